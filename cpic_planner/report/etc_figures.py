"""Curves around an answer of the exposure-time calculator: SNR against time, contrast limit against separation.

Figures of the exposure-time calculator and of the ranking, as files.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cpic_core import FloatArray, InputError, Status, write_named
from cpic_planner import etc
from cpic_planner.ranking import separation_grid
from cpic_planner.report import drawing
from cpic_planner.report.drawing import BAND_STYLE, WIDTH_INCHES, Look, band_style, literal, new_figure, style
from cpic_planner.report.numbers import duration_text, level_text, pretty_name
from cpic_planner.report.words import term_text
from cpic_planner.results import EtcAnswer, EtcResult
from cpic_planner.targets import Targets
from simulator.detectors import noise_terms

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure


N_TIMES, N_PLACES = 90, 25
"""Points of a curve: straight lines between those of a limit miss at most 0.5 % of it."""
TIME_SPAN = (1.0 / 300.0, 30.0)


@dataclass(frozen=True)
class TimeCurve:
    """SNR and significance of one planet in one band against the wall time of as many visits; NaN without a frame.

    ``point`` holds time, SNR and significance of the answer, if there is one.
    """

    label: str
    time_s: FloatArray
    snr: FloatArray
    significance: FloatArray
    threshold: float
    point: tuple[float, float, float] | None


@dataclass(frozen=True)
class SeparationCurve:
    """Contrast limit in one band against separation; NaN where there is none. ``planets``: separation and contrast."""

    label: str
    separation_arcsec: FloatArray
    contrast: FloatArray
    planets: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class EtcCurves:
    """The contents of a figure of an answer; ``limit_time_s`` is the time of the limits, ``limit_level`` the level."""

    times: tuple[TimeCurve, ...]
    limits: tuple[SeparationCurve, ...]
    limit_time_s: float
    limit_level: str


def etc_curves(
    model: etc.EtcModel,
    star: Targets,
    answers: Sequence[EtcAnswer],
    *,
    time_s: float,
    best_band: str | None = None,
    snr: float | None = None,
    sigma: float | None = None,
    exposure_s: float | None = None,
    em_gain: float | None = None,
) -> EtcCurves:
    """Return the curves around the answers to one question about one star.

    Parameters
    ----------
    model : etc.EtcModel
    star : Targets
        One star.
    answers : sequence of EtcAnswer
    time_s : float
        Wall time that the limits are for; the middle of the axis of times where an answer has none.
    best_band : str, optional
        Band of the lines against time where there are several planets; with one planet every band has its line.
    snr, sigma : float, optional
        Level of the limits; the small-sample threshold where neither is given.
    exposure_s, em_gain : float, optional
        What was fixed.
    """
    fixed: dict[str, Any] = {"exposure_s": exposure_s, "em_gain": em_gain}
    detects = any(answer.question != "signal_to_noise" for answer in answers)
    objective: etc.Objective = "snr" if sigma is None and (snr is not None or not detects) else "significance"
    several = len(answers) > len({answer.band for answer in answers})
    drawn = [answer for answer in answers if answer.band == best_band or not several]
    times = _against_time(model, star, drawn, time_s, objective, etc.FixedFrames(**fixed), several)
    bands = dict.fromkeys(answer.band for answer in answers)
    ends = {band: separation_grid(model, band)[[0, -1]] for band in bands}
    grids = {band: np.geomspace(inner, outer, N_PLACES) for band, (inner, outer) in ends.items()}
    found = etc.contrast_limits(model, star, grids, time_s=time_s, snr=snr, sigma=sigma, **fixed)
    planets = {
        band: tuple((row.separation_arcsec, row.contrast) for row in answers if row.band == band and row.contrast)
        for band in bands
    }
    limits = (SeparationCurve(band, grid, found[band], planets[band]) for band, grid in grids.items())
    return EtcCurves(times, tuple(limits), time_s, level_text(snr, sigma))


def _against_time(
    model: etc.EtcModel,
    star: Targets,
    answers: Sequence[EtcAnswer],
    time_s: float,
    objective: etc.Objective,
    fixed: etc.FixedFrames,
    several: bool,
) -> tuple[TimeCurve, ...]:
    """Return the lines of SNR against time; none of planets that are outside the field or send no light."""
    shown = [
        one
        for one in answers
        if one.contrast is not None and 0.0 < one.contrast <= 1.0 and one.status is not Status.OUTSIDE_FIELD
    ]
    centre = np.array([one.time_s or time_s for one in shown])
    visits = np.array([one.visits or model.strategy.visits or 1 for one in shown])
    grid = np.geomspace(TIME_SPAN[0] * centre, TIME_SPAN[1] * centre, N_TIMES, axis=-1)
    planets = [etc.planets_of([one.separation_arcsec] * N_TIMES, None, one.contrast) for one in shown]
    cameras = [model.camera(one.band) for one in shown]
    threshold = np.empty(len(shown))
    lines = np.full((2, *grid.shape), np.nan)
    for camera in dict.fromkeys(cameras):
        mine = np.flatnonzero([one == camera for one in cameras])
        many, visit_time_s = visits[mine, None, None], (grid / visits[:, None])[mine, None]
        alike = etc.cases_of(model, star, [shown[i].band for i in mine], [planets[i] for i in mine], fixed)
        threshold[mine] = alike.threshold[:, 0, 0]
        cases = alike.in_programme(etc.Programme.of(model.strategy, many, visit_time_s))
        choice = etc.best_in_visit(cases.problem(objective), model.visit_s(visit_time_s))
        if model.strategy.n_modes:  # what they change follows the frames slowly
            cases = alike.in_programme(alike.programme_of(many, visit_time_s, choice))
            choice = etc.best_in_visit(cases.problem(objective), model.visit_s(visit_time_s))
        noise, framed = cases.noise(choice), choice.n_frames >= 1
        lines[:, mine] = np.where(framed, (noise.snr, noise.significance), np.nan)[:, :, 0]
    curves = []
    for i, one in enumerate(shown):
        point = None
        if one.time_s is not None and one.snr is not None and one.significance is not None:
            point = (one.time_s, one.snr, one.significance)
        label = one.band + (f", {one.separation_arcsec:.3f}″" if several else "")
        curves.append(TimeCurve(label, grid[i], lines[0, i], lines[1, i], float(threshold[i]), point))
    return tuple(curves)


FIGURE_FORMATS = ("png", "pdf", "svg")
_UNDATED: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "svg": {"Date": None, "Creator": None},
}
_LEAST_SHARE = 0.02
_BELOW: Look = {
    "loc": "upper center",
    "bbox_to_anchor": (0.5, 0.0),
    "borderaxespad": 4.6,
    "fontsize": 8.5,
    "columnspacing": 1.2,
}
_TITLE: dict[str, Any] = {"fontsize": 10, "y": 1.0}  # where it stands anyway: looking for room takes a tenth longer
_REST = "#D0D0D0"
_TERM_COLOURS = {
    "speckle": "#0072B2",
    "reference": "#E69F00",
    "planet": "#009E73",
    "halo": "#CC79A7",
    "sky": "#56B4E9",
    "companion": "#882255",
    "exozodi": "#AA9988",
    "background_mean": "#8C8C8C",
    "counting": "#332288",
    "smear": "#44AA99",
    "companion_wings": "#661100",
    "common_speckle": "#117733",
} | {term: effect.colour for term, effect in noise_terms().items()}


def check_figure_name(path: Path) -> str:
    """Return the format of a figure's file by its name.

    Raises
    ------
    InputError
        If the name ends in none of the known formats.
    """
    ending = path.suffix.lower().lstrip(".")
    if ending not in FIGURE_FORMATS:
        raise InputError("--plot", str(path), allowed=f"a name that ends in {', '.join(FIGURE_FORMATS)}")
    return ending


def write_figure(figure: Figure, path: Path) -> Path:
    """Write a figure whole; no date goes into it.

    Raises
    ------
    InputError
        If the name has no known ending, or the file cannot be written.
    """
    ending = check_figure_name(path)
    buffer = io.BytesIO()
    with style():
        figure.savefig(buffer, format=ending, dpi=drawing.IMAGE_DPI, metadata=_UNDATED[ending])
    try:
        return write_named(path, buffer.getvalue(), key="--plot")
    except OSError as error:
        raise InputError("--plot", str(path), allowed="a writable file", hint=error.strerror or "") from None


def etc_figure(result: EtcResult, curves: EtcCurves) -> Figure:
    """Draw SNR against time, contrast limit against separation, and the noise budget of each answer.

    Parameters
    ----------
    result : EtcResult
    curves : EtcCurves
        Of the same answers, see `cpic_planner.report.etc_figures.etc_curves`.
    """
    rows = [row for row in result.answers if row.budget]
    with style():
        tall = _HIGH + (0.75 + 0.3 * len(rows) if rows else 0.0)
        figure = new_figure(tall, layout=None)
        looks = band_style([curve.label for curve in curves.limits])
        times, limits = figure.add_subplot(), figure.add_subplot()
        upper = max(_times(times, curves, looks), _limits(limits, curves, looks))
        left, bottom = _LEFT, 0.0
        if rows:
            budgets = figure.add_subplot()
            lower, longest = _budgets(budgets, rows)
            left, bottom = max(left, 0.2 + 0.072 * longest), _below(lower)
        # Room for words is counted instead of looked for: that costs more than drawing them.
        free = tall - _ABOVE - _below(upper) - bottom
        wide, high = (WIDTH_INCHES - left - _BETWEEN - _RIGHT) / 2.0, free * _HIGH / tall
        foot = tall - _ABOVE - high
        _place(times, tall, left, foot, wide, high)
        _place(limits, tall, left + wide + _BETWEEN, foot, wide, high)
        if rows:
            _place(budgets, tall, left, bottom, WIDTH_INCHES - left - _RIGHT, free - high)
        title = f"{pretty_name(result.target)}, V {result.v_mag:.2f} mag, {result.distance_pc:.2f} pc"
        figure.suptitle(literal(title), fontsize=12, y=1.0 - 0.05 / tall)
    return figure


_HIGH, _LEFT, _BETWEEN, _RIGHT, _ABOVE = 4.6, 0.8, 1.0, 0.16, 0.49
"""Height of the figure without a budget, and room for words beside and above axes, inches."""


def _below(legend_rows: int) -> float:
    """Return the room for an axis and a legend below it, inches."""
    return 0.75 + 0.18 * legend_rows


def _place(axes: Axes, tall: float, left: float, bottom: float, width: float, height: float) -> None:
    """Put axes at a place of a figure of a height; all are inches."""
    axes.set_position((left / WIDTH_INCHES, bottom / tall, width / WIDTH_INCHES, height / tall))


def _legend(axes: Axes, columns: int, handles: Sequence[Any] | None = None) -> int:
    """Put a legend below, and return its rows."""
    legend = axes.legend(handles=handles, ncols=columns, **_BELOW)
    return math.ceil(len(legend.get_texts()) / columns)


def _few_ticks(*axes: Axis) -> None:
    """Mark 2 and 5 of each decade between numbers: every mark takes as long as a line of the figure."""
    from matplotlib.ticker import LogLocator

    for axis in axes:
        axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))


def _times(axes: Axes, curves: EtcCurves, looks: dict[str, tuple[str, str]]) -> int:
    """Draw SNR against time; return the rows of the legend, as the other two do."""
    from matplotlib.lines import Line2D

    axes.grid(visible=True)
    axes.set(xscale="log", yscale="log", xlabel="wall time allowed (h)", ylabel="SNR, significance")
    handles, lows, highs = [], [], []
    for number, curve in enumerate(curves.times, len(looks)):
        # Where each line is of another planet, their colours follow those of the bands.
        colour, marker = looks.get(curve.label, BAND_STYLE[number % len(BAND_STYLE)])
        hours = curve.time_s / 3600.0
        axes.plot(hours, curve.snr, color=colour, lw=1.7, label=f"_{curve.label}, SNR")
        look: Look = {"lw": 1.3, "ls": (0, (4, 2)), "label": f"_{curve.label}, significance"}
        axes.plot(hours, curve.significance, color=colour, **look)
        if np.isfinite(curve.threshold):
            axes.axhline(curve.threshold, color=colour, lw=1.0, ls=":", zorder=1, label=f"_{curve.label}, threshold")
            highs.append(curve.threshold)
        if curve.point is not None:
            for value, face in ((curve.point[1], colour), (curve.point[2], "white")):
                look = {"marker": marker, "ms": 7, "mfc": face, "mec": colour, "mew": 1.3, "ls": "none"}
                axes.plot(curve.point[0] / 3600.0, value, zorder=5, **look)
        if curve.label not in looks:  # bands have their names below the other panel
            handles.append(Line2D([], [], color=colour, lw=1.7, marker=marker, ms=6, label=curve.label))
        for values in (curve.snr, curve.significance):
            good = values[np.isfinite(values) & (values > 0)]
            if good.size:
                highs.append(good.max())
                lows.append(good.max())
    if highs:
        axes.set_ylim(min(lows, default=1.0) / 30.0, 1.6 * max(highs))
    lines: list[tuple[str, float, Any]] = [("SNR", 1.7, "-"), ("significance", 1.3, (0, (4, 2))), ("threshold", 1, ":")]
    keys = [Line2D([], [], color="#444444", lw=lw, ls=ls, label=label) for label, lw, ls in lines]
    drawing.plain_ticks(axes.yaxis, 1.0, 3.0)
    drawing.plain_ticks(axes.xaxis, 1.0)
    _few_ticks(axes.xaxis, axes.yaxis)
    axes.set_title("The answer's visits, shorter or longer", **_TITLE)
    if not curves.times:
        axes.text(0.5, 0.5, "no planet to be seen here", transform=axes.transAxes, ha="center")
        return 0
    return _legend(axes, 3, [*handles, *keys])


def _limits(axes: Axes, curves: EtcCurves, looks: dict[str, tuple[str, str]]) -> int:
    axes.grid(visible=True)
    from matplotlib.lines import Line2D

    axes.set(yscale="log", xlabel="separation on the diagonal (arcsec)")
    axes.set_ylabel("planet-to-star contrast (flux ratio)", fontsize=9)
    shown: list[float] = []
    handles = []
    for curve in curves.limits:
        colour, marker = looks[curve.label]
        axes.plot(curve.separation_arcsec, curve.contrast, color=colour, lw=1.7, label=f"_{curve.label} limit")
        handles.append(Line2D([], [], color=colour, lw=1.7, marker=marker, ms=6, label=curve.label))
        good = curve.contrast[np.isfinite(curve.contrast)]
        shown += np.percentile(good, [0, 92]).tolist() if good.size else []
        for place, contrast in curve.planets:
            axes.plot(place, contrast, marker=marker, ms=8, mfc=colour, mec="white", mew=0.8, ls="none", zorder=5)
            shown.append(contrast)
    if shown:
        axes.set_ylim(min(shown) / 2.5, max(shown) * 3.0)
    _few_ticks(axes.yaxis)
    title = f"Limit for {curves.limit_level} in {duration_text(curves.limit_time_s)}, and planet"
    axes.set_title(title, **_TITLE)
    return _legend(axes, min(len(handles), 4), handles)


def _budgets(axes: Axes, rows: Sequence[EtcAnswer]) -> tuple[int, int]:
    """Draw one stacked bar an answer; small terms are one piece. Return rows of the legend and the longest label."""
    shares = []
    for row in rows:
        terms = {name.removesuffix("_e2"): value for name, value in row.budget.items() if name.endswith("_e2")}
        total = sum(terms.values()) or 1.0
        shares.append({name: value / total for name, value in terms.items()})
    names = [name for name in _TERM_COLOURS if any(share.get(name, 0.0) >= _LEAST_SHARE for share in shares)]
    names.sort(key=lambda name: -sum(share.get(name, 0.0) for share in shares))
    left = np.zeros(len(rows))
    several = len({row.band for row in rows}) < len(rows)
    labels = [row.band + (f", {row.separation_arcsec:.3f}″" if several else "") for row in rows]
    for name in names:
        widths = np.array([100.0 * share.get(name, 0.0) for share in shares])
        look: Look = {"color": _TERM_COLOURS[name], "edgecolor": "white", "linewidth": 0.6, "label": term_text(name)}
        axes.barh(range(len(rows)), widths, left=left, height=0.66, **look)
        left += widths
    axes.barh(range(len(rows)), 100.0 - left, left=left, height=0.66, color=_REST, label="all other terms")
    axes.set_yticks(range(len(rows)), labels)
    axes.invert_yaxis()
    axes.set(xlim=(0, 100), xlabel="share of the variance of the answer (%)")
    return _legend(axes, 3), max(map(len, labels))
