"""Solar panels: closed forms against panels that are turned step by step."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cpic_planner.survey.visibility import load_visibility
from cpic_planner.survey.visibility.panel import roll_half_range_deg


def limits(**values):
    return load_visibility({"roll_deg": 90} | values)


def smallest_angle_deg(theta, psi, turn, steps=801):
    """Angle from the Sun of the best of many normals, for a boresight along z and panels that turn about y."""
    theta, psi = np.radians(theta), np.radians(psi)
    sun = np.array([np.sin(theta) * np.cos(psi), np.sin(theta) * np.sin(psi), np.cos(theta)])
    turned = np.radians(np.linspace(-turn, turn, steps))
    normals = np.stack([np.cos(turned), np.zeros(steps), np.sin(turned)], axis=-1)
    return np.degrees(np.arccos(np.clip(normals @ sun, -1, 1))).min()


@given(st.floats(0.5, 179.5), st.floats(0, 90), st.floats(1, 80))
def test_at_the_end_of_the_range_the_best_normal_is_at_its_limit(theta, turn, limit):
    (half,) = roll_half_range_deg(np.array([theta]), limits(panel_turn_deg=turn, panel_deg=limit))
    at_rest = smallest_angle_deg(theta, 0.0, turn)
    if np.isnan(half):
        assert at_rest > limit - 1e-6
    else:
        assert 0 <= half <= 90
        assert at_rest <= limit + 0.1
        assert smallest_angle_deg(theta, half, turn) <= limit + 0.1
        if half < 89:
            # A little more roll is too much.
            assert smallest_angle_deg(theta, half + 0.5, turn) >= limit - 0.1
            assert smallest_angle_deg(theta, half * 0.5, turn) <= limit + 0.1


def test_free_panels_follow_their_rule():
    theta = np.linspace(0, 180, 181)
    half = roll_half_range_deg(theta, limits(panel_turn_deg=90))
    rolled = np.sin(np.radians(theta)) * np.sin(np.radians(half))
    assert np.all(rolled <= np.sin(np.radians(25)) + 1e-12)
    # Whatever is less than all around stands at the limit.
    inside = half < 90 - 1e-9
    assert rolled[inside] == pytest.approx(np.sin(np.radians(25)))
    assert np.sin(np.radians(theta[~inside])).max() <= np.sin(np.radians(25)) + 1e-9


def test_fixed_panels_follow_their_rule():
    theta = np.linspace(0, 180, 361)
    half = roll_half_range_deg(theta, limits(panel="fixed"))
    seen = np.isfinite(half)
    assert theta[seen].tolist() == np.linspace(65, 115, 101).tolist()
    assert np.sin(np.radians(theta[seen])) * np.cos(np.radians(half[seen])) == pytest.approx(np.cos(np.radians(25)))
    # What panels of one axis may turn by is nothing to fixed ones.
    other = roll_half_range_deg(theta, limits(panel="fixed", panel_turn_deg=60))
    np.testing.assert_array_equal(half, other)
    np.testing.assert_allclose(roll_half_range_deg(theta, limits(panel_turn_deg=0)), half)


def test_default_reaches_from_40_to_140_degrees_with_the_roll_that_is_free():
    config = load_visibility()
    theta = np.array([39.9, 40.0, 90.0, 140.0, 140.1])
    half = roll_half_range_deg(theta, config)
    assert np.isnan(half).tolist() == [True, False, False, False, True]
    assert half[1:4].tolist() == pytest.approx([0.0, 15.0, 0.0], abs=1e-4)
    assert np.nanmax(roll_half_range_deg(np.linspace(0, 180, 200), config)) == 15.0


def test_no_limit():
    half = roll_half_range_deg(np.linspace(0, 180, 50), limits(panel_deg=90, panel_turn_deg=90))
    assert half == pytest.approx(90.0)
