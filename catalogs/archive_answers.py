"""Read the answers of archives: columns under names old and new, in our units; what cannot be right is refused.

``archive_columns.csv`` lists what is read: SIMBAD's two answers under the names of TAP, of ``add_votable_fields`` and
of astroquery before 0.4.8, and the NASA Exoplanet Archive's table ``ps``, with its names before 2021. A measured
quantity of ``ps`` has columns for both errors and a limit beside its own: a limit is no value, unless the table has a
quantity of ours for it too.
"""

import functools
import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

from catalogs.shipped import shipped_rows
from catalogs.table_cells import Column, Columns, Row, read_rows
from catalogs.table_files import RawTable
from catalogs.tap_client import RefreshError
from catalogs.written_values import unit_of
from cpic_core import InputError


@functools.cache
def asked_columns(table: str) -> Mapping[str, Mapping[str, str]]:
    """Return the rows of ``archive_columns.csv`` on an answer, by the names of its columns."""
    return {row["column"]: row for row in shipped_rows("archive_columns.csv") if row["table"] == table}


@functools.cache
def _columns(table: str) -> Columns:
    def column(row: Mapping[str, str]) -> Column:
        low, high = float(row["low"] or -math.inf), float(row["high"] or math.inf)
        return Column(row["column"], "", row["kind"], row["unit"], row["headings"], low, high)

    return Columns(*map(column, asked_columns(table).values()))


def read_answer(answer: RawTable, table: str, *, unique: tuple[str, ...] = ()) -> tuple[list[Row], tuple[str, ...]]:
    """Return the rows of an answer by the names of ``archive_columns.csv``, and remarks on its columns.

    Parameters
    ----------
    answer : RawTable
        Columns under any of their names.
    table : {"simbad_stars", "simbad_measurements", "ps"}
        What was asked for.
    unique : tuple of str
        Columns in which no two rows may say the same.

    Raises
    ------
    RefreshError
        If a column is missing, in a unit that is not understood, or holds what is none of its values; if a cell is
        missing that every row must have; or if two rows are one.
    """
    columns, asked = _columns(table), asked_columns(table)
    remedy = "the archive may have changed or the service is another one; tables already here stay as they are"
    try:
        known = [(item, meant) for item in answer.columns if (meant := columns.meant_by(item.heading).column)]
        given = [item if meant.unit else replace(item, unit="") for item, meant in known]  # a pure number has none
        lacking = [name for name in columns if name not in {meant.name for _, meant in known}]
        if needed := [name for name in lacking if asked[name]["needed"]]:
            raise RefreshError(f"the archive's table has no column {', '.join(needed)}", remedy)
        read = read_rows(RawTable(answer.name, given), columns, (), about=next(iter(columns)))
        cells = [[name] for name in columns if asked[name]["needed"] == "cell"]
        for number, row in enumerate(read.rows, start=1):
            read.refuse_missing(f"{answer.name} row {number}", row, cells)
    except InputError as error:
        raise RefreshError(str(error), remedy) from None
    notes = []
    for item, meant in known:
        if meant.unit and unit_of(item.unit, meant.unit) != unit_of(meant.unit):
            notes.append(f"{item.heading} is in {item.unit}, not in {meant.unit}: converted")
        if item.heading.lower() != meant.name:
            notes.append(f"{meant.name} is called {item.heading}")
    if lacking:
        notes.append(f"columns that the archive no longer has: {', '.join(lacking)}")
    for name in unique:
        value, count = max(Counter(row[name] for row in read.rows).items(), key=lambda item: item[1], default=("", 0))
        if count > 1:
            raise RefreshError(f"{answer.name}: {count} rows are of one name; same {name} {value}", remedy)
    return read.rows, tuple(notes)
