"""Orbits of found planets from positions, and visits that are made for them."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import cpic_planner.survey.prepare as prepare_module
import cpic_planner.survey.simulate as module
from cpic_planner.planets import (
    STAR_MASS_ERROR,
    PublishedOrbit,
    astrometric_error_arcsec,
    orbit_quality,
    published_orbit,
)
from cpic_planner.survey.calendar import sun_position_angle_deg
from cpic_planner.survey.detection import detection_chance, expected_signals
from cpic_planner.survey.observed import ObservationLog, ObservedVisit
from cpic_planner.survey.orbits import LEAST_ODDS, next_window, orbit_chance
from cpic_planner.survey.prepare import prepare
from cpic_planner.survey.schedule import StarValue
from cpic_planner.survey.simulate import Epoch, best_slots, found_orbits, logged_epochs, positions_of, simulate_survey
from cpic_planner.survey.universe import NEW, albedos_of, draw_planet_sample

STAR = 1


@pytest.fixture
def sample(plain):
    survey = plain.surveys[0]
    name = str(survey.targets.name[STAR])
    how = {"epoch_mjd": survey.calendar.start_mjd, "n": 6, "seed": 1, "one_each": True}
    return draw_planet_sample(name, 0.8, 0.3, survey.strategy.population, **how)


def history(planets, *epochs):
    return SimpleNamespace(planets=planets, published={}, epochs=[Epoch(*parts) for parts in epochs])


def test_orbits_follow_from_the_visits_that_show_the_planet(plain, sample):
    survey = plain.surveys[0]
    n = len(sample)
    snr = 5.0 + np.arange(n)
    first, second, third = (np.arange(n) % k == 0 for k in (1, 2, 3))
    star = history(
        sample, (30.0, "F520", snr, first), (200.0, "F520", 2.0 * snr, second), (400.0, "F520", 3.0 * snr, third)
    )
    some = np.arange(n) != 4
    found = found_orbits(survey, STAR, star, some)
    # Planets 1 and 5 have one position; 0 has three; 2 and 3 two of each kind; 4 is not asked for.
    assert found.planet.tolist() == [0, 2, 3]
    assert found.quality.epochs.tolist() == [3, 2, 2]
    days = survey.calendar.day[STAR, survey.calendar.fraction[STAR] > 0.0]
    gap = survey.strategy.revisits.min_gap_days
    width = survey.model.metrics["F520"].lambda_d_arcsec
    distance = float(survey.targets.distance_pc[STAR])
    for row, (planet, epochs, factors) in enumerate(
        [(0, [30.0, 200.0, 400.0], [1, 2, 3]), (2, [30.0, 200.0], [1, 2]), (3, [30.0, 400.0], [1, 3])]
    ):
        later = min(day for day in days if day >= epochs[-1] + gap)
        assert found.next_day[row] == later
        one = sample.select([planet])
        errors = astrometric_error_arcsec(snr[planet] * np.array(factors), width)[None]
        alone = orbit_quality(one, one.period_days, distance, np.array([epochs]), errors, np.array([later]))
        assert found.quality.axis_error[row] == pytest.approx(alone.axis_error[0], rel=1e-9)
        assert found.place_error_lambda_d[row] == pytest.approx(alone.place_error_arcsec[0] / width, rel=1e-9)
    rule = survey.strategy.orbit
    both = (found.quality.axis_error <= rule.axis_error) & (found.place_error_lambda_d <= rule.place_error_lambda_d)
    assert found.known.tolist() == both.tolist()


def test_turns_that_nobody_counted_need_a_fourth_position(plain, change, sample):
    """Three fine positions over more than a period may be those of another period."""
    survey = change(plain.surveys[0], orbit={"place_error_lambda_d": 10.0, "floor_mas": 0.01})
    near = replace(sample, period_days=np.full(len(sample), 300.0), semi_major_axis_au=np.full(len(sample), 0.82))
    every = np.ones(len(sample), bool)
    for days, known in (((0, 80, 190), True), ((0, 380, 640), False), ((0, 110, 380, 640), True)):
        found = found_orbits(survey, STAR, history(near, *((day, "F520", 1e4 * every, every) for day in days)), every)
        assert (found.quality.axis_error < 0.2).all()
        assert (found.known == known).all()


def test_behind_the_calendar_the_next_window_is_a_year_later(plain, sample):
    survey = plain.surveys[0]
    every = np.ones(len(sample), bool)
    star = history(sample, (30.0, "F520", 9.0 * every, every), (725.0, "F520", 9.0 * every, every))
    assert found_orbits(survey, STAR, star, every).next_day.tolist() == [725.0 + 365.25] * len(sample)


def test_without_planets_or_epochs_there_is_no_orbit(plain, sample):
    survey = plain.surveys[0]
    for planets, epochs in ((sample.select([]), [(1.0, "F520", np.zeros(0), np.zeros(0, bool))]), (sample, [])):
        found = found_orbits(survey, STAR, history(planets, *epochs), np.ones(len(planets), bool))
        assert len(found.planet) == len(found.known) == len(found.next_day) == 0


EASY = {"floor_mas": 1.0, "axis_error": 0.5, "place_error_lambda_d": 2.0}


@pytest.fixture(scope="module")
def played(plain, change):
    """The small survey with many planets, stopped after the first detection, once an orbit is known, and never."""
    survey = plain.surveys[0]
    population = survey.strategy.population.model_copy(update={"planets_per_star": 3.0})
    survey = change(survey, population=population, detection={"half_factor": 0.065}, orbit=EASY)
    rules = {
        "detection": {"after_detection": True},
        "orbit": {"after_detection": False, "after_orbit": True},
        "never": {"after_detection": False},
    }
    return {name: simulate_survey(change(survey, stop=rule), block=0, n=200, seed=1) for name, rule in rules.items()}


def test_a_planet_needs_two_visits_for_an_orbit(played):
    assert not len(played["detection"].orbits["star"]) or played["detection"].orbits["epochs"].min() >= 2
    assert played["never"].universes["orbits_known"].sum() > played["detection"].universes["orbits_known"].sum()


def test_orbits_are_rows_of_planets_that_were_found(played):
    for tables in played.values():
        orbits, found = tables.orbits, tables.detections
        keys, of = (
            list(zip(*(part[name].tolist() for name in ("universe", "star", "planet")), strict=True))
            for part in (orbits, found)
        )
        assert len(set(keys)) == len(keys)
        assert set(keys) <= set(of)
        counted = np.bincount(orbits["universe"][orbits["orbit_known"]], minlength=200)
        assert counted.tolist() == tables.universes["orbits_known"].tolist()
        assert tables.stars["orbits_known"].sum() == counted.sum()


def test_a_star_is_left_once_an_orbit_is_known(played):
    """The same chance: until then both see the same, and no visit is made that the other does not make."""
    orbit, never = played["orbit"], played["never"]
    saved, known = never.universes["visits"] - orbit.universes["visits"], orbit.universes["orbits_known"]
    assert saved.min() == 0 < saved.max()
    assert (known[saved > 0] > 0).all()
    assert (known == 0).any()
    for name in ("visits", "search_h", "new_planets", "known_planets", "orbits_known"):
        assert (orbit.universes[name] == never.universes[name])[known == 0].all()


@pytest.fixture(scope="module")
def host(small):
    """eps Eri in the years in which its known planet stands in the dark hole, visited until its orbit is known."""
    rules = {"targets": {"names": ["eps Eri"]}, "stop": {"after_detection": False, "after_orbit": True}}
    season = {"start_utc": "2033-01-01", "duration_days": 1095, "slot_days": 30}
    return prepare(small(rules | {"revisits": {"max_visits": 6}}, universe=season)).surveys[0]


def known_sample(survey, n=40):
    how = {"epoch_mjd": survey.calendar.start_mjd, "n": n, "seed": 1}
    return draw_planet_sample("eps Eri", 0.8, 0.3, None, known=survey.known, known_rows=survey.known_rows[0], **how)


def test_a_known_planet_begins_with_its_published_orbit(host):
    survey, planets = host, known_sample(host)
    (row,) = survey.known_rows[0]
    every, distance = np.ones(len(planets), bool), float(survey.targets.distance_pc[0])
    orbit = published_orbit(survey.known, row, epoch_mjd=survey.calendar.start_mjd, star_mass_msun=0.8)
    star = history(planets, (400.0, "F520", 10.0 * every, every), (600.0, "F520", 10.0 * every, every))
    star.published = {row: orbit}
    found = found_orbits(survey, 0, star, every)
    width = survey.model.metrics["F520"].lambda_d_arcsec
    errors = np.full((len(planets), 2), astrometric_error_arcsec(10.0, width))
    given = planets, planets.period_days, distance, np.array([[400.0, 600.0]] * len(planets)), errors, found.next_day
    alone = orbit_quality(*given, published=orbit.covariance(planets, planets.period_days))
    assert found.quality.axis_error == pytest.approx(alone.axis_error, rel=1e-9)
    assert found.place_error_lambda_d * width == pytest.approx(alone.place_error_arcsec, rel=1e-9)
    # Its period is published to 1 %: with the mass of the star the axis follows to 2.2 %, whatever the images say.
    assert (found.quality.axis_error < np.hypot(2.0 * 0.0102, STAR_MASS_ERROR) / 3.0 + 1e-3).all()
    nobody_s = replace(planets, known=np.full(len(planets), NEW))
    blind = found_orbits(survey, 0, history(nobody_s, *star.epochs), every)
    assert (blind.quality.axis_error > 3.0 * found.quality.axis_error).all()
    assert found.known.sum() > blind.known.sum() == 0


def test_one_position_is_enough_where_node_and_inclination_are_published(host):
    """Where they are not, the orbit turned the other way passes through the same place, and goes elsewhere."""
    (row,), planets = host.known_rows[0], known_sample(host)
    every = np.ones(len(planets), bool)
    fine = PublishedOrbit(np.diag([1e-3, 1e-3, 0.01, 0.01, 0.01, 0.01]) ** 2, False)
    star = history(planets, (400.0, "F520", 50.0 * every, every))
    star.published = {row: fine}
    columns = dict(host.known.columns)
    for name, value in (
        ("node_deg", 80.0),
        ("node_err_deg", 0.5),
        ("inclination_deg", 130.0),
        ("inclination_err_deg", 0.5),
    ):
        columns[name] = np.where(np.arange(len(host.known)) == row, value, columns[name])
    for name in ("period_err_days", "periastron_err_days", "conjunction_err_days"):
        columns[name] = np.where(np.arange(len(host.known)) == row, 1.0, columns[name])
    placed = replace(host, known=replace(host.known, columns=columns))
    assert placed.known.placed[row]
    assert not host.known.placed[row]
    assert found_orbits(placed, 0, star, every).known.all()
    assert len(found_orbits(host, 0, star, every).planet) == 0
    # The second orbit: at the same place on that day by another node, 180 days later up to two radii away.
    planet = planets.select([0])
    turned = replace(planet, inclination_deg=180.0 - planet.inclination_deg)
    here, there = planet.places([400.0]), turned.places([400.0])
    swing = np.rad2deg(np.arctan2(here.east_au, here.north_au) - np.arctan2(there.east_au, there.north_au))[0]
    turned = replace(turned, node_deg=turned.node_deg + swing)
    same, later = (
        np.hypot(one.east_au - two.east_au, one.north_au - two.north_au)[0, 0] / float(host.targets.distance_pc[0])
        for one, two in ((planet.places([day]), turned.places([day])) for day in (400.0, 580.0))
    )
    assert same < 1e-9
    assert later > 0.3 * host.model.metrics["F520"].lambda_d_arcsec


def test_a_published_period_counts_the_turns(host):
    """Two fine positions more than a period apart: the fourth is not asked for where the period is known."""
    (row,), planets = host.known_rows[0], known_sample(host)
    planets = replace(planets, period_days=np.full(len(planets), 300.0), semi_major_axis_au=np.full(len(planets), 0.82))
    every = np.ones(len(planets), bool)
    for period_error, known in ((1e-3, True), (0.2, False)):
        star = history(planets, *((day, "F520", 1e3 * every, every) for day in (0.0, 80.0, 640.0)))
        star.published = {row: PublishedOrbit(np.diag([period_error, 0.01, 0.1, 0.2, 1.0, 0.1]) ** 2, False)}
        assert (found_orbits(host, 0, star, every).known == known).all()


def logged(survey, *visits):
    """The survey with visits of its star that were made so many days after its start and showed so many planets."""
    own = survey.options[0][0]
    made = [
        ObservedVisit("eps Eri", survey.calendar.start_mjd + day, own, 9.0, float("nan"), planets)
        for day, planets in visits
    ]
    return replace(survey, log=ObservationLog(tuple(made), "test"))


def test_positions_of_the_log_are_of_planets_that_its_visits_showed(host, change):
    survey = logged(host, (-300.0, 1), (340.0, 0), (400.0, 1))
    population = survey.strategy.population
    how = {"epoch_mjd": survey.calendar.start_mjd, "n": 300, "seed": 1, "one_each": True}
    planets = draw_planet_sample(
        "eps Eri", 0.8, 0.3, population, known=survey.known, known_rows=survey.known_rows[0], **how
    )
    every, albedos = np.ones(len(planets), bool), albedos_of(population)
    found = logged_epochs(survey, 0, planets, every, albedos, None)
    assert [epoch.day for epoch in found] == pytest.approx([-300.0, 400.0])
    star, rule = survey.targets.select([0]), survey.strategy.detection
    for epoch in found:
        visit = survey.log.visits[0 if epoch.day < 0.0 else 2]
        roll = sun_position_angle_deg(star, np.array([[visit.mjd]]))[0]  # the log has none
        seen = expected_signals(
            survey.model, star, visit.setting, planets, albedos, planets.places([epoch.day]), roll, None
        )
        odds = detection_chance(seen, rule, np.zeros(len(planets), bool), calibration=rule.calibration)[0]
        # What it showed of a new planet is in the log, and no planet of a universe.
        assert epoch.shown.tolist() == ((odds >= 0.5) & (planets.known != NEW)).tolist()
        assert epoch.snr == pytest.approx(seen.snr[0])
    assert found[1].shown.any()
    several = change(survey, detection={"visits_needed": 2})
    _, both = logged_epochs(several, 0, planets, every, albedos, None)
    assert np.bincount(planets.universe[both.shown]).max() == 1  # one planet, as the log says
    assert (planets.known[both.shown] == NEW).any()
    assert not logged_epochs(survey, 0, planets, ~every, albedos, None)


def test_positions_of_the_log_count_for_orbits(host, change):
    """One image of the known planet from before: no orbit is known worse with it, and more are known."""
    survey = change(logged(host, (395.0, 1)), stop={"after_orbit": False})
    run = module._played(survey, 0, 200, 1)
    star = run.stars[0]
    assert star.epochs[0].day == pytest.approx(395.0)
    assert not (star.epochs[0].shown & ~star.allowed).any()
    found = found_orbits(survey, 0, star, star.found)
    tables = run.tables()
    assert tables.universes["orbits_known"].sum() == found.known.sum()
    star.epochs = star.epochs[1:]
    without = found_orbits(survey, 0, star, star.found)
    both = np.isin(found.planet, without.planet)
    assert set(without.planet[without.known]) < set(found.planet[found.known])
    assert (found.quality.axis_error[both] <= without.quality.axis_error * (1.0 + 1e-9)).all()
    assert (found.place_error_lambda_d[both] <= without.place_error_lambda_d * (1.0 + 1e-9)).all()


HOST, SEASON = "eps Eri", {"start_utc": "2033-01-01", "duration_days": 1095, "slot_days": 30}
N = 200


@pytest.fixture(scope="module")
def season(small):
    """One star in the years in which its known planet stands in the dark hole."""
    rules = {"targets": {"names": [HOST]}, "revisits": {"max_visits": 6}}
    return prepare(small(rules, universe=SEASON)).surveys[0]


@pytest.fixture(scope="module")
def many(season, change):
    """The same with many new planets, a rule that a few positions meet, and visits for orbits."""
    population = season.strategy.population.model_copy(update={"planets_per_star": 3.0})
    rule = {"visits": 6, "axis_error": 0.3, "place_error_lambda_d": 0.6}
    return change(season, population=population, detection={"half_factor": 0.39}, orbit=rule)


def survey_played(survey, n=N):
    return module._played(survey, 0, n, 1)


def shown_twice(survey, change):
    """The star after a survey without visits for orbits; planets found whose orbit is not known."""
    run = survey_played(change(survey, orbit={"visits": 0}, stop={"after_detection": False}))
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
        run = survey_played(survey)
        (star,) = run.stars.values()
        assert star.orbit_visits.max() == most
        assert (run.clock.used <= survey.strategy.time_budget_h + 1e-6).all()
        assert run.clock.used + run.clock.left == pytest.approx(survey.strategy.time_budget_h)
        made = star.orbit_visits > 0
        assert (run.clock.follow[made] > 0.0).all()


def test_a_new_planet_is_confirmed_first(many):
    run = survey_played(many)
    (star,) = run.stars.values()
    visited = star.orbit_visits[star.planets.universe] > 0
    alone = np.bincount(star.planets.universe[star.found], minlength=N) == 1
    new = star.found & (star.planets.known == NEW) & visited & alone[star.planets.universe]
    assert new.any()
    assert star.confirmed[new].all()
    assert (np.sum([epoch.shown for epoch in star.epochs], axis=0)[new] >= 2).all()


def test_no_visit_where_none_can_reach_the_rule(many, change):
    run = survey_played(change(many, orbit={"place_error_lambda_d": 1e-6}))
    (star,) = run.stars.values()
    assert star.found.any()
    assert not star.orbit_visits.any()


def test_positions_of_one_planet_keep_their_gap(many, change):
    survey = change(many, revisits={"min_gap_days": 90.0})
    run = survey_played(survey)
    (star,) = run.stars.values()
    assert star.orbit_visits.any()
    days, shown = np.array([epoch.day for epoch in star.epochs]), np.array([epoch.shown for epoch in star.epochs])
    known = star.planets.known != NEW  # no second look of another gap
    gaps = [np.diff(np.sort(days[shown[:, row]])).min() for row in np.flatnonzero(known & (shown.sum(axis=0) > 1))]
    assert min(gaps) >= 90.0 - 1e-6


@pytest.fixture(scope="module")
def valued(many, change, small):
    """The star of the season with what its orbits are worth, and the same without."""
    rules = {"targets": {"names": [HOST]}, "revisits": {"max_visits": 6}}
    orbit = {"visits": 4, "axis_error": 0.3, "place_error_lambda_d": 0.6}
    problems = []
    with pytest.MonkeyPatch.context() as patch:
        make = prepare_module.make_schedule
        patch.setattr(
            prepare_module, "make_schedule", lambda problem, **how: problems.append(problem) or make(problem, **how)
        )
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
    run = survey_played(change(survey, orbit={"visits": 0}))
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
    seen, odds, *_ = run._visited(0, setting, planets, np.array([slots, slots * 0]), every, None)
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
