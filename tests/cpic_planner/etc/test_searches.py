"""Searches over many functions at once against functions whose answers are known, and the gain against every gain."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cpic_planner.etc.model import best_gain, gain_table
from cpic_planner.etc.searches import bracketed, first_root, lowest
from simulator.detectors import excess_noise_factor2


@dataclass(frozen=True)
class Cases:
    """One number for each case."""

    m: np.ndarray

    def at(self, mask):
        return Cases(self.m[mask])


PLACES = Cases(np.geomspace(0.02, 200.0, 41))
LOW, HIGH = np.full(41, 0.01), np.full(41, 300.0)
VALLEYS = {
    "power laws": lambda p, t: t / p.m + p.m / t,
    "steep and shallow": lambda p, t: (p.m / t) ** 2 + 0.01 * t / p.m,
    "kink": lambda p, t: 1.0 + np.abs(np.log(t / p.m)),
    "cliff behind": lambda p, t: np.where(t <= p.m, p.m / t, np.inf),
}


@pytest.mark.parametrize("name", VALLEYS)
def test_the_bottom_of_a_valley(name):
    function = VALLEYS[name]
    t, value = lowest(PLACES, function, LOW, HIGH)
    truth = PLACES.m * (200.0 ** (1 / 3) if name == "steep and shallow" else 1.0)
    inside = truth < 300.0
    # A smooth bottom is flat: its value is known far better than its place.
    np.testing.assert_allclose(t[inside], truth[inside], rtol=3e-6)
    np.testing.assert_allclose(value, function(PLACES, t), rtol=1e-15)
    np.testing.assert_allclose(value[inside], function(PLACES, truth)[inside], rtol=3e-6)
    assert np.all((t >= LOW) & (t <= HIGH))


def test_the_ends_are_exact():
    for function, end in ((lambda p, t: p.m / t, HIGH), (lambda p, t: p.m * t, LOW)):
        t, value = lowest(PLACES, function, LOW, HIGH)
        np.testing.assert_array_equal(t, end)
        np.testing.assert_array_equal(value, function(PLACES, end))
    t, _ = lowest(PLACES, lambda p, t: p.m / t, LOW, LOW)
    np.testing.assert_array_equal(t, LOW)


def test_a_flat_top_takes_the_longest():
    """Where nothing is gained or lost, the upper bound is the answer: fewest frames."""
    t, _ = lowest(PLACES, lambda p, t: np.maximum(p.m / t, 1.0), LOW, HIGH)
    np.testing.assert_array_equal(t, HIGH)


def test_the_deeper_of_two_valleys():
    def function(p, t):
        return np.minimum(2.0 + np.log(t / 0.05) ** 2, 1.0 + np.log(t / p.m) ** 2)

    deep = Cases(np.array([5.0, 20.0, 100.0]))
    t, value = lowest(deep, function, np.full(3, 0.01), np.full(3, 300.0))
    np.testing.assert_allclose(t, deep.m, rtol=1e-6)
    np.testing.assert_allclose(value, 1.0, rtol=1e-12)


def test_without_any_value_there_is_none():
    t, value = lowest(PLACES, lambda p, t: np.full(np.broadcast(t, p.m).shape, np.inf), LOW, HIGH)
    assert np.all(np.isinf(value))
    assert np.all((t >= LOW) & (t <= HIGH))


FALLS = {
    "power law": lambda p, t: (p.m / t) ** 2,
    "sum of powers": lambda p, t: 0.5 * (p.m / t) + 0.5 * (p.m / t) ** 4,
    "kink": lambda p, t: np.where(t < p.m, (p.m / t) ** 0.3, (p.m / t) ** 5),
    "floor beneath": lambda p, t: 0.999 + 0.001 * (p.m / t) ** 3,
}


@pytest.mark.parametrize("name", FALLS)
def test_a_root_from_below(name):
    function = FALLS[name]
    t = first_root(PLACES, function, LOW, HIGH, np.ones(41, bool))
    value = function(PLACES, t)
    assert value.max() <= 1.0
    assert value.min() >= 1.0 - 4e-15
    np.testing.assert_allclose(t, PLACES.m, rtol=2e-12 if name == "floor beneath" else 2e-14)


def test_a_step_is_found_to_the_last_digit():
    t = first_root(PLACES, lambda p, t: np.where(t < p.m, 2.0, 0.5), LOW, HIGH, np.ones(41, bool))
    assert np.all(t >= PLACES.m)
    np.testing.assert_allclose(t, PLACES.m, rtol=2e-15)


def test_a_root_before_the_bracket_is_its_start():
    t = first_root(PLACES, lambda p, t: np.where(t > 0, 1e-3 / t, 0.0), LOW, HIGH, np.ones(41, bool))
    np.testing.assert_array_equal(t, LOW)


def test_unwanted_cases_are_left_alone():
    wanted = np.arange(41) % 2 == 0
    t = first_root(PLACES, FALLS["power law"], LOW, HIGH, wanted)
    np.testing.assert_array_equal(t[~wanted], HIGH[~wanted])
    np.testing.assert_allclose(t[wanted], PLACES.m[wanted], rtol=1e-14)
    np.testing.assert_array_equal(first_root(PLACES, FALLS["power law"], LOW, HIGH, np.zeros(41, bool)), HIGH)


def test_an_end_that_is_the_root_but_for_rounding_is_taken():
    t = first_root(PLACES, lambda p, t: (HIGH / t) ** 0.5 * (1.0 + 4e-14), HIGH * 0.999, HIGH, np.ones(41, bool))
    np.testing.assert_allclose(t, HIGH, rtol=2e-15)


def test_a_grid_brackets_the_first_of_two_roots():
    low, high, least = bracketed(PLACES, lambda p, t: 0.5 + np.log(t / p.m) ** 2, LOW, HIGH)
    first = PLACES.m * np.exp(-np.sqrt(0.5))
    seen = least <= 1.0
    assert seen.sum() > 20
    assert np.all((low <= np.maximum(first, LOW)) & (high >= np.maximum(first, LOW)))
    step = (HIGH / LOW) ** (1.0 / 23.0)
    assert np.all((high / low)[seen] <= step * (1.0 + 1e-12))


def test_a_grid_that_sees_no_root_keeps_the_bracket():
    low, high, least = bracketed(PLACES, lambda p, t: 1.5 + np.log(t / p.m) ** 2, LOW, HIGH)
    np.testing.assert_array_equal((low, high), (LOW, HIGH))
    assert np.all(least >= 1.5)


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
    st.integers(16, 604), st.floats(1.0 + 1e-9, 1e4), st.floats(0.0, 1.0), st.floats(1e-12, 1e12), st.floats(1e-6, 1e12)
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
