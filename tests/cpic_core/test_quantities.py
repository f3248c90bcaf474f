"""Numbers from outside: units, arrays, and what is no number."""

import sys
import types

import astropy.units as u
import numpy as np
import pandas as pd
import pytest
from astropy.utils.masked import Masked

from cpic_core import InputError, check_finite, check_number, check_pair, check_whole, real_array
from simulator import lambert_phase, planet_albedo, planet_contrast, spectrum_generator, star_photlam
from simulator.target import contrast_at, sky_to_detector


def test_plain_numbers_of_all_kinds():
    for value in (2, 2.0, np.float32(2), np.int64(2), np.array(2), 2 * u.deg):
        assert check_number("x_deg", value, "deg") == 2.0
    given = np.array([1.0, 2.0])
    found = real_array("x", given)
    found[0] = 5.0
    assert given[0] == 1.0
    assert check_finite("x", []).shape == (0,)


@pytest.mark.parametrize("value", ["5", True, 1j, None, [1, [2]], {"a": 1}, 5 * u.m, np.ma.array([1.0], mask=[True])])
def test_what_is_no_number_is_refused(refused, value):
    refused("x_deg = ", check_finite, "x_deg", value, "deg")
    refused("x_deg = ", check_number, "x_deg", value, "deg")


@pytest.mark.parametrize(
    ("value", "right"),
    [
        (np.ma.array([1.0, 2.0], mask=[True, False]), [np.nan, 2.0]),
        (np.ma.array([1.0, 2.0]), [1.0, 2.0]),
        (np.ma.array([[1, 2]], mask=[[False, True]]), [[1.0, np.nan]]),
        (np.ma.array(3.0, mask=True), np.nan),
        (Masked([1.0, 2.0], mask=[False, True]), [1.0, np.nan]),
        (Masked([1.0, 2.0] * u.m, mask=[True, False]), [np.nan, 2.0]),
        (pd.Series([1.0, 2.0]), [1.0, 2.0]),
    ],
)
def test_masked_numbers_are_no_numbers(value, right):
    np.testing.assert_array_equal(real_array("x_m", value, "m"), right)


def test_numbers_are_read_while_another_thread_loads_masked_arrays(monkeypatch):
    """A page that draws loads them while the first question is answered: their module stands there half made."""
    monkeypatch.setitem(sys.modules, "numpy.ma", types.ModuleType("numpy.ma"))
    assert real_array("x", [1.0, 2.0]).tolist() == [1.0, 2.0]


def test_units_at_the_public_edge():
    in_si = planet_contrast(71492 * u.km, 0.8775 * u.au, 0 * u.m, np.pi / 2 * u.rad, 0.5)
    assert in_si == pytest.approx(planet_contrast(1, 0.8775, 0, 90, 0.5), rel=1e-12)
    assert contrast_at(1 * u.R_jup, 1 * u.pc, 0 * u.deg, 0.5) == pytest.approx(contrast_at(1, 206264.806, 0, 0.5))
    assert lambert_phase(np.pi / 2 * u.rad) == pytest.approx(1 / np.pi, rel=1e-15)
    nm = [500.0, 600.0]
    assert np.allclose(
        planet_albedo([0.5, 0.6] * u.um, insolation_au=3e8 * u.km),
        planet_albedo(nm, insolation_au=(3e8 * u.km).to_value(u.au)),
        rtol=1e-12,
    )
    star = star_photlam(5 * u.mag, teff_k=5.8 * u.kK)
    assert star.meta["teff_k"] == pytest.approx(5800.0)
    assert star.meta["magnitude_v"] == 5.0
    assert sky_to_detector(1000 * u.mas, 0, roll_deg=np.pi / 2 * u.rad)[0] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("call", "key"),
    [
        (lambda: planet_contrast(1 * u.m / u.s, 1, 0, 90, 0.5), "radius_rjup"),
        (lambda: planet_contrast(1, 1, 0, 90, "jupiter"), "geometric_albedo"),
        (lambda: planet_contrast([1, 2], [1, 2, 3], 0, 90, 0.5), "shapes"),
        (lambda: contrast_at([1, 2], [1, 2, 3], 90, 0.5), "shapes"),
        (lambda: lambert_phase("full"), "phase_deg"),
        (lambda: planet_albedo("500"), "wavelength_nm"),
        (lambda: planet_albedo(500, log10_mh="1"), "log10_mh"),
        (lambda: planet_albedo(500, log10_mh=True), "log10_mh"),
        (lambda: star_photlam("5", "G2V"), "magnitude_v"),
        (lambda: star_photlam([5.0, 6.0], "G2V"), "magnitude_v"),
        (lambda: star_photlam(5, teff_k=5800 * u.nm), "teff_k"),
        (lambda: spectrum_generator("paper_example", roll_deg="north"), "roll_deg"),
    ],
)
def test_the_key_is_named(call, key):
    with pytest.raises(InputError) as caught:
        call()
    assert caught.value.key == key


def test_whole_numbers_of_all_types():
    for value in (3, 3.0, np.int64(3), np.float32(3)):
        assert check_whole("n", value, 0, 5) == 3
        assert type(check_whole("n", value, 0, 5)) is int


def test_pairs(refused):
    assert check_pair("offset", (1, -2.0), 2.0) == check_pair("offset", [1, -2] * u.arcsec, 2.0, "arcsec") == (1, -2)
    for value in ("ab", 1.0, (1.0,), (1, 2, 3), (1, 2.1), (0, float("nan")), ("a", "b"), None, (True, False)):
        refused(r"offset = .* arcsec.*at most 2, the edge", check_pair, "offset", value, 2.0, "arcsec", why="the edge")
