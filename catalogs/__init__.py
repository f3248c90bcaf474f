"""Facts: stars, names, bands, spectra, albedos and sky, with their sources.

Part of the distribution ``cpic-planner``. Names load on first use, so that importing costs nothing.
"""

from __future__ import annotations

import importlib
from typing import Any

_NAMES = {
    "bands": ("Band", "band_from_file", "load_bands"),
    "catalogue": ("Catalogue", "open_catalogue"),
    "errors": ("InputError",),
    "known_planets": ("KnownPlanetTable", "load_known_planets"),
    "names": ("StarMatch", "resolve_star"),
    "spectra": ("load_albedo", "load_johnson_v", "load_reference_spectrum", "load_stellar_grid", "load_zodi_table"),
    "stars": ("StarTable", "load_stars"),
}
_HOME = {name: module for module, names in _NAMES.items() for name in names}

__all__ = sorted(_HOME)  # noqa: PLE0605


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted(_HOME)
