"""Camera: from photon rate on the detector to the numbers of a frame."""

from __future__ import annotations

from simulator.camera.calibration_files import write_calibration_set
from simulator.camera.calibration_set import CalibrationSet, load_calibration_set
from simulator.camera.emccd import expected_adu_map, expose_frame, to_electrons
from simulator.camera.frame import Frame, MaskBit
from simulator.camera.gain import excess_noise_factor2, gain_variance, multiply, stage_probability
from simulator.camera.gain_voltage import em_gain_of, em_voltage_of
from simulator.camera.infrared import InfraredCamera
from simulator.camera.noise import pixel_variance_e2
from simulator.camera.saturation import GainCap, binding_limit, gain_cap, pixel_saturated
from simulator.camera.stacking import stack_electrons, stackable
from simulator.camera.stage import Effect, Exposure
from simulator.camera.visible import VisibleCamera
from simulator.signal.variance import aperture_noise_pixels

__all__ = [
    "CalibrationSet",
    "Effect",
    "Exposure",
    "Frame",
    "GainCap",
    "InfraredCamera",
    "MaskBit",
    "VisibleCamera",
    "aperture_noise_pixels",
    "binding_limit",
    "em_gain_of",
    "em_voltage_of",
    "excess_noise_factor2",
    "expected_adu_map",
    "expose_frame",
    "gain_cap",
    "gain_variance",
    "load_calibration_set",
    "multiply",
    "pixel_saturated",
    "pixel_variance_e2",
    "stack_electrons",
    "stackable",
    "stage_probability",
    "to_electrons",
    "write_calibration_set",
]
