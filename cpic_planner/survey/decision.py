"""Choose among plans where a number is not known: by the smallest largest loss, and by the mean."""

from dataclasses import dataclass

import numpy as np

from cpic_core import FloatArray, IntArray
from cpic_planner.planets import Law
from cpic_planner.survey.estimates import LEVEL

_STEPS, _ROUNDING = 100_000, 1e-12


@dataclass(frozen=True, eq=False)
class Choice:
    """The choice among ``o`` plans where one of ``t`` values is true.

    Attributes
    ----------
    mean : ndarray, shape (o, t)
        Mean over universes.
    best : ndarray of int, shape (t,)
        The plan that has most under each value.
    loss : ndarray, shape (o, t)
        What the best plan has under a value, less what each one has.
    cautious, expected : int
        The plan whose largest loss is smallest, and the plan of most by the weights.
    knowing : ndarray, shape (u,)
        In each universe, the weighted mean of the best plans less that of ``expected``: its mean is what it is worth to
        know the value before choosing (the expected value of perfect information, Raiffa & Schlaifer 1961).
    """

    mean: FloatArray
    best: IntArray
    loss: FloatArray
    cautious: int
    expected: int
    knowing: FloatArray


def decide(worth: FloatArray, weights: FloatArray) -> Choice:
    """Choose among plans.

    Parameters
    ----------
    worth : ndarray, shape (o, t, u)
        What each plan is worth under each value in each universe.
    weights : ndarray, shape (t,)
        How likely the values are; they sum to 1.

    Notes
    -----
    Smallest largest loss is the rule of Savage (1951, JASA 46, 55). Of equal plans the one that has more by the weights
    is taken, and then the first.
    """
    mean = worth.mean(axis=2)
    best = mean.argmax(axis=0)
    loss = mean.max(axis=0) - mean
    by_weight = mean @ weights
    cautious = int(np.lexsort((-by_weight, loss.max(axis=1)))[0])
    expected = int(by_weight.argmax())
    knowing = np.einsum("tu,t->u", worth[best, np.arange(len(best))] - worth[expected], weights)
    return Choice(mean, best, loss, cautious, expected, knowing)


def quantiles(values: FloatArray, weights: FloatArray, level: float = LEVEL) -> tuple[float, float]:
    """Return the values between which that part of the weight lies.

    Parameters
    ----------
    values, weights : ndarray, shape (n,)
        Weights sum to 1.
    level : float, optional
        Part of the weight that lies between them, 0 to 1.
    """
    order = np.argsort(values, kind="stable")
    below = np.cumsum(weights[order])
    ends = np.searchsorted(below, np.array([0.5 - 0.5 * level, 0.5 + 0.5 * level]) - _ROUNDING)
    low, high = values[order[np.minimum(ends, len(values) - 1)]]
    return float(low), float(high)


def law_weights(law: Law, values: FloatArray) -> FloatArray:
    """Return which part of a law each value stands for: that nearer to it than to any other, counted in probability.

    Parameters
    ----------
    law : Law
    values : ndarray, shape (n,)
        All different.
    """
    grid = law.quantile((np.arange(_STEPS) + 0.5) / _STEPS)
    order = np.argsort(values)
    below = np.searchsorted(grid, values[order]) / _STEPS
    ends = np.concatenate([[0.0], 0.5 * (below[1:] + below[:-1]), [1.0]])
    found = np.empty(len(values))
    found[order] = np.diff(ends)
    return found
