"""Cells of tables for people: made from the columns of rows, for terminals and for pages alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from cpic_planner.models.columns import Column, column_of, columns_of
from cpic_planner.report.numbers import MISSING, contrast_text, formatted, significant
from cpic_planner.report.words import LIMITED_BY, STATUS_SYMBOLS, VERDICTS, status_text

if TYPE_CHECKING:
    from cpic_planner.models import BandConfirmation, BandStanding, EtcAnswer, RankedTarget, SearchRecord
    from cpic_planner.models.base import Result

_SOON = 9
_NEUTRAL = "·"
_WITH_UNIT = ("time", "bytes")
"""Formats that write the unit themselves."""


@dataclass(frozen=True)
class Cells:
    """One column of a table.

    Attributes
    ----------
    header : str
        Heading on a terminal.
    text : callable
        Cell of a row.
    right : bool
        Side.
    gives_way : int
        How soon the column gives way on a narrow terminal; 0: never; the highest goes first.
    label, unit : str
        Heading in pages, and the unit below it.
    """

    header: str
    text: Callable[[Any], Any]
    right: bool = True
    gives_way: int = 0
    label: str = ""
    unit: str = ""


def row_cells(
    kind: type[Result],
    layout: str,
    /,
    *,
    of: Callable[[Any], Result | None] = lambda row: row,
    page: bool = False,
    **special: Callable[[Any], Any] | Cells,
) -> list[Cells]:
    """Return the columns of a table from those of its rows.

    Parameters
    ----------
    kind : type
        Kind of the rows: headings, sides and formats are those of its columns.
    layout : str
        Names of the columns, in order; ``/3`` behind a name: how soon it gives way. ``frames`` stands for number and
        exposure of frames, ``status`` for verdict and reason. Columns that ask for it (``console=True``) and are not
        named stand before the last one.
    of : callable
        The row of an entry of the table; cells without a row are dashes.
    page : bool
        Write numbers as pages do: powers of ten.
    **special
        What is written in a column instead, from the entry; a `Cells` where the row has no such field.

    Returns
    -------
    list of Cells
    """
    shared = _SHARED if "verdict" in kind.model_fields else {"frames": _SHARED["frames"]}
    found, named = [], []
    for word in layout.split():
        name, _, way = word.partition("/")
        own = special.get(name)
        if own is None and name in shared:
            own = replace(shared[name], text=_through(of, shared[name].text))
        if not isinstance(own, Cells):
            own = _column_cells(column_of(kind, name), own, of, page)
        found.append(replace(own, gives_way=int(way or 0)))
        named.append(name)
    more = [column for column in columns_of(kind) if column.look.console and column.name not in named]
    found[-1:-1] = [replace(_column_cells(column, None, of, page), gives_way=_SOON) for column in more]
    return found


def _column_cells(column: Column, own: Callable[[Any], Any] | None, of: Callable[[Any], Any], page: bool) -> Cells:
    text = own or _through(of, _cell_text(column, page))
    form = column.look.format
    unit = "%" if form == "%" else "" if form in _WITH_UNIT else column.unit
    return Cells(column.heading, text, column.right, label=column.label, unit=unit)


def _through(of: Callable[[Any], Any], text: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda entry: MISSING if of(entry) is None else text(of(entry))


def _cell_text(column: Column, page: bool) -> Callable[[Any], str]:
    """Value of a column, with its error behind it where the format has one."""
    form, _, error = column.look.format.partition(" ± ")

    def written(value: Any, form: str) -> str:
        power = page and form.startswith(".") and form.endswith("e")
        return contrast_text(value, int(form[1:-1]) + 1) if power else formatted(value, form)

    def text(row: Any) -> str:
        spread = getattr(row, f"{column.name}_error") if error else None
        value = written(getattr(row, column.name), form)
        return value if spread is None else f"{value} ± {written(spread, error)}"

    return text


def status_cell(status: str, reason: str) -> str:
    """Symbol and the short reason; `explain_symbols` explains the symbols below the table."""
    return f"{STATUS_SYMBOLS.get(status, '')} {reason.replace('_', ' ') or status_text(status)}".strip()


def verdict_cell(item: EtcAnswer | RankedTarget | BandStanding) -> str:
    """Verdict of an answer in a cell; the mark of a success stands before a detection only."""
    if item.status == "ok":
        if item.verdict == "detected":
            return f"{STATUS_SYMBOLS['ok']} {VERDICTS['detected']}"
        return status_text("ok") if item.verdict is None else f"{_NEUTRAL} {VERDICTS[item.verdict]}"
    if item.reason == "speckle_floor" and item.limited_by in ("photons", "background"):
        return f"{STATUS_SYMBOLS[item.status]} {LIMITED_BY[item.limited_by][0]}"
    return status_cell(item.status, item.reason)


def frames_text(item: RankedTarget | BandConfirmation | EtcAnswer | SearchRecord) -> str:
    """Number of frames and their exposure."""
    if item.exposure_s is None or item.n_frames is None:
        return MISSING
    return f"{item.n_frames} × {significant(item.exposure_s)}"


_SHARED = {
    "frames": Cells("frames × s", frames_text, label="frames × exposure", unit="s"),
    "status": Cells("status", verdict_cell, right=False, label="status"),
}
