"""Contrast curves and operating characteristics: in words, on the terminal, drawn, and as reports."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cpic_core import Record, Registry
from cpic_planner import results
from cpic_planner.jobs import RunFolder
from cpic_planner.queries import LIBRARIES
from cpic_planner.report import document as doc, drawing, words
from cpic_planner.report.answers import flag_lines
from cpic_planner.report.drawing import Look, Picture, literal, with_style
from cpic_planner.report.writing import page_html
from cpic_planner.results import CompletenessMap, CurveResult, CurveRow, RecoveredRow, RocResult, RocRow

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_HALF_STEPS = 2.0
"""Levels of a search that the terminal shows, in each unit."""
_POINTS = (
    "band:row,left separation_arcsec contrast_limit_blind contrast_limit_known_place/4 contrast_limit_threshold/3 "
    "{measured}core_throughput/7 azimuth_share/6 threshold/8"
)
_MEASURED = "measured_limit/1 measured_throughput/5 "
_RECOVERED = (
    "band:row,left separation_arcsec contrast n_injected/2 n_recovered/1 recovered recovered_low/3 recovered_high/3 "
    "predicted"
)
_PROGRAMME = (
    "band:row,left separation_arcsec contrast visits frames em_gain visit_time_s/1 time_s resolution_elements/2"
)


def curve_sentences(result: CurveResult) -> list[str]:
    """Return what contrast curves say, in sentences."""
    said = []
    for band in result.bands:
        rows = [row for row in result.points if row.band == band.band and row.contrast_limit_blind is not None]
        best = min(rows, key=lambda row: row.contrast_limit_blind or math.inf, default=None)
        if best is None:
            said.append(f"{band.band}: no limit: {band.message or words.status_text(band.status)}.")
            continue
        said.append(words.text("texts.curve_limit", best=best, programme=_programme_text(band)))
        said += _no_images(band)
        ratios = [
            row.measured_limit / row.contrast_limit_threshold
            for row in rows
            if row.measured_limit is not None and row.contrast_limit_threshold
        ]
        if ratios:
            mean = math.exp(sum(map(math.log, ratios)) / len(ratios))
            places = words.counted(len(ratios), "separation")
            said.append(words.text("texts.curve_measured", band=band, mean=mean, places=places))
    if result.recovered:
        n, hits = (sum(getattr(row, name) for row in result.recovered) for name in ("n_injected", "n_recovered"))
        expected = sum(row.n_injected * row.predicted for row in result.recovered)
        said.append(f"Of {n} injected planets blind searches find {hits}; the law of detection expects {expected:.0f}.")
    return said


def roc_sentences(result: RocResult) -> list[str]:
    """Return what an operating characteristic says, in sentences."""
    said = []
    for band in result.bands:
        row = next((one for one in result.levels if one.band == band.band and one.sigma == result.sigma), None)
        if row is None or band.contrast is None or band.separation_arcsec is None:
            said.append(f"{band.band}: no answer: {band.message or words.status_text(band.status)}.")
            continue
        said.append(words.text("texts.roc_level", band=band, row=row, programme=_programme_text(band)))
        if row.n_planets:
            alarms = words.counted(row.n_false, "false alarm")
            said.append(words.text("texts.roc_images", row=row, alarms=alarms))
        said += _no_images(band)
    return said


def _no_images(band: results.SearchedProgramme) -> list[str]:
    return [f"No images in {band.band}: {band.images_message}."] if band.images_message else []


def _programme_text(band: results.SearchedProgramme) -> str:
    """Return a programme in words."""
    if band.time_s is None or band.visits is None:
        return "no programme"
    return f"{words.counted(band.visits, 'visit')}, {words.duration_text(band.time_s)} in all"


def search_blocks(result: CurveResult | RocResult, *, full: bool = False) -> Iterator[doc.Block]:
    """Yield what searches of a star find, as a terminal shows it.

    Parameters
    ----------
    result : CurveResult or RocResult
    full : bool
        Also the programme of each band, and every level.
    """
    page = SearchedReport(result, {}, full)
    yield from _curves(page) if isinstance(result, CurveResult) else _detections(page)
    if isinstance(result, CurveResult):
        yield from _injected(page)
    if full:
        yield _programme_table(result)
    yield from doc.notes(*search_sentences(result), look="")
    yield from doc.notes(*flag_lines(result.bands, result.note))


def search_sentences(result: CurveResult | RocResult) -> list[str]:
    """Return what contrast curves or operating characteristics say, in sentences."""
    return curve_sentences(result) if isinstance(result, CurveResult) else roc_sentences(result)


def _programme_table(result: CurveResult | RocResult) -> doc.Table:
    kind = results.RocProgramme if isinstance(result, RocResult) else results.SearchedProgramme
    caption = "The programme that every number of a band is about."
    return doc.Table("Programmes", doc.row_columns(kind, f"{_PROGRAMME} images:page"), result.bands, caption)


_LIMITS: tuple[tuple[str, str, Look], ...] = (
    # Wide and pale, so that a line at a known place is seen on it where the two are equal.
    ("contrast_limit_blind", "half found blind", {"ls": "-", "lw": 3.6, "alpha": 0.45}),
    ("contrast_limit_known_place", "half found at a known place", {"ls": (0, (4, 2)), "lw": 1.3}),
    ("contrast_limit_threshold", "at the threshold", {"ls": ":", "lw": 1.7}),
)
_HIGH, _LOW = 3.9, 2.9
"""Heights of the curves and of a row of smaller panels, inches."""
_GREY = "#444444"
_POINT: Look = {"ms": 5, "ls": "none", "lw": 1.0, "mec": "white", "mew": 0.5}
_CONTOURS = (0.1, 0.3, 0.5, 0.7, 0.9)
_FEWEST = 0.3
"""False alarms counted and expected below which nothing is shown."""

Panel = Callable[["Axes"], None]


def _curve_panels(result: CurveResult) -> dict[str, list[Panel]]:
    """Return what draws the curves, the map of completeness of each band, and recovered planets where they are."""
    top = math.ceil(10.0 * max((share for one in result.maps for share in one.azimuth_share), default=0.0)) / 10.0
    panels: dict[str, list[Panel]] = {
        "curves": [lambda axes: _draw_curves(axes, result)],
        "maps": [lambda axes, one=one: _draw_map(axes, one, result, top) for one in result.maps],  # type: ignore[misc]
        "recovered": [lambda axes: _draw_recovered(axes, result.recovered)] * bool(result.recovered),
    }
    return {key: drawn for key, drawn in panels.items() if drawn}


@with_style
def curve_figure(result: CurveResult) -> Figure:
    """Draw the contrast curves of all bands, their maps of completeness, and recovered planets."""
    (curves, *panels) = [panel for drawn in _curve_panels(result).values() for panel in drawn]
    rows = math.ceil(len(panels) / 2)
    figure = drawing.new_figure(_HIGH + _LOW * rows)
    grid = figure.add_gridspec(1 + rows, 2, height_ratios=[_HIGH, *[_LOW] * rows])
    curves(figure.add_subplot(grid[0, :]))
    for number, draw in enumerate(panels):
        last = number == len(panels) - 1 and number % 2 == 0
        draw(figure.add_subplot(grid[1 + number // 2, slice(None) if last else number % 2]))
    figure.suptitle(literal(_title(result)), fontsize=12)
    return figure


def curve_pictures(result: CurveResult) -> dict[str, Picture]:
    """Return the same as pictures of a report: ``curves``, and where they are there ``maps`` and ``recovered``."""
    bands = ", ".join(dict.fromkeys(row.band for row in result.points)) or "no band"
    about = {"bands": bands, "sigma": result.sigma, "n_injected": sum(row.n_injected for row in result.recovered)}
    heights = {"curves": _HIGH, "maps": _LOW, "recovered": _LOW}
    return {key: _picture(panels, heights[key], key, about) for key, panels in _curve_panels(result).items()}


@with_style
def roc_figure(result: RocResult) -> Figure:
    """Draw the probability of a detection against false alarms, and false alarms counted in images."""
    counted = any(row.n_searches for row in result.levels)
    figure = drawing.new_figure(_HIGH)
    _draw_roc(figure.add_subplot(1, 1 + counted, 1), result)
    if counted:
        _draw_alarms(figure.add_subplot(1, 2, 2), result)
    figure.suptitle(literal(_title(result)), fontsize=12)
    return figure


def roc_pictures(result: RocResult) -> dict[str, Picture]:
    """Return the same as pictures of a report: ``roc``, and with images ``alarms``."""
    bands = ", ".join(dict.fromkeys(row.band for row in result.levels)) or "no band"
    about = {"bands": bands, "sigma": result.sigma}
    found = {"roc": _picture([lambda axes: _draw_roc(axes, result)], _HIGH, "roc", about)}
    if any(row.n_searches for row in result.levels):
        found["alarms"] = _picture([lambda axes: _draw_alarms(axes, result)], _LOW, "alarms", about)
    return found


@with_style
def _picture(panels: Sequence[Panel], height: float, name: str, about: Mapping[str, Any]) -> Picture:
    columns = min(len(panels), 2)
    rows = math.ceil(len(panels) / columns)
    figure = drawing.new_figure(height * rows)
    for number, draw in enumerate(panels):
        draw(figure.add_subplot(rows, columns, number + 1))
    return drawing.picture(figure, name, **about)


def _title(result: CurveResult | RocResult) -> str:
    star = f"{words.pretty_name(result.target)}, V {result.v_mag:.2f} mag, {result.distance_pc:.2f} pc"
    return f"{star}: one programme of at most {words.duration_text(result.time_s)}"


def _draw_curves(axes: Axes, result: CurveResult) -> None:
    from matplotlib.lines import Line2D

    drawing.contrast_axes(axes)
    handles, shown = [], []
    for band, (colour, marker) in drawing.band_style([one.band for one in result.bands]).items():
        rows = [row for row in result.points if row.band == band]
        handles.append(Line2D([], [], color=colour, lw=2.0, label=band))
        for name, _, look in _LIMITS:
            x, y = _column(rows, "separation_arcsec"), _column(rows, name)
            axes.plot(x, y, color=colour, marker="_" if len(rows) == 1 else "", ms=14, **look)
            shown += y[np.isfinite(y)].tolist()
        if seen := [row for row in rows if row.measured_limit is not None]:
            x, y = _column(seen, "separation_arcsec"), _column(seen, "measured_limit")
            errors = np.array([row.measured_limit_error or 0.0 for row in seen])
            axes.errorbar(x, y, errors, color=colour, marker=marker, zorder=5, **_POINT)
            shown += y.tolist()
    handles += [Line2D([], [], color=_GREY, label=label, **look) for _, label, look in _LIMITS]
    if any(row.measured_limit is not None for row in result.points):
        look = {"color": _GREY, "marker": "o", "ms": 5, "ls": "none"}
        handles.append(Line2D([], [], label=f"measured in {result.images} images", **look))
    # Without the corners of the hole, where limits climb unbounded.
    if separations := [row.separation_arcsec for row in result.points]:
        drawing.separation_ticks(axes, min(separations) / 1.04, max(separations) * 1.04)
    if shown:
        axes.set_ylim(min(shown) / 1.5, float(np.percentile(shown, 97)) * 1.8)
    drawing.power_ticks(axes.yaxis)
    below: Look = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "borderaxespad": 3.6, "columnspacing": 1.6}
    axes.legend(handles=handles, ncols=4, **below)


def _draw_map(axes: Axes, one: CompletenessMap, result: CurveResult, top: float) -> None:
    drawing.contrast_axes(axes)
    axes.grid(visible=False)
    place, contrast = np.array(one.separation_arcsec), np.array(one.contrast)
    chance = np.array(one.azimuth_share)[:, None] * np.array(one.chance)
    look: Look = {"cmap": drawing.STACK_COLOURS, "vmin": 0.0, "vmax": top}
    if len(place) > 1:
        mesh = axes.pcolormesh(place, contrast, chance.T, shading="nearest", rasterized=True, **look)
        lines = axes.contour(place, contrast, chance.T, levels=_CONTOURS, colors="white", linewidths=0.8)
        bar = axes.figure.colorbar(mesh, ax=axes, label="found blind, at any PA", ticks=_CONTOURS)
        bar.add_lines(lines)
        drawing.separation_ticks(axes, place[0], place[-1])
    else:
        axes.plot(np.full(contrast.shape, place[0]), contrast, color=_GREY, lw=0.5)
        axes.scatter(np.full(contrast.shape, place[0]), contrast, c=chance[0], **look)
        drawing.separation_ticks(axes, place[0] / 1.2, place[0] * 1.2)
    rows = [row for row in result.points if row.band == one.band]
    line: Look = {"color": "#D55E00", "ls": (0, (4, 2)), "lw": 2.0, "label": "half found on the diagonal"}
    axes.plot(_column(rows, "separation_arcsec"), _column(rows, "contrast_limit_blind"), **line)
    axes.legend(loc="lower center", fontsize=8, labelcolor="white")
    axes.set(ylabel="contrast (flux ratio)", ylim=(contrast[0], contrast[-1]))
    drawing.power_ticks(axes.yaxis)
    axes.set_title(one.band, fontsize=10)


def _draw_recovered(axes: Axes, rows: Sequence[RecoveredRow]) -> None:
    axes.grid(visible=True)
    axes.plot([0, 1], [0, 1], color=_GREY, lw=1.0, ls=":")
    for band, (colour, marker) in drawing.band_style([row.band for row in rows]).items():
        mine = [row for row in rows if row.band == band]
        _draw_shares(axes, mine, "predicted", color=colour, marker=marker, label=band)
    axes.set(xlim=(-0.03, 1.03), ylim=(-0.03, 1.03), xlabel="fraction predicted", ylabel="fraction recovered")
    axes.set_title(f"injected planets, {max(row.n_injected for row in rows)} a point", fontsize=10)
    axes.legend(loc="upper left")


def _draw_roc(axes: Axes, result: RocResult) -> None:
    from matplotlib.lines import Line2D

    handles = []
    axes.grid(visible=True)
    axes.set(xscale="log", ylim=(-0.03, 1.03), xlabel="false alarms of one search", ylabel="probability of a detection")
    for band, (colour, marker) in drawing.band_style([one.band for one in result.bands]).items():
        rows = [row for row in result.levels if row.band == band]
        if not rows:
            continue
        handles.append(Line2D([], [], color=colour, lw=2.0, label=band))
        mark = [row.sigma for row in rows].index(result.sigma)
        for suffix, _, look in _SEARCHES:
            x, y = (_column(rows, f"{name}{suffix}") for name in ("false_alarms", "detection_probability"))
            axes.plot(x, y, color=colour, **look)
            axes.scatter(x[mark], y[mark], s=70, facecolors="none", edgecolors=colour, linewidths=1.4, zorder=6)
        if rows[0].n_planets:
            _draw_shares(axes, rows, "false_alarms", color=colour, marker=marker)
    handles += [Line2D([], [], color=_GREY, label=label, **look) for _, label, look in _SEARCHES]
    grey: Look = {"color": _GREY, "ls": "none", "marker": "o"}
    handles.append(Line2D([], [], mfc="none", ms=8, label=f"level of {result.sigma:g}σ", **grey))
    if any(row.n_planets for row in result.levels):
        handles.append(Line2D([], [], ms=5, label="blind, in images", **grey))
    axes.legend(handles=handles, loc="upper left")


_SEARCHES: tuple[tuple[str, str, Look], ...] = (
    ("", "blind", {"ls": "-", "lw": 2.0}),
    ("_known_place", "at a known place", {"ls": (0, (4, 2)), "lw": 1.5}),
)


def _column(rows: Sequence[CurveRow | RecoveredRow | RocRow], name: str) -> np.ndarray:
    return np.array([getattr(row, name) for row in rows], float)


def _draw_shares(axes: Axes, rows: Sequence[RecoveredRow | RocRow], name: str, **look: Any) -> None:
    """Draw recovered fractions with their intervals against another column."""
    x, y, low, high = (_column(rows, one) for one in (name, "recovered", "recovered_low", "recovered_high"))
    axes.errorbar(x, y, [np.maximum(y - low, 0.0), np.maximum(high - y, 0.0)], **_POINT, **look)


def _draw_alarms(axes: Axes, result: RocResult) -> None:
    axes.grid(visible=True)
    axes.set(xscale="log", yscale="log", xlabel="false alarms expected", ylabel="false alarms in the images")
    ends = [1.0]
    for band, (colour, marker) in drawing.band_style([one.band for one in result.bands]).items():
        rows = [row for row in result.levels if row.band == band and row.n_searches]
        expected = np.array([row.n_searches * row.false_alarms for row in rows])
        counts = np.array([row.n_false for row in rows], float)
        shown = (expected >= _FEWEST) & (counts > 0)
        if not shown.any():
            continue
        errors = np.sqrt(counts[shown])
        down = np.minimum(errors, 0.7 * counts[shown])
        axes.errorbar(expected[shown], counts[shown], [down, errors], label=band, color=colour, marker=marker, **_POINT)
        ends += [*expected[shown], *counts[shown]]
    line = [min(ends) / 2.0, max(ends) * 2.0]
    axes.plot(line, line, color=_GREY, lw=1.0, ls=":")
    axes.set(xlim=line, ylim=line)
    axes.set_title(f"{max((row.n_searches for row in result.levels), default=0)} images without planets", fontsize=10)
    if len(axes.get_legend_handles_labels()[0]):
        axes.legend(loc="upper left")


CURVE_PRODUCTS = ("curve.csv", "completeness.csv", "recovered.csv", "report.html")
"""Names of the files of a report of contrast curves."""
ROC_PRODUCTS = ("roc.csv", "report.html")
"""Names of the files of a report of operating characteristics."""
_WORDS = "contrast; significance; threshold; speckle floor; blind search; separation; dark hole; core throughput; RDI"


class SearchedReport(Record):
    """Searches and their pictures, by the keys of `curve_pictures` or `roc_pictures`; ``full``: show every level."""

    result: Any
    pictures: Mapping[str, Picture]
    full: bool = True

    def drawn(self, *keys: str) -> Iterator[doc.Figure]:
        """Yield some of the pictures, those that there are."""
        return (doc.Figure(self.pictures[key], key=key) for key in keys if key in self.pictures)


CURVE_SECTIONS: Registry[doc.Section[SearchedReport]] = Registry("section")
"""Sections of the report of contrast curves, in their order."""
ROC_SECTIONS: Registry[doc.Section[SearchedReport]] = Registry("section")
"""Sections of the report of operating characteristics, in their order."""


def write_curve(folder: RunFolder, result: CurveResult) -> None:
    """Write ``curve.csv``, ``completeness.csv``, ``recovered.csv`` and ``report.html``, each whole."""
    folder.write("curve.csv", _csv(CurveRow, result.points))
    folder.write("completeness.csv", completeness_csv(result))
    folder.write("recovered.csv", _csv(RecoveredRow, result.recovered))
    folder.write("report.html", _page(CURVE_SECTIONS, SearchedReport(result, curve_pictures(result)), "contrast curve"))


def write_roc(folder: RunFolder, result: RocResult) -> None:
    """Write ``roc.csv`` and ``report.html``, each whole."""
    folder.write("roc.csv", _csv(RocRow, result.levels))
    folder.write(
        "report.html", _page(ROC_SECTIONS, SearchedReport(result, roc_pictures(result)), "detection statistics")
    )


def completeness_csv(result: CurveResult) -> str:
    """Return the maps of completeness as CSV, one line a band, separation and contrast."""
    names = ("band", "separation_arcsec", "contrast", "azimuth_share", "chance", "chance_known_place")
    rows = []
    for one in result.maps:
        columns = zip(one.separation_arcsec, one.azimuth_share, one.chance, one.chance_known_place, strict=True)
        for place, share, *chances in columns:
            for contrast, blind, known in zip(one.contrast, *chances, strict=True):
                rows.append(dict(zip(names, (one.band, place, contrast, share, blind, known), strict=True)))
    return results.csv_text(names, rows)


def _csv(kind: type[results.Result], rows: Sequence[results.Result]) -> str:
    return results.csv_text(results.names_of(kind), [results.values_of(row) for row in rows])


def _page(sections: Registry[doc.Section[SearchedReport]], page: SearchedReport, what: str) -> str:
    result, star = page.result, words.full_name(page.result.target, page.result.hip)
    title = f"CPI-C {what} of {star}, configuration {result.config_hash}"
    about = words.text(f"texts.{result.kind}_about")
    summary = [doc.Paragraph(" ".join(search_sentences(result)), "lead")]
    return page_html(doc.document_of(sections, page, title=title, heading=star, about=about, summary=summary))


@doc.section_of(CURVE_SECTIONS, "curves", "Contrast curves")
def _curves(page: SearchedReport) -> Iterator[doc.Block]:
    result: CurveResult = page.result
    yield from page.drawn("curves")
    time = words.duration_text(result.time_s)
    title = f"{words.star_text(result)}; contrast limits at {result.sigma:g}σ in {time}"
    measured = any(row.measured_limit is not None for row in result.points)
    columns = doc.row_columns(CurveRow, f"{_POINTS.format(measured=_MEASURED * measured)} status")
    yield doc.Table(title, columns, result.points, legend=True)


@doc.section_of(CURVE_SECTIONS, "completeness", "Completeness")
def _completeness(page: SearchedReport) -> Iterator[doc.Block]:
    return page.drawn("maps")


@doc.section_of(CURVE_SECTIONS, "injected", "Injected planets")
def _injected(page: SearchedReport) -> Iterator[doc.Block]:
    yield from page.drawn("recovered")
    if page.result.recovered:
        columns = doc.row_columns(RecoveredRow, _RECOVERED)
        yield doc.Table("Injected planets", columns, page.result.recovered, legend=True)


@doc.section_of(ROC_SECTIONS, "detections", "Detections and false alarms")
def _detections(page: SearchedReport) -> Iterator[doc.Block]:
    result: RocResult = page.result
    yield from page.drawn("roc", "alarms")
    images = any(row.n_searches for row in result.levels)
    counted = "n_searches/3 n_false/2 n_planets/3 n_detected/2 recovered/1 " if images else ""
    layout = (
        f"band sigma false_alarms detection_probability {counted}false_alarms_known_place/5 "
        "detection_probability_known_place/4"
    )
    sigma, all_levels = result.sigma, page.full
    rows = [row for row in result.levels if all_levels or row.sigma == sigma or not row.sigma * _HALF_STEPS % 1.0]
    title = f"{words.star_text(result)}; detections and false alarms"
    yield doc.Table(title, doc.row_columns(RocRow, layout), rows, legend=True)


@doc.section_of(CURVE_SECTIONS, "programmes", "Programmes and assumptions")
@doc.section_of(ROC_SECTIONS, "programmes", "Programmes and assumptions")
def _programmes(page: SearchedReport) -> Iterator[doc.Block]:
    """Yield the programme of each band, and what was taken for granted."""
    result = page.result
    yield _programme_table(result)
    said = {one.band: one.message or one.images_message for one in result.bands}
    yield from doc.notes(*(f"{band}: {text}" for band, text in said.items() if text))
    if flags := flag_lines(result.bands, result.note):
        yield doc.Items(flags)
    library = LIBRARIES[result.reference_library]
    yield doc.Facts(
        [
            ("Instrument", result.instrument),
            ("Wall time", f"at most {words.duration_text(result.time_s)} a band"),
            ("Level", f"the false-alarm probability of {result.sigma:g}σ in each resolution element"),
            ("Reference library", [f"{library.meaning} (", doc.code(library.name), f"); {result.n_modes} modes."]),
            ("Date", result.date_utc[:10]),
            ("Star table", result.catalogue),
            *doc.notes_fact(result.notes),
        ]
    )


@doc.section_of(CURVE_SECTIONS, "reproduce", "Reproducing this")
@doc.section_of(ROC_SECTIONS, "reproduce", "Reproducing this")
def _reproduced(page: SearchedReport) -> Iterator[doc.Block]:
    tables = "`curve.csv`, `completeness.csv`, `recovered.csv`" if page.result.kind == "curve" else "`roc.csv`"
    note = f"Numbers in full: `{page.result.kind}.json`; tables: {tables}."
    yield from doc.reproduced_blocks(page.result, doc.marked(note))
    yield doc.Items(words.prose()["credits"])
    yield doc.Fold("Glossary", [doc.Facts(words.terms(_WORDS))])
