"""Detection thresholds for few resolution elements (Mawet et al. 2014, ApJ 792, 97), and the verdict."""

import functools
import math

import numpy as np
import numpy.typing as npt

from cpic_core import FloatArray, InputError, Outcome, Reason, Status, special
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


def threshold_array(n_resolution_elements: npt.ArrayLike, sigma: npt.ArrayLike = 5.0) -> npt.NDArray[np.float64]:
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
    elements = _numbers("n_resolution_elements", n_resolution_elements, "finite and at least 0")
    if not (np.isfinite(elements) & (elements >= 0)).all():
        raise InputError("n_resolution_elements", n_resolution_elements, allowed="finite and at least 0")
    level = _numbers("sigma", sigma, f"above 0 and at most {MAX_SIGMA:g}")
    if not ((level > 0) & (level <= MAX_SIGMA)).all():
        raise InputError("sigma", sigma, unit="sigma", allowed=f"above 0 and at most {MAX_SIGMA:g}")
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


def _numbers(key: str, value: npt.ArrayLike, allowed: str) -> npt.NDArray[np.float64]:
    array = np.asarray(value)
    if array.dtype.kind not in "iuf":
        raise InputError(key, value, allowed=f"numbers, {allowed}")
    return array.astype(np.float64)


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
