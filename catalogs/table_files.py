"""Tables from files: CSV with nothing but the standard library; ECSV, VOTable and FITS with astropy.

A file is read once, as bytes; what it is, its content says before its name does. One that refers to another file or to
an address is refused before it is parsed: reading a table opens nothing but that table.
"""

import base64
import csv
import hashlib
import io
import re
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import InputError, NDArray, bounded_fits, read_file, unguarded

_MAX_BYTES = 1_000_000_000
_FORMATS = "CSV, ECSV, VOTable or FITS"
_PACKED = (b"\x1f\x8b", b"\x1f\x9d", b"BZh", b"\xfd7zXZ")  # what astropy unpacks unasked
_NAMES = "names of columns in the first line"
_FAILED = re.compile(r"QUERY_STATUS\W+(?:value\W+)?ERROR\b", re.IGNORECASE)
_CUT_OFF = re.compile(r"\bOVERFLOW\b|\btruncated\b", re.IGNORECASE)
_CUT = "was cut off, as it says itself: rows are missing"
_MISSING = frozenset(("", "nan", "null", "none", "n/a", "na", "--", "-", "…", "..."))


@dataclass(frozen=True)
class TableBytes:
    """A file's content, its name without folder, and the sha256 of the content."""

    name: str
    data: bytes
    sha256: str


@dataclass(frozen=True)
class RawColumn:
    """One column as the file gives it; cells are None where missing."""

    heading: str
    unit: str
    cells: list[Any]


@dataclass(frozen=True)
class RawTable:
    """All columns of a file, of equal length, and remarks on the reading."""

    name: str
    columns: list[RawColumn]
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.columns[0].cells)

    @property
    def shortened(self) -> str:
        """Words for the provenance of a table that says that rows are missing; ``""`` for any other."""
        return ", cut off: rows are missing" if any(note.endswith(_CUT) for note in self.notes) else ""


def read_bytes(path: str | Path, *, key: str = "catalog", presets: str = "snapshot, latest, simbad_2012") -> TableBytes:
    """Read a file whole; ``key`` is what it is asked for as, ``presets`` what may be given instead of a file.

    Parameters
    ----------
    path : str or Path
        The file.
    key : str
        What it is asked for as, for messages.
    presets : str
        What may be given instead of a file, for messages; "" if nothing.

    Raises
    ------
    InputError
        If there is no such file, or it is no regular file, larger than 1 GB, or cannot be read.
    """
    allowed = f"{presets}, or the name of a {_FORMATS} file" if presets else f"the name of a {_FORMATS} file"
    data = read_file(path, key=key, allowed=allowed, max_bytes=_MAX_BYTES)
    return TableBytes(Path(path).name, data, hashlib.sha256(data).hexdigest())


def parse_table(file: TableBytes) -> RawTable:
    """Read a table of any accepted format.

    Raises
    ------
    InputError
        If it is empty, of another format, damaged, or says of itself that the query behind it failed.
    """
    if not file.data.strip():
        raise InputError(file.name, "an empty file", allowed=f"a {_FORMATS} table with a heading and rows")
    start = file.data[:512].lstrip()
    if start.startswith(b"SIMPLE  ="):
        table = _astropy(file, "fits")
    elif start.startswith(b"<?xml") or b"<VOTABLE" in start.upper():
        table = _astropy(file, "votable")
    else:
        text = _text(file)
        table = _astropy(file, "ecsv") if text.startswith("# %ECSV") else _csv(file.name, text)
    if len(table) == 0:
        raise InputError(file.name, "no rows", allowed="at least one star")
    return table


def _text(file: TableBytes) -> str:
    try:
        text = file.data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = ""
    if not text or "\0" in text:
        raise InputError(
            file.name, "binary or not UTF-8", allowed=f"a {_FORMATS} table", hint="save it as CSV in UTF-8"
        )
    return text


def _csv(name: str, text: str) -> RawTable:
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise InputError(name, "no heading", allowed="a heading line and rows")
    counts = {mark: lines[0].count(mark) for mark in (",", ";", "\t", "|")}
    mark = max(counts, key=lambda item: counts[item])
    if not counts[mark]:
        raise InputError(f"{name} heading", "one column", allowed="columns separated by comma, semicolon or tab")
    try:
        rows = list(csv.reader(lines, delimiter=mark, strict=True, skipinitialspace=True))
    except csv.Error as error:
        raise InputError(name, "broken quoting", allowed="a CSV table", hint=str(error)) from None
    if any(map(_is_number, rows[0])):  # no heading, or one written as a comment
        comments = [line.lstrip("# \t") for line in text.splitlines() if line.lstrip().startswith("#")]
        headed = [
            row for row in csv.reader(comments, delimiter=mark, skipinitialspace=True) if len(row) == len(rows[0])
        ]
        if not headed or any(map(_is_number, headed[-1])):
            raise InputError(f"{name} heading", "numbers", allowed=_NAMES)
        rows.insert(0, headed[-1])
    headings = [text.strip() for text in rows[0]]
    if not any(headings):
        raise InputError(f"{name} heading", "empty", allowed=_NAMES)
    width = len(headings)
    filled = [row for row in rows[1:] if any(map(str.strip, row))]  # spreadsheets write blank rows as separators alone
    for number, row in enumerate(filled, start=1):
        if len(row) < width or any(map(str.strip, row[width:])):
            allowed = f"{width} cells, as in the heading"
            raise InputError(f"{name} row {number}", f"{len(row)} cells", allowed=allowed, hint="a stray separator?")
    notes = remarks(name, "\n".join(line for line in text.splitlines() if line.lstrip().startswith("#")))
    cells: list[list[str | None]] = [[_unguarded(_cell(row[i])) for row in filled] for i in range(width)]
    if mark == ";" and (commas := [text for text, column in zip(headings, cells, strict=True) if _has_commas(column)]):
        cells = [[_pointed(cell) for cell in column] if _has_commas(column) else column for column in cells]
        notes += (f"{name}: decimal commas read in {', '.join(commas)}",)
    columns = [RawColumn(text, "", column) for text, column in zip(headings, cells, strict=True)]
    return RawTable(name, [column for column in columns if column.heading or any(column.cells)], notes)


def remarks(name: str, said: str) -> tuple[str, ...]:
    """Return a note on a table that says of itself, beside its rows, that some are missing.

    Parameters
    ----------
    name : str
        Name of the file.
    said : str
        What it says.

    Raises
    ------
    InputError
        If it says that the query failed that it is the answer to (IVOA DALI 1.1, section 4.4).
    """
    if _FAILED.search(said):
        raise InputError(name, "QUERY_STATUS ERROR", allowed="a whole table", hint="the query behind it failed")
    return (f"{name} {_CUT}",) if _CUT_OFF.search(said) else ()


def _has_commas(cells: list[str | None]) -> bool:
    """Tell whether a column is of numbers with decimal commas: what spreadsheets write between semicolons."""
    given = [cell for cell in cells if cell is not None]
    return any("," in cell for cell in given) and all(_is_number(cell.replace(",", ".", 1)) for cell in given)


def _pointed(cell: str | None) -> str | None:
    return None if cell is None else cell.replace(",", ".")


def _is_number(text: str) -> bool:
    return re.fullmatch(r"\s*[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\s*", text) is not None


def _cell(text: str) -> str | None:
    plain = text.strip()
    return None if plain.lower() in _MISSING else plain


def _unguarded(cell: Any) -> Any:
    return unguarded(cell) if isinstance(cell, str) else cell


def _astropy(file: TableBytes, kind: str) -> RawTable:
    try:
        table, notes = astropy_table(file, kind)
        columns = [raw_column(file.name, name, table[name]) for name in table.colnames]
        if kind == "ecsv":
            columns = [RawColumn(item.heading, item.unit, list(map(_unguarded, item.cells))) for item in columns]
    except InputError:
        raise
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:160]
        what = {"votable": "VOTable", "fits": "FITS table", "ecsv": "ECSV table"}[kind]
        raise InputError(file.name, "unreadable", allowed=f"a whole {what}", hint=reason) from None
    if not columns:
        raise InputError(file.name, "no columns", allowed="a table with columns")
    return RawTable(file.name, columns, notes)


def astropy_table(file: TableBytes, kind: str) -> tuple[Any, tuple[str, ...]]:
    """Return the first table of a file as astropy reads it, and remarks.

    Parameters
    ----------
    file : TableBytes
    kind : {"votable", "fits", "ecsv"}
        What its first bytes say that it is.

    Raises
    ------
    InputError
        If it refers to something outside.
    Exception
        Of many kinds, if it is damaged.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what astropy forgives is no reason to refuse a table
        if kind == "votable":
            parsed, said = votable_document(file)
            several = sum(1 for _ in parsed.iter_tables()) > 1
            notes = (f"{file.name} holds several tables: the first is read",) if several else ()
            return parsed.get_first_table().to_table(use_names_over_ids=True), remarks(file.name, said) + notes
        if kind == "fits":
            table = _fits_table(file.data)
        else:
            from astropy.io import ascii as text_tables

            # As lines: a text without an end of line would be taken for the name of a file.
            table = text_tables.read(_text(file).splitlines(), format="ecsv")
        return table, remarks(file.name, repr(table.meta))


def votable_document(file: TableBytes) -> tuple[Any, str]:
    """Return a VOTable as astropy reads it, the nulls of its first table mended, and what its INFO elements say.

    Raises
    ------
    InputError
        If it refers to something outside: in front of any parser, for astropy's would go and get it.
    Exception
        Of many kinds, if it is damaged.
    """
    found, said = _outside_and_said(file.data)
    if found:
        allowed = "a VOTable that holds its own data"
        raise InputError(file.name, found, allowed=allowed, hint="references are not followed")
    from astropy.io.votable import parse

    parsed = parse(io.BytesIO(file.data))
    first = next(parsed.iter_tables(), None)
    if first is not None and (nulls := _nulls(file.data, first.fields)) is not None:
        first.array.mask = nulls
    return parsed, said


def _fits_table(data: bytes) -> Any:
    """Return the first table of a FITS file, masked where the integers of the file are those of TNULL.

    The standard (FITS 4.0, section 7.3.2) compares them before TSCAL and TZERO; astropy does so without these alone.
    """
    from astropy.io import fits
    from astropy.table import MaskedColumn, Table

    with fits.open(bounded_fits(io.BytesIO(data))) as units:
        unit = next(item for item in units if isinstance(item, fits.BinTableHDU | fits.TableHDU))
        table, written = Table.read(unit, format="fits"), unit.data.view(np.ndarray)
        for column in unit.columns:
            raw = written[column.name]
            if isinstance(column.null, int) and raw.dtype.kind in "iu" and raw.ndim == 1:
                found = table[column.name]
                gone = np.ma.getmaskarray(found) | (raw == column.null)
                table[column.name] = MaskedColumn(np.asarray(found), mask=gone, unit=found.unit)
    return table


_BINARY2 = re.compile(
    rb"<(?:\w+:)?DATA\b[^>]*>(?:\s*<(?:\w+:)?BINARY2\b[^>]*>\s*<(?:\w+:)?STREAM\b[^>]*>(.*?)</)?", re.DOTALL
)


def _nulls(xml: bytes, fields: Any) -> NDArray[np.generic] | None:
    """Return the null flags of a VOTable's first table if it is BINARY2, else None; astropy leaves out those of texts.

    Each row begins with one bit for each field, the highest first (IVOA VOTable 1.4, section 6.4).
    """
    from astropy.io.votable.converters import bitarray_to_bool

    if (found := _BINARY2.search(xml)) is None or found[1] is None:
        return None
    stream = io.BytesIO(base64.b64decode(found[1]))
    rows = []
    while flags := stream.read((len(fields) + 7) // 8):
        rows.append(tuple(bitarray_to_bool(flags, len(fields))))
        for field in fields:
            field.converter.binparse(stream.read)
    return np.array(rows, [(field.ID, bool) for field in fields])


class _Reference(Exception):
    """Raised at the first thing that leads out of a document to another file or address."""


def _outside_and_said(xml: bytes) -> tuple[str, str]:
    """Return what leads outside of an XML document, in words; and the names and values of its INFO elements.

    Outside lead data at an address (``<STREAM href=...>``), a document type with its entities, inclusions, and an
    encoding or packing in which none of them could be seen. A ``LINK`` is for people and is never followed. Where the
    document is damaged, its parser will say so; what is in front of the damage is judged.
    """
    from xml.parsers import expat

    if xml.startswith(_PACKED):
        return "packed data", ""
    said: list[str] = []

    def element(name: str, attributes: dict[str, str]) -> None:
        plain = name.rpartition(":")[2].upper()
        if plain == "STREAM" and any(key.rpartition(":")[2].lower() == "href" for key in attributes):
            raise _Reference("a STREAM with href")
        if plain == "INCLUDE":
            raise _Reference("an inclusion")
        if plain == "INFO":
            said.append(f"{attributes.get('name', '')} {attributes.get('value', '')}")

    def doctype(*_: object) -> None:
        raise _Reference("a document type (DOCTYPE)")

    parser = expat.ParserCreate()
    parser.StartElementHandler = element
    parser.StartDoctypeDeclHandler = doctype
    try:
        parser.Parse(xml, True)
    except _Reference as found:
        return str(found), ""
    except expat.ExpatError:
        pass
    except (LookupError, ValueError):
        return "an unknown encoding", ""
    return "", "\n".join(said)


def raw_column(name: str, heading: str, column: Any) -> RawColumn:
    """Return a column of an astropy table as plain cells.

    Parameters
    ----------
    name : str
        Name of the file, for messages.
    heading : str
        Name of the column.
    column : astropy.table.Column
        Masked cells and nan are missing; a number of single precision becomes the shortest decimal that it stands for.

    Raises
    ------
    InputError
        If it has more than one value per row.
    """
    values = getattr(column, "value", column)  # a Quantity column has its numbers there
    if getattr(values, "ndim", 1) != 1:
        raise InputError(f"{name} column {heading}", f"{values.ndim}-dimensional", allowed="one value per row")
    gone = np.ma.getmaskarray(values).tolist()
    data = np.ma.getdata(values)
    if data.dtype == np.float32:  # 7.3 shall be 7.3, not 7.300000190734863
        data = data.astype(np.str_).astype(np.float64)
    cells = [None if lost else _plain(cell) for cell, lost in zip(data.tolist(), gone, strict=True)]
    unit = getattr(column, "unit", None)
    return RawColumn(heading, "" if unit is None else str(unit), cells)


def _plain(cell: Any) -> Any:
    if isinstance(cell, bytes):
        cell = cell.decode("utf-8", "replace")
    if isinstance(cell, str):
        return _cell(cell)
    return None if isinstance(cell, float) and np.isnan(cell) else cell
