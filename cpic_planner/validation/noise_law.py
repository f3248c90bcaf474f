"""Noise of a matched-filtered residual: the law of one position, and the level and strength that the residual tells.

Gaussian noise and speckles follow the law, with a scale that is estimated; the fit finds the level of the white noise
and the strength of the speckles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
_LEAST_SHARE, _MOST_SHARE = 1e-3, 0.98
# Range of the logarithm of the squared scale: beyond it the chi-square of 3 degrees of freedom holds 1e-4 of its mass.
_LOG_SCALE2 = np.linspace(-7.0, 2.5, 191)[:, None]
_SCALE = np.exp(0.5 * _LOG_SCALE2)
_KNOWN_DOF = 1e4


def log_tail(snr: npt.ArrayLike, laplace: npt.ArrayLike, dof: npt.ArrayLike = np.inf) -> FloatArray:
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
    level, share, free = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(part, np.float64)) for part in (snr, laplace, dof))
    )
    return _tail(level, share, _scale_weights(free))


def equivalent_sigma(snr: npt.ArrayLike, laplace: npt.ArrayLike, dof: npt.ArrayLike = np.inf) -> FloatArray:
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


def snr_at(sigma: float, laplace: npt.ArrayLike, dof: npt.ArrayLike = np.inf) -> FloatArray:
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
        above = _tail(np.expm1(middle), share, weights) <= asked
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return np.asarray(np.expm1(high))


@dataclass(frozen=True, eq=False)
class _ScaleWeights:
    """Which scales are known, and the logarithms of the weights of the others, normalised, shape (scales, m)."""

    known: npt.NDArray[np.bool_]
    logs: FloatArray


def _scale_weights(free: FloatArray) -> _ScaleWeights:
    """Law of the scale of a variance with so many degrees of freedom."""
    from scipy.special import gammaln

    known = free >= _KNOWN_DOF
    half = 0.5 * free[~known]
    logs = half * (np.log(half) + _LOG_SCALE2 - np.exp(_LOG_SCALE2)) - gammaln(half)
    return _ScaleWeights(known, logs - _log_sum(logs))


def _tail(level: FloatArray, share: FloatArray, weights: _ScaleWeights) -> FloatArray:
    """`log_tail` for known weights."""
    known = weights.known
    if known.all():
        return _known_scale(level, share)
    tail = np.empty(level.shape)
    tail[known] = _known_scale(level[known], share[known])
    at_scale = _known_scale(level[~known] * _SCALE, share[~known])
    tail[~known] = _log_sum(at_scale + weights.logs)
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


BoolArray = npt.NDArray[np.bool_]
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
