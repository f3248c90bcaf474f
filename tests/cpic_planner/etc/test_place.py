"""Where a planet may stand."""

import math

import numpy as np
import pytest

from cpic_planner.etc.model import Strategy, build_model
from cpic_planner.etc.place import check_range, diagonal_pa_deg, locate, stand, usable_range_arcsec
from simulator.config import load_instrument

INSTRUMENT = load_instrument()
MODEL = build_model(INSTRUMENT)
ROLL = build_model(INSTRUMENT, None, Strategy(library="roll"))


def corners(model, band, place):
    """The circle of the aperture, as points on the detector."""
    x, y = stand(model, band, place)
    angle = np.linspace(0, 2 * np.pi, 721)
    radius = model.instrument.aperture_radius_arcsec(band)
    return x + radius * np.cos(angle), y + radius * np.sin(angle)


def inside(model, band, x, y):
    a, b = model.instrument.hole_inner_arcsec(band), model.instrument.hole_outer_arcsec(band)
    return bool(np.all((np.minimum(abs(x), abs(y)) >= a - 1e-9) & (np.maximum(abs(x), abs(y)) <= b + 1e-9)))


@pytest.mark.parametrize("model", [MODEL, ROLL], ids=["diagonal", "two rolls"])
@pytest.mark.parametrize("band", MODEL.bands)
def test_an_answer_needs_the_whole_aperture_in_the_squares(model, band):
    for place in np.linspace(0.2, 1.05, 86):
        status = locate(model, band, float(place))[0]
        assert (status == "ok") == inside(model, band, *corners(model, band, float(place)))


def test_the_edges_are_named():
    low, high = usable_range_arcsec(INSTRUMENT, "F520")
    assert locate(MODEL, "F520", low)[0] == locate(MODEL, "F520", high)[0] == "ok"
    assert locate(MODEL, "F520", low * 0.999)[1] == "inside_inner_edge"
    assert locate(MODEL, "F520", high * 1.001)[1] == "outside_outer_edge"
    assert "F520" in locate(MODEL, "F520", 2.0)[2]


def test_a_small_roll_leaves_the_planet_in_its_own_shadow():
    small = build_model(INSTRUMENT, None, Strategy(library="roll", roll_deg=2.0))
    status, reason, text = locate(small, "F520", 0.6)
    assert (status, reason) == ("unreachable", "roll_too_small")
    assert "2 deg" in text


def test_rolled_planets_stand_half_the_roll_beside_the_diagonal():
    x, y = stand(ROLL, "F520", 0.6)
    assert math.hypot(x, y) == pytest.approx(0.6)
    assert math.degrees(math.atan2(y, x)) == pytest.approx(45.0 + 15.0)


@pytest.mark.parametrize("parity", [-1, 1])
def test_parity_turns_the_sky_not_the_detector(parity):
    model = build_model(load_instrument({"detector": {"parity": parity}}), ["F520"])
    assert stand(model, "F520", 0.6) == stand(MODEL, "F520", 0.6)
    zone = model.metrics["F520"].zone
    # Upper right on the detector: west of the star where x grows to the west.
    assert diagonal_pa_deg(zone, parity) == pytest.approx(315.0 if parity == -1 else 45.0)


def test_ranges(refused):
    assert check_range("a", np.float32(2.0), 1.0, 3.0, "s") == 2.0
    for bad in (True, np.True_, "2", None, math.nan, math.inf, 0.9, 3.1, [2.0], 1 + 2j):
        refused("^a = ", check_range, "a", bad, 1.0, 3.0, "s")
