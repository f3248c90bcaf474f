"""Curves over wavelength from other people's files: transmissions, flux densities and albedos, read in one way.

Text with headings, units and remarks as people write them is read here; tables that say what their columns are (FITS,
VOTable, ECSV and others) by `catalogs.table_files`. Words for quantities and units are data (``data/curves.csv``).
A unit is taken from where the file states it, and from nowhere else.
"""

import functools
import io
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from catalogs.shipped import shipped_rows
from catalogs.table_files import TableBytes, parse_table
from cpic_core import NPZ_ERRORS, InputError, npz_in

_STRUCTURED = (b"SIMPLE  =", b"<?xml", b"# %ECSV")
_UNITS = "one of nm, um, Angstrom, m, cm-1, Hz, eV"
_NAMES = "wavelength_nm, wavelength_um, wavelength_angstrom or wavenumber_cm1"
_UNKNOWN = "the unit is not understood"
_UNSAID = f"name the column {_NAMES}, or the unit in a first line such as '# Angstrom'"
_NOISE = 0.01
"""Transmissions below 0 or above 1 by no more of the peak are noise: makers cut measured curves off at 1 % for that."""
# Albedos without a unit: what cannot be nm is um and the other way round; Angstrom and wavenumbers overlap.
_UM_BELOW, _NM_ABOVE, _NM_BELOW = 20.0, 100.0, 3000.0
_LEAST_NM, _MOST_NM = 1e-3, 1e8
_VALUES = {"transmission", "flux", "albedo"}
_MARKS, _BESIDE_COMMAS = (";", ",", "\t", "|", None), (";", "\t")
_REMARKS, _LONGEST, _HEADINGS = 1000, 1000, 50_000
"""Remarks that are looked at, those nearest to the numbers; characters of each; lines without numbers above them."""
_LETTERS = str.maketrans({"\u00b5": "u", "\u03bc": "u", "\u00e5": "angstrom", "\u03bb": "lambda", "\u207b": "-"})
_PER = re.compile(
    r"1\s*/\s*([cu]m)(?![a-z])|(?<![a-z])([cu]m)\s*(?:\^|\*\*)?\s*[({]?\s*[-\u2212]\s*[1\u00b9]\s*[)}]?(?![\d.])"
)
_PERCENT = re.compile(r"(?<![\d<>])(?<!\d\s)(?:%|\bper ?cent\b|\bpct\b)", re.IGNORECASE)
_FLUX = re.compile(
    r"(?<![^\W_])(?:(?:ergs?|photons?|ph|W)\b[\w\s/.*^-]*(?:/|-[12])[\w\s/.*^-]*|[munM\u00b5\u03bc]?Jy(?![^\W_]))"
)
_REMARK = re.compile(r"\s*(?:[!;%]+(?=\s)|!|\\|//|$)")


class _Entry(NamedTuple):
    """Words for one thing: those joined by ``_`` all have to stand. Units have a size, or are over one; 0 else."""

    kind: str
    name: str
    nm: float
    per_nm: float
    words: frozenset[str]


class _Table(NamedTuple):
    """Columns by heading and unit (either may be empty); ``places`` number its rows or lines."""

    name: str
    headings: Sequence[str]
    units: Sequence[str]
    columns: Sequence[Any]
    word: str
    places: Sequence[int]
    remarks: Sequence[str] = ()

    def cells(self, index: int) -> Any:
        return getattr(self.columns[index], "cells", self.columns[index])  # made where they are asked for

    def at(self, row: int) -> str:
        return f"{self.word} {self.places[row]}"


def read_curve(
    name: str, data: bytes, wanted: str, *, unit: str | None = None, most: float = np.inf, by_size: bool = False
) -> tuple[np.ndarray, np.ndarray, str]:
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
    most : float
        Largest value; the least is 0. Noise puts transmissions beyond by at most 1 % of the peak, which is taken off.
    by_size : bool
        Whether wavelengths without a unit are um where all are below 20, and nm where all are within 100 to 3000.

    Returns
    -------
    wavelength_nm, values : ndarray, shape (n,)
        Strictly increasing wavelengths; transmissions and albedos as fractions. Both are read-only.
    unit : str
        Unit of a flux density as the file states it, "" where it states none.

    Raises
    ------
    InputError
        If the file cannot be read, its columns or the unit of its wavelengths cannot be told, or a wavelength or a
        value is no number in its range, repeated or out of order.
    """
    table = _tabled(name, data)
    if len(table.places) < 2:
        raise InputError(name, f"{len(table.places)} rows of numbers", allowed="two or more rows")
    axis, other = _choose(table, wanted)
    raw, values = _numbers(table, axis, "wavelength"), _numbers(table, other, wanted)
    said = [text for text in table.remarks if wanted in _meaning(text)]
    if wanted != "flux" and any(map(_PERCENT.search, [table.headings[other], table.units[other], *said])):
        values = 0.01 * values
    noise = _NOISE * values.max(initial=0.0, where=np.isfinite(values)) if wanted == "transmission" else 0.0
    good = np.isfinite(values) & (values >= -noise) & (values <= most + noise)
    allowed = f"0 to {most:g}, in percent with % in the heading" if most < np.inf else "finite, not negative"
    _check(table, "wavelength", raw, np.isfinite(raw) & (raw > 0.0), "a finite number above 0")
    _check(table, wanted, values, good, allowed)
    nm = _in_nm(table, axis, unit, raw, by_size)
    _check(table, "wavelength", nm, (nm >= _LEAST_NM) & (nm <= _MOST_NM), f"{_LEAST_NM:g} to {_MOST_NM:g} nm")
    if wanted != "albedo":
        ordered = np.append(True, np.diff(nm) * (nm[-1] - nm[0]) > 0.0)
        _check(table, "wavelength", raw, ordered, "rows in order of wavelength, each once")
    order = np.argsort(nm, kind="stable")
    same = np.flatnonzero(np.diff(nm[order]) <= 0.0)
    if same.size:
        where = " and ".join(table.at(index) for index in sorted(order[same[0] : same[0] + 2]))
        raise InputError(f"{name} {where}", "the same wavelength", allowed="one row for each wavelength")
    nm, values = nm[order], values[order].clip(0.0, most)
    nm.setflags(write=False)
    values.setflags(write=False)
    return nm, values, _unit_of_flux(table, other) if wanted == "flux" else ""


def length_nm(unit: str) -> float | None:
    """Return the nanometres of a unit of length that a file names; None for any other unit."""
    entry = _entries("unit", "short").get(_plain(unit).strip())
    return (entry.nm or None) if entry else None


def _check(table: _Table, what: str, values: np.ndarray, good: np.ndarray, allowed: str) -> None:
    """Refuse the first value that is not good."""
    for row in np.flatnonzero(~good)[:1]:
        raise InputError(f"{table.name} {table.at(row)} {what}", float(values[row]), allowed=allowed)


# Words.


@functools.cache
def _vocabulary() -> tuple[_Entry, ...]:
    return tuple(
        _Entry(row["kind"], row["name"], float(row["nm"]), float(row["per_nm"]), frozenset(word.split("_")))
        for row in shipped_rows("curves.csv")
        for word in row["words"].split()
    )


@functools.cache
def _entries(*kinds: str) -> dict[str, _Entry]:
    """Return the entries of some kinds by their words."""
    return {word: entry for entry in _vocabulary() if entry.kind in kinds for word in entry.words}


@functools.lru_cache(maxsize=512)
def _named(text: str, kind: str) -> frozenset[str]:
    """Return what of one kind a text names."""
    words = _words(text)
    return frozenset(entry.name for entry in _vocabulary() if entry.kind == kind and entry.words <= words)


def _meaning(heading: str) -> frozenset[str]:
    """Return what a heading names: values, ``error``, ``axis``, or ``unit`` for nothing but units of wavelengths."""
    words = _words(heading)
    found = _named(heading, "error") or _named(heading, "value")
    if found or _named(heading, "axis"):
        return found or frozenset(("axis",))
    return frozenset(("unit",) if words and words <= _entries("unit", "short").keys() else ())


def _says_only(heading: str, wanted: str) -> bool:
    words, aside = _words(re.sub(r"[(\[].*", "", heading)) - _entries("filler").keys(), _entries("flux").keys()
    return any(entry.words <= words <= entry.words | aside for entry in _vocabulary() if entry.name == wanted)


def _words(text: str) -> set[str]:
    return set(re.findall(r"(?<![\da-z.])[a-z]+\d*", _plain(text)))


def _plain(text: str) -> str:
    """Return a text in lower case, Greek and Swedish letters spelled out, one spelling of 1/cm and 1/um."""
    return _PER.sub(lambda found: f" {found[1] or found[2]}1 ", text.lower().translate(_LETTERS))


# From bytes to columns.


def _tabled(name: str, data: bytes) -> _Table:
    start = data[:512].lstrip()
    if data.startswith(b"PK"):
        return _from_npz(name, data)
    if start.startswith(_STRUCTURED) or b"<VOTABLE" in start.upper() or b"Byte-by-byte" in data[:20_000]:
        return _from_table(name, data)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    if "\0" in text:
        raise InputError(name, "binary or not UTF-8", allowed="text, ECSV, VOTable, FITS or npz")
    return _from_text(name, text)


def _from_npz(name: str, data: bytes) -> _Table:
    try:
        with npz_in(io.BytesIO(data)) as archive:
            arrays = {key: np.asarray(archive[key], dtype=np.float64) for key in archive.files}
    except NPZ_ERRORS as error:
        reason = f"{type(error).__name__}: {error}"[:160]
        raise InputError(name, "unreadable", allowed="an npz file of plain arrays of numbers", hint=reason) from None
    lines = {key: array for key, array in arrays.items() if array.ndim == 1}
    count = max((array.size for array in lines.values()), default=0)
    if any(array.size != count for array in lines.values()):
        shown = ", ".join(f"{key}: {array.size}" for key, array in lines.items())
        raise InputError(f"{name} columns", shown, allowed="columns of equal length")
    return _Table(name, list(lines), [""] * len(lines), list(lines.values()), "row", range(1, count + 1))


def _from_table(name: str, data: bytes) -> _Table:
    try:
        table = parse_table(TableBytes(name, data, ""))
    except InputError as error:
        reason = error.hint or f"allowed: {error.allowed}"
        raise InputError(name, str(error.value), allowed="a whole table of a curve", hint=reason) from None
    said = [(item.heading, item.unit, "" if item.unit else getattr(item, "description", "")) for item in table.columns]
    headings, units, remarks = ([text[:_LONGEST] for text in texts] for texts in zip(*said, strict=True))
    return _Table(name, headings, units, table.columns, "row", range(1, len(table) + 1), remarks)


def _holds_numbers(cells: Iterable[Any]) -> bool:
    return next((number is not None for number in map(_number, cells) if not (number and np.isnan(number))), True)


def _from_text(name: str, text: str) -> _Table:
    said: list[tuple[str, bool]] = []  # what stands beside the numbers, and whether it may be a heading of words
    rows: list[list[str]] = []
    places: list[int] = []
    mark: str | None = None
    for number, line in enumerate(text.splitlines(), start=1):
        body, _, remark = line.partition("#")
        sign = _REMARK.match(body)
        if not body.strip(" \t,;") or (sign and not rows):
            if not rows or len(said) < _REMARKS:
                said.append(((remark or body[sign.end() if sign else 0 :])[:_LONGEST], False))
            continue
        if not rows:
            mark = min(_MARKS, key=lambda item: _likeness(body, item))
            cells = _split(body, mark)
            count = sum(_number(cell) is not None for cell in cells)
            if (2 * count < len(cells) or not count) and len(said) < _HEADINGS:
                said.append((body[:_LONGEST], True))
                continue
            if count < min(2, len(cells)):
                raise InputError(f"{name} line {number}", "something else", allowed="numbers, or a heading of words")
        rows.append(_split(body, mark))
        places.append(number)
        if len(rows[-1]) != len(rows[0]):
            shown, allowed = f"{len(rows[-1])} cells", f"{len(rows[0])}, as in line {places[0]}"
            raise InputError(f"{name} line {number}", shown, allowed=allowed)
    columns = list(zip(*rows, strict=True))
    if columns and not any(columns[-1]):  # a mark behind the last cell
        columns.pop()
    headings, units, remarks = _headings(said[-_REMARKS:], len(columns))
    return _Table(name, headings, units, columns, "line", places, remarks)


def _split(line: str, mark: str | None) -> list[str]:
    """Return the cells of a line; between semicolons or tabs, commas without any point are those of decimals."""
    text = line.replace(",", ".") if mark in _BESIDE_COMMAS and "." not in line else line
    return [cell.strip(" \t\"'") for cell in (text.strip() if mark is None else text.strip(" |")).split(mark)]


def _likeness(line: str, mark: str | None) -> tuple[int, int]:
    """Return what is least for the mark that parts a line into two numbers or more, and into nothing else."""
    cells = [cell for cell in _split(line, mark) if cell]
    numbers = sum(_number(cell) is not None for cell in cells)
    return -min(numbers, 2), len(cells) - numbers


def _number(cell: Any) -> float | None:
    """Return the number of a cell, nan for an empty one, None for words; ``D`` may stand for its power of ten."""
    try:
        if isinstance(cell, str):
            return None if "_" in cell else float(cell.replace("D", "E").replace("d", "e"))
        return np.nan if cell is None or cell is np.ma.masked else float(cell)
    except (TypeError, ValueError):
        return None


def _numbers(table: _Table, index: int, what: str) -> np.ndarray:
    cells = table.cells(index)
    if isinstance(cells, np.ndarray) and cells.dtype.kind in "fiu":
        return np.asarray(np.ma.filled(np.ma.asarray(cells, dtype=np.float64), np.nan))
    found = [_number(cell) for cell in cells]
    if None in found:  # what it is, is not shown: the file may be none of curves
        where = f"{table.name} {table.at(found.index(None))} {what}"
        raise InputError(where, "something else", allowed="a finite number")
    return np.array(found, dtype=np.float64)


def _headings(said: list[tuple[str, bool]], count: int) -> tuple[list[str], list[str], list[str]]:
    """Return the names of columns and their units, empty where there are none, and the remarks that are neither."""
    texts = [text for text, _ in said]
    for first in ({"axis"}, {"unit"}):
        for index in reversed(range(len(said))):
            for cells in _apart(texts[index], count):
                meanings = [_meaning(cell) for cell in cells]
                values, axes = (set().union(*meanings) & kind for kind in (_VALUES, {"axis", "unit"}))
                # A remark may hold such a word by chance, and two words: it must name both, or wavelengths first.
                if (values and axes) or ((values or "axis" in axes) and said[index][1]) or meanings[:1] == [first]:
                    below = (row for text in texts[index + 1 :] for row in _apart(text, count) if _are_units(row))
                    return cells, next(below, [""] * count), texts[:index] + texts[index + 1 :]
    return [""] * count, [""] * count, texts


def _are_units(cells: list[str]) -> bool:
    return any(map(_unit, cells)) and not any(_meaning(cell) - {"unit", "flux"} for cell in cells)


def _apart(text: str, count: int) -> Iterator[list[str]]:
    """Yield the ways in which a line of words can be as many cells; blanks within brackets part nothing."""
    line = text.strip().strip("|").rstrip()
    glued = re.sub(r"\s*[(\[]\s*([^)\]]*?)\s*[)\]]", lambda found: f"({found[1].replace(' ', chr(0))})", line)
    for cells in (*(line.split(mark) for mark in "|;,\t" if mark in line), glued.split()):
        if len(cells) == count or (len(cells) == count + 1 and not cells.pop().strip()):
            yield [cell.strip(" \t\"'").replace(chr(0), " ") for cell in cells]


def _choose(table: _Table, wanted: str) -> tuple[int, int]:
    """Return which column holds wavelengths, and which the values."""
    given = zip(table.headings, table.units, strict=True)
    meanings = [_meaning(text) or frozenset(("unit",) if unit and _unit(unit) else ()) for text, unit in given]
    every = [i for i in range(len(meanings)) if meanings[i] or _holds_numbers(table.cells(i))]
    axes = [i for i in every if "axis" in meanings[i]] or [i for i in every if "unit" in meanings[i]]
    named = [i for i in every if wanted in meanings[i]]
    # A heading that says no more than what is wanted goes first: albedo, where albedo_ch4 stands beside it.
    named = [i for i in named if _says_only(table.headings[i], wanted)] or named
    if len(every) == 2 and not axes:
        axes = [i for i in every if i not in named and not meanings[i]][:1]
    values = named or [i for i in every if i not in axes and not meanings[i]]
    if axes and len(values) == 1:
        return axes[0], values[0]
    shown = ", ".join(table.headings[i] or "unnamed" for i in every) or "no columns of numbers"
    allowed = f"one of wavelengths and one of {'fluxes' if wanted == 'flux' else wanted + 's'}"
    raise InputError(f"{table.name} columns", shown, allowed=allowed, hint=f"name the columns: {_NAMES}; and {wanted}")


# Units.


@functools.lru_cache(maxsize=256)
def _unit(text: str) -> _Entry | None:
    """Return the unit of light's wavelength, frequency or energy that a text is; None if it is none."""
    known = _entries("unit", "short").get(_plain(text).strip(" ()[]"))
    if not text.strip() or (known and (known.nm or known.per_nm)):
        return known
    from astropy import units

    name = known.name if known else text
    try:
        one, two = units.Quantity((1.0, 2.0), name).to_value(units.nm, equivalencies=units.spectral())
    except (ValueError, TypeError):
        return None
    return _Entry("unit", name, one if two > one else 0.0, 0.0 if two > one else one, frozenset())


def _within(heading: str) -> str:
    """Return what stands in brackets at the end of a heading, or behind ``in`` or a slash."""
    found = re.search(r"[(\[]\s*(.*?)\s*[)\]]\s*$|\s(?:in|/)\s+(.+)$", heading)
    return (found[1] or found[2] or "") if found else ""


def _units_in(text: str, *kinds: str) -> set[str]:
    """Return the units of wavelengths that a text names, without those of measures (``2.5A``) and of flux densities."""
    plain, found, known = _plain(text), set(), _entries(*kinds)
    for word in re.finditer(r"[a-z]+\d*", plain):
        before, after = plain[: word.start()].rstrip(), plain[word.end() :][:1]
        if word[0] in known and not (re.search(r"[\d/*^]$|\bper$", before) or after in tuple("/*^-")):
            found.add(known[word[0]].name)
    return found


def _in_nm(table: _Table, axis: int, given: str | None, raw: np.ndarray, by_size: bool) -> np.ndarray:
    """Return wavelengths in nm by the unit that somebody or the file states."""
    heading, stated = table.headings[axis], given or table.units[axis].strip()
    inner, numbered = _within(heading), _named(heading, "axis") == {"wavenumber"}
    found = {stated} if stated else {inner} if _unit(inner) else _units_in(heading, "unit", "short")
    if len(found) > 1 or (numbered and any(map(length_nm, found))):
        raise InputError(f"{table.name} column", heading, allowed=_NAMES)
    for text in () if found or numbered else table.remarks:
        if axes := _named(text, "axis"):
            found |= _units_in(text, "unit") or ({"1 / cm"} if axes == {"wavenumber"} else set())
    if not found:
        found = {"1 / cm"} if numbered else set().union(*(_units_in(text, "unit") for text in table.remarks))
    if not found and by_size and (raw.max() < _UM_BELOW or _NM_ABOVE <= raw.min() <= raw.max() <= _NM_BELOW):
        found = {"um" if raw.max() < _UM_BELOW else "nm"}
    said = " and ".join(sorted(found)) or inner
    unit = _unit(said)
    if unit is None:
        span = f"not stated, numbers from {raw.min():g} to {raw.max():g}"
        hint = _UNKNOWN if said and len(found) < 2 else _UNSAID
        raise InputError(f"{table.name} wavelength unit", said or span, allowed=_UNITS, hint=hint)
    return raw * unit.nm if unit.nm else np.asarray(unit.per_nm / raw)


def _unit_of_flux(table: _Table, index: int) -> str:
    """Return the unit of flux densities that the file states, as astropy spells it; several are joined by "and"."""
    heading, remarks = table.headings[index], table.remarks
    stated = table.units[index].strip() or _within(heading)
    found: set[str] | frozenset[str] = {stated} - {""}
    for texts in ([heading], remarks):
        found = found or {unit.strip() for text in texts for unit in _FLUX.findall(text)}
        found = found or frozenset().union(*(_named(text, "flux") for text in texts))
    known = _entries("spelling")
    return re.sub(r"[^\W\d_]+", lambda m: known[m[0]].name if m[0] in known else m[0], " and ".join(sorted(found)))
