"""The figures of the reports by key; those with one row a strategy, and limits in contrast, are drawn here."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from cpic_core import NDArray
from cpic_planner.report import drawing, whatif_maps
from cpic_planner.report.drawing import Look, Picture, literal, new_figure, place_labels, save, style
from cpic_planner.report.image_figures import snr_figure
from cpic_planner.report.numbers import duration_text, pretty_name, significant
from cpic_planner.report.panel_figure import Panels, PanelSheet
from cpic_planner.report.sky_figures import margin_figure, sky_map
from cpic_planner.report.whatif_curves import convergence_figure, curves_figure, sweep_figure
from cpic_planner.report.whatif_doubt import doubt_figure
from cpic_planner.report.whatif_maps import FEW, left_out, looks_of, row_label, shown_rows
from cpic_planner.report.words import verdict_text
from cpic_planner.results import DifferenceRecord, EstimateRecord, PlanResult, RankedTarget, RankResult, WhatIfResult

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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


_PARTS: tuple[tuple[str, str, str, str], ...] = (
    ("exposing_h", "exposing", "#0072B2", ""),
    ("occulted_h", "target out of sight", "#8C8C8C", "//"),
    ("settling_h", "slewing, settling", "#E69F00", ""),
    ("follow_up_h", "follow-up", "#009E73", "\\\\"),
    ("alarm_h", "false alarms", "#CC79A7", "xx"),
    ("unused_h", "unused budget", "#EFEFEF", ""),
)
_DIFFERENCES: tuple[Literal["planets", "new_planets"], ...] = ("planets", "new_planets")
_UNUSED_REACH = 1.35
_DETECTED: tuple[tuple[str, str, float, bool], ...] = (
    ("snr", "SNR", 1.0, True),
    ("margin", "significance / threshold", 1.0, True),
    ("contrast", "contrast (10⁻⁹)", 1e9, True),
    ("separation_arcsec", "separation (arcsec)", 1.0, False),
)


def yields_figure(result: WhatIfResult) -> Picture:
    """Draw the mean yield with its interval, and the range of single surveys, of every strategy."""
    rows = shown_rows(result.strategies)
    looks = looks_of(result.strategies)
    with style():
        figure, (left, right) = _rowed(result, rows, 2)
        for axes, quantity in ((left, "planets"), (right, "new_planets")):
            for place, i in enumerate(rows):
                estimate: EstimateRecord = getattr(result.strategies[i], quantity)
                ends = [estimate.survey_low, estimate.survey_high]
                axes.plot(ends, [place, place], color=looks[i][0], lw=1.2, marker="|", ms=6)
                _draw_mean(axes, place, estimate, looks[i])
            axes.set_xlim(left=-0.02 * axes.get_xlim()[1])
        left.set_xlabel("planets found, new and known")
        right.set_xlabel("new planets found")
        best = max(result.strategies, key=lambda item: item.planets.mean)
        return save(
            figure,
            alt=f"Planets found by {len(rows)} strategies; most by {best.name}, {significant(best.planets.mean)} a "
            "survey.",
            caption="Marker and thick line: mean over universes with its 90 % interval, how well the mean is known. "
            "Thin line: 5 to 95 % of single surveys, what chance will make of one real survey."
            + left_out(result.strategies),
        )


def differences_figure(result: WhatIfResult) -> Picture | None:
    """Draw paired differences with the first strategy; none where there is only one."""
    if len(result.strategies) < 2:
        return None
    reference = result.strategies[0].name
    places = {result.strategies[i].name: i for i in shown_rows(result.strategies) if i > 0}
    looks = looks_of(result.strategies)
    by_pair = {(item.first, item.quantity): item for item in result.differences if item.second == reference}
    rows = list(places.values())
    with style():
        figure, panels = _rowed(result, rows, 2)
        for axes, quantity in zip(panels, _DIFFERENCES, strict=True):
            for place, (name, i) in enumerate(places.items()):
                item = by_pair.get((name, quantity))
                if item is not None:
                    sure = item.low > 0.0 or item.high < 0.0
                    look = looks[i] if sure else ("#8C8C8C", looks[i][1])
                    _draw_mean(axes, place, item, look, sure=sure)
            axes.axvline(0.0, color="#111111", lw=1.1, ls="--", zorder=1)
            axes.set_xlabel(f"{quantity.replace('_', ' ')}, difference a survey")
        better = [name for name in places if (item := by_pair.get((name, "planets"))) is not None and item.low > 0]
        return save(
            figure,
            alt=f"Differences with {reference} in planets found; surely more: {', '.join(better[:FEW]) or 'none'}"
            f"{f' and {len(better) - FEW} others' if len(better) > FEW else ''}.",
            caption=f"Planets found more (right) or fewer (left) than by {reference} in the same universes, mean with "
            "its 90 % interval. Open and grey: the interval holds zero, so the difference may be chance."
            + left_out(result.strategies),
        )


def time_figure(result: WhatIfResult) -> Picture:
    """Draw where the telescope time goes."""
    rows = shown_rows(result.strategies)
    uses = [result.strategies[i].time_use for i in rows]
    used = np.array([sum(getattr(use, name) for name, *_ in _PARTS[:-1]) for use in uses])
    unused = np.array([use.unused_h for use in uses])
    end = min(float((used + unused).max()), _UNUSED_REACH * float(used.max())) or float((used + unused).max()) or 1.0
    with style():
        figure, (axes,) = _rowed(result, rows, 1)
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
        cut = bool((used + unused).max() > end)
        totals = [f"{result.strategies[i].name} {significant(hours)} h" for i, hours in zip(rows, used, strict=True)]
        return save(
            figure,
            alt=f"Stacked bars of telescope time by what it is used for; in all {', '.join(totals[:FEW])}.",
            caption="Where the telescope time goes, mean over universes. Exposing: science and reference frames with "
            "readouts. Target out of sight: behind the Earth, in the South Atlantic Anomaly, or too little of an orbit "
            "left for a frame."
            + (" Unused budget runs on beyond the axis." if cut else "")
            + left_out(result.strategies),
        )


def detections_figure(result: WhatIfResult) -> Picture | None:
    """Draw what the detected planets are like; none where nothing is detected."""
    rows = [i for i in shown_rows(result.strategies) if result.strategies[i].quantiles]
    if not rows:
        return None
    looks = looks_of(result.strategies)
    with style():
        figure, panels = _rowed(result, rows, len(_DETECTED))
        for axes, (name, title, scale, log) in zip(panels, _DETECTED, strict=True):
            for place, i in enumerate(rows):
                levels = result.strategies[i].quantiles.get(name)
                if levels is not None:
                    _draw_quantiles(axes, place, [scale * level for level in levels], looks[i][0])
            if log:
                drawing.plain_log_axis(axes)
            axes.set_xlabel(title)
        empty = len(result.strategies) - len([item for item in result.strategies if item.quantiles])
        return save(
            figure,
            alt="Ranges of SNR, margin, contrast and separation of the detections of each strategy.",
            caption="Detections of all universes. Box: the middle half, with the median; line: 5 to 95 %. Contrast is "
            "the planet-to-star ratio in the band; significance / threshold is how clearly it stands out."
            + (f" Strategies without any detection, not shown: {empty}." if empty else "")
            + left_out(result.strategies),
        )


def _draw_quantiles(axes: Axes, place: int, levels: Sequence[float], colour: str) -> None:
    lowest, low, middle, high, highest = levels
    axes.plot([lowest, highest], [place, place], color=colour, lw=1.2, solid_capstyle="butt")
    axes.barh(place, high - low, left=low, height=0.46, color=colour, alpha=0.35, edgecolor=colour, lw=1.0)
    axes.plot([middle, middle], [place - 0.23, place + 0.23], color="#111111", lw=1.6, solid_capstyle="butt")


def _draw_mean(
    axes: Axes, place: int, item: EstimateRecord | DifferenceRecord, look: tuple[str, str], *, sure: bool = True
) -> None:
    colour, marker = look
    axes.plot([item.low, item.high], [place, place], color=colour, lw=8.0, solid_capstyle="butt", alpha=0.45)
    face = colour if sure else "white"
    axes.plot([item.mean], [place], marker=marker, ms=5.5, color=colour, ls="none", mfc=face, mec=colour)


def _rowed(result: WhatIfResult, rows: Sequence[int], columns: int) -> tuple[Figure, list[Axes]]:
    """Return the panels that share their rows, first strategy at the top."""
    each = 0.42 if len(rows) <= 12 else 0.24
    figure = new_figure(1.5 + each * max(len(rows), 2))
    panels = list(figure.subplots(1, columns, sharey=True, squeeze=False)[0])
    for axes in panels:
        axes.grid(visible=True, axis="x")
        axes.tick_params(axis="y", length=0)
    small = len(rows) > 12
    labels = [row_label(result.strategies[i].name) for i in rows]
    panels[0].set_yticks(range(len(rows)), labels, fontsize=8 if small else 9.5)
    panels[0].set_ylim(len(rows) - 0.4, -0.6)
    return figure, panels


PLAN_FIGURES = {
    "sky": "Ranked stars on the sky",
    "contrast": "Reference planets and contrast limits",
    "calibration": "Does the prediction hold?",
    "margin": "The sample at a glance",
}
"""Title of each figure of a plan, in their order."""


def plan_figures(
    plan: PlanResult, rank: RankResult, *, limits: Sequence[LimitCurve] = (), holes: Sequence[HoleEdges] = ()
) -> dict[str, Picture]:
    """Draw the figures of a plan, by the keys of `PLAN_FIGURES`.

    Parameters
    ----------
    plan : PlanResult
    rank : RankResult
    limits : sequence of LimitCurve
        Contrast limits to draw; labels name target and band.
    holes : sequence of HoleEdges
        Corners of each band's dark hole on the diagonal.
    """
    confirmed = tuple(target.name for target in plan.targets)
    return {
        "sky": sky_map(rank, confirmed=confirmed),
        "contrast": contrast_diagram(rank, limits=limits, holes=holes, confirmed=confirmed),
        "calibration": snr_figure(plan),
        "margin": margin_figure(rank),
    }


def panel_pictures(plan: PlanResult, panels: Mapping[str, Panels]) -> dict[str, Picture]:
    """Draw the images of every confirmed band that has them; keys are those of ``BandConfirmation.image``."""
    sheet = PanelSheet()
    return {
        band.image: sheet.picture(panels[band.image], target.name)
        for target in plan.targets
        for band in target.bands
        if band.image is not None and band.image in panels
    }


WHATIF_FIGURES: dict[str, tuple[str, Callable[[WhatIfResult], Picture | None]]] = {
    "sweep": ("What the varied setting does", sweep_figure),
    "yields": ("What each strategy yields", yields_figure),
    "differences": ("Is the difference real?", differences_figure),
    "doubt": ("What each plan loses", doubt_figure),
    "curves": ("Yield against telescope time", curves_figure),
    "time": ("Where the time goes", time_figure),
    "calendar": ("Who is visited when", whatif_maps.calendar_figure),
    "sky": ("Where the stars are", whatif_maps.stars_figure),
    "detections": ("What is detected", detections_figure),
    "convergence": ("Are there enough universes?", convergence_figure),
}
"""Title of each figure, and what draws it where the result has something for it."""


def whatif_figures(result: WhatIfResult) -> dict[str, Picture]:
    """Draw the figures that the result has something for, by the keys of `WHATIF_FIGURES`."""
    drawn = {key: draw(result) for key, (_, draw) in WHATIF_FIGURES.items()}
    return {key: picture for key, picture in drawn.items() if picture is not None}
