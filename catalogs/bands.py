"""The observing bands: centre, width, optical transmission and quantum efficiency, each with its source."""

import functools
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from catalogs.spectra import Curve
from cpic_core import ArrayLike, InputError, Provenance, load_yaml, read_file, split_sourced

#: The two cameras.
CAMERAS = ("VIS", "NIR")

_FILE = Path(__file__).resolve().parent / "data" / "bands.yaml"
_MAX_BYTES = 4_000_000
LENGTHS_NM = {"nm": 1.0, "um": 1e3, "micron": 1e3, "microns": 1e3, "angstrom": 0.1, "angstroms": 0.1} | {
    prefix + metres: scale
    for prefix, scale in (("nano", 1.0), ("micro", 1e3))
    for metres in ("meter", "meters", "metre", "metres")
}
"""Nanometres in the units of wavelength that files name, in small letters."""
_ALLOWED = "nm, um, Angstrom"
_OTHER_UNITS = frozenset(("m", "cm", "mm", "pm", "hz", "ghz", "thz", "ev"))
_STRUCTURED = (b"SIMPLE  =", b"<?xml", b"<VOTABLE", b"# %ECSV")


@dataclass(frozen=True, eq=False)
class Band:
    """One observing band.

    Two bands are equal when all their numbers are; a band can be a dictionary key.

    Attributes
    ----------
    name : str
        Band name, for example ``F662``.
    camera : {"VIS", "NIR"}
        The camera that sees it.
    center_nm, width_nm : float
        Centre and full width; the edges of the top-hat when there is no curve.
    t_opt : float
        Mirrors, relay, DM reflectivity, filter and window, 0 < t_opt <= 1, the same at all wavelengths.
    qe : float
        Detector quantum efficiency, e-/ph, 0 < qe <= 1, constant over the band.
    curve : Curve, optional
        Filter transmission that replaces the top-hat.

    Raises
    ------
    InputError
        If a number is outside its range.
    """

    name: str
    camera: str
    center_nm: float
    width_nm: float
    t_opt: float
    qe: float
    curve: Curve | None = None

    def __post_init__(self) -> None:
        if self.camera not in CAMERAS:
            raise InputError(f"{self.name}.camera", self.camera, allowed=", ".join(CAMERAS))
        _in_range(f"{self.name}.center_nm", self.center_nm, "nm", 0.0, 1e5)
        _in_range(f"{self.name}.width_nm", self.width_nm, "nm", 0.0, 2.0 * self.center_nm)
        _in_range(f"{self.name}.t_opt", self.t_opt, "", 0.0, 1.0)
        _in_range(f"{self.name}.qe", self.qe, "e-/ph", 0.0, 1.0)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Band) and self._content() == other._content()

    def __hash__(self) -> int:
        return hash(self._content())

    @property
    def support_nm(self) -> tuple[float, float]:
        """Wavelengths outside which nothing is transmitted."""
        if self.curve is None:
            return self.center_nm - 0.5 * self.width_nm, self.center_nm + 0.5 * self.width_nm
        return float(self.curve.wavelength_nm[0]), float(self.curve.wavelength_nm[-1])

    def filter_transmission(self, wavelength_nm: ArrayLike) -> np.ndarray:
        """Return the filter shape: top-hat of height 1, or the curve; zero outside."""
        wavelength = np.asarray(wavelength_nm, dtype=np.float64)
        if self.curve is None:
            low, high = self.support_nm
            return np.where((wavelength >= low) & (wavelength <= high), 1.0, 0.0)
        left_of, height = self.curve.wavelength_nm, self.curve.transmission
        return np.asarray(np.interp(wavelength, left_of, height, left=0.0, right=0.0))

    def quantum_efficiency(self, wavelength_nm: ArrayLike) -> np.ndarray:
        """Return the quantum efficiency (e-/ph), constant over the band."""
        return np.full(np.shape(wavelength_nm), self.qe)

    def transmission(self, wavelength_nm: ArrayLike) -> np.ndarray:
        """Return detected electrons per photon that reaches the telescope: ``t_opt`` x filter x QE."""
        return np.asarray(self.t_opt * self.filter_transmission(wavelength_nm) * self.quantum_efficiency(wavelength_nm))

    def _content(self) -> tuple[object, ...]:
        curve = () if self.curve is None else (self.curve.wavelength_nm.tobytes(), self.curve.transmission.tobytes())
        return self.name, self.camera, self.center_nm, self.width_nm, self.t_opt, self.qe, curve


def load_bands() -> dict[str, Band]:
    """Return the eight shipped bands by name, in order of wavelength; the dictionary is yours to change."""
    return dict(_load()[0])


def band_provenance() -> dict[str, Provenance]:
    """Return unit, source and confidence of every number, keyed like ``F662.width_nm``."""
    return dict(_load()[1])


def band_from_file(
    path: str | Path, name: str, *, t_opt: float, qe: float, camera: str = "VIS", unit: str | None = None
) -> Band:
    """Read a filter transmission curve from a file of two columns.

    Columns are wavelength and transmission, 0 to 1 or in percent where the heading says ``%``. A text file separates
    them by blanks or a comma; ``#`` starts a comment. The wavelength unit is stated by ``unit``, or as a word of the
    heading or of a comment; in an ECSV, VOTable or FITS table, by its column. Zeros beyond the ends are left out.

    Parameters
    ----------
    path : str or Path
        The file.
    name : str
        Band name.
    t_opt, qe : float
        Transmission of everything else, and quantum efficiency, both over 0 to 1.
    camera : {"VIS", "NIR"}
        The camera that sees it.
    unit : {"nm", "um", "Angstrom"}, optional
        Wavelength unit; overrides the file.

    Returns
    -------
    Band
        Centre: transmission-weighted mean wavelength. Width: area divided by the peak.

    Raises
    ------
    InputError
        If the file cannot be read, the unit is not stated, or values are not finite, wavelengths do not
        increase, or transmissions are negative, above 1 or all zero.
    """
    data = read_file(path, key="file", allowed="a readable file", max_bytes=_MAX_BYTES)
    read = _structured if data.lstrip().startswith(_STRUCTURED) else two_columns
    wavelength_nm, transmission, said = read(data, str(path))
    wavelength_nm = wavelength_nm * _unit_scale(unit or said, str(path))
    if any("%" in line for line in said.splitlines() if not line.startswith("#")):
        transmission = transmission / 100.0
    if not (wavelength_nm[0] > 0.0 and np.all(np.diff(wavelength_nm) > 0.0)):
        raise InputError(f"{path}: wavelength", "not increasing", allowed="positive, strictly increasing wavelengths")
    good = (transmission >= 0.0) & (transmission <= 1.0)
    if not good.all() or not transmission.any():
        worst = 0.0 if good.all() else float(transmission[~good][0])
        raise InputError(f"{path}: transmission", worst, allowed="0 to 1, not all zero")
    open_at = np.flatnonzero(transmission)
    part = slice(max(open_at[0] - 1, 0), open_at[-1] + 2)
    wavelength_nm, transmission = wavelength_nm[part].copy(), transmission[part].copy()
    # Exact area and first moment of a piecewise linear curve.
    step = np.diff(wavelength_nm)
    left, right = transmission[:-1], transmission[1:]
    area = 0.5 * np.sum(step * (left + right))
    moment = np.sum(step * (wavelength_nm[:-1] * (2 * left + right) + wavelength_nm[1:] * (left + 2 * right))) / 6.0
    wavelength_nm.setflags(write=False)
    transmission.setflags(write=False)
    curve = Curve(wavelength_nm, transmission)
    return Band(name, camera, float(moment / area), float(area / transmission.max()), t_opt, qe, curve)


@functools.cache
def _tree() -> dict[str, Any]:
    tree: dict[str, Any] = load_yaml(_FILE, shipped=True)
    return tree


@functools.cache
def _load() -> tuple[dict[str, Band], dict[str, Provenance]]:
    values, provenance = split_sourced(_tree())
    bands = {name: Band(name=name, **_floats(entry)) for name, entry in values["bands"].items()}
    return bands, {key.removeprefix("bands."): item for key, item in provenance.items()}


def _floats(entry: dict[str, str | float]) -> dict[str, Any]:
    return {key: value if isinstance(value, str) else float(value) for key, value in entry.items()}


def _in_range(key: str, value: float, unit: str, low: float, high: float) -> None:
    if not low < value <= high:
        raise InputError(key, value, unit=unit, allowed=f"above {low:g}, at most {high:g}")


def _unit_scale(said: str, path: str) -> float:
    """Return the nanometres of the unit that a text names."""
    words = re.findall(
        r"[^\W\d_]+", said.lower().replace("\N{GREEK SMALL LETTER MU}", "u").replace("\N{MICRO SIGN}", "u")
    )
    scales = {LENGTHS_NM[word] for word in words if word in LENGTHS_NM}
    if len(scales) != 1:
        other = next((word for word in words if word in _OTHER_UNITS), "not stated")
        hint = "name it in the heading or in a comment"
        raise InputError(f"{path}: unit", "more than one" if scales else other, allowed=_ALLOWED, hint=hint)
    return scales.pop()


def _structured(data: bytes, where: str) -> tuple[np.ndarray, np.ndarray, str]:
    """Return the first two columns of a table, and the unit of the first."""
    from catalogs.table_files import TableBytes, parse_table

    columns = parse_table(TableBytes(where, data, "")).columns[:2]
    try:
        wavelength, transmission = (np.array(column.cells, dtype=np.float64) for column in columns)
        if not (np.isfinite(wavelength).all() and np.isfinite(transmission).all()):
            raise ValueError
    except (TypeError, ValueError):
        raise InputError(where, "other columns", allowed="two columns of finite numbers") from None
    if not columns[0].unit:
        return wavelength, transmission, columns[0].heading
    from astropy import units

    try:
        factor = units.Unit(columns[0].unit).to(units.nm)
    except ValueError:
        factor = math.nan
    name = next((word for word, scale in LENGTHS_NM.items() if math.isclose(scale, factor)), columns[0].unit)
    return wavelength, transmission, name


def two_columns(data: bytes, where: str) -> tuple[np.ndarray, np.ndarray, str]:
    """Return the two columns of numbers of a text, and its comments (with their ``#``) and headings, one a line.

    Parameters
    ----------
    data : bytes
        UTF-8 text; columns apart by blanks, commas, semicolons or tabs.
    where : str
        Name of the file, for messages.

    Raises
    ------
    InputError
        If it is no text, or has other lines below the first numbers.
    """
    try:
        lines = data.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        raise InputError(where, "binary or not UTF-8", allowed="UTF-8 text, ECSV, VOTable or FITS") from None
    said: list[str] = []
    rows: list[list[float]] = []
    for number, line in enumerate(lines, start=1):
        text, mark, comment = line.partition("#")
        if not text.strip():
            said.append(mark + comment)
            continue
        try:
            row = [float(field) for field in re.split(r"[\s,;]+", text.strip(" \t,;"))]
        except ValueError:
            row = []
            if not rows:
                said.append(text)
                continue
        if len(row) != 2:
            raise InputError(f"{where} line {number}", "something else", allowed="two numbers")
        rows.append(row)
    if len(rows) < 2:
        raise InputError(where, f"{len(rows)} rows of numbers", allowed="at least two rows of two numbers")
    table = np.array(rows)
    return table[:, 0], table[:, 1], "\n".join(said)
