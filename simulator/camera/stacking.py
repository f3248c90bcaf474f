"""The sum of many frames as one draw, where nothing saturates.

Poisson counts, transfer losses and the multiplication register act on every electron for itself, so the sum of ``n``
frames has the law of one frame of ``n`` times the mean. Limits and curves do not add up: where they matter, frames are
drawn one by one.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from catalogs.errors import InputError
from simulator.camera.gain import excess_noise_factor2
from simulator.camera.readout import Interference
from simulator.camera.stage import Exposure, Work
from simulator.camera.visible import VisibleCamera
from simulator.outcome import Outcome, Reason, Status
from simulator.rng import PathPart, stream

__all__ = ["stack_electrons", "stackable"]

FloatArray = npt.NDArray[np.float64]
# Chance of a Gaussian beyond: 1e-15, once in 1e9 frames of a million pixels.
_MARGIN_SIGMA = 8.0
_NOT_ADDITIVE = ("nonlinearity", "cosmic_rays")


def stackable(camera: VisibleCamera, exposure: Exposure) -> Outcome[float]:
    """Whether frames of an exposure add up to one draw.

    Returns
    -------
    Outcome of float
        ``ok`` with the filled fraction of the nearest limit (eight sigma of noise included); else ``saturated`` with
        the limit that frames can reach, or ``invalid`` where an effect that is no sum is switched on.
    """
    detector = exposure.detector
    for effect in camera.charge:
        if effect.switch in _NOT_ADDITIVE:
            return Outcome.refuse(
                Status.INVALID, Reason.NOT_ADDITIVE, f"{effect.switch} does not add up over frames: switch it off"
            )
    peak = float(exposure.mean_e.max()) + detector.cic_e
    pixel = peak + _MARGIN_SIGMA * math.sqrt(peak)
    factor2 = float(excess_noise_factor2(exposure.em_gain, detector.register_stages))
    output = exposure.em_gain * (peak + _MARGIN_SIGMA * math.sqrt(factor2 * peak + _MARGIN_SIGMA))
    converter = (detector.adc_max_adu - detector.bias_adu) * detector.gain_e_adu - _MARGIN_SIGMA * detector.read_noise_e
    low = detector.bias_adu * detector.gain_e_adu / max(_MARGIN_SIGMA * detector.read_noise_e, 1e-9)
    fills = {
        Reason.PIXEL_FULL_WELL: pixel / detector.full_well_e,
        Reason.REGISTER_FULL_WELL: output / detector.register_full_well_e,
        Reason.ADC_RANGE: max(output / converter if converter > 0 else math.inf, 1.0 / low if low > 0 else math.inf),
    }
    reason = max(fills, key=lambda name: fills[name])
    if fills[reason] > 1.0:
        return Outcome.refuse(Status.SATURATED, reason, f"frames can reach {fills[reason]:.3g} times a limit")
    return Outcome.ok(fills[reason])


def stack_electrons(
    camera: VisibleCamera, exposure: Exposure, n_frames: int, *, seed: int, path: Sequence[PathPart]
) -> FloatArray:
    """Sum of ``n_frames`` frames in electrons at the register input, the mean bias taken off: one draw.

    Parameters
    ----------
    camera : VisibleCamera
    exposure : Exposure
        What ``camera.prepare`` made for one frame.
    n_frames : int
        Number of frames, 1 to 1e9.
    seed, path
        As `VisibleCamera.expose`; the draws are those of no single frame.

    Returns
    -------
    ndarray
        Mean, variance and law of the sum of ``(adu - bias) K / g`` over frames; the converter's rounding enters as its
        variance, ``n / 12`` ADU^2.

    Raises
    ------
    InputError
        If frames can saturate or an effect is switched on that does not add up (see `stackable`).
    """
    answer = stackable(camera, exposure)
    if answer.status is not Status.OK:
        raise InputError("exposure_s", exposure.exposure_s, unit="s",
                         allowed="frames that add up to one draw", hint=answer.message)  # fmt: skip
    n, detector = n_frames, exposure.detector
    noise = math.sqrt(detector.read_noise_e**2 + detector.gain_e_adu**2 / 12.0) if detector.switches.read_noise else 0.0
    scaled = detector.model_copy(
        update={
            "cic_e": n * detector.cic_e,
            "register_cic_e": n * detector.register_cic_e,
            "read_noise_e": math.sqrt(n) * noise,
            "bias_structure": detector.bias_structure.model_copy(
                update={"drift_adu": math.sqrt(n) * detector.bias_structure.drift_adu}
            ),
        }
    )
    mean = n * exposure.mean_e
    whole = dataclasses.replace(
        exposure,
        detector=scaled,
        mean_e=mean,
        zero=np.exp(-mean),
        cic_e=None if exposure.cic_e is None else n * exposure.cic_e,
        stripe_adu=None,
    )
    work = Work(mean.copy(), np.zeros(mean.shape, dtype=np.bool_))
    for effect in (*camera.charge, None, *camera.voltage):
        if effect is None:
            work.image /= detector.gain_e_adu
        elif isinstance(effect, Interference):
            waves = stream(seed, *path, effect.switch)
            effect.add_wave(work.image, whole, np.exp(2j * np.pi * waves.random(n)).sum())
        else:
            effect.draw(work, whole, stream(seed, *path, effect.switch))
    work.image *= detector.gain_e_adu / exposure.em_gain
    return work.image
