"""Figures of survey yields against telescope time, a varied key, and the number of universes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from cpic_core import FloatArray
from cpic_planner.report import drawing
from cpic_planner.report.drawing import BAND_STYLE, Look, Picture, literal, new_figure, save, style
from cpic_planner.report.numbers import significant
from cpic_planner.report.whatif_maps import FEW, Sweep, left_out, looks_of, row_label, shown_rows, sweep_of
from cpic_planner.results import CurvePoint, StrategyOutcome, WhatIfResult

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_What = Literal["curve", "convergence"]
_BAND_ALPHA = 0.18
_MOST_VALUES = 16
"""Values of a sweep that shades can tell apart."""
_LOG_RANGE = 8.0
_BUDGET_REACH = 1.3
"""A budget beyond this many times the longest line is told in the caption: drawing it would squeeze the lines."""


def curves_figure(result: WhatIfResult) -> Picture:
    """Draw planets found against telescope time used, with the 90 % interval of the mean."""
    strategies = result.strategies
    longest = max(item.hours.survey_high for item in strategies) or 1.0
    budgets = sorted({float(item.settings["time_budget_h"]) for item in strategies})
    drawn = [budget for budget in budgets if budget <= _BUDGET_REACH * longest]
    end = 1.04 * max([longest, *drawn])
    with style():
        figure, shown = _panels(result, "curve")
        for axes in figure.axes:
            for budget in drawn:
                axes.axvline(budget, color="#111111", lw=1.1, ls="--", zorder=1)
            axes.set(xlim=(0.0, end), ylim=(0.0, None))
        figure.supxlabel("telescope time used (h)", fontsize=10.5)
        figure.supylabel("planets found, new and known", fontsize=10.5)
        budgets_text = _listed([f"{significant(budget, 4)} h" for budget in budgets])
        where = "dashed" if len(drawn) == len(budgets) else "dashed where on the axis" if drawn else "beyond the axis"
        best = max(strategies, key=lambda item: item.planets.mean)
        return save(
            figure,
            alt=f"Planets found against telescope time for {len(strategies)} strategies; {best.name} ends highest, at "
            f"{significant(best.planets.mean)} planets after {significant(best.hours.mean)} hours.",
            caption="Planets found by the time that so many hours of telescope time were used, mean over universes"
            f"{shown} A line ends, at its marker, where 95 % of the surveys of the strategy "
            f"have ended. Budget: {budgets_text} ({where}).",
        )


def convergence_figure(result: WhatIfResult) -> Picture:
    """Draw mean and interval against the number of universes."""
    with style():
        figure, shown = _panels(result, "convergence")
        for axes in figure.axes:
            drawing.plain_log_axis(axes)
        figure.supxlabel("universes", fontsize=10.5)
        figure.supylabel("planets found, new and known", fontsize=10.5)
        widest = max(item.planets.high - item.planets.low for item in result.strategies)
        return save(
            figure,
            alt=f"Mean number of planets found against the number of universes up to {result.n_universes}.",
            caption="Has the Monte Carlo converged? Mean of the first universes"
            f"{shown} At the end the widest interval is {significant(widest, 2)} "
            "planets; four times the universes halve it.",
        )


def _listed(texts: Sequence[str]) -> str:
    return ", ".join(texts) if len(texts) <= 4 else f"{texts[0]} to {texts[-1]}"


def _panels(result: WhatIfResult, what: _What) -> tuple[Figure, str]:
    """Draw one panel; for a long sweep one of each line, coloured by the value. Return the end of the caption too."""
    strategies, sweep = result.strategies, sweep_of(result.strategies)
    if len(strategies) > FEW and sweep is not None and len(sweep.lines) <= FEW and len(sweep.values) <= _MOST_VALUES:
        return _sweep_panels(strategies, sweep, what), "."
    figure = new_figure(4.4)
    axes = figure.subplots()
    chosen = [strategies[i] for i in shown_rows(strategies, FEW)]
    for item, (colour, marker) in zip(chosen, looks_of(chosen), strict=True):
        _line(axes, item, what, colour, marker, band=True)
    axes.grid(visible=True)
    figure.legend(loc="outside upper center", ncols=3)
    return figure, f" with the 90 % interval of the mean.{left_out(strategies, FEW)}"


def _sweep_panels(strategies: Sequence[StrategyOutcome], sweep: Sweep, what: _What) -> Figure:
    import matplotlib as mpl

    columns = min(3, len(sweep.lines))
    rows = -(-len(sweep.lines) // columns)
    figure = new_figure(1.3 + 2.5 * rows)
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    # The last yellow of the map is too light for a line.
    shades = mpl.colormaps["viridis"](np.linspace(0.0, 0.85, len(sweep.values)))
    looks = [(mpl.colors.to_hex(shade), BAND_STYLE[i % len(BAND_STYLE)][1]) for i, shade in enumerate(shades)]
    handles = {}
    for axes, (name, members) in zip(grid.flat, sweep.lines.items(), strict=False):
        for value, look in zip(sweep.values, looks, strict=True):
            if value in members:
                handles[value] = _line(axes, strategies[members[value]], what, *look, band=False)
        axes.set_title(row_label(name), fontsize=9.5)
        axes.grid(visible=True)
    for axes in grid.flat[len(sweep.lines) :]:
        axes.remove()
    texts = [literal(f"{sweep.key}={value}") for value in sweep.values]
    lines = [handles[value] for value in sweep.values]
    figure.legend(lines, texts, loc="outside upper center", ncols=4, fontsize=8.5)
    return figure


def _line(axes: Axes, item: StrategyOutcome, what: _What, colour: str, marker: str, *, band: bool) -> Artist:
    points: list[CurvePoint] = item.curve if what == "curve" else item.convergence
    x, mean, low, high = (np.array([getattr(point, name) for point in points]) for name in ("x", "mean", "low", "high"))
    if what == "curve":
        # Beyond the end nothing changes: the next point holds what the surveys end with, however far it is.
        end = item.hours.survey_high
        n = int(np.searchsorted(x, end))
        mean, low, high = (np.append(values[:n], values[min(n, len(values) - 1)]) for values in (mean, low, high))
        x = np.append(x[:n], end)
    if band:
        axes.fill_between(x, low, high, color=colour, alpha=_BAND_ALPHA, lw=0)
    look: Look = {"color": colour, "lw": 1.6, "marker": marker, "ms": 6.5, "markevery": [len(x) - 1]}
    (line,) = axes.plot(x, mean, label=row_label(item.name), **look)
    return line


def sweep_figure(result: WhatIfResult) -> Picture | None:
    """Draw yield against the varied key, a line for every base strategy; none where nothing is varied."""
    strategies, sweep = result.strategies, sweep_of(result.strategies)
    if sweep is None:
        return None
    numbers = sweep.numbers
    places = np.arange(len(sweep.values), dtype=float) if numbers is None else np.array(numbers)
    best = {line: max(strategies[i].planets.mean for i in members.values()) for line, members in sweep.lines.items()}
    kept = set(sorted(best, key=lambda line: -best[line])[:FEW])
    lines = [line for line in sweep.lines if line in kept]
    with style():
        figure = new_figure(4.6)
        panels = figure.subplots(1, 2, sharex=True)
        for axes, quantity in zip(panels, ("planets", "new_planets"), strict=True):
            for line, (colour, marker) in zip(lines, BAND_STYLE, strict=False):
                members = sweep.lines[line]
                at = [i for i, value in enumerate(sweep.values) if value in members]
                estimates = [getattr(strategies[members[sweep.values[i]]], quantity) for i in at]
                means = [item.mean for item in estimates]
                errors = [[item.mean - item.low for item in estimates], [item.high - item.mean for item in estimates]]
                look: Look = {"color": colour, "marker": marker, "lw": 1.5, "ms": 6, "elinewidth": 1.1, "capsize": 2.5}
                axes.errorbar(places[at], means, yerr=np.maximum(errors, 0.0), label=row_label(line), **look)
            axes.grid(visible=True)
            axes.set_ylim(0.0, None)
        _value_axis(panels[0], sweep, places)
        panels[0].set_ylabel("planets found, new and known")
        panels[1].set_ylabel("new planets found")
        figure.supxlabel(literal(sweep.title), fontsize=10.5)
        handles, texts = panels[0].get_legend_handles_labels()
        figure.legend(handles, texts, loc="outside upper center", ncols=3)
        hidden = len(sweep.lines) - len(lines)
        return save(
            figure,
            alt=f"Planets found against {sweep.key} for {len(lines)} strategies and {len(sweep.values)} values.",
            caption=f"Planets found for every value of {sweep.key}, with the 90 % interval of the mean. All points "
            "share the same universes, so two of them differ more surely than their intervals suggest: see the "
            f"differences.{f' Strategies that find less, not shown: {hidden}.' if hidden else ''}",
        )


def _value_axis(axes: Axes, sweep: Sweep, places: FloatArray) -> None:
    """Set ticks at the values as they were written; a logarithmic axis for wide ranges."""
    from matplotlib.ticker import NullLocator

    if sweep.numbers is not None and places.min() > 0 and places.max() / places.min() >= _LOG_RANGE:
        axes.set_xscale("log")
    axes.xaxis.set_minor_locator(NullLocator())
    crowded = len(sweep.values) > _MOST_VALUES
    shown = range(0, len(sweep.values), 1 + (len(sweep.values) - 1) // _MOST_VALUES if crowded else 1)
    axes.set_xticks(places[list(shown)], [row_label(sweep.values[i]) for i in shown])
    axes.tick_params(axis="x", rotation=90 if len(sweep.values) > FEW else 0)
