"""Maps in files made elsewhere: arrays of npz files, images of FITS files, never pickle, and what must hold of each."""

import warnings
from collections.abc import Mapping
from io import BufferedReader
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cpic_core import InputError, NDArray, bounded_fits, open_file, read_npz

MAX_BYTES = 1_000_000_000
MAX_SIDE = 8192
SCALE_TOLERANCE = 1e-3
_SCALE_KEYS = ("PIXSCALE", "PIXELSCL")
_ARCSEC = {"": 3600.0, "deg": 3600.0, "degree": 3600.0, "degrees": 3600.0, "arcmin": 60.0, "arcsec": 1.0, "mas": 1e-3}


class FileMap(NamedTuple):
    """One array of a file: its name (``EXTNAME`` in capitals for FITS, may be empty), data, and header cards."""

    name: str
    data: NDArray[Any]
    header: Mapping[str, Any]


class MapFile(NamedTuple):
    """The format of a file, FITS or not, and its arrays in order; there is at least one."""

    is_fits: bool
    maps: tuple[FileMap, ...]

    def named(self, *names: str) -> FileMap | None:
        """Return the first array with one of the names, whatever their capitals."""
        wanted = {name.upper() for name in names}
        return next((item for item in self.maps if item.name.upper() in wanted), None)


def read_maps(key: str, path: str | Path) -> MapFile:
    """Read every array of an npz file, or every image of a FITS file (compressed ones too).

    The content decides which it is, not the name. A FITS header is that of the image over that of the primary unit.

    Parameters
    ----------
    key : str
        What the file is for, for messages.
    path : str or Path
        The file.

    Raises
    ------
    InputError
        If it is missing, damaged (checksums included), empty, larger than 1 GB, or holds Python objects.
    """
    if not isinstance(path, str | Path):
        raise InputError(key, path, allowed="the path of a FITS or npz file")
    allowed = "an existing FITS or npz file"
    with open_file(path, key=key, allowed=allowed, max_bytes=MAX_BYTES) as file:
        start = file.read(8)
        if not start.startswith((b"PK", b"\x93NUMPY")):
            file.seek(0)
            return MapFile(True, _from_fits(key, path, file))
    if start.startswith(b"PK"):
        return MapFile(False, _from_npz(key, path))
    raise InputError(key, str(path), allowed="a FITS or npz file", hint="a bare npy array; write it with np.savez")


def _from_npz(key: str, path: str | Path) -> tuple[FileMap, ...]:
    try:
        arrays = read_npz(path)
    except InputError as error:
        raise InputError(key, str(path), allowed=error.allowed, hint=error.hint) from None
    if not arrays:
        raise InputError(key, str(path), allowed="an npz file with an array")
    return tuple(FileMap(name, array, {}) for name, array in arrays.items())


def _from_fits(key: str, path: str | Path, file: BufferedReader) -> tuple[FileMap, ...]:
    from astropy.io import fits

    with warnings.catch_warnings(record=True) as complaints:
        warnings.simplefilter("always")
        try:
            with fits.open(bounded_fits(file), memmap=False, checksum=True) as hdus:
                found = _images(key, path, hdus)
        except InputError:
            raise
        except Exception as error:  # astropy raises errors of many kinds for damaged files
            raise InputError(key, str(path), allowed="a whole FITS or npz file", hint=str(error)[:160]) from None
    for complaint in complaints:
        words = " ".join(str(complaint.message).split())
        if "failed for HDU" in words:
            raise InputError(key, str(path), allowed="a FITS file whose checksums hold", hint=words)
        if "truncated" in words.lower() or "error validating header" in words.lower():
            raise InputError(key, str(path), allowed="a whole FITS file", hint=words[:160])
    if not found:
        raise InputError(key, str(path), allowed="a FITS file with an image")
    return found


def _images(key: str, path: str | Path, hdus: Any) -> tuple[FileMap, ...]:
    found = []
    for hdu in hdus:
        shape = tuple(hdu.shape) if hdu.is_image else ()
        if not shape:
            continue
        if max(shape) > MAX_SIDE or len(shape) > 3:
            allowed = f"images of at most {MAX_SIDE} pixels a side"
            raise InputError(key, str(path), allowed=allowed, hint=f"shape {shape}")
        header = dict(hdus[0].header) | dict(hdu.header)
        name = str(hdu.header.get("EXTNAME", "")).strip().upper()
        found.append(FileMap(name, np.asarray(hdu.data), header))
    return tuple(found)


def real_map(
    key: str, path: str | Path, data: NDArray[Any], *, sides: tuple[int, int] = (1, MAX_SIDE), square: bool = True
) -> NDArray[np.float64]:
    """Return a map as float64, ``[y, x]``.

    Parameters
    ----------
    key, path : str
        What it is and where it came from, for messages.
    data : ndarray
        What the file holds.
    sides : tuple of int
        Smallest and largest number of samples a side.
    square : bool
        Whether both sides must be equal.

    Raises
    ------
    InputError
        If it is not two-dimensional (or square), complex or not of numbers, too small or large, or not finite.
    """
    name = str(path)
    what = "a square map of real numbers" if square else "a map of real numbers"
    if data.dtype.kind not in "fiub":
        raise InputError(key, name, allowed=what, hint=f"found {data.dtype.name} numbers")
    if data.ndim != 2 or (square and data.shape[0] != data.shape[1]):
        hint = f"shape {data.shape}" + ("; choose one plane of the cube" if data.ndim == 3 else "")
        raise InputError(key, name, allowed=what, hint=hint)
    if not (sides[0] <= min(data.shape) and max(data.shape) <= sides[1]):
        raise InputError(key, name, allowed=f"{sides[0]} to {sides[1]} samples a side", hint=f"shape {data.shape}")
    values = np.array(data, dtype=np.float64)
    bad = int(np.count_nonzero(~np.isfinite(values)))
    if bad:
        raise InputError(key, name, allowed="finite values", hint=f"{bad} are not")
    return values


def array_number(key: str, path: str | Path, item: FileMap | None) -> float | None:
    """Return the number that an array of one holds, None where there is no array.

    Parameters
    ----------
    key : str
        Name that a refusal gives.
    path : str or Path
    item : FileMap or None

    Raises
    ------
    InputError
        If it holds anything else than one finite number.
    """
    if item is None:
        return None
    if item.data.size != 1 or item.data.dtype.kind not in "fiu" or not np.isfinite(item.data).all():
        raise InputError(key, str(item.data)[:40], allowed="one finite number", hint=str(path))
    return float(item.data.reshape(-1)[0])


def header_number(key: str, path: str | Path, header: Mapping[str, Any], card: str) -> float | None:
    """Return a number of a header, None where there is no such card.

    Parameters
    ----------
    key : str
        Name that a refusal gives.
    path : str or Path
    header : mapping
        Keywords and values of one unit.
    card : str
        Keyword.

    Raises
    ------
    InputError
        If the card holds no finite number.
    """
    if card not in header:
        return None
    value = header[card]
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        allowed, hint = "a finite number", str(path)
        raise InputError(f"{key} {card}", value if isinstance(value, str) else repr(value), allowed=allowed, hint=hint)
    return float(value)


def pixel_scale(key: str, path: str | Path, header: Mapping[str, Any]) -> float | None:
    """Return the pixel of a FITS image in arcsec, None where the header does not tell.

    ``PIXSCALE`` or ``PIXELSCL`` in arcsec; else the ``CD`` matrix or ``CDELT1/2`` in the unit of ``CUNIT`` (degrees if
    absent). All that are present must agree to 1e-3, and pixels must be square.

    Parameters
    ----------
    key : str
        Name that a refusal gives.
    path : str or Path
    header : mapping
        Keywords and values of one unit.

    Raises
    ------
    InputError
        If a card is no number above 0, or two disagree.
    """
    stated = {card: header_number(key, path, header, card) for card in _SCALE_KEYS}
    found = {card: value for card, value in stated.items() if value is not None}
    cd = [[header_number(key, path, header, f"CD{i}_{j}") for j in (1, 2)] for i in (1, 2)]
    if any(value is not None for row in cd for value in row):
        matrix = np.array([[value or 0.0 for value in row] for row in cd])
        for axis, norm in enumerate(np.hypot(matrix[0], matrix[1]), start=1):
            found[f"column {axis} of CD"] = float(norm) * _arcsec_per(key, path, header, 1)
    else:
        for axis in (1, 2):
            value = header_number(key, path, header, f"CDELT{axis}")
            if value is not None:
                found[f"CDELT{axis}"] = abs(value) * _arcsec_per(key, path, header, axis)
    if not found:
        return None
    first, scale = next(iter(found.items()))
    for card, value in found.items():
        if not value > 0:
            raise InputError(f"{key} {card}", value, unit="arcsec", allowed="above 0", hint=str(path))
        if abs(value / scale - 1) > SCALE_TOLERANCE:
            allowed = f"{scale:g} as {first} says"
            raise InputError(f"{key} {card}", f"{value:.6g}", unit="arcsec", allowed=allowed, hint=str(path))
    return scale


def _arcsec_per(key: str, path: str | Path, header: Mapping[str, Any], axis: int) -> float:
    unit = str(header.get(f"CUNIT{axis}", "")).strip().lower()
    if unit not in _ARCSEC:
        raise InputError(f"{key} CUNIT{axis}", unit, allowed=", ".join(filter(None, _ARCSEC)), hint=str(path))
    return _ARCSEC[unit]
