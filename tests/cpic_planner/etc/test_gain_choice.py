"""The gain of least noise against trying every gain."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cpic_planner.etc.gain_choice import best_gain, gain_table
from simulator.camera.gain import excess_noise_factor2

SLACK = 2e-5
RATIO = np.geomspace(1e-4, 1e10, 141)


def variance(light, read, gain, stages):
    return excess_noise_factor2(gain, stages) * light + read / gain**2


def scanned(light, read, cap, stages, n=3000):
    """Least variance over a grid of gains up to a cap; the grid itself is good to 1e-6."""
    grid = np.geomspace(1.0, cap, n)[:, None]
    return variance(light, read, grid, stages).min(axis=0)


@pytest.mark.parametrize("stages", [16, 64, 300, 536, 604])
@pytest.mark.parametrize("gain_max", [1.5, 20.0, 300.0, 1000.0, 1e4])
def test_no_gain_has_less_noise(stages, gain_max):
    light, read = np.ones(RATIO.shape), RATIO
    for cap in np.geomspace(1.0, gain_max, 7):
        gain, found = best_gain(light, read, np.full(RATIO.shape, cap), gain_max, stages)
        np.testing.assert_allclose(found, variance(light, read, gain, stages), rtol=1e-13)
        assert np.all((gain >= 1.0) & (gain <= cap))
        assert np.all(found <= scanned(light, read, cap, stages) * (1.0 + SLACK))


@given(
    st.integers(16, 604),
    st.floats(1.0 + 1e-9, 1e4),
    st.floats(0.0, 1.0),
    st.floats(1e-12, 1e12),
    st.floats(1e-6, 1e12),
)
def test_any_register(stages, gain_max, share, light, read):
    cap = gain_max**share
    gain, found = best_gain(np.array([light]), np.array([read]), np.array([cap]), gain_max, stages)
    assert 1.0 <= gain[0] <= cap
    assert found[0] <= scanned(np.array([light]), np.array([read]), cap, stages, 500)[0] * (1.0 + SLACK)


def test_bright_frames_need_no_gain_and_faint_ones_all_of_it():
    gain, _ = best_gain(np.array([1e4]), np.array([100.0]), np.array([1000.0]), 1000.0, 604)
    assert gain[0] == 1.0
    faint, _ = best_gain(np.array([1e-3]), np.array([1e6]), np.array([1000.0]), 1000.0, 604)
    assert faint[0] > 900.0


def test_without_light_or_without_reading():
    gain, found = best_gain(np.array([0.0, 1.0]), np.array([1.0, 0.0]), np.array([500.0, 500.0]), 1000.0, 604)
    np.testing.assert_array_equal(gain, [500.0, 1.0])
    np.testing.assert_allclose(found, [1.0 / 500.0**2, 1.0], rtol=1e-12)


def test_without_a_register():
    for stages, gain_max in ((0, 1.0), (604, 1.0)):
        gain, found = best_gain(np.array([2.0]), np.array([3.0]), np.array([0.5]), gain_max, stages)
        assert (gain[0], found[0]) == (1.0, 5.0)


def test_a_cap_below_one_is_left_to_the_caller():
    gain, _ = best_gain(np.array([1.0]), np.array([1e6]), np.array([0.3]), 1000.0, 604)
    assert gain[0] == 1.0


def test_the_best_gain_grows_with_the_noise_of_reading():
    table = gain_table(1000.0, 604)
    assert np.all(np.diff(table.near) >= -1e-9)
    assert table.near[0] == 0.0
    assert table.far[-1] == pytest.approx(np.log(1000.0), abs=0.02)
