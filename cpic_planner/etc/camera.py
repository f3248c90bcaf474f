"""One frame of a camera as the exposure-time calculator sees it: what it adds, holds, and costs."""

from __future__ import annotations

from dataclasses import dataclass

from simulator.camera.dark_current import dark_rate_e_s
from simulator.config import Instrument
from simulator.config.detector import Detector
from simulator.config.infrared import InfraredDetector

__all__ = ["FrameCamera"]


@dataclass(frozen=True)
class FrameCamera:
    """Noise, limits and times of one frame; electrons at the register input unless said.

    Attributes
    ----------
    full_well_e : float
        Charge that a pixel holds.
    register_full_well_e, converter_e : float
        Charge at the register output that the register and the converter hold (the converter after five sigma of read
        noise); infinite where there is none.
    em_gain_max : float
        Largest EM gain, 1 without a register.
    register_stages : int
        Stages of the register, 0 without one: then ``F^2`` is 1.
    read_noise_e, rounding_e : float
        Rms of read noise and of the converter's rounding, per pixel and frame, at the register output.
    light_factor : float
        Variance over mean of the light in a frame: 1, or what a fitted ramp makes of it.
    cic_e : float
        Clock-induced electrons per pixel and frame.
    dark_e_s : float
        Dark current per pixel.
    line_shift_s : float
        Time that a line of the frame stands in the light of each other during the transfer; 0 without smear.
    readout_s, exposure_min_s, exposure_max_s : float
        Dead time after a frame, shortest and longest exposure.
    blooms : bool
        Whether overfull pixels spill along columns and rows into the hole.
    """

    full_well_e: float
    register_full_well_e: float
    converter_e: float
    em_gain_max: float
    register_stages: int
    read_noise_e: float
    rounding_e: float
    cic_e: float
    dark_e_s: float
    readout_s: float
    exposure_min_s: float
    exposure_max_s: float
    light_factor: float = 1.0
    blooms: bool = True
    line_shift_s: float = 0.0

    @property
    def read_variance_e2(self) -> float:
        """Variance of read noise and rounding together, per pixel and frame, at the register output."""
        return self.read_noise_e**2 + self.rounding_e**2

    @property
    def output_well_e(self) -> float:
        """Charge at the output that register and converter hold."""
        return min(self.register_full_well_e, self.converter_e)

    @classmethod
    def of(cls, instrument: Instrument, band: str) -> FrameCamera:
        """Camera of a band; effects that are switched off count nothing."""
        detector = instrument.detector_of(band)
        if isinstance(detector, Detector):
            return _electron_multiplying(detector)
        return _infrared(detector, instrument.detector.exposure_max_s)


def _electron_multiplying(detector: Detector) -> FrameCamera:
    on = detector.switches
    read_noise = detector.read_noise_e if on.read_noise else 0.0
    headroom = (detector.adc_max_adu - detector.bias_adu) * detector.gain_e_adu - 5.0 * read_noise
    return FrameCamera(
        full_well_e=detector.full_well_e,
        register_full_well_e=detector.register_full_well_e,
        converter_e=max(headroom, 0.0),
        em_gain_max=detector.em_gain_max if on.em_register else 1.0,
        register_stages=detector.register_stages if on.em_register else 0,
        read_noise_e=read_noise,
        rounding_e=detector.gain_e_adu / 12.0**0.5,
        cic_e=detector.cic_e if on.clock_charge else 0.0,
        dark_e_s=dark_rate_e_s(detector) if on.dark else 0.0,
        readout_s=detector.readout_s,
        exposure_min_s=detector.exposure_min_s,
        exposure_max_s=detector.exposure_max_s,
        line_shift_s=detector.transfer.line_shift_s if on.smear else 0.0,
    )


def _infrared(detector: InfraredDetector, exposure_max_s: float) -> FrameCamera:
    """Hybrid array: no register, no blooming.

    Double sampling has twice the variance of a read; a line through ``n`` equally spaced reads has
    ``12 (n - 1) / (n (n + 1))`` of it, and ``6 (n^2 + 1) / (5 n (n + 1))`` times the variance of the light (Garnett &
    Forrest 1993, SPIE 1946, 395).
    """
    on, n = detector.switches, detector.n_reads
    one = detector.read_noise_e if on.read_noise else 0.0
    reads, light = 2.0, 1.0
    extra = 0.0
    if detector.readout_mode == "single":
        reads, extra = 1.0, detector.reset_noise_e**2 if on.reset_noise else 0.0
    elif detector.readout_mode == "up_the_ramp":
        reads, light = 12.0 * (n - 1) / (n * (n + 1)), 6.0 * (n**2 + 1) / (5.0 * n * (n + 1))
    first = n if detector.readout_mode == "up_the_ramp" else 1
    return FrameCamera(
        full_well_e=detector.full_well_e,
        register_full_well_e=float("inf"),
        converter_e=max((detector.adc_max_adu - detector.bias_adu) * detector.gain_e_adu - 5.0 * one, 0.0),
        em_gain_max=1.0,
        register_stages=0,
        read_noise_e=(reads * one**2 + extra) ** 0.5,
        rounding_e=detector.gain_e_adu * (reads / 12.0) ** 0.5,
        cic_e=0.0,
        dark_e_s=detector.dark_e_s if on.dark else 0.0,
        readout_s=detector.readout_s,
        exposure_min_s=first * detector.frame_time_s,
        exposure_max_s=exposure_max_s,
        light_factor=light,
        blooms=False,
    )
