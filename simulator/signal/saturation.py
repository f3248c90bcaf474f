"""Saturation: the longest frame and the largest EM gain that keep the hole clean, and what a limit cuts off.

Hard limits hold inside the hole, and wherever a bloom column or a register tail enters it; the rest of the frame may
saturate (its own cap is known as well, for those who want none of it to).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from simulator.outcome import Reason

FloatArray = NDArray[np.float64]
N_SIGMA = 5.0
# A limit that is reached for certain costs the whole standard deviation of the pixel.
_ALL = 1.0


@dataclass(frozen=True, kw_only=True)
class Wells:
    """What a camera holds; electrons at the register input unless said.

    Attributes
    ----------
    full_well_e : float
        Charge that a pixel holds.
    register_full_well_e, converter_e : float
        Charge at the register output that the register and the converter hold (the converter after five sigma of read
        noise); infinite where there is none.
    em_gain_max : float
        Largest EM gain, 1 without a register.
    blooms : bool
        Whether overfull pixels spill along columns and rows into the hole.
    """

    full_well_e: float
    register_full_well_e: float
    converter_e: float
    em_gain_max: float
    blooms: bool = True

    @property
    def output_well_e(self) -> float:
        """Charge at the output that register and converter hold."""
        return min(self.register_full_well_e, self.converter_e)


def crest_e(mean_e: ArrayLike, factor2: float, n_sigma: float = N_SIGMA) -> FloatArray:
    """Return the mean of counts plus a margin of so many of their standard deviations, ``q + n sqrt(F^2 q)``.

    Parameters
    ----------
    mean_e : array_like
        Electrons at the register input, at least 0.
    factor2 : float
        Variance over mean: 1 in a pixel, 2 at most behind the register.
    n_sigma : float
        Margin.
    """
    mean = np.asarray(mean_e, float)
    return np.asarray(mean + n_sigma * np.sqrt(factor2 * mean))


def largest_mean_e(level_e: float, factor2: float) -> float:
    """Return the mean whose `crest_e` is ``level_e``: 0 for a level below 0, infinite for an infinite one.

    Parameters
    ----------
    level_e : float
        Electrons that must not be passed.
    factor2 : float
        Variance over mean, as of `crest_e`.
    """
    half = N_SIGMA * math.sqrt(factor2) / 2.0
    return (math.sqrt(half * half + max(level_e, 0.0)) - half) ** 2 if math.isfinite(level_e) else math.inf


def overflow(mean_e: FloatArray | float, well_e: float, factor2: float) -> FloatArray:
    """Return what a limit cuts off, in standard deviations of the pixel or of its darkest neighbour.

    Parameters
    ----------
    mean_e : array_like
        Mean electrons of the pixel; below 0 counts as 0.
    well_e : float
        The limit, at the register input.
    factor2 : float
        Variance over mean of the counts, 1 to 2.

    Notes
    -----
    Counts of excess noise F^2 exceed a level q with the chance of a Gaussian beyond ``z = 2 (sqrt q - sqrt m) / F``
    (Poisson, and Poisson electrons multiplied by an exponential law, both to leading order in the exponent). Mean and
    second moment beyond it are ``phi - z Q`` and ``(1 + z^2) Q - z phi``; beyond the limit itself it is the excess.
    """
    mean = np.maximum(np.asarray(mean_e, dtype=np.float64), 0.0)
    z = 2.0 * (math.sqrt(well_e) - np.sqrt(mean)) / math.sqrt(factor2)
    density = np.exp(-0.5 * np.clip(z, -38.0, 38.0) ** 2) / math.sqrt(2.0 * math.pi)
    # The chance beyond z is below phi / z.
    chance = np.where(z > 0.5, density / np.maximum(z, 0.5), 1.0)
    # The overflow goes to neighbours, whose own noise can be as small as that of an empty pixel.
    contrast = np.sqrt(np.maximum(mean, 1.0))
    return np.where(z > 12.0, 0.0, np.where(z > 0.5, (density + chance) * contrast, _ALL + contrast))


def longest_exposure_s(
    peak_columns_e_s: ArrayLike,
    peak_hole_e_s: ArrayLike,
    tail_e_s: ArrayLike,
    camera: Wells,
    em_gain: float = 1.0,
) -> FloatArray:
    """Return the exposure at which a hard limit is met at a gain.

    Parameters
    ----------
    peak_columns_e_s : array_like
        Hottest pixel of the central star in the columns that cross the hole, e-/s: it must not overflow its well,
        because blooming charge runs along the column into the hole.
    peak_hole_e_s : array_like
        Hottest pixel inside the hole, e-/s: it must fit the register and the converter as well.
    tail_e_s : array_like
        Light beside the hole that must fit the register, lest charge trails into the hole.
    camera : Wells
    em_gain : float

    Returns
    -------
    ndarray
        Seconds, without regard to ``exposure_max_s``; ``inf`` for dark pixels.
    """
    hole, tail = np.asarray(peak_hole_e_s, float), np.asarray(tail_e_s, float)
    column = np.maximum(np.asarray(peak_columns_e_s, float), hole) if camera.blooms else hole
    well = largest_mean_e(camera.full_well_e, 1.0)
    output = largest_mean_e(camera.output_well_e / em_gain, 2.0)
    register = largest_mean_e(camera.register_full_well_e / em_gain, 2.0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        trail = tail if camera.blooms else np.zeros_like(tail)
        limits = [
            np.where(rate > 0, level / rate, np.inf)
            for level, rate in ((well, column), (output, hole), (register, trail))
        ]
    return np.minimum(np.minimum(limits[0], limits[1]), limits[2])


def largest_gain(peak_hole_e_s: ArrayLike, tail_e_s: ArrayLike, exposure_s: ArrayLike, camera: Wells) -> FloatArray:
    """Return the largest EM gain that keeps the hole clean: its pixels unsaturated, no register tail running into it.

    Parameters
    ----------
    peak_hole_e_s, tail_e_s, camera
        As of `longest_exposure_s`; the pixel's own well is its business.
    exposure_s : array_like
        Of a frame.

    Returns
    -------
    ndarray
        At most the camera's largest gain. Below 1 not even gain 1 will do.
    """
    exposure = np.asarray(exposure_s, float)
    own = crest_e(np.asarray(peak_hole_e_s, float) * exposure, 2.0)
    beside = crest_e(np.asarray(tail_e_s, float) * exposure, 2.0) if camera.blooms else np.zeros_like(own)
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        cap = np.minimum(
            np.where(own > 0, camera.output_well_e / own, np.inf),
            np.where(beside > 0, camera.register_full_well_e / beside, np.inf),
        )
    return np.minimum(cap, camera.em_gain_max)


def gain_caps(
    peak_hole_e_s: float, tail_e_s: float, peak_frame_e_s: float, exposure_s: float, camera: Wells
) -> dict[str, float]:
    """Return the largest gains of one exposure by what they spare; 0 where not even gain 1 does.

    Parameters
    ----------
    peak_hole_e_s, tail_e_s, camera
        As of `longest_exposure_s`.
    peak_frame_e_s : float
        Hottest pixel of the central star anywhere, e-/s.
    exposure_s : float
        Of the frame.

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
        crest = float(crest_e(rate * exposure_s, 2.0))
        cap = camera.em_gain_max if crest <= 0 else min(well / crest, camera.em_gain_max)
        overfull = rate * exposure_s > largest_mean_e(camera.full_well_e, 1.0)
        caps[name] = cap if cap >= 1.0 and not (overfull and name != "register_tail") else 0.0
    return caps


def frame_limit(
    peak_columns_e_s: float,
    peak_hole_e_s: float,
    tail_e_s: float,
    exposure_s: float,
    em_gain: float,
    camera: Wells,
) -> Reason:
    """Return the limit that a frame breaks furthest, `Reason.NONE` if none.

    Parameters
    ----------
    peak_columns_e_s, peak_hole_e_s, tail_e_s, em_gain, camera
        As of `longest_exposure_s`.
    exposure_s : float
        Of the frame.
    """
    column = max(peak_columns_e_s, peak_hole_e_s) if camera.blooms else peak_hole_e_s
    output = em_gain * float(crest_e(peak_hole_e_s * exposure_s, 2.0))
    tail = em_gain * float(crest_e(tail_e_s * exposure_s, 2.0)) if camera.blooms else 0.0
    well = float(crest_e(column * exposure_s, 1.0))
    fills = {
        Reason.PIXEL_FULL_WELL: well / camera.full_well_e,
        Reason.REGISTER_FULL_WELL: max(output, tail) / camera.register_full_well_e,
        Reason.ADC_RANGE: output / camera.converter_e if camera.converter_e > 0 else math.inf,
    }
    worst = max(fills, key=lambda reason: fills[reason])
    return worst if fills[worst] > 1.0 + 1e-12 else Reason.NONE
