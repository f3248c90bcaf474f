"""A coronagraph as a table: what it does to the star and to a planet, by their separation.

A file has a heading and one row for each separation (CSV, ECSV, VOTable, FITS). Units stand in the names of its
columns, or in brackets behind them: ``separation [mas]``, ``core throughput [%]``. A folder is a yield input package
(`simulator.config.yield_package`).
"""

import functools
import hashlib
import logging
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from catalogs import Column, Columns, RawColumn, RawTable, Rows, parse_table, read_bytes, read_rows
from cpic_core import ArrayLike, FloatArray, InputError, file_state, is_file, read_file
from simulator.config.base import nearest

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


@dataclass(frozen=True, eq=False)
class CoronagraphTable:
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
    from simulator.config.yield_package import FILES, is_package, read_yield_package

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
        from simulator.config.coronagraph_maps import read_coronagraph_maps

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
