"""Where planets are put: diagonals, rolls, and the quadrant with the least light of a companion."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cpic_planner.etc import (
    aperture_rates,
    build_model,
    diagonal_pa_deg,
    place_status,
    planet_offsets,
    questions,
    usable_range_arcsec,
)
from cpic_planner.etc.quadrants import QUADRANTS, dark_quadrants
from cpic_planner.queries import Strategy
from cpic_planner.targets import Targets, find_target
from simulator.config import load_instrument
from simulator.imaging import aperture_sums, overlap_weights, single_band_psf
from simulator.target import sky_to_detector

INSTRUMENT = load_instrument()
MODEL = build_model(INSTRUMENT)
ROLL = build_model(INSTRUMENT, None, Strategy(library="roll"))
TAU_CET = find_target("tau Cet")[0]


def pair(pa_deg, separation_arcsec=4.0, roll_deg=0.0):
    """Return tau Ceti with a companion as bright as itself."""
    columns = {"separation_arcsec": separation_arcsec, "pa_deg": pa_deg, "v_mag": 3.5, "teff_k": 5400.0}
    changed = {f"companion_{name}": np.array([value]) for name, value in columns.items()}
    return replace(TAU_CET, roll_deg=roll_deg, **changed)


def test_rolled_planets_stand_half_the_roll_beside_the_diagonal():
    x, y = planet_offsets(ROLL, TAU_CET, "F520", 0.6)
    assert math.hypot(x, y) == pytest.approx(0.6)
    assert math.degrees(math.atan2(y, x)) == pytest.approx(45.0 + 15.0)


@pytest.mark.parametrize("parity", [-1, 1])
def test_parity_turns_the_sky_not_the_detector(parity):
    model = build_model(load_instrument({"detector": {"parity": parity}}), ["F520"])
    assert planet_offsets(model, TAU_CET, "F520", 0.6) == planet_offsets(MODEL, TAU_CET, "F520", 0.6)
    # Upper right on the detector: west of the star where x grows to the west.
    assert diagonal_pa_deg(model, TAU_CET, "F520") == pytest.approx(315.0 if parity == -1 else 45.0)


@pytest.mark.parametrize("roll_deg", [0.0, 40.0, -130.0])
@pytest.mark.parametrize("pa_deg", [10.0, 55.0, 130.0, 305.0])
def test_the_quadrant_holds_least_of_the_companions_light(pa_deg, roll_deg):
    """Mean of an image of the companion over each quadrant of the hole; the roll turns the companion alone."""
    psf = single_band_psf("F662")
    image = psf.at(*(float(part) for part in sky_to_detector(4.0, pa_deg, roll_deg=roll_deg, parity=-1)))
    sums = aperture_sums(image, overlap_weights(psf.geometry.aperture_radius_arcsec / psf.geometry.pixel_scale_arcsec))
    offset = np.arange(len(image)) - len(image) // 2
    light = {
        name: sums[psf.geometry.hole & (offset * x > 0) & (offset[:, None] * y > 0)].mean()
        for name, (x, y) in zip(QUADRANTS, ((1, 1), (-1, 1), (1, -1), (-1, -1)), strict=True)
    }
    star = pair(pa_deg, roll_deg=roll_deg)
    (number,) = dark_quadrants(MODEL, star, "F662")
    assert light[QUADRANTS[number]] <= 1.03 * min(light.values())
    assert max(light.values()) > 2.0 * min(light.values())
    x, y = planet_offsets(MODEL, star, "F662", 0.6)
    assert (x > 0, y > 0) == (number % 2 == 0, number // 2 == 0)
    turned = sky_to_detector(0.6, diagonal_pa_deg(MODEL, star, "F662"), parity=-1)
    np.testing.assert_allclose((x, y), turned, rtol=1e-12)


def test_only_known_companions_that_count_move_the_planet():
    """No companion, one whose light is left out, and one that may stand anywhere: the upper right quadrant."""
    lit = pair(305.0)
    assert dark_quadrants(MODEL, lit, "F520")[0] != 0
    for star in (TAU_CET, replace(lit, companions="off"), pair(np.nan)):
        assert dark_quadrants(MODEL, star, "F520").tolist() == [0]


def test_stars_have_quadrants_of_their_own():
    stars = [pair(305.0), TAU_CET, pair(130.0), pair(10.0)]
    every = Targets.joined(stars)
    x, y = planet_offsets(MODEL, every, "F520", np.array([[0.5, 0.6]]))
    assert x.shape == y.shape == (4, 2)
    for row, star in enumerate(stars):
        alone = planet_offsets(MODEL, star, "F520", np.array([[0.5, 0.6]]))
        np.testing.assert_array_equal((x[row], y[row]), (alone[0][0], alone[1][0]))
    assert planet_offsets(MODEL, TAU_CET, "F520", np.array([[0.5, 0.6]]))[0].shape == (1, 2)


def test_half_a_hole_keeps_the_planet_in_its_dark_half():
    half = build_model(load_instrument("cpic_2q"), ["F520"])
    for pa_deg in np.arange(12) * 30.0:
        x, _ = planet_offsets(half, pair(pa_deg), "F520", 0.6)
        assert x > 0


@pytest.mark.parametrize("pa_deg", np.arange(8) * 45.0 + 12.0)
def test_two_rolls_stay_in_the_hole_in_every_quadrant(pa_deg):
    low, high = usable_range_arcsec(INSTRUMENT, "F520")
    edge, outer = INSTRUMENT.hole_inner_arcsec("F520"), INSTRUMENT.hole_outer_arcsec("F520")
    radius = INSTRUMENT.aperture_radius_arcsec("F520")
    for place in np.linspace(low, high, 9):
        x, y = (abs(float(part)) for part in planet_offsets(ROLL, pair(pa_deg), "F520", place))
        whole = min(x, y) >= edge + radius and max(x, y) <= outer - radius
        assert whole == (place_status(ROLL, "F520", float(place))[0] == "ok")


def test_answers_say_quadrant_and_roll():
    asked = {"time_s": 7200.0, "separation_arcsec": 0.6, "contrast": 1e-8, "bands": ["F520"]}
    for star in (TAU_CET, pair(305.0), pair(305.0, roll_deg=40.0)):
        (answer,) = questions.signal_to_noise(MODEL, star, **asked)
        assert answer.quadrant == QUADRANTS[dark_quadrants(MODEL, star, "F520")[0]]
        assert answer.roll_deg == star.roll_deg
    outside = questions.signal_to_noise(MODEL, TAU_CET, **(asked | {"separation_arcsec": 3.0}))[0]
    assert outside.quadrant is None


def test_a_roll_turns_the_companion():
    """Rolling by an angle is turning the position angle back by it."""
    x = np.full((1, 1), 0.42)
    for name in ("companion_e_s", "smear_e", "peak_in_hole_e_s"):
        rolled, turned = (
            getattr(aperture_rates(MODEL, star, "F520", x, x, np.full((1, 1), 1e-9)), name)
            for star in (pair(50.0, roll_deg=35.0), pair(15.0))
        )
        np.testing.assert_allclose(rolled, turned, rtol=1e-9)
        assert math.isfinite(float(rolled.flat[0]))
