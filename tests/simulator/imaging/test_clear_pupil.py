"""Diffraction of a round pupil, against what is known of it in closed form."""

import numpy as np
import pytest

from simulator.imaging.table_metrics import airy, disc_light


@pytest.mark.parametrize(
    ("width", "obstruction"),
    [
        (0.0, 0.2),
        (0.2, 0.36),
        *(pytest.param(*one, marks=pytest.mark.long) for one in ((0.0, 0.0), (0.0, 0.36), (0.2, 0.0), (0.2, 0.2))),
    ],
)
def test_all_the_light_is_somewhere(obstruction, width):
    """Within 200 lambda/D all but the wings' 2 / (pi^2 u), which obstruction raises by (1 + e) / (1 - e^2)."""
    u = np.linspace(0.0, 200.0, 400_001)
    total = np.trapezoid(2.0 * np.pi * u * airy(u, obstruction, width), u)
    outside = 2.0 / np.pi**2 / 200.0 * (1.0 + obstruction) / (1.0 - obstruction**2)
    assert total == pytest.approx(1.0 - outside, abs=3e-4)


def test_the_middle_and_the_first_dark_ring():
    """pi / 4 (1 - e^2) of the light per square lambda/D in the middle; dark at 1.2197 lambda/D."""
    assert float(airy(0.0)) == pytest.approx(np.pi / 4.0, rel=1e-9)
    assert float(airy(0.0, 0.3)) == pytest.approx(np.pi / 4.0 * (1.0 - 0.09), rel=1e-9)
    assert float(airy(1.219670)) < 1e-12


@pytest.mark.parametrize(("radius", "light"), [(1.219670, 0.837785), (2.233131, 0.909900)])
def test_discs_to_the_dark_rings_hold_what_books_say(radius, light):
    """Born & Wolf, 8.5.2: 83.8 and 91.0 per cent; 1 - J0^2 - J1^2 at the zeros of J1."""
    assert float(disc_light(np.zeros(1), radius, 0.0, 0.0)[0]) == pytest.approx(light, abs=2e-3)


def test_discs_beside_the_source_hold_the_brightness_times_their_area():
    at = np.array([20.0, 40.0])
    found = disc_light(at, 0.7, 0.0, 0.3)
    smooth = np.array([np.mean(airy(np.linspace(s - 0.7, s + 0.7, 99), 0.0, 0.3)) for s in at])
    np.testing.assert_allclose(found, smooth * np.pi * 0.49, rtol=0.05)
