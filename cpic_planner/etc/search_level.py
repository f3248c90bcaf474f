"""Thresholds of a blind search: how many false alarms a searched region holds above a level."""

import math
from dataclasses import dataclass

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, Outcome, Reason, Status, check_positive, special

MIN_ELEMENTS = 3.0
MIN_SIGMA, MAX_SIGMA = 2.0, 20.0
"""Below 2 sigma excursions run together: their number is no longer that of their Euler characteristic."""
_LOWEST, _HIGHEST = 1.0, 1e60  # thresholds: the density of maxima falls beyond 1
_MOST_LEVEL = 1e100  # its square is finite
_CLOSE = 1e-10


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
        raise InputError("region", f"{pixels.dtype} array of shape {pixels.shape}", allowed="booleans (y, x)")
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
    ndtr = special().ndtr

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
    ndtr = special().ndtr

    if not (MIN_SIGMA <= sigma <= MAX_SIGMA):
        raise InputError("sigma", sigma, unit="sigma", allowed=f"{MIN_SIGMA:g} to {MAX_SIGMA:g}")
    check_positive("roughness", roughness, "1/px2")
    if region.n_elements < MIN_ELEMENTS:
        text = f"{region.n_elements:.3g} resolution elements: too few to know the noise"
        return Outcome.refuse(Status.UNREACHABLE, Reason.TOO_FEW_ELEMENTS, text, unit="sigma")
    asked = math.log(float(ndtr(-sigma)) * (1.0 if per_search else region.n_elements))

    def excess(log_level: float) -> float:
        return math.log(max(float(false_alarms(math.exp(log_level), region, roughness)), 1e-320)) - asked

    low = high = math.log(_LOWEST)
    if excess(low) <= 0.0:  # a region whose few positions cannot give that many alarms
        return Outcome.ok(_LOWEST, unit="sigma")
    while excess(high) > 0.0 and high < math.log(_HIGHEST):
        low, high = high, high + 1.0
    while high - low > _CLOSE:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0.0 else (low, middle)
    return Outcome.ok(math.exp(0.5 * (low + high)), unit="sigma")
