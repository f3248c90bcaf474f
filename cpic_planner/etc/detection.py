"""Detection thresholds for few resolution elements (Mawet et al. 2014, ApJ 792, 97).

The law of detections that simulated images follow, for a blind search and at a known place, and the verdict.
"""

import functools
import math
from collections.abc import Callable
from typing import Annotated

import numpy as np
import numpy.typing as npt
from pydantic import Field

from cpic_core import ArrayLike, FloatArray, InputError, Outcome, Reason, Status, load_yaml, special, split_sourced
from cpic_planner.etc.model import EtcModel
from cpic_planner.etc.noise import StackNoise
from cpic_planner.results import VerdictText
from simulator.config import FrozenModel, Real, preset_path, validate
from simulator.signal import error_light_share

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


INWARD = 0.1
"""Resolution element over separation, ten of them from the star, that the law of a blind search is stated for."""
_LEAST_WIDTH2 = 1e-6


class DetectionLaw(FrozenModel):
    """Normal law of the probability of a detection in the logarithm of significance over threshold.

    Attributes
    ----------
    calibration, calibration_error : float
        Factor on a predicted SNR that gives that of images, and its standard error.
    blind_margin, blind_width, known_margin, known_width : float
        Significance over threshold at which the probability is one half, and the width of the law. For a blind search:
        in Gaussian noise, ten resolution elements from the star, in a single visit.
    blind_tails, blind_inward : float
        What the logarithm of the middle of a blind search gains where all noise is light of the wavefront's errors,
        and for each unit of resolution element over separation (`half_margin`), in a single visit.
    blind_visits : float
        Power of the number of independent wavefronts with which the gain by that light falls.
    stack_margin, stack_inward, stack_width : float
        The same as of ``blind_*`` for so many visits that their scatter tells the noise.
    known_stack_width : float
        The same as ``known_width`` for many visits: the middle is that of a single one.
    blind_margin_error, known_margin_error : float
        Relative standard errors of the middles.
    """

    calibration: Annotated[Real, Field(gt=0, le=10)] = 1.0
    calibration_error: Annotated[Real, Field(ge=0, le=1)] = 0.0
    blind_margin: Annotated[Real, Field(gt=0, le=100)] = 1.0
    blind_width: Annotated[Real, Field(gt=0, le=100)] = 0.2
    blind_tails: Annotated[Real, Field(ge=-10, le=10)] = 0.0
    blind_inward: Annotated[Real, Field(ge=-100, le=100)] = 0.0
    blind_visits: Annotated[Real, Field(ge=0, le=2)] = 0.25
    stack_margin: Annotated[Real, Field(gt=0, le=100)] = 1.0
    stack_inward: Annotated[Real, Field(ge=-100, le=100)] = 0.0
    stack_width: Annotated[Real, Field(gt=0, le=100)] = 0.2
    blind_margin_error: Annotated[Real, Field(ge=0, le=10)] = 0.0
    known_margin: Annotated[Real, Field(gt=0, le=100)] = 1.0
    known_width: Annotated[Real, Field(gt=0, le=100)] = 0.2
    known_stack_width: Annotated[Real, Field(gt=0, le=100)] = 0.2
    known_margin_error: Annotated[Real, Field(ge=0, le=10)] = 0.0


@functools.cache
def default_law() -> DetectionLaw:
    """Return the law of the preset strategy ``default``, whose numbers were measured on simulated images."""
    path = preset_path("strategy", "default", package="cpic_planner")
    assert path is not None
    stated = split_sourced(load_yaml(path, shipped=True))[0]["detection"]
    own = {key: value for key, value in stated.items() if key in DetectionLaw.model_fields}
    return validate(DetectionLaw, own, where="strategy.detection")


def law_of(model: EtcModel, band: str) -> DetectionLaw | None:
    """Return the law that holds for a band of a model.

    Returns
    -------
    DetectionLaw or None
        None where no images were measured: in bands of the near-infrared camera, and where photons are counted.
    """
    measured = model.strategy.mode == "analogue" and band in model.instrument.visible_bands()
    return default_law() if measured else None


def needed_margin(
    model: EtcModel, band: str, tails: ArrayLike, inward: ArrayLike, visits: ArrayLike = 1.0
) -> FloatArray:
    """Return the significance over threshold at which half of the observations detect a planet.

    Parameters
    ----------
    model : EtcModel
        Its strategy says whether the search knows the place.
    band : str
    tails, inward, visits : array_like
        As of `half_margin`.

    Returns
    -------
    ndarray
        By the law of images, or 1 where none was measured (`law_of`).
    """
    law = law_of(model, band)
    if law is None:
        return np.ones(np.broadcast_shapes(np.shape(tails), np.shape(inward), np.shape(visits)))
    at_place = model.strategy.search == "known_place"
    return np.asarray(half_margin(law, at_place, tails, inward, visits) / law.calibration)


def verdict_of(status: Status, detected: bool) -> VerdictText:
    """Return the verdict of an answer about a planet.

    Parameters
    ----------
    status : Status
        Every status but ``ok`` gives ``unreachable``.
    detected : bool
        Whether significance over threshold reaches `needed_margin`: the probability is then at least one half.
    """
    if status is not Status.OK:
        return "unreachable"
    return "detected" if detected else "measured_not_detected"


def half_margin(
    law: DetectionLaw, at_place: ArrayLike, tails: ArrayLike, inward: ArrayLike, visits: ArrayLike = 1.0
) -> FloatArray:
    """Return the significance over threshold at which half of the planets are detected.

    Parameters
    ----------
    law : DetectionLaw
    at_place : array_like of bool
        Planets that are looked for at a known place.
    tails : array_like
        Share of the noise, as rms, that is light of the wavefront's errors (`tail_share`).
    inward : array_like
        Width of a resolution element over the separation.
    visits : array_like
        Independent wavefronts behind the noise (`effective_visits`), above 0.

    Notes
    -----
    ``ln m = t blind_tails V^-blind_visits + g(blind) / V + g(stack) (1 - 1/V)`` with ``g = ln(margin) + inward (i -
    0.1)``. A search that knows no place holds its false alarms down in noise of any tails: it asks for more where the
    light of the wavefront's errors is much of the noise. In a single visit it learns the noise from the few elements of
    the hole; of many visits their scatter tells it, place by place, so that the search asks for less near the star than
    the small-sample threshold that ``margin`` refers to. Whoever knows the place takes photometry there or the search,
    whichever asks for less.
    """
    return margin_of(law, at_place, inward, visits)(np.asarray(tails))


def margin_of(
    law: DetectionLaw, at_place: ArrayLike, inward: ArrayLike, visits: ArrayLike
) -> Callable[[FloatArray], FloatArray]:
    """Return `half_margin` as a function of the share of the errors' light in the noise; parameters as there."""
    alone = 1.0 / np.asarray(visits, float)
    outside = np.asarray(inward) - INWARD
    single = math.log(law.blind_margin) + law.blind_inward * outside
    stack = math.log(law.stack_margin) + law.stack_inward * outside
    slope, calm = law.blind_tails * alone**law.blind_visits, alone * single + (1.0 - alone) * stack
    known = np.where(np.asarray(at_place, bool), law.known_margin, np.inf)
    return lambda tails: np.minimum(known, np.exp(slope * tails + calm))


def detection_probability(
    law: DetectionLaw,
    margin: ArrayLike,
    at_place: ArrayLike,
    tails: ArrayLike,
    inward: ArrayLike,
    *,
    visits: ArrayLike = 1.0,
    shift: ArrayLike = 0.0,
    calibration: ArrayLike = 1.0,
) -> FloatArray:
    """Return the probability that a search detects planets, ``Phi(ln(c margin / m) / w)`` with m of `half_margin`.

    The square of a width is that of one visit over V, and that of a stack for the rest: light of the wavefront's errors
    has heavy tails in one visit, and its mean over many has not. At a known place the larger of two probabilities
    counts, of photometry there and of the search: neither sees less for knowing more. Photometry takes the noise from
    apertures of the summed image, not from the scatter of the visits: its middle knows nothing of their number.

    Parameters
    ----------
    law : DetectionLaw
    margin : array_like
        Predicted significance over threshold.
    at_place, tails, inward, visits
        As of `half_margin`.
    shift : array_like
        Standard errors by which the law's middle is off.
    calibration : array_like
        ``c``: factor on a predicted SNR that gives that of images.
    """
    off = np.asarray(shift, float)
    with np.errstate(divide="ignore"):
        reached = np.log(np.asarray(margin) * np.asarray(calibration, float))
    blind = reached - np.log(half_margin(law, False, tails, inward, visits)) - law.blind_margin_error * off
    blind = blind / law_width(law.blind_width, law.stack_width, visits)
    known = reached - math.log(law.known_margin) - law.known_margin_error * off
    known = known / law_width(law.known_width, law.known_stack_width, visits)
    return np.asarray(special().ndtr(np.where(np.asarray(at_place, bool), np.fmax(known, blind), blind)))


def law_width(single: float, stack: float, visits: ArrayLike) -> FloatArray:
    """Return the width of a law.

    Parameters
    ----------
    single, stack : float
        In one visit, and of many.
    visits : array_like
        As of `half_margin`.
    """
    alone = 1.0 / np.asarray(visits, float)
    return np.sqrt(np.maximum(alone * single**2 + (1.0 - alone) * stack**2, _LEAST_WIDTH2))


def tail_share(
    model: EtcModel, band: str, separation_arcsec: ArrayLike, visit_s: ArrayLike, noise: StackNoise
) -> FloatArray:
    """Return the share of the noise, as rms, that is light of the wavefront's errors: its tails are exponential.

    Parameters
    ----------
    model : EtcModel
    band : str
    separation_arcsec, visit_s : array_like
        Of the planets, and length of the science visits.
    noise : StackNoise
        Of the visits at the planets' places.
    """
    metrics, drift, strategy = model.metrics[band], model.instrument.drift, model.strategy
    width, ratio = strategy.annulus_lambda_d, strategy.reference_ratio
    share = error_light_share(metrics, drift, separation_arcsec, width, ratio, visit_s, model.timing)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.sqrt(share * noise.speckle / noise.quiet)
