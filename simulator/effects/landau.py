"""Landau's law of energy loss, cut off so that it has a mean.

Landau's lambda is the stable law of index 1 and skewness 1; the form of Chambers, Mallows & Stuck (1976, JASA 71, 340)
samples it exactly: with t uniform on (0, pi) and W exponential, ``lambda = -t cot t - ln(W sin t / t)``. Its tail
falls as ``1 / lambda^2``, so that the mean is that of a cut.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numpy.typing import NDArray

_BEYOND = 20.0


def cut_landau(n: int, cut: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw ``n`` values of Landau's lambda, given that it is at most ``cut`` (at least 1)."""
    value = _landau(n, rng)
    (above,) = np.nonzero(value > cut)
    while above.size:
        value[above] = _landau(above.size, rng)
        above = above[value[above] > cut]
    return value


def _landau(n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    # 1 - [0, 1) leaves out 0, where t cot t is a limit; at t = pi the value is huge and cut off.
    t = np.pi * (1.0 - rng.random(n))
    sine = np.sin(t)
    return np.asarray(-t * np.cos(t) / sine - np.log(rng.standard_exponential(n) * sine / t))


@functools.lru_cache(maxsize=64)
def cut_landau_mean(cut: float) -> float:
    """Mean of Landau's lambda, given that it is at most ``cut`` (1 to 600).

    Integrating the sampling form over W leaves smooth functions of t alone:
    ``cut - integral(E1(w)) / integral(exp(-w))`` over 0 to pi, with ``w = exp(-t cot t - cut) t / sin t``.
    """
    from scipy.special import exp1

    # With t = pi s / (1 + s) both integrands fall from one value to 0 within a few units of s around the cut.
    nodes, weights = np.polynomial.legendre.leggauss(16)
    edges = np.linspace(0.0, cut + _BEYOND, math.ceil(cut + _BEYOND) + 1)
    half = 0.5 * np.diff(edges)[:, None]
    s = edges[:-1, None] + half * (1.0 + nodes)
    measure = half * weights / (1.0 + s) ** 2
    t = np.pi * s / (1.0 + s)
    w = np.exp(np.minimum(-t / np.tan(t) - cut + np.log(t / np.sin(t)), math.log(700.0)))
    return float(cut - np.sum(measure * exp1(w)) / np.sum(measure * np.exp(-w)))
