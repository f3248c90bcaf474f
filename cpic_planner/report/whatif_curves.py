"""What surveys yield against telescope time, against a varied key, and against the number of universes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from cpic_planner.models.surveyed import CurvePoint, StrategyOutcome, WhatIfResult
from cpic_planner.report.drawing import Picture, literal, new_figure, save, style
from cpic_planner.report.numbers import significant
from cpic_planner.report.whatif_looks import FEW, Look, Sweep, looks_of, plain_log_axis, row_label, sweep_of

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["convergence_figure", "curves_figure", "sweep_figure"]

_BAND_ALPHA = 0.18
_MANY = 32
_LOG_RANGE = 20.0
_BUDGET_REACH = 1.3
"""A budget beyond this many times the longest line is told in the caption: drawing it would squeeze the lines."""


def curves_figure(result: WhatIfResult) -> Picture:
    """Draw planets found against telescope time used, with the 90 % interval of the mean.

    Parameters
    ----------
    result : WhatIfResult
    """
    strategies = result.strategies
    longest = max(item.hours.survey_high for item in strategies) or 1.0
    budgets = sorted({float(item.settings["time_budget_h"]) for item in strategies})
    drawn = [budget for budget in budgets if budget <= _BUDGET_REACH * longest]
    end = 1.04 * max([longest, *drawn])
    with style():
        figure = _panels(result, "curve")
        for axes in figure.axes:
            for budget in drawn:
                axes.axvline(budget, color="#111111", lw=1.1, ls="--", zorder=1)
            axes.set(xlim=(0.0, end), ylim=(0.0, None))
        figure.supxlabel("telescope time used (h)", fontsize=10.5)
        figure.supylabel("planets found, new and known", fontsize=10.5)
        told = _listed([f"{significant(budget, 4)} h" for budget in budgets])
        where = "dashed" if len(drawn) == len(budgets) else "dashed where on the axis" if drawn else "beyond the axis"
        best = max(strategies, key=lambda item: item.planets.mean)
        return save(
            figure,
            "svg",
            alt=f"Planets found against telescope time for {len(strategies)} strategies; {best.name} ends highest, at "
            f"{significant(best.planets.mean)} planets after {significant(best.hours.mean)} hours.",
            caption="Planets found by the time that so many hours of telescope time were used, mean over universes"
            f"{_band_words(len(strategies))}. A line ends, at its marker, where 95 % of the surveys of the strategy "
            f"have ended. Budget: {told} ({where}).",
        )


def convergence_figure(result: WhatIfResult) -> Picture:
    """Draw mean and interval against the number of universes.

    Parameters
    ----------
    result : WhatIfResult
    """
    with style():
        figure = _panels(result, "convergence")
        for axes in figure.axes:
            plain_log_axis(axes)
        figure.supxlabel("universes", fontsize=10.5)
        figure.supylabel("planets found, new and known", fontsize=10.5)
        widest = max(item.planets.high - item.planets.low for item in result.strategies)
        return save(
            figure,
            "svg",
            alt=f"Mean number of planets found against the number of universes up to {result.n_universes}.",
            caption="Has the Monte Carlo converged? Mean of the first universes"
            f"{_band_words(len(result.strategies))}. At the end the widest interval is {significant(widest, 2)} "
            "planets; four times the universes halve it.",
        )


def _band_words(n: int) -> str:
    return " with the 90 % interval of the mean" if n <= FEW else " (intervals are in the tables)"


def _listed(texts: Sequence[str]) -> str:
    return ", ".join(texts) if len(texts) <= 4 else f"{texts[0]} to {texts[-1]}"


def _panels(result: WhatIfResult, what: Literal["curve", "convergence"]) -> Figure:
    """One panel; for a long sweep one of each base strategy, coloured by the value."""
    strategies, sweep = result.strategies, sweep_of(result.strategies)
    if sweep is not None and len(strategies) > FEW and len(sweep.lines) <= FEW and len(sweep.values) <= _MANY:
        return _sweep_panels(strategies, sweep, what)
    few = len(strategies) <= FEW
    figure = new_figure(4.4 if few else 4.2 + 0.2 * np.ceil(min(len(strategies), _MANY) / 3))
    axes = figure.subplots()
    for item, look in zip(strategies, looks_of(len(strategies)), strict=True):
        _line(axes, item, what, look, band=few)
    axes.grid(visible=True)
    if len(strategies) <= _MANY:
        figure.legend(loc="outside upper center", ncols=3 if few else 2, fontsize=9.5 if few else 8)
    return figure


def _sweep_panels(strategies: Sequence[StrategyOutcome], sweep: Sweep, what: Literal["curve", "convergence"]) -> Figure:
    import matplotlib as mpl

    columns = min(3, len(sweep.lines))
    rows = -(-len(sweep.lines) // columns)
    figure = new_figure(1.3 + 2.5 * rows)
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    # The last yellow of the map is too light for a line.
    colours = mpl.colormaps["viridis"](np.linspace(0.0, 0.85, len(sweep.values)))
    looks = [
        Look(mpl.colors.to_hex(colour), look.marker, look.dash)
        for colour, look in zip(colours, looks_of(len(sweep.values)), strict=True)
    ]
    handles = {}
    for axes, (name, members) in zip(grid.flat, sweep.lines.items(), strict=False):
        for value, look in zip(sweep.values, looks, strict=True):
            if value in members:
                handles[value] = _line(axes, strategies[members[value]], what, look, band=False)
        axes.set_title(row_label(name), fontsize=9.5)
        axes.grid(visible=True)
    for axes in grid.flat[len(sweep.lines) :]:
        axes.remove()
    shown = [value for value in sweep.values if value in handles]
    figure.legend([handles[value] for value in shown], [literal(f"{sweep.key}={value}") for value in shown],
                  loc="outside upper center", ncols=4, fontsize=8.5)  # fmt: skip
    return figure


def _line(
    axes: Axes, item: StrategyOutcome, what: Literal["curve", "convergence"], look: Look, *, band: bool
) -> Artist:
    points: list[CurvePoint] = item.curve if what == "curve" else item.convergence
    x, mean, low, high = (np.array([getattr(point, name) for point in points]) for name in ("x", "mean", "low", "high"))
    if what == "curve":
        # Beyond the end nothing changes: the next point holds what the surveys end with, however far it is.
        end = item.hours.survey_high
        n = int(np.searchsorted(x, end))
        mean, low, high = (np.append(values[:n], values[min(n, len(values) - 1)]) for values in (mean, low, high))
        x = np.append(x[:n], end)
    if band:
        axes.fill_between(x, low, high, color=look.colour, alpha=_BAND_ALPHA, lw=0)
    (line,) = axes.plot(x, mean, color=look.colour, ls=look.dash, lw=1.6, marker=look.marker, ms=6.5,
                        markevery=[len(x) - 1], label=row_label(item.name))  # fmt: skip
    return line


def sweep_figure(result: WhatIfResult) -> Picture | None:
    """Draw yield against the varied key, a line for every base strategy; none where nothing is varied.

    Parameters
    ----------
    result : WhatIfResult
    """
    sweep = sweep_of(result.strategies)
    if sweep is None:
        return None
    numbers = sweep.numbers
    places = np.arange(len(sweep.values), dtype=float) if numbers is None else np.array(numbers)
    with style():
        n_lines = len(sweep.lines)
        figure = new_figure(4.6 + (0.0 if n_lines <= FEW else 0.2 * min(n_lines, _MANY) / 2))
        panels = figure.subplots(1, 2, sharex=True)
        for axes, quantity in zip(panels, ("planets", "new_planets"), strict=True):
            for (name, members), look in zip(sweep.lines.items(), looks_of(n_lines), strict=True):
                chosen = [(x, getattr(result.strategies[members[value]], quantity))
                          for x, value in zip(places, sweep.values, strict=True) if value in members]  # fmt: skip
                x = [place for place, _ in chosen]
                means = np.array([found.mean for _, found in chosen])
                ends = np.array([[found.low, found.high] for _, found in chosen])
                axes.errorbar(x, means, yerr=np.clip(np.abs(ends - means[:, None]).T, 0, None), color=look.colour,
                              marker=look.marker, ls=look.dash, lw=1.5, ms=6, elinewidth=1.1, capsize=2,
                              label=row_label(name))  # fmt: skip
            axes.grid(visible=True)
            axes.set_ylim(0.0, None)
        _value_axis(panels[0], sweep, places)
        panels[0].set_ylabel("planets found, new and known")
        panels[1].set_ylabel("new planets found")
        figure.supxlabel(literal(sweep.key), fontsize=10.5)
        if n_lines <= _MANY:
            handles, texts = panels[0].get_legend_handles_labels()
            figure.legend(handles, texts, loc="outside upper center", ncols=3 if n_lines <= FEW else 2, fontsize=9)
        return save(
            figure,
            "svg",
            alt=f"Planets found against {sweep.key} for {n_lines} strategies and {len(sweep.values)} values.",
            caption=f"Planets found for every value of {sweep.key}, mean with the 90 % interval of the mean. The same "
            "universes are used for every point, so differences between points are surer than their intervals look; "
            "the table of differences has them.",
        )


def _value_axis(axes: Axes, sweep: Sweep, places: np.ndarray) -> None:
    """A logarithmic axis for wide ranges, names where the values are no numbers."""
    if sweep.numbers is None:
        axes.set_xticks(places, [row_label(value) for value in sweep.values])
        axes.set_xlim(-0.5, len(places) - 0.5)
    elif places.min() > 0 and places.max() / places.min() >= _LOG_RANGE:
        axes.set_xscale("log")
