"""Geometric albedos from a user's tables of wavelength and albedo; for grids see `simulator.target.albedo_grid`."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from catalogs import LENGTHS_NM, Albedo, TableBytes, parse_table
from cpic_core import NPZ_ERRORS, InputError, at_home, open_npz, read_file
from simulator.target.albedo_grid_file import LARGEST_ALBEDO, is_sqlite

_MAX_BYTES = 200_000_000
_FORMATS = "a text, CSV, ECSV, VOTable, FITS or npz file"
_NAMES = "wavelength_nm, wavelength_um, wavelength_angstrom or wavenumber_cm1"
_HINT = f"name the columns: {_NAMES}; and albedo"

# nm per unit; a wavenumber in 1/cm is 1e7 over nm.
_WAVENUMBER = "cm1"
_SHORT_ANGSTROM = {"a": 0.1, "aa": 0.1}  # in the name of a column; in a sentence "a" is a word
_WAVELENGTH_WORDS = {"wavelength", "wavelengths", "waveln", "wave", "wavel", "lambda", "lam", "wl", "wvl", "wlen"}
_WAVENUMBER_WORDS = {"wavenumber", "wavenumbers", "wavenum", "wno"}
_ALBEDO_WORDS = {"albedo", "albedos", "alb", "geomalb", "ag"}
_ERROR_WORDS = {"err", "error", "errors", "sigma", "std", "unc", "uncertainty", "uncertainties"}
# Without a unit: what cannot be nm is um and the other way round; Angstrom and wavenumbers overlap.
_UM_BELOW = 20.0
_NM_RANGE = (100.0, 3000.0)


@dataclass(frozen=True)
class _Columns:
    """Columns of numbers by heading and unit (both may be empty); ``rows`` says where each row stands.

    ``remark_units`` are those of wavelengths that remarks name.
    """

    headings: list[str]
    units: list[str]
    values: list[np.ndarray]
    rows: Sequence[str]
    remark_units: frozenset[str] = frozenset()


def read_albedo(path: str | Path, *, unit: str | None = None) -> Albedo:
    """Read a geometric albedo from a file with a column of wavelengths or wavenumbers and one of albedos.

    Text (columns apart by blanks, commas, semicolons or tabs; ``#`` begins a remark; the line above the numbers, or a
    remark there, may name the columns), ECSV, VOTable, FITS, and npz with such names as ``wavelength_nm`` and
    ``albedo``. What a file is, its content says. Rows may come in any order: over wavenumber, as in PICASO's output,
    they run down in wavelength. Where there are more than two columns, names choose.

    Parameters
    ----------
    path : str or Path
        The file.
    unit : str, optional
        ``nm``, ``um``, ``angstrom``, ``cm-1`` or what astropy reads as a unit of light's wavelength, frequency or
        energy; overrides the file. By default the unit is that of the column or its name (``wavelength_um``,
        ``Wavelength [micron]``; a ``wavenumber`` is in 1/cm); where there is none, numbers all below 20 are um, all
        within 100 to 3000 nm.

    Returns
    -------
    Albedo
        Increasing wavelengths in nm; documented over all of them.

    Raises
    ------
    InputError
        If the file cannot be read, its columns or unit cannot be told, a row is broken, a wavelength is repeated, or
        an albedo is not within 0 to 2.
    """
    place = at_home(path)
    hint = "is it a grid of models? then give log10_mh and log10_fsed with it"
    data = read_file(path, key="albedo file", allowed=_FORMATS, max_bytes=_MAX_BYTES, too_large=hint)
    columns = _parse(place, data)
    axis, other = _choose(place.name, columns)
    raw, values = columns.values[axis], columns.values[other]
    if raw.size < 2:
        raise InputError(place.name, f"{raw.size} rows", allowed="two or more rows of wavelength and albedo")
    if columns.units[other].strip() == "%":
        values = 0.01 * values
    _check_rows(place.name, columns.rows, "wavelength", raw, np.isfinite(raw) & (raw > 0.0), "a finite number above 0")
    good = (values >= 0.0) & (values <= LARGEST_ALBEDO)
    _check_rows(place.name, columns.rows, "albedo", values, good, f"0 to {LARGEST_ALBEDO:g}")
    length = _in_nm(place.name, columns, axis, unit)
    order = np.argsort(length, kind="stable")
    wavelength_nm, albedo = length[order], values[order]
    same = np.flatnonzero(np.diff(wavelength_nm) <= 0.0)
    if same.size:
        first, second = sorted(order[same[0] : same[0] + 2].tolist())
        where = f"{place.name} {columns.rows[first]} and {columns.rows[second]}"
        raise InputError(where, "the same wavelength", allowed="one row for each wavelength")
    for array in (wavelength_nm, albedo):
        array.setflags(write=False)
    return Albedo(wavelength_nm, albedo)


def _check_rows(name: str, rows: Sequence[str], what: str, values: np.ndarray, good: np.ndarray, allowed: str) -> None:
    bad = np.flatnonzero(~good)
    if bad.size:
        raise InputError(f"{name} {rows[bad[0]]} {what}", float(values[bad[0]]), allowed=allowed)


def _parse(place: Path, data: bytes) -> _Columns:
    start = data[:512].lstrip()
    if is_sqlite(data):
        raise _is_grid(place)
    if data.startswith(b"PK"):
        return _from_npz(place, data)
    if start.startswith((b"SIMPLE  =", b"<?xml", b"# %ECSV")) or b"<VOTABLE" in start.upper():
        return _from_table(place, data)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise InputError("albedo file", str(place), allowed=_FORMATS, hint="binary or not UTF-8")
    return _from_text(place.name, text)


def _is_grid(place: Path) -> InputError:
    hint = "this is a grid of models: give log10_mh and log10_fsed with it"
    return InputError("albedo file", str(place), allowed="a table of wavelength and albedo", hint=hint)


def _from_npz(place: Path, data: bytes) -> _Columns:
    if b"allphotdata.npy" in data:
        raise _is_grid(place)
    try:
        with open_npz(place) as archive:
            arrays = {name: np.asarray(archive[name], dtype=np.float64) for name in archive.files}
    except NPZ_ERRORS as error:
        allowed, reason = "an npz file of plain arrays of numbers", f"{type(error).__name__}: {error}"[:160]
        raise InputError("albedo file", str(place), allowed=allowed, hint=reason) from None
    lines = {name: array for name, array in arrays.items() if array.ndim == 1}
    return _tabled(place.name, list(lines), [""] * len(lines), list(lines.values()))


def _from_table(place: Path, data: bytes) -> _Columns:
    try:
        table = parse_table(TableBytes(place.name, data, ""))
    except InputError as error:
        allowed, reason = "a whole table of wavelength and albedo", error.hint or str(error.value)
        raise InputError("albedo file", str(place), allowed=allowed, hint=reason) from None
    headings, units, values = [], [], []
    for column in table.columns:
        try:
            cells = [np.nan if cell is None else float(cell) for cell in column.cells.tolist()]
        except (TypeError, ValueError):
            continue  # words: neither of the two
        headings.append(column.heading)
        units.append(column.unit)
        values.append(np.array(cells))
    return _tabled(place.name, headings, units, values)


def _tabled(name: str, headings: list[str], units: list[str], values: list[np.ndarray]) -> _Columns:
    sizes = {column.size for column in values}
    if len(sizes) > 1:
        shown = ", ".join(f"{heading}: {column.size}" for heading, column in zip(headings, values, strict=True))
        raise InputError(f"{name} columns", shown, allowed="columns of equal length")
    return _Columns(headings, units, values, [f"row {number}" for number in range(1, max(sizes, default=0) + 1)])


def _from_text(name: str, text: str) -> _Columns:
    remarks: list[tuple[str, bool]] = []  # what stands above the numbers, and whether behind a #
    rows: list[list[float]] = []
    places: list[str] = []
    for number, line in enumerate(text.splitlines(), start=1):
        body, _, remark = line.partition("#")
        if not body.strip():
            if remark.strip() and not rows:
                remarks.append((remark, True))
            continue
        cells = _numbers_of(body)
        if not rows and all(cell is None for cell in cells):
            remarks.append((body, False))
            continue
        numbers = [cell for cell in cells if cell is not None]
        expected = len(rows[0]) if rows else len(cells)
        if len(numbers) != len(cells) or len(cells) != expected:
            allowed = f"{expected} numbers" if rows else "numbers, or a heading of words"
            raise InputError(f"{name} line {number}", "something else", allowed=allowed)
        rows.append(numbers)
        places.append(f"line {number}")
    if len(rows) < 2:
        raise InputError(name, f"{len(rows)} rows of numbers", allowed="two or more rows of wavelength and albedo")
    headings, rest = _headings(remarks, len(rows[0]))
    return _Columns(headings, [""] * len(headings), list(np.array(rows).T), places, _remark_units(rest))


def _numbers_of(body: str) -> list[float | None]:
    """Return the cells of a line; None for a cell that is no number."""
    mark = next((mark for mark in ",;" if mark in body), None)
    found: list[float | None] = []
    for cell in body.strip().rstrip(mark).split(mark):
        try:
            found.append(float(cell))
        except ValueError:
            found.append(None)
    return found


def _headings(remarks: list[tuple[str, bool]], count: int) -> tuple[list[str], list[str]]:
    """Return the names of the columns, empty where there are none, and the remarks that are no names."""
    for index in reversed(range(len(remarks))):
        text, behind_mark = remarks[index]
        glued = re.sub(r"\s*[(\[]\s*(.*?)\s*[)\]]", lambda found: "_" + found[1].replace(" ", ""), text)
        for cells in (*(text.split(mark) for mark in ",;\t" if mark in text), glued.split()):
            kinds = [_kind(cell) for cell in cells]
            # A remark may hold such a word by chance, and two words: it must name both, or the first.
            named = "axis" in kinds and "albedo" in kinds
            if len(cells) == count and (named or kinds[0] == "axis" or (any(kinds) and not behind_mark)):
                return [cell.strip() for cell in cells], [text for text, _ in remarks[:index] + remarks[index + 1 :]]
    return [""] * count, [text for text, _ in remarks]


def _remark_units(remarks: list[str]) -> frozenset[str]:
    found: set[str] = set()
    for words in map(_words, remarks):
        if words & (_WAVELENGTH_WORDS | _WAVENUMBER_WORDS):
            units = words & {*LENGTHS_NM, _WAVENUMBER}
            found |= units or ({_WAVENUMBER} if words & _WAVENUMBER_WORDS else set())
    return frozenset(found)


def _choose(name: str, columns: _Columns) -> tuple[int, int]:
    """Return which column holds wavelengths or wavenumbers, and which albedos."""
    kinds = [_kind(heading) for heading in columns.headings]
    axes = [index for index, kind in enumerate(kinds) if kind == "axis"]
    albedos = [index for index, kind in enumerate(kinds) if kind == "albedo"]
    if len(kinds) == 2 and len(axes) < 2 and len(albedos) < 2:
        # One name tells the other; without any, wavelengths come first.
        axis = axes[0] if axes else 1 - albedos[0] if albedos else 0
        return axis, 1 - axis
    if len(kinds) > 2 and axes and len(albedos) == 1:
        return axes[0], albedos[0]
    shown = ", ".join(heading or "unnamed" for heading in columns.headings) or "no columns of numbers"
    raise InputError(f"{name} columns", shown, allowed="one of wavelengths and one of albedos", hint=_HINT)


def _in_nm(name: str, columns: _Columns, axis: int, unit: str | None) -> np.ndarray:
    raw = columns.values[axis]
    stated = unit or columns.units[axis].strip() or _unit_of(name, columns.headings[axis])
    if not stated and columns.remark_units:
        scales = {LENGTHS_NM.get(word, 0.0) for word in columns.remark_units}
        if len(scales) > 1:
            shown = " and ".join(sorted(columns.remark_units))
            raise InputError(f"{name} unit of wavelength", shown, allowed="one unit", hint=_HINT)
        stated = min(columns.remark_units)
    if stated:
        return _convert(name, raw, stated)
    if raw.max() < _UM_BELOW:
        return raw * LENGTHS_NM["um"]
    if _NM_RANGE[0] <= raw.min() and raw.max() <= _NM_RANGE[1]:
        return raw * LENGTHS_NM["nm"]
    span = f"not stated, numbers from {raw.min():g} to {raw.max():g}"
    raise InputError(f"{name} unit of wavelength", span, allowed="nm, um, angstrom or cm-1", hint=_HINT)


def _convert(name: str, raw: np.ndarray, unit: str) -> np.ndarray:
    key = _plain(unit).strip(" ()[]")
    if key == _WAVENUMBER:
        return 1e7 / raw
    if key in LENGTHS_NM or key in _SHORT_ANGSTROM:
        return raw * (LENGTHS_NM | _SHORT_ANGSTROM)[key]
    from astropy import units

    try:
        return np.asarray(units.Quantity(raw, unit).to_value(units.nm, equivalencies=units.spectral()))
    except (ValueError, TypeError):
        raise InputError(f"{name} unit of wavelength", unit, allowed="nm, um, angstrom or cm-1") from None


def _kind(heading: str) -> str:
    """Return "axis", "albedo" or nothing."""
    words = _words(heading)
    if not words or words & _ERROR_WORDS:
        return ""
    if words & (_WAVELENGTH_WORDS | _WAVENUMBER_WORDS) or words <= {*LENGTHS_NM, _WAVENUMBER}:
        return "axis"
    return "albedo" if words & _ALBEDO_WORDS or words == {"a", "g"} else ""


def _unit_of(name: str, heading: str) -> str:
    words = _words(heading)
    number = bool(words & _WAVENUMBER_WORDS)
    units = words & {*LENGTHS_NM, _WAVENUMBER, *_SHORT_ANGSTROM}
    if len(units) > 1 or (number and units - {_WAVENUMBER}):
        raise InputError(f"{name} column", heading, allowed=_NAMES)
    return _WAVENUMBER if number else next(iter(units), "")


def _words(text: str) -> set[str]:
    return set(re.findall(r"[a-z]+\d*", _plain(text)))


def _plain(text: str) -> str:
    """Return a text in lower case, Greek and Swedish letters spelled out, one spelling of 1/cm."""
    plain = text.lower()
    for letter, word in (("\u00b5", "u"), ("\u03bc", "u"), ("\u00e5", "angstrom"), ("\u03bb", "lambda")):
        plain = plain.replace(letter, word)
    reciprocal = r"1\s*/\s*cm(?![a-z])|(?<![a-z])cm\s*(?:\^|\*\*)?\s*[({]?\s*[-\u2212]\s*1\s*[)}]?|cm\u207b\u00b9"
    return re.sub(reciprocal, f" {_WAVENUMBER} ", plain)
