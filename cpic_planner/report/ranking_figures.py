"""Figures of a ranking: its first stars, the whole sample, the sky, contrasts, and an ensemble of instruments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cpic_core import ArrayLike, NDArray, Record
from cpic_planner import results
from cpic_planner.registry import SCORES, Score
from cpic_planner.report import drawing, words
from cpic_planner.report.drawing import VERDICT_STYLE, Look, Picture, literal, with_style
from cpic_planner.results import RankedTarget, RankResult

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


N_STARS = 20
MOST_STARS = 100
"""Stars whose names can still be read in one figure, which is then 27 inches high."""
_N_BINS = 28
_LOWEST_DECADES = 4.0
_MARGIN = "margin: significance / threshold\nat a known place"
_LEGEND: Look = {"loc": "lower right", "fontsize": 8.5, "frameon": True, "edgecolor": "none", "framealpha": 0.9}


@with_style
def rank_figure(rank: RankResult, n_stars: int = N_STARS) -> Figure:
    """Draw the score, and the margin of the reference planet, of the first stars.

    Parameters
    ----------
    rank : RankResult
    n_stars : int
        How many stars have bars, at most `MOST_STARS`; the title says how many they are.
    """
    rows = rank.targets[: min(n_stars, MOST_STARS)]
    figure, (left, right) = drawing.panels(max(3.2, 1.4 + 0.26 * len(rows)), 2, grid="", width_ratios=(1.4, 1.0))
    _scores(left, rows, SCORES[rank.score_name])
    _margins(right, rows)
    title = f"First {len(rows)} of {len(rank.targets)} stars, population {rank.population.name}"
    figure.suptitle(literal(f"{title}, at most {words.duration_text(rank.time_s)}"), fontsize=11)
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
    drawing.name_rows(axes, _star_names(rows))
    axes.grid(visible=True, axis="x")
    axes.set_xlabel(f"{score.title}{unit and f' ({unit})'}")
    axes.legend(handles=[Patch(color=looks[band][0], label=band) for band in looks], **_LEGEND)


def _star_names(rows: Sequence[RankedTarget]) -> list[str]:
    return [literal(f"{row.rank}  {words.pretty_name(row.name)}") for row in rows]


def _margins(axes: Axes, rows: list[RankedTarget]) -> None:
    margins = [row.detection_margin for row in rows if row.detection_margin > 0]
    groups = drawing.by_verdict(row for row in rows if row.detection_margin > 0)
    for verdict, group in groups.items():
        colour, marker = VERDICT_STYLE[verdict]
        own = [(row.detection_margin, rows.index(row)) for row in group]
        look: Look = {"marker": marker, "ms": 6, "ls": "none", "color": colour, "label": words.verdict_text(verdict)}
        axes.plot(*zip(*own, strict=True), **look)
    if margins:
        axes.set_xscale("log")
        axes.set_xlim(min(0.5, 0.7 * min(margins)), max(2.0, 1.4 * max(margins)))
        drawing.plain_ticks(axes.xaxis, 1.0, 3.0)
        axes.legend(title="reference planet", title_fontsize=8.5, **_LEGEND)
    drawing.name_rows(axes, _star_names(rows))
    axes.tick_params(axis="y", labelleft=False)
    axes.set_xlabel(_MARGIN)
    axes.grid(visible=True)


@with_style
def margin_figure(rank: RankResult) -> Picture:
    """Draw a histogram of detection margins by status, and how many stars end in each outcome."""
    from matplotlib.ticker import MaxNLocator

    rows = [row for row in rank.targets if row.detection_margin > 0]
    figure, (left, right) = drawing.panels(3.5, 2, grid="", width_ratios=(1.55, 1.0))
    if rows:
        positive = np.array([row.detection_margin for row in rows])
        high = np.log10(positive.max() * 1.05)
        low = max(np.log10(positive.min() * 0.95), high - _LOWEST_DECADES)
        low, high = min(low, -0.05), max(high, 0.05)
        step = (high - low) / _N_BINS
        edges = 10.0 ** (step * np.arange(np.floor(low / step), np.ceil(high / step) + 1))
        groups = drawing.by_verdict(rows)
        colours = [VERDICT_STYLE[verdict][0] for verdict in groups]
        labels = [f"{words.verdict_text(verdict)} ({len(group)})" for verdict, group in groups.items()]
        margins = [[max(row.detection_margin, edges[0]) for row in group] for group in groups.values()]
        left.hist(margins, bins=edges.tolist(), stacked=True, rwidth=0.92, color=colours, label=labels)
        left.set_xscale("log")
        drawing.plain_ticks(left.xaxis, 1.0, 3.0)
    left.yaxis.set_major_locator(MaxNLocator(6, integer=True))
    left.set(xlabel=_MARGIN, ylabel="stars per bin")
    left.grid(visible=True, axis="y")
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower left", ncols=2, columnspacing=1.4)
    _outcomes(right, rank)
    without = len(rank.targets) - len(rows)
    left_out = f"; stars without a possible frame are left out ({without})" if without else ""
    search = words.SEARCHES[words.mode_of(rank)]
    return drawing.picture(figure, "margins", rows=rows, left_out=left_out, search=search)


def _outcomes(axes: Axes, rank: RankResult) -> None:
    """Draw horizontal bars, most frequent on top."""
    import textwrap

    def name(key: str) -> str:
        if key in words.LIMITED_BY:
            return words.LIMITED_BY[key][0]
        return "\n".join(textwrap.wrap(words.reason_text(key) or "detected", 24))

    verdicts = {row.limited_by or row.reason or "none": drawing.verdict_of(row) for row in rank.targets}
    verdicts["ok"] = "detected"
    items = sorted((rank.counts_limited_by or rank.counts).items(), key=lambda item: (item[1], item[0]))
    counts = [count for _, count in items]
    colours = [VERDICT_STYLE[verdicts.get(key, "unreachable")][0] for key, _ in items]
    bars = axes.barh(range(len(items)), counts, color=colours, height=0.6)
    axes.bar_label(bars, labels=[str(count) for count in counts], padding=3)
    axes.set_yticks(range(len(items)), [name(key) for key, _ in items])
    axes.set(xlim=(0, 1.3 * max(counts, default=1)), xlabel="stars")


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


def _label_stars(
    rows: Sequence[RankedTarget], confirmed: tuple[str, ...]
) -> tuple[list[RankedTarget], list[RankedTarget]]:
    """Return the simulated stars, and those that have a label: these, and the first others."""
    ringed = [row for row in rows if row.name in confirmed]
    return ringed, ringed + [row for row in rows[: drawing.MOST_LABELLED] if row.name not in confirmed]


@with_style
def sky_map(rank: RankResult, *, confirmed: tuple[str, ...] = ()) -> Picture:
    """Draw all ranked stars in equatorial coordinates (Mollweide).

    Parameters
    ----------
    rank : RankResult
    confirmed : tuple of str
        SIMBAD identifiers of targets that were simulated: ringed, and labelled first.
    """
    rows = [row for row in rank.targets if row.ra_deg is not None and row.dec_deg is not None]
    figure = drawing.new_figure(5.3)
    axes = sky_axes(figure)
    for verdict, chosen in reversed(drawing.by_verdict(rows).items()):
        label = f"{words.verdict_text(verdict)} ({len(chosen)})"
        # One call per half magnitude: markers of one size share one definition, which keeps the file small.
        for step in sorted({round(2.0 * row.v_mag) for row in chosen}, key=lambda step: abs(step - 8)):
            group = [row for row in chosen if round(2.0 * row.v_mag) == step]
            look = drawing.verdict_look(verdict, faint=0.5)
            axes.scatter(*_map_positions(group), s=float(marker_area(step / 2.0)), label=label, **look)
            label = "_nolegend_"
    ringed, chosen = _label_stars(rows, confirmed)
    if ringed:
        areas = marker_area([row.v_mag for row in ringed]) + RING_AREA
        axes.scatter(*_map_positions(ringed), s=areas, label=f"simulated as images ({len(ringed)})", **drawing.RING)
    handles, texts = axes.get_legend_handles_labels()
    for v_mag in (1, 4, 7):
        handles.append(axes.scatter([], [], s=marker_area(v_mag), c="#555555", linewidths=0))
        texts.append(f"V = {v_mag}")
    figure.legend(handles, texts, loc="outside lower center", ncols=4, handletextpad=0.4, columnspacing=1.6)
    longitude, latitude = _map_positions(chosen)
    names = [literal(words.pretty_name(row.name)) for row in chosen]
    areas = marker_area([row.v_mag for row in chosen]) + RING_AREA * np.array([row.name in confirmed for row in chosen])
    near: Look = {"avoid": axes.get_xticklabels(), "reach_px": np.sqrt(areas / np.pi) * drawing.SCREEN_DPI / 72.0}
    drawing.place_labels(axes, longitude.tolist(), latitude.tolist(), names, fontsize=9, **near)
    best = ", ".join(words.pretty_name(row.name) for row in rows[:5]) or "none"
    more = words.hidden_sentence("Stars without a listed position", len(rank.targets) - len(rows))
    return drawing.picture(figure, "sky_map", rows=rows, best=best, more=more)


_LINE_STYLES = ("-", "--", "-.", ":")


class LimitCurve(Record):
    """Contrast limit against separation; NaN where there is none.

    Attributes
    ----------
    label : str
        Target and band.
    separation_arcsec, contrast : ndarray
        Equal lengths; contrast is the planet-to-star flux ratio at the stated n sigma.
    """

    label: str
    separation_arcsec: NDArray[np.float64]
    contrast: NDArray[np.float64]


class HoleEdges(Record):
    """Separations of the inner and outer corner of a band's dark hole on the diagonal of a quadrant."""

    band: str
    inner_arcsec: float
    outer_arcsec: float


@with_style
def contrast_diagram(
    rank: RankResult,
    *,
    limits: Sequence[LimitCurve] = (),
    holes: Sequence[HoleEdges] = (),
    confirmed: tuple[str, ...] = (),
) -> Picture:
    """Draw every ranked reference planet, the contrast limits and the edges of the dark holes.

    Parameters
    ----------
    rank : RankResult
    limits : sequence of LimitCurve
        Detection limits at the level ``rank.sigma`` in ``rank.time_s``.
    holes : sequence of HoleEdges
        Drawn as vertical lines.
    confirmed : tuple of str
        SIMBAD identifiers of targets that were simulated: ringed.
    """

    def places(chosen: Sequence[RankedTarget]) -> tuple[list[float], list[float]]:
        return [row.separation_arcsec for row in chosen], [row.contrast for row in chosen]

    rows = [row for row in rank.targets if row.contrast > 0 and row.separation_arcsec > 0]
    figure = drawing.new_figure(5.8)
    axes = figure.add_subplot()
    drawing.contrast_axes(axes)
    handles: dict[str, Artist] = {}
    groups = drawing.by_verdict(rows)
    for verdict, group in reversed(groups.items()):
        size = 14 if verdict == "unreachable" else 26
        text = f"reference planet: {words.verdict_text(verdict)} ({len(group)})"
        handles[text] = axes.scatter(*places(group), s=size, **drawing.verdict_look(verdict, faint=0.45))
    ringed, chosen = _label_stars(rows, confirmed)
    if ringed:
        handles["simulated as images"] = axes.scatter(*places(ringed), s=90, **drawing.RING)
    lines = []
    for index, curve in enumerate(limits):
        look: Look = {"color": drawing.BAND_STYLE[index % len(drawing.BAND_STYLE)][0], "lw": 1.6, "zorder": 3}
        look |= {"ls": _LINE_STYLES[index % len(_LINE_STYLES)]}
        lines += axes.plot(curve.separation_arcsec, curve.contrast, **look)
    _frame(axes, rows, limits, holes)
    texts = [*handles, *(literal(f"{rank.sigma:g}σ contrast limit: {curve.label}") for curve in limits)]
    figure.legend([*handles.values(), *lines], texts, loc="outside lower center", ncols=2, columnspacing=2.0)
    _hole_lines(axes, holes)
    labels = {row.name for row in chosen}
    others = list(zip(*places([row for row in groups.get("detected", []) if row.name not in labels]), strict=True))
    reach = [9.0 if row.name in confirmed else 5.0 for row in chosen]
    names = [literal(words.pretty_name(row.name)) for row in chosen]
    drawing.place_labels(axes, *places(chosen), names, fontsize=9, reach_px=reach, others=others)
    return drawing.picture(figure, "contrast_diagram", rows=rows, limits=limits, rank=rank)


def _frame(axes: Axes, rows: Sequence[RankedTarget], limits: Sequence[LimitCurve], holes: Sequence[HoleEdges]) -> None:
    """Set the limits of the axes: the points and curves with room for labels."""
    edges = [edge for hole in holes for edge in (hole.inner_arcsec, hole.outer_arcsec)]
    separations = [row.separation_arcsec for row in rows] + edges
    contrasts = [row.contrast for row in rows]
    for curve in limits:
        good = np.isfinite(curve.contrast) & (curve.contrast > 0)
        separations += curve.separation_arcsec[good].tolist()
        # The limit climbs without bound at the edges; its bulk decides the frame.
        contrasts += np.percentile(curve.contrast[good], [0, 90]).tolist() if good.any() else []
    if separations:
        drawing.separation_ticks(axes, min(separations) / 1.06, max(separations) * 1.06)
    if contrasts:
        axes.set_ylim(min(contrasts) / 2.0, max(contrasts) * 2.5)


def _hole_lines(axes: Axes, holes: Sequence[HoleEdges]) -> None:
    """Draw lines at the hole's corners; equal edges of several bands share one line and one label."""
    groups: dict[float, list[str]] = {}
    for hole in holes:
        groups.setdefault(round(hole.inner_arcsec, 4), []).append(f"{hole.band} inner")
        groups.setdefault(round(hole.outer_arcsec, 4), []).append("outer")
    for edge, names in groups.items():
        axes.axvline(edge, color="#999999", lw=0.9, ls=":", zorder=1)
        text = "outer" if set(names) == {"outer"} else ", ".join(sorted({n for n in names if n != "outer"}))
        look: Look = {"rotation": 35, "rotation_mode": "anchor", "fontsize": 8.5, "color": "#666666"}
        axes.text(edge, 1.012, text, transform=axes.get_xaxis_transform(), ha="left", va="bottom", **look)


N_BARS, N_ENSEMBLE_STARS = 12, 25
_LOW, _HIGH, _INK = "#4477aa", "#cc6677", "#222222"


@with_style
def ensemble_figure(rank: RankResult, n_stars: int = N_ENSEMBLE_STARS) -> Figure:
    """Draw the ranks of the first stars over an ensemble, and what the number of planets hangs on.

    Parameters
    ----------
    rank : RankResult
        With an ensemble.
    n_stars : int
        How many stars are drawn, at most 100.
    """
    ensemble = rank.ensemble
    assert ensemble is not None
    rows, bars = rank.targets[: min(n_stars, MOST_STARS)], ensemble.bars[:N_BARS]
    height = max(4.2, 1.4 + 0.24 * max(len(rows), len(bars)))
    figure, (left, right) = drawing.panels(height, 2, grid="x", width_ratios=(1.0, 1.05))
    _draw_ranks(left, rows)
    _draw_bars(right, bars, ensemble.planets_nominal)
    title = f"{words.count_text(ensemble.n_instruments)} instruments that fit what is known"
    figure.suptitle(literal(f"{title}; up to {words.duration_text(rank.time_s)} per star and band"), fontsize=11)
    figure.draw_without_rendering()
    return figure


def ensemble_picture(rank: RankResult) -> Picture:
    """Return that figure for a page."""
    assert rank.ensemble is not None
    first = ", ".join(words.pretty_name(row.name) for row in rank.targets[:5])
    return drawing.picture(ensemble_figure(rank), "ensemble", first=first, bars=rank.ensemble.bars[:N_BARS])


def _draw_ranks(axes: Axes, rows: Sequence[RankedTarget]) -> None:
    for at, row in enumerate(rows):
        if row.rank_median is None or row.rank_p05 is None or row.rank_p95 is None:
            continue
        axes.plot([row.rank_p05, row.rank_p95], [at, at], color=_LOW, lw=2.2, solid_capstyle="butt")
        axes.plot([row.rank_median], [at], "o", color=_INK, ms=4.5)
        text = f" {100 * (row.p_reachable or 0.0):.0f} %"
        axes.annotate(text, (row.rank_p95, at), fontsize=7.5, va="center", color=_INK, annotation_clip=False)
    drawing.name_rows(axes, _star_names(rows))
    last = max((row.rank_p95 or 1.0 for row in rows), default=1.0)
    axes.set(xlabel="rank (and share that reaches it)", xlim=(0, 1.18 * last + 1))


def _draw_bars(axes: Axes, bars: Sequence[results.EnsembleBar], nominal: float) -> None:
    for at, bar in enumerate(bars):
        for value, text, colour in ((bar.planets_low, bar.low, _LOW), (bar.planets_high, bar.high, _HIGH)):
            axes.barh(at, value - nominal, left=nominal, height=0.6, color=colour)
            upper = value == max(bar.planets_low, bar.planets_high)
            side, spaced = ("left", f" {text}") if upper else ("right", f"{text} ")
            axes.annotate(literal(spaced), (value, at), fontsize=7.0, va="center", ha=side, color=_INK)
    axes.axvline(nominal, color=_INK, lw=1.0)
    drawing.name_rows(axes, [literal(bar.label) for bar in bars])
    ends = [value for bar in bars for value in (bar.planets_low, bar.planets_high)] or [nominal]
    room = 0.28 * max(max(ends) - min(ends), 1e-12)
    axes.set(xlabel="planets of one observation each", xlim=(min(ends) - room, max(ends) + room))
