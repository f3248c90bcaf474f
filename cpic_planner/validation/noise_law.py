"""Upper limits of what a pixel without a cosmic ray shows, from the exact law of the camera.

One pixel of one frame holds a Poisson number of electrons of mean ``lambda``, multiplied by the register and read with
Gaussian noise. In electrons at the register input its cumulant function is exactly
``lambda m(s) + sigma^2 s^2 / 2``, where ``1 + m(s)`` is the mean of ``exp(s output / gain)`` of one electron: the
generating function of the register (`simulator.detectors.gain`) at real arguments. Markov's inequality
``P(X > T) <= exp(lambda m(s) + sigma^2 s^2 / 2 - s T)`` (Chernoff 1952) then bounds the tail for every ``s``, at any
gain and level: no normal law and no exponential one is assumed.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np

from cpic_core import ArrayLike, FloatArray
from simulator.detectors import generating_function, stage_probability

# Slopes s of the bound in 1/e-: any set is valid, a dense one is sharp. Noise of 1e4 e- needs 5e-4.
_SLOPES = np.geomspace(1e-5, 30.0, 1500)
_LARGEST_GROWTH = 1e9
_DEPTHS = np.geomspace(1e-6, 1e4, 3000)
_PLACES = 256


@dataclass(frozen=True)
class PixelLaw:
    """The law of a pixel of one frame, and the chance with which noise may exceed a limit.

    Attributes
    ----------
    em_gain : float
        Gain of the register.
    stages : int
        Its stages; 0 without one.
    sigma_e : float
        Gaussian noise referred to the register input.
    false_alarm : float
        Largest chance, above 0 and below 1.
    """

    em_gain: float
    stages: int
    sigma_e: float
    false_alarm: float

    def limit_of_mean(self, mean_e: ArrayLike) -> FloatArray:
        """Return the level that a pixel of known mean exceeds with at most the chance that is allowed.

        Parameters
        ----------
        mean_e : array_like
            Mean electrons of the pixel in a frame, dark current and clock-induced charge included, at least 0.

        Returns
        -------
        ndarray
            ``min over s of (mean m(s) + sigma^2 s^2 / 2 - log(false_alarm)) / s``.
        """
        slopes, growth, _ = _growth(float(self.em_gain), int(self.stages))
        mean = np.asarray(mean_e, dtype=np.float64)
        offset = (0.5 * (self.sigma_e * slopes) ** 2 - math.log(self.false_alarm)) / slopes
        return _lowest_line(mean, growth / slopes, offset)

    def limit_beside_others(self, total_e: ArrayLike, n_frames: int, drift: float = 0.0) -> FloatArray:
        """Return the level that one of several frames of a pixel exceeds at most so often, whatever the pixel's mean.

        Parameters
        ----------
        total_e : array_like
            Sum of the pixel over all ``n_frames`` frames, the one to be tested included.
        n_frames : int
            Number of frames, at least 2.
        drift : float
            The mean of the tested frame may exceed that of the others by this fraction.

        Returns
        -------
        ndarray
            Limits on a single frame.

        Notes
        -----
        With ``R`` the sum of the other ``n - 1`` frames, ``E exp(s X - u R) = exp(lambda [(1 + drift) m(s) + (n - 1)
        m(-u)] + sigma^2 (s^2 + (n - 1) u^2) / 2)``. Where ``u`` makes the bracket 0 (or negative) the unknown mean is
        gone and ``s X - u R > sigma^2 (s^2 + (n - 1) u^2) / 2 - log(false_alarm)`` happens with at most that chance.
        Written for the total, each ``s`` is a line in it; the lowest is taken. (That choice looks at the total, which
        costs less than what the inequality gives away: exact tails stay below ``false_alarm``.)
        """
        slopes, growth, depth = _growth(float(self.em_gain), int(self.stages))
        others = n_frames - 1
        index = np.searchsorted(depth, growth * (1.0 + drift) / others)
        possible = index < depth.size
        s, u = slopes[possible], _DEPTHS[index[possible]]
        constant = 0.5 * self.sigma_e**2 * (s**2 + others * u**2) - math.log(self.false_alarm)
        return _lowest_line(np.asarray(total_e, dtype=np.float64), u / (s + u), constant / (s + u))


@functools.lru_cache(maxsize=16)
def _growth(em_gain: float, stages: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the slopes ``s``, ``m(s)`` at them, and ``-m(-u)`` at the depths ``u``."""
    p = float(stage_probability(em_gain, max(stages, 1)))

    def m(s: FloatArray) -> FloatArray:
        with np.errstate(over="ignore", invalid="ignore"):
            value = generating_function(np.exp(s / em_gain).astype(np.complex128), p, stages).real - 1.0
        return np.asarray(value)

    up = m(_SLOPES)
    fine = np.isfinite(up) & (up < _LARGEST_GROWTH)
    # Beyond the first overflow the product of infinities is no number.
    last = int(np.argmin(fine)) if not fine.all() else fine.size
    return _SLOPES[:last], up[:last], -m(-_DEPTHS)


def _lowest_line(x: FloatArray, slope: FloatArray, offset: FloatArray) -> FloatArray:
    """Return the minimum over lines ``slope x + offset``, to second order: the best line of a near place each."""
    if x.size == 0:
        return np.zeros(x.shape)
    places = np.unique(np.quantile(x, np.linspace(0.0, 1.0, min(_PLACES, x.size))))
    best = np.argmin(np.multiply.outer(places, slope) + offset, axis=1)
    middle = 0.5 * (places[1:] + places[:-1])
    chosen = best[np.searchsorted(middle, x)]
    return np.asarray(slope[chosen] * x + offset[chosen])
