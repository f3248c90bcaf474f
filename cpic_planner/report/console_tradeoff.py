"""Speed against accuracy on the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cpic_planner.models import TradeoffResult, TradeoffRow
from cpic_planner.report.cells import Cells, row_cells
from cpic_planner.report.terminal import print_plain, print_table

if TYPE_CHECKING:
    from rich.console import Console


def print_tradeoff(result: TradeoffResult, console: Console) -> None:
    """Print one table a scene: every way with its time, memory and errors.

    Parameters
    ----------
    result : TradeoffResult
    console : Console
    """

    def way(row: TradeoffRow) -> str:
        title = row.title if row.machine == result.machine.key else f"{row.title} (another machine)"
        return title if row.status == "ok" else f"{title}: {row.status}, {row.reason.replace('_', ' ')}"

    cells = row_cells(
        TradeoffRow,
        "title wall_s cpu_s peak_memory_mb/2 flux_error/1 snr_error",
        flux_error=lambda row: _error(row.flux_error, None),
        snr_error=lambda row: _error(row.snr_error, row.snr_uncertainty),
        title=Cells("way", way, right=False),
    )
    for scene in result.scenes:
        rows = [row for row in result.rows if row.scene == scene.name]
        title = f"{scene.title} ({scene.name}, {scene.band})"
        print_table(console, title, cells, rows)
    for name, ratio in result.speed_ups.items():
        print_plain(console, f"{name}: one call of the closed forms is {ratio:.0f} times faster than the reference")


def _error(value: float | None, uncertainty: float | None) -> str:
    if value is None:
        return ""
    return f"{100 * value:+.2g} %" if not uncertainty else f"{100 * value:+.2g} ± {100 * uncertainty:.1g} %"
