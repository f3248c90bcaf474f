"""Figures against the date: separations of known planets, and when stars can be seen.

When stars can be seen: the year of one star, or a calendar of several.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cpic_core import FloatArray, NDArray, listed
from cpic_planner.report.drawing import BAND_STYLE, Look, date_axis, literal, new_figure, style
from cpic_planner.report.numbers import full_name, pretty_name
from cpic_planner.report.words import BLOCK_WORDS
from cpic_planner.results import KnownPlanetRow, KnownResult, VisibilityResult, VisibleDays, VisibleTarget

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch


_UNIX_MJD = 40587.0
_LINES = ("-", "--", ":", "-.")


def known_figure(result: KnownResult) -> Figure:
    """Draw the tracks of the planets of one star.

    Parameters
    ----------
    result : KnownResult
        With tracks.
    """
    rows = [row for row in result.planets if row.track is not None]
    with style():
        figure = new_figure(4.6)
        axes = figure.subplots()
        _holes(axes, result)
        for number, row in enumerate(rows):
            _track(axes, row, number)
        axes.axvline(_days([result.mjd])[0], color="#444444", lw=0.9, ls=":")
        tops = [max(row.track.separation_high_arcsec) for row in rows if row.track is not None]
        highest = 1.08 * max(*tops, *(hole.outer_arcsec for hole in result.holes))
        axes.set(ylim=(0.0, highest), ylabel="projected separation (arcsec)", xlim=_ends(rows))
        date_axis(axes, minticks=5, maxticks=None)
        axes.grid(visible=True)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=3, fontsize=9, columnspacing=1.6)
        stars = ", ".join(dict.fromkeys(pretty_name(row.star) for row in rows))
        title = f"Known planets of {stars}: median, and 68 % of the draws"
        if result.columns_not_used:
            title += f"\ncolumns of the table that were not used: {listed(result.columns_not_used)}"
        figure.suptitle(literal(title), fontsize=11)
        figure.draw_without_rendering()
    return figure


def _holes(axes: Axes, result: KnownResult) -> None:
    """Draw the edges of the bands' dark holes, and shade what lies in any of them; equal edges share a line."""
    edges: dict[tuple[float, float], list[str]] = {}
    for hole in result.holes:
        edges.setdefault((hole.inner_arcsec, hole.outer_arcsec), []).append(hole.band)
    axes.axhspan(min(inner for inner, _ in edges), max(outer for _, outer in edges), color="#F2F2F2", lw=0, zorder=0)
    for number, ((inner, outer), bands) in enumerate(edges.items()):
        look: Look = {"color": "#666666", "lw": 0.8, "ls": _LINES[number % len(_LINES)], "zorder": 1}
        axes.axhline(outer, **look)
        axes.axhline(inner, label=f"dark hole {', '.join(bands)}: {inner:.2f} to {outer:.2f}″", **look)


def _track(axes: Axes, row: KnownPlanetRow, number: int) -> None:
    track = row.track
    assert track is not None
    colour = BAND_STYLE[number % len(BAND_STYLE)][0]
    days = _days(track.mjd)
    # Where the phase is unknown there is no track: lines say in which range the planet stands at any date.
    known = "phase_unknown" not in row.flags
    if known:
        low, high = track.separation_low_arcsec, track.separation_high_arcsec
        axes.fill_between(days, low, high, color=colour, alpha=0.25, lw=0)
    unknown = "".join(f", {name} unknown" for name in ("phase", "omega") if f"{name}_unknown" in row.flags)
    doubted = "" if row.status == "confirmed" else f", {row.status}"
    label = literal(f"{row.planet.rpartition(' ')[2]}{doubted}{unknown}")
    axes.plot(days, track.separation_median_arcsec, color=colour, lw=1.6 if known else 1.1, label=label)
    for end, edge in (("16", track.separation_low_arcsec), ("84", track.separation_high_arcsec)):
        look: Look = {"alpha": 0.4, "lw": 0.5} if known else {"ls": (0, (2, 2)), "lw": 0.9}
        axes.plot(days, edge, color=colour, label=f"_{label}, {end} % are below", **look)


def _ends(rows: list[KnownPlanetRow]) -> tuple[float, float]:
    dates = [day for row in rows if row.track is not None for day in (row.track.mjd[0], row.track.mjd[-1])]
    low, high = _days([min(dates), max(dates)])
    return float(low), float(high)


def _days(mjd: list[float]) -> np.ndarray:
    """Return the days since 1970, as the date axis counts."""
    return np.asarray(mjd, float) - _UNIX_MJD


# Light tints of Okabe-Ito colours and hatches: told apart with any colour vision, and in grey by the hatch.
_BLOCK_STYLE: dict[str, tuple[str, str]] = {
    "sun": ("#F6C48E", "////"),
    "moon": ("#C9C9C9", "...."),
    "panel": ("#E3BCD2", "\\\\\\\\"),
    "limb": ("#7A7A7A", "xxxx"),
}
_VISIBLE, _WINDOW, _SUN, _MOON = "#0072B2", "#111111", "#D55E00", "#666666"
_MINUTES = "Blues"
_BELOW: Look = {"loc": "upper center", "fontsize": 9}


def visibility_figure(result: VisibilityResult) -> Figure:
    """Draw minutes per orbit and angles of one star against the date, or minutes of several stars as a calendar."""
    with style():
        figure = _year(result) if len(result.targets) == 1 else _calendar(result)
        figure.draw_without_rendering()
    return figure


def _edges(result: VisibilityResult) -> FloatArray:
    """Return the begin of every step and the end of the last, dates of matplotlib."""
    middle = _days(result.mjd)
    return np.concatenate([middle, middle[-1:] + result.step_days]) - 0.5 * result.step_days


def _year(result: VisibilityResult) -> Figure:
    target = result.targets[0]
    edges = _edges(result)
    figure = new_figure(6.6)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(1.25, 1.0))
    blocks = _shade((top, bottom), edges, target.days)
    _times(top, edges, target, result.period_s, blocks)
    _angles(bottom, edges, result)
    bottom.set_xlim(edges[0], edges[-1])
    date_axis(bottom)
    name = full_name(target.name, target.hip)
    where = f"ecliptic latitude {target.ecliptic_latitude_deg:.1f}°".replace("-", "−")
    title = f"{name}, {where}: seen on {target.observable_days:g} of {result.n_days} days from "
    figure.suptitle(literal(title + result.start_utc[:10]), fontsize=11)
    return figure


def _shade(axes: tuple[Axes, Axes], edges: FloatArray, days: VisibleDays) -> list[Patch]:
    """Shade what blocks; one handle a cause."""
    from matplotlib.patches import Patch

    handles: list[Patch] = []
    causes = np.array(days.blocked_by)
    for cause, (colour, hatch) in _BLOCK_STYLE.items():
        runs = _runs(causes == cause)
        look: Look = {"facecolor": colour, "edgecolor": "white", "hatch": hatch, "lw": 0.0}
        for begin, end in runs:
            for one in axes:
                one.axvspan(edges[begin], edges[end], zorder=0.5, **look)
        if runs:
            handles.append(Patch(label=BLOCK_WORDS[cause], **look))
    return handles


def _runs(chosen: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first step and first step behind of every run."""
    change = np.flatnonzero(np.diff(np.concatenate([[0], chosen.astype(int), [0]])))
    return [(int(begin), int(end)) for begin, end in zip(change[::2], change[1::2], strict=True)]


def _steps(axes: Axes, edges: FloatArray, values: list[float], visible: NDArray[np.bool_], **look: Any) -> Any:
    """Return a line of steps where something is seen."""
    shown = np.where(visible, values, np.nan)
    return axes.stairs(shown / 60.0, edges, baseline=None, **look)


def _times(axes: Axes, edges: FloatArray, target: VisibleTarget, period_s: float, blocks: list[Patch]) -> None:
    visible = np.array(target.days.blocked_by) == ""
    minutes = np.where(visible, target.days.visible_s, 0.0) / 60.0
    axes.stairs(minutes, edges, fill=True, color=_VISIBLE, alpha=0.55, lw=0.0)
    line = _steps(axes, edges, target.days.visible_s, visible, color=_VISIBLE, lw=1.4, label="usable, less the anomaly")
    look: Look = {"color": _WINDOW, "lw": 1.1, "ls": (0, (3, 1.5)), "label": "longest window"}
    window = _steps(axes, edges, target.days.window_s, visible, **look)
    whole = axes.axhline(period_s / 60.0, color="#8C8C8C", lw=1.0, ls=":", label="one orbit")
    axes.set(ylim=(0.0, 1.06 * period_s / 60.0), ylabel="minutes per orbit")
    axes.grid(visible=True, axis="y")
    axes.legend(handles=[line, window, whole, *blocks], ncols=3, bbox_to_anchor=(0.5, -0.02), **_BELOW)


def _angles(axes: Axes, edges: FloatArray, result: VisibilityResult) -> None:
    days, limits = result.targets[0].days, result.pointing
    middle = 0.5 * (edges[1:] + edges[:-1])
    (sun,) = axes.plot(middle, days.sun_deg, color=_SUN, lw=1.8, label="from the Sun")
    (moon,) = axes.plot(middle, days.moon_deg, color=_MOON, lw=1.0, label="from the Moon")
    turn = limits.panel_turn_deg if limits.panel == "one_axis" else 0.0
    reach = turn + limits.panel_deg
    lines = [("Sun limit", limits.sun_deg, _SUN, "--"), ("Moon limit", limits.moon_deg, _MOON, "--")]
    if 90.0 - reach > limits.sun_deg:
        lines.append(("panels from", 90.0 - reach, _SUN, ":"))
    if reach < 90.0:
        lines.append(("panels to", 90.0 + reach, _SUN, ":"))
    handles = [
        axes.axhline(value, color=colour, lw=1.1, ls=dashes, label=f"{label} {value:g}°")
        for label, value, colour, dashes in lines
    ]
    axes.set(ylim=(0.0, 180.0), ylabel="angle (deg)", yticks=range(0, 181, 30))
    axes.grid(visible=True, axis="y")
    axes.legend(handles=[sun, moon, *handles], ncols=6, columnspacing=1.2, bbox_to_anchor=(0.5, -0.19), **_BELOW)


def _calendar(result: VisibilityResult) -> Figure:
    import matplotlib as mpl
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.patches import Patch

    n = len(result.targets)
    edges = _edges(result)
    minutes = np.array([target.days.visible_s for target in result.targets]) / 60.0
    causes = np.array([target.days.blocked_by for target in result.targets])
    visible = minutes[causes == ""]
    low = 5.0 * np.floor(visible.min() / 5.0) if visible.size else 0.0
    high = max(5.0 * np.ceil(visible.max() / 5.0), low + 5.0) if visible.size else 1.0
    # The lightest blues are left out: they would look like nothing.
    colours = mpl.colors.ListedColormap(mpl.colormaps[_MINUTES](np.linspace(0.25, 1.0, 256)))
    scale = Normalize(low, high)
    figure = new_figure(min(12.0, 2.1 + 0.3 * n))
    axes = figure.subplots()
    extent = (edges[0], edges[-1], n - 0.5, -0.5)
    axes.imshow(colours(scale(minutes)), aspect="auto", interpolation="nearest", extent=extent)
    used: list[Patch] = []
    for cause, (colour, hatch) in _BLOCK_STYLE.items():
        look: Look = {"facecolor": colour, "edgecolor": "white", "hatch": hatch, "lw": 0.0}
        for row in range(n):
            bars = [(edges[begin], edges[end] - edges[begin]) for begin, end in _runs(causes[row] == cause)]
            axes.broken_barh(bars, (row - 0.5, 1.0), **look)
        if (causes == cause).any():
            used.append(Patch(**look, label=BLOCK_WORDS[cause]))
    axes.set_yticks(range(n), [literal(pretty_name(target.name)) for target in result.targets])
    for row in range(1, n):
        axes.axhline(row - 0.5, color="white", lw=1.6)
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(n - 0.5, -0.5)
    axes.set_xlim(edges[0], edges[-1])
    date_axis(axes)
    figure.colorbar(ScalarMappable(scale, colours), ax=axes, label="minutes per orbit", pad=0.015, aspect=max(8, 3 * n))
    if used:
        figure.legend(handles=used, loc="outside lower center", ncols=len(used), fontsize=9)
    figure.suptitle(f"{n} stars, {result.n_days} days from {result.start_utc[:10]}", fontsize=11)
    return figure
