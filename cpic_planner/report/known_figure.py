"""Separation of known planets against time, with the dark holes of the bands."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cpic_planner.models import KnownPlanetRow, KnownResult
from cpic_planner.report.drawing import BAND_STYLE, literal, new_figure, style
from cpic_planner.report.names import pretty_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_UNIX_MJD = 40587.0
_LINES = ("-", "--", ":", "-.")


def known_figure(result: KnownResult) -> Figure:
    """Draw the tracks of the planets of one star.

    Parameters
    ----------
    result : KnownResult
        With tracks.
    """
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    rows = [row for row in result.planets if row.track is not None]
    with style():
        ticks = AutoDateLocator()
        figure = new_figure(4.6)
        axes = figure.subplots()
        _holes(axes, result)
        for number, row in enumerate(rows):
            _track(axes, row, number)
        axes.axvline(_days([result.mjd])[0], color="#444444", lw=0.9, ls=":")
        top = max([max(row.track.separation_high_arcsec) for row in rows if row.track is not None], default=1.0)
        highest = max(1.12 * top, 1.25 * max(hole.inner_arcsec for hole in result.holes))
        axes.set(ylim=(0.0, highest), ylabel="projected separation (arcsec)", xlim=_ends(rows))
        axes.xaxis.set_major_locator(ticks)
        axes.xaxis.set_major_formatter(ConciseDateFormatter(ticks))
        axes.grid(visible=True)
        axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=9)
        stars = ", ".join(dict.fromkeys(pretty_name(row.star) for row in rows))
        figure.suptitle(literal(f"known planets of {stars}: median and 68 % of {result.n_draws} draws"), fontsize=11)
        figure.draw_without_rendering()
    return figure


def _holes(axes: Axes, result: KnownResult) -> None:
    """Shade where the bands' dark holes lie; bands of one geometry share a shade."""
    edges: dict[tuple[float, float], list[str]] = {}
    for hole in result.holes:
        edges.setdefault((hole.inner_arcsec, hole.outer_arcsec), []).append(hole.band)
    for number, ((inner, outer), bands) in enumerate(edges.items()):
        axes.axhspan(inner, outer, color="#8C8C8C", alpha=0.10, lw=0)
        for edge in (inner, outer):
            axes.axhline(edge, color="#8C8C8C", lw=0.7, ls=_LINES[number % len(_LINES)])
        axes.axhline(
            inner,
            color="#8C8C8C",
            lw=0.7,
            ls=_LINES[number % len(_LINES)],
            label=f"dark hole {', '.join(bands)}: {inner:.2f} to {outer:.2f}″",
        )


def _track(axes: Axes, row: KnownPlanetRow, number: int) -> None:
    track = row.track
    assert track is not None
    colour = BAND_STYLE[number % len(BAND_STYLE)][0]
    days = _days(track.mjd)
    axes.fill_between(days, track.separation_low_arcsec, track.separation_high_arcsec, color=colour, alpha=0.25, lw=0)
    unknown = ", phase unknown" if "phase_unknown" in row.flags else ""
    doubted = "" if row.status == "confirmed" else f", {row.status}"
    label = literal(f"{row.planet.rpartition(' ')[2]}{doubted}{unknown}")
    axes.plot(days, track.separation_median_arcsec, color=colour, lw=1.6, label=label)


def _ends(rows: list[KnownPlanetRow]) -> tuple[float, float]:
    dates = [day for row in rows if row.track is not None for day in (row.track.mjd[0], row.track.mjd[-1])]
    low, high = _days([min(dates), max(dates)])
    return float(low), float(high)


def _days(mjd: list[float]) -> np.ndarray:
    """Days since 1970, as the date axis counts."""
    return np.asarray(mjd, float) - _UNIX_MJD
