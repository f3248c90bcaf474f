"""Dust that each star has for itself: the law, its light in a visit, and the yield of a survey over it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import lognorm

from cpic_planner.survey.candidates import N_DRAWS
from cpic_planner.survey.detection import expected_signals
from cpic_planner.survey.prepare import prepare
from cpic_planner.survey.simulate import simulate_survey
from cpic_planner.survey.strategy import DustLaw
from cpic_planner.survey.universe import albedos_of, draw_planet_sample, dust_of, star_mass_msun
from simulator.config import deep_merge

STAR, LAW = "eps Eri", {"median": 30.0, "p95": 3000.0}


def with_dust(survey, zodis):
    """The survey with the same dust around all stars."""
    instrument = survey.model.instrument.changed({"sky": {"exozodi_zodis": zodis}})
    assumed = survey.strategy.assumptions.model_copy(update={"exozodi": zodis})
    strategy = survey.strategy.model_copy(update={"assumptions": assumed})
    return replace(survey, strategy=strategy, model=replace(survey.model, instrument=instrument))


@pytest.fixture(scope="module")
def dusty(small, sharp_tree):
    """One visit of a star without chance, planets in plenty, dust by a wide law."""
    population = {"base": "giants", "planets_per_star": 2.0}
    rules = {"targets": {"names": [STAR]}, "assumptions": {"exozodi": LAW}, "population": population}
    rules["revisits"] = {"max_visits": 1}
    return prepare(small(deep_merge(sharp_tree, rules), universe={"known_planets": "off"})).surveys[0]


def planets_of(survey, n, block):
    star = survey.targets.select([0])
    who = STAR, float(star_mass_msun(star)[0]), float(star.luminosity_lsun[0]), survey.strategy.population
    return star, draw_planet_sample(*who, epoch_mjd=survey.calendar.start_mjd, n=n, seed=1, block=block)


def test_the_law_is_lognormal():
    law, shares = DustLaw(median=3, p95=27), np.linspace(0.001, 0.999, 97)
    sigma = np.log(27.0 / 3.0) / 1.6448536269514722
    np.testing.assert_allclose(law.zodis(shares), lognorm.ppf(shares, sigma, scale=3.0), rtol=1e-12)
    assert law.zodis(np.array([0.0, 0.5, 0.95])) == pytest.approx([0.0, 3.0, 27.0])
    assert np.all(DustLaw(median=3, p95=3).zodis(shares) == 3.0)


def test_each_planet_stands_in_the_dust_of_its_universe(dusty):
    """Signals with an array of levels are those of models with one level each."""
    star, planets = planets_of(dusty, 60, 0)
    (visit,) = dusty.schedule.visits
    way, albedos = dusty.options[0][visit.option], albedos_of(dusty.strategy.population)
    places = planets.places(dusty.calendar.day[0, [visit.slot]])
    zodis = dust_of(dusty.strategy, planets, 1, STAR, 0)
    assert len(set(zodis.tolist())) == len(set(planets.universe.tolist()))  # planets of one star share it
    every = expected_signals(dusty.model, star, way, planets, albedos, places, [0.0], zodis)
    # An instrument takes up to 100 000 zodi.
    seen = np.flatnonzero((every.margin[0] > 0.0) & (zodis <= 1e5))
    assert seen.size > 10
    for row in seen[:12]:
        alone = with_dust(dusty, float(zodis[row])).model
        one = expected_signals(alone, star, way, planets, albedos, places, [0.0])
        for name in ("margin", "reached_blind", "width_blind", "reached_known", "width_known", "snr", "contrast"):
            assert getattr(every, name)[0, row] == pytest.approx(getattr(one, name)[0, row], rel=1e-12)


def test_the_yield_is_the_mean_over_the_levels(dusty):
    """Universes with dust of their own find what surveys with one level find on average over shares of the law."""
    n, law = 1500, dusty.strategy.assumptions.dust
    drawn = simulate_survey(dusty, block=0, n=4 * n, seed=1).universes["new_planets"]
    levels = law.zodis((np.arange(12) + 0.5) / 12.0)
    each = [simulate_survey(with_dust(dusty, level), block=9, n=n, seed=1).universes["new_planets"] for level in levels]
    means = [found.mean() for found in each]
    assert means[0] > 1.5 * means[-1]
    error = np.hypot(drawn.std() / np.sqrt(4 * n), np.std(np.mean(each, axis=0)) / np.sqrt(n))
    # Twelve steps of a share leave less than a hundredth of the yield.
    assert abs(drawn.mean() - np.mean(means)) < 4.0 * error + 0.01 * np.mean(means)
    middle = simulate_survey(with_dust(dusty, law.median), block=9, n=n, seed=1).universes["new_planets"].mean()
    assert abs(middle - np.mean(means)) > 2.0 * error


def test_a_schedule_is_worth_the_mean_over_the_levels(dusty):
    """The planets of planning have dust of their own, too."""
    yields = simulate_survey(dusty, block=3, n=4000, seed=2).universes["new_planets"]
    planned = sum(visit.gain for visit in dusty.schedule.visits)
    error = np.hypot(yields.std() / np.sqrt(4000), np.sqrt(2.0 * planned / N_DRAWS))
    assert abs(yields.mean() - planned) < 4.0 * error


def test_strategies_see_the_same_dust(dusty, change):
    """The luck of a star is its own: another law moves all its levels alike, another star has others."""
    _, planets = planets_of(dusty, 100, 2)
    other = change(dusty, assumptions={"exozodi": DustLaw(median=60, p95=6000)}).strategy
    own = dust_of(dusty.strategy, planets, 1, STAR, 2)
    np.testing.assert_allclose(dust_of(other, planets, 1, STAR, 2), 2.0 * own, rtol=1e-12)
    assert not np.allclose(dust_of(dusty.strategy, planets, 1, "tau Cet", 2), own)
    assert dust_of(with_dust(dusty, 3.0).strategy, planets, 1, STAR, 2) is None


def test_detections_say_how_much_dust_there_was(dusty):
    found = simulate_survey(dusty, block=0, n=100, seed=1).detections
    _, planets = planets_of(dusty, 100, 0)
    zodis = dict(zip(planets.universe.tolist(), dust_of(dusty.strategy, planets, 1, STAR, 0), strict=True))
    assert found["exozodi_zodis"] == pytest.approx([zodis[universe] for universe in found["universe"].tolist()])
    assert set(simulate_survey(with_dust(dusty, 7.0), block=0, n=100, seed=1).detections["exozodi_zodis"]) == {7.0}
