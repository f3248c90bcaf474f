"""Search for least values and first roots of functions of one argument, for many cases at once.

Functions are searched in the logarithm of their argument.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Self

import numpy as np

from cpic_core import FloatArray, NDArray

_COARSE = 24
_BITS, _FEW_CASES, _MANY_CASES = 18, 16, 300
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_NUDGE = 1e-7
_AT_ONCE = 2000
_FEW_NUMBERS = 2000
_MAX_STEPS = 200
_ULPS = 8e-16
# A root is often just above its lower bracket, where the function falls with a slope of some -1.
_START = 3.0
_GRID, _NINE = np.linspace(0.0, 1.0, _COARSE), np.linspace(0.0, 1.0, 9)
_SHARES = {step: np.linspace(0.0, 1.0, 2 ** (step + 1) + 1) for step in (3, 6)}


def spread(array: Any, shape: tuple[int, ...]) -> Any:
    """Return an array in a shape that it broadcasts to: itself where it has it, which `numpy` takes longer to find.

    A few numbers are written out: a view of them takes ten times as long to make.

    Parameters
    ----------
    array : array_like
    shape : tuple of int
    """
    if getattr(array, "shape", None) == shape:
        return array
    if math.prod(shape) > _FEW_NUMBERS:
        return np.broadcast_to(array, shape)
    whole = np.empty(shape, getattr(array, "dtype", None) or np.asarray(array).dtype)
    whole[...] = array
    return whole


def whole_steps(most: float, n: int) -> FloatArray:
    """Return whole numbers from 1 to the most, evenly in the logarithm, each once: ``n`` of them or fewer."""
    every = np.rint(np.geomspace(1.0, most, n))
    return np.asarray(every[np.diff(every, prepend=0.0) > 0.0])  # `numpy.unique` would load masked arrays


def mapped(function: Callable[..., Any], first: Any, *others: Any) -> Any:
    """Return arrays, tuples or `CaseArrays` of them, with every array changed by a function; what is no array stays.

    Parameters
    ----------
    function : callable
        Of an array, and of those of others at its place.
    first, *others : object
        Of one structure.
    """
    if isinstance(first, (np.ndarray, np.floating)):
        return function(first, *others)
    if isinstance(first, CaseArrays):
        return first._combined(function, *others)
    if isinstance(first, tuple):
        parts = [mapped(function, *each) for each in zip(first, *others, strict=True)]
        return type(first)(*parts) if hasattr(first, "_fields") else tuple(parts)
    return first


class CaseArrays:
    """Base of dataclasses of arrays that broadcast, a case each; what is no array is the same for all cases."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    def _combined(self, function: Callable[..., Any], *others: "CaseArrays") -> Self:
        """Return these cases with every array changed by a function of it and of those of others."""
        parts = {name: getattr(self, name) for name in self.__dataclass_fields__}
        for name, own in parts.items():
            if isinstance(own, (np.ndarray, np.floating, CaseArrays, tuple)):
                parts[name] = mapped(function, own, *(getattr(case, name) for case in others))
        return type(self)(**parts)

    def at(self, index: Any) -> Self:
        """Return the cases of a mask, as flat arrays, or one element of the first axis."""
        masked = isinstance(index, np.ndarray) and index.dtype == np.bool_
        shape = index.shape if masked else getattr(self, "shape", None)
        return self._combined(lambda array: (array if shape is None else spread(array, shape))[index])

    def spread(self, shape: tuple[int, ...]) -> Self:
        """Return the cases repeated along new first axes."""
        return self._combined(lambda array: spread(array, shape))

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


def lowest(
    problem: Any,
    function: Callable[..., FloatArray],
    low: FloatArray,
    high: FloatArray,
    *more: FloatArray,
    coarse: bool = True,
) -> tuple[FloatArray, FloatArray]:
    """Return the argument of least value between two bounds, case by case.

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
    still falls there and no point of a grid lies below it. The others are closed in on from the lowest point of the
    grid, to some 3e-6 of it.
    """
    grid = _between(low, high, _GRID) if coarse else np.array(high, float)[None]
    beside = np.maximum(high * (1.0 - _NUDGE), low)[None]
    seen = function(problem, np.concatenate((grid, beside)), *more)
    values, at_high = seen[:-1], seen[-2]
    falling = (seen[-1] >= at_high) & np.isfinite(at_high)
    search = (high > low) & ~falling
    if coarse:
        k = np.argmin(np.where(np.isnan(values), np.inf, values), axis=0)
        search |= (high > low) & (k < _COARSE - 1)
    t, value = np.array(high, float), np.array(at_high, float)
    if not search.any():
        return t, value
    part, others = problem.at(search), [array[search] for array in more]
    lo, hi = low[search], high[search]
    if coarse:
        lo = taken(grid, np.maximum(k - 1, 0))[search]
        hi = taken(grid, np.minimum(k + 1, _COARSE - 1))[search]
    best_t, best_value = _closed_in(lambda t: function(part, t, *others), lo, hi, _BITS if coarse else _BITS + 3)
    better = best_value < value[search]
    t[search] = np.where(better, best_t, t[search])
    value[search] = np.where(better, best_value, value[search])
    return t, value


def _closed_in(
    function: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray, bits: int
) -> tuple[FloatArray, FloatArray]:
    """Return the argument of least value in one valley, to ``2^-bits`` of the logarithm of its width, and the value.

    Many cases are searched by golden sections, which take the fewest values; a few cost as much as one, and close in by
    whole grids.
    """
    if low.size >= _MANY_CASES:
        return _golden(function, np.log(low), np.log(high), math.ceil(bits * math.log(2.0) / -math.log(_GOLDEN)))
    step = 6 if low.size < _FEW_CASES else 3
    share = _SHARES[step]
    for _ in range(math.ceil(bits / step)):
        fine = _between(low, high, share)
        found = function(fine)
        j = np.argmin(np.where(np.isnan(found), np.inf, found), axis=0)
        low, high = taken(fine, np.maximum(j - 1, 0)), taken(fine, np.minimum(j + 1, len(share) - 1))
    return taken(fine, j), taken(found, j)


def _golden(
    function: Callable[[FloatArray], FloatArray], a: FloatArray, b: FloatArray, steps: int
) -> tuple[FloatArray, FloatArray]:
    """Return the same as `_closed_in`, between logarithms."""

    def value(x: FloatArray) -> FloatArray:
        found = function(np.exp(x))
        return np.where(np.isnan(found), np.inf, found)

    left, right = b - _GOLDEN * (b - a), a + _GOLDEN * (b - a)
    at_left, at_right = value(left), value(right)
    for _ in range(steps):
        down = at_left <= at_right
        a, b = np.where(down, a, left), np.where(down, right, b)
        new = np.where(down, b - _GOLDEN * (b - a), a + _GOLDEN * (b - a))
        there = value(new)
        left, right = np.where(down, new, right), np.where(down, left, new)
        at_left, at_right = np.where(down, there, at_right), np.where(down, at_left, there)
    down = at_left <= at_right
    return np.exp(np.where(down, left, right)), np.where(down, at_left, at_right)


def _between(low: FloatArray, high: FloatArray, share: FloatArray) -> FloatArray:
    """Return the points between two bounds, evenly in the logarithm, on a new first axis; the ends are exact."""
    shares = share.reshape((-1,) + (1,) * low.ndim)
    points = low * (high / low) ** shares
    points[-1] = high
    return points


def lowest_whole(cost: Callable[[FloatArray], FloatArray], most: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the whole number from 1 to ``most`` of least cost, to 4 % beyond some 25, and it; cost has one valley.

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
        grid = np.round(low * (high / low) ** _NINE.reshape(axis))
    values = cost(grid)
    return around_lowest(grid, values)[1], np.fmin.reduce(values)


def around_lowest(grid: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the point before the one of least value along the first axis, that one, and the point after it.

    Parameters
    ----------
    grid, values : ndarray
        NaN is never least.
    """
    k = np.argmin(np.where(np.isnan(values), np.inf, values), axis=0)
    wide = spread(grid, values.shape)
    return taken(wide, np.maximum(k - 1, 0)), taken(wide, k), taken(wide, np.minimum(k + 1, len(grid) - 1))


def taken(array: FloatArray, index: NDArray[np.int_]) -> FloatArray:
    """Return one element of the first axis for every case.

    Parameters
    ----------
    array : ndarray
    index : ndarray of int
        Of the shape of the other axes.
    """
    flat = array.reshape(len(array), -1)[index.reshape(-1), np.arange(index.size)]
    return np.asarray(flat.reshape(index.shape))


def last_true(condition: Callable[[FloatArray], NDArray[np.bool_]], shape: tuple[int, ...], bits: int) -> FloatArray:
    """Return the largest whole multiple of ``2^-bits`` below 1 at which a condition holds that holds up to some number.

    Parameters
    ----------
    condition : callable
        Of numbers with one more axis in front than ``shape``.
    shape : tuple of int
    bits : int

    Returns
    -------
    ndarray
        0 where it holds nowhere else; whether it does there is not asked.
    """
    found, left = np.zeros(shape), bits
    while left:
        # As many at once as cost little more than one.
        step = min(left, max(1, int(np.log2(_AT_ONCE / max(found.size, 1)))) if found.size < _AT_ONCE else 1)
        left -= step
        points = np.arange(1.0, 2.0**step).reshape((-1,) + (1,) * len(shape)) * 2.0 ** (left - bits)
        found = found + np.count_nonzero(condition(found + points), axis=0) * 2.0 ** (left - bits)
    return found


def bracketed(
    problem: Any, function: Callable[..., FloatArray], low: FloatArray, high: FloatArray, *more: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return closer brackets of the first root of `first_root`, from a grid between the given ones.

    Parameters
    ----------
    problem, function, low, high, *more
        As of `lowest`.

    Returns
    -------
    low, high, least : ndarray
        The last point before the function is at most 1, and the first one where it is; without such a point the given
        brackets. ``least`` is the least value that was seen.
    """
    grid = _between(low, high, _GRID)
    seen = function(problem, grid, *more)
    seen = np.where(np.isnan(seen), np.inf, seen)
    k, least = np.argmax(seen <= 1.0, axis=0), seen.min(axis=0)
    some = least <= 1.0
    return np.where(some, taken(grid, np.maximum(k - 1, 0)), low), np.where(some, taken(grid, k), high), least


def first_root(
    problem: Any,
    function: Callable[..., FloatArray],
    low: FloatArray,
    high: FloatArray,
    wanted: NDArray[np.bool_],
    *more: FloatArray,
    tolerance: float = 2e-15,
) -> FloatArray:
    """Return where a falling positive function comes down to 1: the least argument with a value of at most 1.

    Parameters
    ----------
    problem, function, *more
        As in `lowest`; all arrays of the shape of ``low``. A function that knows all cases or none has None for them.
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
    Chandrupatla (1997, Adv. Eng. Software 28, 145) on logarithms, which straighten power laws: the parabola through the
    last three points where it is monotonic between them, else a bisection.
    """
    t = np.array(high, float)
    mask = wanted & (high > low)
    if not mask.any():
        return t
    part, others = None if problem is None else problem.at(mask), [array[mask] for array in more]
    start, end = np.log(low[mask]), np.log(high[mask])
    at_start, at_end = (np.log(function(part, ends[mask], *others)) for ends in (low, high))
    at_low, at_end = at_start <= 0.0, np.minimum(at_end, 0.0)
    # The last point, the one on the other side of the root, and the one before.
    x, fx, other, f_other = end, at_end, start, at_start
    with np.errstate(invalid="ignore", divide="ignore"):
        new = start + at_start * np.fmin(_START, (end - start) / (at_start - at_end))
    new = np.where((new > start) & (new < end), new, 0.5 * (start + end))
    for _ in range(_MAX_STEPS):
        below = np.where(fx <= 0.0, fx, f_other)
        roundings = np.maximum(_ULPS * np.maximum(np.abs(x), 1.0), 0.05 * tolerance)
        if (at_low | (below > -tolerance) | (np.abs(x - other) <= 0.25 * roundings)).all():
            break
        f_new = np.log(function(part, np.exp(new), *others))
        same = (f_new <= 0.0) == (fx <= 0.0)
        last, f_last = np.where(same, x, other), np.where(same, fx, f_other)
        other, f_other = np.where(same, other, x), np.where(same, f_other, fx)
        x, fx = new, f_new
        with np.errstate(invalid="ignore", divide="ignore"):
            place, value = (x - other) / (last - other), (fx - f_other) / (f_last - f_other)
            share = fx / (f_other - fx) * f_last / (f_other - f_last)
            share += (last - x) / (other - x) * fx / (f_last - fx) * f_other / (f_last - f_other)
            curved = (value**2 < place) & ((1.0 - value) ** 2 < 1.0 - place)
            # A root that rounding puts on an end is a few roundings inside of it, not halfway to the other one.
            within = np.minimum(roundings / np.abs(other - x), 0.25)
            share = np.minimum(np.maximum(np.where(curved, share, 0.5), within), 1.0 - within)
        new = x + share * (other - x)
    t[mask] = np.where(at_low, low[mask], np.minimum(np.exp(np.where(fx <= 0.0, x, other)), high[mask]))
    return t


def first_root_of_all(
    function: Callable[[FloatArray], FloatArray],
    low: FloatArray,
    high: FloatArray,
    wanted: NDArray[np.bool_],
    tolerance: float = 2e-15,
) -> FloatArray:
    """Return what `first_root` does where the function knows all cases or none; ``low`` where none is wanted.

    Parameters
    ----------
    function : callable
        Of an array of the shape of ``low``.
    low, high, wanted, tolerance
        As of `first_root`.
    """

    def value(_: Any, t: FloatArray) -> FloatArray:
        return np.where(wanted, np.clip(function(t.reshape(low.shape)), 1e-300, 1e300), 1.0).ravel()

    ends = low.ravel(), np.maximum(high, low * (1.0 + 1e-15)).ravel()
    return first_root(None, value, *ends, np.ones(low.size, bool), tolerance=tolerance).reshape(low.shape)
