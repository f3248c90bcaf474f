"""Camera: from photon rate on the detector to the numbers of a frame. Names load on first use."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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
    from simulator.camera.visible import VisibleCamera
    from simulator.detectors.effect import Effect, Exposure
    from simulator.signal.variance import aperture_noise_pixels

_HOME = {
    "write_calibration_set": "simulator.camera.calibration_files",
    "CalibrationSet": "simulator.camera.calibration_set",
    "load_calibration_set": "simulator.camera.calibration_set",
    "expected_adu_map": "simulator.camera.emccd",
    "expose_frame": "simulator.camera.emccd",
    "to_electrons": "simulator.camera.emccd",
    "Frame": "simulator.camera.frame",
    "MaskBit": "simulator.camera.frame",
    "excess_noise_factor2": "simulator.camera.gain",
    "gain_variance": "simulator.camera.gain",
    "multiply": "simulator.camera.gain",
    "stage_probability": "simulator.camera.gain",
    "em_gain_of": "simulator.camera.gain_voltage",
    "em_voltage_of": "simulator.camera.gain_voltage",
    "InfraredCamera": "simulator.camera.infrared",
    "aperture_noise_pixels": "simulator.signal.variance",
    "pixel_variance_e2": "simulator.camera.noise",
    "GainCap": "simulator.camera.saturation",
    "binding_limit": "simulator.camera.saturation",
    "gain_cap": "simulator.camera.saturation",
    "pixel_saturated": "simulator.camera.saturation",
    "stack_electrons": "simulator.camera.stacking",
    "stackable": "simulator.camera.stacking",
    "Effect": "simulator.detectors.effect",
    "Exposure": "simulator.detectors.effect",
    "VisibleCamera": "simulator.camera.visible",
}

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


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)
