"""Searches over many functions at once, against functions whose answers are known."""

from dataclasses import dataclass

import numpy as np
import pytest

from cpic_planner.etc.searches import first_root, lowest


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
