"""Tables from files in every format that astronomers hand around, told apart by what they hold, each read by a library.

A file is read once, as bytes. One that refers to another file or to an address is refused before it is parsed: reading
a table opens nothing but that table and the ReadMe beside it that describes its bytes.
"""

import base64
import csv
import hashlib
import io
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from datetime import timedelta
from functools import partial
from itertools import compress
from numbers import Integral, Real
from pathlib import Path
from typing import Any, cast

import numpy as np

from cpic_core import InputError, NDArray, Record, bounded_fits, read_file, unguarded

_MAX_BYTES = 1_000_000_000
_MAX_README_BYTES = 10_000_000
_MAX_UNPACKED_BYTES = 4_000_000_000
_MAX_CELLS = 200_000_000
_MAX_PAGE_BYTES = 50_000_000  # of HTML, LaTeX and Excel, which take many times their size in memory
_SMALL_BYTES = 2_000_000  # up to here the standard library is as fast as importing pyarrow
_HEAD_BYTES = 200_000
_LOOKED_AT = 100  # lines from which a layout is told
_FORMATS = "CSV, ECSV, VOTable, FITS, MRT, IPAC, Parquet, Excel, HTML, LaTeX or plain text"
_PACKED = (b"\x1f\x8b", b"\x1f\x9d", b"BZh", b"\xfd7zXZ")  # what astropy unpacks unasked
_NAMES = "names of columns in the first line"
_FAILED = re.compile(r"QUERY_STATUS\W+(?:value\W+)?ERROR\b", re.IGNORECASE)
_CUT_OFF = re.compile(  # a curve may be "truncated at 1 %"
    r"\bOVERFLOW\b|\b(?:result|answer|table|output|rows)\b[^\n]*\btruncated\b|\btruncated\b[^\n]*\brows\b",
    re.IGNORECASE,
)
_CUT = "was cut off, as it says itself: rows are missing"
_MISSING = frozenset(("", "nan", "null", "none", "n/a", "na", "<na>", "nat", "--", "---", "-", "…", "...", "~", r"\n"))
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_COMMENT = re.compile(rb"(?:^|[\r\n])[ \t]*(#[^\r\n]*)")
_CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f\x7f\ufffd]")
_LINE = re.compile(r"[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+$")
_RULE = re.compile(r"(?=[-=+|:;, \t]+$).*(?:--|==|\|:?-).*|\(\d+ rows?\)")  # psql ends with the number of rows
_DESCRIBED = re.compile(r"^Byte-by-byte Description of file", re.MULTILINE | re.IGNORECASE)
_IPAC = re.compile(r"(?:(?:\\[^\r\n]*|[ \t]*)\r?\n)*(?:\|[^\r\n]*\|[ \t]*\r?\n){1,4}(?=[ \t]+[^|\s+])")
_VIZIER = re.compile(r"^#Column\t(\S+)\t[^\t\n]*\t([^\t\n]*)(?:\t\[ucd=([^\]\n]*))?", re.MULTILINE)
_TABULAR = re.compile(r"\\begin\{(?:tabular|tabulary|longtable)[x*]*\}|\\startdata")
_GREEK = "alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi pi rho sigma tau phi chi psi omega"
_LATEX_WORDS = (
    (r"\\frac\{([^{}]*)\}\{([^{}]*)\}", r"\1/\2"),
    (r"\^\{?\\circ\}?", "deg"),
    (r"\\(?:nodata|[clv]?dots)(?![A-Za-z])|\\(?:tablenotemark|tablefootmark|cite[a-z]*)\{[^{}]*\}", ""),
    (rf"\\({_GREEK.replace(' ', '|')})(?![a-z])", r"\1"),
    (r"\\[,;:! ]|~", " "),
    (r"\\([_#%&])|\\[A-Za-z]+\*?(?:\[[^\[\]]*\])?|[${}^]", r"\1"),
)
_Notes = tuple[str, ...]
_Parted = tuple[Sequence[Any], tuple["LeftOut", ...]]
"""Columns of cells, and the rows that have another number of them than the heading."""
_Mark = str | tuple[tuple[int, int | None], ...]
"""Separator of cells; or, of tables of fixed width, the first and last place of each."""


class TableBytes(Record):
    """A file's content, its name without folder, and the sha256 of the content."""

    name: str
    data: bytes
    sha256: str


class RawColumn(Record, eq=False):
    """One column as the file gives it.

    Parameters
    ----------
    heading, unit : str
        As the file has them; "" if it has none.
    source : numpy.ma.MaskedArray or callable
        The cells, or a function that makes them, which is called once, when they are asked for.
    description, ucd : str
        What the file says of the column, and its UCD (IVOA); "" if it says nothing.
    """

    heading: str
    unit: str
    source: Any
    description: str = ""
    ucd: str = ""

    @property
    def cells(self) -> "np.ma.MaskedArray[Any, Any]":
        """One value per row, masked where missing: texts (object), int64, float64 or bool."""
        if callable(self.source):
            object.__setattr__(self, "source", self.source())  # what it is made of is not kept
        return cast("np.ma.MaskedArray[Any, Any]", self.source)


ROW_OUT, CELL_OUT = "row left out", "taken as missing"
"""Words for what is done with rows and with cells that cannot be used."""


class LeftOut(Record):
    """A row of a file that was not used, or a cell that was taken as missing, and why.

    Parameters
    ----------
    row : int
        Number of the row below the heading, from 1.
    name : str
        What the row is about; ``""`` if it does not say.
    column : str
        Heading of the file, or several joined by " or ".
    value : str
        What stands there.
    why : str
        What may stand there, or what is wrong.
    done : {"row left out", "taken as missing"}
    """

    row: int
    name: str
    column: str
    value: str
    why: str
    done: str


class RawTable(Record):
    """All columns of a file, of equal length, remarks on the reading, and the broken rows that were left out."""

    name: str
    columns: Sequence[RawColumn]
    notes: _Notes = ()
    rejects: tuple[LeftOut, ...] = ()

    def __len__(self) -> int:
        return len(self.columns[0].cells)

    @property
    def shortened(self) -> str:
        """Words for the provenance of a table that says that rows are missing; ``""`` for any other."""
        return ", cut off: rows are missing" if any(note.endswith(_CUT) for note in self.notes) else ""

    def refusal_of(self, item: LeftOut) -> InputError:
        """Return the refusal of the table for a broken row."""
        allowed = item.why.removeprefix("allowed: ")
        return InputError(f"{self.name} row {item.row}", item.value, allowed=allowed, hint="a stray separator?")

    @property
    def numbers(self) -> NDArray[np.int64]:
        """The number of each row, counted from 1 below the heading: those of `rejects` are left out."""
        left_out = [reject.row for reject in self.rejects]
        return np.setdiff1d(np.arange(1, len(self) + len(left_out) + 1), left_out)


def read_bytes(path: str | Path, *, key: str = "catalog", presets: str = "snapshot, latest, simbad_2012") -> TableBytes:
    """Read a file whole; ``key`` is what it is asked for as, ``presets`` what may be given instead of a file.

    A ReadMe of the CDS beside it that describes its bytes is read too and put in front of them.

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
    allowed = f"{presets}, or the name of a table ({_FORMATS})" if presets else f"the name of a table ({_FORMATS})"
    data = read_file(path, key=key, allowed=allowed, max_bytes=_MAX_BYTES)
    place = Path(path).expanduser()
    readme = place.with_name("ReadMe")
    if place.suffix.lower() in (".dat", ".txt", ".tab", "") and place != readme and readme.is_file():
        told = read_file(readme, key=key, allowed="a ReadMe of the CDS", max_bytes=_MAX_README_BYTES)
        data = _described(place.name, data, told)
    return TableBytes(place.name, data, hashlib.sha256(data).hexdigest())


def _described(name: str, data: bytes, readme: bytes) -> bytes:
    """Return a data file of the CDS behind its description in a ReadMe; alone where that has none of it."""
    title = rb"^Byte-by-byte Description of file:[^\n]*(?<![\w.])" + re.escape(name.encode()) + rb"(?![\w.])[^\n]*\n"
    found = re.search(title, readme, re.MULTILINE)
    parts = re.split(rb"^(-{40,}[ \t\r]*\n)", readme[found.end() :], maxsplit=3, flags=re.MULTILINE) if found else []
    return found[0] + b"".join(parts[:6]) + data if found and len(parts) == 7 else data


def parse_table(file: TableBytes, readme: bytes | None = None) -> RawTable:
    """Read a table of any accepted format.

    Parameters
    ----------
    file : TableBytes
        What was read.
    readme : bytes, optional
        The ReadMe of the CDS that describes the bytes of a data file.

    Raises
    ------
    InputError
        If it is empty, of another format, damaged, or says of itself that the query behind it failed.
    """
    if not file.data or file.data.isspace():
        raise InputError(file.name, "an empty file", allowed=f"a table with a heading and rows ({_FORMATS})")
    if readme is not None:
        file = replace(file, data=_described(file.name, file.data, readme))
    what, read = _reader(file)
    try:
        table = read()
    except InputError:
        raise
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:160]
        raise InputError(file.name, "unreadable", allowed=f"a whole {what}", hint=reason) from None
    if not table.columns:
        raise InputError(file.name, "no columns", allowed="a table with columns")
    if len(table) == 0:
        if table.rejects:
            raise table.refusal_of(table.rejects[0])
        raise InputError(file.name, "no rows", allowed="at least one row below the heading")
    return table


def _reader(file: TableBytes) -> tuple[str, Callable[[], RawTable]]:
    """Return what a file is, in words, and the function that reads it."""
    start = file.data[:512].lstrip()
    if start.startswith(b"SIMPLE  ="):
        return "FITS table", partial(_astropy, file, "fits")
    if start.startswith(b"PAR1"):
        return "Parquet file", partial(_parquet, file)
    if start.startswith(b"PK\x03\x04"):
        return "Excel workbook", partial(_excel, file)
    if start.startswith(b"\xd0\xcf\x11\xe0"):
        raise InputError(file.name, "an old Excel file (.xls)", allowed=_FORMATS, hint="save it as .xlsx or CSV")
    notes: _Notes = ()
    if not _is_votable(start):
        file, notes = _in_utf8(file)
    text = file.data[:_HEAD_BYTES].decode("utf-8", "ignore").lstrip()
    if _is_votable(text[:512].encode()):
        return "VOTable", partial(_astropy, file, "votable")
    if text.startswith("# %ECSV"):
        return "ECSV table", partial(_astropy, file, "ecsv", notes)
    if text.startswith("<"):
        return "HTML table", partial(_html, file, notes)
    if _TABULAR.search(text):
        return "LaTeX table", partial(_latex, file, notes)
    if _DESCRIBED.search(text):
        return "MRT or CDS table", partial(_astropy, file, "cds", notes)
    if _IPAC.match(text):
        return "IPAC table", partial(_astropy, file, "ipac", notes)
    return "table", partial(_plain_text, file, notes)


def _is_votable(start: bytes) -> bool:
    return b"<VOTABLE" in start.upper() or (start.startswith(b"<?xml") and b"<html" not in start.lower())


def _in_utf8(file: TableBytes) -> tuple[TableBytes, tuple[str, ...]]:
    """Return a text as UTF-8 without a byte-order mark, and a note where it is written in another way."""
    if file.data.isascii() and b"\0" not in file.data:
        return file, ()
    encoding = "UTF-16" if file.data.startswith((b"\xff\xfe", b"\xfe\xff")) else "UTF-8"
    try:
        text = file.data.decode(encoding)
    except UnicodeDecodeError:
        encoding, text = "Windows-1252", file.data.decode("cp1252", "replace")
    if "\0" in text or (encoding != "UTF-8" and _CONTROL.search(text)):
        packed = file.data.startswith(_PACKED)
        hint = "unpack it first" if packed else "save it as CSV in UTF-8"
        raise InputError(file.name, "packed" if packed else "binary", allowed=f"a table ({_FORMATS})", hint=hint)
    if encoding == "UTF-8":
        return replace(file, data=file.data.removeprefix(b"\xef\xbb\xbf")), ()
    bare = re.sub(r"^\s*<\?xml[^>]*\?>", "", text)  # which names the other encoding
    return replace(file, data=bare.encode()), (f"{file.name}: read as {encoding}, not being UTF-8",)


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


def _plain_text(file: TableBytes, notes: _Notes) -> RawTable:
    """Read columns apart by commas, semicolons, tabs, bars or blanks, or of fixed width, every cell as a text."""
    name, data = file.name, file.data
    small = len(data) <= _SMALL_BYTES
    lines = _lines(data if small else data[:_HEAD_BYTES])
    heading, units, first, mark = _layout(name, lines if any(map(_is_content, lines)) else _lines(data))
    start = len("".join(lines[:first]).encode())
    slow = small or (b"#" in data and data.find(b"\n#", start) >= 0) or mark not in (",", ";", "\t", "|")
    said = b"\n".join(_COMMENT.findall(data if slow else data[:start])).decode()
    notes += remarks(name, said)
    parted = None if slow else _parted_by_arrow(data, start, mark, len(heading))
    if parted is None:
        body, *others = re.split(rb"[\r\n]#(?:RESOURCE=|Table\t)", data[start:])  # of VizieR
        notes += _several(name, 1 + len(others))
        parted = _parted(_split(name, filter(_is_content, _lines(body)), mark), len(heading))
    return _table(name, heading, units, parted, notes, said, mark != ",")


def _lines(data: bytes) -> list[str]:
    return _LINE.findall(data.decode("utf-8", "ignore"))


def _is_content(line: str) -> bool:
    plain = line.strip()
    return not (not plain or plain.startswith("#") or _RULE.fullmatch(plain))


def _layout(name: str, lines: list[str]) -> tuple[list[str], list[str], int, _Mark]:
    """Return headings, units, the number of the first line below them, and what stands between cells.

    A line of dashes below the headings (VizieR, SIMBAD, rdb, psql, Markdown, fixed width) says all of it.
    """
    for i, line in enumerate(lines):
        rule = line.rstrip()
        if i == 0 or not _RULE.fullmatch(rule.strip()) or _RULE.fullmatch(lines[i - 1].strip() or "--"):
            continue
        mark: _Mark = next((sign for sign in "|\t;," if sign in rule.replace("+", "|")), "")
        if not mark:
            starts = [found.start() for found in re.finditer(r"[-=]+", rule)]
            mark = tuple(zip([0, *starts[1:]], [*starts[1:], None], strict=True))
        above = [list(row) for row in _split(name, [text for text in lines[max(i - 2, 0) : i] if text.strip()], mark)]
        if len(above[-1]) > 1 and (mark == "|" or not lines[i - 1].startswith("#")):
            with_units = len(above) > 1 and len(above[0]) == len(above[1]) and _is_content(lines[i - 2])
            heading, units = above if with_units else (above[-1], [])
            return heading, units, i + 1, mark
    places = [i for i, line in enumerate(lines) if _is_content(line)]
    if not places:
        raise InputError(name, "no heading", allowed="a heading line and rows")
    sample = [lines[i] for i in places[:_LOOKED_AT]]
    mark = max((",", ";", "\t", "|", "  ", " "), key=lambda sign: _fit(sample, sign))
    rows = list(_split(name, sample, mark))
    if len(rows[0]) < 2:
        allowed = "columns separated by comma, semicolon, tab, bar or blanks"
        raise InputError(f"{name} heading", "one column", allowed=allowed)
    if any(map(_is_number, rows[0])):  # no heading, or one written as a comment
        comments = [line.strip().lstrip("# \t") for line in lines[: places[0]] if line.lstrip().startswith("#")]
        headed = [row for row in _split(name, filter(None, comments), mark) if len(row) == len(rows[0])]
        headed = headed or [row for text in comments if len(row := re.split(r"[\s,;|]+", text)) == len(rows[0])]
        if not headed or any(map(_is_number, headed[-1])):
            raise InputError(f"{name} heading", "numbers", allowed=_NAMES)
        units = _units_of([headed[-1], *rows]) if len(headed) > 1 else []
        return headed[-2] if units else headed[-1], units, places[0], mark
    if len(rows) > 1 and all(re.fullmatch(r"\d*[NSMD]", cell, re.IGNORECASE) for cell in rows[1]):  # types of rdb
        return rows[0], [], places[1] + 1, mark
    units = _units_of(rows[1:])
    return rows[0], units, places[bool(units)] + 1, mark


def _fit(lines: list[str], mark: str) -> tuple[float, bool, int]:
    """Return how well a mark parts lines: the share with as many cells as the heading, and how many these are."""
    if mark not in lines[0].strip():
        return 0.0, False, 0
    try:
        first, *rest = _split("", lines, mark)
    except InputError:
        first, *rest = [line.split(mark) for line in lines]
    fitting = [len(row) >= len(first) and not any(row[len(first) :]) for row in rest]
    share, blanks = sum(fitting) / len(rest) if rest else 1.0, not mark.strip(" ")
    return (0.0, False, 0) if blanks and share < 0.5 else (share, not blanks, len(first))  # prose has blanks, too


def _units_of(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the units that stand between headings and numbers, if the first of these rows holds some."""
    given = [i for i, cell in enumerate(rows[0]) if cell.strip("-")] if len(rows) > 1 else []
    numbers = any(i < len(row) and _is_number(row[i]) for row in rows[1:] for i in given)
    if not numbers or any(map(_is_number, rows[0])):
        return []
    from astropy import units

    plain = [cell.strip("[]()-") for cell in rows[0]]
    try:
        return plain if all(len(plain[i]) < 40 and units.Unit(plain[i]) is not None for i in given) else []
    except (ValueError, TypeError):
        return []


def _split(name: str, lines: Iterable[str], mark: _Mark) -> Iterator[list[str]]:
    """Return the cells of each line."""
    if isinstance(mark, tuple):
        return ([line[start:end].strip() for start, end in mark] for line in lines)
    if mark == "  ":
        return (re.split(r"\s{2,}|\t", line.strip()) for line in lines)
    if mark == " ":
        lines = (line.strip().replace("\t", " ") for line in lines)
    given = list(lines)
    try:
        rows = list(csv.reader(given, delimiter=mark, strict=True, skipinitialspace=True))
    except csv.Error as error:
        if mark not in ("\t", "|"):
            raise InputError(name, "broken quoting", allowed="a CSV table", hint=str(error)) from None
        rows = [line.split(mark) for line in given]  # who writes these seldom quotes
    return ([cell.strip() for cell in row] for row in rows)


def _parted(rows: Iterable[list[str]], width: int) -> _Parted:
    """Return the columns of rows, and those rows that have other numbers of cells than the heading."""
    filled = [row for row in rows if any(row)]  # spreadsheets write blank rows as separators alone
    good = [len(row) >= width and not any(row[width:]) for row in filled]
    rejects = [_rejected(i, len(row), width) for i, row in enumerate(filled, start=1) if not good[i - 1]]
    columns = list(zip(*(row[:width] for row in compress(filled, good)), strict=True)) or [()] * width
    return columns, tuple(rejects)


def _rejected(row: int, cells: int, width: int) -> LeftOut:
    return LeftOut(row, "", "", f"{cells} cells", f"allowed: {width} cells, as in the heading", ROW_OUT)


def _parted_by_arrow(data: bytes, start: int, mark: Any, width: int) -> _Parted | None:
    """Return what `_parted` returns of a large file, with columns of Arrow; None if it is none of the simple ones."""
    import pyarrow as pa
    from pyarrow import csv as tables

    rejects: list[LeftOut] = []
    quoted = data.find(b'"', start) >= 0
    simple = data.find(b"\n" + mark.encode() * (width - 1), start) < 0 and not (quoted and mark in "\t|")

    def rejected(row: tables.InvalidRow) -> str:
        nonlocal simple
        simple = simple and _is_content(row.text) and any(row.text.split(mark)[width:] or ["short"])
        rejects.append(_rejected(row.number, row.actual_columns, width))
        return "skip"

    names = list(map(str, range(width)))
    texts = dict.fromkeys(names, pa.string())
    found = tables.read_csv(
        pa.py_buffer(memoryview(data)[start:]),
        tables.ReadOptions(column_names=names, use_threads=False, block_size=2**21),
        tables.ParseOptions(delimiter=mark, newlines_in_values=quoted, invalid_row_handler=rejected),
        tables.ConvertOptions(column_types=texts, strings_can_be_null=False, check_utf8=False),  # it was decoded
    )
    whole = not quoted or len(found) + len(rejects) == sum(map(bool, map(bytes.strip, data[start:].splitlines())))
    return (found.columns, tuple(rejects)) if simple and whole else None  # else a quotation may span lines


def _table(
    name: str,
    heading: list[str],
    units: list[str],
    parted: _Parted,
    notes: _Notes,
    said: str = "",
    commas: bool = False,
) -> RawTable:
    """Return a table of columns of texts; those without heading and content are left out."""
    if not any(heading):
        raise InputError(f"{name} heading", "empty", allowed=_NAMES)
    told = {label: (about, ucd) for label, about, ucd in _VIZIER.findall(said)}
    columns, pointed = [], []
    for i, text in enumerate(heading):
        point = commas and _has_commas(_given(parted[0][i]))
        pointed += [text] * point
        cells: Any = partial(_texts, parted[0][i], text, point=point)
        column = RawColumn(text, units[i] if units else "", cells, *told.get(text, ()))
        if text or not column.cells.mask.all():
            columns.append(column)
    if pointed:
        notes += (f"{name}: decimal commas read in {', '.join(pointed)}",)
    return RawTable(name, columns, notes, parted[1])


def _has_commas(cells: Sequence[str]) -> bool:
    """Tell whether a column is of numbers with decimal commas: what spreadsheets write between semicolons."""
    given = [cell for cell in cells if cell.strip().lower() not in _MISSING]
    return any("," in cell for cell in given) and all(_is_number(cell.replace(",", ".", 1)) for cell in given)


def _given(column: Any) -> Any:
    return column.to_pylist() if hasattr(column, "to_pylist") else column


def _is_number(text: str) -> bool:
    return _NUMBER.fullmatch(text.strip()) is not None


def _texts(column: Any, heading: str, *, point: bool = False, guarded: bool = True) -> "np.ma.MaskedArray[Any, Any]":
    """Return texts without blanks around them, masked where the word is one for a missing value.

    In a column of signs (``DE-`` of declinations in three parts) a dash is none.
    """
    missing = _MISSING - {"-"} if heading.strip().lower().endswith(("-", "sign")) else _MISSING
    if getattr(column, "null_count", 1):
        texts = [cell.strip() if type(cell) is str else _said(cell) for cell in _given(column)]
    else:
        from pyarrow import compute

        texts = compute.utf8_trim_whitespace(column).to_pylist()
    gone = [not text or (not "0" <= text[0] <= "9" and text.lower() in missing) for text in texts]
    guarded = guarded and "'" in "".join(texts)
    plain = [unguarded(text) if text[:1] == "'" else text for text in texts] if guarded else texts
    cells = np.array([text.replace(",", ".") for text in plain] if point else plain, object)
    cells[gone] = ""
    return np.ma.MaskedArray(cells, gone, fill_value="")


def _said(cell: Any) -> str:
    return "" if cell is None else (cell.decode("utf-8", "replace") if isinstance(cell, bytes) else str(cell)).strip()


def column_of(heading: str, unit: str, cells: Sequence[Any]) -> RawColumn:
    """Return a column of a list: numbers if all cells are, else texts; None and nan are missing.

    Parameters
    ----------
    heading, unit : str
    cells : sequence
        Texts, numbers, truth values and None.
    """
    given = [cell for cell in cells if cell is not None]
    for kind, dtype in ((bool | np.bool_, np.bool_), (Integral, np.int64), (Real, np.float64)):
        if given and all(isinstance(cell, kind) for cell in given):
            gone = np.array([cell is None for cell in cells])
            try:
                data = np.array([dtype() if cell is None else cell for cell in cells], dtype)
            except OverflowError:
                continue
            return RawColumn(heading, unit, _masked(data, gone, heading))
    return RawColumn(heading, unit, _texts(cells, heading, guarded=False))


def _masked(data: Any, gone: Any, heading: str, *, guarded: bool = False) -> "np.ma.MaskedArray[Any, Any]":
    """Return plain values, masked where they are missing or nan.

    A number of single precision becomes the shortest decimal that it stands for: 7.3, not 7.300000190734863.
    """
    if data.dtype.kind == "f":
        data = (data.astype(np.str_) if data.itemsize < 8 else data).astype(np.float64)
        gone = gone | np.isnan(data)
        return np.ma.MaskedArray(np.where(gone, np.nan, data), gone)
    if data.dtype.kind in "ib" or (data.dtype.kind == "u" and data.max(initial=0) < 2**63):
        return np.ma.MaskedArray(data.astype(bool if data.dtype.kind == "b" else np.int64), gone)
    texts = _texts(data, heading, guarded=guarded)
    texts[gone] = np.ma.masked
    return texts


def _html(file: TableBytes, notes: _Notes) -> RawTable:
    """Read the largest table of a page; end tags may be left out, as HTML allows."""
    from html.parser import HTMLParser

    _refuse_large(file.name, len(file.data))
    tables: list[list[list[list[str]]]] = []
    begun: list[list[list[list[str]]]] = []

    class Page(HTMLParser):
        def handle_starttag(self, tag: str, attrs: object) -> None:
            if tag == "table":
                begun.append([])
                tables.append(begun[-1])
            elif tag == "tr" and begun:
                begun[-1].append([])
            elif tag in ("td", "th") and begun and begun[-1]:
                begun[-1][-1].append([])
            elif tag == "br":
                self.handle_data(" ")

        def handle_endtag(self, tag: str) -> None:
            if tag == "table" and begun:
                begun.pop()

        def handle_data(self, data: str) -> None:
            if begun and begun[-1] and begun[-1][-1]:
                begun[-1][-1][-1].append(data)

    Page().feed(file.data.decode())
    found = max(tables, key=lambda rows: sum(map(len, rows)), default=[])
    if len(found) < 2:
        raise InputError(file.name, "no table", allowed="a page with a table of rows and columns")
    rows = [[" ".join("".join(cell).split()) for cell in row] for row in found if row]
    return _of_rows(file.name, rows, notes, sum(len(rows) > 1 for rows in tables), "largest")


def _latex(file: TableBytes, notes: _Notes) -> RawTable:
    """Read the first table of a text in LaTeX or AASTeX; its commands are taken as text, and none is followed."""
    _refuse_large(file.name, len(file.data))
    text = re.sub(r"(?<!\\)%.*", "", file.data.decode())
    _, _, whole = text.partition("\\tablehead{")
    if "\\startdata" in whole:
        heading, _, body = whole.partition("\\startdata")
        parts = [heading.rpartition("}")[0], body.partition("\\enddata")[0]]
    else:
        begun = _TABULAR.search(text)
        parts = [text[begun.end() :].partition("\n")[2].partition("\\end{")[0]] if begun else []
    lines = [line for part in parts for line in re.split(r"\\\\(?:\[[^\[\]]*\])?|\\tabularnewline", part)]
    rows = [[_plain_latex(cell) for cell in re.split(r"(?<!\\)&", line)] for line in lines]
    return _of_rows(file.name, list(filter(any, rows)), notes, len(_TABULAR.findall(text)))


def _plain_latex(cell: str) -> str:
    for pattern, plain in _LATEX_WORDS:
        cell = re.sub(pattern, plain, cell)
    return " ".join(cell.split())


def _excel(file: TableBytes) -> RawTable:
    """Read the first sheet of a workbook; a formula is what was last computed of it."""
    import zipfile

    from openpyxl import load_workbook

    with zipfile.ZipFile(io.BytesIO(file.data)) as archive:
        _refuse_large(file.name, sum(item.file_size for item in archive.infolist()))
        if any(b"<!DOCTYPE" in archive.open(part).read(4096) for part in archive.namelist()):
            raise InputError(file.name, "a document type (DOCTYPE)", allowed="a plain workbook")
    book = load_workbook(io.BytesIO(file.data), read_only=True, data_only=True, keep_links=False)
    sheet, rows, cells = book.worksheets[0], [], 0
    sheet.reset_dimensions()  # the file may say any
    for row in sheet.iter_rows(values_only=True):
        rows.append([_hours(cell) if isinstance(cell, timedelta) else _said(cell) for cell in row])
        if (cells := cells + len(row)) > _MAX_PAGE_BYTES:
            raise InputError(file.name, "too many cells", allowed=f"up to {_MAX_PAGE_BYTES:.0e}", hint="save it as CSV")
    filled = [len(row) - row.count("") for row in rows]
    start = next((i for i, count in enumerate(filled) if 2 * count > max(filled)), 0)  # below titles
    width = max(map(len, rows), default=0)
    return _of_rows(file.name, [row + [""] * (width - len(row)) for row in rows[start:]], (), len(book.worksheets))


def _hours(cell: timedelta) -> str:
    """Return what was typed as 61:03:00, which a sheet keeps as a time of more than two days."""
    minutes, seconds = divmod(cell.total_seconds(), 60.0)
    return f"{minutes // 60.0:.0f}:{minutes % 60.0:02.0f}:{seconds:g}"


def _of_rows(name: str, rows: list[list[str]], notes: _Notes, tables: int, which: str = "first") -> RawTable:
    """Return a table of rows of cells, the first of them the headings and the second perhaps the units."""
    notes += _several(name, tables, which)
    units = _units_of(rows[1:_LOOKED_AT])
    heading = rows[0] if rows else []
    return _table(name, heading, units, _parted(rows[2 if units else 1 :], len(heading)), notes)


def _several(name: str, tables: int, which: str = "first") -> _Notes:
    return (f"{name} holds several tables: the {which} is read",) if tables > 1 else ()


def _refuse_large(name: str, size: int) -> None:
    if size > _MAX_PAGE_BYTES:
        allowed = f"up to {_MAX_PAGE_BYTES / 1e6:.0f} MB"
        raise InputError(name, f"{size / 1e6:.0f} MB unpacked", allowed=allowed, hint="save it as CSV")


def _astropy(file: TableBytes, kind: str, notes: _Notes = ()) -> RawTable:
    table, said = astropy_table(file, kind)
    columns = [table[name] for name in table.colnames]
    vectors = [column for column in columns if getattr(column, "ndim", 1) == 2]
    if len(table) == 1 and any(re.match("wav|lambda", column.info.name, re.IGNORECASE) for column in vectors):
        columns = _turned(vectors)
    plain = [column for column in columns if getattr(column, "ndim", 1) == 1]
    left = _left_out(file.name, [column.info.name for column in columns if getattr(column, "ndim", 1) > 1])
    guarded = kind not in ("fits", "votable", "parquet")
    raw = [raw_column(file.name, column.info.name, column, guarded=guarded) for column in plain]
    return RawTable(file.name, raw, notes + said + left)


def _turned(vectors: list[Any]) -> list[Any]:
    """Return the longest vectors of a table of one row as columns: so spectrographs of HST and ESO keep a spectrum."""
    from astropy.table import MaskedColumn

    longest = max(column.shape[1] for column in vectors)
    return [
        MaskedColumn(column[0], column.info.name, unit=column.unit, description=column.info.description)
        for column in vectors
        if column.shape[1] == longest
    ]


def astropy_table(file: TableBytes, kind: str) -> tuple[Any, tuple[str, ...]]:
    """Return the first table of a file as astropy reads it, and remarks.

    Parameters
    ----------
    file : TableBytes
    kind : {"votable", "fits", "parquet", "ecsv", "cds", "ipac"}
        What its content says that it is.

    Raises
    ------
    InputError
        If it refers to something outside.
    Exception
        Of many kinds, if it is damaged.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what astropy forgives is no reason to refuse a table
        tables = 1
        if kind == "votable":
            parsed, said = votable_document(file)
            tables = sum(1 for _ in parsed.iter_tables())
            table = parsed.get_first_table().to_table(use_names_over_ids=True)
        elif kind == "fits":
            table, tables = _fits_table(file.data)
            said = repr(table.meta)
        elif kind == "parquet":
            from astropy.table import Table

            table, said = Table.read(io.BytesIO(file.data), format="parquet"), ""
        else:
            from astropy.io import ascii as text_tables

            # As lines: a text without an end of line would be taken for the name of a file.
            text = file.data.decode().replace("\r\n", "\n").replace("\r", "\n").rstrip("\n")
            table = text_tables.read(text.split("\n"), format=kind)
            said = repr(table.meta)
        return table, remarks(file.name, said) + _several(file.name, tables)


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
    if first is not None and (stream := _BINARY2.search(file.data)) is not None and stream[1] is not None:
        _mask_texts(first, io.BytesIO(base64.b64decode(stream[1])))
    return parsed, said


def _fits_table(data: bytes) -> tuple[Any, int]:
    """Return the first table of a FITS file, masked where the file has its nulls, and the number of tables.

    In binary tables the standard (FITS 4.0, sections 7.2.2 and 7.3.2) compares TNULL with integers before TSCAL and
    TZERO; astropy does so without these alone. In ASCII tables it is a text, with which Table.read fails.
    """
    from astropy.io import fits
    from astropy.table import MaskedColumn, Table

    with fits.open(bounded_fits(io.BytesIO(data)), character_as_bytes=True) as units:
        tables = [item for item in units if isinstance(item, fits.BinTableHDU | fits.TableHDU)]
        if not tables:
            raise ValueError("it has no table extension")
        unit, text = tables[0], isinstance(tables[0], fits.TableHDU)
        table = Table() if text else Table.read(unit, format="fits")
        written = unit.data.view(np.ndarray)
        for i, column in enumerate(unit.columns, start=1):
            raw = written[column.name]
            if text:
                gone = np.isin(np.char.strip(raw), [str(column.null).strip().encode(), b""])
                table[column.name] = MaskedColumn(np.asarray(unit.data[column.name]), mask=gone, unit=column.unit)
            elif isinstance(column.null, int) and (column.bscale or column.bzero) and raw.ndim == 1:
                table[column.name] = MaskedColumn(table[column.name], mask=raw == column.null)
            if ucd := unit.header.get(f"TUCD{i}"):  # as TOPCAT writes it
                table[column.name].meta["ucd"] = ucd
    return table, len(tables)


_BINARY2 = re.compile(rb"<(?:\w+:)?DATA\b[^>]*>(?:\s*<(?:\w+:)?BINARY2\b[^>]*>\s*<(?:\w+:)?STREAM\b[^>]*>([^<]*)</)?")


def _mask_texts(table: Any, stream: io.BytesIO) -> None:
    """Mask the null texts of a table of BINARY2, which astropy leaves out.

    Each row begins with one bit for each field, the highest first (IVOA VOTable 1.4, section 6.4).
    """
    texts = [i for i, field in enumerate(table.fields) if field.datatype in ("char", "unicodeChar")]
    if not texts or not len(table.array):
        return
    size = (len(table.fields) + 7) // 8
    steps: list[Any] = [size]
    stream.seek(size)
    for field in table.fields:
        start = stream.tell()
        field.converter.binparse(stream.read)
        if "*" in (field.arraysize or ""):
            steps += [field.converter.binparse, 0]
        else:
            steps[-1] += stream.tell() - start
    flags = []
    stream.seek(0)
    for _ in range(len(table.array)):
        flags.append(stream.read(steps[0])[:size])
        for parse, plain in zip(steps[1::2], steps[2::2], strict=True):
            parse(stream.read)
            stream.seek(plain, io.SEEK_CUR)
    nulls = np.unpackbits(np.frombuffer(b"".join(flags), np.uint8).reshape(-1, size), axis=1).astype(bool)
    for i in texts:
        table.array.mask[table.fields[i].ID] |= nulls[:, i]


_CELL_TAGS = (b"<TR>", b"</TR>", b"<TD>", b"</TD>", b"<TD/>")


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
    start, tag, rest = xml.partition(b"<TABLEDATA>")
    cells, tag_end, end = rest.partition(b"</TABLEDATA>")
    if cells.count(b"<") == cells.count(b">") == sum(map(cells.count, _CELL_TAGS)):  # cells of plain text: most of it
        xml = start + tag + tag_end + end
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


def raw_column(name: str, heading: str, column: Any, *, guarded: bool = False) -> RawColumn:
    """Return a column of an astropy table as plain cells.

    Parameters
    ----------
    name : str
        Name of the file, for messages.
    heading : str
        Name of the column.
    column : astropy.table.Column
        Masked cells and nan are missing; a number of single precision becomes the shortest decimal that it stands for.
    guarded : bool
        Whether texts may be guarded against being taken for formulas.

    Raises
    ------
    InputError
        If it has more than one value per row.
    """
    values = getattr(column, "value", column)  # a Quantity column has its numbers there
    if getattr(values, "ndim", 1) != 1:
        raise InputError(f"{name} column {heading}", f"{values.ndim}-dimensional", allowed="one value per row")
    unit = getattr(column, "unit", None)
    about, ucd = getattr(column, "description", None), (getattr(column, "meta", None) or {}).get("ucd")
    data, gone = np.ma.getdata(values), np.ma.getmaskarray(values)
    cells: Any = partial(_masked, data, gone, heading, guarded=guarded)
    return RawColumn(heading, "" if unit is None else str(unit), cells, str(about or ""), str(ucd or ""))


def _parquet(file: TableBytes) -> RawTable:
    """Read a Parquet file; columns of lists and of records are left out."""
    import pyarrow as pa
    from pyarrow import parquet

    about = parquet.read_metadata(pa.BufferReader(file.data))
    unpacked = sum(about.row_group(i).total_byte_size for i in range(about.num_row_groups))
    if unpacked > _MAX_UNPACKED_BYTES or about.num_rows * about.num_columns > _MAX_CELLS:
        shown = f"{about.num_rows} rows of {about.num_columns} columns, {unpacked / 1e9:.1f} GB unpacked"
        raise InputError(file.name, shown, allowed=f"up to 4 GB and {_MAX_CELLS:.0e} cells")
    schema = about.schema.to_arrow_schema()
    if b"table_meta_yaml" in (schema.metadata or {}):  # by astropy, which keeps units and gaps in its own way
        return _astropy(file, "parquet")
    kinds = {field.name: field.type for field in schema}
    plain = [name for name, kind in kinds.items() if not pa.types.is_nested(kind)]
    texts = [name for name in plain if pa.types.is_string(kinds[name]) or pa.types.is_large_string(kinds[name])]
    table = parquet.read_table(pa.BufferReader(file.data), columns=plain, read_dictionary=texts, use_threads=False)
    columns = [RawColumn(name, "", partial(_arrow_cells, file.name, name, table[name])) for name in plain]
    return RawTable(file.name, columns, _left_out(file.name, [name for name in kinds if name not in plain]))


def _left_out(name: str, headings: Sequence[str]) -> tuple[str, ...]:
    said = f"{name}: columns of several values per row are left out: {', '.join(headings)}"
    return (said,) if headings else ()


def _arrow_cells(name: str, heading: str, column: Any) -> "np.ma.MaskedArray[Any, Any]":
    import pyarrow as pa
    from pyarrow import compute

    if pa.types.is_dictionary(column.type):  # a short file may hold a long text a million times
        longest = [compute.max(compute.binary_length(part.dictionary)).as_py() or 0 for part in column.chunks]
        if max(longest, default=0) * len(column) > _MAX_UNPACKED_BYTES:
            raise InputError(f"{name} column {heading}", "too long texts", allowed="names, numbers and remarks")
        return _texts(column.cast(column.type.value_type), heading, guarded=False)
    gone, given = column.is_null().to_numpy(), column.drop_null().to_numpy()
    if given.dtype.kind not in "biuf":
        return _texts(column.cast(pa.string()), heading, guarded=False)
    data = np.zeros(len(column), given.dtype)
    data[~gone] = given
    return _masked(data, gone, heading)
