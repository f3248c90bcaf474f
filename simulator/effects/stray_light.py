"""Earthshine and stray light on the detector as numbers or maps, and the units of maps in FITS files."""

import re
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import FloatArray, InputError
from simulator.config import ExtraLight, Instrument
from simulator.imaging import read_maps, real_map

_WORDS = dict.fromkeys(("pixel", "pixels", "px"), "pix") | dict.fromkeys(("relative", "dimensionless"), "")
_WORDS |= {"electrons": "electron", "dn": "adu"}
_PER_FRAME = re.compile(r"/\s*(?:frame|exposure)s?\b|\b(?:frame|exposure)s?\s*\^?(?:\*\*)?\s*-1")
# e- or e, not part of a word; the minus of e-1 is that of a power.
_CHARGE = re.compile(r"(?<![a-z])e(?:-(?!\d))?(?![a-z])")


def unit_factor(key: str, path: str, header: Mapping[str, Any], unit: str, *, required: bool = True) -> float:
    """Return the factor from the unit that a map's header states to the one wanted.

    Parameters
    ----------
    key : str
        What the map is, for the refusal.
    path : str
        The file, for the refusal.
    header : mapping
        Cards of the image; ``BUNIT`` counts. Whatever `astropy.units` reads is understood, in capitals or not, and
        ``e-``, ``px`` and ``DN`` besides; per pixel or per frame may stand in it or not.
    unit : str
        What is wanted, as ``electron/s``; empty for a pure number.
    required : bool
        Whether a map without ``BUNIT`` is refused.

    Raises
    ------
    InputError
        If the unit is missing, cannot be read, or is of another kind; the one found and those accepted are named.
    """
    allowed = f"{unit} or {_per_pixel(unit)}" if unit else "none: the map has no unit"
    if "BUNIT" not in header:
        if required:
            raise InputError(f"{key} BUNIT", "missing", allowed=allowed, hint=path)
        return 1.0
    text = str(header["BUNIT"])
    from astropy import units

    wanted = units.Unit(unit)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", units.UnitsWarning)
            given = units.Unit(_plain(text))
        for target in (wanted, wanted / units.pixel) if unit else (wanted,):
            if given.is_equivalent(target):
                return float(given.to(target))
    except ValueError:
        pass
    raise InputError(f"{key} BUNIT", text, allowed=allowed, hint=path)


def _per_pixel(unit: str) -> str:
    above, _, below = unit.partition("/")
    return f"{above}/({below} pix)" if below else f"{unit}/pix"


def _plain(text: str) -> str:
    """Return the text of a unit in the words of astropy, with one fraction line at most."""
    text = _PER_FRAME.sub("", text.strip().lower())
    text = _CHARGE.sub("electron", text)
    text = re.sub(r"[a-z]+", lambda word: _WORDS.get(word[0], word[0]), text)
    above, *below = text.split("/")
    if len(below) < 2:
        return text
    return f"{above}/({' '.join(part.strip(' ()') for part in below)})"


_UNIT = "electron/s"


def stray_light_map(instrument: Instrument, band: str, shape: tuple[int, int]) -> FloatArray | None:
    """Return the electrons per second and pixel of earthshine and stray light that are given on the detector.

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
    """Return the names of the files that cosmic rays, earthshine and stray light of a band read, for headers.

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
    """Return the light besides the sky, by the name of its section."""
    return {"earthshine": instrument.sky.earthshine, "stray_light": instrument.sky.stray_light}


def _read_map(key: str, path: str, shape: tuple[int, int]) -> FloatArray:
    found = read_maps(key, path)
    if not found.is_fits:
        raise InputError(key, path, allowed="a FITS file, which says its unit")
    item = next((image for image in found.maps if image.data.ndim == 2), found.maps[0])
    values = real_map(key, path, item.data, square=False)
    if values.shape != tuple(shape):
        allowed = f"a map of {shape[0]} rows x {shape[1]} columns, the whole frame"
        raise InputError(key, path, allowed=allowed, hint=f"it has {values.shape[0]} x {values.shape[1]}")
    values *= unit_factor(key, path, item.header, _UNIT)
    if (values < 0).any():
        row, column = np.argwhere(values < 0)[0]
        hint = f"row {row}, column {column} holds {values[row, column]:g}"
        raise InputError(key, path, unit="e-/s", allowed="values at least 0", hint=hint)
    return values
