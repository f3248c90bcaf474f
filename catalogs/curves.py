"""Curves over wavelength from other people's files: transmissions, flux densities and albedos, read in one way.

Text with headings, units and remarks as people write them is read here; tables that say what their columns are (FITS,
VOTable, ECSV and others) by `catalogs.table_files`. Words for quantities and units are data (``data/curves.csv``).
A unit is taken from where the file states it, and from nowhere else.
"""

import csv
import functools
import io
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from catalogs.table_files import TableBytes, parse_table
from cpic_core import NPZ_ERRORS, InputError, npz_in

Wanted: TypeAlias = Literal["transmission", "flux", "albedo"]

_WORDS = Path(__file__).resolve().parent / "data" / "curves.csv"
_STRUCTURED = (b"SIMPLE  =", b"<?xml", b"# %ECSV")
_FORMATS = "text, ECSV, VOTable, FITS or npz"
_UNITS = "nm, um, Angstrom, m, cm-1, Hz or eV"
_NAMES = "wavelength_nm, wavelength_um, wavelength_angstrom or wavenumber_cm1"
_UNKNOWN = "the unit is not understood"
_UNSAID = "name the unit in the heading (wavelength_nm) or in a first line such as '# Angstrom'"
_RANGE_NM = (1e-3, 1e8)
# Without a unit: what cannot be nm is um and the other way round; Angstrom and wavenumbers overlap.
_UM_BELOW = 20.0
_NM_RANGE = (100.0, 3000.0)
_WAVENUMBER = "1 / cm"
_MARKS = (";", ",", "\t", "|", None)
_PERCENT = re.compile(r"(?<![\d<>])(?<!\d\s)%|\bper ?cent\b|\bpct\b", re.IGNORECASE)
_FLUX = re.compile(r"\b(?:ergs?|photons?|ph|W)\b[\w\s/.*^-]*(?:/|-[12])[\w\s/.*^-]*")


@dataclass(frozen=True, eq=False)
class Samples:
    """A curve as its file gives it, in order of wavelength.

    Attributes
    ----------
    wavelength_nm, values : ndarray, shape (n,)
        Strictly increasing wavelengths; transmissions and albedos as fractions. Both are read-only.
    unit : str
        Unit of a flux density as the file states it, "" where it states none; "" for all else.
    rows : tuple of str
        Where each sample stands in the file, for messages.
    """

    wavelength_nm: np.ndarray
    values: np.ndarray
    unit: str
    rows: tuple[str, ...]


@dataclass(frozen=True)
class _Table:
    """Columns by heading and unit (either may be empty); ``rows`` says where each row stands."""

    headings: list[str]
    units: list[str]
    cells: list[Any]
    rows: Sequence[str]
    remarks: list[str]


def read_curve(name: str, data: bytes, wanted: Wanted, *, unit: str | None = None, by_size: bool = False) -> Samples:
    """Read a curve from a file with a column of wavelengths (or wavenumbers, frequencies, energies) and one of values.

    Text has columns apart by blanks, commas, semicolons, tabs or bars; ``#`` begins a remark, and lines of words above
    the numbers may name columns and units. Where there are more than two columns, names choose, and the others are not
    looked at. Rows may run up or down; those of albedos may come in any order.

    Parameters
    ----------
    name : str
        Name of the file, for messages.
    data : bytes
        Its content.
    wanted : {"transmission", "flux", "albedo"}
        What the values are.
    unit : str, optional
        Unit of the wavelengths; overrides the file.
    by_size : bool
        Whether wavelengths without a unit are um where all are below 20, and nm where all are within 100 to 3000.

    Raises
    ------
    InputError
        If the file cannot be read, its columns or the unit of its wavelengths cannot be told, or a wavelength or a
        value is no finite number, repeated or out of order.
    """
    table = _tabled(name, data, wanted)
    axis, other = _choose(name, table, wanted)
    raw, values = _numbers(name, table, axis, "wavelength"), _numbers(name, table, other, wanted)
    if raw.size < 2:
        raise InputError(name, f"{raw.size} rows", allowed=f"two or more rows of wavelength and {wanted}")
    check_rows(name, table.rows, "wavelength", raw, np.isfinite(raw) & (raw > 0.0), "a finite number above 0")
    check_rows(name, table.rows, wanted, values, np.isfinite(values), "a finite number")
    stated = _unit_of_axis(name, table, axis, unit)
    if not stated and by_size:
        stated = (
            "um" if raw.max() < _UM_BELOW else "nm" if _NM_RANGE[0] <= raw.min() <= raw.max() <= _NM_RANGE[1] else ""
        )
    if not stated:
        said, span = _within(table.headings[axis]), f"not stated, numbers from {raw.min():g} to {raw.max():g}"
        raise InputError(f"{name} wavelength unit", said or span, allowed=_UNITS, hint=_UNKNOWN if said else _UNSAID)
    length = _in_nm(raw, stated)
    if not _RANGE_NM[0] <= length.min() <= length.max() <= _RANGE_NM[1]:
        span, hint = f"{length.min():g} to {length.max():g}", f"its wavelengths are taken to be in {stated}"
        allowed = "{:g} to {:g}".format(*_RANGE_NM)
        raise InputError(f"{name} wavelengths", span, unit="nm", allowed=allowed, hint=hint)
    if wanted != "flux" and _is_percent(table, other, wanted):
        values = 0.01 * values
    order = np.argsort(length, kind="stable")
    same = np.flatnonzero(np.diff(length[order]) <= 0.0)
    if same.size:
        first, second = sorted(order[same[0] : same[0] + 2].tolist())
        where = f"{name} {table.rows[first]} and {table.rows[second]}"
        raise InputError(where, "the same wavelength", allowed="one row for each wavelength")
    turns = np.flatnonzero(np.diff(order) != np.diff(order)[0])
    if wanted != "albedo" and turns.size:
        row = int(np.flatnonzero(np.diff(length) * (length[1] - length[0]) <= 0.0)[0]) + 1
        raise InputError(f"{name} {table.rows[row]} wavelength", float(raw[row]), allowed="rows in order of wavelength")
    sorted_nm, values = length[order], values[order]
    for array in (sorted_nm, values):
        array.setflags(write=False)
    found = _unit_of_flux(table, other) if wanted == "flux" else ""
    return Samples(sorted_nm, values, found, tuple(table.rows[index] for index in order))


def check_rows(name: str, rows: Sequence[str], what: str, values: np.ndarray, good: np.ndarray, allowed: str) -> None:
    """Refuse the first value that is not good.

    Parameters
    ----------
    name : str
        Name of the file.
    rows : sequence of str
        Where each value stands in it.
    what, allowed : str
        What the value is, and what it may be.
    values, good : ndarray, shape (n,)

    Raises
    ------
    InputError
    """
    bad = np.flatnonzero(~good)
    if bad.size:
        raise InputError(f"{name} {rows[bad[0]]} {what}", float(values[bad[0]]), allowed=allowed)


def length_nm(unit: str) -> float | None:
    """Return the nanometres of a unit of length that a file names; None for any other unit."""
    return _words_of("unit", "short").get(_plain(unit).strip(), ("", None))[1]


@functools.cache
def _facts() -> tuple[tuple[str, str, float | None, frozenset[str]], ...]:
    """Return kind, name, size in nm and words of every entry of the table of words; joined words all have to stand."""
    with _WORDS.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return tuple(
        (row["kind"], row["name"], float(row["nm"]) if row["nm"] else None, frozenset(word.split("_")))
        for row in rows
        for word in row["words"].split()
    )


@functools.cache
def _words_of(*kinds: str) -> dict[str, tuple[str, float | None]]:
    """Return name and size in nm by word."""
    return {word: (name, size) for kind, name, size, words in _facts() if kind in kinds for word in words}


def _meanings(text: str) -> set[str]:
    """Return what a heading names: values, ``error``, ``axis``, or ``unit`` for nothing but units of wavelengths."""
    if _names(text, "error"):
        return {"error"}
    if found := _names(text, "value") or ({"axis"} if _names(text, "axis") else set()):
        return found
    words = _letters(text)
    return {"unit"} if words and words <= set(_words_of("unit", "short")) else set()


def _names(text: str, kind: str) -> set[str]:
    """Return what of one kind a text names."""
    words = _letters(text)
    return {name for own, name, _, phrase in _facts() if own == kind and phrase <= words}


def _is_exact(heading: str, wanted: str) -> bool:
    """Tell whether a heading says no more than what is wanted: ``albedo`` does, ``albedo_ch4`` does not."""
    aside = {*_words_of("filler", "unit", "short", "flux")}
    own = {word for kind, name, _, phrase in _facts() if (kind, name) == ("value", wanted) for word in phrase}
    words = _letters(re.sub(r"[(\[].*", "", heading))
    return bool(words & own) and words <= own | aside


# From bytes to columns.


def _tabled(name: str, data: bytes, wanted: str) -> _Table:
    start = data[:512].lstrip()
    if data.startswith(b"PK"):
        return _from_npz(name, data)
    if start.startswith(_STRUCTURED) or b"<VOTABLE" in start.upper() or b"Byte-by-byte" in data[:20_000]:
        return _from_table(name, data, wanted)
    for encoding in ("utf-8-sig", "cp1252"):
        try:
            text = data.decode(encoding)
            break
        except UnicodeDecodeError:
            text = "\0"
    if "\0" in text:
        raise InputError(name, "binary or not UTF-8", allowed=_FORMATS)
    return _from_text(name, text, wanted)


def _from_npz(name: str, data: bytes) -> _Table:
    try:
        with npz_in(io.BytesIO(data)) as archive:
            arrays = {key: np.asarray(archive[key], dtype=np.float64) for key in archive.files}
    except NPZ_ERRORS as error:
        reason = f"{type(error).__name__}: {error}"[:160]
        raise InputError(name, "unreadable", allowed="an npz file of plain arrays of numbers", hint=reason) from None
    lines = {key: array for key, array in arrays.items() if array.ndim == 1}
    sizes = {array.size for array in lines.values()}
    if len(sizes) > 1:
        shown = ", ".join(f"{key}: {array.size}" for key, array in lines.items())
        raise InputError(f"{name} columns", shown, allowed="columns of equal length")
    return _Table(list(lines), [""] * len(lines), list(lines.values()), _numbered(max(sizes, default=0)), [])


def _from_table(name: str, data: bytes, wanted: str) -> _Table:
    try:
        table = parse_table(TableBytes(name, data, ""))
    except InputError as error:
        allowed, reason = f"a whole table of wavelength and {wanted}", error.hint or f"allowed: {error.allowed}"
        raise InputError(name, str(error.value), allowed=allowed, hint=reason) from None
    columns = [column for column in table.columns if _number(next(_given(column.cells), None)) is not None]
    remarks = [getattr(column, "description", "") for column in columns]
    headings, units = [column.heading for column in columns], [column.unit for column in columns]
    return _Table(headings, units, [column.cells for column in columns], _numbered(len(table)), remarks)


def _given(cells: Iterable[Any]) -> Iterator[Any]:
    return (cell for cell in cells if cell is not None and cell is not np.ma.masked)


def _numbered(count: int) -> list[str]:
    return [f"row {number}" for number in range(1, count + 1)]


def _from_text(name: str, text: str, wanted: str) -> _Table:
    said: list[tuple[str, bool]] = []  # what stands above the numbers, and whether it is marked as a remark
    below: list[str] = []
    rows: list[list[str]] = []
    places: list[str] = []
    mark: str | None = None
    for number, line in enumerate(text.splitlines(), start=1):
        body, _, remark = line.partition("#")
        if not body.strip(" \t,;"):
            said.append((remark, True)) if not rows else below.append(remark)
            continue
        if not rows:
            mark = min(_MARKS, key=lambda item: _likeness(body, item))
            cells = _split(body, mark)
            count = sum(_number(cell) is not None for cell in cells)
            if not count or 2 * count < len(cells) or body.lstrip()[0] in "!\\|":
                said.append((body.lstrip().lstrip("!\\|"), body.lstrip()[0] in "!\\|"))
                continue
            if count < min(2, len(cells)):
                raise InputError(f"{name} line {number}", "something else", allowed="numbers, or a heading of words")
        rows.append(_split(body, mark))
        places.append(f"line {number}")
        if len(rows[-1]) != len(rows[0]):
            shown, allowed = f"{len(rows[-1])} cells", f"{len(rows[0])}, as in {places[0]}"
            raise InputError(f"{name} line {number}", shown, allowed=allowed)
    if len(rows) < 2:
        raise InputError(name, f"{len(rows)} rows of numbers", allowed=f"two or more rows of wavelength and {wanted}")
    columns = [list(column) for column in zip(*rows, strict=True)]
    if not any(columns[-1]):  # a mark behind the last cell
        columns.pop()
    headings, units, rest = _headings(said, len(columns), wanted)
    return _Table(headings, units, columns, places, rest + below)


def _split(line: str, mark: str | None) -> list[str]:
    return [cell.strip(" \t\"'") for cell in (line.strip() if mark is None else line.strip(" ")).split(mark)]


def _likeness(line: str, mark: str | None) -> tuple[bool, int]:
    """Return whether a mark parts a line into too few numbers, and how many cells are none: the least is the mark."""
    cells = [cell for cell in _split(line, mark) if cell]
    numbers = sum(_number(cell) is not None for cell in cells)
    return numbers < 2, len(cells) - numbers


def _number(cell: Any) -> float | None:
    """Return the number of a cell, nan for an empty one, None for words; a comma or a ``D`` may stand in it."""
    if cell is None or cell is np.ma.masked:
        return np.nan
    try:
        if not isinstance(cell, str):
            return float(cell)
        return None if "_" in cell else float(cell.replace(",", ".").replace("D", "E").replace("d", "e"))
    except (TypeError, ValueError):
        return None


def _numbers(name: str, table: _Table, index: int, what: str) -> np.ndarray:
    cells = table.cells[index]
    if isinstance(cells, np.ndarray) and cells.dtype.kind in "fiu":
        return np.asarray(np.ma.filled(np.ma.asarray(cells, dtype=np.float64), np.nan))
    found = [_number(cell) for cell in cells]
    if None in found:
        row = found.index(None)
        raise InputError(f"{name} {table.rows[row]} {what}", cells[row] or "empty", allowed="a finite number")
    return np.array(found, dtype=np.float64)


def _headings(said: list[tuple[str, bool]], count: int, wanted: str) -> tuple[list[str], list[str], list[str]]:
    """Return the names of columns and their units, empty where there are none, and the remarks that are neither."""
    for only_units in (False, True):
        for index in reversed(range(len(said))):
            for cells in _apart(said[index][0], count):
                meanings = [_meanings(cell) for cell in cells]
                # A remark may hold such a word by chance, and two words: it must name both, or the first.
                named = any(wanted in found for found in meanings) and bool(set.union(*meanings) & {"axis", "unit"})
                words = any(found - {"unit"} for found in meanings) and not said[index][1]
                if named or words or meanings[0] == ({"unit"} if only_units else {"axis"}):
                    rest = [text for text, _ in said]
                    units = next(
                        (row for text in rest[index + 1 :] for row in _apart(text, count) if _are_units(row)), []
                    )
                    return cells, units or [""] * count, rest[:index] + rest[index + 1 :]
    return [""] * count, [""] * count, [text for text, _ in said]


def _are_units(cells: list[str]) -> bool:
    return any(map(_understood, cells)) and not any(_meanings(cell) - {"unit", "flux"} for cell in cells)


def _apart(text: str, count: int) -> Iterator[list[str]]:
    """Yield the ways in which a line of words can be as many cells; blanks within brackets part nothing."""
    line = text.strip().strip("|").rstrip()
    glued = re.sub(r"\s*[(\[]\s*([^)\]]*?)\s*[)\]]", lambda found: f"({found[1].replace(' ', chr(0))})", line)
    for cells in (*(line.split(mark) for mark in "|;,\t" if mark in line), glued.split()):
        if len(cells) == count or (len(cells) == count + 1 and not cells.pop().strip()):
            yield [cell.strip(" \t\"'").replace(chr(0), " ") for cell in cells]


def _choose(name: str, table: _Table, wanted: str) -> tuple[int, int]:
    """Return which column holds wavelengths, and which the values."""
    meanings = [_meanings(heading) for heading in table.headings]
    for found, unit in zip(meanings, table.units, strict=True):
        if not found and unit and _understood(unit):
            found.add("unit")
    every = range(len(meanings))
    axes = [i for i in every if "axis" in meanings[i]] or [i for i in every if "unit" in meanings[i]]
    named = [i for i in every if wanted in meanings[i]]
    named = [i for i in named if _is_exact(table.headings[i], wanted)] or named
    if len(every) == 2 and not axes:
        axes = [i for i in every if i not in named and not meanings[i]][:1]
    values = named or [i for i in every if i not in axes and not meanings[i]]
    if axes and len(values) == 1:
        return axes[0], values[0]
    shown = ", ".join(heading or "unnamed" for heading in table.headings) or "no columns of numbers"
    allowed = f"one of wavelengths and one of {'fluxes' if wanted == 'flux' else wanted + 's'}"
    raise InputError(f"{name} columns", shown, allowed=allowed, hint=f"name the columns: {_NAMES}; and {wanted}")


# Units.


def _letters(text: str) -> set[str]:
    return set(re.findall(r"[a-z]+\d*", _plain(text)))


def _plain(text: str) -> str:
    """Return a text in lower case, Greek and Swedish letters spelled out, one spelling of 1/cm and 1/um."""
    plain = text.lower()
    for letter, word in (
        ("\u00b5", "u"),
        ("\u03bc", "u"),
        ("\u00e5", "angstrom"),
        ("\u212b", "angstrom"),
        ("\u03bb", "lambda"),
    ):
        plain = plain.replace(letter, word)
    power = r"(?<![a-z])([cu]m)\s*(?:\^|\*\*)?\s*[({]?\s*[-\u2212]\s*1\s*[)}]?(?![\d.])"
    return re.sub(rf"1\s*/\s*([cu]m)(?![a-z])|{power}|(cm)\u207b\u00b9", lambda m: f" {m[1] or m[2] or m[3]}1 ", plain)


def _understood(text: str) -> str:
    """Return the unit of light's wavelength, frequency or energy that a text is; "" if it is none."""
    known = _words_of("unit", "short").get(_plain(text).strip(" ()[]"))
    if known or not text.strip():
        return known[0] if known else ""
    from astropy import units

    try:
        units.Unit(text).to(units.nm, equivalencies=units.spectral())
    except (ValueError, TypeError):
        return ""
    return text


def _within(heading: str) -> str:
    """Return what stands in brackets at the end of a heading, or behind ``in`` or a slash."""
    found = re.search(r"[(\[]\s*(.*?)\s*[)\]]\s*$|\s(?:in|/)\s+(.+)$", heading)
    return (found[1] or found[2] or "") if found else ""


def _units_in(text: str, *kinds: str) -> set[str]:
    """Return the units of wavelengths that a text names, without those of measures (``2.5A``) and of flux densities."""
    plain, found = _plain(text), set()
    for word in re.finditer(r"[a-z]+\d*", plain):
        before, after = plain[: word.start()].rstrip(), plain[word.end() :]
        measured = before[-1:].isdigit() or before[-1:] in tuple("/*^") or before.endswith(" per")
        if not measured and after[:1] not in tuple("/*^-") and word[0] in _words_of(*kinds):
            found.add(_words_of(*kinds)[word[0]][0])
    return found


def _unit_of_axis(name: str, table: _Table, axis: int, given: str | None) -> str:
    """Return the unit of wavelengths that somebody or the file states; "" where it states none."""
    heading, stated = table.headings[axis], given or table.units[axis].strip()
    if stated:
        if not _understood(stated):
            raise InputError(f"{name} wavelength unit", stated, allowed=_UNITS, hint=_UNKNOWN)
        return _understood(stated)
    known, numbered = _understood(_within(heading)), _names(heading, "axis") == {"wavenumber"}
    found = {known} - {""} or _units_in(heading, "unit", "short")
    if len(found) > 1 or (numbered and any(length_nm(unit) for unit in found)):
        raise InputError(f"{name} column", heading, allowed=_NAMES)
    if found or numbered:
        return next(iter(found), _WAVENUMBER)
    for text in table.remarks:
        if names := _names(text, "axis"):
            found |= _units_in(text, "unit") or ({_WAVENUMBER} if names == {"wavenumber"} else set())
    found = found or set().union(*(_units_in(text, "unit") for text in table.remarks))
    if len(found) > 1:
        raise InputError(
            f"{name} wavelength unit", " and ".join(sorted(found)), allowed=f"one of {_UNITS}", hint=_UNSAID
        )
    return next(iter(found), "")


def _in_nm(raw: np.ndarray, unit: str) -> np.ndarray:
    if unit == _WAVENUMBER:
        return 1e7 / raw
    if (size := length_nm(unit)) is not None:
        return raw * size
    from astropy import units

    return np.asarray(units.Quantity(raw, unit).to_value(units.nm, equivalencies=units.spectral()))


def _is_percent(table: _Table, index: int, wanted: str) -> bool:
    own = f"{table.headings[index]} {table.units[index]}"
    return any(_PERCENT.search(text) for text in (own, *(text for text in table.remarks if wanted in _meanings(text))))


def _unit_of_flux(table: _Table, index: int) -> str:
    """Return the unit of flux densities as the file states it; several joined by "and", "" for none."""
    heading = table.headings[index]
    if stated := table.units[index].strip() or _within(heading):
        return stated
    found = _names(heading, "flux") or set().union(*(_names(text, "flux") for text in table.remarks))
    found = found or {text.strip() for remark in (heading, *table.remarks) for text in _FLUX.findall(remark)}
    return " and ".join(sorted(found))
