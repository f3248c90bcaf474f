"""One frame of a camera as the exposure-time calculator sees it: what it adds, holds, and costs."""

import functools
import math
from dataclasses import dataclass
from typing import Self

from simulator.config import Instrument
from simulator.detectors import FrameTerm, added_variance
from simulator.signal import Wells


@dataclass(frozen=True, kw_only=True)
class FrameCamera(Wells):
    """Noise, limits and times of one frame; electrons at the register input unless said.

    Attributes
    ----------
    full_well_e, register_full_well_e, converter_e, em_gain_max, blooms
        As of `simulator.signal.saturation.Wells`.
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
    added : tuple of (str, FrameTerm)
        Variance of a pixel and frame that further effects of the detector add, by term of the budget of noise.
    """

    register_stages: int
    read_noise_e: float
    rounding_e: float
    cic_e: float
    dark_e_s: float
    readout_s: float
    exposure_min_s: float
    exposure_max_s: float
    light_factor: float = 1.0
    line_shift_s: float = 0.0
    added: tuple[tuple[str, FrameTerm], ...] = ()

    @functools.cached_property
    def _rest(self) -> FrameTerm:
        return FrameTerm.total([FrameTerm(), *(term for _, term in self.added)])

    @property
    def read_variance_e2(self) -> float:
        """Variance of a pixel and frame at the register output: read noise, rounding and what other effects add."""
        return self.read_noise_e**2 + self.rounding_e**2 + float(self._rest.output_e2)

    @property
    def charge_e(self) -> float:
        """Electrons of a pixel and frame that come without light, before the register: clock-induced and other."""
        return self.cic_e + float(self._rest.charge_e)

    @property
    def rate_e_s(self) -> float:
        """Electrons of a pixel that come with time besides light and dark current."""
        return float(self._rest.rate_e_s)

    @property
    def amplifier_e(self) -> float:
        """Rms of read noise and of what else comes behind the register but the rounding, at the register output."""
        return math.hypot(self.read_noise_e, math.sqrt(float(self._rest.output_e2)))

    @classmethod
    def of(cls, instrument: Instrument, band: str) -> Self:
        """Camera of a band; effects that are switched off count nothing.

        Parameters
        ----------
        instrument : Instrument
        band : str
            Name of a band of the instrument, such as ``F520``.
        """
        channel = instrument.channel_of(band)
        detector, terms = channel.detector, added_variance(channel.detector)
        read, rounding, cic, dark = (terms.pop(name, FrameTerm()) for name in ("read_noise", "rounding", "cic", "dark"))
        rest = FrameTerm.total([FrameTerm(), *terms.values()])
        one_read_e = detector.read_noise_e if detector.switches.read_noise else 0.0
        swing_e = math.hypot(one_read_e, math.sqrt(float(rest.output_e2)))
        same = ("full_well_e", "register_full_well_e", "readout_s", "exposure_min_s", "line_shift_s")
        return cls(
            **{name: getattr(detector, name) for name in same},
            converter_e=max(detector.converter_e - 5.0 * swing_e, 0.0),
            em_gain_max=detector.em_gain_max if detector.multiplies else 1.0,
            register_stages=detector.register_stages if detector.multiplies else 0,
            read_noise_e=math.sqrt(float(read.output_e2)),
            rounding_e=math.sqrt(float(rounding.output_e2)),
            cic_e=float(cic.charge_e),
            dark_e_s=float(dark.rate_e_s),
            exposure_max_s=channel.exposure_max_s,
            light_factor=detector.ramp()[1],
            blooms=channel.multiplies,
            added=tuple(terms.items()),
        )
