"""Longest frame that saturates nothing."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulator.camera.saturation import binding_limit
from simulator.config.instrument import Detector
from simulator.outcome import Reason

__all__ = ["frame_limit", "longest_exposure_s"]

N_SIGMA = 5.0


def _largest_mean_e(level_e: float, factor: float) -> float:
    """Mean ``q`` at which ``q + N_SIGMA sqrt(factor q)`` reaches ``level_e``."""
    half = N_SIGMA * math.sqrt(factor) / 2.0
    return (math.sqrt(half * half + max(level_e, 0.0)) - half) ** 2


def longest_exposure_s(
    peak_frame_e_s: ArrayLike, peak_hole_e_s: ArrayLike, detector: Detector
) -> NDArray[np.float64]:
    """Exposure at which a hard limit is met even at EM gain 1.

    Parameters
    ----------
    peak_frame_e_s : array_like
        Hottest pixel of the central star anywhere on the frame, e-/s: it must not overflow its well, because
        blooming charge would run through the hole.
    peak_hole_e_s : array_like
        Hottest pixel inside the hole, e-/s: it must fit the register and the converter as well.
    detector : Detector

    Returns
    -------
    ndarray
        Seconds, without regard to ``exposure_max_s``; ``inf`` for dark pixels.
    """
    well = _largest_mean_e(detector.full_well_e, 1.0)
    converter = (
        detector.adc_max_adu - detector.bias_adu
    ) * detector.gain_e_adu - N_SIGMA * detector.read_noise_e
    output = _largest_mean_e(min(detector.register_full_well_e, converter), 2.0)
    hole = np.asarray(peak_hole_e_s, float)
    frame = np.maximum(np.asarray(peak_frame_e_s, float), hole)
    with np.errstate(divide="ignore"):
        return np.minimum(well / frame, output / hole)


def frame_limit(
    peak_frame_e_s: float, peak_hole_e_s: float, exposure_s: float, em_gain: float, detector: Detector
) -> Reason:
    """Which limit a frame breaks, `Reason.NONE` if none."""
    hole = str(binding_limit(peak_hole_e_s * exposure_s, em_gain, detector, N_SIGMA))
    if hole:
        return Reason(hole)
    over = max(peak_frame_e_s, peak_hole_e_s) * exposure_s > _largest_mean_e(detector.full_well_e, 1.0)
    return Reason.PIXEL_FULL_WELL if over else Reason.NONE
