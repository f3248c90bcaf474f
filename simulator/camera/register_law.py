"""The exact law of the multiplication register, tabulated for few electrons, and its cumulants.

One electron leaves a stage as ``1 + Bernoulli(p)`` electrons, so the generating function of the output is that of one
stage, ``f(z) = z (1 - p + p z)``, iterated over the stages; ``n`` electrons give its ``n``-th power. Evaluated on the
unit circle and transformed back, it is the whole distribution to rounding.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["RegisterTable", "output_cumulants", "output_pmf", "register_table"]

FloatArray = npt.NDArray[np.float64]

# Exponent of the probability left out at the upper end of a table, exp(-36) = 2e-16: half a step of a uniform number.
_TAIL = 36.0
MAX_ENTRIES = 450_000
MAX_DIRECT = 64
MAX_LOOKUPS = 3
_GUIDE_SHARE = 4


@dataclass(frozen=True, eq=False)
class RegisterTable:
    """Distribution functions of the output for 1 to ``n_direct`` electrons, one after the other.

    Attributes
    ----------
    cdf : ndarray
        Values of all distribution functions; that of ``n`` electrons starts at the output ``n``.
    start : ndarray of int64
        Where that of ``n`` electrons starts in ``cdf`` (index ``n``; index 0 is unused).
    guide : ndarray of int32
        For equal steps of probability, the first entry to look at, counted from the start.
    guide_start, guide_size : ndarray of int64
        Place and length of each guide.
    n_direct : int
        Largest number of electrons with a table of its own.
    """

    cdf: FloatArray
    start: npt.NDArray[np.int64]
    guide: npt.NDArray[np.int32]
    guide_start: npt.NDArray[np.int64]
    guide_size: npt.NDArray[np.int64]
    n_direct: int


def output_pmf(electrons: int, probability: float, stages: int, size: int) -> FloatArray:
    """Probabilities of 0 to ``size - 1`` electrons at the output (``size`` a power of two; what lies above folds)."""
    return np.asarray(np.fft.irfft(_transform(probability, stages, size) ** electrons, size))


@functools.lru_cache(maxsize=64)
def output_cumulants(probability: float, stages: int) -> tuple[float, float, float]:
    """First three cumulants of the output of one electron, from their recursion over the stages."""
    p, q = probability, 1.0 - probability
    first, second, third = 1.0, 0.0, 0.0
    for _ in range(stages):
        third = (1 + p) ** 3 * third + 3 * (1 + p) * p * q * second + p * q * (1 - 2 * p) * first
        second = (1 + p) ** 2 * second + p * q * first
        first *= 1 + p
    return first, second, third


@functools.lru_cache(maxsize=16)
def register_table(gain: float, probability: float, stages: int) -> RegisterTable:
    """Tables for one register; built in 10 to 500 ms, kept for the last 16 registers."""
    sizes = [_entries(n, gain) for n in range(1, MAX_DIRECT + 1)]
    n_direct = max(int(np.searchsorted(np.cumsum(sizes), MAX_ENTRIES, side="right")), 1)
    size = 1 << math.ceil(math.log2(sizes[n_direct - 1] + n_direct + 1))
    one = _transform(probability, stages, size)
    power = np.ones_like(one)
    functions, guides = [], []
    for n in range(1, n_direct + 1):
        power = power * one
        pmf = np.maximum(np.fft.irfft(power, size), 0.0)[n:]
        function = np.cumsum(pmf)
        function /= function[-1]
        function = function[: sizes[n - 1]].copy()
        function[-1] = 2.0
        steps = 1 << max(math.ceil(math.log2(function.size / _GUIDE_SHARE)), 4) if function.size > 1 else 1
        functions.append(function)
        guides.append(np.searchsorted(function, np.arange(steps) / steps, side="right").astype(np.int32))
    return RegisterTable(
        cdf=np.concatenate(functions),
        start=_starts(functions),
        guide=np.concatenate(guides),
        guide_start=_starts(guides),
        guide_size=np.array([0, *(guide.size for guide in guides)], dtype=np.int64),
        n_direct=n_direct,
    )


def _starts(parts: list[npt.NDArray[np.float64]] | list[npt.NDArray[np.int32]]) -> npt.NDArray[np.int64]:
    return np.array([0, 0, *np.cumsum([part.size for part in parts[:-1]])], dtype=np.int64)


def _entries(electrons: int, gain: float) -> int:
    """Outputs up to which the tail, that of a sum of exponentials, is below exp(-36)."""
    return int(gain * (electrons + math.sqrt(2.0 * electrons * _TAIL) + _TAIL)) + 32


def _transform(probability: float, stages: int, size: int) -> npt.NDArray[np.complex128]:
    z = np.exp(-2j * np.pi * np.arange(size // 2 + 1) / size)
    for _ in range(stages):
        z *= 1.0 - probability + probability * z
    return z
