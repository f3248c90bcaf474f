"""Noise of a residual, as a search finds it: the level of the white noise and the strength of the speckles."""

import math
from dataclasses import dataclass

import numpy as np

from cpic_core import BoolArray, FloatArray, NDArray
from cpic_planner.etc import PRIORS

_MAX_STEPS, _MAX_CHANGE, _DONE = 15, 2.0, 1e-3


@dataclass(frozen=True, eq=False)
class NoiseTerms:
    """Terms of the variance per position, shape (p,): ``level white + drift linear + drift^2 square``.

    With a third number, ``+ drift common shared``: speckles that are the same in all visits.
    """

    white: FloatArray
    linear: FloatArray
    square: FloatArray
    shared: FloatArray | None = None

    @property
    def believed(self) -> FloatArray:
        """Standard deviations of the logarithms of the numbers, before a residual is seen."""
        return np.array(PRIORS[:2] if self.shared is None else PRIORS)

    def at(self, places: BoolArray | NDArray[np.intp] | int | slice) -> "NoiseTerms":
        """Return the terms of some of the positions."""
        return NoiseTerms(*(part[places] for part in self._arrays()))

    def beside(self, other: "NoiseTerms") -> "NoiseTerms":
        """Return the terms of these positions and of others, of the same numbers."""
        return NoiseTerms(*map(np.concatenate, zip(self._arrays(), other._arrays(), strict=True)))

    def _arrays(self) -> list[FloatArray]:
        parts = [self.white, self.linear, self.square]
        return parts if self.shared is None else [*parts, self.shared]

    def _parts(self, logs: FloatArray) -> list[FloatArray]:
        """Return the terms at the logarithms of the numbers."""
        level, drift = np.exp(logs[:2])
        parts = [level * self.white, drift * self.linear, drift**2 * self.square]
        return parts if self.shared is None else [*parts, drift * math.exp(logs[2]) * self.shared]

    def variance(self, logs: FloatArray) -> FloatArray:
        """Return the sum of the terms at the logarithms of ``level``, ``drift`` and ``common``."""
        return np.asarray(sum(self._parts(logs)))

    def slopes(self, logs: FloatArray, variance: FloatArray) -> FloatArray:
        """Return the derivatives of the logarithm of the variance, shape (2 or 3, p).

        Parameters
        ----------
        logs : ndarray, shape (2,) or (3,)
            Of ``level``, ``drift`` and ``common``.
        variance : ndarray, shape (p,)
            There.
        """
        white, linear, square, *shared = self._parts(logs)
        return np.stack([white, sum(shared, linear + 2.0 * square), *shared]) / variance


@dataclass(frozen=True, eq=False)
class NoiseFit:
    """Logarithms of the numbers of `NoiseTerms`, the inverse of their covariance, and the variance per position."""

    logs: FloatArray
    information: FloatArray
    variance: FloatArray


def fit_noise(
    ratio: FloatArray, before: FloatArray, terms: NoiseTerms, weight: FloatArray, start: FloatArray
) -> NoiseFit:
    """Return the most probable level, drift and common part, given squared significances.

    Parameters
    ----------
    ratio : ndarray, shape (p,)
        Squares of the residual over its standard deviation, with the variances ``before``.
    before : ndarray, shape (p,)
        Variance that was assumed.
    terms : NoiseTerms
    weight : ndarray, shape (p,)
        Independent samples per position: neighbours share their noise.
    start : ndarray, shape (2,) or (3,)
        First guess of the logarithms.

    Notes
    -----
    Minimises ``sum weight [ln V + ratio before / V] / 2`` plus the priors, by Fisher scoring with damping.
    """
    prior = np.diag(terms.believed**-2)

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
