"""Blocks of a page made from what is printed on a console."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import groupby
from typing import TYPE_CHECKING, Any, cast
from urllib.parse import urlencode

from cpic_planner import report
from cpic_planner.results import RankedTarget

if TYPE_CHECKING:
    from rich.console import Console


_LEAST_ROWS = 3


class Blocks(report.Sheet):
    """Stands where a console does, and keeps what is printed as blocks of a page."""

    def __init__(self) -> None:
        self.form, self.width, self.encoding, self.taken = "page", 0, "utf-8", None
        self.blocks: list[report.Block] = []

    def take(self, title: str, columns: Sequence[report.Cells], entries: list[Any]) -> None:
        """Keep a table, and what its headings mean."""
        columns, same = _told_once(columns, entries)
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
        caption: Any = [report.strong(f"{first}."), *(f" {text}." for text in [*more, *filter(None, [same])])]
        self.blocks.append(report.Table(first, caption, heads, cells, "", picked))
        said = [f"{column.label or column.header}: {column.legend}." for column in columns if column.legend]
        if said:
            self.blocks.append(report.Fold("What the headings mean", [report.Items(said)]))

    def print(self, *objects: Any, **look: Any) -> None:
        """Keep a line."""
        text = " ".join(str(item) for item in objects).strip()
        if text and getattr(objects[0], "style", "") == "bold":
            self.blocks.append(report.Heading(text))
        elif text:
            self.blocks.append(report.Paragraph(text, "note" if text.startswith(("!", "Note")) else ""))


def _told_once(columns: Sequence[report.Cells], entries: Sequence[Any]) -> tuple[list[report.Cells], str]:
    """Return the columns without those that repeat another one in every row, and a sentence that says which these are.

    Fewer than three rows, and cells without a value, repeat by chance; the last column, the status, always stays.
    """
    kept: dict[tuple[str, ...], report.Cells] = {}
    same = []
    for number, column in enumerate(columns):
        texts = tuple(str(column.text(entry)).strip() for entry in entries)
        chance = len(texts) < _LEAST_ROWS or set(texts) <= {"", report.MISSING} or number + 1 == len(columns)
        first = kept.setdefault((str(number),) if chance else texts, column)
        if first is not column:
            same.append(f"{column.label or column.header} (as {first.label or first.header})")
    return list(kept.values()), f"Left out, because alike in every row: {', '.join(same)}" * bool(same)


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
    return [block for part in groupby(sheet.blocks, key=_is_plain) for block in _listed(*part)]


def _is_plain(block: report.Block) -> bool:
    return isinstance(block, report.Paragraph) and not block.look


def _listed(plain: bool, blocks: Iterable[report.Block]) -> list[report.Block]:
    """Return blocks, or one list of many lines: a wall of them is not read."""
    found = list(blocks)
    texts = [block.text for block in found if isinstance(block, report.Paragraph)]
    return [report.Items(texts)] if plain and len(texts) >= _LEAST_ROWS else found
