"""Two answers compared, as a document."""

from __future__ import annotations

from collections.abc import Iterator

from cpic_core import shortened
from cpic_planner import results
from cpic_planner.report import document as doc
from cpic_planner.report.ranking import move_blocks
from cpic_planner.report.writing import page_html

_SHOWN, _LONGEST = 30, 24
_NONE = "–"


def comparison_blocks(
    result: results.AnswerComparison | results.RankComparison, limit: int = _SHOWN
) -> Iterator[doc.Block]:
    """Yield what differs between two answers, the first ``limit`` values of them, and what explains it."""
    if isinstance(result, results.RankComparison):
        if result.before.config_hash == result.after.config_hash:
            yield doc.Paragraph("No difference: both are one ranking.")
        else:
            yield from move_blocks(result, limit)
        return
    title = f"What differs in the answer from {result.before.name} (before) to {result.after.name} (after)"
    if result.changes:
        columns = doc.row_columns(
            results.AnswerChange,
            "row:row quantity before after unit/1 relative",
            before=lambda one: shortened(one.before or _NONE, _LONGEST),
            after=lambda one: shortened(one.after or _NONE, _LONGEST),
            relative=lambda one: _NONE if one.relative is None else f"{100.0 * one.relative:+.3g}",
        )
        first = f": the first {limit} of {len(result.changes)}" if len(result.changes) > limit else ""
        yield doc.Table(f"{title}{first}", columns, result.changes[:limit])
    if result.settings:
        columns = doc.row_columns(
            results.SettingChange,
            "key:row before after unit",
            before=lambda one: shortened(one.before, _LONGEST),
            after=lambda one: shortened(one.after, _LONGEST),
        )
        yield doc.Table("What differs in the question", columns, result.settings)
    yield from _said(result)


def _said(result: results.AnswerComparison | results.RankComparison) -> Iterator[doc.Block]:
    """Yield what explains the differences, in words."""
    if isinstance(result, results.AnswerComparison):
        yield from doc.notes(result.statement, look="")


def comparison_page(result: results.AnswerComparison | results.RankComparison) -> str:
    """Return the page of a comparison."""
    heading = f"{result.before.name} and {result.after.name}"
    about = "Two answers to one kind of question: what differs, and what explains it."
    said, blocks = list(_said(result)), list(comparison_blocks(result))
    # The page says first what terminals say last.
    sections = [("differences", "Differences", blocks[: len(blocks) - len(said)])]
    return page_html(doc.Document(f"CPI-C: {heading}", heading, about, said, sections))
