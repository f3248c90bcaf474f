"""Physics: from a scene to frames of the camera.

Part of the distribution ``cpic-planner``. Names load on first use, so that importing costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simulator.calibration import Calibration, calibrate
    from simulator.config import (
        Instrument,
        Planet,
        Scene,
        SceneStar,
        load_instrument,
        load_scene,
        scenes_from_table,
    )
    from simulator.imaging.deformable_mirror import load_dm_surface
    from simulator.imaging.external import ExternalPsf, load_psf, save_psf
    from simulator.imaging.psf import Psf, single_band_psf
    from simulator.knobs import Knobs
    from simulator.observation import Observation, observe
    from simulator.outcome import NotOk, Outcome, Reason, Status
    from simulator.passbands import Passbands
    from simulator.products import check_level0, write_level0
    from simulator.rng import stream
    from simulator.target import lambert_phase, planet_albedo, planet_contrast, star_photlam
    from simulator.target.sources import spectrum_generator

_HOME = {
    "Calibration": "calibration",
    "calibrate": "calibration",
    "check_level0": "products",
    "write_level0": "products",
    "Instrument": "config",
    "Planet": "config",
    "Scene": "config",
    "SceneStar": "config",
    "load_instrument": "config",
    "load_scene": "config",
    "scenes_from_table": "config",
    "ExternalPsf": "imaging.external",
    "Psf": "imaging.psf",
    "load_dm_surface": "imaging.deformable_mirror",
    "load_psf": "imaging.external",
    "save_psf": "imaging.external",
    "single_band_psf": "imaging.psf",
    "Knobs": "knobs",
    "Observation": "observation",
    "observe": "observation",
    "NotOk": "outcome",
    "Outcome": "outcome",
    "Reason": "outcome",
    "Status": "outcome",
    "Passbands": "passbands",
    "stream": "rng",
    "lambert_phase": "target",
    "planet_albedo": "target",
    "planet_contrast": "target",
    "star_photlam": "target",
    "spectrum_generator": "target.sources",
}

__all__ = [
    "Calibration",
    "ExternalPsf",
    "Instrument",
    "Knobs",
    "NotOk",
    "Observation",
    "Outcome",
    "Passbands",
    "Planet",
    "Psf",
    "Reason",
    "Scene",
    "SceneStar",
    "Status",
    "calibrate",
    "check_level0",
    "lambert_phase",
    "load_dm_surface",
    "load_instrument",
    "load_psf",
    "load_scene",
    "observe",
    "planet_albedo",
    "planet_contrast",
    "save_psf",
    "scenes_from_table",
    "single_band_psf",
    "spectrum_generator",
    "star_photlam",
    "stream",
    "write_level0",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
