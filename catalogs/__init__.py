"""Facts: stars, names, bands, spectra, albedos and sky, with their sources.

Part of the distribution ``cpic-planner``. Names load on first use, so that importing costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from catalogs.bands import Band, band_from_file, load_bands
    from catalogs.catalogue import Catalogue, open_catalogue
    from catalogs.errors import InputError
    from catalogs.known_planets import KnownPlanetTable, load_known_planets
    from catalogs.names import StarMatch, resolve_star
    from catalogs.spectra import (
        load_albedo,
        load_johnson_v,
        load_reference_spectrum,
        load_stellar_grid,
        load_zodi_table,
    )
    from catalogs.stars import StarTable, load_stars

_HOME = {
    "Catalogue": "catalogue",
    "open_catalogue": "catalogue",
    "Band": "bands",
    "band_from_file": "bands",
    "load_bands": "bands",
    "InputError": "errors",
    "KnownPlanetTable": "known_planets",
    "load_known_planets": "known_planets",
    "StarMatch": "names",
    "resolve_star": "names",
    "load_albedo": "spectra",
    "load_johnson_v": "spectra",
    "load_reference_spectrum": "spectra",
    "load_stellar_grid": "spectra",
    "load_zodi_table": "spectra",
    "StarTable": "stars",
    "load_stars": "stars",
}

__all__ = [
    "Band",
    "Catalogue",
    "InputError",
    "KnownPlanetTable",
    "StarMatch",
    "StarTable",
    "band_from_file",
    "load_albedo",
    "load_bands",
    "load_johnson_v",
    "load_known_planets",
    "load_reference_spectrum",
    "load_stars",
    "load_stellar_grid",
    "load_zodi_table",
    "open_catalogue",
    "resolve_star",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
