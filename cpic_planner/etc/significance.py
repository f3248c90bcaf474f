"""Detection thresholds for few resolution elements (Mawet et al. 2014, ApJ 792, 97)."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from catalogs.errors import InputError
from simulator.outcome import Outcome, Reason, Status

__all__ = ["MIN_ELEMENTS", "detection_threshold", "threshold_array"]

MIN_ELEMENTS = 3
# The false-alarm probability of 20 sigma is 3e-89. Below 1e-100 the quantile of SciPy before 1.17 has no correct digit.
MAX_SIGMA = 20.0


def detection_threshold(n_resolution_elements: float, sigma: float = 5.0) -> Outcome[float]:
    """Significance that a planet must reach to be detected.

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
    return Outcome.refuse(
        Status.UNREACHABLE,
        Reason.TOO_FEW_ELEMENTS,
        f"{float(n_resolution_elements):g} elements: the background scatter is undefined below {MIN_ELEMENTS}",
        unit="sigma",
    )


def threshold_array(n_resolution_elements: npt.ArrayLike, sigma: npt.ArrayLike = 5.0) -> npt.NDArray[np.float64]:
    """`detection_threshold` for arrays.

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
    from scipy.special import ndtr, stdtrit

    elements = _numbers("n_resolution_elements", n_resolution_elements, "finite and at least 0")
    if not (np.isfinite(elements) & (elements >= 0)).all():
        raise InputError("n_resolution_elements", n_resolution_elements, allowed="finite and at least 0")
    level = _numbers("sigma", sigma, f"above 0 and at most {MAX_SIGMA:g}")
    if not ((level > 0) & (level <= MAX_SIGMA)).all():
        raise InputError("sigma", sigma, unit="sigma", allowed=f"above 0 and at most {MAX_SIGMA:g}")
    defined = elements >= MIN_ELEMENTS
    n = np.where(defined, elements, float(MIN_ELEMENTS))
    # Lower tail of the symmetric law: its probability keeps full relative precision where 1 - p would not.
    quantile = -stdtrit(n - 2.0, ndtr(-level))
    return np.asarray(np.where(defined, quantile * np.sqrt(1.0 + 1.0 / (n - 1.0)), np.inf))


def _numbers(key: str, value: npt.ArrayLike, allowed: str) -> npt.NDArray[np.float64]:
    array = np.asarray(value)
    if array.dtype.kind not in "iuf":
        raise InputError(key, value, allowed=f"numbers, {allowed}")
    return array.astype(np.float64)
