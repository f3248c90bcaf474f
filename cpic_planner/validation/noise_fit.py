"""Noise of a residual from the residual itself: level of the white noise, and strength of the speckles."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["NoiseFit", "NoiseTerms", "fit_noise", "smooth_white"]

FloatArray = npt.NDArray[np.float64]
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
        """Derivatives of the logarithm of the variance, shape (2, p)."""
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
