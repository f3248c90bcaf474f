"""The figures of the reports by key; those with one row a strategy are drawn here."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from cpic_planner.report import drawing, whatif_maps
from cpic_planner.report.contrast_figure import HoleEdges, LimitCurve, contrast_diagram
from cpic_planner.report.drawing import Look, Picture, new_figure, save, style
from cpic_planner.report.image_figures import snr_figure
from cpic_planner.report.numbers import significant
from cpic_planner.report.panel_figure import PanelSheet
from cpic_planner.report.panels import Panels
from cpic_planner.report.sky_figures import margin_figure, sky_map
from cpic_planner.report.whatif_curves import convergence_figure, curves_figure, sweep_figure
from cpic_planner.report.whatif_doubt import doubt_figure
from cpic_planner.report.whatif_maps import FEW, left_out, looks_of, row_label, shown_rows
from cpic_planner.results import DifferenceRecord, EstimateRecord, PlanResult, RankResult, WhatIfResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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
