"""Noise of a matched-filtered residual: the law of one position, and the level and strength that the residual tells.

Gaussian noise and speckles follow the law, with a scale that is estimated; the fit finds the level of the white noise
and the strength of the speckles.

What a pixel without a cosmic ray can show: upper limits from the exact law of the camera.

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

from cpic_core import ArrayLike, BoolArray, FloatArray
from simulator.detectors import generating_function, stage_probability

_LEAST_SHARE, _MOST_SHARE = 1e-3, 0.98
# Range of the logarithm of the squared scale: beyond it the chi-square of 3 degrees of freedom holds 1e-4 of its mass.
_LOG_SCALE2 = np.linspace(-7.0, 2.5, 191)[:, None]
_SCALE = np.exp(0.5 * _LOG_SCALE2)
_KNOWN_DOF = 1e4


def log_tail(snr: ArrayLike, laplace: ArrayLike, dof: ArrayLike = np.inf) -> FloatArray:
    """Logarithm of the probability that noise alone reaches a level.

    Parameters
    ----------
    snr : array_like, shape (n,)
        Signal over estimated standard deviation, at least 0.
    laplace : array_like
        Share of the variance that follows a Laplace law, 0 to 1; the rest is Gaussian.
    dof : array_like
        Degrees of freedom of the estimated variance, above 0; broadcasts.

    Notes
    -----
    The light of two independent circular Gaussian fields differs by a Laplace variate; its sum with Gaussian noise has
    the tail ``Phi(-x) + exp(y^2/2) [exp(-t/b) Phi(x - y) - exp(t/b) Phi(-x - y)] / 2`` with ``x = t/s, y = s/b``
    (normal-Laplace law, Reed & Jorgensen 2004, Commun. Stat. Theory Methods 33, 1733). The mean over the estimated
    scale is taken numerically; without a Laplace share it is Student's t.
    """
    parts = (np.atleast_1d(np.asarray(part, np.float64)) for part in (snr, laplace, dof))
    level, share, free = np.broadcast_arrays(*parts)
    return _tail(level, share, *_scale_weights(free))


def equivalent_sigma(snr: ArrayLike, laplace: ArrayLike, dof: ArrayLike = np.inf) -> FloatArray:
    """Return the level of a standard normal variate that noise reaches as rarely.

    Parameters
    ----------
    snr : array_like
        Signal over estimated standard deviation, of any sign.
    laplace, dof : array_like
        As of `log_tail`.
    """
    from scipy.special import ndtri_exp

    level = np.asarray(snr, np.float64)
    return np.asarray(np.copysign(ndtri_exp(log_tail(np.abs(level), laplace, dof)), level))


def snr_at(sigma: float, laplace: ArrayLike, dof: ArrayLike = np.inf) -> FloatArray:
    """Return the signal over estimated noise whose `equivalent_sigma` is ``sigma``, to 1e-6; bisection.

    Parameters
    ----------
    sigma : float
        Level of a standard normal variate, above 0.
    laplace, dof : array_like
        As of `log_tail`.
    """
    from scipy.special import log_ndtr

    share, free = np.broadcast_arrays(np.atleast_1d(np.asarray(laplace, float)), np.asarray(dof, float))
    weights, asked = _scale_weights(free), log_ndtr(-sigma)
    low, high = np.zeros(share.shape), np.full(share.shape, np.log(1e6))
    for _ in range(45):
        middle = 0.5 * (low + high)
        above = _tail(np.expm1(middle), share, *weights) <= asked
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return np.asarray(np.expm1(high))


def _scale_weights(free: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Law of the scale of a variance with so many degrees of freedom.

    Which scales are known, and the logarithms of the weights of the others, normalised, shape (scales, m).
    """
    from scipy.special import gammaln

    known = free >= _KNOWN_DOF
    half = 0.5 * free[~known]
    logs = half * (np.log(half) + _LOG_SCALE2 - np.exp(_LOG_SCALE2)) - gammaln(half)
    return known, logs - _log_sum(logs)


def _tail(level: FloatArray, share: FloatArray, known: BoolArray, log_weights: FloatArray) -> FloatArray:
    """`log_tail` for known weights."""
    tail = np.empty(level.shape)
    tail[known] = _known_scale(level[known], share[known])
    if not known.all():
        tail[~known] = _log_sum(_known_scale(level[~known] * _SCALE, share[~known]) + log_weights)
    return tail


def _log_sum(logs: FloatArray) -> FloatArray:
    """Logarithm of the sum of exponentials over the first axis."""
    top = np.maximum(logs.max(axis=0), -1e300)
    with np.errstate(divide="ignore"):
        return np.asarray(top + np.log(np.exp(logs - top).sum(axis=0)))


def _known_scale(level: FloatArray, share: FloatArray) -> FloatArray:
    from scipy.special import log_ndtr

    heavy = np.clip(share, _LEAST_SHARE, _MOST_SHARE)
    width, fall = np.sqrt(1.0 - heavy), np.sqrt(0.5 * heavy)
    x, y = level / width, width / fall
    gauss = log_ndtr(-x)
    right = 0.5 * y**2 - level / fall + log_ndtr(x - y)
    left = 0.5 * y**2 + level / fall + log_ndtr(-x - y)
    # The terms of a Gaussian law with next to no Laplace share cancel: it is then better alone.
    top = np.maximum(gauss, right)
    total = np.exp(gauss - top) + 0.5 * (np.exp(right - top) - np.exp(left - top))
    result: FloatArray = np.where(share > _LEAST_SHARE, top + np.log(np.maximum(total, 1e-300)), log_ndtr(-level))
    return result


# What is believed before the residual is seen, as standard deviations of natural logarithms: white noise is computed
# from known numbers, the drift of a visit from an assumed one (A).
PRIOR_WHITE, PRIOR_DRIFT = 0.25, 1.0
_MAX_STEPS, _MAX_CHANGE, _DONE = 15, 2.0, 1e-3


@dataclass(frozen=True, eq=False)
class NoiseTerms:
    """Terms of the variance per position, shape (p,): ``level white + drift linear + drift^2 square``."""

    white: FloatArray
    linear: FloatArray
    square: FloatArray

    def variance(self, logs: FloatArray) -> FloatArray:
        """Sum of the terms at the logarithms of ``level`` and ``drift``."""
        level, drift = np.exp(logs)
        return np.asarray(level * self.white + drift * self.linear + drift**2 * self.square)

    def slopes(self, logs: FloatArray, variance: FloatArray) -> FloatArray:
        """Return the derivatives of the logarithm of the variance, shape (2, p).

        Parameters
        ----------
        logs : ndarray, shape (2,)
            Of ``level`` and ``drift``.
        variance : ndarray, shape (p,)
            There.
        """
        level, drift = np.exp(logs)
        return np.stack([level * self.white, drift * self.linear + 2.0 * drift**2 * self.square]) / variance


@dataclass(frozen=True, eq=False)
class NoiseFit:
    """Logarithms of ``level`` and ``drift``, the inverse of their covariance, and the variance per position."""

    logs: FloatArray
    information: FloatArray
    variance: FloatArray


def fit_noise(
    ratio: FloatArray, before: FloatArray, terms: NoiseTerms, weight: FloatArray, start: FloatArray
) -> NoiseFit:
    """Most probable level and drift, given squared significances.

    Parameters
    ----------
    ratio : ndarray, shape (p,)
        Squares of the residual over its standard deviation, with the variances ``before``.
    before : ndarray, shape (p,)
        Variance that was assumed.
    terms : NoiseTerms
    weight : ndarray, shape (p,)
        Independent samples per position: neighbours share their noise.
    start : ndarray, shape (2,)
        First guess of the logarithms.

    Notes
    -----
    Minimises ``sum weight [ln V + ratio before / V] / 2`` plus the priors, by Fisher scoring with damping.
    """
    prior = np.diag([PRIOR_WHITE**-2, PRIOR_DRIFT**-2])

    def cost(logs: FloatArray) -> tuple[float, FloatArray]:
        variance = terms.variance(logs)
        relative = variance / before
        return 0.5 * float(np.sum(weight * (np.log(relative) + ratio / relative)) + logs @ prior @ logs), variance

    logs = np.array(start, float)
    value, variance = cost(logs)
    damping = 1e-4
    for _ in range(_MAX_STEPS):
        slopes = terms.slopes(logs, variance)
        gradient = 0.5 * (slopes * weight) @ (1.0 - ratio * before / variance) + prior @ logs
        information = 0.5 * (slopes * weight) @ slopes.T + prior
        while True:
            change = np.linalg.solve(information + damping * np.diag(np.diag(information)), -gradient)
            trial = logs + np.clip(change, -_MAX_CHANGE, _MAX_CHANGE)
            lower, there = cost(trial)
            if lower <= value or damping > 1e6:
                break
            damping *= 10.0
        if lower > value:
            break
        gained, logs, value, variance, damping = value - lower, trial, lower, there, 0.1 * damping
        if gained < _DONE:
            break
    slopes = terms.slopes(logs, variance)
    return NoiseFit(logs, 0.5 * (slopes * weight) @ slopes.T + prior, variance)


def smooth_white(measured: FloatArray, patterns: FloatArray) -> FloatArray:
    """Variance without the noise of its own measurement: least squares on smooth patterns.

    Parameters
    ----------
    measured : ndarray, shape (p,)
        Variance per position, from frames that hold the same noise as the residual: where they happen to be dark the
        residual is bright and its variance is understated.
    patterns : ndarray, shape (k, p)
        Images of the light, at least 0.

    Returns
    -------
    ndarray, shape (p,)
        Not below a quarter of the median of ``measured``.
    """
    scales = patterns.mean(axis=1)
    used = patterns[scales > 0] / scales[scales > 0][:, None]
    weights, *_ = np.linalg.lstsq(used.T, measured, rcond=None)
    return np.asarray(np.maximum(weights @ used, 0.25 * math.fabs(float(np.median(measured)))))


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
        Its stages.
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
        """Level that a pixel of known mean exceeds with at most the chance that is allowed.

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
        """Level that one of several frames of a pixel exceeds at most so often, whatever the pixel's mean.

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
    """Slopes ``s``, ``m(s)`` at them, and ``-m(-u)`` at the depths ``u``."""
    p = float(stage_probability(em_gain, stages))

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
    """Minimum over lines ``slope x + offset``, to second order: each x takes the best line of a place near it."""
    if x.size == 0:
        return np.zeros(x.shape)
    places = np.unique(np.quantile(x, np.linspace(0.0, 1.0, min(_PLACES, x.size))))
    best = np.argmin(np.multiply.outer(places, slope) + offset, axis=1)
    middle = 0.5 * (places[1:] + places[:-1])
    chosen = best[np.searchsorted(middle, x)]
    return np.asarray(slope[chosen] * x + offset[chosen])
