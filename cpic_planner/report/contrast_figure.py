"""Reference planets and detection limits in the plane of separation and contrast."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cpic_core import NDArray
from cpic_planner.report import drawing
from cpic_planner.report.drawing import Look, Picture, literal, new_figure, place_labels, save, style
from cpic_planner.report.numbers import duration_text, pretty_name
from cpic_planner.report.words import verdict_text
from cpic_planner.results import RankedTarget, RankResult

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

_LINE_STYLES = ("-", "--", "-.", ":")
_TICKS_ARCSEC = (0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0, 1.5, 2.0)


@dataclass(frozen=True)
class LimitCurve:
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


@dataclass(frozen=True)
class HoleEdges:
    """Separations of the inner and outer corner of a band's dark hole on the diagonal of a quadrant."""

    band: str
    inner_arcsec: float
    outer_arcsec: float


def contrast_axes(axes: Axes) -> None:
    """Make a plane of separation and contrast, both logarithmic."""
    axes.set(xscale="log", yscale="log")
    axes.grid(visible=True)
    axes.set_xlabel("projected separation (arcsec)")
    axes.set_ylabel("planet-to-star contrast (flux ratio)")


def separation_ticks(axes: Axes, low: float, high: float) -> None:
    """Set the limits of the axis of separations, arcsec, and write plain numbers at it."""
    axes.set_xlim(low, high)
    ticks = [tick for tick in _TICKS_ARCSEC if low <= tick <= high]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_xticks([], minor=True)


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
    rows = [row for row in rank.targets if row.contrast > 0 and row.separation_arcsec > 0]
    with style():
        figure = new_figure(5.8)
        axes = figure.add_subplot()
        contrast_axes(axes)
        handles: list[Artist] = []
        texts: list[str] = []
        groups = drawing.by_verdict(rows)
        for verdict, chosen in reversed(groups.items()):
            x, y = [row.separation_arcsec for row in chosen], [row.contrast for row in chosen]
            size = 14 if verdict == "unreachable" else 26
            handles.append(axes.scatter(x, y, s=size, **drawing.verdict_look(verdict, faint=0.45)))
            texts.append(f"reference planet: {verdict_text(verdict)} ({len(chosen)})")
        ringed = [row for row in rows if row.name in confirmed]
        if ringed:
            x, y = [row.separation_arcsec for row in ringed], [row.contrast for row in ringed]
            handles.append(axes.scatter(x, y, s=90, **drawing.RING))
            texts.append("simulated as images")
        for index, curve in enumerate(limits):
            look: Look = {"color": drawing.BAND_STYLE[index % len(drawing.BAND_STYLE)][0], "lw": 1.6, "zorder": 3}
            dashes = _LINE_STYLES[index % len(_LINE_STYLES)]
            line = axes.plot(curve.separation_arcsec, curve.contrast, ls=dashes, **look)
            handles.append(line[0])
            texts.append(literal(f"{rank.sigma:g}σ contrast limit: {curve.label}"))
        _frame(axes, rows, limits, holes)
        figure.legend(handles, texts, loc="outside lower center", ncols=2, columnspacing=2.0)
        _hole_lines(axes, holes)
        chosen = ringed + [row for row in rows[: drawing.MOST_LABELLED] if row.name not in confirmed]
        x, y = [row.separation_arcsec for row in chosen], [row.contrast for row in chosen]
        reach = [9.0 if row.name in confirmed else 5.0 for row in chosen]
        names = [literal(pretty_name(row.name)) for row in chosen]
        labels = {row.name for row in chosen}
        detected = [row for row in groups.get("detected", []) if row.name not in labels]
        seen = [(row.separation_arcsec, row.contrast) for row in detected]
        place_labels(axes, x, y, names, fontsize=9, reach_px=reach, others=seen)
        return save(
            figure,
            alt=f"Diagram of contrast against separation: {len(rows)} reference planets and {len(limits)} "
            f"contrast-limit curves.",
            caption="Contrast of each star's reference planet in its best band (symbols), and the contrast limit "
            "of single targets (lines): the planet-to-star flux ratio whose significance reaches the "
            f"small-sample threshold equivalent to {rank.sigma:g}σ in the wall time planned for that star (at most "
            f"{duration_text(rank.time_s)}). A limit belongs to its own star: other stars' planets are not judged by "
            "it. Vertical lines: corners of the dark hole on the diagonal of a quadrant.",
        )


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
        separation_ticks(axes, min(separations) / 1.06, max(separations) * 1.06)
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
