"""Cosmic rays out of a sequence of frames, pixel by pixel in time; and sums over frames with holes.

A pixel is compared with itself in the other frames of its sequence (science and reference each on their own). At high
gain and low flux its law has an exponential tail, so that no number of sigma fits all levels: the limit comes from the
exact law (`cpic_planner.validation.noise_law`) and holds at every gain and level.
"""

import math
from dataclasses import dataclass

import numpy as np

from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, IntArray, numeric_context, require
from cpic_planner.validation.apertures import check_mask, described
from cpic_planner.validation.frames import CalibratedFrames
from cpic_planner.validation.noise_law import PixelLaw

FALSE_ALARM = 1e-6
MOST_E = 1e100
# The wavefront walks within a visit: speckles change by up to this fraction and more where they are faint.
DRIFT = 0.1
_MOST_PASSES = 20


@dataclass(frozen=True, eq=False)
class Rejection:
    """The pixels that were taken out of a sequence.

    Attributes
    ----------
    rejected : ndarray of bool, shape (n_frames, y, x)
        Pixel-frames that are hit or lie next to one that is.
    n_hit : int
        Pixel-frames above the limit, the neighbours not counted.
    possible : bool
        Whether there was anything to compare with.
    reason : {"", "single_frame"}
        Why not.
    """

    rejected: BoolArray
    n_hit: int
    possible: bool
    reason: str

    @property
    def fraction(self) -> float:
        """Rejected share of all pixel-frames."""
        return float(np.mean(self.rejected))


@dataclass(frozen=True, eq=False)
class Combined:
    """Sum of a sequence over frames with holes.

    Attributes
    ----------
    image_e : ndarray, shape (y, x)
        Mean of the usable frames times the number of all frames; NaN where ``covered`` is false.
    n_usable : ndarray of int, shape (y, x)
        Usable frames of each pixel.
    n_frames : int
        All frames.
    """

    image_e: FloatArray
    n_usable: IntArray
    n_frames: int

    @property
    def covered(self) -> BoolArray:
        """Pixels with a usable frame; the others are no part of any region."""
        return self.n_usable > 0

    @property
    def variance_factor(self) -> FloatArray:
        """Variance of a pixel over that of a sum without holes: ``n_frames / n_usable``; infinite where not covered."""
        with np.errstate(divide="ignore"):
            return self.n_frames / self.n_usable


@numeric_context()
def reject_cosmic_rays(
    frames: ArrayLike,
    usable: ArrayLike,
    *,
    em_gain: float,
    read_noise_e: float,
    pedestal_e: ArrayLike = 0.0,
    stages: int = 604,
    gain_e_adu: float = 0.0,
    false_alarm: float = FALSE_ALARM,
    drift: float = DRIFT,
    grow: bool = True,
) -> Rejection:
    """Find the pixel-frames that cosmic rays hit.

    Parameters
    ----------
    frames : array_like, shape (n_frames, y, x)
        Electrons at the register input of frames of one exposure and gain (`calibrated_frames`).
    usable : array_like of bool, same shape
        Pixel-frames to use; the others are neither tested nor compared with.
    em_gain : float
        Gain of the register, 1 to 1e4.
    read_noise_e : float
        Read noise at the output of the register, at least 0.
    pedestal_e : array_like, optional
        Mean electrons per frame that calibration has taken off (``CalibratedFrames.pedestal_e``), (y, x) or a number.
    stages : int, optional
        Stages of the register; 0 without one.
    gain_e_adu : float, optional
        Electrons per ADU at the output: rounding of the converter.
    false_alarm : float, optional
        Largest chance of taking a pixel-frame without a hit for one, above 0 and below 0.1.
    drift : float, optional
        Fraction by which the light of a pixel may rise in a frame over its mean, 0 to 10.
    grow : bool, optional
        Whether the eight neighbours of a hit pixel in the same frame go with it.

    Returns
    -------
    Rejection
        With a single frame nothing is rejected, ``possible`` is false and ``reason`` says so.

    Raises
    ------
    InputError
        For arrays of wrong or different shapes, numbers that are not finite or beyond 1e100 either way, or an argument
        out of range.

    Notes
    -----
    The limit on one frame follows from the sum of all of them without knowing the mean of the pixel
    (`PixelLaw.limit_beside_others`). Where a pixel is hit twice or more, the sum is too large at first and falls as
    hits go out: it is repeated until nothing more is found. Charge diffuses by 0.35 pixels (Gaussian) and transfers
    leave 1.6 % of it in the next row and column each, so that the neighbours hold what the limit lets through. They go
    whatever they hold: that takes light out of no mean.

    On clean frames of 0.01 to 1e4 e- at gains 1 to 1000 the chance of a false hit is 0.2 ``false_alarm`` at most; the
    mean loses less than 1e-3 of itself or, where read noise rules, 1e-6 of that.

    Particles that cross a layer of 14 um (the ``physical`` model) are found in every aperture from gain 20 on. At gain
    1 a third of them hides in the read noise and adds 1 to 2 % to that of the stack.
    """
    data, good = _checked(frames, usable)
    for key, value, low, high in (
        ("em_gain", em_gain, 1.0, 1e4),
        ("read_noise_e", read_noise_e, 0.0, 1e6),
        ("gain_e_adu", gain_e_adu, 0.0, 1e6),
        ("drift", drift, 0.0, 10.0),
    ):
        require(key, value, math.isfinite(value) and low <= value <= high, "", f"{low:g} to {high:g}")
    require("false_alarm", false_alarm, 0.0 < false_alarm < 0.1, "", "above 0 and below 0.1")
    n_frames, hit = len(data), np.zeros(data.shape, dtype=np.bool_)
    if n_frames < 2:
        return Rejection(hit, 0, False, "single_frame")
    pedestal = np.broadcast_to(np.asarray(pedestal_e, dtype=np.float64), data.shape[1:])
    sigma = math.sqrt(read_noise_e**2 + gain_e_adu**2 / 12.0) / em_gain
    # Unusable pixel-frames count as empty and are not tested.
    tested = data.reshape(n_frames, -1)
    counted = good.reshape(n_frames, -1)
    flat = hit.reshape(n_frames, -1)
    total = np.einsum("nyx,nyx->yx", data, good).reshape(-1)
    count = np.count_nonzero(good, axis=0).reshape(-1)
    offset = pedestal.reshape(-1)
    law = PixelLaw(em_gain, stages, sigma, false_alarm)
    active = np.flatnonzero(count >= 2)
    for _ in range(_MOST_PASSES):
        limit = np.empty(active.size)
        for number in np.unique(count[active]):
            same = count[active] == number
            where = active[same]
            limit[same] = law.limit_beside_others(total[where] + number * offset[where], int(number), drift)
        columns = slice(None) if active.size == total.size else active  # a choice of columns is a copy
        above = (tested[:, columns] > limit - offset[active]) & counted[:, columns] & ~flat[:, columns]
        changed = above.any(axis=0)
        if not changed.any():
            break
        frame, place = np.nonzero(above[:, changed])
        place = active[changed][place]
        flat[frame, place] = True
        np.subtract.at(total, place, tested[frame, place])
        np.subtract.at(count, place, 1)
        active = active[changed]
        active = active[count[active] >= 2]
    n_hit = int(np.count_nonzero(hit))
    return Rejection(grown(hit) if grow and n_hit else hit, n_hit, True, "")


def rejected_in(frames: CalibratedFrames) -> Rejection:
    """Find the hits of a calibrated sequence."""
    return reject_cosmic_rays(
        frames.electrons,
        frames.usable,
        em_gain=frames.em_gain,
        read_noise_e=frames.noise_e * frames.em_gain,
        pedestal_e=frames.pedestal_e,
        stages=frames.detector.register_stages,
    )


@numeric_context()
def combine(electrons: ArrayLike, usable: ArrayLike) -> Combined:
    """Return the sum of frames with holes: the mean of each pixel's usable frames times the number of frames.

    Parameters
    ----------
    electrons : array_like, shape (n_frames, y, x)
    usable : array_like of bool, same shape

    Raises
    ------
    InputError
        For arrays of wrong or different shapes, or numbers that are not finite or beyond 1e100 either way.
    """
    data, good = _checked(electrons, usable)
    mean, count = _means(data, good)
    return Combined(np.where(count > 0, mean * len(data), np.nan), count, len(data))


def filled(electrons: ArrayLike, usable: ArrayLike) -> tuple[FloatArray, BoolArray]:
    """Return the frames without holes, for reductions that need whole rows.

    Parameters
    ----------
    electrons : array_like, shape (n_frames, y, x)
    usable : array_like of bool, same shape

    Returns
    -------
    frames : ndarray, shape (n_frames, y, x)
        Unusable pixel-frames hold the mean of their pixel over the usable ones: linear in the light, and the sum over
        frames is that of `combine`. Pixels that are never usable hold 0.
    covered : ndarray of bool, shape (y, x)
        Pixels with a usable frame: the region of the reduction must lie inside.

    Raises
    ------
    InputError
        For arrays of wrong or different shapes, or numbers that are not finite or beyond 1e100 either way.
    """
    data, good = _checked(electrons, usable)
    mean, count = _means(data, good)
    return np.where(good, data, mean), count > 0


def _means(data: FloatArray, good: BoolArray) -> tuple[FloatArray, IntArray]:
    """Return the mean over usable frames, 0 without any, and their number."""
    count = np.count_nonzero(good, axis=0)
    total = np.einsum("nyx,nyx->yx", data, good)
    return total / np.maximum(count, 1), np.asarray(count, dtype=np.int64)


def grown(hit: BoolArray, pixels: int = 1) -> BoolArray:
    """Mark each hit with its neighbours in the same frame, up to so many pixels away either way."""
    wide = hit.copy()
    for _ in range(pixels):
        across = wide.copy()
        across[:, :, 1:] |= wide[:, :, :-1]
        across[:, :, :-1] |= wide[:, :, 1:]
        wide = across.copy()
        wide[:, 1:] |= across[:, :-1]
        wide[:, :-1] |= across[:, 1:]
    return wide


def _checked(frames: ArrayLike, usable: ArrayLike) -> tuple[FloatArray, BoolArray]:
    data = np.asarray(frames)
    if data.dtype.kind not in "iuf" or data.ndim != 3 or data.size == 0:
        raise InputError("frames", described(data), unit="e-", allowed="frames (n, y, x)")
    good = check_mask("usable", usable, data.shape, empty=True)
    data = data.astype(np.float64, copy=False)
    if not max(data.max(), -data.min()) <= MOST_E:  # nor is nan
        bad, allowed = ~np.isfinite(data), "finite numbers"
        if not bad.any():
            bad, allowed = np.abs(data) > MOST_E, f"{-MOST_E:g} to {MOST_E:g}, so that sums stay finite"
        n, y, x = np.argwhere(bad)[0]
        raise InputError(f"frames[{n}, y={y}, x={x}]", float(data[n, y, x]), unit="e-", allowed=allowed)
    return data, good
