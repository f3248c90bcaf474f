"""Read the answers of archives: columns under names old and new, in our units; what cannot be right is refused.

``archive_columns.csv`` lists what is read: SIMBAD's two answers under the names of TAP, of ``add_votable_fields`` and
of astroquery before 0.4.8, and the NASA Exoplanet Archive's table ``ps``, with its names before 2021. A measured
quantity of ``ps`` has columns for both errors and a limit beside its own.
"""

import functools
import math
from collections import Counter
from collections.abc import Mapping
from typing import Any

from catalogs.shipped import shipped_rows
from catalogs.table_cells import Column, Columns, Row, read_rows
from catalogs.table_files import RawColumn, RawTable, column_of
from catalogs.tap_client import RefreshError
from cpic_core import InputError

_UNITS = {
    "d": "days day bjd jd",
    "AU": "au",
    "deg": "degrees",
    "jupiterMass": "jupitermass mj mjup mjupiter",
    "jupiterRad": "jupiterradius jupiterradii rj rjup rjupiter",
    "solMass": "solarmass msun",
}
"""Units as archives have written them, lower case without blanks and underlines, by ours."""


@functools.cache
def asked_columns(table: str) -> Mapping[str, Mapping[str, str]]:
    """Return the rows of ``archive_columns.csv`` on an answer, by the names of its columns."""
    beside = {"needed": "", "quantity": ""}
    ends = {"err1": beside, "err2": beside, "lim": beside | {"unit": ""}}
    found = {}
    for row in shipped_rows("archive_columns.csv"):
        if row["table"] != table:
            continue
        found[row["column"]] = row
        for end, other in ends.items() if row["quantity"] else ():
            found[row["column"] + end] = row | other | {"column": row["column"] + end}
    return found


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
    given, notes = [], []
    try:
        for item in answer.columns:
            if (meant := columns.meant_by(item.heading).column) is not None:
                own = _in_our_words(item, meant)
                given.append((meant.name, own))
                if own.unit not in ("", meant.unit):
                    notes.append(f"{item.heading} is in {own.unit}, not in {meant.unit}: converted")
                if item.heading.lower() != meant.name:
                    notes.append(f"{meant.name} is called {item.heading}")
        lacking = [name for name in columns if name not in dict(given)]
        if needed := [name for name in lacking if asked[name]["needed"]]:
            raise RefreshError(f"the archive's table has no column {', '.join(needed)}", remedy)
        if lacking:
            notes.append(f"columns that the archive no longer has: {', '.join(lacking)}")
        read = read_rows(RawTable(answer.name, [own for _, own in given]), columns, (), about=next(iter(columns)))
        for number, row in enumerate(read.rows, start=1):
            for name in columns:
                if name not in row and asked[name]["needed"] == "cell":
                    raise InputError(f"{answer.name} row {number} column {read.headings[name]}", "missing")
    except InputError as error:
        raise RefreshError(str(error), remedy) from None
    for name in unique:
        value, count = max(Counter(row[name] for row in read.rows).items(), key=lambda item: item[1], default=("", 0))
        if count > 1:
            raise RefreshError(f"{answer.name}: {count} rows are of one name; same {name} {value}", remedy)
    return read.rows, tuple(notes)


def _in_our_words(given: RawColumn, meant: Column) -> RawColumn:
    """Return a column with its unit as we write it and its angles in degrees; a pure number has no unit."""
    unit = given.unit if meant.unit else ""
    if unit.lower().replace(" ", "").replace("_", "") in _UNITS.get(meant.unit, "").split():
        unit = meant.unit
    cells: list[Any] = [None if cell == "~" else cell for cell in given.cells.tolist()]
    if meant.unit == "deg" and any(isinstance(cell, str) and len(cell.split()) > 1 for cell in cells):
        from astropy.coordinates import Angle

        clock = "hourangle" if meant.name.startswith("ra") else "deg"  # what SIMBAD gave before TAP
        try:
            unit, cells = "deg", [None if cell is None else Angle(str(cell), unit=clock).deg for cell in cells]
        except ValueError as error:
            raise InputError(f"column {given.heading}", "unreadable", allowed="angles", hint=str(error)) from None
    return column_of(given.heading, unit, cells)
