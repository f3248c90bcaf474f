"""Light on the detector that no optics of this model made: earthshine and stray light as numbers or maps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.errors import InputError
from simulator.config import Instrument
from simulator.config.effects import ExtraLight
from simulator.imaging.map_files import read_maps, real_map

__all__ = ["effect_files", "stray_light_map"]

FloatArray = NDArray[np.float64]
_UNITS = "electron / s or electron / (s pix)"


def stray_light_map(instrument: Instrument, band: str, shape: tuple[int, int]) -> FloatArray | None:
    """Electrons per second and pixel of earthshine and stray light that are given on the detector.

    Parameters
    ----------
    instrument : Instrument
        Its sections ``sky.earthshine`` and ``sky.stray_light``.
    band : str
        Any band of the instrument.
    shape : tuple of int
        Rows and columns of the whole frame of the band's camera.

    Returns
    -------
    ndarray, shape ``shape``, or None
        None if neither is set, or both are surface brightnesses in front of the telescope, which are part of
        `sky_rate_e_s_arcsec2`.

    Raises
    ------
    InputError
        If a map is missing, damaged, of another shape or unit, negative or not finite.
    """
    instrument.band(band)
    total = None
    for name, light in _lights(instrument):
        path = light.map_of(band)
        found: Any = light.rate_e_s
        if path is not None:
            found = _read_map(f"sky.{name}.map_file", path, shape)
        if found is not None:
            total = (np.zeros(shape) if total is None else total) + found
    return total


def effect_files(instrument: Instrument, band: str) -> list[str]:
    """Names of the files that cosmic rays, earthshine and stray light of a band read, for headers."""
    template = instrument.cosmic_rays.template.template_file if instrument.cosmic_rays.model == "template" else None
    paths = [template, *(light.map_of(band) for _, light in _lights(instrument))]
    return [Path(path).name for path in paths if path is not None]


def _lights(instrument: Instrument) -> tuple[tuple[str, ExtraLight], ...]:
    return ("earthshine", instrument.sky.earthshine), ("stray_light", instrument.sky.stray_light)


def _read_map(key: str, path: str, shape: tuple[int, int]) -> FloatArray:
    found = read_maps(key, path)
    if not found.is_fits:
        raise InputError(key, path, allowed="a FITS file, which says its unit")
    item = next((image for image in found.maps if image.data.ndim == 2), found.maps[0])
    values = real_map(key, path, item.data, square=False)
    if values.shape != tuple(shape):
        raise InputError(key, path, allowed=f"a map of {shape[0]} rows x {shape[1]} columns, the whole frame",
                         hint=f"it has {values.shape[0]} x {values.shape[1]}")  # fmt: skip
    values *= _per_second(key, path, item.header.get("BUNIT"))
    if (values < 0).any():
        row, column = np.argwhere(values < 0)[0]
        raise InputError(key, path, unit="e-/s", allowed="values at least 0",
                         hint=f"row {row}, column {column} holds {values[row, column]:g}")  # fmt: skip
    return values


def _per_second(key: str, path: str, unit: Any) -> float:
    """Factor from the unit of a map to electrons per second (and pixel)."""
    from astropy import units

    if unit is None:
        raise InputError(f"{key} BUNIT", "missing", allowed=_UNITS, hint=path)
    try:
        given = units.Unit(str(unit).strip())
        for target in (units.electron / units.s, units.electron / units.s / units.pixel):
            if given.is_equivalent(target):
                return float(given.to(target))
    except ValueError:
        pass
    raise InputError(f"{key} BUNIT", str(unit), allowed=_UNITS, hint=path)
