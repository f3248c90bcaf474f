"""Meaning of the columns of a user's table, on the terminal and on the page."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cpic_planner import results
from cpic_planner.report.cells import Cells, print_note, print_plain, print_table, row_cells
from cpic_planner.report.numbers import MISSING

if TYPE_CHECKING:
    from rich.console import Console

_WIDE = 60
_OPTION = {"stars": "--catalog", "planets": "--known-planets"}
"""Option that takes a table of each kind."""


_WORDS = {"not known": "heading not known"}


def print_columns(result: results.ColumnsResult, console: Console) -> None:
    """Print what the columns of a file are taken for, and how many of its rows can be used."""
    for table in result.tables:
        rows = f"{table.n_usable} of {table.n_rows} row{'s' * (table.n_rows != 1)} can be used"
        title = f"{result.file} as a table of {table.taken_as} ({_OPTION[table.taken_as]}): {rows}"
        cells = row_cells(
            results.ColumnTaken,
            "heading quantity unit reason",
            quantity=lambda row: row.quantity or "not used",
            unit=_unit,
            reason=_remark,
        )
        print_table(console, title, cells, table.columns, last_width=_WIDE)
        if table.left_out:
            shown = row_cells(
                results.ReasonLeftOut,
                "done count column first reason",
                first=Cells("first", _first, right=False, label="first of them"),
            )
            print_table(console, "Left out, by reason", shown, table.left_out, last_width=_WIDE)
        print_plain(console, *(note for note in table.notes if not _is_shown(note, result.file)))
    if len(result.tables) > 1:
        print_note(console, "The file can be read both as stars and as planets: the option decides.")
    if any(row.unit_assumed for table in result.tables for row in table.columns):
        print_note(console, "(assumed): the file names no unit, and this one is taken.")


def _unit(row: results.ColumnTaken) -> str:
    return f"{row.unit} (assumed)" if row.unit_assumed else row.unit or MISSING


def _remark(row: results.ColumnTaken) -> str:
    return row.convention if row.quantity else _WORDS.get(row.reason, row.reason)


def _first(row: results.ReasonLeftOut) -> str:
    return f"row {row.row}{f' ({row.name})' * bool(row.name)}: {row.value}"


def _is_shown(note: str, file: str) -> bool:
    """Tell whether a remark says what the tables show."""
    said = note.removeprefix(f"{file}: ")
    return said.startswith("columns not used") or " left out: " in said or " taken as missing: " in said
