"""Light on the detector that no optics of this model made: earthshine and stray light as numbers or maps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from catalogs.errors import InputError
from simulator.config import Instrument
from simulator.config.effects import ExtraLight
from simulator.effects.map_units import unit_factor
from simulator.imaging.map_files import read_maps, real_map

FloatArray = NDArray[np.float64]
_UNIT = "electron/s"


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
    parts = stray_light_parts(instrument, band, shape)
    return sum(parts.values(), np.zeros(shape)) if parts else None


def stray_light_parts(
    instrument: Instrument,
    band: str,
    shape: tuple[int, int],
    *,
    first_pixel: tuple[int, int] = (0, 0),
    window: tuple[int, int] | None = None,
) -> dict[str, FloatArray]:
    """Return the parts of `stray_light_map` by origin, for a window of the frame.

    Parameters
    ----------
    instrument, band, shape
        As `stray_light_map`.
    first_pixel : tuple of int
        Row and column of the frame at which the window begins.
    window : tuple of int, optional
        Its rows and columns; the whole frame if not given. What reaches beyond the frame sees nothing of a map.

    Returns
    -------
    dict of str to ndarray
        ``earthshine`` and ``stray_light``, as far as they are given on the detector.
    """
    instrument.band(band)
    parts = {}
    for name, light in extra_lights(instrument).items():
        path = light.map_of(band)
        if path is not None:
            whole = _read_map(f"sky.{name}.map_file", path, shape)
            parts[name] = whole if window is None else _cut(whole, first_pixel, window)
        elif light.rate_e_s is not None:
            parts[name] = np.full(shape if window is None else window, light.rate_e_s)
    return parts


def _cut(whole: FloatArray, first_pixel: tuple[int, int], window: tuple[int, int]) -> FloatArray:
    # Places of the window's rows and columns in the frame; those outside it stay dark.
    places = [first + np.arange(length) for first, length in zip(first_pixel, window, strict=True)]
    inside = [(place >= 0) & (place < size) for place, size in zip(places, whole.shape, strict=True)]
    part = np.zeros(window)
    part[np.ix_(*inside)] = whole[np.ix_(*(place[there] for place, there in zip(places, inside, strict=True)))]
    return part


def effect_files(instrument: Instrument, band: str) -> list[str]:
    """Names of the files that cosmic rays, earthshine and stray light of a band read, for headers.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    template = instrument.cosmic_rays.template.template_file if instrument.cosmic_rays.model == "template" else None
    paths = [template, *(light.map_of(band) for light in extra_lights(instrument).values())]
    return [Path(path).name for path in paths if path is not None]


def extra_lights(instrument: Instrument) -> dict[str, ExtraLight]:
    """Light besides the sky, by the name of its section."""
    return {"earthshine": instrument.sky.earthshine, "stray_light": instrument.sky.stray_light}


def _read_map(key: str, path: str, shape: tuple[int, int]) -> FloatArray:
    found = read_maps(key, path)
    if not found.is_fits:
        raise InputError(key, path, allowed="a FITS file, which says its unit")
    item = next((image for image in found.maps if image.data.ndim == 2), found.maps[0])
    values = real_map(key, path, item.data, square=False)
    if values.shape != tuple(shape):
        raise InputError(
            key,
            path,
            allowed=f"a map of {shape[0]} rows x {shape[1]} columns, the whole frame",
            hint=f"it has {values.shape[0]} x {values.shape[1]}",
        )
    values *= unit_factor(key, path, item.header, _UNIT)
    if (values < 0).any():
        row, column = np.argwhere(values < 0)[0]
        raise InputError(
            key,
            path,
            unit="e-/s",
            allowed="values at least 0",
            hint=f"row {row}, column {column} holds {values[row, column]:g}",
        )
    return values
