"""The value of visits against the tree of all outcomes."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cpic_planner.survey.value import StarValue


def star_of(problems, seed, slots=5, options=2):
    return problems.candidate(np.random.default_rng(seed), options=options, slots=slots, planets=3)


def upper(star, needed, visits):
    """Expected detections that count, over those needed, by the tree of all outcomes."""
    total = 0.0
    for planet, weight in enumerate(star.weight):
        chances = [float(star.chance[option, slot, planet]) for option, slot in visits]
        for hits in itertools.product((False, True), repeat=len(chances)):
            odds = math.prod(p if hit else 1.0 - p for p, hit in zip(chances, hits, strict=True))
            total += weight * odds * min(sum(hits), needed) / needed
    return total


VISITS = st.lists(st.tuples(st.integers(0, 1), st.integers(0, 4)), max_size=5)


@given(seed=st.integers(0, 10_000), needed=st.integers(1, 4), visits=VISITS)
def test_values_are_those_of_all_outcomes(problems, seed, needed, visits):
    star = star_of(problems, seed)
    state = StarValue.of(star, needed, visits)
    assert state.value == pytest.approx(problems.outcomes(star, needed, visits), abs=1e-9)
    assert state.upper == pytest.approx(upper(star, needed, visits), abs=1e-9)
    assert state.upper >= state.value - 1e-12
    if needed == 1:
        assert state.upper == pytest.approx(state.value, abs=1e-12)


@given(seed=st.integers(0, 10_000), needed=st.integers(1, 3), visits=VISITS)
def test_gains_are_what_a_visit_adds(problems, seed, needed, visits):
    star = star_of(problems, seed)
    state = StarValue.of(star, needed, visits)
    value, more = state.gains()
    for option, slot in np.ndindex(value.shape):
        after = state.after((option, slot))
        assert value[option, slot] == pytest.approx(after.value - state.value, abs=1e-9)
        assert more[option, slot] == pytest.approx(after.upper - state.upper, abs=1e-9)


@given(seed=st.integers(0, 10_000), needed=st.integers(1, 3), visits=VISITS, extra=VISITS)
def test_the_upper_value_has_diminishing_returns(problems, seed, needed, visits, extra):
    star = star_of(problems, seed)
    few, many = StarValue.of(star, needed, visits), StarValue.of(star, needed, [*visits, *extra])
    assert np.all(many.gains()[1] <= few.gains()[1] + 1e-9)
    assert many.upper >= few.upper - 1e-12


def test_the_order_of_visits_does_not_matter(problems):
    star, visits = star_of(problems, 4), [(0, 0), (1, 3), (0, 2)]
    values = [StarValue.of(star, 2, order).value for order in itertools.permutations(visits)]
    np.testing.assert_allclose(values, values[0], rtol=1e-12)
