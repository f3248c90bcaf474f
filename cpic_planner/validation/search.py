"""Thresholds of a blind search: how many false alarms a searched region holds above a level, and the noise in it.

The fit of the noise finds the level of the white noise and the strength of the speckles that a residual shows.
"""

import math
from dataclasses import dataclass

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, NDArray, Outcome, Reason, Status
from cpic_planner.validation.apertures import check_positive, described

MIN_ELEMENTS = 3.0
MIN_SIGMA, MAX_SIGMA = 2.0, 20.0
"""Below 2 sigma excursions run together: their number is no longer that of their Euler characteristic."""
_LOWEST, _HIGHEST = 1.0, 1e60  # thresholds: the density of maxima falls beyond 1
_MOST_LEVEL = 1e100  # its square is finite


@dataclass(frozen=True)
class SearchedRegion:
    """Size and shape of the positions that a search visits; made by `searched_region`.

    Attributes
    ----------
    area_pixels : float
        Area between the outermost positions.
    half_perimeter_pixels : float
        Half of its circumference, holes included.
    euler : float
        Number of pieces less number of holes in them.
    n_positions : int
        Pixels of the region.
    n_elements : float
        Resolution elements, areas of ``(lambda/D)^2``, in these pixels.
    """

    area_pixels: float
    half_perimeter_pixels: float
    euler: float
    n_positions: int
    n_elements: float


def searched_region(region: BoolArray, lambda_d_pixels: float) -> SearchedRegion:
    """Measure the pixels of a search.

    Parameters
    ----------
    region : ndarray of bool, shape (n, n)
        Pixels on whose centres a source is looked for.
    lambda_d_pixels : float
        lambda/D, above 0.

    Raises
    ------
    InputError
        If an argument is out of range.

    Notes
    -----
    Pixel centres are the corners of a lattice of P points, E edges and F squares: area F, half perimeter E - 2 F, Euler
    characteristic P - E + F (Worsley et al. 1996, Human Brain Mapping 4, 58, in two dimensions).
    """
    pixels = np.asarray(region)
    if pixels.dtype != np.bool_ or pixels.ndim != 2:
        raise InputError("region", described(pixels), allowed="booleans (y, x)")
    check_positive("lambda_d_pixels", lambda_d_pixels, "px")
    points = int(np.count_nonzero(pixels))
    upright = pixels[1:] & pixels[:-1]
    edges = int(np.count_nonzero(upright) + np.count_nonzero(pixels[:, 1:] & pixels[:, :-1]))
    squares = int(np.count_nonzero(upright[:, 1:] & upright[:, :-1]))
    half_perimeter, euler = float(edges - 2 * squares), float(points - edges + squares)
    return SearchedRegion(float(squares), half_perimeter, euler, points, points / lambda_d_pixels**2)


def false_alarms(threshold: ArrayLike, region: SearchedRegion, roughness: float) -> FloatArray:
    """Return the expected number of noise peaks of a search at or above a level.

    Parameters
    ----------
    threshold : array_like
        Signal over known noise, 1 to 1e100.
    region : SearchedRegion
    roughness : float
        Variance of the gradient of the significance map along one axis, per square pixel, above 0.

    Returns
    -------
    ndarray
        Shape of ``threshold``.

    Notes
    -----
    The expected Euler characteristic of the part of a smooth Gaussian field above a level ``u``, which at high ``u`` is
    the number of its peaks, is ``sum_d L_d roughness^(d/2) rho_d(u)`` with the half perimeter and area of the region as
    ``L_1`` and ``L_2`` (Adler & Taylor 2007, Random Fields and Geometry, ch. 12). The densities ``rho_1 = exp(-u^2/2) /
    (2 pi)`` and ``rho_2 = u exp(-u^2/2) / (2 pi)^(3/2)`` hold for known noise.
    """
    from scipy.special import ndtr

    level = np.asarray(threshold, dtype=np.float64)
    if not ((level >= _LOWEST) & (level <= _MOST_LEVEL)).all():
        raise InputError("threshold", threshold, allowed=f"{_LOWEST:g} to {_MOST_LEVEL:g}")
    check_positive("roughness", roughness, "1/px2")
    slope, curve = math.sqrt(roughness), np.exp(-0.5 * level**2)
    return np.asarray(
        region.euler * ndtr(-level)
        + region.half_perimeter_pixels * slope / (2.0 * math.pi) * curve
        + region.area_pixels * slope**2 / (2.0 * math.pi) ** 1.5 * (level * curve)
    )


def search_threshold(
    region: SearchedRegion, roughness: float, *, sigma: float = 5.0, per_search: bool = False
) -> Outcome[float]:
    """Return the level that noise alone reaches as rarely as asked anywhere in a searched region.

    Parameters
    ----------
    region : SearchedRegion
    roughness : float
        As in `false_alarms`.
    sigma : float
        Gaussian significance that states the false-alarm probability, 2 to 20.
    per_search : bool
        Whether this probability is that of one false alarm in the whole search. By default it is that of one in each
        resolution element of the region, as with `cpic_planner.etc.detection.detection_threshold`: a search of n
        elements then expects n times that many.

    Returns
    -------
    Outcome of float
        ``unreachable`` with reason ``too_few_resolution_elements`` below 3 elements.

    Raises
    ------
    InputError
        If an argument is out of range.

    Examples
    --------
    A square of 70 x 70 pixels with 3.3 pixels to lambda/D:

    >>> import numpy as np
    >>> square = searched_region(np.ones((70, 70), bool), 3.3)
    >>> round(search_threshold(square, 0.2, sigma=3.0).unwrap(), 2)
    3.43
    """
    from scipy.optimize import brentq
    from scipy.special import ndtr

    if not (MIN_SIGMA <= sigma <= MAX_SIGMA):
        raise InputError("sigma", sigma, unit="sigma", allowed=f"{MIN_SIGMA:g} to {MAX_SIGMA:g}")
    check_positive("roughness", roughness, "1/px2")
    if region.n_elements < MIN_ELEMENTS:
        text = f"{region.n_elements:.3g} resolution elements: too few to know the noise"
        return Outcome.refuse(Status.UNREACHABLE, Reason.TOO_FEW_ELEMENTS, text, unit="sigma")
    asked = math.log(float(ndtr(-sigma)) * (1.0 if per_search else region.n_elements))

    def excess(log_level: float) -> float:
        return math.log(max(float(false_alarms(math.exp(log_level), region, roughness)), 1e-320)) - asked

    low, high = math.log(_LOWEST), math.log(_HIGHEST)
    if excess(low) <= 0.0:  # a region whose few positions cannot give that many alarms
        return Outcome.ok(_LOWEST, unit="sigma")
    return Outcome.ok(math.exp(float(brentq(excess, low, high, xtol=1e-9))), unit="sigma")


# What is believed before the residual is seen, as standard deviations of natural logarithms: white noise is computed
# from known numbers, the drift of a visit and what all visits share from assumed ones (A).
PRIOR_WHITE, PRIOR_DRIFT, PRIOR_COMMON = 0.25, 1.0, 1.0
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
        known = [PRIOR_WHITE, PRIOR_DRIFT]
        return np.array(known if self.shared is None else [*known, PRIOR_COMMON])

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
