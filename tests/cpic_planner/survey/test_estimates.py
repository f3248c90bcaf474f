"""Intervals that hold what they promise, over many repeats of known laws.

Tables of a survey: every column declared, keys unique, universes numbered over all blocks.
"""

import functools
import json
import math

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import assume, given, strategies as st
from scipy.stats import norm, t as student

from cpic_planner.jobs.folder import open_run_folder
from cpic_planner.survey.outcome import convergence, difference_interval, mean_interval, spread
from cpic_planner.survey.simulate import simulate_survey
from cpic_planner.survey.tables import TABLES, ResultStore


@functools.cache
def interval_of(counts):
    """Interval of counts that occur so often: few tables of sparse counts differ."""
    values, numbers = zip(*counts, strict=True)
    return mean_interval(np.repeat(np.array(values, float), numbers))


@functools.cache
def difference_of(counts):
    """The same of differences."""
    values, numbers = zip(*counts, strict=True)
    return difference_interval(np.repeat(np.array(values, float), numbers))


def coverage(draw, truth, repeats=1000, seed=0, of=interval_of):
    """Share of the repeats whose interval holds the true mean."""
    rng = np.random.default_rng(seed)
    held = 0
    for _ in range(repeats):
        values, numbers = np.unique(draw(rng), return_counts=True)
        found = of(tuple(zip(values.tolist(), numbers.tolist(), strict=True)))
        held += found.low <= truth <= found.high
    return held / repeats


# Differences of paired yields: what both find cancels, what one alone finds is sparse. At 1000 repeats the share of a
# true 90 % has a standard error of 0.9 %.
@pytest.mark.parametrize(("n", "first", "second"), [(1000, 0.05, 0.02), (300, 0.03, 0.03), (100, 0.15, 0.05)])
def test_paired_differences_of_sparse_counts(n, first, second):
    share = coverage(lambda rng: rng.poisson(first, n) - rng.poisson(second, n), first - second, of=difference_of)
    assert 0.87 <= share <= 0.93, share


@pytest.mark.parametrize("events", [1.0, 2.0, 4.0])
def test_a_few_differences_of_one_sign_may_be_chance(events):
    """Equal strategies, a few planets each that the other misses: 55 to 80 % hold 0 without a thought of the others."""

    def draw(rng):
        return rng.poisson(events / 100, 100) - rng.poisson(events / 100, 100)

    held = coverage(draw, 0.0, of=difference_of)
    assert 0.87 <= held <= 0.96
    assert held > coverage(draw, 0.0) + 0.03


def test_many_differences_are_those_of_a_mean():
    values = np.random.default_rng(4).normal(3.0, 1.0, 1000)
    one, other = mean_interval(values), difference_interval(values)
    assert (one.mean, one.error) == (other.mean, other.error)
    assert (other.low, other.high) == pytest.approx((one.low, one.high), abs=0.05 * one.error)


@pytest.mark.parametrize(("n", "rate"), [(300, 0.1), (100, 0.2)])
def test_yields(n, rate):
    share = coverage(lambda rng: rng.poisson(rate, n), rate)
    assert 0.87 <= share <= 0.93, share


def test_hours_that_are_skewed():
    share = coverage(lambda rng: rng.exponential(3.0, 300) ** 1.2, 3.0**1.2 * math.gamma(2.2), repeats=600)
    assert 0.87 <= share <= 0.93, share


@pytest.mark.parametrize("level", [0.5, 0.99])
def test_other_levels_of_a_normal_law(level):
    rng = np.random.default_rng(1)
    held = np.mean(
        [
            found.low <= 0.0 <= found.high
            for found in (mean_interval(rng.standard_normal(100), level) for _ in range(600))
        ]
    )
    assert abs(held - level) < 4.0 * np.sqrt(level * (1 - level) / 600) + 0.01


SAMPLES = st.lists(st.integers(-3, 6), min_size=3, max_size=60)


@pytest.mark.parametrize("interval", [mean_interval, difference_interval])
@given(values=SAMPLES, shift=st.integers(-1000, 1000))
def test_a_shift_shifts_and_a_sign_turns(interval, values, shift):
    one = interval(values)
    other, turned = interval(np.array(values) + shift), interval(-np.array(values))
    for name, expected in (("low", one.low + shift), ("mean", one.mean + shift), ("high", one.high + shift)):
        assert getattr(other, name) == pytest.approx(expected, abs=1e-7)
    assert (turned.low, turned.mean, turned.high) == pytest.approx((-one.high, -one.mean, -one.low), abs=1e-9)
    assert one.low <= one.mean <= one.high


@given(values=SAMPLES, factor=st.floats(0.01, 100.0))
def test_a_unit_does_not_matter(values, factor):
    assume(len(set(values)) > 1)
    one, other = mean_interval(values), mean_interval(factor * np.array(values, float))
    assert (other.low, other.high) == pytest.approx((factor * one.low, factor * one.high), rel=1e-9, abs=1e-9)


def test_without_skewness_it_is_students():
    values = norm.ppf((np.arange(400) + 0.5) / 400.0)
    error = values.std(ddof=1) / 20.0
    found = mean_interval(values)
    assert found.error == pytest.approx(error, rel=1e-12)
    assert found.high == pytest.approx(student.ppf(0.95, 399) * error, rel=0.01)
    assert found.low == pytest.approx(-found.high, rel=1e-6)


def test_the_order_of_universes_does_not_matter():
    values = np.random.default_rng(3).poisson(0.4, 300)
    one, other = mean_interval(values), mean_interval(np.sort(values))
    assert one.mean == other.mean
    assert (one.low, one.high, one.error) == pytest.approx((other.low, other.high, other.error), rel=1e-9)


def test_a_longer_tail_reaches_further():
    found = mean_interval([0] * 95 + [1] * 5)
    assert found.high - found.mean > found.mean - found.low > 0.0
    assert found.low > 0.0


@pytest.mark.parametrize("value", [0.0, 7.0, -2.0, 1e7])
def test_constants_leave_what_was_not_met(value):
    found = mean_interval(np.full(400, value))
    assert found.mean == value
    assert found.error == 0.0
    # No event in 400 tries: a rate of ln(10) / 400 gives none in one case of ten.
    assert found.high - value == pytest.approx(np.log(10.0) / 400, rel=1e-6)
    assert value - found.low == pytest.approx(np.log(10.0) / 400, rel=1e-6)


def test_levels_are_refused(refused):
    refused("level = 0.3", mean_interval, [1.0, 2.0], 0.3)


def test_spread_is_that_of_single_surveys():
    values = np.arange(1, 101)
    assert spread(values) == (5.0, 95.0)
    assert spread([0, 0, 0, 1]) == (0.0, 1.0)


def test_convergence_ends_with_everything():
    values = np.random.default_rng(0).poisson(0.3, 700)
    points = convergence(values)
    assert [point.x for point in points] == sorted({point.x for point in points})
    assert (points[0].x, points[-1].x) == (10, 700)
    whole = mean_interval(values)
    assert (points[-1].mean, points[-1].high) == (whole.mean, whole.high)
    assert [point.x for point in convergence([1, 2])] == [2]
    assert [point.x for point in convergence([1, 2, 3, 4, 5])] == [5]


def test_columns_are_those_declared(plain, tmp_path):
    survey = plain.surveys[0]
    parts = [
        simulate_survey(survey, block=block, n=60, seed=1).rows(name, 100 * block)
        for block in (0, 1)
        for name in ("one", "two")
    ]
    for part in parts:
        assert {table.name: {column.name for column in table.columns} for table in TABLES} == {
            name: set(columns) for name, columns in part.items()
        }
    with open_run_folder(tmp_path, kind="whatif", config_hash="1") as folder:
        store = ResultStore(folder, TABLES)
        for number, part in enumerate(parts):
            store.save_part(f"part {number}", part)
        paths = store.merge()
        universes, detections = store.read("universes"), store.read("detections")
    assert len(universes["universe"]) == 240
    assert set(universes["universe"]) == set(range(60)) | set(range(100, 160))
    assert set(detections["universe"]) <= set(universes["universe"])
    stored = pq.read_schema(paths["detections"])
    assert stored.field("separation_arcsec").metadata[b"unit"] == b"arcsec"
    assert json.loads(stored.metadata[b"cpic_planner"])["key"] == ["strategy", "universe", "star", "planet"]
    # What the detections count is what the universes say.
    for name in ("one", "two"):
        mine = detections["strategy"] == name
        total = (universes["new_planets"] + universes["known_planets"])[universes["strategy"] == name].sum()
        assert mine.sum() == total > 0


def test_units_stand_in_the_names():
    suffixes = {"h": "_h", "d": "day", "R_Jup": "_rjup", "au": "_au", "deg": "_deg", "arcsec": "_arcsec"}
    for table in TABLES:
        for column in table.columns:
            assert column.description
            assert column.name.endswith(suffixes.get(column.unit, "")), column.name


def test_an_empty_block_has_its_columns(plain):
    from dataclasses import replace

    survey = plain.surveys[0]
    nothing = replace(survey, schedule=replace(survey.schedule, visits=()))
    rows = simulate_survey(nothing, block=0, n=5, seed=1).rows("none", 0)
    assert np.array_equal(rows["universes"]["universe"], np.arange(5))
    assert all(len(values) == 0 for values in rows["detections"].values())
