"""Figures of a comparison of survey strategies."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from cpic_core import Record
from cpic_planner import results
from cpic_planner.report import drawing
from cpic_planner.report.drawing import BAND_STYLE, Look, Picture, literal, with_style
from cpic_planner.report.ranking_figures import map_longitude, marker_area, sky_axes
from cpic_planner.report.words import decimals, hidden_sentence, pretty_name, significant
from cpic_planner.results import StrategyOutcome, SurveyTarget, WhatIfResult

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


FEW = 8
"""Strategies that can be told apart by colour and marker in one plot."""
MOST_ROWS = 40
"""Rows of a figure that can be read."""
_LABEL_LENGTH = 34
_DASHED: Look = {"color": "#111111", "lw": 1.1, "ls": "--", "zorder": 1}


class Sweep(Record):
    """Strategies that differ by the values of keys, as ``--vary`` names them.

    Attributes
    ----------
    key : str
        What is drawn along the axis: the key with the most values.
    values : tuple of str
        Its values with unit or x, ascending if they are numbers, otherwise in order of appearance.
    numbers : tuple of float or None
        The values in ``unit``, if all of them are numbers of that one unit.
    unit : str
        Unit of the numbers; ``x`` for factors, empty for quantities that have none.
    lines : dict
        Index of the strategy at each value, by line: the base strategy with the values of the other keys.
    """

    key: str
    values: tuple[str, ...]
    numbers: tuple[float, ...] | None
    unit: str
    lines: dict[str, dict[str, int]]

    @property
    def title(self) -> str:
        """The key with its unit, for an axis."""
        return f"{self.key} ({self.unit})" if self.numbers is not None and self.unit else self.key


def looks_of(strategies: Sequence[StrategyOutcome]) -> list[tuple[str, str]]:
    """Return colour and marker of each strategy.

    Up to 8 differ; of more, those of one line of a sweep look alike, and without a sweep all do: their rows are named.
    """
    n = len(strategies)
    sweep = sweep_of(strategies) if n > FEW else None
    if n <= FEW:
        return list(BAND_STYLE[:n])
    if sweep is None or len(sweep.lines) > FEW:
        return [BAND_STYLE[0]] * n
    lines = {i: line for line, members in enumerate(sweep.lines.values()) for i in members.values()}
    return [BAND_STYLE[lines[i]] for i in range(n)]


def sweep_of(strategies: Sequence[StrategyOutcome]) -> Sweep | None:
    """Return what varies where all strategies have values of the same keys; otherwise none."""
    parsed = [(item.base, {setting.name: setting for setting in item.varied}) for item in strategies]
    keys = list(parsed[0][1]) if parsed else []
    if not keys or any(list(values) != keys for _, values in parsed):
        return None
    settings_by_key = {key: {values[key].text: values[key] for _, values in parsed} for key in keys}
    key = max(keys, key=lambda name: len(settings_by_key[name]))
    if len(settings_by_key[key]) < 2:
        return None
    lines: dict[str, dict[str, int]] = {}
    for index, (base, values) in enumerate(parsed):
        rest = " ".join(values[name].label for name in keys if name != key and len(settings_by_key[name]) > 1)
        lines.setdefault(f"{base} {rest}".strip(), {})[values[key].text] = index
    texts, settings = list(settings_by_key[key]), list(settings_by_key[key].values())
    units = {"x" if item.text.startswith("x") and not item.unit else item.unit for item in settings}
    amounts = [number for item in settings if (number := _number(item.value)) is not None]
    if len(amounts) < len(settings) or len(units) > 1:
        return Sweep(key, tuple(texts), None, "", lines)
    ordered = sorted(zip(amounts, texts, strict=True))
    return Sweep(key, tuple(text for _, text in ordered), tuple(value for value, _ in ordered), units.pop(), lines)


def _number(value: Any) -> float | None:
    """Return a number, or the only one of a list; None for anything else."""
    if isinstance(value, list | tuple) and len(value) == 1:
        return _number(value[0])
    plain = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    return float(value) if plain else None


def row_label(name: str) -> str:
    """Return the name of a strategy for an axis: cut in its middle if long, for names differ at both ends."""
    if len(name) > _LABEL_LENGTH:
        half = (_LABEL_LENGTH - 1) // 2
        name = f"{name[:half]}…{name[-half:]}"
    return literal(name)


def shown_rows(strategies: Sequence[StrategyOutcome], most: int = MOST_ROWS) -> list[int]:
    """Return which strategies a figure shows: all, or the first one and those that find most, in order."""
    best = sorted(range(1, len(strategies)), key=lambda i: (-strategies[i].planets.mean, i))
    return sorted([0, *best[: most - 1]])


def left_out(strategies: Sequence[StrategyOutcome], most: int = MOST_ROWS) -> str:
    """Return the sentence that says which strategies a figure shows; empty if it shows all."""
    if len(strategies) <= most:
        return ""
    return f" Shown are the first strategy and the {most - 1} of all {len(strategies)} that find most."


_Visits = Mapping[str, Sequence[tuple[int, SurveyTarget]]]
"""Stars by name, each with index and record of every strategy that visits it."""
_RING_AREA = 75.0
_LABELLED = 14
_SPREAD = 0.76
"""Height of a row that the marks of its strategies share."""


def visited(result: WhatIfResult) -> dict[str, list[tuple[int, SurveyTarget]]]:
    """Return the stars that any strategy visits, with index and record of each strategy that does.

    Stars stand by the best rank that any strategy gives them.
    """
    visits: dict[str, list[tuple[int, SurveyTarget]]] = {}
    for i, strategy in enumerate(result.strategies):
        for target in strategy.targets:
            if target.slots:
                visits.setdefault(target.name, []).append((i, target))
    order = sorted(visits, key=lambda name: (min(target.rank for _, target in visits[name]), name))
    return {name: visits[name] for name in order}


@with_style
def calendar_figure(result: WhatIfResult) -> Picture | None:
    """Draw a mark for every planned visit: stars down, dates across; none where nothing is visited."""
    stars = visited(result)
    rows = dict(list(stars.items())[:MOST_ROWS])
    if not rows:
        return None
    many = len(result.strategies) > FEW
    begins = np.array(result.slot_utc, "datetime64[D]").astype(float)  # days since 1970, as matplotlib counts
    step = float(result.universe["slot_days"])
    each = 0.62 if len(rows) <= 10 and not many else 0.3
    figure, axes = drawing.panels(1.7 + each * max(len(rows), 3), grid="x")
    for row in range(len(rows)):
        axes.axhspan(row - 0.5, row + 0.5, color="#F4F6F8" if row % 2 else "white", lw=0, zorder=0)
    if many:
        _counts(axes, rows, begins, step, len(result.strategies))
        drawn = "Shade: in how many strategies a visit is planned in that slot."
    else:
        _marks(axes, result, rows, begins + 0.5 * step)
        drawn = f"One mark for each slot of {step:g} days with a visit, a colour and shape for each strategy."
    drawing.name_rows(axes, [_star_label(name, members) for name, members in rows.items()], marks=False)
    axes.set(ylim=(len(rows) - 0.5, -0.5), xlim=(begins[0] - step, begins[-1] + 2 * step))
    drawing.date_axis(axes)
    more = hidden_sentence("Stars of lower rank", len(stars) - len(rows))
    return drawing.picture(figure, "calendar", rows=rows, strategies=result.strategies, drawn=drawn, more=more)


def _star_label(name: str, members: Sequence[tuple[int, SurveyTarget]]) -> str:
    return literal(pretty_name(name)) + (" ●" if any(target.known_planets for _, target in members) else "")


def _marks(axes: Axes, result: WhatIfResult, rows: _Visits, middle: np.ndarray) -> None:
    n = len(result.strategies)
    offsets = _SPREAD * ((np.arange(n) + 0.5) / n - 0.5)
    places: list[tuple[list[float], list[float]]] = [([], []) for _ in range(n)]
    for row, members in enumerate(rows.values()):
        for i, target in members:
            places[i][0].extend(middle[target.slots])
            places[i][1].extend([row + offsets[i]] * len(target.slots))
    for (x, y), item, (colour, marker) in zip(places, result.strategies, looks_of(result.strategies), strict=True):
        look: Look = {"color": colour, "marker": marker, "ms": 4.5 if len(rows) <= 20 else 3.2}
        axes.plot(x, y, ls="none", markeredgewidth=0, label=row_label(item.name), **look)
    axes.figure.legend(loc="outside upper center", ncols=3, fontsize=9)


def _counts(axes: Axes, rows: _Visits, begins: np.ndarray, step: float, n: int) -> None:
    """Draw how many strategies visit each star in each slot."""
    from matplotlib.ticker import MaxNLocator

    counts = np.zeros((len(rows), len(begins)))
    for row, members in enumerate(rows.values()):
        for _, target in members:
            counts[row, sorted(set(target.slots))] += 1.0
    edges = np.append(begins, begins[-1] + step)
    shown = np.ma.masked_equal(counts, 0.0)
    look: Look = {"cmap": "viridis_r", "vmin": 1.0, "vmax": max(counts.max(), 2.0)}
    mesh = axes.pcolormesh(edges, np.arange(len(rows) + 1) - 0.5, shown, **look)
    axes.figure.colorbar(mesh, ax=axes, label=f"strategies, of {n}", pad=0.015, ticks=MaxNLocator(6, integer=True))


@with_style
def stars_figure(result: WhatIfResult) -> Picture | None:
    """Draw the visited stars on the sky, coloured by planets found for the time; none where nothing is visited."""
    from matplotlib.colors import LogNorm

    stars = visited(result)
    if not stars:
        return None
    best = {name: max(target.planets_per_100h for _, target in members) for name, members in stars.items()}
    # The most fruitful first: their labels are placed first, and they are drawn last.
    rows = [stars[name][0][1] for name in sorted(stars, key=lambda name: (-best[name], name))]
    values = np.array([best[row.name] for row in rows])
    x, y = map_longitude([row.ra_deg for row in rows]), np.deg2rad([row.dec_deg for row in rows])
    areas = 2.0 * marker_area([row.v_mag for row in rows])
    hosts = np.array([any(target.known_planets for _, target in stars[row.name]) for row in rows])
    fruitful = values > 0
    figure = drawing.new_figure(4.8)
    axes = sky_axes(figure)
    if (~fruitful).any():
        look: Look = {"facecolors": "white", "lw": 0.9, "edgecolors": "#777777", "zorder": 3}
        label = f"nothing found ({(~fruitful).sum()})"
        axes.scatter(x[~fruitful], y[~fruitful], s=areas[~fruitful], label=label, **look)
    if fruitful.any():
        ends = values[fruitful].min(), max(values[fruitful].max(), 1.001 * values[fruitful].min())
        order = np.flatnonzero(fruitful)[::-1]
        look = {"cmap": "viridis_r", "norm": LogNorm(*ends), "edgecolors": "#333333", "linewidths": 0.4}
        dots = axes.scatter(x[order], y[order], s=areas[order], c=values[order], zorder=4, **look)
        bar = figure.colorbar(dots, ax=axes, label="planets found per 100 h", shrink=0.8, pad=0.03)
        bar.ax.yaxis.set_major_formatter("{x:g}")
        bar.ax.yaxis.set_minor_formatter("{x:g}" if ends[1] < 20 * ends[0] else "")
    if hosts.any():
        look = {"facecolors": "none", "lw": 1.3, "edgecolors": "#D55E00", "zorder": 5}
        axes.scatter(x[hosts], y[hosts], s=areas[hosts] + _RING_AREA, label=f"known planet ({hosts.sum()})", **look)
    figure.legend(loc="outside lower center", ncols=4)
    first = slice(_LABELLED)
    reach = np.sqrt((areas + _RING_AREA * hosts) / np.pi)[first] * drawing.SCREEN_DPI / 72.0
    names = [literal(pretty_name(row.name)) for row in rows[first]]
    near: Look = {"avoid": axes.get_xticklabels(), "reach_px": reach.tolist()}
    drawing.place_labels(axes, x[first].tolist(), y[first].tolist(), names, fontsize=9, **near)
    fruits = ", ".join(pretty_name(row.name) for row in rows[:3])
    return drawing.picture(figure, "visited_stars", rows=rows, first=fruits)


_PARTS: tuple[tuple[str, str, str, str], ...] = (
    ("exposing_h", "exposing", "#0072B2", ""),
    ("occulted_h", "target out of sight", "#8C8C8C", "//"),
    ("settling_h", "slewing, settling", "#E69F00", ""),
    ("follow_up_h", "follow-up", "#009E73", "\\\\"),
    ("alarm_h", "false alarms", "#CC79A7", "xx"),
    ("unused_h", "unused budget", "#EFEFEF", ""),
)
_UNUSED_REACH = 1.35
_DETECTED: tuple[tuple[str, str, float, bool], ...] = (
    ("snr", "SNR", 1.0, True),
    ("margin", "significance / threshold", 1.0, True),
    ("contrast", "contrast (10⁻⁹)", 1e9, True),
    ("separation_arcsec", "separation (arcsec)", 1.0, False),
)
_ALL_PLANETS = "planets found, new and known"


@with_style
def yields_figure(result: WhatIfResult) -> Picture:
    """Draw the mean yield with its interval, and the range of single surveys, of every strategy."""
    rows, looks = shown_rows(result.strategies), looks_of(result.strategies)
    figure, panels = _row_panels(result, rows, 2)
    quantities = {"planets": _ALL_PLANETS, "new_planets": "new planets found"}
    for axes, (quantity, label) in zip(panels, quantities.items(), strict=True):
        for place, i in enumerate(rows):
            estimate: results.EstimateRecord = getattr(result.strategies[i], quantity)
            ends = [estimate.survey_low, estimate.survey_high]
            axes.plot(ends, [place, place], color=looks[i][0], lw=1.2, marker="|", ms=6)
            _draw_mean(axes, place, estimate, looks[i])
        axes.set_xlim(left=-0.02 * axes.get_xlim()[1])
        axes.set_xlabel(label)
    best = max(result.strategies, key=lambda item: item.planets.mean)
    return drawing.picture(figure, "yields", rows=rows, best=best, more=left_out(result.strategies))


@with_style
def differences_figure(result: WhatIfResult) -> Picture | None:
    """Draw paired differences with the first strategy; none where there is only one."""
    if len(result.strategies) < 2:
        return None
    reference = result.strategies[0].name
    places = {result.strategies[i].name: i for i in shown_rows(result.strategies) if i > 0}
    looks = looks_of(result.strategies)
    by_pair = {(item.first, item.quantity): item for item in result.differences if item.second == reference}
    figure, panels = _row_panels(result, list(places.values()), 2)
    quantities: tuple[Literal["planets", "new_planets"], ...] = ("planets", "new_planets")
    for axes, quantity in zip(panels, quantities, strict=True):
        for place, (name, i) in enumerate(places.items()):
            if (item := by_pair.get((name, quantity))) is not None:
                sure = item.low > 0.0 or item.high < 0.0
                _draw_mean(axes, place, item, looks[i] if sure else ("#8C8C8C", looks[i][1]), sure=sure)
        axes.axvline(0.0, **_DASHED)
        axes.set_xlabel(f"{quantity.replace('_', ' ')}, difference a survey")
    better = [name for name in places if (item := by_pair.get((name, "planets"))) is not None and item.low > 0]
    others = f" and {len(better) - FEW} others" if len(better) > FEW else ""
    names = f"{', '.join(better[:FEW]) or 'none'}{others}"
    return drawing.picture(figure, "differences", reference=reference, better=names, more=left_out(result.strategies))


@with_style
def time_figure(result: WhatIfResult) -> Picture:
    """Draw where the telescope time goes."""
    rows = shown_rows(result.strategies)
    uses = [result.strategies[i].time_use for i in rows]
    used = np.array([sum(getattr(use, name) for name, *_ in _PARTS[:-1]) for use in uses])
    unused = np.array([use.unused_h for use in uses])
    end = min(float((used + unused).max()), _UNUSED_REACH * float(used.max())) or float((used + unused).max()) or 1.0
    figure, (axes,) = _row_panels(result, rows, 1)
    left = np.zeros(len(rows))
    for name, label, colour, hatch in _PARTS:
        widths = np.array([getattr(use, name) for use in uses])
        look: Look = {"color": colour, "hatch": hatch, "edgecolor": "white", "lw": 0.4, "height": 0.66}
        axes.barh(range(len(rows)), widths, left=left, label=label, **look)
        left += widths
    axes.set_xlim(0.0, end)
    for place in range(len(rows)):
        if unused[place] > 0 and used[place] < 0.88 * end:
            text, place_xy = f"{significant(unused[place])} h unused", (used[place], place)
            look = {"textcoords": "offset points", "va": "center", "fontsize": 8, "color": "#333333"}
            axes.annotate(text, place_xy, (4, 0), **look)
    axes.set_xlabel("telescope time a survey (h)")
    figure.legend(loc="outside upper center", ncols=5, fontsize=9, handlelength=1.6, columnspacing=1.4)
    cut = " Unused budget runs on beyond the axis." if (used + unused).max() > end else ""
    totals = [f"{result.strategies[i].name} {significant(hours)} h" for i, hours in zip(rows, used, strict=True)]
    words: dict[str, Any] = {"totals": ", ".join(totals[:FEW]), "cut": cut, "more": left_out(result.strategies)}
    return drawing.picture(figure, "telescope_time", **words)


@with_style
def detections_figure(result: WhatIfResult) -> Picture | None:
    """Draw what the detected planets are like; none where nothing is detected."""
    rows = [i for i in shown_rows(result.strategies) if result.strategies[i].quantiles]
    if not rows:
        return None
    looks = looks_of(result.strategies)
    figure, panels = _row_panels(result, rows, len(_DETECTED))
    for axes, (name, title, scale, log) in zip(panels, _DETECTED, strict=True):
        for place, i in enumerate(rows):
            levels = result.strategies[i].quantiles.get(name)
            if levels is not None:
                _draw_quantiles(axes, place, [scale * level for level in levels], looks[i][0])
        if log:
            drawing.plain_log_axis(axes)
        axes.set_xlabel(title)
    empty = hidden_sentence("Strategies without any detection", sum(not item.quantiles for item in result.strategies))
    return drawing.picture(figure, "detections", empty=empty, more=left_out(result.strategies))


def _draw_quantiles(axes: Axes, place: int, levels: Sequence[float], colour: str) -> None:
    lowest, low, middle, high, highest = levels
    axes.plot([lowest, highest], [place, place], color=colour, lw=1.2, solid_capstyle="butt")
    axes.barh(place, high - low, left=low, height=0.46, color=colour, alpha=0.35, edgecolor=colour, lw=1.0)
    axes.plot([middle, middle], [place - 0.23, place + 0.23], color="#111111", lw=1.6, solid_capstyle="butt")


def _draw_mean(
    axes: Axes,
    place: int,
    item: results.EstimateRecord | results.DifferenceRecord,
    look: tuple[str, str],
    *,
    sure: bool = True,
) -> None:
    colour, marker = look
    axes.plot([item.low, item.high], [place, place], color=colour, lw=8.0, solid_capstyle="butt", alpha=0.45)
    face = colour if sure else "white"
    axes.plot([item.mean], [place], marker=marker, ms=5.5, color=colour, ls="none", mfc=face, mec=colour)


def _row_panels(result: WhatIfResult, rows: Sequence[int], columns: int) -> tuple[Figure, list[Axes]]:
    """Return the panels that share their rows, first strategy at the top."""
    many = len(rows) > 12
    height = 1.5 + (0.24 if many else 0.42) * max(len(rows), 2)
    figure, panels = drawing.panels(height, columns, grid="x", sharey=True, squeeze=False)
    for axes in panels[0]:
        axes.tick_params(axis="y", length=0)
    labels = [row_label(result.strategies[i].name) for i in rows]
    drawing.name_rows(panels[0][0], labels, fontsize=8 if many else 9.5)
    return figure, list(panels[0])


_What = Literal["curve", "convergence"]
_BAND_ALPHA = 0.18
_MOST_VALUES = 16
"""Values of a sweep that shades can tell apart."""
_LOG_RANGE = 8.0
_BUDGET_REACH = 1.3
"""A budget beyond this many times the longest line is told in the caption: drawing it would squeeze the lines."""


@with_style
def curves_figure(result: WhatIfResult) -> Picture:
    """Draw planets found against telescope time used, with the 90 % interval of the mean."""
    strategies = result.strategies
    longest = max(item.hours.survey_high for item in strategies) or 1.0
    budgets = sorted({float(item.settings["time_budget_h"]) for item in strategies})
    drawn = [budget for budget in budgets if budget <= _BUDGET_REACH * longest]
    figure, shown = _curves(result, "curve", "telescope time used (h)")
    for axes in figure.axes:
        for budget in drawn:
            axes.axvline(budget, **_DASHED)
        axes.set(xlim=(0.0, 1.04 * max([longest, *drawn])), ylim=(0.0, None))
    texts = [f"{significant(budget, 4)} h" for budget in budgets]
    listed = ", ".join(texts) if len(texts) <= 4 else f"{texts[0]} to {texts[-1]}"
    where = "dashed" if len(drawn) == len(budgets) else "dashed where on the axis" if drawn else "beyond the axis"
    best = max(strategies, key=lambda item: item.planets.mean)
    words: dict[str, Any] = {"strategies": strategies, "best": best, "shown": shown, "budgets": listed, "where": where}
    return drawing.picture(figure, "yield_curves", **words)


@with_style
def convergence_figure(result: WhatIfResult) -> Picture:
    """Draw mean and interval against the number of universes."""
    figure, shown = _curves(result, "convergence", "universes")
    for axes in figure.axes:
        drawing.plain_log_axis(axes)
    widest = max(item.planets.high - item.planets.low for item in result.strategies)
    return drawing.picture(figure, "convergence", n_universes=result.n_universes, shown=shown, widest=widest)


def _curves(result: WhatIfResult, what: _What, label: str) -> tuple[Figure, str]:
    """Draw one panel; for a long sweep one of each line, coloured by the value. Return the end of the caption too."""
    strategies, sweep = result.strategies, sweep_of(result.strategies)
    if len(strategies) > FEW and sweep is not None and len(sweep.lines) <= FEW and len(sweep.values) <= _MOST_VALUES:
        figure, shown = _sweep_panels(strategies, sweep, what), "."
    else:
        figure, axes = drawing.panels(4.4)
        chosen = [strategies[i] for i in shown_rows(strategies, FEW)]
        for item, (colour, marker) in zip(chosen, looks_of(chosen), strict=True):
            _line(axes, item, what, colour, marker, band=True)
        figure.legend(loc="outside upper center", ncols=3)
        shown = f" with the 90 % interval of the mean.{left_out(strategies, FEW)}"
    figure.supxlabel(label, fontsize=10.5)
    figure.supylabel(_ALL_PLANETS, fontsize=10.5)
    return figure, shown


def _sweep_panels(strategies: Sequence[StrategyOutcome], sweep: Sweep, what: _What) -> Figure:
    import matplotlib as mpl

    columns = min(3, len(sweep.lines))
    rows = -(-len(sweep.lines) // columns)
    figure, grid = drawing.panels(1.3 + 2.5 * rows, columns, rows, sharex=True, sharey=True, squeeze=False)
    # The last yellow of the map is too light for a line.
    shades = mpl.colormaps["viridis"](np.linspace(0.0, 0.85, len(sweep.values)))
    looks = [(mpl.colors.to_hex(shade), BAND_STYLE[i % len(BAND_STYLE)][1]) for i, shade in enumerate(shades)]
    handles = {}
    for axes, (name, members) in zip(grid.flat, sweep.lines.items(), strict=False):
        for value, look in zip(sweep.values, looks, strict=True):
            if value in members:
                handles[value] = _line(axes, strategies[members[value]], what, *look, band=False)
        axes.set_title(row_label(name), fontsize=9.5)
    for axes in grid.flat[len(sweep.lines) :]:
        axes.remove()
    texts = [literal(f"{sweep.key}={value}") for value in sweep.values]
    lines = [handles[value] for value in sweep.values]
    figure.legend(lines, texts, loc="outside upper center", ncols=4, fontsize=8.5)
    return figure


def _line(axes: Axes, item: StrategyOutcome, what: _What, colour: str, marker: str, *, band: bool) -> Artist:
    points: list[results.CurvePoint] = item.curve if what == "curve" else item.convergence
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


@with_style
def sweep_figure(result: WhatIfResult) -> Picture | None:
    """Draw yield against the varied key, a line for every base strategy; none where nothing is varied."""
    strategies, sweep = result.strategies, sweep_of(result.strategies)
    if sweep is None:
        return None
    places = np.arange(len(sweep.values), dtype=float) if sweep.numbers is None else np.array(sweep.numbers)
    best = {line: max(strategies[i].planets.mean for i in members.values()) for line, members in sweep.lines.items()}
    kept = set(sorted(best, key=lambda line: -best[line])[:FEW])
    lines = [line for line in sweep.lines if line in kept]
    figure, panels = drawing.panels(4.6, 2, sharex=True)
    quantities = {"planets": _ALL_PLANETS, "new_planets": "new planets found"}
    for axes, (quantity, label) in zip(panels, quantities.items(), strict=True):
        for line, (colour, marker) in zip(lines, BAND_STYLE, strict=False):
            members = sweep.lines[line]
            at = [i for i, value in enumerate(sweep.values) if value in members]
            estimates = [getattr(strategies[members[sweep.values[i]]], quantity) for i in at]
            means = [item.mean for item in estimates]
            errors = [[item.mean - item.low for item in estimates], [item.high - item.mean for item in estimates]]
            look: Look = {"color": colour, "marker": marker, "lw": 1.5, "ms": 6, "elinewidth": 1.1, "capsize": 2.5}
            axes.errorbar(places[at], means, yerr=np.maximum(errors, 0.0), label=row_label(line), **look)
        axes.set_ylim(0.0, None)
        axes.set_ylabel(label)
    _value_axis(panels[0], sweep, places)
    figure.supxlabel(literal(sweep.title), fontsize=10.5)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    more = hidden_sentence("Strategies that find less", len(sweep.lines) - len(lines))
    return drawing.picture(figure, "sweep", sweep=sweep, lines=lines, more=more)


def _value_axis(axes: Axes, sweep: Sweep, places: np.ndarray) -> None:
    """Set ticks at the values as they were written; a logarithmic axis for wide ranges."""
    from matplotlib.ticker import NullLocator

    if sweep.numbers is not None and places.min() > 0 and places.max() / places.min() >= _LOG_RANGE:
        axes.set_xscale("log")
    axes.xaxis.set_minor_locator(NullLocator())
    crowded = len(sweep.values) > _MOST_VALUES
    shown = range(0, len(sweep.values), 1 + (len(sweep.values) - 1) // _MOST_VALUES if crowded else 1)
    axes.set_xticks(places[list(shown)], [row_label(sweep.values[i]) for i in shown])
    axes.tick_params(axis="x", rotation=90 if len(sweep.values) > FEW else 0)


_DARK, _ROOM = 0.4, 34.0


def plan_label(item: results.DoubtChoice) -> str:
    """Return the name of a plan: its strategy, and the value that it is planned for."""
    return f"{item.strategy}, for {item.planned_for}"


@with_style
def doubt_figure(result: WhatIfResult) -> Picture | None:
    """Draw what every plan loses under every value; none where no number is in doubt."""
    found = result.doubt
    if found is None:
        return None
    best = sorted(range(len(found.choices)), key=lambda i: (found.choices[i].largest_loss, i))
    rows = [found.choices[i] for i in sorted(best[:MOST_ROWS])]
    texts = [value.text for value in found.values]
    cells = {(cell.strategy, cell.planned_for, cell.played_under): cell for cell in found.cells}
    own = [[cells[item.strategy, item.planned_for, text] for text in texts] for item in rows]
    losses = np.array([[cell.loss.mean for cell in row] for row in own])
    most = max(float(losses.max()), 1e-3)
    chosen = {"cautious": plan_label(found.decision.cautious), "most": plan_label(found.decision.expected)}
    figure, axes = drawing.panels(1.6 + 0.29 * len(rows), grid="")
    drawn = axes.imshow(losses, aspect="auto", cmap="cividis_r", vmin=0.0, vmax=most)
    for y, (row, item) in enumerate(zip(own, rows, strict=True)):
        for x, cell in enumerate(row):
            loss = "best" if cell.loss.mean == 0.0 else f"(−{decimals(cell.loss.mean, 3)})"
            colour = "white" if cell.loss.mean > _DARK * most else "black"
            look: Look = {"ha": "center", "va": "center", "fontsize": min(8.5, _ROOM / len(texts)), "color": colour}
            axes.text(x, y, f"{decimals(cell.planets.mean, 2)}  {loss}", **look)
        if names := [name for name, plan in chosen.items() if plan == plan_label(item)]:
            axes.text(len(texts) - 0.45, y, ", ".join(names), va="center", fontsize=9.5, fontweight="bold")
        if y and item.strategy != rows[y - 1].strategy:
            axes.axhline(y - 0.5, color="white", lw=3.0)
    axes.set_yticks(range(len(rows)), [row_label(plan_label(item)) for item in rows])
    axes.set_xticks(range(len(texts)), [literal(text) for text in texts])
    axes.set(xlabel=literal(f"{found.key} that turns out to be true"), ylabel="plan")
    axes.tick_params(length=0)
    figure.colorbar(drawn, ax=axes, pad=0.12, label="planets fewer than the best plan")
    about: dict[str, Any] = {"key": found.key, "what": found.quantity.replace("_", " ")}
    more = hidden_sentence("Plans that lose more", len(found.choices) - len(rows))
    return drawing.picture(figure, "doubt", rows=rows, values=found.values, more=more, **about)


WHATIF_FIGURES: dict[str, tuple[str, Callable[[WhatIfResult], Picture | None]]] = {
    "sweep": ("What the varied setting does", sweep_figure),
    "yields": ("What each strategy yields", yields_figure),
    "differences": ("Is the difference real?", differences_figure),
    "doubt": ("What each plan loses", doubt_figure),
    "curves": ("Yield against telescope time", curves_figure),
    "time": ("Where the time goes", time_figure),
    "calendar": ("Who is visited when", calendar_figure),
    "sky": ("Where the stars are", stars_figure),
    "detections": ("What is detected", detections_figure),
    "convergence": ("Are there enough universes?", convergence_figure),
}
"""Title of each figure, and what draws it where the result has something for it."""


def whatif_figures(result: WhatIfResult) -> dict[str, Picture]:
    """Draw the figures that the result has something for, by the keys of `WHATIF_FIGURES`."""
    drawn = {key: draw(result) for key, (_, draw) in WHATIF_FIGURES.items()}
    return {key: picture for key, picture in drawn.items() if picture is not None}
