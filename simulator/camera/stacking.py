"""The sum of many frames as one draw, where nothing saturates.

Poisson counts, transfer losses and the multiplication register act on every electron for itself, so the sum of ``n``
frames has the law of one frame of ``n`` times the mean. Limits and curves do not add up: where they matter, frames are
drawn one by one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from catalogs.errors import InputError
from simulator.camera.camera import begun, scaled
from simulator.camera.gain import excess_noise_factor2
from simulator.camera.noise import FrameNoise
from simulator.camera.visible import VisibleCamera
from simulator.detectors.effect import Exposure
from simulator.outcome import Outcome, Reason, Status
from simulator.rng import PathPart

FloatArray = npt.NDArray[np.float64]
# Chance of a Gaussian beyond: 1e-15, once in 1e9 frames of a million pixels.
_MARGIN_SIGMA = 8.0
MAX_FRAMES = 1_000_000


def stackable(camera: VisibleCamera, exposure: Exposure) -> Outcome[float]:
    """Whether frames of an exposure add up to one draw.

    Parameters
    ----------
    camera : VisibleCamera
    exposure : Exposure

    Returns
    -------
    Outcome of float
        ``ok`` with the filled fraction of the nearest limit (eight sigma of noise included); else ``saturated`` with
        the limit that frames can reach, or ``invalid`` where an effect that is no sum is switched on.
    """
    detector, structure = exposure.detector, exposure.detector.bias_structure
    for effect in camera.charge:
        if effect.in_sums == "not_additive":
            return Outcome.refuse(
                Status.INVALID, Reason.NOT_ADDITIVE, f"{effect.switch} does not add up over frames: switch it off"
            )
    cic = exposure.detector.cic_e if exposure.cic_e is None else exposure.cic_e
    rest = FrameNoise.of(detector, 1.0, exposure.exposure_s)
    peak = float((exposure.mean_e + cic).max()) + rest.rest_e
    if detector.switches.register_clock_charge:
        peak += detector.register_cic_e * detector.register_stages
    pixel = peak + _MARGIN_SIGMA * math.sqrt(peak)
    factor2 = float(excess_noise_factor2(exposure.em_gain, detector.register_stages))
    output = exposure.em_gain * (peak + _MARGIN_SIGMA * math.sqrt(factor2 * peak + _MARGIN_SIGMA))
    level = np.array(detector.bias_adu) if exposure.bias_adu is None else exposure.bias_adu
    stripes = np.zeros(1) if exposure.stripe_adu is None else exposure.stripe_adu
    amplifier_e = math.hypot(detector.read_noise_e, math.sqrt(rest.rest_e2))
    swing = _MARGIN_SIGMA * math.hypot(amplifier_e / detector.gain_e_adu, structure.drift_adu)
    swing += structure.interference_adu
    room = detector.adc_max_adu - float(level.max() + stripes.max()) - swing
    low = float(level.min() + stripes.min()) - swing
    fills = {
        Reason.PIXEL_FULL_WELL: pixel / detector.full_well_e,
        Reason.REGISTER_FULL_WELL: output / detector.register_full_well_e,
        Reason.ADC_RANGE: math.inf if low < 0 or room <= 0 else output / detector.gain_e_adu / room,
    }
    reason = max(fills, key=lambda name: fills[name])
    if fills[reason] > 1.0:
        return Outcome.refuse(Status.SATURATED, reason, f"frames can reach {fills[reason]:.3g} times a limit")
    return Outcome.ok(fills[reason])


def stack_electrons(
    camera: VisibleCamera, exposure: Exposure, n_frames: int, *, seed: int, path: Sequence[PathPart]
) -> FloatArray:
    """Sum of ``n_frames`` frames in electrons at the register input, the fixed bias taken off: one draw.

    Parameters
    ----------
    camera : VisibleCamera
    exposure : Exposure
        What ``camera.prepare`` made for one frame.
    n_frames : int
        Number of frames, 1 to 1e6.
    seed, path
        As `VisibleCamera.expose`; the draws are those of no single frame.

    Returns
    -------
    ndarray
        Mean, variance and law of the sum over frames of ``(adu - bias) K / g``; level, map and stripes of the bias are
        off. The converter's rounding enters as its variance, ``n / 12`` ADU^2.

    Raises
    ------
    InputError
        If frames can saturate or an effect is switched on that does not add up (see `stackable`), or the number of
        frames is out of range.
    """
    if isinstance(n_frames, bool) or not isinstance(n_frames, int | np.integer) or not 1 <= n_frames <= MAX_FRAMES:
        raise InputError("n_frames", n_frames, allowed=f"an integer from 1 to {MAX_FRAMES}")
    answer = stackable(camera, exposure)
    if answer.status is not Status.OK:
        raise InputError(
            "exposure_s",
            exposure.exposure_s,
            unit="s",
            allowed="frames that add up to one draw",
            hint=answer.message,
        )
    n, detector = int(n_frames), exposure.detector
    whole = scaled(exposure, n)
    work = begun(whole, seed, path)
    for effects in (camera.charge, camera.voltage):
        for effect in effects:
            effect.draw_sum(work, whole, n, work.stream(effect.switch))
        if effects is camera.charge:
            work.image /= detector.gain_e_adu
    work.image *= detector.gain_e_adu / exposure.em_gain
    return work.image
