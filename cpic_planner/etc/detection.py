"""Levels of a detection.

Thresholds for few resolution elements (Mawet et al. 2014, ApJ 792, 97), and the verdict. Tails of the noise of one
position of a residual: Gaussian noise and speckles of visits, of an estimated scale. Thresholds of a blind search: how
many false alarms a searched region holds above a level.
"""

import functools
import math

import numpy as np

from cpic_core import (
    ArrayLike,
    BoolArray,
    FloatArray,
    InputError,
    Outcome,
    Reason,
    Record,
    Status,
    check_positive,
    checked_array,
    special,
)
from cpic_planner.results import VerdictText

MIN_ELEMENTS = 3
# The false-alarm probability of 20 sigma is 3e-89. Below 1e-100 the quantile of SciPy before 1.17 has no correct digit.
MAX_SIGMA = 20.0
_N_ELEMENTS = 8000


def detection_threshold(n_resolution_elements: float, sigma: float = 5.0) -> Outcome[float]:
    """Return the significance that a planet must reach to be detected.

    Parameters
    ----------
    n_resolution_elements : float
        Independent resolution elements at the planet's separation, the tested one included; at least 0.
    sigma : float, optional
        Gaussian significance whose false-alarm probability is asked for, above 0 and at most 20.

    Returns
    -------
    Outcome of float
        Threshold on (flux - mean of the other elements) / (their sample standard deviation) with the
        one-sided false-alarm probability of ``sigma`` in a normal law: ``t(n - 2) sqrt(1 + 1/(n - 1))``.
        ``unreachable`` with reason ``too_few_resolution_elements`` below 3 elements. One tested position: a
        search over many positions needs more.

    Raises
    ------
    InputError
        If an argument is not a finite number in range.

    Examples
    --------
    >>> round(detection_threshold(19).unwrap(), 2)
    7.95
    """
    if np.ndim(n_resolution_elements):
        raise InputError("n_resolution_elements", n_resolution_elements, allowed="one number (see threshold_array)")
    threshold = float(threshold_array(n_resolution_elements, sigma))
    if math.isfinite(threshold):
        return Outcome.ok(threshold, unit="sigma")
    text = f"{float(n_resolution_elements):g} elements: the background scatter is undefined below {MIN_ELEMENTS}"
    return Outcome.refuse(Status.UNREACHABLE, Reason.TOO_FEW_ELEMENTS, text, unit="sigma")


def threshold_array(n_resolution_elements: ArrayLike, sigma: ArrayLike = 5.0) -> FloatArray:
    """Return the same as `detection_threshold`, for arrays.

    Parameters
    ----------
    n_resolution_elements : array_like
        Numbers of elements (fractions allowed), finite and at least 0.
    sigma : array_like, optional
        Gaussian significances, above 0 and at most 20; broadcasts.

    Returns
    -------
    ndarray
        Thresholds, ``inf`` below 3 elements; never NaN.

    Raises
    ------
    InputError
        If an element is not a finite number in range.
    """
    elements = checked_array("n_resolution_elements", n_resolution_elements, low=0.0)
    above = f"above 0 and at most {MAX_SIGMA:g}"
    level = checked_array("sigma", sigma, low=np.finfo(float).tiny, high=MAX_SIGMA, unit="sigma", allowed=above)
    defined = elements >= MIN_ELEMENTS
    n = np.where(defined, elements, float(MIN_ELEMENTS))
    # Lower tail of the symmetric law: its probability keeps full relative precision where 1 - p would not.
    quantile = -special().stdtrit(n - 2.0, special().ndtr(-level))
    return np.asarray(np.where(defined, quantile * np.sqrt(1.0 + 1.0 / (n - 1.0)), np.inf))


def near_threshold(elements: FloatArray, sigma: float) -> FloatArray:
    """Return `threshold_array` from a table, within 1e-6 of it: for many numbers of elements, and one level.

    Parameters
    ----------
    elements : ndarray
        Numbers of resolution elements, finite and at least 0.
    sigma : float
        As of `detection_threshold`.
    """
    found = np.exp(np.interp(elements, *_thresholds(sigma)))
    return np.where(elements >= MIN_ELEMENTS, found, np.inf)


@functools.lru_cache(maxsize=8)
def _thresholds(sigma: float) -> tuple[FloatArray, FloatArray]:
    """Return the numbers of resolution elements, and logarithms of the thresholds of that level."""
    elements = MIN_ELEMENTS - 1.0 + np.geomspace(1.0, 1e5, _N_ELEMENTS)
    return elements, np.log(threshold_array(elements, sigma))


def verdict_of(status: Status, detected: bool) -> VerdictText:
    """Return the verdict of an answer about a planet.

    Parameters
    ----------
    status : Status
        Every status but ``ok`` gives ``unreachable``.
    detected : bool
        Whether the probability is at least one half.
    """
    if status is not Status.OK:
        return "unreachable"
    return "detected" if detected else "measured_not_detected"


# Beyond these a law is as good as its limit: known noise, and Gaussian speckles.
_KNOWN_DOF, _MANY_VISITS = 1e6, 1e6
_DROP, _STEPS = 23.0, 14  # of the logarithm of the integrand at the ends of the sum; of their search
_LEAST_LOG, _TERMS = -600.0, 18
_MOST_ROUNDS, _CLOSE = 80, 1e-11


def log_tail(snr: ArrayLike, laplace: ArrayLike, dof: ArrayLike = np.inf, visits: ArrayLike = 1.0) -> FloatArray:
    """Return the logarithm of the probability that noise alone reaches a level.

    Parameters
    ----------
    snr : array_like, shape (n,)
        Signal over estimated standard deviation, at least 0.
    laplace : array_like
        Share of the variance that is a sum of Laplace variates, 0 to 1; the rest is Gaussian.
    dof : array_like
        Degrees of freedom of the estimated variance, above 0; broadcasts.
    visits : array_like
        Number V of these variates, of equal variance, above 0; fractions allowed (`effective_visits`).

    Notes
    -----
    The light of two independent circular Gaussian fields differs by a Laplace variate. The sum of V of them is Gaussian
    noise of a variance that is a Gamma variate of shape V (variance-gamma law, Madan & Seneta 1990, J. Business 63,
    511), so that the noise has the characteristic function ``exp(-(1-s) t^2/2) (1 + s t^2/(2V))^-V``. The tail is the
    mean of Gaussian tails, of Student's where the scale is estimated, over that variate: a trapezoidal sum over its
    logarithm, around the largest term, to 1e-9 of the tail.
    """
    parts = (np.atleast_1d(np.asarray(part, np.float64)) for part in (snr, laplace, dof, visits))
    level, share, free, number = np.broadcast_arrays(*parts)
    share = np.where(number < _MANY_VISITS, share, 0.0)
    result = _scaled_tail(level, free)
    mixed = share > 0.0
    if mixed.any():
        result[mixed] = _mixed_tail(level[mixed], share[mixed], free[mixed], number[mixed])
    return result


def _mixed_tail(level: FloatArray, share: FloatArray, free: FloatArray, number: FloatArray) -> FloatArray:
    """Return the same as `log_tail`, for shares above 0, shape (n,)."""
    from scipy.special import gammaln, wrightomega

    few, squared = np.minimum(free, 1e9), level**2

    def exponent(log_ratio: FloatArray) -> FloatArray:
        """Return the logarithm of the integrand but for factors that vary slowly."""
        ratio = np.exp(log_ratio)
        variance = np.maximum(1.0 - share + share * ratio, 1e-300)
        return np.asarray(number * (log_ratio - ratio) - 0.5 * (few + 1.0) * np.log1p(squared / (few * variance)))

    # The largest term: a root of a convex falling function of the ratio, which Newton's steps reach from below.
    ratio, extra = np.ones(level.shape), squared / few
    for _ in range(_STEPS):
        variance = 1.0 - share + share * ratio
        pull = 0.5 * (few + 1.0) * share * extra / (variance * (variance + extra))
        slope = -number / ratio**2 - pull * share * (1.0 / variance + 1.0 / (variance + extra))
        change = (number / ratio - number + pull) / slope
        ratio = ratio - change
        if np.abs(change).max() < _CLOSE:
            break
    top = np.log(ratio)
    floor = exponent(top) - _DROP
    height = ratio - top + (0.5 * (few + 1.0) * np.log1p(extra / (1.0 - share + share * ratio)) + _DROP) / number
    inside, outside = np.stack([top, top]), np.stack([top - ratio - _DROP / number, np.log(2.0 * height + 2.0)])
    for _ in range(_STEPS):
        middle = 0.5 * (inside + outside)
        above = exponent(middle) > floor
        inside, outside = np.where(above, middle, inside), np.where(above, outside, middle)
    # In p with log G = p - exp(-p) the integrand falls doubly exponentially to both sides.
    low, high = outside + wrightomega(-outside)
    count = int(_TERMS + _TERMS / min(float(number.min()), 1e3))
    step = (high - low) / count
    places = low + step * np.arange(count + 1)[:, None]
    shrunk = np.exp(-places)
    logs = places - shrunk
    ratios = np.exp(logs)
    weights = number * (logs - ratios + np.log(number)) - gammaln(number) + np.log1p(shrunk)
    spread = np.sqrt(np.maximum(1.0 - share + share * ratios, 1e-300))
    return np.asarray(_log_sum(weights + _scaled_tail(level / spread, free)) + np.log(step))


def _scaled_tail(level: FloatArray, free: FloatArray) -> FloatArray:
    """Return the logarithm of the tail of Student's law, of the normal law for many degrees of freedom."""
    from scipy.special import betaln, hyp2f1, log_ndtr, stdtr

    free = np.broadcast_to(free, level.shape)
    known = free >= _KNOWN_DOF
    tail = np.empty(level.shape)
    tail[known] = log_ndtr(-level[known])
    if not known.all():
        number, value = free[~known], level[~known]
        with np.errstate(divide="ignore"):
            logs = np.log(stdtr(number, -value))
        far = logs < _LEAST_LOG  # where the tail itself is no number: the incomplete beta function's series
        half, below = 0.5 * number[far], 1.0 / (1.0 + value[far] ** 2 / number[far])
        series = np.log(hyp2f1(half, 0.5, half + 1.0, below)) - np.log(2.0 * half) - betaln(half, 0.5)
        logs[far] = half * np.log(below) + series
        tail[~known] = logs
    return tail


def _log_sum(logs: FloatArray) -> FloatArray:
    """Return the logarithm of the sum of exponentials over the first axis."""
    top = logs.max(axis=0)
    # Rows in memory are added alike, one or many: a sum over the first axis takes another order for a single column.
    terms = np.ascontiguousarray(np.exp(logs - top).T)
    return np.asarray(top + np.log(terms.sum(axis=-1)))


def equivalent_sigma(
    snr: ArrayLike, laplace: ArrayLike, dof: ArrayLike = np.inf, visits: ArrayLike = 1.0
) -> FloatArray:
    """Return the level of a standard normal variate that noise reaches as rarely.

    Parameters
    ----------
    snr : array_like
        Signal over estimated standard deviation, of any sign.
    laplace, dof, visits : array_like
        As of `log_tail`.
    """
    from scipy.special import ndtri_exp

    level = np.asarray(snr, np.float64)
    return np.asarray(np.copysign(ndtri_exp(log_tail(np.abs(level), laplace, dof, visits)), level))


def snr_at(sigma: float, laplace: ArrayLike, dof: ArrayLike = np.inf, visits: ArrayLike = 1.0) -> FloatArray:
    """Return the signal over estimated noise whose `equivalent_sigma` is ``sigma``, to 1e-9; false position.

    Parameters
    ----------
    sigma : float
        Level of a standard normal variate, above 0.
    laplace, dof, visits : array_like
        As of `log_tail`.
    """
    from scipy.special import log_ndtr

    parts = np.broadcast_arrays(*(np.atleast_1d(np.asarray(part, float)) for part in (laplace, dof, visits)))
    asked = float(log_ndtr(-sigma))

    def excess(logs: FloatArray) -> FloatArray:
        """Return the error of the square root of the tail's logarithm, which is nearly straight."""
        return np.sqrt(-log_tail(np.exp(logs), *parts)) - math.sqrt(-asked)

    # Tails are heavier than Gaussian ones: the level is not below.
    low = np.full(parts[0].shape, math.log(sigma) - 1e-6)
    high = low + 0.7
    below, above = excess(low), excess(high)
    while (short := above < 0.0).any():
        low, below = np.where(short, high, low), np.where(short, above, below)
        high = np.where(short, high + (high - math.log(sigma)), high)
        above = np.where(short, excess(high), above)
    middle, found, side = low, np.zeros(low.shape, bool), np.zeros(low.shape)
    for _ in range(_MOST_ROUNDS):
        middle = np.where(found, middle, (low * above - high * below) / (above - below))
        value = excess(middle)
        found |= np.abs(value) < _CLOSE
        if found.all():
            break
        # Illinois: an end that stays twice counts half, so that it moves soon.
        now = np.where(value > 0.0, 1.0, -1.0)
        again, right = now == side, now > 0.0
        below = np.where(right, np.where(again, 0.5 * below, below), value)
        above = np.where(right, value, np.where(again, 0.5 * above, above))
        low, high, side = np.where(right, low, middle), np.where(right, middle, high), now
    return np.asarray(np.exp(middle))


MIN_SIGMA = 2.0
"""Below 2 sigma excursions run together: their number is no longer that of their Euler characteristic."""
_LOWEST, _HIGHEST = 1.0, 1e60  # thresholds: the density of maxima falls beyond 1
_MOST_LEVEL = 1e100  # its square is finite
_CLOSE_LEVEL = 1e-10


class SearchedRegion(Record):
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

    level = checked_array("threshold", threshold, low=_LOWEST, high=_MOST_LEVEL)
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
    while high - low > _CLOSE_LEVEL:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0.0 else (low, middle)
    return Outcome.ok(math.exp(0.5 * (low + high)), unit="sigma")
