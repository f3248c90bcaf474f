"""Speed against accuracy on the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cpic_planner.models import TradeoffResult, TradeoffRow

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["print_tradeoff"]


def print_tradeoff(result: TradeoffResult, console: Console) -> None:
    """One table a scene: every way with its time, memory and errors."""
    from rich.table import Table

    for scene in result.scenes:
        table = Table(title=f"{scene.title} ({scene.name}, {scene.band})", title_justify="left")
        for name in ("way", "wall (s)", "CPU (s)", "MB", "flux", "SNR"):
            table.add_column(name, justify="left" if name == "way" else "right")
        for row in result.rows:
            if row.scene == scene.name:
                table.add_row(*_cells(row, result.machine.key))
        console.print(table)
    for name, ratio in result.speed_ups.items():
        console.print(f"{name}: one call of the closed forms is {ratio:.0f} times faster than the reference")


def _cells(row: TradeoffRow, machine: str) -> list[str]:
    title = row.title if row.machine == machine else f"{row.title} (another machine)"
    if row.status != "ok":
        return [title, row.status, row.reason, "", "", ""]
    return [
        title,
        f"{row.wall_s:.3g}",
        f"{row.cpu_s:.3g}",
        f"{row.peak_memory_mb:.0f}",
        _error(row.flux_error, None),
        _error(row.snr_error, row.snr_uncertainty),
    ]


def _error(value: float | None, uncertainty: float | None) -> str:
    if value is None:
        return ""
    return f"{100 * value:+.2g} %" if not uncertainty else f"{100 * value:+.2g} ± {100 * uncertainty:.1g} %"
