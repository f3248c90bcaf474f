"""What strategies yield, from their tables."""

import csv
import io
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from astropy import units
from astropy.table import Table

from catalogs import parse_table, read_bytes, read_rows
from cpic_planner.planets import load_population
from cpic_planner.results import PlannedVisitRow, VisitsResult, values_of
from cpic_planner.survey.observed import COLUMNS, read_schedule
from cpic_planner.survey.outcome import (
    VISIT_FILES,
    difference_interval,
    differences,
    mean_interval,
    outcome,
    planned_rows,
    rank_changes,
    spread,
    visit_files,
)
from cpic_planner.survey.prepare import prepare
from cpic_planner.survey.simulate import simulate_survey
from cpic_planner.survey.visibility import load_visibility, visibility


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
    u = {
        name: np.zeros_like(values) if name not in ("strategy", "universe") else values
        for name, values in tables["universes"].items()
    }
    d = {name: values[:0] for name, values in tables["detections"].items()}
    s = {
        name: np.zeros_like(values)
        if name in ("new_planets", "known_planets", "visits", "search_h", "follow_up_h")
        else values
        for name, values in tables["stars"].items()
    }
    o = {name: values[:0] for name, values in tables["orbits"].items()}
    found = outcome(survey, {"universes": u, "detections": d, "stars": s, "orbits": o}, [""] * 3, None)
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
