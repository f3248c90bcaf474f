"""Means over universes with intervals that hold, and how they converge."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from catalogs.errors import InputError

__all__ = ["Estimate", "convergence", "mean_interval", "spread"]

FloatArray = NDArray[np.float64]
LEVEL = 0.90


@dataclass(frozen=True)
class Estimate:
    """Mean over universes.

    ``low`` and ``high`` hold the true mean with the stated probability; ``error`` is the standard error.
    """

    mean: float
    error: float
    low: float
    high: float
    n: int


def mean_interval(values: ArrayLike, level: float = LEVEL) -> Estimate:
    """Mean of a sample and an interval for that of its law, also where few values differ from the others.

    Parameters
    ----------
    values : array_like, shape (n,)
        One number a universe: a yield, or the difference of two; at least 2.
    level : float
        Probability of the interval, 0.5 to 0.999.

    Returns
    -------
    Estimate

    Notes
    -----
    Yields are small counts and their differences are mostly 0, so the mean is skewed where Student's interval takes it
    to be symmetric. Hall's monotone transformation of the studentised mean, ``g(T) = T + a T^2/3 + a^2 T^3/27 +
    a/6`` with ``a = skewness / sqrt(n)``, removes the skewness (Hall 1992, J. R. Stat. Soc. B 54, 221); its inverse at
    Student's quantiles gives the ends. A sample without any scatter leaves the interval that Poisson events allow that
    were not met: ``-ln(1 - level) / n`` above and below the mean.
    """
    x = np.asarray(values, float)
    if x.ndim != 1 or x.size < 2 or not np.isfinite(x).all():
        raise InputError("values", x.shape, allowed="at least two finite numbers, one a universe")
    if not 0.5 <= level <= 0.999:
        raise InputError("level", level, allowed="0.5 to 0.999")
    n, mean = x.size, float(x.mean())
    sd = float(x.std(ddof=1))
    if sd <= 1e-12 * max(1.0, abs(mean)):
        reach = -math.log1p(-level) / n
        return Estimate(mean, 0.0, mean - reach, mean + reach, n)
    from scipy.special import stdtrit

    error = sd / math.sqrt(n)
    skewness = float(np.mean((x - mean) ** 3)) / float(np.mean((x - mean) ** 2)) ** 1.5
    a, t = skewness / math.sqrt(n), float(stdtrit(n - 1, 0.5 + 0.5 * level))
    ends = [mean - error * _hall_inverse(sign * t, a) for sign in (1.0, -1.0)]
    return Estimate(mean, error, min(ends), max(ends), n)


def _hall_inverse(t: float, a: float) -> float:
    """Studentised mean at which Hall's transformation is ``t``."""
    if abs(a) < 1e-9:
        return t
    return 3.0 / a * (math.copysign(abs(1.0 + a * (t - a / 6.0)) ** (1.0 / 3.0), 1.0 + a * (t - a / 6.0)) - 1.0)


def spread(values: ArrayLike, level: float = LEVEL) -> tuple[float, float]:
    """Quantiles between which that part of the universes lies: what one survey may turn out to be."""
    x = np.asarray(values, float)
    low, high = np.quantile(x, [0.5 - 0.5 * level, 0.5 + 0.5 * level], method="inverted_cdf")
    return float(low), float(high)


def convergence(values: ArrayLike, points: int = 12) -> list[Estimate]:
    """Estimates from the first few universes to all of them, at numbers evenly spaced in logarithm."""
    x = np.asarray(values, float)
    sizes = np.unique(np.geomspace(min(10, x.size), x.size, points).round().astype(int))
    return [mean_interval(x[:size]) for size in sizes if size >= 2]
