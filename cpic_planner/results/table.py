"""Rows as files and back: CSV, ECSV with units, Arrow schemas of Parquet files, tables of astropy, pandas frames.

Columns derive from the row.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar, get_args, get_origin

from cpic_core import guarded, unguarded
from cpic_planner.results.base import Column, Result, column_of, columns_of
from simulator.config import validate

if TYPE_CHECKING:
    import pandas as pd
    from astropy.table import Table

R = TypeVar("R", bound=Result)

FLAG_SEPARATOR = "|"
"""What stands between the flags of a ranked star in a file."""
OWN = "column of your own table, as it is there"
_FILLED = {"float64": 0.0, "int64": 0, "bool": False}
_MIDDLE = re.compile("_(mean|median)$")


@dataclass(frozen=True)
class Taken:
    """A column of a file, and where its values stand.

    Attributes
    ----------
    column : Column
    value : callable
        Returns the value of an entry; null where it has none.
    """

    column: Column
    value: Callable[[Any], Any]


def taken_of(row: type[Result], *paths: str, of: Callable[[Any], Any] = lambda entry: entry) -> list[Taken]:
    """Return columns of a kind of row, in order: numbers of records that it holds are columns of their own.

    Parameters
    ----------
    row : type
    *paths : str
        Names of fields, with dots between those of records in records; every field by default. A record of numbers
        alone, such as a mean with its error, gives a column for each: ``NAME`` is the mean or the median, and
        ``NAME_error``, ``NAME_low`` stand beside it.
    of : callable
        Returns the row of an entry.
    """
    found = []
    for path in paths or row.model_fields:
        *outer, name = path.split(".")
        kind, unit = row, ""
        for part in outer:
            unit = column_of(kind, part).look.unit or ""
            kind = _record(kind, part) or Result
        found += _flat(kind, name, outer, unit, of)
    return found


def _flat(kind: type[Result], name: str, outer: list[str], unit: str, of: Callable[[Any], Any]) -> list[Taken]:
    column, path = column_of(kind, name), [*outer, name]
    if column.dtype:
        unit = column.unit or (unit if column.right and column.dtype != "bool" else "")
        return [Taken(replace(column, name="_".join(path), unit=unit), lambda entry: _at(of(entry), path))]
    record = _record(kind, name)
    parts = () if record is None else columns_of(record)
    if record is None or len(parts) < len(record.model_fields) or not all(part.right for part in parts):
        return []
    held = [item for part in parts for item in _flat(record, part.name, path, column.look.unit or "", of)]
    return [
        replace(item, column=replace(item.column, name=_MIDDLE.sub("", item.column.name), description=said))
        for item, part in zip(held, parts, strict=True)
        for said in ["; ".join(filter(None, (column.description, part.description or part.name.replace("_", " "))))]
    ]


def _record(kind: type[Result], name: str) -> type[Result] | None:
    """Return the kind of the record that a field holds; None where it holds something else."""
    annotation = kind.model_fields[name].annotation
    for held in (annotation, *get_args(annotation)):
        if isinstance(held, type) and issubclass(held, Result):
            return None if get_origin(annotation) in (list, tuple, dict) else held
    return None


def _at(value: Any, path: Sequence[str]) -> Any:
    for name in path:
        value = getattr(value, name, None)
    return value


def own_taken(entries: Sequence[Any]) -> list[Taken]:
    """Return the columns of a user's table that rows carry, in the order in which these have them.

    Parameters
    ----------
    entries : sequence
        Rows with a field ``own``.
    """
    names = dict.fromkeys(name for entry in entries for name in entry.own)
    return [
        Taken(Column(name, _dtype_of([entry.own.get(name) for entry in entries]), OWN), partial(_own_value, name))
        for name in names
    ]


def _own_value(name: str, entry: Any) -> Any:
    return entry.own.get(name)


def _dtype_of(cells: Iterable[Any]) -> str:
    """Return the type of a column with these cells: numbers or truth values if all are."""
    kinds = {type(cell) for cell in cells if cell is not None}
    if kinds == {bool}:
        return "bool"
    return "int64" if kinds == {int} else "float64" if kinds and kinds <= {int, float} else "string"


def values_of(row: Result, *, before: str = "") -> dict[str, Any]:
    """Return the cells of a row by the names of its columns, with ``before`` in front of each name."""
    return {before + column.name: getattr(row, column.name) for column in columns_of(type(row))}


def names_of(row: type[Result], *, before: str = "") -> tuple[str, ...]:
    """Return the names of the columns of a kind of row, with ``before`` in front of each."""
    return tuple(before + column.name for column in columns_of(row))


def rows_of(kind: type[Result]) -> dict[str, type[Result]]:
    """Return the fields of a kind of result that hold rows, and of which kind these are."""
    found = {}
    for name, field in kind.model_fields.items():
        lists = (held for held in (field.annotation, *get_args(field.annotation)) if get_origin(held) in (list, tuple))
        for row in (held for several in lists for held in get_args(several)[:1]):
            if isinstance(row, type) and issubclass(row, Result) and taken_of(row):
                found[name] = row
    return found


def csv_text(names: Sequence[str], rows: Iterable[Mapping[str, Any]], *, joined: str = ";", digits: int = 0) -> str:
    """Return rows as CSV text: a heading of names, one line a row, units in the names.

    Parameters
    ----------
    names : sequence of str
        Columns, in order.
    rows : iterable of mapping
        Cells by name. Missing and null ones are empty, yes and no are 1 and 0; texts are `cpic_core.guarded`.
    joined : str
        What stands between the items of a list.
    digits : int
        Significant digits of numbers; 0: all, the shortest text that reads back to the same double.
    """

    def cell(value: Any) -> Any:
        if isinstance(value, float) and digits:
            return f"{value:.{digits}g}"
        plain = "" if value is None else int(value) if isinstance(value, bool) else _plain(value, joined)
        return guarded(plain) if isinstance(plain, str) else plain

    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(map(guarded, names))
    writer.writerows([cell(row.get(name)) for name in names] for row in rows)
    return buffer.getvalue()


def rows_from_csv(row: type[R], text: str, *, joined: str = ";") -> list[R]:
    """Return the rows that `csv_text` or `ecsv_text` wrote; columns that the kind of row does not have are left out.

    Parameters
    ----------
    row : type
        Kind of the rows.
    text : str
        With a heading of names; lines that begin with # in front of it are comments.
    joined : str
        What stands between the items of a list.

    Raises
    ------
    InputError
        For a column that is missing, or a cell that is none of its column.
    """
    while text.startswith("#"):
        text = text.partition("\n")[2]
    return [
        validate(
            row, {name: _read(row, name, cell, joined) for name, cell in cells.items() if name in row.model_fields}
        )
        for cells in csv.DictReader(io.StringIO(text, newline=""), restkey="")
    ]


def _read(row: type[Result], name: str, cell: str | None, joined: str) -> Any:
    kind, cell = row.model_fields[name].annotation, unguarded(cell or "")
    if get_origin(kind) in (list, tuple):
        return [item for item in cell.split(joined) if item]
    return None if not cell and type(None) in get_args(kind) else cell


def _plain(value: Any, joined: str) -> Any:
    return joined.join(str(item) for item in value) if isinstance(value, (list, tuple)) else value


def _filled(taken: Taken, entries: Sequence[Any], joined: str) -> tuple[list[Any], list[bool]]:
    """Return the cells of a column without nulls, and which of them were null; texts that are null are empty."""
    cells = [taken.value(entry) for entry in entries]
    missing = [cell is None for cell in cells]
    dtype = taken.column.dtype
    if dtype == "string":
        return ["" if cell is None else str(_plain(cell, joined)) for cell in cells], [False] * len(cells)
    return [_FILLED[dtype] if cell is None else cell for cell in cells], missing


def astropy_table(
    columns: Sequence[Taken],
    entries: Sequence[Any],
    meta: Mapping[str, Any],
    *,
    joined: str = FLAG_SEPARATOR,
    text: Callable[[str], str] = str,
) -> Table:
    """Return a table of astropy with unit and meaning of every column; missing numbers are masked.

    Parameters
    ----------
    columns : sequence of Taken
    entries : sequence
        Rows, or what the columns take values from.
    meta : mapping
        Of the table; plain values.
    joined : str
        What stands between the items of a list.
    text : callable
        Returns a text as the table has it.
    """
    import numpy as np
    from astropy.table import Column as PlainColumn, MaskedColumn, Table

    table = Table(meta=dict(meta))
    for taken in columns:
        column = taken.column
        about = {"name": text(column.name), "unit": column.unit or None, "description": column.description or None}
        cells, missing = _filled(taken, entries, joined)
        texts = column.dtype == "string"
        values = np.array(list(map(text, cells)) if texts else cells, dtype=str if texts else column.dtype)
        masked = any(missing)
        table[about["name"]] = MaskedColumn(values, mask=missing, **about) if masked else PlainColumn(values, **about)
    return table


def ecsv_text(
    columns: Sequence[Taken], entries: Sequence[Any], meta: Mapping[str, Any], *, joined: str = FLAG_SEPARATOR
) -> str:
    """Return rows as ECSV 1.0: unit and meaning of every column, and what the table is, in the header.

    Parameters
    ----------
    columns, entries, meta, joined
        As of `astropy_table`.

    Notes
    -----
    Reads back with ``astropy.table.Table.read(..., format="ascii.ecsv")``; missing numbers are masked, and texts that
    begin like a formula keep the apostrophe of `cpic_core.guarded`.
    """
    buffer = io.StringIO()
    table = astropy_table(columns, entries, meta, joined=joined, text=guarded)
    table.write(buffer, format="ascii.ecsv", delimiter=",")
    return buffer.getvalue()


def data_frame(columns: Sequence[Taken], entries: Sequence[Any], *, joined: str = FLAG_SEPARATOR) -> pd.DataFrame:
    """Return rows as a pandas frame, units in the names; missing numbers are NaN or, of whole ones, ``pandas.NA``.

    Parameters
    ----------
    columns, entries, joined
        As of `astropy_table`.
    """
    import pandas as pd

    series = {}
    for taken in columns:
        cells, missing = _filled(taken, entries, joined)
        dtype = "object" if taken.column.dtype == "string" else taken.column.dtype
        if any(missing) and dtype != "float64":
            dtype = {"int64": "Int64", "bool": "boolean"}[dtype]
        known = [None if gone else cell for cell, gone in zip(cells, missing, strict=True)]
        series[taken.column.name] = pd.Series(known, dtype=dtype)
    return pd.DataFrame(series)


def parquet_bytes(columns: Sequence[Taken], entries: Sequence[Any], *, joined: str = FLAG_SEPARATOR) -> bytes:
    """Return rows as a Parquet file, without nulls: unit and meaning of every column stand in its metadata.

    Parameters
    ----------
    columns, entries, joined
        As of `astropy_table`.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    cells = [_filled(taken, entries, joined)[0] for taken in columns]
    sink = io.BytesIO()
    pq.write_table(pa.table(cells, schema=arrow_schema([taken.column for taken in columns])), sink)
    return sink.getvalue()


def arrow_schema(columns: Sequence[Column]) -> Any:
    """Return the Arrow schema of columns without nulls: types, and unit and meaning of each column."""
    import pyarrow as pa

    return pa.schema(
        [
            pa.field(
                column.name,
                pa.string() if column.dtype == "string" else pa.from_numpy_dtype(column.dtype),
                nullable=False,
                metadata={"unit": column.unit, "description": column.description},
            )
            for column in columns
        ]
    )
