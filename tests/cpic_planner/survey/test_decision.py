"""Choices among plans, against tables that can be worked out by hand and against brute force."""

import itertools

import numpy as np
import pytest

from cpic_planner.planets import read_law
from cpic_planner.survey.doubt import decide, law_weights, quantiles

# A textbook table: three plans under two values.
MEANS = np.array([[10.0, 0.0], [7.0, 4.0], [4.0, 6.0]])


def worth(means, scatter=0.0, n=50, seed=1):
    """Universes with these means exactly."""
    noise = np.random.default_rng(seed).normal(size=(*means.shape, n))
    return means[..., None] + scatter * (noise - noise.mean(axis=2, keepdims=True))


@pytest.mark.parametrize("scatter", [0.0, 3.0])
def test_a_table_by_hand(scatter):
    found = decide(worth(MEANS, scatter), np.array([0.25, 0.75]))
    np.testing.assert_allclose(found.loss, [[0.0, 6.0], [3.0, 2.0], [6.0, 0.0]], atol=1e-12)
    assert found.best.tolist() == [0, 2]
    assert found.cautious == 1  # largest losses 6, 3, 6
    assert found.expected == 2  # 2.5, 4.75, 5.5
    assert found.knowing.mean() == pytest.approx(0.25 * 10.0 + 0.75 * 6.0 - 5.5)


def test_equal_largest_losses_leave_the_choice_to_the_weights():
    found = decide(worth(np.array([[5.0, 3.0], [3.0, 5.0]])), np.array([0.4, 0.6]))
    assert (found.cautious, found.expected) == (1, 1)


@pytest.mark.parametrize("seed", range(20))
def test_every_choice_is_that_of_brute_force(seed):
    random = np.random.default_rng(seed)
    plans, values, universes = (int(n) for n in random.integers((2, 2, 3), (6, 5, 9)))
    made = random.poisson(1.5, (plans, values, universes)).astype(float)
    weights = random.dirichlet(np.ones(values))
    found = decide(made, weights)
    mean = [[sum(made[o, t]) / universes for t in range(values)] for o in range(plans)]
    expected = [sum(w * m for w, m in zip(weights, row, strict=True)) for row in mean]
    largest = [max(max(mean[q][t] for q in range(plans)) - mean[o][t] for t in range(values)) for o in range(plans)]
    assert expected[found.expected] == pytest.approx(max(expected))
    assert largest[found.cautious] == pytest.approx(min(largest))
    # Who knows the value may follow any rule from values to plans: the best of all rules less the best single plan.
    rules = itertools.product(range(plans), repeat=values)
    best = max(sum(w * mean[o][t] for t, (w, o) in enumerate(zip(weights, rule, strict=True))) for rule in rules)
    assert found.knowing.mean() == pytest.approx(best - max(expected))
    assert found.knowing.mean() >= -1e-12


def test_the_weight_of_a_value_is_the_part_of_the_law_nearest_to_it():
    law = read_law({"law": "log_uniform", "low": 0.1, "high": 4.0})
    shares = np.log(np.array([0.4, 1.0, 2.0, 4.0]) / 0.1) / np.log(40.0)
    ends = [0.0, *(0.5 * (shares[1:] + shares[:-1])), 1.0]
    order = [2, 0, 3, 1]
    found = law_weights(law, np.array([0.4, 1.0, 2.0, 4.0])[order])
    np.testing.assert_allclose(found, np.diff(ends)[order], atol=2e-5)
    # One value stands for everything; values beyond the law for what lies at its end.
    assert law_weights(law, np.array([1.0])) == pytest.approx([1.0])
    np.testing.assert_allclose(law_weights(law, np.array([0.01, 40.0])), [0.5, 0.5])


def test_weighted_quantiles_are_those_of_repeated_values():
    random = np.random.default_rng(3)
    values = random.normal(size=40)
    times = random.integers(1, 30, 40)
    every = np.repeat(values, times)
    expected = np.quantile(every, [0.05, 0.95], method="inverted_cdf")
    assert quantiles(values, times / times.sum()) == tuple(expected)
    assert quantiles(np.array([2.0, 1.0]), np.array([0.5, 0.5])) == (1.0, 2.0)
    assert quantiles(np.array([2.0, 1.0]), np.array([0.0, 1.0])) == (1.0, 1.0)
