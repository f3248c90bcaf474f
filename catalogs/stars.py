"""The star catalogue: nearby F, G and K stars with every filled value labelled.

Rows are all stars of the SIMBAD extract of spectral class F, G or K with parallax >= 25 mas and V <= 7.5, without a
bright limit and of every luminosity class, less blends whose components are listed and less four rows that a better
parallax puts beyond 40 pc (``stars_removed.csv``). A ranking uses all rows with V <= 7. Companions are flagged, never
dropped: dwarfs without a close companion are the paper's "nearly 700", but its own example, alpha Cen B, has one.

Values are read from ``data/stars.csv``; units and descriptions are in ``data/columns.csv``. A number is nan only where
its ``*_src`` column says ``missing``.

Stars and companions stand where their sources saw them: alpha Cen B where Hipparcos did in 1991;
`catalogs.star_places` moves them to a date. ``close_companion`` is SIMBAD's flag, by which the paper counts its sample.
Published temperatures are laid over the base table, and over refreshed tables (:mod:`catalogs.published_parameters`);
a table of one's own is never touched.
"""

import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Self

import numpy as np

from catalogs.frozen_table import FrozenTable
from catalogs.nomenclature import designation_key
from catalogs.published_parameters import updated_columns
from catalogs.shipped import shipped_lines, shipped_words
from catalogs.star_columns import COLUMNS
from cpic_core import ArrayLike, InputError, NDArray

_KINDS: dict[str, type] = {"int": np.int64, "bool": np.bool_, "float": np.float64, "text": np.str_}
_READERS: dict[str, Callable[[str], Any]] = {"int": int, "bool": int, "float": lambda text: float(text or math.nan)}


class OwnColumns(Mapping[str, NDArray[np.generic]]):
    """Columns of a user's table that are not used, by their headings: they travel to the output as the file has them.

    Parameters
    ----------
    cells : mapping of str to callable
        Returns the cells of a column, one a row of the file, masked where missing; called when they are asked for.
    rows : array_like
        Row of the file of each star, from 0.
    """

    def __init__(
        self,
        cells: Mapping[str, Callable[[], "np.ma.MaskedArray[Any, Any]"]] = MappingProxyType({}),
        rows: ArrayLike = (),
    ) -> None:
        self._cells, self._rows = cells, np.asarray(rows, np.int64)

    def __getitem__(self, heading: str) -> NDArray[np.generic]:
        """Return a column: numbers, truth values and texts, None where missing."""
        cells = self._cells[heading]()[self._rows]
        found = np.ma.getdata(cells).astype(object)
        found[np.ma.getmaskarray(cells)] = None
        found.flags.writeable = False
        return found

    def __iter__(self) -> Iterator[str]:
        return iter(self._cells)

    def __len__(self) -> int:
        return len(self._cells)

    def __reduce__(self) -> tuple[object, ...]:
        """Travel without the columns: what works in other processes does not need them."""
        return (OwnColumns, ())

    def select(self, rows: ArrayLike) -> "OwnColumns":
        """Return the same columns of some of the stars."""
        return OwnColumns(self._cells, self._rows[np.asarray(rows)]) if self._cells else self


@dataclass(frozen=True)
class StarTable(FrozenTable):
    """An immutable table of stars.

    Parameters
    ----------
    columns : mapping of str to ndarray
        Read-only arrays of equal length: float64, int64 (``hip``, 0 if none), bool or text.
    units : mapping of str to str
        Unit of each column, ``""`` for pure numbers and text.
    descriptions : mapping of str to str
        One line on each column.
    label : str
        What messages call the table; ``""`` for the embedded catalogue and selections of it.
    own : OwnColumns
        Columns of a user's file that are not used; none of other tables.
    """

    units: Mapping[str, str]
    descriptions: Mapping[str, str]
    label: str = ""
    own: OwnColumns = field(default_factory=OwnColumns)

    def column(self, name: str) -> NDArray[np.generic]:
        """Return one column (read-only).

        Raises
        ------
        InputError
            If there is no such column.
        """
        if name not in self.columns:
            raise InputError("column", name, allowed=", ".join(self.columns))
        return self.columns[name]

    def select(self, mask: ArrayLike) -> Self:
        """Return the table of the chosen rows.

        Parameters
        ----------
        mask : array_like
            Boolean mask of the table's length, or integer row numbers in the wanted order.

        Raises
        ------
        InputError
            If a mask has another length, or a row number is out of range.
        """
        chosen = np.asarray(mask)
        if chosen.size == 0 and chosen.dtype != np.bool_:
            chosen = chosen.astype(np.int64)
        if chosen.dtype == np.bool_:
            if chosen.shape != (len(self),):
                raise InputError("mask", f"shape {chosen.shape}", allowed=f"({len(self)},)")
        elif not np.issubdtype(chosen.dtype, np.integer):
            raise InputError("mask", str(chosen.dtype), allowed="booleans or integer row numbers")
        elif chosen.size and (chosen.min() < -len(self) or chosen.max() >= len(self)):
            raise InputError("mask", int(np.abs(chosen).max()), allowed=f"row numbers below {len(self)}")
        parts = {name: values[chosen] for name, values in self.columns.items()}
        return replace(self.with_columns(parts), own=self.own.select(chosen))

    def row(self, index: int) -> dict[str, str | int | float | bool]:
        """Return one star as a dictionary of plain Python values.

        Raises
        ------
        InputError
            If the index is out of range.
        """
        if not -len(self) <= index < len(self):
            raise InputError("row", index, allowed=f"0 to {len(self) - 1}")
        return {name: values[index].item() for name, values in self.columns.items()}

    def with_columns(self, columns: Mapping[str, NDArray[np.generic]]) -> Self:
        """Return the table with other columns, or more, which become read-only."""
        return replace(self, columns={**self.columns, **columns})

    @functools.cached_property
    def name_keys(self) -> Mapping[str, tuple[int, ...]]:
        """Rows by the canonical key of every name in the table's own columns; rows of that ``name`` come first."""
        found: dict[str, list[int]] = {}

        def add(text: str, row: int) -> None:
            rows = found.setdefault(designation_key(text), [])
            if row not in rows:
                rows.append(row)

        letters = self.column("component").tolist()
        for name in ("name", "simbad_id", "hd", "gj", "bayer", "flamsteed", "common_name"):
            for row, text in enumerate(self.column(name).tolist()):
                if text:
                    add(text, row)
                    if name in ("bayer", "flamsteed") and letters[row]:
                        add(f"{text} {letters[row]}", row)
        for row, number in enumerate(self.column("hip").tolist()):
            if number:
                add(f"HIP {number}", row)
        return MappingProxyType({key: tuple(rows) for key, rows in found.items() if key})


def star_table(values: Mapping[str, Sequence[object]], label: str, own: OwnColumns | None = None) -> StarTable:
    """Return a table with the columns and units of the embedded one.

    Parameters
    ----------
    values : mapping of str to sequence
        One sequence per column of :data:`catalogs.star_columns.COLUMNS`, of equal length.
    label : str
        What messages call the table.
    own : OwnColumns, optional
        What else the file has.

    Raises
    ------
    InputError
        If a column is missing or unknown, or the lengths differ.
    """
    names = [column.name for column in COLUMNS]
    if set(values) != set(names):
        wrong = sorted(set(values) ^ set(names))
        raise InputError(f"{label} columns", ", ".join(wrong), allowed="those of the embedded catalogue")
    lengths = {len(cells) for cells in values.values()}
    if len(lengths) > 1:
        raise InputError(f"{label} columns", f"lengths {sorted(lengths)}", allowed="one length")
    columns: dict[str, NDArray[np.generic]] = {
        column.name: np.array(list(values[column.name]), _KINDS[column.kind]) for column in COLUMNS
    }
    units = {column.name: column.unit for column in COLUMNS}
    descriptions = {column.name: column.description for column in COLUMNS}
    descriptions |= shipped_words("star_columns_of_any_table")
    return StarTable(columns, units, descriptions, label, own or OwnColumns())


def load_stars(*, updates: bool = True) -> StarTable:
    """Return the embedded catalogue, brightest star first. It is read once per process.

    Parameters
    ----------
    updates : bool
        Lay published temperatures over the base table (:func:`with_updates`); without them temperatures are those of
        ExoCat-1 and of colours.

    Returns
    -------
    StarTable
        All rows with V <= 7.5; ``table.select(table.column("v_mag") <= 7.0)`` is the ranked part.
    """
    return _stars(updates)


@functools.cache
def _stars(updates: bool) -> StarTable:
    if updates:
        return with_updates(_stars(updates=False))
    header, *rows = shipped_lines("stars.csv")
    texts = dict(zip(header, zip(*rows, strict=True), strict=True))
    cells = {column.name: list(map(_READERS.get(column.kind, str), texts[column.name])) for column in COLUMNS}
    return replace(star_table(cells, ""), descriptions={column.name: column.description for column in COLUMNS})


def with_updates(table: StarTable) -> StarTable:
    """Return the table with the published parameters of its stars."""
    return table.with_columns(updated_columns(table.columns))
