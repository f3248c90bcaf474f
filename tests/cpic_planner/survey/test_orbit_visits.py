"""Visits for orbits: slots against a search of all of them, and what they bring and cost in played universes."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

import cpic_planner.survey.prepare as prepare_module
import cpic_planner.survey.simulate as module
from cpic_planner.planets import astrometric_error_arcsec, orbit_quality
from cpic_planner.survey.detection import detection_chance
from cpic_planner.survey.orbits import LEAST_ODDS, next_window, orbit_chance
from cpic_planner.survey.prepare import prepare
from cpic_planner.survey.schedule import StarValue
from cpic_planner.survey.simulate import Epoch, best_slots, found_orbits, positions_of, simulate_survey
from cpic_planner.survey.universe import NEW

STAR, SEASON = "eps Eri", {"start_utc": "2033-01-01", "duration_days": 1095, "slot_days": 30}
N = 200


@pytest.fixture(scope="module")
def season(small):
    """One star in the years in which its known planet stands in the dark hole."""
    rules = {"targets": {"names": [STAR]}, "revisits": {"max_visits": 6}}
    return prepare(small(rules, universe=SEASON)).surveys[0]


@pytest.fixture(scope="module")
def many(season, change):
    """The same with many new planets, a rule that a few positions meet, and visits for orbits."""
    population = season.strategy.population.model_copy(update={"planets_per_star": 3.0})
    rule = {"visits": 6, "axis_error": 0.3, "place_error_lambda_d": 0.6}
    return change(season, population=population, detection={"half_factor": 0.39}, orbit=rule)


def played(survey, n=N):
    return module._played(survey, 0, n, 1)


def shown_twice(survey, change):
    """The star after a survey without visits for orbits; planets found whose orbit is not known."""
    run = played(change(survey, orbit={"visits": 0}, stop={"after_detection": False}))
    (star,) = run.stars.values()
    known = found_orbits(survey, 0, star, star.found)
    rows = np.setdiff1d(np.flatnonzero(star.found), known.planet[known.known])
    return run, star, rows


def errors_with(survey, star, row, ahead, chosen):
    """Whether positions in some slots make an orbit known, by the public law alone."""
    rule, seen, planet = survey.strategy.orbit, positions_of(survey, star, np.array([row])), star.planets.select([row])
    width = survey.model.metrics["F520"].lambda_d_arcsec
    slots = list(chosen)
    new = astrometric_error_arcsec(ahead[1, slots, row], width, rule.floor_mas)
    days = np.append(seen.day[0], survey.calendar.day[0, slots])[None]
    errors = np.append(seen.error_arcsec[0], new)[None]
    last = days[np.isfinite(errors)].max()
    found = orbit_quality(
        planet,
        planet.period_days,
        float(survey.targets.distance_pc[0]),
        days,
        errors,
        next_window(survey.calendar, 0, np.array([last]), survey.strategy.revisits.min_gap_days),
        star_mass_error=rule.star_mass_error,
        published=seen.published,
    )
    enough = found.epochs[0] >= 2 and (found.epochs[0] >= 4 or found.arc_periods[0] < 1.0 or seen.period_error[0] < 0.1)
    good = found.axis_error <= rule.axis_error and found.place_error_arcsec / width <= rule.place_error_lambda_d
    return bool(good and enough)


def test_slots_are_the_fewest_that_make_the_orbit_known(many, change):
    survey = change(many, orbit={"visits": 2})
    run, star, rows = shown_twice(survey, change)
    setting, gap = survey.options[0][0], survey.strategy.revisits.min_gap_days
    run._ahead(0, star, rows, setting, 0)
    ahead, day = star.ahead[setting], survey.calendar.day[0]
    cost = survey.calendar.cost_h(survey.model, 0, setting, survey.strategy.visit.settlings)
    found = best_slots(survey, 0, star, rows, setting, 0, ahead[:, :, rows])
    last = positions_of(survey, star, rows).last_day
    missed, answers = 0, set()
    for k, row in enumerate(rows[:60].tolist()):
        free = np.flatnonzero(np.isfinite(cost) & (ahead[0, :, row] >= LEAST_ODDS) & (day >= last[k] + gap - 1e-9))
        one = {slot for slot in free.tolist() if errors_with(survey, star, row, ahead, [slot])}
        apart = [pair for pair in itertools.combinations(free.tolist(), 2) if day[pair[1]] - day[pair[0]] >= gap - 1e-9]
        chosen = tuple(np.flatnonzero(found[:, k]).tolist())
        answers.add((bool(one), len(chosen)))
        if one:
            assert len(chosen) == 1
            assert set(chosen) <= one
        elif chosen:
            assert chosen in apart
            assert errors_with(survey, star, row, ahead, chosen)
        else:
            missed += any(errors_with(survey, star, row, ahead, pair) for pair in apart)
    assert {(True, 1), (False, 0)} <= answers
    # One point at a time may miss a pair.
    assert missed <= 2


def test_visits_for_orbits_make_orbits_known(season, change):
    """The same calendar and the same luck: what is found is the same, and more of it has an orbit in fewer hours."""
    # Visits of an hour measure the place of the known planet so well that a few of them meet this.
    season = change(season, orbit={"visits": 0, "place_error_lambda_d": 0.6})
    until = {"after_detection": False, "after_orbit": True}
    others = change(season, orbit={"visits": 6}), change(season, stop=until, alarms={"check": False})
    none, goal, stays = (simulate_survey(one, block=0, n=N, seed=1).universes for one in (season, *others))
    for name in ("new_planets", "known_planets", "search_h"):
        np.testing.assert_array_equal(goal[name], none[name])
    assert none["orbits_known"].sum() == 0
    more = goal["orbits_known"] - stays["orbits_known"]
    assert more.mean() > 2.0 * more.std() / np.sqrt(N)
    hours = [sum(part[name].mean() for name in ("search_h", "follow_up_h", "alarm_h")) for part in (goal, stays)]
    assert hours[0] < 0.8 * hours[1]


def test_the_calendar_does_not_know_of_them(small, plain):
    """The schedule and its bound are those of detections, with visits for orbits or without."""
    (survey,) = prepare(small({"orbit": {"visits": 6}})).surveys
    assert survey.schedule == plain.surveys[0].schedule


def test_visits_for_orbits_are_paid_and_bounded(many, change):
    for most in (1, 2):
        survey = change(many, orbit={"visits": most})
        run = played(survey)
        (star,) = run.stars.values()
        assert star.orbit_visits.max() == most
        assert (run.clock.used <= survey.strategy.time_budget_h + 1e-6).all()
        assert run.clock.used + run.clock.left == pytest.approx(survey.strategy.time_budget_h)
        made = star.orbit_visits > 0
        assert (run.clock.follow[made] > 0.0).all()


def test_a_new_planet_is_confirmed_first(many):
    run = played(many)
    (star,) = run.stars.values()
    visited = star.orbit_visits[star.planets.universe] > 0
    alone = np.bincount(star.planets.universe[star.found], minlength=N) == 1
    new = star.found & (star.planets.known == NEW) & visited & alone[star.planets.universe]
    assert new.any()
    assert star.confirmed[new].all()
    assert (np.sum([epoch.shown for epoch in star.epochs], axis=0)[new] >= 2).all()


def test_no_visit_where_none_can_reach_the_rule(many, change):
    run = played(change(many, orbit={"place_error_lambda_d": 1e-6}))
    (star,) = run.stars.values()
    assert star.found.any()
    assert not star.orbit_visits.any()


def test_positions_of_one_planet_keep_their_gap(many, change):
    survey = change(many, revisits={"min_gap_days": 90.0})
    run = played(survey)
    (star,) = run.stars.values()
    assert star.orbit_visits.any()
    days, shown = np.array([epoch.day for epoch in star.epochs]), np.array([epoch.shown for epoch in star.epochs])
    known = star.planets.known != NEW  # no second look of another gap
    gaps = [np.diff(np.sort(days[shown[:, row]])).min() for row in np.flatnonzero(known & (shown.sum(axis=0) > 1))]
    assert min(gaps) >= 90.0 - 1e-6


@pytest.fixture(scope="module")
def valued(many, change, small):
    """The star of the season with what its orbits are worth, and the same without."""
    rules = {"targets": {"names": [STAR]}, "revisits": {"max_visits": 6}}
    orbit = {"visits": 4, "axis_error": 0.3, "place_error_lambda_d": 0.6}
    problems = []
    with pytest.MonkeyPatch.context() as patch:
        make = prepare_module.make_schedule
        patch.setattr(prepare_module, "make_schedule", lambda problem: problems.append(problem) or make(problem))
        prepared = [prepare(small(rules | {"orbit": orbit | {"value": v}}, universe=SEASON)) for v in (0, 2)]
    return problems, prepared


def test_orbits_are_further_planets_that_only_early_slots_show(valued):
    (without, problem), _ = valued
    (plain,), (star,) = without.stars, problem.stars
    n = len(plain.weight)
    assert 0 < star.orbits <= n
    assert plain.orbits == 0
    for one in (star.detections, plain):
        np.testing.assert_array_equal(one.chance, plain.chance)
        np.testing.assert_array_equal(one.weight, plain.weight)
    extra = star.chance[:, :, n:]
    assert np.isin(star.known[n:], star.known[:n]).all()
    # Each is one of the planets, in some of its slots, at twice its weight.
    twins = [
        j
        for k in range(0, star.orbits, 7)
        for j in np.flatnonzero(star.weight[:n] * 2.0 == star.weight[n + k])
        if (np.isin(extra[..., k], [0.0]) | (extra[..., k] == plain.chance[..., j])).all()
    ]
    assert len(twins) >= len(range(0, star.orbits, 7))
    # From the last open slot there is none to come, and none of its planets has its node published.
    assert not extra[:, np.flatnonzero(np.isfinite(star.cost_h[0]))[-1]].any()


def test_a_slot_is_early_enough_where_the_positions_to_come_make_the_orbit_known(many, change):
    """Against the public law of orbits, for planets of one star, slot by slot."""
    survey = change(many, orbit={"visits": 2})
    run = played(change(survey, orbit={"visits": 0}))
    star, setting = run.stars[0], survey.options[0][0]
    rows = np.flatnonzero(star.allowed)[:60]
    planets = star.planets.select(rows)
    b, gap = survey.calendar.n_slots, survey.strategy.revisits.min_gap_days
    where = survey.strategy, survey.model, survey.targets.select([0]), survey.calendar, 0, setting
    how = {"albedos": run.albedos, "zodis": None}
    chance = np.full((b, len(rows)), 0.25)
    found = orbit_chance(*where, chance, planets, survey.known, **how)
    assert set(np.unique(found)) == {0.0, 0.25}
    cost = survey.calendar.cost_h(survey.model, 0, setting, survey.strategy.visit.settlings)
    slots, day = np.flatnonzero(np.isfinite(cost)), survey.calendar.day[0]
    assert not found[~np.isfinite(cost)].any()
    every = np.ones(len(rows), bool)
    seen, odds, _ = run._visited(0, setting, planets, np.array([slots, slots * 0]), every, None)
    odds = detection_chance(seen, survey.strategy.detection, every, calibration=survey.strategy.detection.calibration)
    published = star.published
    for k in range(len(rows)):
        for begin in range(len(slots)):
            chosen = [begin] if seen.snr[begin, k] > 0.0 else []
            for later in range(begin + 1, len(slots)):
                apart = chosen and day[slots[later]] >= day[slots[chosen[-1]]] + gap - 1e-9
                if apart and len(chosen) < 3 and odds[later, k] >= LEAST_ODDS:
                    chosen.append(later)
            shown = [every[:1]] * len(chosen)
            epochs = [
                Epoch(day[slots[s]], "F520", seen.snr[s, k : k + 1], show)
                for s, show in zip(chosen, shown, strict=True)
            ]
            one = SimpleNamespace(planets=planets.select([k]), published=published)
            known = False
            for count in range(2, len(chosen) + 1):
                one.epochs = epochs[:count]
                known |= bool(found_orbits(survey, 0, one, every[:1]).known[0])
            assert (found[slots[begin], k] > 0.0) == known, (k, begin)


def test_a_schedule_that_values_orbits_has_more_of_them(valued):
    """Bounds hold for what is counted, and odds of visits are those of detections."""
    (_, problem), prepared = valued
    plain, orbits = (item.surveys[0].schedule for item in prepared)
    assert orbits.value <= orbits.bound * (1.0 + 1e-9)

    def worth(schedule):
        visits = [(visit.option, visit.slot) for visit in schedule.visits if not visit.reserve]
        return StarValue.of(problem.stars[0], problem.needed, visits).value

    assert worth(orbits) == pytest.approx(orbits.value)
    assert worth(orbits) > worth(plain)
    assert max(visit.probability for visit in prepared[1].surveys[0].schedule.visits) <= 1.0
