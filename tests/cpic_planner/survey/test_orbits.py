"""Orbits of the planets that surveys find: their epochs, the next window, and stars that are left with an orbit."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cpic_planner.planets import astrometric_error_arcsec, orbit_quality
from cpic_planner.survey.orbits import Epoch, found_orbits
from cpic_planner.survey.simulate import simulate_survey
from cpic_planner.survey.universe import draw_planet_sample

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
        sample,
        (30.0, "F520", snr, first),
        (200.0, "F520", 2.0 * snr, second),
        (400.0, "F520", 3.0 * snr, third),
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
    survey = change(survey, population=population, detection={"blind_margin": 0.05}, orbit=EASY)
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
