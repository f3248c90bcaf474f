from __future__ import annotations

import mpmath
import numpy as np
import pytest

from simulator.detectors import dark_law_e_s


@pytest.mark.parametrize(
    ("celsius", "sheet"), [(-40, 0.055), (-30, 0.3), (-20, 1.5), (-10, 6.5), (0, 23), (19.85, 260)]
)
def test_curve_of_the_data_sheet(celsius, sheet) -> None:
    assert float(dark_law_e_s(celsius + 273.15, 260.0)) == pytest.approx(sheet, rel=0.2)


@pytest.mark.parametrize(("kelvin", "rate"), [(218, 2.5e-3), (203, 9e-5), (193, 8e-6)])
def test_cold_detectors(kelvin, rate) -> None:
    assert float(dark_law_e_s(kelvin, 260.0)) == pytest.approx(rate, rel=0.1)


def test_value_against_mpmath() -> None:
    exact = 260 * mpmath.mpf("1.14e6") * mpmath.mpf(193) ** 3 * mpmath.exp(mpmath.mpf(-9080) / 193)
    assert float(dark_law_e_s(193.0, 260.0)) == pytest.approx(float(exact), rel=1e-12)


def test_rises_with_temperature_and_broadcasts() -> None:
    law = dark_law_e_s(np.linspace(120, 320, 201)[:, None], [0.0, 1.0, 500.0])
    assert law.shape == (201, 3)
    assert (np.diff(law[:, 1]) > 0).all()
    assert (law[:, 0] == 0).all()
    assert law[:, 2] == pytest.approx(500 * law[:, 1])


def test_the_detector_adds_what_cooling_leaves(changed) -> None:
    cold = changed(temperature_k=193, dark_e_s=5e-4, dark_293k_e_s=260)
    assert cold.dark_rate_e_s == pytest.approx(5e-4 + 8.1e-6, rel=1e-3)
    assert changed(temperature_k=293, dark_e_s=5e-4, dark_293k_e_s=0).dark_rate_e_s == 5e-4


@pytest.mark.parametrize("temperature", [119.0, 321.0, np.nan, np.inf, "cold"])
def test_refusals(refused, temperature) -> None:
    refused("temperature_k", dark_law_e_s, temperature, 260.0)
    refused("dark_293k_e_s", dark_law_e_s, 200.0, -1.0)
