"""Many cases at once: their arrays, least values and first roots of functions of one argument, the gain of least noise.

Functions are searched in the logarithm of their argument. A frame has the variance ``F^2(g) A + B / g^2``, so that the
best gain depends on ``u = B / A`` and on the largest gain alone. ``F^2`` rises from 1 to a broad top (1.98 near gain
300 of 604 stages) and falls a little beyond it, so there can be two minima: one where reading is beaten, one at the
largest gain.
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self, TypeVar

import numpy as np

from cpic_core import FloatArray, NDArray
from simulator.detectors import frame_variance_e2, noise_factor2

_COARSE, _FINE, _ROUNDS = 24, 17, 6
_NUDGE = 1e-7
_MAX_STEPS = 200


class CaseArrays:
    """Base of dataclasses whose arrays have one shape, a case each; what is no array is the same for all cases."""

    def _combined(self, function: Callable[..., Any], *others: "CaseArrays") -> Self:
        """These cases with every array changed by a function of it and of those of others."""
        parts = dict(vars(self))
        for name, own in parts.items():
            if isinstance(own, (np.ndarray, np.floating)):
                parts[name] = function(own, *(getattr(case, name) for case in others))
            elif isinstance(own, CaseArrays):
                parts[name] = own._combined(function, *(getattr(case, name) for case in others))
        return type(self)(**parts)

    def at(self, index: Any) -> Self:
        """Return the cases of a mask, as flat arrays, or one element of the first axis."""
        return self._combined(lambda array: array[index])

    def spread(self, shape: tuple[int, ...]) -> Self:
        """Return the cases repeated along new first axes."""
        return self._combined(lambda array: np.broadcast_to(array, shape))

    def where(self, mask: NDArray[np.bool_], other: Self) -> Self:
        """Return these cases where the mask holds, others elsewhere.

        Parameters
        ----------
        mask : ndarray of bool
        other : CaseArrays
            Of the same kind and shape.
        """
        return self._combined(lambda one, two: np.where(mask, one, two), other)

    @classmethod
    def stacked(cls, cases: Sequence[Self], axis: int = 0) -> Self:
        """Return cases of one kind and shape on a new axis: solved together they cost little more than one."""
        return cases[0]._combined(lambda *arrays: np.stack(arrays, axis), *cases[1:])


class _Selectable(Protocol):
    def at(self, mask: NDArray[np.bool_]) -> Any: ...


Problem = TypeVar("Problem", bound=_Selectable)


def lowest(
    problem: Problem,
    function: Callable[..., FloatArray],
    low: FloatArray,
    high: FloatArray,
    *more: FloatArray,
    coarse: bool = True,
) -> tuple[FloatArray, FloatArray]:
    """Argument of least value between two bounds, case by case.

    Parameters
    ----------
    problem : object with ``at(mask)``
        Its cases are selected together with the arguments.
    function : callable
        ``function(problem, t, *more)``; arrays of one shape, or with one axis more in front for ``t``.
    low, high : ndarray
        Bounds, positive.
    *more : ndarray
        Further arrays of that shape.
    coarse : bool
        Look at a grid over the whole range as well; not needed where there is one minimum only.

    Returns
    -------
    t, value : ndarray

    Notes
    -----
    The upper bound is where saturation or the visit ends, and nearly always the answer: it is taken where the function
    still falls there and no point of a grid lies below it. The others are searched on grids that close in on the lowest
    point, to some 3e-6 of it.
    """
    at_high = function(problem, high, *more)
    falling = (function(problem, np.maximum(high * (1.0 - _NUDGE), low), *more) >= at_high) & np.isfinite(at_high)
    search = (high > low) & ~falling
    if coarse:
        grid = _between(low, high, np.linspace(0.0, 1.0, _COARSE))
        values = function(problem, grid, *more)
        k = np.argmin(np.where(np.isnan(values), np.inf, values), axis=0)
        search |= (high > low) & (k < _COARSE - 1)
    t, value = np.array(high, float), np.array(at_high, float)
    if not search.any():
        return t, value
    part, others = problem.at(search), [array[search] for array in more]
    lo, hi = low[search], high[search]
    if coarse:
        lo = np.take_along_axis(grid, np.maximum(k - 1, 0)[None], axis=0)[0][search]
        hi = np.take_along_axis(grid, np.minimum(k + 1, _COARSE - 1)[None], axis=0)[0][search]
    share = np.linspace(0.0, 1.0, _FINE)
    for _ in range(_ROUNDS if coarse else _ROUNDS + 1):
        fine = _between(lo, hi, share)
        found = function(part, fine, *others)
        j = np.argmin(np.where(np.isnan(found), np.inf, found), axis=0)
        lo = np.take_along_axis(fine, np.maximum(j - 1, 0)[None], axis=0)[0]
        hi = np.take_along_axis(fine, np.minimum(j + 1, _FINE - 1)[None], axis=0)[0]
    best_t = np.take_along_axis(fine, j[None], axis=0)[0]
    best_value = np.take_along_axis(found, j[None], axis=0)[0]
    better = best_value < value[search]
    t[search] = np.where(better, best_t, t[search])
    value[search] = np.where(better, best_value, value[search])
    return t, value


def _between(low: FloatArray, high: FloatArray, share: FloatArray) -> FloatArray:
    """Points between two bounds, evenly in the logarithm, on a new first axis; the ends are exact."""
    shares = share.reshape((-1,) + (1,) * low.ndim)
    points = low * (high / low) ** shares
    points[-1] = high
    return points


def lowest_whole(cost: Callable[[FloatArray], FloatArray], most: FloatArray) -> FloatArray:
    """Return the whole number from 1 to ``most`` of least cost, where cost has one valley; to 4 % beyond some 25.

    Parameters
    ----------
    cost : callable
        Of numbers with one more axis in front.
    most : ndarray
    """
    top = np.maximum(most, 1.0)
    axis = (-1,) + (1,) * top.ndim
    grid = np.minimum(2.0 ** np.arange(np.ceil(np.log2(top.max())) + 1.0).reshape(axis), top)
    for _ in range(2):
        low, high = around_lowest(grid, cost(grid))[::2]
        grid = np.round(low * (high / low) ** np.linspace(0.0, 1.0, 9).reshape(axis))
    return around_lowest(grid, cost(grid))[1]


def around_lowest(grid: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the point before the one of least value along the first axis, that one, and the point after it.

    Parameters
    ----------
    grid, values : ndarray
        NaN is never least.
    """
    k = np.argmin(np.where(np.isnan(values), np.inf, values), axis=0)[None]
    wide = np.broadcast_to(grid, values.shape)
    last = len(grid) - 1
    before, best, after = (np.take_along_axis(wide, np.clip(k + step, 0, last), axis=0)[0] for step in (-1, 0, 1))
    return before, best, after


def first_root(
    problem: Problem,
    function: Callable[..., FloatArray],
    low: FloatArray,
    high: FloatArray,
    wanted: NDArray[np.bool_],
    *more: FloatArray,
    tolerance: float = 2e-15,
) -> FloatArray:
    """Where a falling positive function comes down to 1: the least argument with a value of at most 1.

    Parameters
    ----------
    problem, function, *more
        As in `lowest`; all arrays of the shape of ``low``.
    low, high : ndarray
        Brackets; the value at ``high`` is at most 1. Where that at ``low`` is so already, ``low`` is returned.
    wanted : ndarray of bool
        Cases to solve; ``high`` is returned for the others.
    tolerance : float
        How far below 1 the value may stay.

    Returns
    -------
    ndarray
        The value there is 1 to the tolerance, from below.

    Notes
    -----
    Regula falsi on logarithms, which straighten power laws, with the Illinois rule and a bisection every fourth step.
    """
    t = np.array(high, float)
    mask = wanted & (high > low)
    if not mask.any():
        return t
    part, others = problem.at(mask), [array[mask] for array in more]
    a, b = np.log(low[mask]), np.log(high[mask])
    fa, fb = np.log(function(part, low[mask], *others)), np.log(function(part, high[mask], *others))
    at_low, reached = fa <= 0.0, fb
    last = np.zeros(a.shape, int)
    for step in range(_MAX_STEPS):
        done = at_low | (reached > -tolerance) | (b - a <= 2e-16 * np.maximum(np.abs(b), 1.0))
        if done.all():
            break
        with np.errstate(invalid="ignore", divide="ignore"):
            x = b - fb * (b - a) / (fb - fa)
        x = np.where((x > a) & (x < b) & (step % 4 != 3), x, 0.5 * (a + b))
        fx = np.log(function(part, np.exp(x), *others))
        right = fx <= 0.0
        move_a, move_b = ~right & ~done, right & ~done
        fa = np.where(move_a, fx, np.where(move_b & (last == 1), 0.5 * fa, fa))
        fb = np.where(move_b, fx, np.where(move_a & (last == -1), 0.5 * fb, fb))
        reached = np.where(move_b, fx, reached)
        a, b = np.where(move_a, x, a), np.where(move_b, x, b)
        last = np.where(right, 1, -1)
    t[mask] = np.where(at_low, low[mask], np.minimum(np.exp(b), high[mask]))
    return t


_N_RATIOS, _N_GAINS = 3000, 300
_STEP = 1e-4
_BISECTIONS = 45


@dataclass(frozen=True, eq=False)
class GainTable:
    """Logarithms of the best gains for logarithms of ``B / A``.

    ``near`` is the first minimum of the variance, ``far`` the largest gain where that has less, else ``near``.
    """

    log_ratio: FloatArray
    near: FloatArray
    far: FloatArray
    stages: int


@functools.lru_cache(maxsize=16)
def gain_table(gain_max: float, stages: int) -> GainTable:
    """Return a table of the best gains of a register.

    Parameters
    ----------
    gain_max : float
        Largest gain, above 1.
    stages : int
        Of the register.
    """
    log_ratio = np.linspace(np.log(0.1), np.log(1e8), _N_RATIOS)
    ratio, top = np.exp(log_ratio), np.log(gain_max)

    def variance(log_gain: FloatArray) -> FloatArray:
        result: FloatArray = noise_factor2(np.exp(log_gain), stages) + ratio * np.exp(-2.0 * log_gain)
        return result

    def rises(log_gain: FloatArray) -> NDArray[np.bool_]:
        return variance(log_gain + _STEP) > variance(log_gain - _STEP)

    grid = np.linspace(0.0, top, _N_GAINS)
    on_grid = noise_factor2(np.exp(grid), stages)[:, None] + ratio * np.exp(-2.0 * grid)[:, None]
    # First minimum: where the variance first rises; the largest gain where it never does.
    rising = np.diff(on_grid, axis=0) > 0
    k = np.where(rising.any(axis=0), rising.argmax(axis=0), _N_GAINS - 1)
    low, high = grid[np.maximum(k - 1, 0)], grid[np.minimum(k + 1, _N_GAINS - 1)]
    first = np.where(k == 0, 0.0, np.where(k == _N_GAINS - 1, top, _switch(rises, low, high)))
    far = np.where(variance(np.full(_N_RATIOS, top)) < variance(first), top, first)
    return GainTable(log_ratio, first, far, stages)


def _switch(true: Callable[[FloatArray], NDArray[np.bool_]], low: FloatArray, high: FloatArray) -> FloatArray:
    """Where a condition that holds from some point on becomes true, by bisection; ``low`` where it holds at once."""
    at_low = true(low)
    a, b = low.copy(), high.copy()
    for _ in range(_BISECTIONS):
        middle = 0.5 * (a + b)
        yes = true(middle)
        a, b = np.where(yes, a, middle), np.where(yes, middle, b)
    return np.where(at_low, low, b)


def best_gain(
    light_variance_e2: FloatArray, read_variance_e2: FloatArray, gain_cap: FloatArray, gain_max: float, stages: int
) -> tuple[FloatArray, FloatArray]:
    """Gain of least variance up to a cap, and that variance.

    Parameters
    ----------
    light_variance_e2 : ndarray
        ``A``: variance of a frame that the register multiplies, at ``F^2 = 1``.
    read_variance_e2 : ndarray
        ``B``: variance added at the output.
    gain_cap : ndarray
        Largest gain that saturates nothing; below 1 there is none, and gain 1 is returned for the caller to refuse.
    gain_max : float
        Largest gain of the register.
    stages : int
        Stages of the register; 0 for none.

    Returns
    -------
    gain, variance : ndarray
        Exact but for the table between its points.
    """
    if stages == 0 or gain_max <= 1.0:
        return np.ones(np.broadcast(light_variance_e2, gain_cap).shape), light_variance_e2 + read_variance_e2
    table = gain_table(gain_max, stages)
    with np.errstate(divide="ignore"):
        where = np.log(read_variance_e2) - np.log(light_variance_e2)
    cap = np.maximum(gain_cap, 1.0)
    gain = np.minimum(np.exp(np.interp(where, table.log_ratio, table.near)), cap)
    variance = frame_variance_e2(light_variance_e2, noise_factor2(gain, stages), read_variance_e2, gain)
    other = np.minimum(np.exp(np.interp(where, table.log_ratio, table.far)), cap)
    if np.any(other > gain):
        there = frame_variance_e2(light_variance_e2, noise_factor2(other, stages), read_variance_e2, other)
        better = there < variance
        gain, variance = np.where(better, other, gain), np.where(better, there, variance)
    return gain, variance
