"""Calibration maps in FITS files: what each must be, reading one, and writing a whole set."""

from __future__ import annotations

import contextlib
import io
import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cpic_core import FloatArray, InputError, NDArray, element_name, write_bytes
from simulator.camera.frame import MaskBit
from simulator.config import AnyDetector
from simulator.effects import unit_factor
from simulator.imaging import read_maps

if TYPE_CHECKING:
    from simulator.camera.calibration_set import CalibrationSet


class _Kind(NamedTuple):
    """The contents of a map: its unit, range, and fill."""

    unit: str
    high: float
    fill_zero: bool


_KINDS = {
    "flat": _Kind("", 1e9, True),
    "dark": _Kind("electron/s", 1e9, False),
    "cic": _Kind("electron", 1e6, False),
    "bad_columns": _Kind("", 2.0**31, True),
    "bias": _Kind("adu", 65535.0, False),
}
FLAT_MEAN_RANGE = (0.5, 2.0)


def file_print(kind: str, path: str) -> tuple[int, ...]:
    """Return the size, time and number of a file on disk: what changes when it is written anew.

    Parameters
    ----------
    kind : str
        Kind of the map.
    path : str

    Raises
    ------
    InputError
        If there is no such file.
    """
    try:
        found = Path(path).stat()
    except OSError:
        raise InputError(_key(kind), path, allowed="an existing FITS file") from None
    return found.st_size, found.st_mtime_ns, found.st_ino


def read_calibration_map(kind: str, path: str, detector: AnyDetector) -> FloatArray:
    """Read the first two-dimensional image of a FITS file as a map over the whole frame.

    Parameters
    ----------
    kind : {"flat", "dark", "cic", "bad_columns", "bias"}
        What the file holds. ``BUNIT`` must convert to electron/s (dark), electron (cic) or adu (bias), each per pixel
        or not; the others have none, or that of a pure number.
    path : str
        The file.
    detector : Detector
        Gives the shape of the frame. A map of the active pixels alone is laid into the frame: around it ``flat`` and
        ``bad_columns`` are 0, the others have the median of the map.

    Raises
    ------
    InputError
        For a file that cannot be read, or whose map has another shape or unit or a value out of range (file and pixel
        are named), a flat far from 1 on average, or a bias whose median the converter cannot write.
    """
    rule, key = _KINDS[kind], _key(kind)
    file = read_maps(key, path)
    if not file.is_fits:
        raise InputError(key, path, allowed="a FITS file")
    image = next((item for item in file.maps if item.data.ndim == 2), None)
    if image is None:
        raise InputError(key, path, allowed="a FITS file with a two-dimensional image")
    factor = unit_factor(key, path, image.header, rule.unit, required=bool(rule.unit))
    frame, active = (detector.n_rows, detector.n_columns), detector.active_shape
    if image.data.shape not in (frame, active):
        allowed = f"{frame}, the frame (rows, columns), or {active}, its active pixels"
        raise InputError(f"{key} shape", str(image.data.shape), unit="px", allowed=allowed, hint=path)
    values = _checked_values(rule, key, path, image.data, factor)
    if kind == "flat":
        _check_flat(key, path, values if values.shape == active else values[detector.sections["active"]])
    median = float(np.median(values))
    if kind == "bias" and not median < detector.adc_max_adu:
        allowed = f"below the ADC maximum {detector.adc_max_adu}"
        raise InputError(f"{key} median", f"{median:.6g}", unit="ADU", hint=path, allowed=allowed)
    if values.shape == frame:
        return values
    whole = np.full(frame, 0.0 if rule.fill_zero else median)
    whole[detector.sections["active"]] = values
    return whole


def write_calibration_set(
    calibration: CalibrationSet, folder: str | Path, *, overwrite: bool = False
) -> dict[str, Path]:
    """Write a set as FITS maps in the form that `load_calibration_set` reads.

    Parameters
    ----------
    calibration : CalibrationSet
        A set over the whole frame.
    folder : str or Path
        Where ``flat.fits``, ``dark.fits``, ``cic.fits``, ``bad_columns.fits`` and ``bias.fits`` go; made if absent.
        The bias is its map, or its level with the stripes.
    overwrite : bool
        Whether files of these names are replaced.

    Returns
    -------
    dict of str to Path
        The files, by their key in ``detector.calibration_files``.

    Raises
    ------
    InputError
        If a file exists and ``overwrite`` is false.
    OSError
        If the folder cannot be written; files that were there keep their content.
    """
    place = Path(folder)
    bias = calibration.bias_adu
    if bias is None:
        bias = np.tile(calibration.bias_level_adu + calibration.stripe_adu, (calibration.shape[0], 1))
    written: dict[str, NDArray[Any]] = {
        "flat": calibration.response,
        "dark": calibration.dark_e_s,
        "cic": calibration.cic_e,
        "bad_columns": calibration.bad_column.astype(np.uint8) * np.uint8(MaskBit.BAD),
        "bias": bias,
    }
    paths = {kind: place / f"{kind}.fits" for kind in written}
    for path in paths.values():
        if path.exists() and not overwrite:
            raise InputError("folder", str(path), allowed="a name that is free", hint="overwrite=True replaces it")
    place.mkdir(parents=True, exist_ok=True)
    # All are whole on disk before the first takes its name.
    ready = Path(tempfile.mkdtemp(dir=place, prefix=".calibration."))
    try:
        for kind, values in written.items():
            _write_map(ready / paths[kind].name, kind, values)
        for path in paths.values():
            (ready / path.name).replace(path)
    finally:
        with contextlib.suppress(OSError):
            shutil.rmtree(ready)
    return paths


def _write_map(path: Path, kind: str, values: NDArray[Any]) -> None:
    from astropy.io import fits

    hdu = fits.PrimaryHDU(values)
    if _KINDS[kind].unit:
        hdu.header["BUNIT"] = _KINDS[kind].unit
    hdu.header["MAPKIND"] = (kind, "key in detector.calibration_files")
    hdu.add_checksum(when="of this unit")  # the default comment is the time of day
    buffer = io.BytesIO()
    hdu.writeto(buffer)
    write_bytes(path, buffer.getvalue())


def _key(kind: str) -> str:
    return f"detector.calibration_files.{kind}"


def _checked_values(rule: _Kind, key: str, path: str, data: NDArray[Any], factor: float) -> FloatArray:
    if data.dtype.kind not in "fiub":
        raise InputError(key, path, allowed="a map of real numbers", hint=f"found {data.dtype.name} numbers")
    values = np.array(data, dtype=np.float64) * factor
    wrong = ~((values >= 0.0) & (values <= rule.high))
    if wrong.any():
        name, index = element_name(key, wrong)
        raise InputError(name, float(values[index]), unit=rule.unit, allowed=f"0 to {rule.high:g}", hint=path)
    if key == _key("bad_columns") and (values != np.rint(values)).any():
        name, index = element_name(key, values != np.rint(values))
        raise InputError(name, float(values[index]), allowed="whole numbers, 0 for good pixels", hint=path)
    return values


def _check_flat(key: str, path: str, active: FloatArray) -> None:
    """Refuse a flat in counts, or scaled otherwise: it would change the throughput of the instrument."""
    lit = active[active > 0]
    mean = float(lit.mean()) if lit.size else 0.0
    low, high = FLAT_MEAN_RANGE
    if not low <= mean <= high:
        allowed = f"relative response: mean of the active pixels {low:g} to {high:g}"
        raise InputError(f"{key} mean", f"{mean:.6g}", allowed=allowed, hint=f"divide it by its mean; {path}")
