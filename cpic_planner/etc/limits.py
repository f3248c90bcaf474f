"""Longest frame that saturates nothing."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulator.camera.saturation import binding_limit, gain_cap
from simulator.config.detector import Detector
from simulator.outcome import Reason

__all__ = ["frame_limit", "largest_gain", "longest_exposure_s"]

N_SIGMA = 5.0


def _largest_mean_e(level_e: float, factor: float) -> float:
    """Mean ``q`` at which ``q + N_SIGMA sqrt(factor q)`` reaches ``level_e``."""
    half = N_SIGMA * math.sqrt(factor) / 2.0
    return (math.sqrt(half * half + max(level_e, 0.0)) - half) ** 2


def longest_exposure_s(
    peak_columns_e_s: ArrayLike, peak_hole_e_s: ArrayLike, detector: Detector
) -> NDArray[np.float64]:
    """Exposure at which a hard limit is met even at EM gain 1.

    Parameters
    ----------
    peak_columns_e_s : array_like
        Hottest pixel of the central star in the columns that cross the hole, e-/s: it must not overflow its well,
        because blooming charge runs along the column into the hole.
    peak_hole_e_s : array_like
        Hottest pixel inside the hole, e-/s: it must fit the register and the converter as well.
    detector : Detector

    Returns
    -------
    ndarray
        Seconds, without regard to ``exposure_max_s``; ``inf`` for dark pixels.
    """
    well = _largest_mean_e(detector.full_well_e, 1.0)
    converter = (detector.adc_max_adu - detector.bias_adu) * detector.gain_e_adu - N_SIGMA * detector.read_noise_e
    output = _largest_mean_e(min(detector.register_full_well_e, converter), 2.0)
    hole = np.asarray(peak_hole_e_s, float)
    column = np.maximum(np.asarray(peak_columns_e_s, float), hole)
    with np.errstate(divide="ignore"):
        return np.minimum(well / column, output / hole)


def largest_gain(
    peak_hole_e_s: ArrayLike, tail_e_s: ArrayLike, exposure_s: ArrayLike, detector: Detector
) -> NDArray[np.float64]:
    """Largest EM gain that keeps the hole clean: its own pixels unsaturated, and no register tail running into it.

    Returns
    -------
    ndarray
        1 to ``em_gain_max``; 0 where not even gain 1 will do.
    """
    exposure = np.asarray(exposure_s, float)
    own = gain_cap(np.asarray(peak_hole_e_s, float) * exposure, detector, N_SIGMA).gain
    tail = np.asarray(tail_e_s, float) * exposure
    with np.errstate(divide="ignore"):
        beside = detector.register_full_well_e / (tail + N_SIGMA * np.sqrt(2.0 * tail))
    gain = np.minimum(own, beside)
    return np.where(gain >= 1.0, gain, 0.0)


def frame_limit(
    peak_columns_e_s: float,
    peak_hole_e_s: float,
    tail_e_s: float,
    exposure_s: float,
    em_gain: float,
    detector: Detector,
) -> Reason:
    """Which limit a frame breaks, `Reason.NONE` if none."""
    hole = str(binding_limit(peak_hole_e_s * exposure_s, em_gain, detector, N_SIGMA))
    if hole:
        return Reason(hole)
    if max(peak_columns_e_s, peak_hole_e_s) * exposure_s > _largest_mean_e(detector.full_well_e, 1.0):
        return Reason.PIXEL_FULL_WELL
    tail = tail_e_s * exposure_s
    over = em_gain * (tail + N_SIGMA * math.sqrt(2.0 * tail)) > detector.register_full_well_e
    return Reason.REGISTER_FULL_WELL if over else Reason.NONE
