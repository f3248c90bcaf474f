"""Measured albedos against the values tabulated when the source was chosen."""

from __future__ import annotations

import numpy as np
import pytest

from catalogs.errors import InputError
from simulator.target import albedo_flags, planet_albedo

WAVELENGTH_NM = np.array([520, 550, 662, 720, 850, 890, 940, 1265, 1425, 1542], dtype=float)
TABLE = {
    "jupiter": [0.519, 0.528, 0.526, 0.369, 0.452, 0.048, 0.463, 0.147, 0.006, 0.046],
    "saturn": [0.453, 0.487, 0.555, 0.381, 0.537, 0.064, 0.559, 0.279, 0.011, 0.176],
    "uranus": [0.593, 0.617, 0.250, 0.063, 0.093, 0.015, 0.262, 0.023, 0.001, 0.011],
    "neptune": [0.536, 0.552, 0.172, 0.061, 0.063, 0.016, 0.174, 0.019, 0.002, 0.009],
}


@pytest.mark.parametrize("planet", TABLE)
def test_tabulated_values(planet: str) -> None:
    np.testing.assert_allclose(planet_albedo(WAVELENGTH_NM, model=planet), TABLE[planet], atol=1.01e-3)


def test_default_is_jupiter_and_shape_is_kept() -> None:
    assert planet_albedo(550.0) == pytest.approx(0.528, abs=1e-3)
    assert planet_albedo(np.full((2, 3), 600.0)).shape == (2, 3)


def test_undocumented_wavelengths_are_flagged() -> None:
    np.testing.assert_array_equal(albedo_flags([520.0, 1050.0, 1050.1, 1542.0]), [False, False, True, True])


@pytest.mark.parametrize("wavelength", [299.0, 1760.0, np.nan, [500.0, 2000.0]])
def test_no_silent_extrapolation(wavelength) -> None:
    with pytest.raises(InputError):
        planet_albedo(wavelength)


def test_unknown_model_is_refused() -> None:
    with pytest.raises(InputError) as caught:
        planet_albedo(500.0, model="earth")
    assert "jupiter" in str(caught.value)
