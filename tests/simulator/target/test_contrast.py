"""Planet contrast: the paper's example, exact arithmetic, limits and bad input.

Lambert phase function against closed values and 60-digit arithmetic.
"""

import mpmath
import numpy as np
import pytest
from hypothesis import given, strategies as st

from simulator.passbands import Passbands
from simulator.target import contrast_at, lambert_phase, planet_contrast, sin_phase


def test_alpha_cen_b_example_per_unit_albedo() -> None:
    # 1 R_J at 0.65 arcsec, 1.35 pc, phase 90: (R/r)^2 / pi with r = 0.8775 AU.
    rho = 0.65 * 1.35
    side = rho * np.sqrt(0.5)
    assert planet_contrast(1.0, -side, side, 90.0, 1.0) == pytest.approx(9.441e-8, rel=1e-4)
    assert planet_contrast(1.0, rho, 0.0, 90.0, 1.0) == pytest.approx(contrast_at(1.0, rho, 90.0, 1.0), rel=1e-15)


def test_table_of_the_paper_within_its_precision() -> None:
    # Table 1: contrast and SNR; its three bluest values agree with Jupiter's albedo within their own noise.
    albedo = Passbands.from_bands().band_albedo("jupiter", 5260.0, 4.55, 0.2)[:3]
    found = planet_contrast(1.0, 0.8775, 0.0, 90.0, albedo)
    paper, snr = np.array([5.163e-8, 4.737e-8, 3.533e-8]), np.array([8.87, 4.45, 5.48])
    assert np.all(np.abs(found - paper) < paper / snr)


@given(
    st.floats(0.01, 10.0),
    st.floats(-50.0, 50.0).filter(lambda x: abs(x) > 1e-3),
    st.floats(-50.0, 50.0),
    st.one_of(st.floats(1e-6, 179.0), st.floats(1e-9, 1.0).map(lambda x: 180.0 - x)),
    st.floats(0.001, 1.0),
)
def test_against_exact_arithmetic(radius: float, ra: float, dec: float, phase: float, albedo: float) -> None:
    with mpmath.workdps(80):
        a = mpmath.mpf(phase) * mpmath.pi / 180
        rho = mpmath.sqrt(mpmath.mpf(ra) ** 2 + mpmath.mpf(dec) ** 2)
        size = mpmath.mpf(radius) * 71492 / mpmath.mpf("149597870.7") * mpmath.sin(a) / rho
        phi = (mpmath.sin(a) + (mpmath.pi - a) * mpmath.cos(a)) / mpmath.pi
        expected = mpmath.mpf(albedo) * size**2 * phi
        assert abs(mpmath.mpf(planet_contrast(radius, ra, dec, phase, albedo)) / expected - 1) < 1e-12


def test_limits_and_maximum() -> None:
    assert planet_contrast(1.0, 1.0, 0.0, 0.0, 0.5) == 0.0
    assert planet_contrast(1.0, 1.0, 0.0, 180.0, 0.5) == 0.0
    phase = np.linspace(0.0, 180.0, 1801)
    values = planet_contrast(1.0, 1.0, 0.0, phase, 0.5)
    assert phase[np.argmax(values)] == pytest.approx(63.0, abs=1.0)
    assert contrast_at(1.0, 1.0, 0.0, 0.5) == pytest.approx(0.5 * (71492.0 / 149597870.7) ** 2, rel=1e-14)


def test_arrays_broadcast_and_scalars_are_floats() -> None:
    values = planet_contrast(1.0, np.array([[0.5], [1.0]]), 0.0, np.array([30.0, 60.0, 90.0]), 0.4)
    assert values.shape == (2, 3)
    np.testing.assert_allclose(values[0], 4.0 * values[1], rtol=1e-14)
    assert isinstance(planet_contrast(1, 1, 0, 90, 0.5), float)
    assert isinstance(contrast_at(1, 1, 90, 0.5), float)
    assert contrast_at(1.0, [1.0, 2.0], 90.0, 0.5).shape == (2,)
    assert planet_contrast(0.0, 1.0, 0.0, 90.0, 0.5) == 0.0


def _exact(phase_deg: float) -> mpmath.mpf:
    with mpmath.workdps(80):
        a = mpmath.mpf(phase_deg) * mpmath.pi / 180
        return (mpmath.sin(a) + (mpmath.pi - a) * mpmath.cos(a)) / mpmath.pi


def test_landmarks() -> None:
    assert lambert_phase(0.0) == pytest.approx(1.0, rel=1e-15)
    assert lambert_phase(90.0) == pytest.approx(1.0 / np.pi, rel=1e-15)
    assert lambert_phase(180.0) == 0.0
    assert isinstance(lambert_phase(45), float)
    assert lambert_phase([[0.0, 90.0]]).shape == (1, 2)


def test_full_relative_precision_up_to_new_phase() -> None:
    near_new = 180.0 - np.logspace(-12, 2, 300)
    angles = np.concatenate([np.linspace(0.0, 179.999, 1500), near_new, [np.nextafter(180.0, 0.0)]])
    found = lambert_phase(angles)
    worst = max(abs(mpmath.mpf(f) / _exact(float(a)) - 1) for f, a in zip(found, angles, strict=True))
    assert worst < 1e-14


def test_falls_monotonically() -> None:
    values = lambert_phase(np.linspace(0.0, 180.0, 100_001))
    assert np.all(np.diff(values) < 0.0)


def test_sine_is_exact_at_both_ends() -> None:
    assert sin_phase(0.0) == sin_phase(180.0) == 0.0
    assert sin_phase(90.0) == 1.0
    tiny = 180.0 - 2.0**-40
    with mpmath.workdps(60):
        assert sin_phase(tiny) == pytest.approx(float(mpmath.sin(mpmath.mpf(2) ** -40 * mpmath.pi / 180)), rel=1e-14)
