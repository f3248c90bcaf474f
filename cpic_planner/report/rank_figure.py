"""A ranking as figures: its first stars as bars, and how the whole sample fares."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpic_planner.models import RankedTarget, RankResult
from cpic_planner.registry.scores import SCORES
from cpic_planner.report.drawing import STATUS_STYLE, Picture, band_style, literal, new_figure, save, style
from cpic_planner.report.names import pretty_name
from cpic_planner.report.numbers import duration_text
from cpic_planner.report.words import LIMITED_BY, reason_text, status_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

N_STARS = 20
MOST_STARS = 100
"""Stars whose names can still be read in one figure, which is then 27 inches high."""
_N_BINS = 28
_LOWEST_DECADES = 4.0


def rank_figure(rank: RankResult, n_stars: int = N_STARS) -> Figure:
    """Draw completeness, and margin of the reference planet, of the first stars.

    Parameters
    ----------
    rank : RankResult
    n_stars : int
        How many stars have bars, at most `MOST_STARS`; the title says how many they are.
    """
    rows = rank.targets[: min(n_stars, MOST_STARS)]
    with style():
        figure = new_figure(max(3.2, 1.4 + 0.26 * len(rows)))
        left, right = figure.subplots(1, 2, width_ratios=(1.4, 1.0))
        looks = band_style(sorted({row.completeness_band for row in rows}))
        _completeness(left, rows, looks)
        _margins(right, rows)
        title = f"first {len(rows)} of {len(rank.targets)} stars by {SCORES[rank.score_name].title}"
        under = f"population {rank.population.name}, up to {duration_text(rank.time_s)} per star and band"
        figure.suptitle(literal(f"{title}; {under}"), fontsize=11)
        figure.draw_without_rendering()
    return figure


def _completeness(axes: Axes, rows: list[RankedTarget], looks: dict[str, tuple[str, str]]) -> None:
    from matplotlib.patches import Patch

    values = [100.0 * row.completeness for row in rows]
    errors = [100.0 * row.completeness_error for row in rows]
    colours = [looks[row.completeness_band][0] for row in rows]
    axes.barh(range(len(rows)), values, xerr=errors, color=colours, height=0.7, error_kw={"lw": 0.9, "capsize": 1.5})
    axes.set_yticks(range(len(rows)), [literal(f"{row.rank}  {pretty_name(row.name)}") for row in rows])
    axes.invert_yaxis()
    axes.grid(visible=True, axis="x")
    axes.set(xlabel="completeness (%)", ylim=(len(rows) - 0.4, -0.6))
    bands = [band for band in looks if band in {row.completeness_band for row in rows}]
    axes.legend(
        handles=[Patch(color=looks[band][0], label=band) for band in bands],
        loc="lower right",
        fontsize=8.5,
        frameon=True,
        edgecolor="none",
        framealpha=0.9,
    )


def _margins(axes: Axes, rows: list[RankedTarget]) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    seen = [(i, row) for i, row in enumerate(rows) if row.detection_margin > 0]
    for status, (colour, marker) in STATUS_STYLE.items():
        own = [(i, row.detection_margin) for i, row in seen if row.status == status]
        if own:
            axes.plot(
                [margin for _, margin in own],
                [i for i, _ in own],
                marker=marker,
                ms=6,
                ls="none",
                color=colour,
                label=status_text(status),
            )
    axes.axvline(1.0, color="#111111", lw=1.2, ls="--", zorder=1)
    if seen:
        axes.set_xscale("log")
        margins = [row.detection_margin for _, row in seen]
        axes.set_xlim(min(0.5, 0.7 * min(margins)), max(2.0, 1.4 * max(margins)))
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
    if seen:
        axes.legend(loc="lower right", fontsize=8.5, frameon=True, edgecolor="none", framealpha=0.9)
    axes.set_yticks(range(len(rows)), [""] * len(rows))
    axes.set(xlabel="margin (1: reference planet detected)", ylim=(len(rows) - 0.4, -0.6))
    axes.grid(visible=True)


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
