"""The report of a confirmed scene: its sections, each an entry of `CONFIRM_SECTIONS`, and figures of atmospheres."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, Registry
from cpic_planner import results
from cpic_planner.registry import LIBRARIES
from cpic_planner.report import document as doc, image_figures
from cpic_planner.report.cells import frames_text
from cpic_planner.report.drawing import Look, Picture, band_style, new_figure, save, style
from cpic_planner.report.numbers import MISSING, count_text, decimals, significant
from cpic_planner.report.summary import calibration_sentence, confirm_sentences, outcome_text, overrides_sentence
from cpic_planner.report.words import ALBEDO_STATUS, prose, terms
from cpic_planner.validation import AlbedoFit, AlbedoModel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_REGION, _INNER, _OUTER = "#0072B2", "#5B9FD0", "#C4DDEF"
_TRUTH, _BEST, _SPECTRUM = "#D55E00", "#000000", "#7A7A7A"
# Wavelengths shown beyond the outermost bands.
_MARGIN_NM = 40.0
_STATUS_TEXT = {
    "constrained": "both constrained",
    "not_constrained": "not constrained",
    "degenerate": "degenerate: fewer bands than parameters",
}
_BELOW: Look = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "borderaxespad": 4.4}
_PARAMETER_TEXT = {"log10_mh": "[M/H]", "log10_fsed": "f_sed"}


def albedo_figure(
    fit: AlbedoFit,
    model: AlbedoModel,
    *,
    truth: tuple[float, float] | None = None,
    spectrum: tuple[ArrayLike, ArrayLike] | None = None,
) -> Figure:
    """Draw the posterior of metallicity and clouds, and the measured contrasts.

    Parameters
    ----------
    fit : AlbedoFit
    model : AlbedoModel
        What was fitted.
    truth : (log10_mh, log10_fsed), optional
        Marked where it is known.
    spectrum : (wavelength_nm, contrast), optional
        The planet's true contrast against wavelength, shapes (n,).

    Raises
    ------
    InputError
        If the spectrum's columns do not fit each other.
    """
    line = None if spectrum is None else _columns(spectrum)
    with style():
        figure = new_figure(4.5)
        left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.15))
        _posterior(left, fit, truth)
        _contrasts(right, fit, model, line)
        figure.draw_without_rendering()
    return figure


def albedo_picture(fit: AlbedoFit, model: AlbedoModel, **known: Any) -> Picture:
    """Return the same as a picture of a report; ``known`` are ``truth`` and ``spectrum``."""
    figure = albedo_figure(fit, model, **known)
    mh, fsed = fit.interval("log10_mh"), fit.interval("log10_fsed")
    ranges = (
        f"{decimals(mh[0], 2)} to {decimals(mh[1], 2)} and log10 f_sed {decimals(fsed[0], 2)} to {decimals(fsed[1], 2)}"
    )
    with style():
        return save(
            figure,
            alt="Regions of 68 % and 95 % probability in metallicity and f_sed, and measured contrasts: "
            f"{', '.join(fit.bands)}.",
            caption="Left: what the measured contrasts allow, with flat priors over the ranges of the model; 68 % of "
            f"the probability has log10 [M/H] {ranges} ({_STATUS_TEXT[fit.status]}). Right: measured contrasts with "
            "1-sigma errors and bandwidths, those of the best fit, and the input spectrum.",
        )


def _columns(spectrum: tuple[ArrayLike, ArrayLike]) -> tuple[FloatArray, FloatArray]:
    wavelength, contrast = (np.asarray(column, dtype=np.float64) for column in spectrum)
    if wavelength.ndim != 1 or wavelength.shape != contrast.shape or wavelength.size == 0:
        raise InputError("spectrum", f"{wavelength.shape}, {contrast.shape}", allowed="two columns of equal length")
    return wavelength, contrast


def _posterior(axes: Axes, fit: AlbedoFit, truth: tuple[float, float] | None) -> None:
    from matplotlib.patches import Patch

    inner, outer = fit.level(0.68), fit.level(0.95)
    x, y, density = fit.log10_mh_grid, fit.log10_fsed_grid, fit.posterior.T
    top = max(float(density.max()), inner) * 1.001
    axes.contourf(x, y, density, levels=[outer, inner, top], colors=[_OUTER, _INNER])
    axes.contour(x, y, density, levels=[outer, inner], colors=[_REGION], linewidths=[0.8, 1.3])
    axes.grid(visible=True)
    handles: list[Any] = [
        Patch(facecolor=_INNER, edgecolor=_REGION, label="68 %"),
        Patch(facecolor=_OUTER, edgecolor=_REGION, label="95 %"),
    ]
    bare: Look = {"ls": "none", "clip_on": False}
    if fit.status != "degenerate":
        look = bare | {"marker": "x", "ms": 8, "mew": 1.8, "color": _BEST, "zorder": 6}
        handles += axes.plot(fit.log10_mh, fit.log10_fsed, label="best fit", **look)
    if truth is not None:
        look = bare | {"marker": "*", "ms": 13, "mfc": _TRUTH, "mec": "white", "zorder": 5}
        handles += axes.plot(*truth, label="truth", **look)
    axes.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]), xlabel="metallicity, log10 [M/H]", ylabel="clouds, log10 f_sed")
    axes.set_title(f"{_STATUS_TEXT[fit.status]}\n{_open_text(fit)}", fontsize=9.5)
    axes.legend(handles=handles, ncols=4, handletextpad=0.5, columnspacing=1.2, **_BELOW)


def _open_text(fit: AlbedoFit) -> str:
    """Return which ends of the ranges the 95 % region reaches."""
    ends = []
    for name, text in _PARAMETER_TEXT.items():
        sides = [side for side in ("low", "high") if f"{name}_{side}" in fit.open_edges]
        if sides:
            ends.append(f"{' and '.join(sides)} {text}")
    return f"open at {', '.join(ends)}" if ends else "within the ranges of the model"


def _contrasts(axes: Axes, fit: AlbedoFit, model: AlbedoModel, line: tuple[FloatArray, FloatArray] | None) -> None:
    from matplotlib.lines import Line2D

    rows = [model.bands.index(band) for band in fit.bands]
    middle, half = model.wavelength_nm[rows], 0.5 * model.width_nm[rows]
    low, high = float((middle - half).min()) - _MARGIN_NM, float((middle + half).max()) + _MARGIN_NM
    shown = [*(fit.contrasts - fit.errors), *(fit.contrasts + fit.errors), *fit.model_contrasts, 0.0]
    handles: list[Line2D] = []
    if line is not None:
        inside = (line[0] >= low) & (line[0] <= high) & np.isfinite(line[1])
        shown += line[1][inside].tolist()
    unit = 10.0 ** np.floor(np.log10(max(np.abs(shown))))
    if line is not None:
        handles += axes.plot(line[0][inside], line[1][inside] / unit, color=_SPECTRUM, lw=1.2, label="input spectrum")
    looks = band_style(model.bands)
    for number, band in enumerate(fit.bands):
        colour, marker = looks[band]
        value, error = fit.contrasts[number] / unit, fit.errors[number] / unit
        look: Look = {"color": colour, "marker": marker, "ms": 6.5, "mec": "white", "mew": 0.6, "lw": 1.6, "capsize": 3}
        axes.errorbar(middle[number], value, error, half[number], zorder=5, **look)
        handles.append(Line2D([], [], color=colour, marker=marker, ms=6.5, lw=1.6, label=band))
    looks_best: Look = {"ls": "none", "marker": "_", "ms": 17, "mew": 2.0, "color": _BEST}
    handles += axes.plot(middle, fit.model_contrasts / unit, label="best fit", zorder=4, **looks_best)
    axes.grid(visible=True)
    axes.axhline(0.0, color="#444444", lw=0.8)
    spread = (max(shown) - min(shown)) / unit
    axes.set(xlim=(low, high), ylim=(min(shown) / unit - 0.04 * spread, max(shown) / unit + 0.08 * spread))
    axes.set(xlabel="wavelength (nm)", ylabel=f"contrast ($10^{{{round(np.log10(unit))}}}$)")
    chance = "" if fit.p_value is None else f", p {significant(fit.p_value, 2)}"
    grey = "" if fit.grey == 1.0 else f", common factor {decimals(fit.grey, 2)}"
    count = len(fit.bands)
    axes.set_title(f"chi-square {decimals(fit.chi2, 1)} of {count} band{'s' * (count > 1)}{chance}{grey}", fontsize=9.5)
    axes.legend(handles=handles, ncols=3, handletextpad=0.6, columnspacing=1.4, **_BELOW)


CONFIRM_FIGURES = {
    "spectrum": "Recovered contrasts on the spectrum of the scene",
    "calibration": "Does the prediction hold?",
}
"""Figures that have a title of their own; others are shown under their keys."""
_WORDS = (
    "contrast; SNR; significance; threshold; speckle floor; predicted, recovered; realisation; blind search; "
    "optimistic, pessimistic; separation; dark hole; core throughput; RDI; integration, wall time; EM gain"
)
"""Terms of the glossary that this report uses."""


@dataclass(frozen=True)
class ConfirmReport:
    """The contents of the report of a confirmed scene.

    Attributes
    ----------
    result : ConfirmResult
    figures : mapping of str to Picture
        By the keys of `CONFIRM_FIGURES`, or by a title.
    images : mapping of str to Picture
        Image panels by band.
    """

    result: results.ConfirmResult
    figures: Mapping[str, Picture]
    images: Mapping[str, Picture]

    @property
    def planets(self) -> dict[str, list[results.BandConfirmation]]:
        """Measurements by planet."""
        by_planet: dict[str, list[results.BandConfirmation]] = {}
        for item in self.result.bands:
            by_planet.setdefault(item.planet, []).append(item)
        return by_planet

    @property
    def calibration(self) -> str:
        """How the prediction holds; empty without planets."""
        return calibration_sentence(self.result) if self.result.bands else ""


CONFIRM_SECTIONS: Registry[doc.Section[ConfirmReport]] = Registry("section")
"""Sections of the report, in their order."""


def confirm_document(report: ConfirmReport) -> doc.Document:
    """Return the report of a confirmed scene."""
    result = report.result
    searched = LIBRARIES[result.reference_library].searched
    heading = f"{result.scene}: {outcome_text(result.bands)}" if result.bands else result.scene
    summary = [doc.Paragraph(" ".join(confirm_sentences(result)), "lead")]
    if altered := overrides_sentence(result):
        summary.insert(0, doc.Paragraph(doc.strong(altered), "altered"))
    if report.calibration:
        summary.append(doc.Paragraph(doc.strong(report.calibration), "lead"))
    return doc.document_of(
        CONFIRM_SECTIONS,
        report,
        title=f"CPI-C: {heading}, configuration {result.config_hash}",
        heading=heading,
        about=f"A scene for CPI-C: simulated as images, the star subtracted, {searched}, beside what the "
        "exposure-time calculator predicts.",
        summary=summary,
    )


@doc.section_of(CONFIRM_SECTIONS, "planets", "Planets")
def _planets(report: ConfirmReport) -> Iterator[doc.Block]:
    for number, (name, bands) in enumerate(report.planets.items(), 1):
        table = image_figures.measure_table(name, bands, f"{name} by band.")
        blocks = [table, *image_figures.audit_blocks(name, bands)]
        yield doc.Group(f"planet-{number}", name, blocks)


_Candidate = tuple[results.SearchRecord, results.CandidateRecord | None]


def _of_search(text: Callable[[results.SearchRecord], str]) -> Callable[[_Candidate], str]:
    """Return the cell of a search, in its first row alone."""
    return lambda row: text(row[0]) if row[1] is None or row[1] is row[0].candidates[0] else ""


def _of_candidate(text: Callable[[results.CandidateRecord], doc.Inline]) -> Callable[[_Candidate], doc.Inline]:
    return lambda row: MISSING if row[1] is None else text(row[1])


def _detected(item: results.CandidateRecord) -> doc.Inline:
    return doc.badge("ok", "detected") if item.detected else doc.badge("unreachable", "below")


def _elsewhere(search: results.SearchRecord) -> str:
    return f"{search.false_detections} of {search.realisations}"


def _separation(row: _Candidate) -> doc.Inline | doc.Span:
    return doc.Span("nothing is named", 6) if row[1] is None else decimals(row[1].separation_arcsec, 3)


_SEARCHED: tuple[doc.Column[_Candidate], ...] = (
    doc.Column("Band", lambda row: row[0].band, look="row left"),
    doc.Column("Frames × exposure", _of_search(frames_text), "s"),
    doc.Column("EM gain", _of_search(lambda search: significant(search.em_gain))),
    doc.Column("Resolution elements", _of_search(lambda search: count_text(round(search.resolution_elements)))),
    doc.Column("Detections elsewhere", _of_search(_elsewhere), "of searches"),
    doc.Column("Separation", _separation, "arcsec"),
    doc.Column("PA", _of_candidate(lambda item: decimals(item.pa_deg, 1)), "deg"),
    doc.Column("SNR", _of_candidate(lambda item: significant(item.snr)), "matched filter"),
    doc.Column("Threshold", _of_candidate(lambda item: significant(item.threshold))),
    doc.Column("Detected", _of_candidate(_detected), look="left"),
    doc.Column("Planet", _of_candidate(lambda item: item.planet or MISSING), look="left"),
)


@doc.section_of(CONFIRM_SECTIONS, "search", "Blind search")
def _search(report: ConfirmReport) -> Iterator[doc.Block]:
    searches = report.result.searches
    if not searches:
        yield doc.Paragraph(
            "Two rolls show every planet twice: there the threshold at the known place decides, and nothing is "
            "searched blind."
        )
        return
    caption = (
        "What the search names in the first realisation of each band. The planets of the scene are told afterwards, by "
        "their places; a detection that is none of them is a false one or another star. Detections elsewhere are those "
        "of all realisations that are no planet of the scene."
    )
    rows: list[_Candidate] = []
    for search in searches:
        rows += [(search, item) for item in search.candidates] or [(search, None)]
    yield doc.table("Blind search", caption, _SEARCHED, rows)


def _with_error(value: float, error: float, places: int) -> str:
    return f"{decimals(value, places)} ± {decimals(error, places)}"


_POSITIONS: tuple[doc.Column[results.PositionRecord], ...] = (
    doc.Column("Planet", lambda item: item.planet, look="row left"),
    doc.Column("Bands", lambda item: ", ".join(item.bands), look="left"),
    doc.Column("Separation", lambda one: _with_error(one.separation_arcsec, one.separation_error_arcsec, 4), "arcsec"),
    doc.Column("true", lambda item: decimals(item.true_separation_arcsec, 4)),
    doc.Column("PA", lambda item: _with_error(item.pa_deg, item.pa_error_deg, 2), "deg"),
    doc.Column("true", lambda item: decimals(item.true_pa_deg, 2)),
)


def _interval(median: float, interval: Sequence[float]) -> str:
    return f"{decimals(median, 2)}; {decimals(interval[0], 2)} to {decimals(interval[1], 2)}"


_ALBEDOS: tuple[doc.Column[results.AlbedoRecord], ...] = (
    doc.Column("Planet", lambda item: item.planet, look="row left"),
    doc.Column("Bands", lambda item: ", ".join(item.bands), look="left"),
    doc.Column("log10 M/H", lambda item: _interval(item.log10_mh, item.log10_mh_interval), "median; interval"),
    doc.Column("log10 f_sed", lambda item: _interval(item.log10_fsed, item.log10_fsed_interval), "median; interval"),
    doc.Column("Correlation", lambda item: decimals(item.correlation, 2)),
    doc.Column("χ²", lambda item: f"{decimals(item.chi2, 2)} ({item.degrees_of_freedom})", "degrees of freedom"),
    doc.Column("Standing", lambda item: ALBEDO_STATUS[item.status], look="left wide"),
)


@doc.section_of(CONFIRM_SECTIONS, "found", "Positions and albedos")
def _positions_and_albedos(report: ConfirmReport) -> Iterator[doc.Block]:
    result = report.result
    if result.positions:
        caption = "Fitted positions, first realisation that shows the planet in each band, mean of the bands."
        yield doc.table("Positions", caption, _POSITIONS, result.positions)
    if result.albedos:
        caption = (
            "Metallicity and clouds that fit the mean contrasts, with the errors of one observation a band; size, "
            "distance and phase of the planet are taken as known. Intervals hold 68 %; χ² is that of the best fit."
        )
        yield doc.table("Albedo fits", caption, _ALBEDOS, result.albedos)


@doc.section_of(CONFIRM_SECTIONS, "images", "Images")
def _images(report: ConfirmReport) -> Iterator[doc.Block]:
    if report.images:
        return image_figures.picture_blocks(report.images, report.images, report.result.scene)
    return iter([doc.Paragraph("No band was observed.")])


@doc.section_of(CONFIRM_SECTIONS, "figures", "Figures")
def _figures(report: ConfirmReport) -> Iterator[doc.Block]:
    for key, picture in report.figures.items():
        more = report.calibration if key == "calibration" else ""
        yield doc.Figure(picture, CONFIRM_FIGURES.get(key, key), more=more)


@doc.section_of(CONFIRM_SECTIONS, "assumptions", "Assumptions")
def _assumptions(report: ConfirmReport) -> Iterator[doc.Block]:
    result, library = report.result, LIBRARIES[report.result.reference_library]
    modes = f"{result.rdi_modes} mode{'s' * (result.rdi_modes != 1)} subtracted"
    yield doc.Facts(
        [
            ("Instrument", image_figures.instrument_fact(result)),
            ("Reference library", [f"{library.meaning} (", doc.code(library.name), f"); {modes}."]),
            (
                "Detection threshold",
                f"the false-alarm probability of {result.sigma:g}σ per resolution element. Predictions know the "
                f"planet's place; a realisation is a detection if {library.found}.",
            ),
        ]
    )


@doc.section_of(CONFIRM_SECTIONS, "modelled", "What was modelled")
def _modelled(report: ConfirmReport) -> Iterator[doc.Block]:
    return image_figures.modelled_blocks([(band.band, band.modelled) for band in report.result.bands if band.modelled])


@doc.section_of(CONFIRM_SECTIONS, "missing", "What is not modelled")
def _missing(report: ConfirmReport) -> Iterator[doc.Block]:
    return image_figures.not_modelled_blocks(report.result.not_modelled)


@doc.section_of(CONFIRM_SECTIONS, "glossary", "Glossary")
def _glossary(report: ConfirmReport) -> Iterator[doc.Block]:
    yield doc.Facts(terms(_WORDS))


@doc.section_of(CONFIRM_SECTIONS, "reproduce", "Reproducing this")
def _reproduce(report: ConfirmReport) -> Iterator[doc.Block]:
    note = doc.marked(f"Numbers in full: `confirm.json`; {image_figures.MEASURED_NOTE}")
    yield from doc.reproduced_blocks(report.result, note)
    yield doc.Items(prose()["credits"])
