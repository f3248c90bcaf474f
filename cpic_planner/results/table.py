"""Rows as files and back: CSV, ECSV with units, Arrow schemas of Parquet files, pandas frames.

Columns derive from the row.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar, get_args, get_origin

from cpic_core import guarded, unguarded
from cpic_planner.results.base import Column, Result, columns_of
from simulator.config import validate

if TYPE_CHECKING:
    import pandas as pd

R = TypeVar("R", bound=Result)

FLAG_SEPARATOR = "|"
"""What stands between the flags of a ranked star in a file."""
_FILLED = {"float64": 0.0, "int64": 0, "bool": False}


def values_of(row: Result, *, before: str = "") -> dict[str, Any]:
    """Return the cells of a row by the names of its columns, with ``before`` in front of each name."""
    return {before + column.name: getattr(row, column.name) for column in columns_of(type(row))}


def names_of(row: type[Result], *, before: str = "") -> tuple[str, ...]:
    """Return the names of the columns of a kind of row, with ``before`` in front of each."""
    return tuple(before + column.name for column in columns_of(row))


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
    writer = csv.writer(buffer, lineterminator="\r\n")
    writer.writerow(names)
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


def _filled(column: Column, rows: Sequence[Result], joined: str) -> tuple[list[Any], list[bool]]:
    """Return the cells of a column without nulls, and which of them were null; texts that are null are empty."""
    cells = [getattr(row, column.name) for row in rows]
    missing = [cell is None for cell in cells]
    if column.dtype == "string":
        return ["" if cell is None else str(_plain(cell, joined)) for cell in cells], [False] * len(cells)
    return [_FILLED[column.dtype] if cell is None else cell for cell in cells], missing


def ecsv_text(row: type[Result], rows: Sequence[Result], meta: Mapping[str, Any], *, joined: str = "|") -> str:
    """Return rows as ECSV 1.0: unit and meaning of every column, and what the table is, in the header.

    Parameters
    ----------
    row : type
        Kind of the rows.
    rows : sequence of Result
    meta : mapping
        Of the table; plain values.
    joined : str
        What stands between the items of a list.

    Notes
    -----
    Reads back with ``astropy.table.Table.read(..., format="ascii.ecsv")``; missing numbers are masked, and texts that
    begin like a formula keep the apostrophe of `cpic_core.guarded`.
    """
    import numpy as np
    from astropy.table import Column as PlainColumn, MaskedColumn, Table

    table = Table()
    for column in columns_of(row):
        about = {"name": column.name, "unit": column.unit or None, "description": column.description or None}
        cells, missing = _filled(column, rows, joined)
        if column.dtype == "string":
            cells = list(map(guarded, cells))
        values = np.array(cells, dtype=str if column.dtype == "string" else column.dtype)
        masked = any(missing)
        table[column.name] = MaskedColumn(values, mask=missing, **about) if masked else PlainColumn(values, **about)
    table.meta.update(meta)
    buffer = io.StringIO()
    table.write(buffer, format="ascii.ecsv", delimiter=",")
    return buffer.getvalue()


def data_frame(row: type[Result], rows: Sequence[Result], *, joined: str = "|") -> pd.DataFrame:
    """Return rows as a pandas frame, units in the names; missing numbers are NaN or, of whole ones, ``pandas.NA``.

    Parameters
    ----------
    row : type
        Kind of the rows.
    rows : sequence of Result
    joined : str
        What stands between the items of a list.
    """
    import pandas as pd

    columns = {}
    for column in columns_of(row):
        cells, missing = _filled(column, rows, joined)
        dtype = "object" if column.dtype == "string" else column.dtype
        if any(missing) and dtype != "float64":
            dtype = {"int64": "Int64", "bool": "boolean"}[dtype]
        known = [None if gone else cell for cell, gone in zip(cells, missing, strict=True)]
        columns[column.name] = pd.Series(known, dtype=dtype)
    return pd.DataFrame(columns)


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
