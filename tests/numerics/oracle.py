"""Relative errors and condition numbers of functions in double precision, by mpmath at the very doubles passed."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from mpmath import mp, mpf

DIGITS = 50
ALLOWED = 1e-12
"""Largest relative error of a closed form, times its condition number where that is above 1."""
SMALLEST = 2.3e-308
"""Results below the smallest normal double lose digits by gradual underflow: they count as they are, absolutely."""


@dataclass(frozen=True)
class ClosedForm:
    """A public function, the arguments it is tried with, and its formula in mpmath.

    Attributes
    ----------
    name : str
        Dotted public name.
    domain : str
        What the cases cover, in words.
    cases : sequence of tuple of float
        Arguments; all of them count in the condition number.
    computed : callable
        From doubles to a double: the function under test.
    exact : callable
        From ``mpf`` to ``mpf``: the same formula, written independently.
    fixed : sequence of int
        Positions of arguments that are whole numbers (stages, frames): no derivative is taken by them.
    allowed : float
        Largest relative error over ``max(1, condition)``.
    """

    name: str
    domain: str
    cases: Sequence[tuple[float, ...]]
    computed: Callable[..., float]
    exact: Callable[..., mpf]
    fixed: Sequence[int] = ()
    allowed: float = ALLOWED


@dataclass(frozen=True)
class Point:
    """Relative error and condition number of one case."""

    arguments: tuple[float, ...]
    error: float
    condition: float

    @property
    def share(self) -> float:
        """Error over the condition number where that is above 1: what the allowed error is compared with."""
        return self.error / max(1.0, self.condition)


def points(form: ClosedForm) -> list[Point]:
    """Measure every case of a function; a warning of numpy is an error."""
    found = []
    for case in form.cases:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            value = float(form.computed(*case))
        with mp.workdps(DIGITS):
            exact = form.exact(*(mpf(x) for x in case))
            found.append(Point(tuple(case), _error(value, exact), condition(form, case, exact)))
    return found


def worst(found: Iterable[Point]) -> Point:
    """The case nearest to (or farthest beyond) what is allowed."""
    return max(found, key=lambda point: point.share)


def condition(form: ClosedForm, case: Sequence[float], exact: mpf) -> float:
    """Sum over the arguments of ``|x f'(x) / f(x)|``; 1 where the result is exactly 0."""
    if exact == 0:
        return 1.0
    total = mpf(0)
    for i, x in enumerate(case):
        if i in form.fixed or x == 0:
            continue
        step = mpf(10) ** (-DIGITS // 2) * abs(mpf(x))

        def at(shift: mpf, i: int = i) -> mpf:
            return form.exact(*(mpf(y) + (shift if k == i else 0) for k, y in enumerate(case)))

        total += abs(mpf(x) * (at(step) - at(-step)) / (2 * step) / exact)
    return float(total)


def _error(value: float, exact: mpf) -> float:
    if not math.isfinite(value):
        return math.inf
    difference = abs(mpf(value) - exact)
    if abs(exact) < SMALLEST:
        return 0.0 if difference <= SMALLEST else math.inf
    return float(difference / abs(exact))
