"""The EM gain of least noise.

A frame has the variance ``F^2(g) A + B / g^2``, so that the best gain depends on ``u = B / A`` and on the largest gain
alone. ``F^2`` rises from 1 to a broad top (1.98 near gain 300 of 604 stages) and falls a little beyond it, so there can
be two minima: one where reading is beaten, one at the largest gain.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.camera.gain import noise_factor2
from simulator.signal.variance import frame_variance_e2

FloatArray = NDArray[np.float64]
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
    """Tabulate the best gains up to ``gain_max`` of a register of ``stages`` stages."""
    log_ratio = np.linspace(np.log(0.1), np.log(1e8), _N_RATIOS)
    ratio, top = np.exp(log_ratio), np.log(gain_max)

    def variance(log_gain: FloatArray) -> FloatArray:
        return noise_factor2(np.exp(log_gain), stages) + ratio * np.exp(-2.0 * log_gain)

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
