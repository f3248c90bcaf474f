"""Blocks of a page made from what is printed on a console."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, cast
from urllib.parse import urlencode

from cpic_planner import report
from cpic_planner.results import RankedTarget

if TYPE_CHECKING:
    from rich.console import Console


class Blocks(report.Sheet):
    """Stands where a console does, and keeps what is printed as blocks of a page."""

    def __init__(self) -> None:
        self.form, self.width, self.encoding, self.taken = "page", 0, "utf-8", None
        self.blocks: list[report.Block] = []

    def take(self, title: str, columns: Sequence[report.Cells], entries: list[Any]) -> None:
        """Keep a table, and what its headings mean."""
        named = [(column.label or column.header, column.unit) for column in columns]
        looks = ["" if column.right else "left" for column in columns]
        looks[-1] += " verdict" * (not columns[-1].right)
        texts: list[Any] = [[f"{name} ", report.small(unit)] if unit else name for name, unit in named]
        heads = tuple(map(report.Cell, texts, looks))
        rows = [[_cell(column, entry) for column in columns] for entry in entries]
        picked = frozenset(number for number, row in enumerate(rows) if str(row[0]).startswith("→"))
        first_heads = [True] + [False] * (len(columns) - 1)
        cells = tuple(tuple(map(report.Cell, row, looks, first_heads)) for row in rows)
        first, *more = title.split("\n")
        caption: Any = [report.strong(f"{first}."), *(f" {text}." for text in more)]
        self.blocks.append(report.Table(first, caption, heads, cells, "", picked))
        said = [f"{column.label or column.header}: {column.legend}." for column in columns if column.legend]
        if said:
            self.blocks.append(report.Fold("What the headings mean", [report.Items(said)]))

    def print(self, *objects: Any, **look: Any) -> None:
        """Keep a line."""
        text = " ".join(str(item) for item in objects).strip()
        if text:
            self.blocks.append(report.Paragraph(text, "note" if text.startswith(("!", "Note")) else ""))


def _cell(column: report.Cells, entry: Any) -> Any:
    """Return the text of a cell; a ranked star leads to its page."""
    text = column.cell(entry).strip()
    if isinstance(entry, RankedTarget) and column.fields == ("name",):
        name = f"HIP {entry.hip}" if entry.hip else entry.name
        return report.page_link(f"/star?{urlencode({'name': name})}", text)
    return text


def blocks_of(tables: Callable[[Console], None]) -> list[report.Block]:
    """Return what a function prints on a console as blocks of a page."""
    sheet = Blocks()
    tables(cast("Console", sheet))
    return sheet.blocks
