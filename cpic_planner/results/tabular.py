"""Rows of results for people who work in Python: as tables of astropy, as pandas frames, and short in a notebook."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from typing import TYPE_CHECKING, Any, ClassVar

from cpic_core import InputError, shortened

if TYPE_CHECKING:
    import pandas as pd
    from astropy.table import Table

    from cpic_planner.results.table import Taken

_MOST_FIELDS, _MOST_ROWS, _MOST_COLUMNS, _LONGEST = 8, 20, 12, 60
_ABOUT = ("fingerprint", "schema_version", "kind")


class Tabular:
    """Base of results: what has rows gives them as a table.

    Attributes
    ----------
    main_rows : str
        Field that holds the rows that the result is about; empty for the first one that holds rows.
    """

    main_rows: ClassVar[str] = ""

    def to_table(self, rows: str = "") -> Table:
        """Return the rows as a table of astropy, with units; missing numbers are masked.

        Parameters
        ----------
        rows : str
            Field that holds the rows; by default those that the result is about. One without rows is one row.

        Returns
        -------
        astropy.table.Table
            A column for each field of the row; of a mean with its error one for each number. Lists of words are
            joined with ``|``. ``meta`` has the plain fields of the result.

        Raises
        ------
        InputError
            If the result has no such rows.
        """
        from cpic_planner.results.table import astropy_table

        columns, entries = self._table(rows)
        plain = {
            name: value for name, value in vars(self).items() if isinstance(value, str | int | float) and value != ""
        }
        return astropy_table(columns, entries, plain if entries != [self] else {})

    def to_pandas(self, rows: str = "") -> pd.DataFrame:
        """Return the rows as a pandas frame, units in the names; missing numbers are NaN, of whole ones ``pandas.NA``.

        Parameters
        ----------
        rows : str
            As of `to_table`.

        Raises
        ------
        InputError
            As `to_table`.
        """
        from cpic_planner.results.table import data_frame

        return data_frame(*self._table(rows))

    def _table(self, rows: str) -> tuple[list[Taken], list[Any]]:
        from cpic_planner.results.table import own_taken, rows_of, taken_of

        kind: Any = type(self)
        held = rows_of(kind)
        if rows and rows not in held:
            raise InputError("rows", rows, allowed=", ".join(held) or "nothing: the result has no rows")
        name = rows or self.main_rows or next(iter(held), "")
        if not name:
            return taken_of(kind), [self]
        entries = list(getattr(self, name) or ())
        own = own_taken(entries) if "own" in held[name].model_fields else []
        return [*taken_of(held[name]), *own], entries

    def __repr_args__(self) -> Iterator[tuple[str, Any]]:
        """Yield what a short ``repr`` names: the first fields that hold something, and how many rows there are."""
        told = 0
        for name, value in vars(self).items():
            if name in _ABOUT or value is None or value == "" or isinstance(value, dict | Tabular):
                continue
            if isinstance(value, list | tuple):
                if value:
                    yield name, _Count(value)
            elif told < _MOST_FIELDS:
                told += 1
                yield name, shortened(value, _LONGEST) if isinstance(value, str) else value

    def _repr_html_(self) -> str:
        """Return the first rows as a table for a notebook."""
        frame = self.to_pandas()
        shown = frame.dropna(axis=1, how="all").head(_MOST_ROWS)
        text = shown.to_html(max_cols=_MOST_COLUMNS, border=0)
        return f"<p>{escape(repr(self))}</p>\n{text}\n<p>{len(shown)} of {len(frame)} rows</p>"


class _Count:
    """Stands for a list in a short ``repr``."""

    def __init__(self, items: list[Any] | tuple[Any, ...]) -> None:
        self._items = items

    def __repr__(self) -> str:
        first = self._items[0]
        if len(self._items) <= 3 and isinstance(first, str | int | float):
            return repr(self._items)
        return f"[{len(self._items)} {type(first).__name__}]"
