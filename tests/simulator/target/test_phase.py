"""Lambert phase function against closed values and 60-digit arithmetic."""

import mpmath
import numpy as np
import pytest

from simulator.target import lambert_phase
from simulator.target.phase import sin_phase


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
