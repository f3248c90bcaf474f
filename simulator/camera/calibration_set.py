"""Differences of the pixels of a camera: response, dark current, clock-induced charge, bias; seeded or from files.

Every flaw draws from its own stream of ``flaws.seed``, so that changing one leaves the others as they are. Files are
calibration maps in FITS, read and written one by one or as a whole set.
"""

from __future__ import annotations

import contextlib
import functools
import io
import math
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import field, fields, replace
from enum import IntFlag
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from cpic_core import BoolArray, FloatArray, InputError, NDArray, Record, element_name, stream, write_bytes
from simulator.config import AnyDetector, Section
from simulator.detectors import Switches
from simulator.effects import unit_factor
from simulator.imaging import read_maps


class MaskBit(IntFlag):
    """Bits of the truth mask: those of the Level-1 data model."""

    GOOD = 0
    BAD = 1
    HOT = 2
    WARM = 4
    SATURATED = 8
    COSMIC_RAY = 16
    SATELLITE_TRAIL = 32


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


# A pixel is warm from 10 and hot from 100 times the median dark current on, and a median below 1e-4 e-/s counts as
# that. Assumed: the Level-1 data model names the bits but no limits.
WARM_FACTOR, HOT_FACTOR, LEAST_MEDIAN_E_S = 10.0, 100.0, 1e-4
LEAST_RESPONSE = 0.01


def response_map(shape: tuple[int, int], rms: float, rng: np.random.Generator) -> FloatArray:
    """Return the relative response: Gaussian about 1, at least 0.01 before its mean is made exactly 1."""
    if rms == 0.0:
        return np.ones(shape)
    response = rng.standard_normal(shape)
    response *= rms
    response += 1.0
    np.maximum(response, LEAST_RESPONSE, out=response)
    response /= response.mean()
    return response


def scatter_map(shape: tuple[int, int], rms: float, rng: np.random.Generator) -> FloatArray:
    """Return log-normal factors above 0 of mean 1 and relative standard deviation ``rms``."""
    if rms == 0.0:
        return np.ones(shape)
    variance = math.log1p(rms * rms)
    factor = rng.standard_normal(shape)
    factor *= math.sqrt(variance)
    factor -= 0.5 * variance
    np.exp(factor, out=factor)
    return factor


def chosen_places(shape: tuple[int, int], fraction: float, rng: np.random.Generator) -> BoolArray:
    """Return the ``fraction`` of the pixels, rounded to a whole number, at random places."""
    chosen = np.zeros(shape, dtype=np.bool_)
    number = round(fraction * chosen.size)
    if number:
        chosen.reshape(-1)[rng.choice(chosen.size, number, replace=False, shuffle=False)] = True
    return chosen


def excess_map(hot: BoolArray, factor: float, rng: np.random.Generator) -> FloatArray:
    """Return what hot pixels have in excess, in units of the mean dark current: exponential of mean ``factor - 1``."""
    excess = np.zeros(hot.shape)
    excess[hot] = (factor - 1.0) * rng.standard_exponential(int(np.count_nonzero(hot)))
    return excess


def warm_from_e_s(dark_e_s: FloatArray, pixels: tuple[slice, slice]) -> float:
    """Return the dark current from which on a pixel is warm: 10 times the median of ``pixels``."""
    return WARM_FACTOR * max(float(np.median(dark_e_s[pixels])), LEAST_MEDIAN_E_S)


def flaw_mask(bad: BoolArray, dark_e_s: FloatArray, pixels: tuple[slice, slice]) -> NDArray[np.uint8]:
    """Return the `MaskBit` of the flaws: bad as given; hot or warm by dark current against the median of ``pixels``."""
    warm = warm_from_e_s(dark_e_s, pixels)
    mask = np.where(bad, np.uint8(MaskBit.BAD), np.uint8(MaskBit.GOOD))
    hot = dark_e_s >= HOT_FACTOR / WARM_FACTOR * warm
    mask[hot] |= np.uint8(MaskBit.HOT)
    mask[(dark_e_s >= warm) & ~hot] |= np.uint8(MaskBit.WARM)
    return mask


class CalibrationSet(Record, eq=False):
    """Maps over the frame, with everything switched on; read-only arrays ``[y, x]``.

    Attributes
    ----------
    response : ndarray
        Relative response to light. Mean of the active pixels 1 before dead pixels and bad columns, which have 0; 0 in
        shielded pixels, prescan and overscan.
    dark_e_s : ndarray
        Dark current of every pixel of the image section, shielded ones included; 0 in prescan and overscan.
    dark_uniform_e_s : ndarray
        The same without structure.
    cic_e : ndarray
        Clock-induced electrons per pixel and frame: in all rows of the columns of the image section.
    stripe_adu : ndarray
        Offset of the bias of every column, mean 0; 0 where a map of the bias was given.
    bias_adu : ndarray or None
        Map of the bias (level and structure) from a file.
    mask : ndarray of uint8
        `simulator.camera.MaskBit`: bad (dead pixels, bad columns), warm and hot (from 10 and 100 times the median dark
        current on).
    bias_level_adu : float
        Level of the bias: the median of its map where there is one.
    cic_varies : bool
        Whether ``cic_e`` differs from pixel to pixel.
    files : mapping of str to str
        Files used, by what they hold.
    sensitivity, dark_smooth_e_s : ndarray
        Response without dead pixels and bad columns; dark current without hot pixels and bad columns.
    dead, hot, bad_column : ndarray of bool
        Pixels of each flaw.
    """

    response: FloatArray
    dark_e_s: FloatArray
    dark_uniform_e_s: FloatArray
    cic_e: FloatArray
    stripe_adu: FloatArray
    bias_adu: FloatArray | None
    mask: NDArray[np.uint8]
    sensitivity: FloatArray
    dark_smooth_e_s: FloatArray
    dead: BoolArray
    hot: BoolArray
    bad_column: BoolArray
    bias_level_adu: float = 0.0
    cic_varies: bool = False
    files: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.mask.shape
        return rows, columns

    def window(self, rows: slice, columns: slice) -> CalibrationSet:
        """Return the set of a window, without copying.

        Raises
        ------
        InputError
            If the window is empty, has a step, or reaches beyond the frame.
        """
        for key, part, size in (("rows", rows, self.shape[0]), ("columns", columns, self.shape[1])):
            start, stop, step = part.start or 0, size if part.stop is None else part.stop, part.step
            if not 0 <= start < stop <= size or step not in (None, 1):
                raise InputError(f"window {key}", repr(part), unit="px", allowed=f"slice of 0 to {size} without step")
        cut: dict[str, Any] = {}
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                cut[item.name] = value[rows, columns] if value.ndim == 2 else value[columns]
        return replace(self, **cut)

    def response_of(self, switches: Switches) -> FloatArray:
        """Return the response with the flaws that are switched on (``flat``, ``bad_pixels``, ``bad_columns``)."""
        columns = _columns_on(switches)
        if switches.flat and switches.bad_pixels and columns:
            return self.response
        response = self.sensitivity.copy() if switches.flat else (self.sensitivity > 0).astype(np.float64)
        if switches.bad_pixels:
            response[self.dead] = 0.0
        if columns:
            response[self.bad_column] = 0.0
        return response

    def dark_of(self, switches: Switches) -> FloatArray:
        """Return the dark current with the flaws that are switched on.

        ``dark_structure`` is the scatter from pixel to pixel, ``bad_pixels`` holds hot pixels, ``bad_columns`` theirs,
        ``dark`` everything.
        """
        columns = _columns_on(switches)
        if not switches.dark:
            return np.zeros(self.shape)
        if switches.dark_structure and switches.bad_pixels and columns:
            return self.dark_e_s
        dark = (self.dark_smooth_e_s if switches.dark_structure else self.dark_uniform_e_s).copy()
        raised = (self.hot & ~self.bad_column) if switches.bad_pixels else np.zeros(self.shape, dtype=np.bool_)
        if columns:
            raised |= self.bad_column
        dark[raised] += self.dark_e_s[raised] - self.dark_smooth_e_s[raised]
        return dark

    def mask_of(self, switches: Switches) -> NDArray[np.uint8]:
        """Return the mask with the flaws that are switched on."""
        columns = _columns_on(switches)
        if switches.dark and switches.dark_structure and switches.bad_pixels and columns:
            return self.mask
        mask = self.mask.copy()
        bad = (self.dead & switches.bad_pixels) | (self.bad_column & columns)
        mask[~bad] &= np.uint8(0xFF ^ MaskBit.BAD)
        raised = self.hot & ~self.bad_column
        dark = np.where(self.bad_column, columns, np.where(raised, switches.bad_pixels, switches.dark_structure))
        mask[~(dark & switches.dark)] &= np.uint8(0xFF ^ (MaskBit.HOT | MaskBit.WARM))
        return mask


def _columns_on(switches: Switches) -> bool:
    """Return whether there are bad columns: they belong to the visible camera alone."""
    return bool(getattr(switches, "bad_columns", True))


def load_calibration_set(detector: AnyDetector) -> CalibrationSet:
    """Return the calibration set of the visible camera, over its whole frame.

    Parameters
    ----------
    detector : Detector
        Gives frame, level and scatter of every flaw, and files that replace parts of the seeded set.

    Returns
    -------
    CalibrationSet
        Made once per configuration and content of the files. A ``flat`` replaces scatter of the response and dead
        pixels (its zeros), ``dark`` scatter, hot pixels and extra charge of bad columns, ``bad_columns`` the seeded
        columns (its pixels have no response, and the extra charge unless there is a ``dark``), ``bias`` level and
        stripes. A map of the active pixels alone is taken too: outside them ``flat`` and ``bad_columns`` are 0, the
        others their median. The level of a ``dark`` is the median of its active pixels; hot are those from 10 times
        that on.

    Raises
    ------
    InputError
        For a file that is missing, no FITS image, of another shape or unit, or holds NaN, infinity or a value out of
        range (naming file and pixel); for more bad columns than there are active ones.
    """
    prints = tuple(file_print(kind, path) for kind, path in detector.maps.items())
    every = dict.fromkeys(type(detector.switches).model_fields, True)  # one set, whatever is switched off
    return _cached_set(detector.with_switches(every), prints)


def bias_level_adu(detector: AnyDetector) -> float:
    """Return the level of the bias: the median of its map where a file is named, else that of the configuration."""
    return load_calibration_set(detector).bias_level_adu if "bias" in detector.maps else detector.bias_adu


# One set of the default visible camera takes 60 MB, of the near-infrared one 15 MB.
@functools.lru_cache(maxsize=4)
def _cached_set(detector: AnyDetector, prints: tuple[tuple[int, ...], ...]) -> CalibrationSet:
    """Build a set; ``prints`` of the files keep a changed file from being taken for its former self."""
    maps = {kind: read_calibration_map(kind, path, detector) for kind, path in detector.maps.items()}
    bad_column = (maps["bad_columns"] > 0) if "bad_columns" in maps else _bad_columns(detector)
    sensitivity, dead = _sensitivity(detector, maps.get("flat"))
    dead &= ~bad_column
    response = np.where(dead | bad_column, 0.0, sensitivity)
    uniform, smooth, dark, hot = _dark(detector, maps.get("dark"), bad_column)
    cic, varies = _clock_charge(detector, maps.get("cic"))
    bias = maps.get("bias")
    return CalibrationSet(
        response=response,
        dark_e_s=dark,
        dark_uniform_e_s=uniform,
        cic_e=cic,
        stripe_adu=_stripes(detector) if bias is None else np.zeros(detector.n_columns),
        bias_adu=bias,
        mask=flaw_mask(dead | bad_column, dark, detector.sections["active"]),
        sensitivity=sensitivity,
        dark_smooth_e_s=smooth,
        dead=dead,
        hot=hot,
        bad_column=bad_column,
        bias_level_adu=detector.bias_adu if bias is None else float(np.median(bias)),
        cic_varies=varies,
        files=MappingProxyType(detector.maps),
    )


def _rng(detector: AnyDetector, flaw: str) -> np.random.Generator:
    return stream(detector.flaws.seed, "calibration", detector.set_name, flaw)


def _size(section: Section) -> tuple[int, int]:
    rows, columns = section
    return rows.stop - rows.start, columns.stop - columns.start


def _bad_columns(detector: AnyDetector) -> BoolArray:
    bad, parts = np.zeros(detector.shape, dtype=np.bool_), detector.sections
    number, columns = detector.flaws.bad_columns, parts["active"][1]
    available = columns.stop - columns.start
    if number > available:
        raise InputError("detector.flaws.bad_columns", number, allowed=f"at most the {available} active columns")
    chosen = _rng(detector, "bad_columns").choice(available, number, replace=False)
    bad[parts["image"][0], columns.start + chosen] = True
    return bad


def _sensitivity(detector: AnyDetector, flat: FloatArray | None) -> tuple[FloatArray, BoolArray]:
    """Return the response before dead pixels and bad columns, and the dead pixels."""
    shape, active = detector.shape, detector.sections["active"]
    sensitivity, dead = np.zeros(shape), np.zeros(shape, dtype=np.bool_)
    if flat is not None:
        dead[active] = flat[active] == 0
        sensitivity[active] = np.where(dead, 1.0, flat)[active]
        return sensitivity, dead
    sensitivity[active] = response_map(_size(active), detector.flaws.prnu_rms, _rng(detector, "response"))
    dead[active] = chosen_places(_size(active), detector.flaws.dead_fraction, _rng(detector, "dead"))
    return sensitivity, dead


Darks = tuple[FloatArray, FloatArray, FloatArray, BoolArray]


def _dark(detector: AnyDetector, given: FloatArray | None, bad_column: BoolArray) -> Darks:
    """Return the dark current: uniform, with scatter, with all flaws; and the hot pixels."""
    image, active, flaws = detector.sections["image"], detector.sections["active"], detector.flaws
    uniform, smooth, dark = (np.zeros(detector.shape) for _ in range(3))
    level = detector.dark_rate_e_s if given is None else float(np.median(given[active]))
    uniform[image] = level
    if given is not None:
        dark[image] = given[image]
        hot = dark >= warm_from_e_s(dark, active)
        return uniform, np.where(hot | bad_column, uniform, dark), dark, hot
    hot, size = np.zeros(detector.shape, dtype=np.bool_), _size(image)
    smooth[image] = level * scatter_map(size, flaws.dsnu_rms, _rng(detector, "dark"))
    hot[image] = chosen_places(size, flaws.hot_fraction, _rng(detector, "hot"))
    dark[image] = smooth[image] + level * excess_map(hot[image], flaws.hot_factor, _rng(detector, "hot_excess"))
    dark[bad_column] += flaws.bad_column_e_s
    return uniform, smooth, dark, hot


def _clock_charge(detector: AnyDetector, given: FloatArray | None) -> tuple[FloatArray, bool]:
    """Return the clock-induced charge of all rows of the image's columns, and whether it varies."""
    cic, section = np.zeros(detector.shape), (slice(0, detector.n_rows), detector.sections["image"][1])
    if given is not None:
        cic[section] = given[section]
        return cic, bool(np.ptp(given[section]) > 0)
    cic[section] = detector.cic_e * scatter_map(_size(section), detector.flaws.cic_rms, _rng(detector, "cic"))
    return cic, detector.flaws.cic_rms > 0


def _stripes(detector: AnyDetector) -> FloatArray:
    stripes = _rng(detector, "stripes").standard_normal(detector.n_columns)
    stripes -= stripes.mean()
    return np.asarray(stripes * detector.stripe_rms_adu)
