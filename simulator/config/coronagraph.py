"""A coronagraph that is known by what it does to the star and to a planet: a table, maps, or a yield input package.

A table file has a heading and one row for each separation (CSV, ECSV, VOTable, FITS). Units stand in the names of its
columns, or in brackets behind them: ``separation [mas]``, ``core throughput [%]``. Maps, by place on the detector, are
arrays of an npz file or images of a FITS file, named as the columns of a table.

A yield input package is the folder of images that AYO, EXOSIMS, pyEDITH and yippy read: images of the star by its
diameter (``stellar_intens.fits``, ``stellar_intens_diam_list.fits``), of sources by their offset
(``offax_psf.fits``, ``offax_psf_offset_list.fits``) and of an even sky (``sky_trans.fits``): parts of the light on the
collecting area in each pixel, angles in lambda/D, the star at ``XCENTER, YCENTER``, counted from 0. Source of the
format: the readers of EXOSIMS (``process_opticalsys_package``) and of yippy 2.10.6, which agree on this.
"""

import functools
import hashlib
import logging
import math
import re
from collections.abc import Mapping
from dataclasses import field, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from catalogs import Column, Columns, RawColumn, RawTable, Rows, parse_table, read_bytes, read_rows
from cpic_core import (
    ArrayLike,
    FloatArray,
    InputError,
    NDArray,
    Record,
    digest_of,
    file_state,
    is_file,
    overlap_weights,
    read_file,
)
from simulator.config.base import nearest
from simulator.config.map_files import MapFile, array_number, header_number, pixel_scale, read_maps, real_map

KEY = "coronagraph.table"
_LOG = logging.getLogger(__name__)
MOST_BYTES, MOST_BYTES_OF_MAPS = 20_000_000, 200_000_000
_TINY = 1e-300


def _column(name: str, unit: str, low: float, high: float, description: str, aliases: str = "") -> Column:
    return Column(name, description, "float", unit, aliases, low, high)


COLUMNS = Columns(
    _column("separation_arcsec", "arcsec", 1e-6, 60.0, "from the star", "separation sep rarcsec ras angularseparation"),
    _column("separation_lambda_d", "", 1e-3, 1e5, "in lambda/D of the band", "rlamd rlambdad seplambdad rlod seplod"),
    _column(
        *("core_throughput", "", 0.0, 1.0, "light of a source in its core, over that on the clear pupil"),
        "corethruput corethrupt corethpt throughput corethroughputs",
    ),
    _column(
        *("raw_contrast", "", 0.0, 1.0, "starlight in a core there, over the light of the star in its core there"),
        "contrast corecontrast meanrawcontrast averagerawcontrast avgrawcontrast",
    ),
    _column(
        *("contrast_stability", "", 0.0, 1.0, "rms of what a subtraction leaves of it, in the same unit"),
        "stability deltacontrast deltac residualcontrast speckleresidual contrastfloor noisefloor",
    ),
    _column(
        *("occulter_transmission", "", 0.0, 1.0, "light of an extended source that passes, over the clear pupil"),
        "occtrans occultertrans occulttransmission occulttrans",
    ),
    _column(
        *("core_area_arcsec2", "arcsec2", 1e-12, 100.0, "area of the core on the sky"),
        "corearea areasqarcsec coreareasqarcsec areaarcsec2",
    ),
    _column("core_area_lambda_d2", "", 1e-3, 1e3, "in (lambda/D)^2 of the band", "corearealamd2 coreareaslod2"),
    _column("sky_transmission", "", 0.0, 1.0, "that of an even sky, where it is another than of dust around the star"),
    _column("speckle_variance_per_nm2", "", 0.0, 1e6, "variance of core sums between visits each 1 nm off: cross term"),
    _column("speckle_variance_per_nm4", "", 0.0, 1e6, "the same of the light of the wavefront's errors"),
    _column("noise_contrast", "", 0.0, 1.0, "mean starlight of the cores whose scatter is the noise of a source there"),
    _column("error_light_per_nm2", "", 0.0, 1.0, "light that wavefront errors of 1 nm rms scatter into these cores"),
    _column(
        "planet_left", "", 1e-3, 1.0, "part of a source's light that the mean of the background leaves in its core"
    ),
    _column("source_peak_pixel", "", 0.0, 1.0, "brightest pixel of a source"),
    _column(
        *("source_peak_step", "", 0.0, 1.0, "the same, of pixels as wide as the rows' step: contrasts are over it"),
        "psfpeak coremeanintensity",
    ),
    _column("star_peak_zone", "", 0.0, 1.0, "brightest pixel of the star in the zone"),
    _column("star_peak_columns", "", 0.0, 1.0, "brightest pixel of the star in detector columns through the zone"),
    _column("star_peak_frame", "", 0.0, 1.0, "brightest pixel of the star anywhere"),
    _column("star_register_tail", "", 0.0, 1.0, "largest mean of the star over pixels of a row that end at the zone"),
    _column("star_columns", "", 0.0, 1e4, "starlight of whole columns under a core on the diagonal"),
    _column("noise_fraction", "", 1e-3, 1.0, "sum of squared weights of the pixels of a core over its area"),
    _column("source_noise_fraction", "", 1e-3, 1.0, "the same, weighted by the light of a source"),
    _column(
        "filter_gain", "", 0.1, 10.0, "SNR of a source through a matched filter over that in its core, white noise"
    ),
    *(
        _column(f"filter_linear_{number}", "", 0.0, 1e3, "variance of the cross term through it over that in cores")
        for number in range(1, 6)
    ),
    _column("filter_square", "", 0.0, 1e3, "the same of the light of the wavefront's errors"),
    _column("filter_tails", "", 0.0, 1.0, "its excess kurtosis through the filter over that of a Laplace variate"),
    _column("filter_positions", "", 1e-3, 1e6, "pixels of filtered white noise that are worth one"),
    _column("filter_roughness", "", 1e-6, 1e3, "variance of its gradient over its variance, per square pixel"),
)
"""What a table may hold; light of the star and of sources is over that on the clear pupil."""
REQUIRED = (("separation_arcsec", "separation_lambda_d"), ("core_throughput",), ("raw_contrast",))
CONSTANT = (
    *("source_peak_pixel", "star_peak_zone", "star_peak_columns", "star_peak_frame", "star_register_tail"),
    *("noise_fraction", "source_noise_fraction"),
    *("filter_square", "filter_tails", "filter_positions", "filter_roughness"),
)
"""Columns of one value for all separations."""
_LOGARITHMIC = (
    "raw_contrast",
    "noise_contrast",
    "contrast_stability",
    "speckle_variance_per_nm2",
    "speckle_variance_per_nm4",
)
_IN_LAMBDA_D = re.compile(
    r"\s*\(?\s*(?:lambda|lam|λ|l)_?(?:0|c)?\s*/\s*D\s*\)?\s*(?:\^|\*\*)?\s*(2|²)?\s*", re.IGNORECASE
)
_SUFFIXES = {"mas": "mas", "mas2": "mas2", "percent": "%", "pct": "%", "uas": "uas"}


class CoronagraphTable(Record, eq=False):
    """A coronagraph in one band, by separation from the star; see `COLUMNS` for what the columns mean.

    Attributes
    ----------
    file : str
        Name of the file, without its folder.
    sha256 : str
        Of its content.
    separation_arcsec : ndarray, shape (s,)
        Ascending.
    columns : mapping of str to ndarray, shape (s,)
        Those that the file has, separations left out, areas in arcsec^2.
    notes : tuple of str
        Remarks on the reading: columns that are not used.
    origin : str
        What was read from where.
    maps : mapping of str to ndarray, shape (n, n)
        Columns that are known by place, ``[y, x]``, the star on the middle pixel; the columns are their means over
        rings.
    map_step_arcsec : float
        Pixel of the maps.
    """

    file: str
    sha256: str
    separation_arcsec: FloatArray
    columns: Mapping[str, FloatArray]
    notes: tuple[str, ...] = ()
    maps: Mapping[str, FloatArray] = field(default_factory=dict)
    map_step_arcsec: float = 0.0
    origin: str = ""

    def __contains__(self, name: str) -> bool:
        """Return whether the table has a column."""
        return name in self.columns

    def at(self, name: str, separation_arcsec: ArrayLike) -> FloatArray:
        """Return a column's value at separations: linear between rows, contrasts and variances in their logarithms.

        Beyond the first and last row it is theirs.

        Parameters
        ----------
        name : str
            A column that the table has.
        separation_arcsec : array_like
        """
        place, values = np.asarray(separation_arcsec, dtype=np.float64), self.columns[name]
        if name not in _LOGARITHMIC:
            return np.asarray(np.interp(place, self.separation_arcsec, values))
        return np.asarray(np.exp(np.interp(place, self.separation_arcsec, np.log(np.maximum(values, _TINY)))))

    def at_place(self, name: str, x_arcsec: ArrayLike, y_arcsec: ArrayLike) -> FloatArray:
        """Return the value of a column at places on the detector: of its map between the pixels, where there is one.

        Parameters
        ----------
        name : str
            A column that the table has.
        x_arcsec, y_arcsec : array_like
            Offset from the star.
        """
        x, y = np.broadcast_arrays(np.asarray(x_arcsec, np.float64), np.asarray(y_arcsec, np.float64))
        if name not in self.maps:
            return self.at(name, np.hypot(x, y))
        values = self.maps[name]
        middle = len(values) // 2
        row, column = (np.clip(part / self.map_step_arcsec + middle, 0.0, len(values) - 1.0) for part in (y, x))
        i, j = (np.minimum(part.astype(np.intp), len(values) - 2) for part in (row, column))
        p, q = row - i, column - j
        lower, upper = (values[i + k, j] * (1.0 - q) + values[i + k, j + 1] * q for k in (0, 1))
        return np.asarray(lower * (1.0 - p) + upper * p)

    def varies(self, name: str) -> bool:
        """Return whether a column has more than one value."""
        return bool(np.ptp(self.maps.get(name, self.columns[name])) > 0.0)

    def constant(self, name: str) -> float | None:
        """Return the value of a column that has one value for all separations; None where the table lacks it."""
        return float(self.columns[name][0]) if name in self.columns else None

    @property
    def core_area_arcsec2(self) -> float | None:
        """Mean area of the core; None where the table does not say."""
        return float(self.columns["core_area_arcsec2"].mean()) if "core_area_arcsec2" in self.columns else None

    @property
    def core_radius_arcsec(self) -> float | None:
        """Radius of a disc of that area."""
        area = self.core_area_arcsec2
        return None if area is None else math.sqrt(area / math.pi)


@functools.lru_cache(maxsize=1)
def shipped_tables() -> tuple[str, ...]:
    """Return the names of the tables that the package ships."""
    return tuple(sorted(path.stem for path in _folder().glob("*.csv")))


def _folder() -> Path:
    return Path(str(files("simulator") / "presets" / "coronagraph"))


def table_path(name: str) -> str:
    """Return the file of a table: a shipped one by its name, else the name itself."""
    return str(_folder() / f"{name}.csv") if name in shipped_tables() else name


def coronagraph_table(
    name: str,
    lambda_d_arcsec: float,
    *,
    diameter_m: float | None = None,
    is_stated: bool = False,
    aperture_arcsec: float | None = None,
    star_diameter_mas: float | None = None,
) -> CoronagraphTable:
    """Read the table of a band; the same file is read once.

    Parameters
    ----------
    name : str
        A file or folder, or the name of a shipped table.
    lambda_d_arcsec : float
        lambda/D of the file in the band.
    diameter_m : float, optional
        Its D, for words.
    is_stated : bool
        Whether that is said of the file; otherwise separations in arcsec and in lambda/D may be those of another.
    aperture_arcsec : float, optional
        Radius of the photometric aperture, for images; 0.7 lambda/D if not given.
    star_diameter_mas : float, optional
        Angular diameter of the star, for images.

    Raises
    ------
    InputError
        Naming file, row, column, value and range: it cannot be read, lacks a column or a cell, has fewer than two rows
        or two of one separation, or holds what no coronagraph does.
    """
    path = table_path(name)
    if not is_file(path) and is_package(path):
        aperture = 0.7 * lambda_d_arcsec if aperture_arcsec is None else aperture_arcsec
        states = tuple(_state(str(Path(path) / file)) for file in FILES)
        found = read_yield_package(path, states, lambda_d_arcsec, diameter_m, aperture, star_diameter_mas)
        for note in found.notes:
            _say(note)
        return found
    if Path(path).name in FILES:
        raise InputError(KEY, path, allowed="its folder, a yield input package")
    if star_diameter_mas is not None:
        allowed = "not given: only the images of a yield input package depend on it"
        raise InputError("coronagraph.star_diameter_mas", star_diameter_mas, unit="mas", allowed=allowed)
    return _read(path, _state(path), lambda_d_arcsec, diameter_m, is_stated)


def _state(path: str) -> tuple[int, int]:
    try:
        return file_state(path)
    except (OSError, ValueError):
        return (0, 0)  # reading says what is wrong


@functools.lru_cache(maxsize=64)
def _read(
    path: str, state: tuple[int, int], lambda_d_arcsec: float, diameter_m: float | None, is_stated: bool
) -> CoronagraphTable:
    if path.lower().endswith((".npz", ".fits", ".fit", ".fts")) and not _is_fits_table(path):
        return read_coronagraph_maps(path, lambda_d_arcsec)
    presets = ", ".join((*shipped_tables(), "the folder of a yield input package"))
    file = read_bytes(path, key=KEY, presets=presets)
    if len(file.data) > MOST_BYTES:
        raise InputError(KEY, file.name, allowed=f"a table of at most {MOST_BYTES} bytes")
    parsed = parse_table(file)
    raw = replace(parsed, columns=[_renamed(column) for column in parsed.columns])
    rows = read_rows(raw, COLUMNS, REQUIRED, about="separation_arcsec")
    _refuse_misspelt(raw)
    for where, row in rows:
        rows.refuse_missing(where, row, [(name,) for name in rows.headings])
    columns = {name: np.array([row[name] for row in rows.rows]) for name in rows.headings}
    if len(rows.rows) < 2:
        raise InputError(file.name, f"{len(rows.rows)} row", allowed="at least two separations")
    unit, notes = _unit(rows, columns, lambda_d_arcsec, diameter_m, is_stated)
    notes = (*notes, *_over_cores(rows, columns, unit))
    for name, power in (("separation", 1), ("core_area", 2)):
        arcsec, units = f"{name}_arcsec{'' if power == 1 else power}", f"{name}_lambda_d{'' if power == 1 else power}"
        if units in columns:
            columns.setdefault(arcsec, columns[units] * unit**power)
            del columns[units]
    order = np.argsort(columns["separation_arcsec"], kind="stable")
    columns = {name: values[order] for name, values in columns.items()}
    place = columns.pop("separation_arcsec")
    if (np.diff(place) <= 0).any():
        twice = float(place[:-1][np.diff(place) <= 0][0])
        raise InputError(f"{file.name} column separation", twice, unit="arcsec", allowed="every separation once")
    notes = (*rows.notes, *notes)
    for note in notes:
        _say(note)
    origin = ", ".join(f"{name} from {heading}" for name, heading in rows.headings.items())
    return checked(CoronagraphTable(file.name, file.sha256, place, columns, notes, origin=f"{file.name}: {origin}"))


def _unit(
    rows: Rows, columns: Mapping[str, FloatArray], lambda_d_arcsec: float, diameter_m: float | None, is_stated: bool
) -> tuple[float, tuple[str, ...]]:
    """Return lambda/D of a table, and a remark where its separations in arcsec and in lambda/D say another one."""
    unit, names = lambda_d_arcsec, rows.headings
    notes: tuple[str, ...] = ()
    if {"separation_arcsec", "separation_lambda_d"} <= columns.keys():
        both = f"{names['separation_arcsec']} and {names['separation_lambda_d']}"
        arcsec, units = columns["separation_arcsec"], columns["separation_lambda_d"]
        unit = float(arcsec @ units / (units @ units))
        share, key = unit / lambda_d_arcsec, f"{rows.label} columns"
        of = "" if diameter_m is None else f", that of a diameter of {diameter_m / share:.4g} m in this band"
        if np.abs(arcsec / units / unit - 1.0).max() > 0.05:
            raise InputError(key, both, allowed="one lambda/D in all rows, to 5 %", hint="leave one of the two out")
        if abs(share - 1.0) > (0.05 if is_stated else 0.25):
            hint = "leave one of the two out" + ("" if is_stated else ", or give coronagraph.diameter_m")
            hint = f"lambda/D of the file is {unit:.4g} arcsec{of}; {hint}"
            raise InputError(key, both, allowed=f"lambda/D = {lambda_d_arcsec:.4g} arcsec to 5 %", hint=hint)
        if is_stated or abs(share - 1.0) <= 0.01:
            unit = lambda_d_arcsec  # its cells are rounded
        else:
            notes = (f"{rows.label}: lambda/D of {both} is {unit:.4g} arcsec{of}; separations are those in arcsec",)
    if {"core_area_arcsec2", "core_area_lambda_d2"} <= columns.keys():
        both = f"{names['core_area_arcsec2']} and {names['core_area_lambda_d2']}"
        if np.abs(columns["core_area_arcsec2"] / columns["core_area_lambda_d2"] / unit**2 - 1.0).max() > 0.05:
            raise InputError(f"{rows.label} columns", both, allowed="the same to 5 %", hint="leave one of the two out")
    return unit, notes


def _over_cores(rows: Rows, columns: dict[str, FloatArray], unit: float) -> tuple[str, ...]:
    """Bring contrasts that are over the peak of a source over the light in its core, as ours are; say so.

    The light of the star in a core is contrast times peak times the pixels of the core, whose width is the step between
    two rows. Source: github.com/roman-corgi/cgi_noise 597dbfb, ``cginoiselib.py``, ``CGintmpix`` and ``CGintSamp``.
    """
    if "source_peak_step" not in columns:
        return ()
    heading, peak, core = rows.headings["source_peak_step"], columns.pop("source_peak_step"), columns["core_throughput"]
    least = float((peak / np.maximum(columns["raw_contrast"], _TINY)).min())
    if "core_area_arcsec2" not in columns or len(core) < 3 or least <= 1.0 or not core.all():
        allowed = "the peak of a source, beside its core's area in arcsec2 and throughput, in at least three rows"
        hint = "starlight of a pixel needs the pixel of its image: give raw_contrast instead" if least <= 1.0 else ""
        raise InputError(f"{rows.label} column {heading}", float(peak.min()), allowed=allowed, hint=hint)
    # Those in lambda/D are less rounded.
    place = columns["separation_lambda_d"] * unit if "separation_lambda_d" in columns else columns["separation_arcsec"]
    step = float(np.diff(np.sort(place))[1])
    factor = peak * columns["core_area_arcsec2"] / step**2 / core
    for name in ("raw_contrast", "contrast_stability"):
        if name in columns:
            columns[name] = columns[name] * factor
    times = f"{factor.min():.3g} to {factor.max():.3g} times the file's"
    return (f"{rows.label}: contrasts are over {heading}, of pixels of {step:.3g} arcsec; over cores they are {times}",)


@functools.lru_cache(maxsize=64)
def _say(note: str) -> None:
    """Say once for a file what was not read of it: every band of one file reads it."""
    _LOG.warning("%s", note)


def _is_fits_table(path: str) -> bool:
    """Return whether a file is FITS with a table and no image."""
    data = read_file(path, key=KEY, allowed="a readable file", max_bytes=MOST_BYTES_OF_MAPS)
    return data.startswith(b"SIMPLE  =") and b"XTENSION= 'BINTABLE'" in data and b"XTENSION= 'IMAGE" not in data


def sha256_of(data: bytes) -> str:
    """Return the sha256 of the content of a file, in hexadecimal digits."""
    return hashlib.sha256(data).hexdigest()


def checked(table: CoronagraphTable) -> CoronagraphTable:
    """Return a table whose arrays stay as they are, if it is one of a coronagraph.

    Raises
    ------
    InputError
        For what no coronagraph does.
    """
    _check(table.file, table.separation_arcsec, table.columns)
    for values in (table.separation_arcsec, *table.columns.values(), *table.maps.values()):
        values.flags.writeable = False
    return table


def _check(name: str, place: FloatArray, columns: Mapping[str, FloatArray]) -> None:
    """Refuse what no coronagraph does."""
    core = columns["core_throughput"]
    if not core.any():
        raise InputError(f"{name} column core_throughput", 0, allowed="above 0 at one separation at least")
    for other in ("occulter_transmission", "sky_transmission"):
        if other in columns and (core > columns[other] * (1.0 + 1e-6) + 1e-9).any():
            worst = int((core - columns[other]).argmax())
            allowed = f"at least core_throughput, {core[worst]:g} at {place[worst]:.4g} arcsec"
            raise InputError(f"{name} column {other}", float(columns[other][worst]), allowed=allowed)
    for one in CONSTANT:
        if one in columns and np.ptp(columns[one]) > 0:
            raise InputError(f"{name} column {one}", float(columns[one].max()), allowed="the same value in every row")


def _renamed(column: RawColumn) -> RawColumn:
    """Return a column whose heading says lambda/D or a unit as a suffix, in the names and units of `COLUMNS`."""
    heading, unit = column.heading, column.unit
    if COLUMNS.meant_by(heading)[0] is not None and not re.search(r"[\[(].*[\])]\s*$", heading) and not unit:
        return column
    if not unit and (found := re.fullmatch(r"\s*(.*\w.*?)\s*(?:\[(.*)\]|\((.*)\))\s*", heading)):
        heading, unit = found[1], (found[2] or found[3] or "").strip()
    if found := _IN_LAMBDA_D.fullmatch(unit):
        bare = re.sub(r"_(?:arcsec|as)2?$", "", heading)
        return replace(column, heading=f"{bare}_lambda_d{'2' if found[1] else ''}", unit="")
    ending = heading.lower().rsplit("_", 1)
    if not unit and len(ending) == 2 and ending[1] in _SUFFIXES:
        heading, unit = heading[: -len(ending[1]) - 1], _SUFFIXES[ending[1]]
    return replace(column, heading=heading, unit=unit)


def _refuse_misspelt(raw: RawTable) -> None:
    """Refuse a column that is nearly one of ours: what it says would be left out."""
    for column in raw.columns:
        meant: Any = COLUMNS.meant_by(column.heading)[0]
        if meant is None and column.heading and (hint := nearest(column.heading.lower(), _near(column.heading))):
            raise InputError(f"{raw.name} column", column.heading, allowed="columns that are known", hint=hint)


def _near(heading: str) -> list[str]:
    """Return the names that a heading differs from by a letter or two."""
    import difflib

    return difflib.get_close_matches(heading.lower(), list(COLUMNS), n=3, cutoff=0.85)


_SIDES = (9, 4001)
_MAPS = tuple(
    name
    for name in COLUMNS
    if name not in CONSTANT and not name.startswith(("separation", "star_columns", "source_peak"))
)
_SQUARES = ("contrast_stability", "speckle_variance_per_nm2", "speckle_variance_per_nm4")
_EDGES = ("inner_arcsec", "outer_arcsec", "inner_lambda_d", "outer_lambda_d")
_SCALES = ("pixel_scale_arcsec", "pixel_scale_lambda_d")


def read_coronagraph_maps(path: str, lambda_d_arcsec: float) -> CoronagraphTable:
    """Read the maps of a band: a table of their means over rings, with the maps beside it.

    Parameters
    ----------
    path : str
    lambda_d_arcsec : float
        lambda/D of the band.

    Raises
    ------
    InputError
        If the file cannot be read, lacks a map or the scale, or a map is not square of one odd side, out of range or
        not finite.
    """
    name = Path(path).name
    data = read_file(path, key=KEY, allowed="a readable FITS or npz file", max_bytes=MOST_BYTES_OF_MAPS)
    file = read_maps(KEY, path)
    maps, side = {}, 0
    for column in _MAPS:
        found = file.named(column)
        if found is not None and found.data.ndim:
            maps[column] = real_map(f"{name} {column}", name, found.data, sides=_SIDES)
            side = side or len(maps[column])
            _check_map(name, column, maps[column], side)
    for group in REQUIRED[1:]:
        if not any(one in maps for one in group):
            raise InputError(f"{name} map {group[0]}", "missing", allowed=f"an array or image of the name {group[0]}")
    numbers = _numbers(name, path, file)
    if "pixel_scale_lambda_d" in numbers:
        step = numbers["pixel_scale_lambda_d"] * lambda_d_arcsec
    elif "pixel_scale_arcsec" in numbers:
        step = numbers["pixel_scale_arcsec"]
    else:
        raise InputError(f"{name} pixel_scale_arcsec", "missing", unit="arcsec", allowed="or pixel_scale_lambda_d")
    if not step > 0:
        raise InputError(f"{name} pixel_scale_arcsec", step, unit="arcsec", allowed="above 0")
    if "core_area_lambda_d2" in maps:
        maps.setdefault("core_area_arcsec2", maps.pop("core_area_lambda_d2") * lambda_d_arcsec**2)
    offset = np.arange(side) - side // 2
    ring = np.hypot(offset[:, None], offset)
    rings = {column: _means(values, ring, squares=column in _SQUARES) for column, values in maps.items()}
    place = np.asarray(step * np.arange(side // 2), np.float64)
    inner, outer = _edges(numbers, place, rings["core_throughput"], lambda_d_arcsec)
    kept = (place >= inner - 0.5 * step) & (place <= outer + 0.5 * step) & (place > 0)
    if np.count_nonzero(kept) < 2:
        allowed = f"an inner and an outer edge with two pixels between them, 0 to {place[-1]:.4g} arcsec"
        raise InputError(f"{name} inner_arcsec, outer_arcsec", (inner, outer), unit="arcsec", allowed=allowed)
    columns = {column: values[kept] for column, values in rings.items()}
    columns |= {one: np.full(kept.sum(), numbers[one]) for one in CONSTANT if one in numbers}
    return checked(CoronagraphTable(name, sha256_of(data), place[kept], columns, (), maps, step))


def _check_map(name: str, column: str, values: FloatArray, side: int) -> None:
    limits = COLUMNS[column]
    if len(values) != side or side % 2 == 0:
        allowed = "square maps of one odd side, the star on the middle pixel"
        raise InputError(f"{name} map {column}", f"{len(values)} pixels a side", allowed=allowed)
    if (values.min() < limits.low and values.min() != 0.0) or values.max() > limits.high:
        worst = float(values.min() if values.min() < limits.low else values.max())
        raise InputError(f"{name} map {column}", worst, unit=limits.unit, allowed=limits.range)


def _numbers(name: str, path: str, file: MapFile) -> dict[str, float]:
    """Return the scale, edges and constants of the file: arrays of one number, or cards of the header."""
    found: dict[str, float] = {}
    for key in (*_SCALES, *_EDGES, *CONSTANT):
        item = file.named(key)
        number = array_number(f"{name} {key}", path, item) if item is not None and item.data.size == 1 else None
        if number is not None:
            found[key] = number
    if file.is_fits:
        header = file.maps[0].header
        for key, card in zip((*_EDGES, _SCALES[1]), ("INNER", "OUTER", "INNERLD", "OUTERLD", "PIXLD"), strict=True):
            value = header_number(KEY, path, header, card)
            if value is not None:
                found[key] = value
        scale = pixel_scale(KEY, path, header)
        if scale is not None and _SCALES[1] not in found:
            found[_SCALES[0]] = scale
    return found


def _edges(
    numbers: Mapping[str, float], place: FloatArray, core: FloatArray, lambda_d_arcsec: float
) -> tuple[float, float]:
    """Return the separations of the search for planets: from half of the largest core to the edge of the map."""
    most = float(place[-1])
    first = float(place[int(np.argmax(core >= 0.5 * core.max()))])
    inner = numbers.get("inner_arcsec", numbers.get("inner_lambda_d", math.nan) * lambda_d_arcsec)
    outer = numbers.get("outer_arcsec", numbers.get("outer_lambda_d", math.nan) * lambda_d_arcsec)
    return (first if math.isnan(inner) else inner), min(most, most if math.isnan(outer) else outer)


def _means(values: FloatArray, ring: FloatArray, *, squares: bool) -> FloatArray:
    """Return the means over rings one pixel wide, of rms values of their squares."""
    number = np.rint(ring).astype(int).ravel()
    weights = (values**2 if squares else values).ravel()
    mean = (np.bincount(number, weights) / np.bincount(number))[: len(values) // 2]
    return np.asarray(np.sqrt(mean) if squares else mean)


STAR, DIAMETERS = "stellar_intens.fits", "stellar_intens_diam_list.fits"
SOURCES, OFFSETS = "offax_psf.fits", "offax_psf_offset_list.fits"
SKY = "sky_trans.fits"
FILES = (STAR, DIAMETERS, SOURCES, OFFSETS, SKY)
_CUT, _STEP = 4, 0.05
"""Parts into which a pixel is cut along each axis for means over rings, and width of the rings in pixels."""
_ROW_LAMBDA_D, _TURNS = 0.05, 360
_ROUNDING, _LEAST_SHIFT, _MOST_SHIFT = 1e-3, 0.1, 1.5


def is_package(path: str) -> bool:
    """Return whether a path is a folder with at least one of the files of a yield input package."""
    return any(is_file(Path(path) / name) for name in FILES)


@functools.lru_cache(maxsize=16)
def read_yield_package(
    path: str,
    states: tuple[Any, ...],
    lambda_d_arcsec: float,
    diameter_m: float | None,
    aperture_arcsec: float,
    star_diameter_mas: float | None,
) -> CoronagraphTable:
    """Read the table of a coronagraph from its images.

    The core throughput is the light of a source in an aperture around it, exact for light that is even within a pixel;
    between the offsets it is linear, and beyond the first and last one, or where the aperture would leave the images,
    the table ends. Starlight and sky are means over all position angles, every 0.05 lambda/D; between two diameters
    of the star they are linear. Offsets in two dimensions give means over circles.

    Parameters
    ----------
    path : str
        The folder.
    states : tuple
        What changes with its files: the same is read once.
    lambda_d_arcsec : float
        lambda/D of the images.
    diameter_m : float, optional
        The D of that lambda/D: what the images were made for is compared with it.
    aperture_arcsec : float
        Radius of the photometric aperture.
    star_diameter_mas : float, optional
        Angular diameter of the star; the smallest of the package if not given.

    Raises
    ------
    InputError
        Naming file, card, value and range: a file is missing or damaged, two do not belong together, or the images are
        none of a coronagraph.
    """
    folder = Path(path)
    lacking = [name for name in FILES if not is_file(folder / name)]
    if lacking:
        allowed = f"the folder of a yield input package: {', '.join(FILES)}"
        raise InputError(KEY, path, allowed=allowed, hint=f"without {', '.join(lacking)}")
    star = None if star_diameter_mas is None else round(1e-3 * star_diameter_mas / lambda_d_arcsec, 9)
    found, header = _measured(path, states, round(aperture_arcsec / lambda_d_arcsec, 9), star)
    notes = found.notes + _another_telescope(found.file, header, lambda_d_arcsec, diameter_m)
    return checked(replace(found, separation_arcsec=found.separation_arcsec * lambda_d_arcsec, notes=notes))


@functools.lru_cache(maxsize=8)
def _measured(
    path: str, states: tuple[Any, ...], aperture_lambda_d: float, star_lambda_d: float | None
) -> tuple[CoronagraphTable, Mapping[str, Any]]:
    """Return the table with its separations in lambda/D, which all bands share, and the header of the star's images."""
    folder = Path(path)
    sources, header = _images(folder / SOURCES, 3)
    stars, star_header = _images(folder / STAR, 3)
    sky, sky_header = _images(folder / SKY, 2)
    pixel = _pixel(folder / STAR, star_header, None)
    for name, cards in ((SOURCES, header), (SKY, sky_header)):
        _pixel(folder / name, cards, pixel)
    diameters = _list(folder / DIAMETERS, len(stars)).reshape(-1)
    diameter, star = _star_of(folder / DIAMETERS, stars, diameters, star_lambda_d)
    radius = aperture_lambda_d / pixel
    offsets, centre, shift = _places(folder, sources, _list(folder / OFFSETS, len(sources)), header, pixel)
    x, y = (centre + shift + offsets / pixel).T
    # Another convention of the centre is that of all files that state the same.
    middles = [
        np.add(own, shift) if np.allclose(own := _centre(folder / name, image, cards), centre) else np.asarray(own)
        for name, image, cards in ((STAR, star, star_header), (SKY, sky, sky_header))
    ]
    cores = [_around(image, right, up, radius) for image, right, up in zip(sources, x, y, strict=True)]
    separation, core = _rings(offsets, np.array([math.nan if cut is None else cut[0].sum() for cut in cores]))
    rooms = (_room(folder / name, image, at) for name, image, at in zip((STAR, SKY), (star, sky), middles, strict=True))
    reach = min(rooms) - radius
    whole = separation <= reach * pixel
    if np.count_nonzero(core[whole] > 0) < 2:
        allowed = f"two offsets, with light, whose apertures of {aperture_lambda_d:.3g} lambda/D are on the images"
        raise InputError(KEY, str(folder / OFFSETS), allowed=allowed)
    separation, core = separation[whole], core[whole]
    steps = np.arange(separation[0], separation[-1], _ROW_LAMBDA_D)
    place = np.unique(np.concatenate([separation, steps]).round(9))
    core = np.interp(place, separation, core)
    light, through = (
        _ring_means(image, at, place / pixel, radius) for image, at in zip((star, sky), middles, strict=True)
    )
    through /= math.pi * radius**2
    if through.max() > 1.05:
        raise InputError(f"{KEY} {SKY}", float(through.max()), allowed="0 to 1: the part of an even sky's light")
    # Where the aperture holds the star, or it is brighter than a source of its own light, nobody looks for planets.
    good = (core > 0) & (light <= core) & (place > aperture_lambda_d)
    best, lost = int(np.where(good, core, -1.0).argmax()), np.flatnonzero(~good)
    edge = int(np.searchsorted(lost, best))
    kept = slice(int(lost[edge - 1]) + 1 if edge else 0, int(lost[edge]) if edge < len(lost) else None)
    if len(place[kept]) < 2:
        raise InputError(KEY, str(folder / STAR), allowed="a star fainter behind the mask than a source beside it")
    place, core, light, through = place[kept], core[kept], light[kept], np.minimum(through[kept], 1.0)
    origin = (
        f"{folder.name}, a yield input package: core_throughput from {SOURCES} ({len(sources)} offsets), raw_contrast "
        f"from it and {STAR} (star of {diameter:.3g} lambda/D), in apertures of {aperture_lambda_d:.3g} lambda/D at "
        f"{place[0]:.3g} to {place[-1]:.3g} lambda/D; occulter_transmission from {SKY}; not used: the images themselves"
    )
    moved = (
        f"{folder.name}: sources are {shift[0]:+.2f}, {shift[1]:+.2f} pixels from where {SOURCES} says; moved by that"
    )
    notes = (moved,) * bool(shift.any())
    columns = {"core_throughput": core, "raw_contrast": light / core, "occulter_transmission": through}
    digest = sha256_of("".join(digest_of(folder / name) for name in FILES).encode())
    return CoronagraphTable(folder.name, digest, place, columns, notes, origin=origin), star_header


def _another_telescope(
    name: str, header: Mapping[str, Any], lambda_d_arcsec: float, diameter_m: float | None
) -> tuple[str, ...]:
    """Return a remark where band or diameter are none that the images were made for, as far as the header says."""
    cards = (header_number(f"{KEY} {STAR}", name, header, card) for card in ("MINLAM", "MAXLAM", "D"))
    low, high, made_m = (math.nan if value is None else value for value in cards)
    low, high = (1e3 * edge if edge < 10.0 else edge for edge in (low, high))  # in um by EXOSIMS, or in nm
    if diameter_m is None:
        return ()
    nm = 1e9 * diameter_m * math.radians(lambda_d_arcsec / 3600.0)
    if not (nm < 0.99 * low or nm > 1.01 * high or abs(made_m / diameter_m - 1.0) > 0.01):
        return ()
    made = [f"{low:.4g} to {high:.4g} nm"] * (low <= high) + [f"a diameter of {made_m:.4g} m"] * (made_m > 0)
    taken = f"its lambda/D is taken for that of {nm:.4g} nm and {diameter_m:.4g} m"
    return (f"{name}: made for {' and '.join(made)}; {taken}",)


def _images(path: Path, dimensions: int) -> tuple[FloatArray, Mapping[str, Any]]:
    """Return square images of parts of light and their header."""
    found = read_maps(KEY, path).maps[0]
    data = np.asarray(found.data)
    if data.ndim != dimensions or data.shape[-1] != data.shape[-2] or data.dtype.kind not in "fiu":
        allowed = "a cube of square images" if dimensions == 3 else "one square image"
        raise InputError(KEY, str(path), allowed=allowed, hint=f"{data.dtype.name} of shape {data.shape}")
    images = data.astype(np.float64)
    worst = float(images.min())
    if not np.isfinite(images).all() or worst < -_ROUNDING * float(images.max()):
        raise InputError(KEY, str(path), allowed="finite values, none negative", hint=f"the least is {worst:.3g}")
    most = float(images.sum(axis=(-2, -1)).max()) if dimensions == 3 else 0.0
    if most > 1.0 + _ROUNDING:
        raise InputError(KEY, str(path), allowed="parts of the light: a sum of at most 1", hint=f"it is {most:.6g}")
    return np.maximum(images, 0.0, out=images), found.header


def _list(path: Path, number: int) -> FloatArray:
    """Return a list of one or two numbers for each image, ``(number, 1)`` or ``(number, 2)``."""
    data = np.asarray(read_maps(KEY, path).maps[0].data)
    rows = data.reshape(-1, 1) if data.size == number else data.T if data.shape == (2, number) != (2, 2) else data
    if rows.ndim != 2 or rows.shape[0] != number or rows.shape[1] > 2 or rows.dtype.kind not in "fiu":
        raise InputError(KEY, str(path), allowed=f"a number for each of {number} images", hint=f"shape {data.shape}")
    if not np.isfinite(rows).all():
        raise InputError(KEY, str(path), allowed="finite numbers")
    return rows.astype(np.float64)


def _pixel(path: Path, header: Mapping[str, Any], other: float | None) -> float:
    """Return the pixel in lambda/D; that of another file where this one does not say, and no other."""
    said = header_number(f"{KEY} {path.name}", path, header, "PIXSCALE")
    pixel = other if said is None else said
    allowed = "above 0 lambda/D" if other is None else f"{other:g} lambda/D, as in {STAR}"
    if pixel is None or not pixel > 0 or abs(pixel / (other or pixel) - 1.0) > _ROUNDING:
        raise InputError(f"{KEY} {path.name} PIXSCALE", "missing" if pixel is None else pixel, allowed=allowed)
    return pixel


def _centre(path: Path, image: FloatArray, header: Mapping[str, Any]) -> tuple[float, float]:
    """Return the star's place ``(x, y)``, pixel centres at whole numbers from 0; ``n / 2`` where no card says it."""
    cards = (header_number(f"{KEY} {path.name}", path, header, f"{axis}CENTER") for axis in "XY")
    x, y = (image.shape[-1] / 2 if value is None else value for value in cards)
    return x, y


def _room(path: Path, image: FloatArray, centre: FloatArray) -> float:
    """Return the largest circle around the star on an image, in pixels."""
    x, y = (float(part) for part in centre)
    room = float(min(x, y, len(image) - 1 - x, len(image) - 1 - y)) + 0.5
    if room <= 1.0:
        raise InputError(f"{KEY} {path.name} XCENTER, YCENTER", (x, y), unit="px", allowed="a pixel of the image")
    return room


def _star_of(
    path: Path, stars: FloatArray, diameters: FloatArray, asked_lambda_d: float | None
) -> tuple[float, FloatArray]:
    """Return the diameter of the star in lambda/D and its image, linear between two diameters."""
    order = np.argsort(diameters, kind="stable")
    least, most = (float(diameters[order[at]]) for at in (0, -1))
    asked = least if asked_lambda_d is None else asked_lambda_d
    if not least <= asked <= most:
        allowed = f"{least:g} to {most:g} lambda/D, those of {path.name}"
        raise InputError("coronagraph.star_diameter_mas", f"{asked:.4g} lambda/D", allowed=allowed)
    weights = [float(np.interp(asked, diameters[order], row)) for row in np.eye(len(order))]
    return asked, np.tensordot(weights, stars[order], axes=1)


def _places(
    folder: Path, sources: FloatArray, listed: FloatArray, header: Mapping[str, Any], pixel: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the offsets ``(n, 2)`` in lambda/D, the stated centre, and how far sources are from there, in pixels.

    One number for each image is an offset along x, or along y where the light is there. Where the brightest source is
    not quite where centre and offset put it, the difference is that of all: it is the convention of the centre.
    """
    centre = np.array(_centre(folder / SOURCES, sources, header))
    number = int(sources.max(axis=(1, 2)).argmax())
    image = sources[number]
    if not image.any():
        raise InputError(KEY, str(folder / SOURCES), allowed="images of sources with light in them")
    seen = np.array(np.unravel_index(int(image.argmax()), image.shape)[::-1], np.float64)
    for _ in range(20):  # the middle of the light around the middle
        cut = _around(image, seen[0], seen[1], 1.0 / pixel)
        if cut is None:
            break
        light, rows, columns = cut
        seen = np.array([(light.sum(axis=0) * columns).sum(), (light.sum(axis=1) * rows).sum()]) / light.sum()
    zeros = np.zeros_like(listed)
    forms = [listed] if listed.shape[1] == 2 else [np.hstack([listed, zeros]), np.hstack([zeros, listed])]
    offsets = min(forms, key=lambda form: float(np.hypot(*(seen - centre - form[number] / pixel))))
    shift = seen - centre - offsets[number] / pixel
    if np.hypot(*shift) > max(_MOST_SHIFT, 0.5 / pixel):
        at, stated = (f"[{x:.2f}, {y:.2f}]" for x, y in (seen, seen - shift))
        hint = f"image {number} is brightest at {at}; centre and {OFFSETS} put its source at {stated}"
        raise InputError(f"{KEY} {SOURCES} XCENTER, YCENTER", tuple(centre), unit="px", allowed="the star", hint=hint)
    return offsets, centre, shift * (float(np.hypot(*shift)) > _LEAST_SHIFT)


def _around(
    image: FloatArray, x: float, y: float, radius: float
) -> tuple[FloatArray, NDArray[np.intp], NDArray[np.intp]] | None:
    """Return the light in an aperture, its rows and columns, in pixels; None where it is not whole on the image."""
    column, row = round(float(x)), round(float(y))
    weights = overlap_weights(radius, float(y) - row, float(x) - column)
    used = [np.asarray(weights.max(axis=axis) > 0) for axis in (1, 0)]
    weights = weights[np.ix_(*used)]
    rows, columns = (at + np.flatnonzero(one) - len(one) // 2 for at, one in zip((row, column), used, strict=True))
    if min(rows[0], columns[0]) < 0 or max(rows[-1], columns[-1]) >= len(image):
        return None
    return weights * image[np.ix_(rows, columns)], rows, columns


def _rings(offsets: FloatArray, light: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return separations, ascending, and the mean light of the sources there; those whose light is nan are left out.

    Where the offsets are those of one quadrant, each stands for its mirror images too; between them light is linear.
    """
    axes = [np.unique(part[part > 0]) for part in np.abs(offsets.T)]
    if min(map(len, axes)) == 0:  # on a line through the star
        at, number = np.unique(np.hypot(*offsets.T).round(9), return_inverse=True)
        mean = np.bincount(number, light) / np.bincount(number)
    else:
        from scipy.interpolate import LinearNDInterpolator

        signs = [(1, 1), (-1, 1), (1, -1), (-1, -1)] if offsets.min() >= 0 else [(1, 1)]
        points, first = np.unique(np.concatenate([offsets * sign for sign in signs]), axis=0, return_index=True)
        between = LinearNDInterpolator(points, np.tile(light, len(signs))[first])
        step = min(float(np.diff([0.0, *axis]).min()) for axis in axes)
        at = step * np.arange(1, math.ceil(float(np.abs(offsets).max()) / step) + 1)
        turns = np.linspace(0.0, 2.0 * math.pi, _TURNS, endpoint=False)
        mean = between(at[:, None] * np.cos(turns), at[:, None] * np.sin(turns)).mean(axis=1)
    kept = np.isfinite(mean)
    return at[kept], mean[kept]


def _ring_means(image: FloatArray, centre: FloatArray, separation: FloatArray, radius: float) -> FloatArray:
    """Return the means over all position angles of the light in apertures at separations, all in pixels.

    A point at r from the star is in the aperture at s for the part ``arccos((r^2 + s^2 - a^2) / 2 r s) / pi`` of the
    angles; a pixel counts in 16 parts.
    """
    part = (np.arange(len(image) * _CUT) + 0.5) / _CUT - 0.5
    distance = np.hypot(part[:, None] - centre[1], part - centre[0])
    each = np.repeat(np.repeat(image, _CUT, axis=0), _CUT, axis=1) / _CUT**2
    light = np.bincount(np.rint(distance / _STEP).astype(np.intp).ravel(), each.ravel())
    r = np.maximum(_STEP * np.arange(len(light)), 1e-9)
    means = np.empty(len(separation))
    for number, s in enumerate(np.maximum(separation, 1e-9)):
        near = slice(max(int((s - radius) / _STEP) - 1, 0), int((s + radius) / _STEP) + 2)
        cosine = (r[near] ** 2 + s**2 - radius**2) / (2.0 * r[near] * s)
        means[number] = (np.arccos(np.clip(cosine, -1.0, 1.0)) / math.pi) @ light[near]
    return means
