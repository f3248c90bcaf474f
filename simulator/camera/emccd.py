"""The EMCCD chain from photon rate to ADU: noiseless (`expected_adu_map`) and noisy (`expose_frame`) apart.

Order of the stages: photo-electrons and dark current, pixel full well, clock-induced charge, register,
register full well, read noise, converter. Charge above a full well is cut off and counted; it does not spill.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catalogs.errors import InputError
from simulator.camera.checks import checked_array, element_name
from simulator.camera.gain import multiply
from simulator.camera.sampling import poisson_counts, scattered_events
from simulator.config.detector import Detector
from simulator.rng import PathPart, stream

__all__ = ["Frame", "expected_adu_map", "expose_frame", "to_electrons"]

FloatArray = npt.NDArray[np.float64]

NEGATIVE_TOLERANCE = 1e-9
# Keeps sums over a detector inside 64-bit integers; any full well is far below.
MAX_MEAN_E = 1e12
MAX_EXPOSURE_S = 1e6


@dataclass(frozen=True, eq=False)
class Frame:
    """One raw frame and its bookkeeping.

    Attributes
    ----------
    adu : ndarray of uint16
        Image in ADU, shape of the rate map.
    lost : ndarray of bool
        Pixels that a limit cut off: pixel full well, register full well or converter.
    n_clipped : int
        Pixels cut off at either end of the converter's range.
    n_saturated_pixels : int
        Pixels that lost charge above the pixel full well.
    n_register_saturated : int
        Pixels that lost charge above the register full well.
    n_negative_rates : int
        Pixels whose rate was a rounding-error negative and was taken as 0.
    """

    adu: npt.NDArray[np.uint16]
    lost: npt.NDArray[np.bool_]
    n_clipped: int
    n_saturated_pixels: int
    n_register_saturated: int
    n_negative_rates: int = 0


def expected_adu_map(rate_e_s_map: npt.ArrayLike, exposure_s: float, em_gain: float, detector: Detector) -> FloatArray:
    """Mean ADU of every pixel, without noise and without rounding.

    Parameters
    ----------
    rate_e_s_map : array_like
        Photo-electrons per second and pixel, 2-D (y, x) window of any shape.
    exposure_s : float
        Exposure of the frame, 0 to 1e6 s (0 is a bias frame).
    em_gain : float
        Actual gain of the register, 1 to ``detector.em_gain_max``.
    detector : Detector
        The camera.

    Returns
    -------
    ndarray
        ``(rate t + dark t + cic) g / K + bias``, each stage cut off at its limit. Within a few sigma of a
        limit the mean of noisy frames is lower, since only their upper tail is cut.

    Raises
    ------
    InputError
        For a rate that is NaN, infinite or negative (naming the pixel), or another argument out of range.
    """
    rates, _ = _checked_rates(rate_e_s_map)
    _check_exposure(exposure_s)
    _check_em_gain(em_gain, detector)
    charge = _collected_mean(rates, exposure_s, detector)
    charge = (np.minimum(charge, detector.full_well_e) + detector.cic_e) * em_gain
    adu = np.minimum(charge, detector.register_full_well_e) / detector.gain_e_adu + detector.bias_adu
    return np.minimum(adu, float(detector.adc_max_adu))


def expose_frame(
    rate_map_e_s: npt.ArrayLike,
    exposure_s: float,
    em_gain: float,
    detector: Detector,
    *,
    seed: int,
    path: Sequence[PathPart],
) -> Frame:
    """One noisy frame.

    Parameters
    ----------
    rate_map_e_s : array_like
        Photo-electrons per second and pixel, 2-D (y, x) window of any shape.
    exposure_s, em_gain, detector
        As `expected_adu_map`.
    seed : int
        Seed of the run.
    path : sequence of str or int
        Names of target, role, band, realisation, frame. Each stage draws from ``stream(seed, *path, stage)``
        (``photons``, ``cic``, ``register``, ``read``), so that a stage that is switched off (by a zero in the
        configuration) leaves the numbers of the others unchanged.

    Returns
    -------
    Frame

    Raises
    ------
    InputError
        For a rate that is NaN, infinite or more negative than 1e-9 of the largest (naming the pixel), or
        another argument out of range.
    """
    if isinstance(path, str):
        raise InputError("path", path, allowed="a sequence of names, not one string")
    rates, n_negative = _checked_rates(rate_map_e_s)
    _check_exposure(exposure_s)
    _check_em_gain(em_gain, detector)
    charge = poisson_counts(_collected_mean(rates, exposure_s, detector), stream(seed, *path, "photons"))
    over_well = _cut(charge, detector.full_well_e)
    if detector.cic_e > 0:
        charge += scattered_events(detector.cic_e, charge.shape, stream(seed, *path, "cic"))
    charge = multiply(charge, em_gain, rng=stream(seed, *path, "register"), stages=detector.register_stages)
    over_register = _cut(charge, detector.register_full_well_e)
    adu = charge / detector.gain_e_adu
    if detector.read_noise_e > 0:
        noise = stream(seed, *path, "read").standard_normal(charge.shape)
        noise *= detector.read_noise_e / detector.gain_e_adu
        adu += noise
    adu += detector.bias_adu
    np.rint(adu, out=adu)
    clipped = (adu < 0) | (adu > detector.adc_max_adu)
    np.clip(adu, 0, detector.adc_max_adu, out=adu)
    return Frame(
        adu=adu.astype(np.uint16),
        lost=over_well | over_register | clipped,
        n_clipped=int(np.count_nonzero(clipped)),
        n_saturated_pixels=int(np.count_nonzero(over_well)),
        n_register_saturated=int(np.count_nonzero(over_register)),
        n_negative_rates=n_negative,
    )


def to_electrons(adu: npt.ArrayLike, detector: Detector, em_gain: float) -> FloatArray:
    """Electrons at the register input: ``(adu - bias) gain_e_adu / em_gain``; dark and clock charge included.

    Raises
    ------
    InputError
        If ``em_gain`` is out of range.
    """
    _check_em_gain(em_gain, detector)
    return (np.asarray(adu, dtype=np.float64) - detector.bias_adu) * (detector.gain_e_adu / em_gain)


def _collected_mean(rates: FloatArray, exposure_s: float, detector: Detector) -> FloatArray:
    with np.errstate(over="ignore"):
        return np.minimum((rates + detector.dark_e_s) * exposure_s, MAX_MEAN_E)


def _cut(charge: npt.NDArray[np.int64], full_well_e: float) -> npt.NDArray[np.bool_]:
    """Cut charge off at the full well, in place; return in which pixels."""
    limit = math.floor(full_well_e)
    over: npt.NDArray[np.bool_] = charge > limit
    if over.any():
        np.minimum(charge, limit, out=charge)
    return over


def _checked_rates(rate_map_e_s: npt.ArrayLike) -> tuple[FloatArray, int]:
    """Rates with rounding-error negatives set to 0, and their number."""
    allowed = f"finite and at least 0 (rounding errors to -{NEGATIVE_TOLERANCE:g} of the largest count as 0)"
    rates = np.asarray(rate_map_e_s)
    if rates.dtype.kind not in "iuf" or rates.ndim != 2 or rates.size == 0:
        raise InputError("rate_map_e_s", f"{rates.dtype} array of shape {rates.shape}", unit="e-/s",
                         allowed="a non-empty 2-D (y, x) array of numbers")  # fmt: skip
    rates = rates.astype(np.float64, copy=False)
    lowest, highest = float(rates.min()), float(rates.max())
    if lowest >= 0.0 and math.isfinite(highest):
        return rates, 0
    finite = np.isfinite(rates)
    bad = ~finite if not finite.all() else rates < -NEGATIVE_TOLERANCE * max(highest, 0.0)
    if bad.any():
        name, index = element_name("rate_map_e_s", bad)
        raise InputError(name, float(rates[index]), unit="e-/s", allowed=allowed)
    return np.maximum(rates, 0.0), int(np.count_nonzero(rates < 0.0))


def _check_exposure(exposure_s: float) -> None:
    if checked_array("exposure_s", exposure_s, low=0.0, high=MAX_EXPOSURE_S, unit="s").ndim:
        raise InputError("exposure_s", exposure_s, unit="s", allowed="one number")


def _check_em_gain(em_gain: float, detector: Detector) -> None:
    if checked_array("em_gain", em_gain, low=1.0, high=detector.em_gain_max).ndim:
        raise InputError("em_gain", em_gain, allowed="one number")
