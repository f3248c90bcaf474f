"""Saturation: the longest frame and the largest EM gain that keep the hole clean, and what binds.

Hard limits hold inside the hole, and wherever a bloom column or a register tail enters it; the rest of the frame may
saturate (its own cap is known as well, for those who want none of it to).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cpic_planner.etc.camera import FrameCamera
from simulator.outcome import Reason

__all__ = ["N_SIGMA", "frame_limit", "gain_caps", "largest_gain", "longest_exposure_s"]

FloatArray = NDArray[np.float64]
N_SIGMA = 5.0


def _largest_mean_e(level_e: float, factor: float) -> float:
    """Mean ``q`` at which ``q + N_SIGMA sqrt(factor q)`` reaches ``level_e``."""
    half = N_SIGMA * math.sqrt(factor) / 2.0
    return (math.sqrt(half * half + max(level_e, 0.0)) - half) ** 2 if math.isfinite(level_e) else math.inf


def _crest(mean_e: FloatArray) -> FloatArray:
    """Mean plus the margin of a multiplied Poisson law, whose variance is at most twice its mean."""
    return mean_e + N_SIGMA * np.sqrt(2.0 * mean_e)


def longest_exposure_s(
    peak_columns_e_s: ArrayLike,
    peak_hole_e_s: ArrayLike,
    tail_e_s: ArrayLike,
    camera: FrameCamera,
    em_gain: float = 1.0,
) -> FloatArray:
    """Exposure at which a hard limit is met at a gain.

    Parameters
    ----------
    peak_columns_e_s : array_like
        Hottest pixel of the central star in the columns that cross the hole, e-/s: it must not overflow its well,
        because blooming charge runs along the column into the hole.
    peak_hole_e_s : array_like
        Hottest pixel inside the hole, e-/s: it must fit the register and the converter as well.
    tail_e_s : array_like
        Light beside the hole that must fit the register, lest charge trails into the hole.
    camera : FrameCamera
    em_gain : float

    Returns
    -------
    ndarray
        Seconds, without regard to ``exposure_max_s``; ``inf`` for dark pixels.
    """
    hole, tail = np.asarray(peak_hole_e_s, float), np.asarray(tail_e_s, float)
    column = np.maximum(np.asarray(peak_columns_e_s, float), hole) if camera.blooms else hole
    well = _largest_mean_e(camera.full_well_e, 1.0)
    output = _largest_mean_e(camera.output_well_e / em_gain, 2.0)
    register = _largest_mean_e(camera.register_full_well_e / em_gain, 2.0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        trail = tail if camera.blooms else np.zeros_like(tail)
        limits = [
            np.where(rate > 0, level / rate, np.inf)
            for level, rate in ((well, column), (output, hole), (register, trail))
        ]
    return np.minimum(np.minimum(limits[0], limits[1]), limits[2])


def largest_gain(
    peak_hole_e_s: ArrayLike, tail_e_s: ArrayLike, exposure_s: ArrayLike, camera: FrameCamera
) -> FloatArray:
    """Largest EM gain that keeps the hole clean: its own pixels unsaturated, and no register tail running into it.

    The pixel's own well is the business of `longest_exposure_s`. Below 1 not even gain 1 will do.
    """
    exposure = np.asarray(exposure_s, float)
    own = _crest(np.asarray(peak_hole_e_s, float) * exposure)
    beside = _crest(np.asarray(tail_e_s, float) * exposure) if camera.blooms else np.zeros_like(own)
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        cap = np.minimum(
            np.where(own > 0, camera.output_well_e / own, np.inf),
            np.where(beside > 0, camera.register_full_well_e / beside, np.inf),
        )
    return np.minimum(cap, camera.em_gain_max)


def gain_caps(
    peak_hole_e_s: float, tail_e_s: float, peak_frame_e_s: float, exposure_s: float, camera: FrameCamera
) -> dict[str, float]:
    """Largest gains of one exposure by what they spare; 0 where not even gain 1 does.

    Returns
    -------
    dict of str to float
        ``hole``: the pixels inside the hole fit register and converter. ``register_tail``: no charge trails into the
        hole. ``frame``: no pixel of the whole frame saturates.
    """
    wells = {
        "hole": (peak_hole_e_s, camera.output_well_e),
        "register_tail": (tail_e_s if camera.blooms else 0.0, camera.register_full_well_e),
        "frame": (peak_frame_e_s, camera.output_well_e),
    }
    caps = {}
    for name, (rate, well) in wells.items():
        crest = float(_crest(np.asarray(rate * exposure_s, float)))
        cap = camera.em_gain_max if crest <= 0 else min(well / crest, camera.em_gain_max)
        overfull = rate * exposure_s > _largest_mean_e(camera.full_well_e, 1.0)
        caps[name] = cap if cap >= 1.0 and not (overfull and name != "register_tail") else 0.0
    return caps


def frame_limit(
    peak_columns_e_s: float,
    peak_hole_e_s: float,
    tail_e_s: float,
    exposure_s: float,
    em_gain: float,
    camera: FrameCamera,
) -> Reason:
    """Which limit a frame breaks furthest, `Reason.NONE` if none."""
    column = max(peak_columns_e_s, peak_hole_e_s) if camera.blooms else peak_hole_e_s
    output = em_gain * float(_crest(np.asarray(peak_hole_e_s * exposure_s, float)))
    tail = em_gain * float(_crest(np.asarray(tail_e_s * exposure_s, float))) if camera.blooms else 0.0
    well = column * exposure_s + N_SIGMA * math.sqrt(column * exposure_s)
    fills = {
        Reason.PIXEL_FULL_WELL: well / camera.full_well_e,
        Reason.REGISTER_FULL_WELL: max(output, tail) / camera.register_full_well_e,
        Reason.ADC_RANGE: output / camera.converter_e if camera.converter_e > 0 else math.inf,
    }
    worst = max(fills, key=lambda reason: fills[reason])
    return worst if fills[worst] > 1.0 + 1e-12 else Reason.NONE
