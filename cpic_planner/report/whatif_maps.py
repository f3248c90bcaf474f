"""Appearance of strategies in figures: one colour and marker each, and the values that a sweep varies.

When strategies visit which stars, and where these stand on the sky.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cpic_planner.report import drawing
from cpic_planner.report.drawing import BAND_STYLE, Look, Picture, literal, new_figure, place_labels, save, style
from cpic_planner.report.numbers import pretty_name
from cpic_planner.report.sky_figures import map_longitude, marker_area, sky_axes
from cpic_planner.results import StrategyOutcome, SurveyTarget, WhatIfResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes


FEW = 8
"""Strategies that can be told apart by colour and marker in one plot."""
MOST_ROWS = 40
"""Rows of a figure that can be read."""
_LABEL_LENGTH = 34


@dataclass(frozen=True)
class Sweep:
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
    amounts = [_number(item.value) for item in settings]
    if None in amounts or len(units) > 1:
        return Sweep(key, tuple(texts), None, "", lines)
    ordered = sorted(zip(amounts, texts, strict=True))
    numbers = tuple(float(value) for value, _ in ordered)  # type: ignore[arg-type]
    return Sweep(key, tuple(text for _, text in ordered), numbers, units.pop(), lines)


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


def calendar_figure(result: WhatIfResult) -> Picture | None:
    """Draw a mark for every planned visit: stars down, dates across; none where nothing is visited."""
    stars = visited(result)
    rows = dict(list(stars.items())[:MOST_ROWS])
    if not rows:
        return None
    many = len(result.strategies) > FEW
    begins = np.array(result.slot_utc, "datetime64[D]").astype(float)  # days since 1970, as matplotlib counts
    step = float(result.universe["slot_days"])
    with style():
        each = 0.62 if len(rows) <= 10 and not many else 0.3
        figure = new_figure(1.7 + each * max(len(rows), 3))
        axes = figure.subplots()
        for row in range(len(rows)):
            axes.axhspan(row - 0.5, row + 0.5, color="#F4F6F8" if row % 2 else "white", lw=0, zorder=0)
        if many:
            _counts(axes, rows, begins, step, len(result.strategies))
        else:
            _marks(axes, result, rows, begins + 0.5 * step)
        axes.set_yticks(range(len(rows)), [_star_label(name, members) for name, members in rows.items()])
        axes.tick_params(axis="y", length=0)
        axes.set(ylim=(len(rows) - 0.5, -0.5), xlim=(begins[0] - step, begins[-1] + 2 * step))
        drawing.date_axis(axes)
        axes.grid(visible=True, axis="x")
        hidden = len(stars) - len(rows)
        drawn = f"One mark for each slot of {step:g} days with a visit, a colour and shape for each strategy."
        if many:
            drawn = "Shade: in how many strategies a visit is planned in that slot."
        return save(
            figure,
            alt=f"Calendar of visits of {len(rows)} stars by {len(result.strategies)} strategies.",
            caption=f"Planned visits, those held in reserve included; stars by the best rank that any strategy gives "
            f"them; ● marks stars with a known planet. {drawn} Stop rules cancel later visits once a planet is found."
            + (f" Stars of lower rank, not shown: {hidden}." if hidden else ""),
        )


def _star_label(name: str, members: Sequence[tuple[int, SurveyTarget]]) -> str:
    return literal(pretty_name(name)) + (" ●" if any(target.known_planets for _, target in members) else "")


def _marks(
    axes: Axes, result: WhatIfResult, rows: Mapping[str, Sequence[tuple[int, SurveyTarget]]], middle: np.ndarray
) -> None:
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


def _counts(
    axes: Axes, rows: Mapping[str, Sequence[tuple[int, SurveyTarget]]], begins: np.ndarray, step: float, n: int
) -> None:
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
    with style():
        figure = new_figure(4.8)
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
            label = f"known planet ({hosts.sum()})"
            axes.scatter(x[hosts], y[hosts], s=areas[hosts] + _RING_AREA, label=label, **look)
        figure.legend(loc="outside lower center", ncols=4)
        first = slice(_LABELLED)
        reach = np.sqrt((areas + _RING_AREA * hosts) / np.pi)[first] * drawing.SCREEN_DPI / 72.0
        names = [literal(pretty_name(row.name)) for row in rows[first]]
        hours, px, py = axes.get_xticklabels(), x[first].tolist(), y[first].tolist()
        place_labels(axes, px, py, names, fontsize=9, avoid=hours, reach_px=reach.tolist())
        return save(
            figure,
            alt=f"Map of the sky with {len(rows)} visited stars; most planets for the time: "
            f"{', '.join(pretty_name(row.name) for row in rows[:3])}.",
            caption="Stars that any strategy visits. Colour: planets found, new and known, per 100 h of telescope time "
            "in the strategy that does best there; area grows with brightness; rings mark stars with a known planet.",
        )
