"""Answers of the calculator with several instruments on the terminal, band by band below each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from cpic_planner.report.cells import Cells, print_plain, print_table, row_cells
from cpic_planner.report.console_etc import ANSWER
from cpic_planner.report.numbers import MISSING, full_name, significant
from cpic_planner.report.words import LIMITED_BY
from cpic_planner.results import EtcAnswer, EtcResult

if TYPE_CHECKING:
    from rich.console import Console


@dataclass(frozen=True)
class _Row:
    """An answer, the instrument that it is of, and the first instrument's answer to the same."""

    instrument: str
    answer: EtcAnswer
    base: EtcAnswer | None

    @property
    def ratio(self) -> str:
        base, own = self.base, self.answer
        if base is None or not base.value or own.value is None:
            return MISSING
        same = ["separation_arcsec"] + ["contrast"] * (own.question != "contrast_limit")  # there it is the answer
        alike = all(math.isclose(getattr(own, name), getattr(base, name), rel_tol=_ALIKE) for name in same)
        return significant(own.value / base.value, 3) if alike else _UNLIKE


_ALIKE = 1e-3
"""Relative difference up to which two separations or contrasts are the same in every digit that is shown."""
_UNLIKE = "other planet"


def print_both(results: Sequence[tuple[str, EtcResult]], console: Console) -> None:
    """Print answers with several instruments, and their ratio to those of the first one.

    Parameters
    ----------
    results : sequence of (str, EtcResult)
        Name of each instrument, and what is answered with it.
    console : Console
    """
    grouped = [(name, _by_band(result)) for name, result in results]
    first = grouped[0][1]
    rows = []
    for band in dict.fromkeys(band for _, answers in grouped for band in answers):
        bases = first.get(band, [])
        for name, answers in grouped:
            own = answers.get(band, [])
            padded = [*bases, *[None] * (len(own) - len(bases))]
            rows += [_Row(name, row, base) for row, base in zip(own, padded, strict=False)]
    cells = row_cells(
        EtcAnswer,
        "band instrument value ratio separation_arcsec contrast visits frames snr significance limit status",
        of=lambda row: row.answer,
        instrument=Cells("instrument", lambda row: row.instrument, right=False),
        value=replace(ANSWER, text=lambda row: ANSWER.text(row.answer)),
        ratio=Cells("ratio", lambda row: row.ratio, legend="answer over that of the first instrument in the same band"),
        limit=Cells("limit", lambda row: LIMITED_BY[row.answer.limited_by or "none"][0], right=False),
    )
    title = f"{full_name(results[0][1].target, results[0][1].hip)} with each instrument"
    print_table(console, title, cells, rows, explained=True, legend=True)
    if any(row.ratio == _UNLIKE for row in rows):
        why = "each instrument has its own best place, and planets of other separations or contrasts do not compare"
        print_plain(console, f"No ratio is given where it says {_UNLIKE}: {why}. A stated separation is that of both.")


def _by_band(result: EtcResult) -> dict[str, list[EtcAnswer]]:
    found: dict[str, list[EtcAnswer]] = {}
    for row in result.answers:
        found.setdefault(row.band, []).append(row)
    return found
