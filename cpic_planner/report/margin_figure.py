"""How the whole sample fares: distribution of margins, and counts by outcome."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpic_planner.models import RankResult
from cpic_planner.report.drawing import STATUS_STYLE, Picture, new_figure, save, style
from cpic_planner.report.words import LIMITED_BY, reason_text, status_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_N_BINS = 28
_LOWEST_DECADES = 4.0


def margin_figure(rank: RankResult) -> Picture:
    """Draw a histogram of detection margins by status, and how many stars end in each outcome."""
    from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

    rows = rank.targets
    with style():
        figure = new_figure(3.5)
        left, right = figure.subplots(1, 2, width_ratios=(1.55, 1.0))
        positive = np.array([row.detection_margin for row in rows if row.detection_margin > 0])
        if positive.size:
            high = np.log10(positive.max() * 1.05)
            low = max(np.log10(positive.min() * 0.95), high - _LOWEST_DECADES)
            low, high = min(low, -0.05), max(high, 0.05)
            step = (high - low) / _N_BINS  # bins start at 1, so that no bin mixes detections with the rest
            edges = 10.0 ** (step * np.arange(np.floor(low / step), np.ceil(high / step) + 1))
            groups = [
                (
                    s,
                    [
                        max(row.detection_margin, edges[0])
                        for row in rows
                        if row.status == s and row.detection_margin > 0
                    ],
                )
                for s in STATUS_STYLE
            ]
            groups = [(s, margins) for s, margins in groups if margins]
            left.hist(
                [margins for _, margins in groups],
                bins=edges.tolist(),
                stacked=True,
                rwidth=0.92,
                color=[STATUS_STYLE[s][0] for s, _ in groups],
                label=[f"{status_text(s)} ({len(margins)})" for s, margins in groups],
            )
            left.set_xscale("log")
            left.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
            left.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            left.xaxis.set_minor_formatter(NullFormatter())
        left.yaxis.set_major_locator(MaxNLocator(6, integer=True))
        left.axvline(1.0, color="#111111", lw=1.2, ls="--", label="margin 1: detection")
        left.set(xlabel="detection margin (significance / threshold)", ylabel="stars per bin")
        left.grid(visible=True, axis="y")
        figure.legend(*left.get_legend_handles_labels(), loc="outside lower left", ncols=2, columnspacing=1.4)
        _outcomes(right, rank)
        without = len(rows) - positive.size
        left_out = f"; stars without a possible frame are left out ({without})" if without else ""
        return save(
            figure,
            "svg",
            alt=f"Histogram of the detection margins of {positive.size} stars, and bars that count stars by outcome.",
            caption="Left: predicted detection margin of the reference planet around every ranked star, in the star's "
            f"best band and separation{left_out}. Right: stars by outcome.",
        )


def _outcomes(axes: Axes, rank: RankResult) -> None:
    """Horizontal bars, most frequent on top."""
    found = {row.limited_by or row.reason or "none": row.status for row in rank.targets}
    items = sorted((rank.counts_limited_by or rank.counts).items(), key=lambda item: (item[1], item[0]))
    status_of = found | {"ok": "ok"}
    names = [LIMITED_BY[key][0] if key in LIMITED_BY else _wrapped(reason_text(key) or "detected") for key, _ in items]
    counts = [count for _, count in items]
    colours = [STATUS_STYLE.get(status_of.get(key, "unreachable"), STATUS_STYLE["unreachable"])[0] for key, _ in items]
    bars = axes.barh(range(len(items)), counts, color=colours, height=0.6)
    axes.bar_label(bars, labels=[str(count) for count in counts], padding=3)
    axes.set_yticks(range(len(items)), names)
    axes.set_xlim(0, 1.3 * max(counts, default=1))
    axes.set_xlabel("stars")


def _wrapped(text: str) -> str:
    import textwrap

    return "\n".join(textwrap.wrap(text, 24))
