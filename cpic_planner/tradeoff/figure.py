"""Error against time, a panel for each scene."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from cpic_planner.models.tradeoff import TradeoffResult, TradeoffRow
from cpic_planner.report.drawing import new_figure, place_labels, style

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe-Ito colours, and a symbol each.
LOOKS: dict[str, tuple[str, str, str]] = {
    "closed_form": ("#D55E00", "*", "closed forms"),
    "images": ("#56B4E9", "s", "images, stated way"),
    "tier": ("#000000", "o", "named tiers"),
    "tolerance": ("#009E73", "D", "tolerances"),
    "knob": ("#CC79A7", "+", "one knob changed"),
    "effect": ("#999999", "x", "one effect left out"),
}
SMALLEST = 1e-6
"""Errors below are drawn here, as upper limits."""
_LABELS = {"reference": "reference", "standard": "standard", "quick": "quick", "etc": "closed form"}
DPI = 130


def pareto_png(result: TradeoffResult) -> bytes:
    """The figure as a file."""
    buffer = io.BytesIO()
    with style():
        pareto_figure(result).savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return buffer.getvalue()


def pareto_figure(result: TradeoffResult) -> Figure:
    """Draw the larger of the errors of flux and SNR against wall clock."""
    scenes = list(result.scenes)
    columns = 2 if len(scenes) > 1 else 1
    lines = math.ceil((len(scenes) + (columns == 2 and len(scenes) % 2 == 0)) / columns) if scenes else 1
    figure = new_figure(3.0 * lines + 0.9)
    panels = figure.subplots(lines, columns, squeeze=False, sharex=True).ravel()
    ok = [row for row in result.rows if row.status == "ok" and row.wall_s and row.snr_error is not None]
    for panel, scene in zip(panels, scenes, strict=False):
        _panel(panel, [row for row in ok if row.scene == scene.name])
        panel.set_title(scene.title)
    for panel in panels[len(scenes) :]:
        panel.set_axis_off()
    for panel in panels[: len(scenes)][-columns:]:
        panel.tick_params(labelbottom=True)  # the lowest of each column
    figure.supxlabel("wall clock of one observation (s)", fontsize=10.5)
    figure.supylabel("relative error (larger of flux and SNR)", fontsize=10.5)
    handles, labels = _legend()
    figure.legend(handles, labels, loc="outside upper center", ncols=4)
    for panel, scene in zip(panels, scenes, strict=False):
        named = [row for row in ok if row.scene == scene.name and row.point in _LABELS]
        place_labels(
            panel,
            [row.wall_s or 0.0 for row in named],
            [_size(row)[0] for row in named],
            [_LABELS[row.point] for row in named],
            fontsize=8.5,
        )
    return figure


def _size(row: TradeoffRow) -> tuple[float, bool]:
    """Error to draw, and whether it is only a limit."""
    sizes = []
    for quantity in ("flux", "snr"):
        value, limit = abs(getattr(row, f"{quantity}_error") or 0.0), getattr(row, f"{quantity}_uncertainty") or 0.0
        sizes.append((value, False) if value > limit else (limit, True))
    value, limit = max(sizes)
    return (value, limit) if value > SMALLEST else (SMALLEST, True)


def _panel(axes: Axes, rows: Sequence[TradeoffRow]) -> None:
    top = max([0.1, *(_size(row)[0] for row in rows)])
    axes.set(xscale="log", yscale="log", ylim=(0.5 * SMALLEST, 3.0 * top))
    axes.grid(visible=True)
    for level in (0.01, 0.03, 0.05):
        axes.axhline(level, color="#BBBBBB", lw=0.8, ls=":", zorder=1)
    for group, (colour, marker, _) in LOOKS.items():
        for row in rows:
            if row.group != group:
                continue
            value, limit = _size(row)
            thin = marker in "+x"
            axes.plot(
                row.wall_s or 0.0,
                value,
                marker="v" if limit else marker,
                color=colour,
                ls="none",
                zorder=3,
                ms=9 if marker == "*" else 6,
                mew=1.3 if thin and not limit else 0.8,
                mfc="none" if limit or thin else colour,
                mec=colour,
            )


def _legend() -> tuple[list[Artist], list[str]]:
    from matplotlib.lines import Line2D

    handles: list[Artist] = [
        Line2D([], [], color=colour, marker=marker, ls="none", ms=7, mfc="none" if marker in "+x" else colour)
        for colour, marker, _ in LOOKS.values()
    ]
    handles.append(Line2D([], [], color="#444444", marker="v", ls="none", ms=7, mfc="none"))
    handles.append(Line2D([], [], color="#BBBBBB", ls=":"))
    return handles, [*(text for _, _, text in LOOKS.values()), "upper limit", "1, 3 and 5 %"]
