"""Noise of a pixel in one frame of a camera, as far as its numbers are certain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from simulator.camera.gain import excess_noise_factor2
from simulator.config.detector import AnyDetector, Detector
from simulator.detectors.chains import added_variance
from simulator.quantities import checked_array
from simulator.signal.variance import MOST, FrameTerm, frame_variance_e2


@dataclass(frozen=True)
class FrameNoise:
    """Variance of a pixel of one frame, referred to the register input.

    Attributes
    ----------
    factor2 : float
        Variance over mean of the electrons that are counted: squared excess noise factor, or that of a fitted ramp.
    clock_e : float
        Clock-induced electrons a frame.
    read_e2, rounding_e2 : float
        Variance of the amplifier and of the converter.
    dark_e : float
        Dark current a frame.
    photons : bool
        Whether counts are drawn.
    rest_e, rest_e2 : float
        Electrons at the register input, and variance behind the register, that further effects of the detector add.
    added_e2 : mapping of str to float
        Variance of each of these, by its term in budgets of noise.
    """

    factor2: float
    clock_e: float
    read_e2: float
    rounding_e2: float
    dark_e: float
    photons: bool
    rest_e: float = 0.0
    rest_e2: float = 0.0
    added_e2: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, detector: AnyDetector, em_gain: float, exposure_s: float) -> FrameNoise:
        """Return the noise of a frame with what is switched on.

        Parameters
        ----------
        detector : Detector or InfraredDetector
        em_gain : float
            Gain of the register, 1 without one.
        exposure_s : float
            Of the frame.

        Returns
        -------
        FrameNoise
            Without a register the variances of several reads together, and of the light what they make of it
            (`simulator.signal.variance.ramp_factors`).
        """
        terms = added_variance(detector, exposure_s)
        cic, read, rounding, dark = (terms.pop(name, FrameTerm()) for name in ("cic", "read_noise", "rounding", "dark"))
        factor2 = float(register_factor2(detector, em_gain, exposure_s))
        rest = FrameTerm.total([FrameTerm(), *terms.values()])
        return cls(
            factor2=factor2,
            clock_e=float(cic.charge_e),
            read_e2=float(read.output_e2) / em_gain**2,
            rounding_e2=float(rounding.output_e2) / em_gain**2,
            dark_e=float(dark.rate_e_s) * exposure_s,
            photons=detector.switches.photon_noise,
            rest_e=float(rest.charge_e + rest.rate_e_s * exposure_s),
            rest_e2=float(rest.output_e2) / em_gain**2,
            added_e2={name: float(term.variance_e2(exposure_s, factor2, em_gain)) for name, term in terms.items()},
        )

    @property
    def gaussian_e2(self) -> float:
        """Variance of amplifier and converter together, and what else comes behind the register."""
        return self.read_e2 + self.rounding_e2 + self.rest_e2

    @property
    def pedestal_e(self) -> float:
        """Mean electrons of a pixel without light."""
        return self.dark_e + self.clock_e + self.rest_e

    def variance_e2(self, light_e: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return the variance of pixels that light leaves so many electrons in."""
        return self.charge_variance_e2(
            (np.asarray(light_e, dtype=np.float64) + self.dark_e) * self.photons + self.clock_e + self.rest_e
        )

    def charge_variance_e2(self, charge_e: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return the variance of pixels that hold so many electrons on average, with dark and clock-induced ones."""
        return np.asarray(frame_variance_e2(np.asarray(charge_e, float), self.factor2, self.gaussian_e2, 1.0))


def register_factor2(
    detector: AnyDetector, em_gain: npt.ArrayLike, exposure_s: float | None = None
) -> npt.NDArray[np.float64]:
    """Return the variance over the mean of the electrons that a camera counts.

    Parameters
    ----------
    detector : Detector or InfraredDetector
    em_gain : array_like
        Gain of the register, 1 without one.
    exposure_s : float, optional
        Exposure of the frame; one that has room for all reads of a ramp if not given.

    Returns
    -------
    ndarray
        Squared excess noise factor of the register, 1 where it is switched off; what a fitted ramp makes of the light.
    """
    if isinstance(detector, Detector):
        factor2 = excess_noise_factor2(em_gain, detector.register_stages)
        return factor2 if detector.switches.em_register else np.ones_like(factor2)
    return np.full(np.shape(em_gain), detector.ramp(exposure_s)[1])


def pixel_variance_e2(
    photon_e: npt.ArrayLike, cic_e: npt.ArrayLike, em_gain: npt.ArrayLike, detector: Detector
) -> npt.NDArray[np.float64]:
    """Return the variance of one pixel of one frame, referred to the register input.

    Parameters
    ----------
    photon_e : array_like
        Mean electrons collected during the exposure (photo-electrons and dark current), 0 to 1e100.
    cic_e : array_like
        Mean clock-induced electrons per frame, 0 to 1e100.
    em_gain : array_like
        Gain of the register, 1 to 1e4.
    detector : Detector
        Gives read noise (electrons at the register output), ADC gain and number of stages; what is switched off counts
        nothing.

    Returns
    -------
    ndarray
        ``F^2 (photon + cic) + read_noise^2 / g^2 + (K / g)^2 / 12`` in electrons^2, with ``K`` in e-/ADU;
        arguments broadcast. The last term is the rounding of the converter, uniform as long as the noise
        before it exceeds about half an ADU.

    Raises
    ------
    InputError
        If an argument is negative, not finite or out of range.
    """
    photon = checked_array("photon_e", photon_e, low=0.0, high=MOST, unit="e-")
    cic = checked_array("cic_e", cic_e, low=0.0, high=MOST, unit="e-")
    behind = FrameNoise.of(detector, 1.0, 0.0).gaussian_e2
    factor2 = register_factor2(detector, em_gain)
    return np.asarray(frame_variance_e2(photon + cic, factor2, behind, np.asarray(em_gain, float)))
