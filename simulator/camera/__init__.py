"""Camera: from photon rate on the detector to the numbers of a frame."""

from __future__ import annotations

from simulator.camera.emccd import Frame, expected_adu_map, expose_frame, to_electrons
from simulator.camera.gain import excess_noise_factor2, gain_variance, multiply, stage_probability
from simulator.camera.noise import aperture_noise_pixels, pixel_variance_e2
from simulator.camera.saturation import GainCap, binding_limit, gain_cap, pixel_saturated

__all__ = [
    "Frame",
    "GainCap",
    "aperture_noise_pixels",
    "binding_limit",
    "excess_noise_factor2",
    "expected_adu_map",
    "expose_frame",
    "gain_cap",
    "gain_variance",
    "multiply",
    "pixel_saturated",
    "pixel_variance_e2",
    "stage_probability",
    "to_electrons",
]
