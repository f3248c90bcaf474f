"""The first stars of a ranking as bars."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cpic_planner.models import RankedTarget, RankResult
from cpic_planner.registry.scores import SCORES
from cpic_planner.report.drawing import STATUS_STYLE, band_style, literal, new_figure, style
from cpic_planner.report.names import pretty_name
from cpic_planner.report.numbers import duration_text
from cpic_planner.report.words import status_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

N_STARS = 20
MOST_STARS = 100
"""Stars whose names can still be read in one figure, which is then 27 inches high."""


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
