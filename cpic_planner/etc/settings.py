"""Choice of frame exposure, number of frames and EM gain.

For each target the longest frame that saturates nothing is found first; shorter frames are tried as well, and
the setting of highest significance in the given time (or of least time for the given SNR) wins.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cpic_planner.etc.limits import largest_gain, longest_exposure_s
from cpic_planner.etc.model import EtcModel
from cpic_planner.etc.noise import StackNoise, best_gain, frame_terms, stack_noise
from cpic_planner.etc.rates import ApertureRates

__all__ = ["FRAME_MULTIPLES", "VISIT_LENGTHS_S", "Settings", "settings_for_snr", "settings_for_time", "visit_lengths"]

FloatArray = NDArray[np.float64]
BISECTIONS = 28
VISIT_LENGTHS_S = tuple(600.0 * 2.0**k for k in range(12))
"""Wall times tried besides the longest allowed; fixed, so that more time never takes a choice away."""
FRAME_MULTIPLES = (1.0, 1.15, 1.5, 2.5, 6.0)


@dataclass(frozen=True)
class Settings:
    """Chosen settings; arrays of one shape. ``n_frames`` is 0 where nothing fits.

    ``time_s`` is wall time: science and reference frames with their readouts, plus overhead.
    """

    exposure_s: FloatArray
    n_frames: FloatArray
    em_gain: FloatArray
    time_s: FloatArray
    noise: StackNoise
    longest_exposure_s: FloatArray


def _gain(model: EtcModel, rates: ApertureRates, exposure_s: FloatArray) -> FloatArray:
    detector = model.instrument.detector
    _, light, read = frame_terms(rates, exposure_s, detector, reference_ratio=model.strategy.reference_ratio)
    return best_gain(light, read, largest_gain(rates.peak_hole_e_s, rates.tail_e_s, exposure_s, detector))


def visit_lengths(time_s: float) -> list[float]:
    """Wall times to choose from when at most ``time_s`` may be used: the wavefront walks, so longer can be worse."""
    return [time_s, *(length for length in VISIT_LENGTHS_S if length < time_s)]


def settings_for_time(
    model: EtcModel,
    rates: ApertureRates,
    time_s: float,
    *,
    exposure_s: float | None = None,
    em_gain: float | None = None,
) -> Settings:
    """Settings of highest significance that fit into ``time_s`` of wall time.

    Parameters
    ----------
    model : EtcModel
    rates : ApertureRates
        Arrays of any shape.
    time_s : float
        Wall time, overheads and reference frames included.
    exposure_s, em_gain : float, optional
        Fixed by the user; chosen otherwise.

    Returns
    -------
    Settings
    """
    detector, ratio = model.instrument.detector, model.strategy.reference_ratio
    limit = longest_exposure_s(rates.peak_columns_e_s, rates.peak_hole_e_s, detector)
    usable = max(time_s - model.instrument.overhead_s, 0.0) / (1.0 + ratio)
    if exposure_s is not None:
        exposure = np.full(limit.shape, float(exposure_s))[None]
        frames = np.floor(usable / (exposure + detector.readout_s) + 1e-9)
    else:
        longest = np.clip(limit, detector.exposure_min_s, detector.exposure_max_s)
        fewest = np.maximum(np.ceil(usable / (longest + detector.readout_s) - 1e-9), 1.0)
        multiples = np.asarray(FRAME_MULTIPLES).reshape((-1,) + (1,) * limit.ndim)
        frames = np.ceil(fewest[None] * multiples)
        exposure = usable / frames - detector.readout_s
        frames = np.where(exposure >= detector.exposure_min_s, frames, 0.0)
        exposure = np.maximum(exposure, detector.exposure_min_s)
    return _choose(model, rates, limit, exposure, frames, em_gain, best=lambda s: -s.noise.significance)


def settings_for_snr(
    model: EtcModel,
    rates: ApertureRates,
    snr: float,
    *,
    exposure_s: float | None = None,
    em_gain: float | None = None,
    refine: bool = True,
) -> Settings:
    """Settings of least wall time that reach ``snr``; ``n_frames`` is 0 where no time suffices.

    ``N = SNR^2 V1 / (S1^2 - SNR^2 spk1^2)`` frames, rounded up; the denominator vanishes at the speckle floor. The
    exposure is then shortened to what this whole number of frames needs, unless ``refine`` is false.
    """
    detector, ratio = model.instrument.detector, model.strategy.reference_ratio
    limit = longest_exposure_s(rates.peak_columns_e_s, rates.peak_hole_e_s, detector)
    if exposure_s is not None:
        exposure = np.full(limit.shape, float(exposure_s))[None]
    else:
        longest = np.clip(limit, detector.exposure_min_s, detector.exposure_max_s)
        steps = np.asarray(FRAME_MULTIPLES).reshape((-1,) + (1,) * limit.ndim)
        exposure = np.maximum(longest[None] / steps, detector.exposure_min_s)
    gain = _gain(model, rates, exposure) if em_gain is None else np.full(exposure.shape, float(em_gain))
    one = stack_noise(rates, exposure, 1.0, gain, detector, reference_ratio=ratio)
    level = 1.0 + 1.0 / rates.background_apertures
    white = one.source_variance_e2 + level * (one.background_variance_e2 + one.detector_variance_e2)
    room = one.signal_e**2 - snr**2 * level * one.speckle_variance_e2
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        needed = np.where(room > 0, snr**2 * white / room, np.inf)
    frames = np.where(needed < 1e9, np.maximum(np.ceil(needed - 1e-9), 1.0), 0.0)
    if exposure_s is None and refine:
        exposure = _shortest(model, rates, snr, exposure, frames, em_gain)
    return _choose(model, rates, limit, exposure, frames, em_gain, best=lambda s: s.time_s)


def _shortest(
    model: EtcModel,
    rates: ApertureRates,
    snr: float,
    exposure_s: FloatArray,
    n_frames: FloatArray,
    em_gain: float | None,
) -> FloatArray:
    """Shortest exposure at which ``n_frames`` frames still reach ``snr``, by bisection of its logarithm."""
    detector, ratio = model.instrument.detector, model.strategy.reference_ratio
    low, high = np.full(exposure_s.shape, detector.exposure_min_s), exposure_s
    frames = np.maximum(n_frames, 1.0)
    for _ in range(BISECTIONS):
        middle = np.sqrt(low * high)
        gain = _gain(model, rates, middle) if em_gain is None else np.full(middle.shape, float(em_gain))
        enough = stack_noise(rates, middle, frames, gain, detector, reference_ratio=ratio).snr >= snr
        low, high = np.where(enough, low, middle), np.where(enough, middle, high)
    return high


def _choose(
    model: EtcModel,
    rates: ApertureRates,
    limit: FloatArray,
    exposure: FloatArray,
    frames: FloatArray,
    em_gain: float | None,
    *,
    best: Callable[[Settings], FloatArray],
) -> Settings:
    """Pick along the first axis the candidate of least ``best(settings)`` among the feasible ones."""
    detector, ratio = model.instrument.detector, model.strategy.reference_ratio
    gain = _gain(model, rates, exposure) if em_gain is None else np.full(exposure.shape, float(em_gain))
    shape = np.broadcast_shapes(exposure.shape, frames.shape, gain.shape)
    exposure, frames, gain = (np.broadcast_to(item, shape) for item in (exposure, frames, gain))
    noise = stack_noise(rates, exposure, frames, gain, detector, reference_ratio=ratio)
    time = np.where(
        frames > 0,
        model.instrument.overhead_s + (1.0 + ratio) * frames * (exposure + detector.readout_s),
        0.0,
    )
    every = Settings(exposure, frames, gain, time, noise, np.broadcast_to(limit, shape))
    feasible = (
        (frames > 0)
        & (exposure <= limit * (1.0 + 1e-12))
        & (gain <= largest_gain(rates.peak_hole_e_s, rates.tail_e_s, exposure, detector))
    )
    pick = np.argmin(np.where(feasible, best(every), np.inf), axis=0)[None]

    def take(array: ArrayLike) -> FloatArray:
        full = np.broadcast_to(np.asarray(array), shape)
        return np.take_along_axis(full, pick, axis=0)[0]

    any_feasible = take(feasible)
    zero = np.where(any_feasible, 1.0, 0.0)
    chosen = {name: take(getattr(noise, name)) * (zero if name in ("snr", "significance") else 1.0)
              for name in StackNoise.__dataclass_fields__}  # fmt: skip
    return Settings(
        take(exposure), take(frames) * zero, take(gain), take(time) * zero, StackNoise(**chosen), take(limit)
    )
