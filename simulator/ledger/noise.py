"""Noise of a pixel in a frame and of a planet's aperture sum over a visit, for the sizes of effects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from simulator.camera.gain import excess_noise_factor2
from simulator.config.detector import Detector, InfraredDetector
from simulator.ledger.light import PlanetPlace, Sketch

__all__ = ["FrameNoise", "visit_variance_e2"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class FrameNoise:
    """Variance of a pixel of one frame, referred to the register input, as far as it is certain.

    Attributes
    ----------
    factor2 : float
        Squared excess noise factor.
    clock_e : float
        Clock-induced electrons a frame.
    read_e2, rounding_e2 : float
        Variance of the amplifier and of the converter.
    dark_e : float
        Dark current a frame.
    photons : bool
        Whether counts are drawn.
    """

    factor2: float
    clock_e: float
    read_e2: float
    rounding_e2: float
    dark_e: float
    photons: bool

    @classmethod
    def of(cls, detector: Detector | InfraredDetector, em_gain: float, dark_e: float) -> FrameNoise:
        """Noise of a detector with what is switched on."""
        switches = detector.switches
        read = detector.read_noise_e**2 / em_gain**2 if switches.read_noise else 0.0
        factor2, clock = 1.0, 0.0
        if isinstance(detector, Detector):
            if detector.switches.em_register:
                factor2 = float(excess_noise_factor2(em_gain, detector.register_stages))
            clock = detector.cic_e if detector.switches.clock_charge else 0.0
        return cls(
            factor2,
            clock,
            read,
            detector.gain_e_adu**2 / 12.0 / em_gain**2,
            dark_e if switches.dark else 0.0,
            switches.photon_noise,
        )

    def variance_e2(self, light_e: FloatArray | float) -> FloatArray:
        """Of pixels that light leaves so many electrons in."""
        charge = (np.asarray(light_e, dtype=np.float64) + self.dark_e) * self.photons + self.clock_e
        return self.factor2 * charge + self.read_e2 + self.rounding_e2


def visit_variance_e2(
    planet: PlanetPlace,
    sketch: Sketch,
    noise: FrameNoise,
    *,
    source_noise_fraction: float,
    exposure_s: float,
    n_frames: int,
    speckle_e_s: float,
    line_shift_s: float,
    flaws_e: float = 0.0,
) -> dict[str, float]:
    """Variance of the aperture sum of a planet over a visit, by origin, electrons^2.

    ``N F^2 w (light t) + N n (F^2 cic + read^2 + rounding) + (N t speckle)^2``: w the mean squared weight of the pixels
    of the aperture, n the sum of squared weights (`simulator.camera.noise.aperture_noise_pixels`), speckle the rms of
    aperture sums that a reference visit leaves; ``line_shift_s`` the time that a row of the frame transfer takes, 0
    without smear; ``flaws_e`` what hot pixels and bad columns add to a frame, times the
    squared weights.
    """
    fraction = sketch.noise_pixels / sketch.aperture_pixels
    bright = float((planet.weights**2).sum()) / max(float(planet.weights.sum()), 1e-300) if planet.weights.size else 1.0
    counts = n_frames * noise.factor2 * noise.photons
    light = counts * exposure_s * fraction
    return {
        "planet": counts * exposure_s * source_noise_fraction * planet.signal_e_s,
        "halo": counts * exposure_s * max(fraction, bright) * planet.halo_e_s,
        "other": light * planet.other_e_s,
        "sky": light * planet.sky_e_s,
        "smear": counts * fraction * line_shift_s * planet.column_e_s,
        "dark": counts * sketch.noise_pixels * noise.dark_e,
        "flaws": counts * flaws_e,
        "clock": n_frames * noise.factor2 * sketch.noise_pixels * noise.clock_e,
        "read": n_frames * sketch.noise_pixels * noise.read_e2,
        "rounding": n_frames * sketch.noise_pixels * noise.rounding_e2,
        "speckle": (n_frames * exposure_s * speckle_e_s) ** 2,
    }
