"""Figures of a ranking: its first stars as bars, the fate of the whole sample, and the stars on the sky.

Where the ranked stars are on the sky.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cpic_core import ArrayLike, NDArray
from cpic_planner.registry import SCORES, Score
from cpic_planner.report import drawing
from cpic_planner.report.drawing import VERDICT_STYLE, Look, Picture, literal, new_figure, place_labels, save, style
from cpic_planner.report.numbers import duration_text, pretty_name
from cpic_planner.report.summary import mode_of
from cpic_planner.report.words import LIMITED_BY, SEARCHES, reason_text, verdict_text
from cpic_planner.results import RankedTarget, RankResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


N_STARS = 20
MOST_STARS = 100
"""Stars whose names can still be read in one figure, which is then 27 inches high."""
_N_BINS = 28
_LOWEST_DECADES = 4.0
_MARGIN = "margin: significance / threshold\nat a known place"
_LEGEND: Look = {"loc": "lower right", "fontsize": 8.5, "frameon": True, "edgecolor": "none", "framealpha": 0.9}


def rank_figure(rank: RankResult, n_stars: int = N_STARS) -> Figure:
    """Draw the score, and the margin of the reference planet, of the first stars.

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
        _scores(left, rows, SCORES[rank.score_name])
        _margins(right, rows)
        title = f"First {len(rows)} of {len(rank.targets)} stars, population {rank.population.name}"
        figure.suptitle(literal(f"{title}, at most {duration_text(rank.time_s)}"), fontsize=11)
        figure.draw_without_rendering()
    return figure


def _scores(axes: Axes, rows: list[RankedTarget], score: Score) -> None:
    """Draw what orders the stars, in the colour of the band that it is for; an error where completeness has one."""
    from matplotlib.patches import Patch

    of_completeness = score.name.startswith("completeness")
    bands = [row.completeness_band if of_completeness else row.band for row in rows]
    looks = drawing.band_style(sorted(set(bands)))
    factor, unit = score.written
    values = [max(factor * row.score, 0.0) for row in rows]
    shares = [row.completeness_error / row.completeness if row.completeness else 0.0 for row in rows]
    errors = [value * share for value, share in zip(values, shares, strict=True)] if of_completeness else None
    look: Look = {"height": 0.7, "error_kw": {"lw": 0.9, "capsize": 1.5}, "label": f"_{score.title}"}
    axes.barh(range(len(rows)), values, xerr=errors, color=[looks[band][0] for band in bands], **look)
    _name_stars(axes, rows)
    axes.grid(visible=True, axis="x")
    axes.set_xlabel(f"{score.title}{unit and f' ({unit})'}")
    axes.legend(handles=[Patch(color=looks[band][0], label=band) for band in looks], **_LEGEND)


def _name_stars(axes: Axes, rows: list[RankedTarget]) -> None:
    """Name the rows of a panel, first star on top."""
    axes.set_yticks(range(len(rows)), [literal(f"{row.rank}  {pretty_name(row.name)}") for row in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)


def _margins(axes: Axes, rows: list[RankedTarget]) -> None:
    margins = [row.detection_margin for row in rows if row.detection_margin > 0]
    groups = drawing.by_verdict(row for row in rows if row.detection_margin > 0)
    for verdict, group in groups.items():
        colour, marker = VERDICT_STYLE[verdict]
        own = [(row.detection_margin, rows.index(row)) for row in group]
        axes.plot(*zip(*own, strict=True), marker=marker, ms=6, ls="none", color=colour, label=verdict_text(verdict))
    if margins:
        axes.set_xscale("log")
        axes.set_xlim(min(0.5, 0.7 * min(margins)), max(2.0, 1.4 * max(margins)))
        drawing.plain_ticks(axes.xaxis, 1.0, 3.0)
        axes.legend(title="reference planet", title_fontsize=8.5, **_LEGEND)
    _name_stars(axes, rows)
    axes.tick_params(axis="y", labelleft=False)
    axes.set_xlabel(_MARGIN)
    axes.grid(visible=True)


def margin_figure(rank: RankResult) -> Picture:
    """Draw a histogram of detection margins by status, and how many stars end in each outcome."""
    from matplotlib.ticker import MaxNLocator

    rows = rank.targets
    with style():
        figure = new_figure(3.5)
        left, right = figure.subplots(1, 2, width_ratios=(1.55, 1.0))
        positive = np.array([row.detection_margin for row in rows if row.detection_margin > 0])
        if positive.size:
            high = np.log10(positive.max() * 1.05)
            low = max(np.log10(positive.min() * 0.95), high - _LOWEST_DECADES)
            low, high = min(low, -0.05), max(high, 0.05)
            step = (high - low) / _N_BINS
            edges = 10.0 ** (step * np.arange(np.floor(low / step), np.ceil(high / step) + 1))
            groups = drawing.by_verdict(row for row in rows if row.detection_margin > 0)
            colours = [VERDICT_STYLE[verdict][0] for verdict in groups]
            labels = [f"{verdict_text(verdict)} ({len(group)})" for verdict, group in groups.items()]
            margins = [[max(row.detection_margin, edges[0]) for row in group] for group in groups.values()]
            left.hist(margins, bins=edges.tolist(), stacked=True, rwidth=0.92, color=colours, label=labels)
            left.set_xscale("log")
            drawing.plain_ticks(left.xaxis, 1.0, 3.0)
        left.yaxis.set_major_locator(MaxNLocator(6, integer=True))
        left.set(xlabel=_MARGIN, ylabel="stars per bin")
        left.grid(visible=True, axis="y")
        figure.legend(*left.get_legend_handles_labels(), loc="outside lower left", ncols=2, columnspacing=1.4)
        _outcomes(right, rank)
        without = len(rows) - positive.size
        left_out = f"; stars without a possible frame are left out ({without})" if without else ""
        return save(
            figure,
            alt=f"Histogram of the margins of {positive.size} stars, and bars that count stars by outcome.",
            caption="Left: predicted margin of the reference planet around every ranked star, in the star's best band "
            f"and separation{left_out}. The margin is the significance over the threshold at a known place; colours "
            f"show the verdict, which goes by the probability {SEARCHES[mode_of(rank)]}, so that a planet of margin "
            "below 1 can be detected. Right: stars by outcome.",
        )


def _outcomes(axes: Axes, rank: RankResult) -> None:
    """Draw horizontal bars, most frequent on top."""
    verdicts = {row.limited_by or row.reason or "none": drawing.verdict_of(row) for row in rank.targets}
    verdicts["ok"] = "detected"
    items = sorted((rank.counts_limited_by or rank.counts).items(), key=lambda item: (item[1], item[0]))
    names = [LIMITED_BY[key][0] if key in LIMITED_BY else _wrapped(reason_text(key) or "detected") for key, _ in items]
    counts = [count for _, count in items]
    colours = [VERDICT_STYLE[verdicts.get(key, "unreachable")][0] for key, _ in items]
    bars = axes.barh(range(len(items)), counts, color=colours, height=0.6)
    axes.bar_label(bars, labels=[str(count) for count in counts], padding=3)
    axes.set_yticks(range(len(items)), names)
    axes.set_xlim(0, 1.3 * max(counts, default=1))
    axes.set_xlabel("stars")


def _wrapped(text: str) -> str:
    import textwrap

    return "\n".join(textwrap.wrap(text, 24))


RING_AREA = 70.0
OBLIQUITY_DEG = 23.4392911
"""Mean obliquity of the ecliptic at J2000.0 (IAU 1976), drawn line only."""


def map_longitude(ra_deg: ArrayLike) -> NDArray[np.float64]:
    """Return the map longitude (rad) of right ascensions: 12 h at the left and right edge, increasing to the left."""
    return -np.deg2rad((np.asarray(ra_deg, float) + 180.0) % 360.0 - 180.0)


def marker_area(v_mag: ArrayLike) -> NDArray[np.float64]:
    """Return the marker area (square points): brighter stars are larger."""
    return np.clip(8.0 * 10.0 ** (0.15 * (7.0 - np.asarray(v_mag, float))), 7.0, 110.0)


def _map_positions(rows: Sequence[RankedTarget]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Map longitudes and latitudes (rad) of stars that have a position."""
    latitude = np.deg2rad(np.array([row.dec_deg for row in rows], np.float64))
    return map_longitude(np.array([row.ra_deg for row in rows], np.float64)), latitude


def _radius_px(v_mag: float, ringed: bool) -> float:
    """Return the radius of a star's marker on the screen."""
    area = float(marker_area(v_mag)) + (RING_AREA if ringed else 0.0)
    return float(np.sqrt(area / np.pi)) * drawing.SCREEN_DPI / 72.0


def sky_axes(figure: Figure) -> Axes:
    """Add an empty map of the whole sky in equatorial coordinates (Mollweide), with the ecliptic."""
    from matplotlib.patheffects import withStroke

    axes = figure.add_subplot(projection="mollweide")
    axes.grid(visible=True)
    axes.set_xticks(map_longitude(np.array([150.0, 120, 90, 60, 30, 0, 330, 300, 270, 240, 210])))
    hours = [f"{hour} h" for hour in (10, 8, 6, 4, 2, 0, 22, 20, 18, 16, 14)]
    axes.set_xticklabels(hours, color="#666666", fontsize=8.5)
    for hour_label in axes.get_xticklabels():
        hour_label.set_path_effects([withStroke(linewidth=2.0, foreground="white")])
        hour_label.set_zorder(6)
    axes.set_yticks(np.deg2rad([-60, -30, 0, 30, 60]))
    axes.set_yticklabels(["−60°", "−30°", "0°", "+30°", "+60°"])
    axes.set_xlabel("right ascension (ICRS, increasing to the left)")
    axes.set_ylabel("declination (ICRS)")
    ra = np.linspace(-180.0, 180.0, 361)
    ecliptic = np.arctan(np.tan(np.deg2rad(OBLIQUITY_DEG)) * np.sin(np.deg2rad(ra)))
    axes.plot(-np.deg2rad(ra), ecliptic, color="#B58900", lw=1.1, ls="--", zorder=1, label="ecliptic")
    return axes


def sky_map(rank: RankResult, *, confirmed: tuple[str, ...] = ()) -> Picture:
    """Draw all ranked stars in equatorial coordinates (Mollweide).

    Parameters
    ----------
    rank : RankResult
    confirmed : tuple of str
        SIMBAD identifiers of targets that were simulated: ringed, and labelled first.
    """
    rows = [row for row in rank.targets if row.ra_deg is not None and row.dec_deg is not None]
    hidden = len(rank.targets) - len(rows)
    with style():
        figure = new_figure(5.3)
        axes = sky_axes(figure)
        for verdict, chosen in reversed(drawing.by_verdict(rows).items()):
            label = f"{verdict_text(verdict)} ({len(chosen)})"
            # One call per half magnitude: markers of one size share one definition, which keeps the file small.
            for step in sorted({round(2.0 * row.v_mag) for row in chosen}, key=lambda step: abs(step - 8)):
                group = [row for row in chosen if round(2.0 * row.v_mag) == step]
                look = drawing.verdict_look(verdict, faint=0.5)
                axes.scatter(*_map_positions(group), s=float(marker_area(step / 2.0)), label=label, **look)
                label = "_nolegend_"
        ringed = [row for row in rows if row.name in confirmed]
        if ringed:
            areas = marker_area([row.v_mag for row in ringed]) + RING_AREA
            axes.scatter(*_map_positions(ringed), s=areas, label=f"simulated as images ({len(ringed)})", **drawing.RING)
        handles, texts = axes.get_legend_handles_labels()
        for v_mag in (1, 4, 7):
            handles.append(axes.scatter([], [], s=marker_area(v_mag), c="#555555", linewidths=0))
            texts.append(f"V = {v_mag}")
        figure.legend(handles, texts, loc="outside lower center", ncols=4, handletextpad=0.4, columnspacing=1.6)
        chosen = ringed + [row for row in rows[: drawing.MOST_LABELLED] if row.name not in confirmed]
        longitude, latitude = _map_positions(chosen)
        names = [literal(pretty_name(row.name)) for row in chosen]
        reach = [_radius_px(row.v_mag, row.name in confirmed) for row in chosen]
        hours, px, py = axes.get_xticklabels(), longitude.tolist(), latitude.tolist()
        place_labels(axes, px, py, names, fontsize=9, avoid=hours, reach_px=reach)
        best = ", ".join(pretty_name(row.name) for row in rows[:5]) or "none"
        return save(
            figure,
            alt=f"Map of the whole sky with {len(rows)} ranked stars, coloured by verdict; highest ranked: {best}.",
            caption="Ranked stars on the sky. Marker area grows with brightness (V); colour and shape give the verdict "
            "of the reference planet; rings mark targets whose images were simulated."
            + (f" Stars without a listed position, not shown: {hidden}." if hidden else ""),
        )
