"""Methane coefficients from the four planets: published anchors, known bands, and an inversion of known input."""

import functools

import numpy as np
import pytest

from simulator.target import load_parametric_grid
from tools.calibrate_albedo.methane import ANCHORS_PER_KM_AM, invert_methane


@functools.cache
def inverted(turns):
    return invert_methane(last_nm=805.0, turns=turns)


# After 6 turns the rms is that of 40 within 0.001 and mixing ratios within a sixth, far inside what is asked below.
@pytest.mark.long
def test_giant_planets_are_recovered():
    # Jupiter and the others stand within a few hundredths at every wavelength bin.
    found = inverted(6)
    for planet in found.measured:
        assert found.rms(planet, 400.0, 805.0) < 0.02, planet


@pytest.mark.long
@pytest.mark.parametrize("turns", [2, 6])
def test_mixing_ratios_are_those_of_the_planets(turns):
    published = {"jupiter": (0.0024, 2.0), "saturn": (0.0051, 2.0), "uranus": (0.03, 2.5), "neptune": (0.04, 2.5)}
    for planet, (value, factor) in published.items():
        assert value / factor < inverted(turns).mixing_ratio[planet] < value * factor, planet


def test_shipped_coefficients_meet_the_published_ones():
    grid = load_parametric_grid()
    for wavelength, published in ANCHORS_PER_KM_AM.items():
        ours = np.interp(wavelength, grid.wavelength_nm, grid.methane_per_km_am)
        assert ours == pytest.approx(published, rel=0.3), wavelength


def test_bands_and_windows_are_where_methane_has_them():
    grid = load_parametric_grid()

    def k(wavelength):
        return np.interp(wavelength, grid.wavelength_nm, grid.methane_per_km_am)

    assert k(889.0) > 3.0 * k(727.0) > 10.0 * k(619.0) > 100.0 * k(640.0)
    for window, band in ((750.0, 727.0), (830.0, 862.0), (937.0, 889.0)):
        assert k(window) < 0.02 * k(band)
