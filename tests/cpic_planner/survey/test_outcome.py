"""Intervals that hold what they promise, tables of results, and what each fact moves."""

import csv
import functools
import hashlib
import io
import json
import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest
from astropy import units
from astropy.table import Table
from hypothesis import assume, given, strategies as st
from scipy.stats import norm, t as student

from catalogs import parse_table, read_bytes, read_rows
from cpic_planner.jobs.folder import open_run_folder
from cpic_planner.planets import load_population
from cpic_planner.results import PlannedVisitRow, VisitsResult, WhatIfResult, values_of
from cpic_planner.survey import load_strategies, run_whatif, with_universe
from cpic_planner.survey.observed import COLUMNS, read_schedule
from cpic_planner.survey.outcome import (
    ALL,
    FACTS,
    QUANTITIES,
    VISIT_FILES,
    convergence,
    counts_of,
    difference_interval,
    differences,
    facts_record,
    mean_interval,
    outcome,
    planned_rows,
    rank_changes,
    spread,
    taken_back,
    visit_files,
)
from cpic_planner.survey.prepare import prepare
from cpic_planner.survey.simulate import simulate_survey
from cpic_planner.survey.tables import TABLES, ResultStore
from cpic_planner.survey.visibility import load_visibility, visibility
from cpic_planner.survey.whatif import whatif_cost


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
    survey = plain.surveys[0]
    nothing = replace(survey, schedule=replace(survey.schedule, visits=()))
    rows = simulate_survey(nothing, block=0, n=5, seed=1).rows("none", 0)
    assert np.array_equal(rows["universes"]["universe"], np.arange(5))
    assert all(len(values) == 0 for values in rows["detections"].values())


def tables_of(survey, n=150, seed=1):
    return simulate_survey(survey, block=0, n=n, seed=seed).rows(survey.strategy.name, 0)


@pytest.fixture(scope="module")
def played(small):
    """Two strategies, one with follow-up, over the same universes."""
    shy = {"name": "shy", "visit": {"time_s": 3000}, "revisits": {"max_visits": 2}, "follow_up": {"bands": ["F520"]}}
    prepared = prepare(small({"name": "plain"}, shy))
    return [(survey, tables_of(survey)) for survey in prepared.surveys]


@pytest.fixture(scope="module")
def outcomes(played):
    return [outcome(survey, tables, ["2028-01-15"] * len(survey.targets), None) for survey, tables in played]


def test_yields_are_means_over_universes(played, outcomes):
    for (_, tables), found in zip(played, outcomes, strict=True):
        u = tables["universes"]
        total = u["new_planets"] + u["known_planets"]
        interval = mean_interval(total)
        assert (found.planets.mean, found.planets.high) == (interval.mean, interval.high)
        assert (found.planets.survey_low, found.planets.survey_high) == spread(total)
        assert found.planets.low >= 0.0
        assert found.planets.mean == pytest.approx(found.new_planets.mean + found.known_planets.mean)
        assert found.any_planet == np.mean(total > 0)
        assert found.any_new_planet == np.mean(u["new_planets"] > 0)
        assert found.hours.mean == pytest.approx(np.mean(u["search_h"] + u["follow_up_h"]))


def test_new_planets_over_the_range_of_the_occurrence_rate(played, outcomes):
    for (survey, tables), found in zip(played, outcomes, strict=True):
        rate = found.occurrence
        low, high = survey.strategy.population.provenance["planets_per_star"].range
        assert (rate.planets_per_star, rate.planets_per_star_low, rate.planets_per_star_high) == (0.21, low, high)
        assert (low, high) == (0.14, 0.26)
        assert rate.low / low == pytest.approx(found.new_planets.mean / 0.21)
        assert rate.high / high == pytest.approx(found.new_planets.mean / 0.21)
        whole = tables["universes"]["new_planets_unconditional"]
        assert found.new_planets_unconditional.mean == whole.mean()
        stars = sum(target.new_planets_unconditional for target in found.targets)
        assert stars == pytest.approx(whole.mean())
    (survey, tables), *_ = played
    stated = load_population({"base": "giants", "planets_per_star": 0.3})
    own = replace(survey, strategy=survey.strategy.model_copy(update={"population": stated}))
    assert outcome(own, tables, ["2028-01-15"] * len(survey.targets), None).occurrence is None


def test_the_curve_ends_with_everything(played, outcomes):
    for (_, tables), found in zip(played, outcomes, strict=True):
        means = [point.mean for point in found.curve]
        assert np.all(np.diff(means) >= 0.0)
        assert means[0] == 0.0
        assert means[-1] == pytest.approx(found.planets.mean)
        d, n = tables["detections"], len(tables["universes"]["visits"])
        middle = found.curve[20]
        assert middle.mean == pytest.approx(np.count_nonzero(d["used_h"] <= middle.x) / n)
        assert all(point.low <= point.mean <= point.high for point in found.curve)


def test_time_adds_up_to_the_budget(played, outcomes):
    for (survey, tables), found in zip(played, outcomes, strict=True):
        use = found.time_use
        parts = use.exposing_h + use.occulted_h + use.settling_h + use.follow_up_h + use.unused_h
        assert parts == pytest.approx(survey.strategy.time_budget_h) == pytest.approx(use.budget_h)
        assert use.budget_share == pytest.approx(survey.strategy.time_budget_h / (730.0 * 24.0))
        assert use.follow_up_h == pytest.approx(float(tables["universes"]["follow_up_h"].mean()))
        assert min(use.exposing_h, use.occulted_h, use.settling_h) > 0.0
        visits = float(tables["stars"]["visits"].sum()) / len(tables["universes"]["visits"])
        assert use.settling_h == pytest.approx(visits * survey.strategy.visit.settlings * survey.calendar.settle_h)


def test_targets_by_rank(played, outcomes):
    for (survey, tables), found in zip(played, outcomes, strict=True):
        rates = [target.planets_per_100h for target in found.targets]
        assert rates == sorted(rates, reverse=True)
        assert [target.rank for target in found.targets] == list(range(1, len(rates) + 1))
        total = sum(target.new_planets + target.known_seen for target in found.targets)
        assert total == pytest.approx(found.planets.mean)
        assert sum(target.planned_visits for target in found.targets) == found.schedule.visits
        for target in found.targets:
            mine = tables["stars"]["star"] == target.name
            assert target.visits == pytest.approx(tables["stars"]["visits"][mine].sum() / 150)
            hours = target.search_h + target.follow_up_h
            assert target.planets_per_100h == pytest.approx(100 * (target.new_planets + target.known_seen) / hours)
        assert {"eps Eri b"} <= {name for target in found.targets for name in target.known_planets}
        assert survey.strategy.name == found.name


def test_quantiles_are_those_of_detections(played, outcomes):
    for (_, tables), found in zip(played, outcomes, strict=True):
        for name, values in found.quantiles.items():
            np.testing.assert_allclose(values, np.quantile(tables["detections"][name], [0.05, 0.25, 0.5, 0.75, 0.95]))
        assert "snr" in found.quantiles


def test_paired_differences(played):
    names, tables = [survey.strategy.name for survey, _ in played], [item["universes"] for _, item in played]
    found = {item.quantity: item for item in differences(names, tables)}
    assert set(found) == {"planets", "new_planets", "characterised_planets", "orbits_known", "hours"}
    one = tables[1]["new_planets"] + tables[1]["known_planets"] - tables[0]["new_planets"] - tables[0]["known_planets"]
    item = found["planets"]
    assert (item.first, item.second) == ("shy", "plain")
    assert item.mean == pytest.approx(one.mean())
    assert (item.low, item.high) == (difference_interval(one).low, difference_interval(one).high)
    assert item.correlation == pytest.approx(
        np.corrcoef(*(t["new_planets"] + t["known_planets"] for t in tables))[0, 1]
    )
    assert ("fewer" in item.verdict) == (item.high < 0)
    turned = {item.quantity: item for item in differences(names[::-1], tables[::-1])}
    assert turned["planets"].mean == pytest.approx(-item.mean)
    assert (turned["planets"].low, turned["planets"].high) == pytest.approx((-item.high, -item.low))


def test_equal_strategies_do_not_differ(played):
    tables = played[0][1]["universes"]
    for item in differences(["a", "b"], [tables, tables]):
        assert (item.mean, item.error) == (0.0, 0.0)
        assert item.low < 0.0 < item.high
        assert "do not differ" in item.verdict


def test_many_strategies_are_compared_with_the_first(played):
    tables = played[0][1]["universes"]
    better = dict(tables) | {"new_planets": tables["new_planets"] + 1}
    best = dict(tables) | {"new_planets": tables["new_planets"] + 2}
    names = [f"s{k}" for k in range(8)]
    found = differences(names, [tables] * 6 + [better, best])
    pairs = {(item.first, item.second) for item in found}
    assert {(name, "s0") for name in names[1:]} <= pairs
    assert pairs - {(name, "s0") for name in names[1:]} == {("s7", "s6")}
    few = differences(names[:4], [tables] * 4)
    assert len({(item.first, item.second) for item in few}) == 6


def test_changes_of_rank_say_why(outcomes):
    changes = rank_changes(outcomes)
    first, other = ({target.name: target.rank for target in item.targets} for item in outcomes)
    for change in changes:
        assert change.strategy == "shy"
        assert (change.first_rank, change.rank) == (first.get(change.star), other.get(change.star))
        assert change.first_rank != change.rank
        assert change.why
    assert rank_changes([outcomes[0], outcomes[0]]) == []


def test_nothing_found(played):
    survey, tables = played[0]
    events, named = ("detections", "orbits"), ("strategy", "universe", "star", "block", "universes")
    empty = {
        table: {
            name: values[:0] if table in events else values if name in named else np.zeros_like(values)
            for name, values in columns.items()
        }
        for table, columns in tables.items()
    }
    found = outcome(survey, empty, [""] * 3, None)
    assert found.planets.mean == found.any_planet == 0.0
    assert found.quantiles == {}
    assert found.planets.high > 0.0  # not met is not impossible
    assert found.planets.low == 0.0
    assert all(target.planets_per_100h == 0.0 for target in found.targets)
    assert found.time_use.unused_h == survey.strategy.time_budget_h


ABOUT = {"version": "1", "config_hash": "0123456789abcdef", "catalogue": "stars", "date_utc": "2028-01-01T00:00:00"}


@pytest.fixture(scope="module")
def rows(plain):
    return list(planned_rows(plain.surveys[0]))


def test_a_planned_visit_is_where_and_when_the_calendar_has_it(plain, rows):
    (survey,), universe = plain.surveys, plain.config.universe
    calendar, orbit = survey.calendar, survey.model.instrument.mission.orbit
    fine = visibility(
        survey.targets.ra_deg,
        survey.targets.dec_deg,
        load_visibility(),
        orbit,
        start_utc=universe.start_utc,
        n_days=730,
        step_days=0.5,
    )
    assert [row.visit for row in rows] == list(range(1, len(survey.schedule.visits) + 1))
    for row, visit in zip(rows, survey.schedule.visits, strict=True):
        setting = survey.options[visit.star][visit.option]
        assert (row.star, row.band, row.frames_per_visit) == (survey.targets.name[visit.star], "F520", setting.n_frames)
        assert (row.exposure_s, row.em_gain) == pytest.approx((setting.exposure_s, setting.em_gain), rel=1e-5)
        begin = calendar.start_mjd + 60.0 * visit.slot
        assert begin <= row.window_start_mjd < row.window_end_mjd <= begin + 60.0
        middle = calendar.start_mjd + calendar.day[visit.star, visit.slot]
        assert row.window_start_mjd < middle < row.window_end_mjd
        # A calendar that looks every ten days, beside every half of one: none is seen farther out than that.
        mine = (fine.mjd > begin) & (fine.mjd < begin + 60.0) & fine.observable[visit.star]
        seen = fine.mjd[mine]
        assert seen.min() > row.window_start_mjd - 10.0
        assert seen.max() < row.window_end_mjd + 10.0
        inside = mine & (fine.mjd > row.window_start_mjd) & (fine.mjd < row.window_end_mjd)
        minutes = fine.visible_s[visit.star, inside] / 60.0
        assert minutes.min() - 1.0 < row.arc_usable_min < minutes.max() + 1.0
        longest = fine.window_s[visit.star, inside] / 60.0
        assert longest.min() - 1.0 < row.arc_longest_min < longest.max() + 1.0
        # The frames fill the arcs, and the arcs and settlings the telescope time.
        assert (row.arcs - 1) * row.arc_usable_min * 60.0 < row.time_s * 1.05
        assert row.arcs * row.arc_usable_min * 60.0 >= row.time_s
        orbits_h = row.telescope_h - 2 * calendar.settle_h
        assert row.arcs - 1 < orbits_h * 3600.0 / calendar.period_s <= row.arcs + 1e-3
        assert row.roll_deg == pytest.approx(calendar.sun_pa_deg[visit.star, visit.slot], abs=0.01)
    assert "known_planet" in {row.reason for row in rows if row.star == "eps Eri"}
    assert {row.reason for row in rows if row.star == "alf Cen A"} == {"search"}
    assert [row.reserve for row in rows] == [visit.reserve for visit in survey.schedule.visits]
    assert {row.quadrants for row in rows} == {"all"}


def test_two_quadrants_have_names(plain):
    (survey,) = plain.surveys
    metrics = {band: replace(item, hole_mode="2q", hole_side="top") for band, item in survey.model.metrics.items()}
    half = replace(survey, model=replace(survey.model, metrics=metrics))
    assert next(planned_rows(half)).quadrants == "upper right; upper left"


def test_the_three_files_are_one_table(plain, rows, tmp_path):
    """What each says reads back as it was, units and meanings with it, by others' readers and by ours."""
    for name, text in visit_files(plain.surveys, ABOUT).items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    by_csv, by_ecsv, by_json = (tmp_path / name for name in VISIT_FILES)
    stored = VisitsResult.model_validate_json(by_json.read_text())
    assert stored.visits == rows
    assert {name: getattr(stored, name) for name in ABOUT} == ABOUT
    table = Table.read(by_ecsv, format="ascii.ecsv")
    assert table.meta["config_hash"] == ABOUT["config_hash"]
    assert (table["telescope_h"].unit, table["arc_usable_min"].unit) == (units.h, units.min)
    assert all(table[name].description for name in table.colnames)
    lines = list(csv.DictReader(io.StringIO(by_csv.read_text())))
    assert list(lines[0]) == table.colnames == list(PlannedVisitRow.model_fields)
    for path in (by_csv, by_ecsv):
        read = read_rows(parse_table(read_bytes(path)), COLUMNS, (), about="star").rows
        for row, got in zip(rows, read, strict=True):
            assert got == {name: value for name, value in values_of(row).items() if value is not None}, path.name
    found = [read_schedule(path)[0] for path in (by_csv, by_ecsv, by_json)]
    # nan is not equal to itself, and no roll or window of these is missing.
    assert found[0] == found[1] == found[2]
    assert not any(math.isnan(visit.roll_deg + visit.mjd) for visit in found[0])
    assert [visit.row for visit in found[0]] == [row.visit for row in rows]


def test_a_calendar_without_visits_is_a_table_without_rows(plain):
    empty = replace(plain.surveys[0], schedule=replace(plain.surveys[0].schedule, visits=()))
    texts = visit_files([empty], ABOUT)
    assert texts["visits.csv"].splitlines() == [",".join(PlannedVisitRow.model_fields)]
    assert json.loads(texts["visits.json"])["visits"] == []
    assert len(Table.read(texts["visits.ecsv"], format="ascii.ecsv")) == 0


ALL_FACTS = ("known_planets", "rv", "stability", "known_giants", "companions", ALL)
STRATEGIES = ({"name": "plain"}, {"name": "plain 1", "visit": {"time_s": 18000}})
UNIVERSE = {"universes": 120, "exclusions": ["rv", "known_giants"], "facts": True}


def asked(**universe):
    return taken_back(with_universe(load_strategies(), {"facts": True} | universe))


def test_each_state_takes_one_fact_back():
    states = {name: state.universe for name, state in asked().items()}
    assert tuple(states) == ALL_FACTS
    now = with_universe(load_strategies(), {"facts": True}).universe
    changed = {
        "known_planets": {"known_planets": "archive_2019"},
        "rv": {"exclusions": ("stability", "known_giants")},
        "stability": {"exclusions": ("rv", "known_giants")},
        "known_giants": {"exclusions": ("rv", "stability")},
        "companions": {"catalog": "simbad_2012"},
        ALL: {"known_planets": "archive_2019", "exclusions": (), "catalog": "simbad_2012"},
    }
    for name, state in states.items():
        assert state == now.model_copy(update=changed[name]), name


@pytest.mark.parametrize(
    ("universe", "names"),
    [
        ({"facts": False}, ()),
        ({"known_planets": "off"}, ("rv", "stability", "known_giants", "companions", ALL)),
        ({"known_planets": "archive_2019"}, ("rv", "stability", "known_giants", "companions", ALL)),
        ({"known_planets": "none+mine.csv"}, ("rv", "stability", "known_giants", "companions", ALL)),
        ({"exclusions": "none"}, ("known_planets", "companions", ALL)),
        ({"exclusions": "rv", "known_planets": "off", "catalog": "simbad_2012"}, ("rv",)),
    ],
)
def test_facts_that_a_survey_does_not_use_are_left_out(universe, names):
    assert tuple(asked(**universe)) == names


def test_a_table_of_ones_own_is_laid_over_that_of_2019():
    for source in ("mine.csv", "snapshot+mine.csv"):
        assert asked(known_planets=source)["known_planets"].universe.known_planets == "archive_2019+mine.csv"


@pytest.fixture(scope="module")
def config(small):
    return small(*STRATEGIES, universe=UNIVERSE)


@pytest.fixture(scope="module")
def run(config, tmp_path_factory):
    """Two strategies, the name of one the beginning of the other's, with every fact that they use."""
    folder, told = tmp_path_factory.mktemp("facts"), []
    result = run_whatif(config, folder, pages=False, advance=lambda text, steps=1, /: told.append(steps)).result
    return folder, result, told


def universes_of(folder, strategy):
    columns = pd.read_parquet(folder / "universes.parquet")
    mine = columns["strategy"] == strategy
    return counts_of({name: columns[name][mine] for name in ("new_planets", "known_planets")})


@pytest.mark.parametrize("fact", ["known_planets", "rv", ALL])
def test_every_row_is_a_run_without_the_fact(run, config, tmp_path, fact):
    folder, result, _ = run
    state = with_universe(taken_back(config)[fact], {"facts": False})
    run_whatif(state, tmp_path / "separate", pages=False)
    for row in (row for row in result.facts.rows if row.fact == fact):
        before, now = (universes_of(where, row.strategy) for where in (tmp_path / "separate", folder))
        for name in QUANTITIES:
            mean, change = mean_interval(before[name]), difference_interval(before[name] - now[name])
            assert getattr(row, name).mean == mean.mean
            assert getattr(row, name).error == mean.error
            found = getattr(row, f"{name}_change")
            assert (found.mean, found.low, found.high) == (change.mean, change.low, change.high)


def test_the_record_says_what_was_taken_back(run):
    _, result, _ = run
    found = {item.name: item for item in result.facts.facts}
    assert tuple(found) == ("known_planets", "rv", "known_giants", "companions", ALL)
    assert found["known_planets"].known_planets == "archive_2019"
    assert found["companions"].catalog == "simbad_2012"
    assert [item.exclusions for item in found.values()] == [
        ["rv", "known_giants"],
        ["known_giants"],
        ["rv"],
        ["rv", "known_giants"],
        [],
    ]
    pairs = [(row.fact, row.strategy) for row in result.facts.rows]
    assert pairs == [(name, item["name"]) for name in found for item in STRATEGIES]


def test_velocities_take_new_planets_away(run):
    """Around eps Eri, tau Cet and alpha Centauri most giants would have been found."""
    _, result, _ = run
    change = next(row.new_planets_change for row in result.facts.rows if (row.fact, row.strategy) == ("rv", "plain"))
    assert change.mean > 0.0
    assert "The fact that moves most" in result.facts.statement


def test_steps_are_told_and_the_result_is_kept(run, config):
    folder, result, told = run
    assert sum(told) == whatif_cost(config).counts["n_steps"]
    assert WhatIfResult.model_validate_json((folder / "whatif.json").read_text()) == result


@pytest.mark.long
def test_workers_and_a_break_change_nothing(small, tmp_path):
    config = small(universe={"universes": 40, "exclusions": ["rv"], "facts": True})
    for name, workers in (("alone", 1), ("two", 2)):
        made = run_whatif(config, tmp_path / name, pages=False, workers=workers)
        assert made.computed_parts > 0
    assert [fact.name for fact in made.result.facts.facts] == ["known_planets", "rv", "companions", ALL]
    bodies = [(tmp_path / name / "whatif.json").read_bytes() for name in ("alone", "two")]
    assert len({hashlib.sha256(body).hexdigest() for body in bodies}) == 1
    again = run_whatif(config, tmp_path / "two", pages=False)
    assert again.computed_parts == 0


def test_without_being_asked_there_is_no_comparison(small, tmp_path):
    config = small(universe={"universes": 10})
    assert run_whatif(config, tmp_path, pages=False).result.facts is None


def counts(new, known):
    return counts_of({"new_planets": np.array(new), "known_planets": np.array(known)})


def test_the_statement_names_the_fact_that_moves_most_planets_and_most_new_ones(run, config):
    _, result, _ = run
    (outcome, _), zero = result.strategies, [0] * 200
    now = counts(zero, zero)
    one, two, rare = [1, 0] * 100, [2, 1] * 100, [1] + [0] * 199
    states = {fact.name: config for fact in FACTS}
    without = {name: [now] for name in states} | {"rv": [counts(one, zero)], "known_planets": [counts(zero, two)]}
    said = facts_record(states, [outcome], [now], without).statement
    assert said.startswith("The fact that moves most planets is what was published on known planets since 2019: plain")
    assert f"finds {outcome.planets.mean:.2f} with it and 1.50 without" in said
    assert "The fact that moves most new planets is what radial velocities exclude: plain finds" in said
    without["known_planets"] = [now]
    said = facts_record(states, [outcome], [now], without).statement
    assert said.count("The fact that moves most") == 1
    without["rv"] = [counts(rare, zero)]
    said = facts_record(states, [outcome], [now], without).statement
    assert said == "No single fact changes the planets found by more than chance."
