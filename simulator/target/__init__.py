"""Target simulation: stellar spectra, planet albedo, phase, contrast and positions.

Names load on first use, so that importing the package costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from catalogs.spectral_types import StellarParameters, stellar_parameters
    from simulator.target.albedo import albedo_flags, planet_albedo
    from simulator.target.contrast import contrast_at, planet_contrast
    from simulator.target.phase import lambert_phase
    from simulator.target.positions import detector_to_sky, sky_to_detector
    from simulator.target.sources import Source, scene_sources, spectrum_generator
    from simulator.target.spectrum_table import read_spectrum
    from simulator.target.star_spectrum import STAR_FLAGS, StarSpectrum, star_photlam, stellar_spectrum

__all__ = [
    "STAR_FLAGS",
    "Source",
    "StarSpectrum",
    "StellarParameters",
    "albedo_flags",
    "contrast_at",
    "detector_to_sky",
    "lambert_phase",
    "planet_albedo",
    "planet_contrast",
    "read_spectrum",
    "scene_sources",
    "sky_to_detector",
    "spectrum_generator",
    "star_photlam",
    "stellar_parameters",
    "stellar_spectrum",
]

_HOME = {
    "STAR_FLAGS": "star_spectrum",
    "Source": "sources",
    "StarSpectrum": "star_spectrum",
    "StellarParameters": "catalogs.spectral_types",
    "albedo_flags": "albedo",
    "contrast_at": "contrast",
    "detector_to_sky": "positions",
    "lambert_phase": "phase",
    "planet_albedo": "albedo",
    "planet_contrast": "contrast",
    "read_spectrum": "spectrum_table",
    "scene_sources": "sources",
    "sky_to_detector": "positions",
    "spectrum_generator": "sources",
    "star_photlam": "star_spectrum",
    "stellar_parameters": "catalogs.spectral_types",
    "stellar_spectrum": "star_spectrum",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home = _HOME[name]
    return getattr(importlib.import_module(home if "." in home else f"{__name__}.{home}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
