"""Targets x planets of one band, made ready for a question."""

from dataclasses import replace

import numpy as np
import pytest

from cpic_planner.etc import build_model, cases_of, planets_of
from cpic_planner.queries import ReferencePlanet, Strategy
from cpic_planner.targets import rank_sample
from simulator.config import load_instrument

MODEL = build_model(load_instrument(), ["F520", "F850"])
STARS = rank_sample(v_mag_max=2.0).select(range(5))


def cases(contrast=1e-8, place=(0.5, 0.7), model=MODEL, **wish):
    return cases_of(model, STARS, ["F520"], planets_of(list(place), None, contrast), **wish)


@pytest.mark.parametrize("factor", [1e-20, 1e-3, 1.0, 7.0, 1e8])
def test_other_contrasts_are_those_computed_afresh(factor):
    other, fresh = cases().rates_at(np.full((1, 5, 2), 1e-8 * factor)), cases(1e-8 * factor).rates
    for name in ("planet_e_s", "peak_planet_e_s", "peak_in_hole_e_s", "halo_e_s", "companion_e_s"):
        np.testing.assert_allclose(getattr(other, name), getattr(fresh, name), rtol=1e-12)


def test_planets_are_one_or_as_many(refused):
    two = [ReferencePlanet(), ReferencePlanet(radius_rjup=2.0)]
    assert len(planets_of(0.5)) == 1
    assert planets_of(0.5, two).models == tuple(two)
    np.testing.assert_array_equal(planets_of([0.5, 0.6], two).separation_arcsec, [0.5, 0.6])
    np.testing.assert_array_equal(planets_of(0.5, None, [1e-9, 1e-8]).separation_arcsec, [0.5, 0.5])
    np.testing.assert_array_equal(planets_of(np.array([0.5, 0.6]), None, np.float64(1e-9)).contrast, [1e-9, 1e-9])
    for bad in (([0.5, 0.6, 0.7], two, None), ([], None, None), ([[0.5]], None, None), (0.5, two, [1e-9] * 3)):
        refused("separation_arcsec", planets_of, *bad)
    for place, contrast in ((-0.1, 0.5), (121.0, 0.5), (0.5, 1.1), (0.5, -1e-9), (True, 0.5), ("0.5", 0.5)):
        refused("", planets_of, place, None, contrast)


def test_planets_of_different_models_in_one_go():
    big, small = ReferencePlanet(radius_rjup=2.0), ReferencePlanet(radius_rjup=1.0)
    found = cases_of(MODEL, STARS, ["F520"], planets_of([0.5, 0.5, 0.6], [big, small, big]))
    np.testing.assert_allclose(found.contrast[..., 0], 4.0 * found.contrast[..., 1], rtol=1e-12)
    np.testing.assert_allclose(found.contrast[..., 2] / found.contrast[..., 0], (0.5 / 0.6) ** 2, rtol=1e-12)


def test_places_without_an_answer_are_carried_along():
    found = cases(place=(0.0, 0.5, 5.0))
    np.testing.assert_array_equal(found.usable, np.tile([False, True, False], (1, 5, 1)))
    alone = cases(place=(0.5,))
    np.testing.assert_allclose(found.rates.planet_e_s[..., 1], alone.rates.planet_e_s[..., 0], rtol=1e-14)
    assert np.all(found.rates.planet_e_s > 0)
    assert np.all(np.isfinite(found.rates.planet_e_s))
    head = found.head(0, 0, 0)
    assert head["threshold"] is None
    assert head["core_throughput"] is None
    assert found.head(0, 0, 1)["core_throughput"] == pytest.approx(
        float(MODEL.metrics["F520"].core_throughput(found.x_arcsec[0, 0, 1], found.y_arcsec[0, 0, 1]))
    )
    assert (head["quadrant"], found.head(0, 0, 1)["quadrant"]) == (None, "upper right")


def test_a_star_without_coordinates_says_that_its_sky_is_assumed():
    nowhere = replace(STARS, ra_deg=np.full(len(STARS), np.nan))
    for stars, flagged in ((STARS, False), (nowhere, True)):
        found = cases_of(MODEL, stars, ["F520"], planets_of([0.5]))
        assert ("sky_place_unknown" in found.head(0, 0, 0)["flags"]) is flagged


def test_wishes_fix_the_camera():
    problem = cases(exposure_s=500.0, em_gain=12.0).problem("snr")
    assert (problem.camera.exposure_min_s, problem.camera.exposure_max_s, problem.fixed_gain()) == (500.0, 500.0, 12.0)
    free = cases().problem("snr")
    assert (free.camera.exposure_max_s, free.fixed_gain()) == (300.0, None)
    counting = build_model(load_instrument(), ["F520"], Strategy(mode="photon_counting"))
    assert cases(model=counting).problem("snr").fixed_gain() == 1000.0


def test_light_of_planets_is_counted_once():
    """Rate in the aperture = star x contrast x core, whatever the place, less the mean of the background."""
    found = cases()
    column = MODEL.passbands.names.index("F520")
    star = MODEL.passbands.star_rate_e_s(
        STARS.v_mag, STARS.teff_k, STARS.log_g, STARS.metallicity, MODEL.instrument.telescope.area_cm2
    )[:, column]
    rates = found.rates
    np.testing.assert_allclose(rates.planet_e_s, star[:, None] * 1e-8 * rates.core * rates.planet_left, rtol=1e-12)
