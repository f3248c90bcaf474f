"""Tables on a terminal: columns that give way where it is narrow, and what its encoding can show."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from cpic_planner.report.cells import Cells
from cpic_planner.report.words import STATUS_SYMBOLS, status_text

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

_STYLE = {"ok": "green", "unreachable": "yellow", "saturated": "red", "outside_field": "magenta", "invalid": "red"}
_GAP = 2
_LAST_COLUMN = 18


def print_table(
    console: Console,
    title: str,
    cells: Sequence[Cells],
    rows: Iterable[Any],
    *,
    last_width: int = _LAST_COLUMN,
    explained: bool = False,
) -> None:
    """Print a table of the columns that fit; the last one (status) always stays and may wrap.

    Parameters
    ----------
    console : Console
    title : str
    cells : sequence of Cells
    rows : iterable
        What `Cells.text` takes.
    last_width : int
        Width beyond which the last column wraps.
    explained : bool
        Explain the symbols of the rows' statuses below the table.
    """
    entries = list(rows)
    console.print(_drawn(console, title, cells, [[cell.text(row) for cell in cells] for row in entries], last_width))
    if explained:
        explain_symbols(console, [row.status for row in entries if row.status != "ok"])


def _drawn(console: Console, title: str, columns: Sequence[Cells], rows: list[list[str]], last_width: int) -> Table:
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


def explain_symbols(console: Console, statuses: list[str]) -> None:
    """Explain the symbols of a table."""
    used = [status for status in STATUS_SYMBOLS if status in statuses]
    if used and used != ["ok"]:
        print_note(console, "   ".join(f"{STATUS_SYMBOLS[status]} {status_text(status)}" for status in used))
