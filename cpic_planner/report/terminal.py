"""Tables on a terminal: columns that give way where it is narrow, and what its encoding can show."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from cpic_planner.report.names import pretty_name
from cpic_planner.report.numbers import MISSING, significant
from cpic_planner.report.words import LIMITED_BY, STATUS_SYMBOLS, VERDICTS, status_text

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from cpic_planner.models import BandConfirmation, BandStanding, EtcRow, RankedTarget, SearchRecord

__all__ = [
    "Column",
    "explain_symbols",
    "frames_text",
    "print_note",
    "print_plain",
    "ratio_text",
    "short_name",
    "status_cell",
    "text_table",
    "verdict_cell",
]

_STYLE = {"ok": "green", "unreachable": "yellow", "saturated": "red", "outside_field": "magenta", "invalid": "red"}


class Column(NamedTuple):
    """Header, side, and how soon the column gives way on a narrow terminal (0: never; the highest goes first)."""

    header: str
    right: bool = True
    gives_way: int = 0


_GAP = 2
_LAST_COLUMN = 18


def text_table(
    console: Console, title: str, columns: list[Column], rows: list[list[str]], *, last_width: int = _LAST_COLUMN
) -> Table:
    """Table of the columns that fit; the last one (status) always stays and may wrap beyond ``last_width``."""
    from rich import box
    from rich.cells import cell_len
    from rich.table import Table
    from rich.text import Text

    widths = [max([cell_len(c.header), *(cell_len(row[i]) for row in rows)]) + _GAP for i, c in enumerate(columns)]
    widths[-1] = min(widths[-1], last_width + _GAP)
    shown = list(range(len(columns)))
    for i in sorted(shown, key=lambda i: -columns[i].gives_way):
        if sum(widths[j] for j in shown) > console.width and columns[i].gives_way > 0:
            shown.remove(i)
    table = Table(
        title=Text(_fitting(console, title), style="bold"),
        title_justify="left",
        box=box.SIMPLE_HEAD,
        padding=(0, _GAP - 1, 0, 0),
        pad_edge=False,
        show_edge=False,
    )
    for i in shown:
        last = i == len(columns) - 1
        table.add_column(
            Text(_fitting(console, columns[i].header)),
            justify="right" if columns[i].right else "left",
            no_wrap=not last,
            overflow="fold" if last else "ellipsis",
            vertical="top",
        )
    for row in rows:
        table.add_row(*(_cell(console, row[i]) for i in shown))
    return table


def _fitting(console: Console, text: str) -> str:
    """What the terminal's encoding can show; anything else becomes a question mark instead of an error."""
    return text.encode(console.encoding, "replace").decode(console.encoding)


def _cell(console: Console, text: str) -> Text:
    """Text without markup (names may hold brackets), coloured when it starts with a status symbol."""
    from rich.text import Text

    for status, symbol in STATUS_SYMBOLS.items():
        if text.startswith(symbol):
            return Text(_fitting(console, text), style=_STYLE[status])
    return Text(_fitting(console, text))


def print_note(console: Console, text: str) -> None:
    """Print a line below a table."""
    from rich.text import Text

    console.print(Text(_fitting(console, text), style="dim"))


def print_plain(console: Console, text: str, *, bold: bool = False) -> None:
    """Print a line of text."""
    from rich.text import Text

    console.print(Text(_fitting(console, text), style="bold" if bold else ""))


_NAME_LENGTH, _NEUTRAL = 18, "·"


def short_name(identifier: str) -> str:
    """Readable name of a star, cut to the width of a column."""
    name = pretty_name(identifier)
    return name if len(name) <= _NAME_LENGTH else f"{name[: _NAME_LENGTH - 1]}…"


def ratio_text(value: float | None) -> str:
    """A flux ratio in the compact form of terminals."""
    return MISSING if value is None else f"{value:.2e}"


def status_cell(status: str, reason: str) -> str:
    """Symbol and the short reason; `explain_symbols` explains the symbols below the table."""
    return f"{STATUS_SYMBOLS.get(status, '')} {reason.replace('_', ' ') or status_text(status)}".strip()


def verdict_cell(item: EtcRow | RankedTarget | BandStanding) -> str:
    """Verdict of an answer in a cell; the mark of a success stands before a detection only."""
    if item.status == "ok":
        if item.verdict == "detected":
            return f"{STATUS_SYMBOLS['ok']} {VERDICTS['detected']}"
        return status_text("ok") if item.verdict is None else f"{_NEUTRAL} {VERDICTS[item.verdict]}"
    if item.reason == "speckle_floor" and item.limited_by in ("photons", "background"):
        return f"{STATUS_SYMBOLS[item.status]} {LIMITED_BY[item.limited_by][0]}"
    return status_cell(item.status, item.reason)


def explain_symbols(console: Console, statuses: list[str]) -> None:
    """Explain the symbols of a table."""
    used = [status for status in STATUS_SYMBOLS if status in statuses]
    if used and used != ["ok"]:
        print_note(console, "   ".join(f"{STATUS_SYMBOLS[status]} {status_text(status)}" for status in used))


def frames_text(item: RankedTarget | BandConfirmation | EtcRow | SearchRecord) -> str:
    """Number of frames and their exposure."""
    if item.exposure_s is None or item.n_frames is None:
        return MISSING
    return f"{item.n_frames} × {significant(item.exposure_s)}"
