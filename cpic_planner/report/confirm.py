"""Planets measured in simulated images: in words, on the terminal, and as reports of scenes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from cpic_core import Registry
from cpic_planner import results
from cpic_planner.queries import LIBRARIES
from cpic_planner.report import document as doc, words
from cpic_planner.report.cells import Cells, frames_text, print_note, print_plain, print_table, row_cells, status_cell
from cpic_planner.report.drawing import Picture
from cpic_planner.report.image_figures import shown_in_both_lights
from cpic_planner.report.simulation import ModelledGroup, ModelledRow, largest_errors, modelled_groups
from cpic_planner.report.words import MISSING, contrast_text, count_text, counted, decimals, significant
from cpic_planner.results import BandConfirmation, CandidateRecord, ModellingRecord, SearchRecord
from simulator.knobs import Quantity

if TYPE_CHECKING:
    from rich.console import Console


def calibration_sentence(result: results.ImagedResult) -> str:
    """Return predicted over recovered SNR and what it says; a bias is named only beyond two standard errors."""
    return words.sentence(result.calibration_text)


def outcome_text(bands: Sequence[BandConfirmation]) -> str:
    """Return whether simulated images confirm planets: in how many bands, or that nothing was measured.

    Parameters
    ----------
    bands : sequence of BandConfirmation
        At least one: of one planet, or of several, each of whose bands counts.
    """
    if all(band.recovered_snr is None for band in bands):
        return "not measured in simulated images"
    found, tried = sum(bool(band.detected) for band in bands), len(bands)
    of = counted(tried, "band" if len({band.planet for band in bands}) == 1 else "measurement")
    where = bands[0].band if tried == 1 else f"{found or 'any'} of {of}"
    return f"{'' if found else 'not '}confirmed by simulated images in {where}"


def overrides_sentence(result: results.ImagedResult) -> str:
    """Return what is altered in the images; empty if nothing is."""
    altered = words.overrides_text(result.simulator_overrides)
    return f"Images altered: {altered}. Predictions are nominal." if altered else ""


def setup_text(result: results.ImagedResult) -> str:
    """Return what images are to be made again with."""
    return f"Seed {result.seed}, {words.dial_text(result)}, configuration {result.config_hash}."


def _confirm_sentences(result: results.ConfirmResult) -> list[str]:
    """Return the summary of a confirmed scene, one sentence an item."""
    planets = list(dict.fromkeys(band.planet for band in result.bands))
    bands = list(dict.fromkeys([*(search.band for search in result.searches), *(band.band for band in result.bands)]))
    sentences = [
        f"{counted(len(planets), 'planet')} in {', '.join(bands) or 'no band'}, "
        f"{counted(result.realisations, 'realisation')} each: simulated, reduced, "
        f"{LIBRARIES[result.reference_library].searched}."
    ]
    for planet in planets:
        own = [band for band in result.bands if band.planet == planet]
        measured = [band for band in own if band.recovered_snr is not None]
        detected = [f"{one.band} ({one.n_detected} of {one.realisations})" for one in measured if one.detected]
        if measured:
            sentences.append(f"{planet} is found in {', '.join(detected) or 'no band'}.")
        else:
            sentences.append(f"{planet} was not observed: {', '.join(sorted({band.message for band in own}))}.")
    if not planets:
        sentences.append("The scene has no planet in the field: there is nothing to compare with a prediction.")
    return [*sentences, *programme_sentences(result)]


def programme_sentences(result: results.ConfirmResult) -> list[str]:
    """Return for whom visits and frames of a scene were chosen, and what they leave unused of the time."""
    every: list[SearchRecord | BandConfirmation] = [*result.searches, *result.bands]
    rows = {row.band: row for row in every if row.exposure_s is not None}
    chosen: dict[str, list[str]] = {}
    for row in rows.values():
        if row.chosen_for:
            each = row.frames_per_visit if isinstance(row, BandConfirmation) else row.n_frames
            visits = f"{counted(row.visits or 1, 'visit')} of {each} × {significant(row.exposure_s)} s"
            chosen.setdefault(row.chosen_for, []).append(f"{row.band} {visits}")
    said = [
        f"Programme of highest SNR for {name}, as cpic etc chooses it: {', '.join(each)}."
        for name, each in chosen.items()
    ]
    unused = words.unused_text(rows.values())
    return [*said, *[f"{unused}."] * bool(unused)]


def modelled_sentence(bands: Iterable[BandConfirmation]) -> str:
    """Return how images were drawn and the largest error that is predicted of them; empty without images."""
    made = [band.modelled for band in bands if band.modelled is not None and band.status != "invalid"]
    if not made:
        return ""
    ways = " and ".join(words.WORDS["draws"][draw] for draw in sorted({item.draw for item in made}))
    return f"Images: {ways}; predicted error beside the reference: {words.error_text(largest_errors(made))}."


MEASURED = (
    "separation_arcsec/3 visits frames/4 em_gain/6 time_s/5 predicted_snr/1 recovered_snr/1 etc_ratio n_detected{more} "
    "outcome"
)
"""What is shown of each measurement on the terminal; the rest is in the files."""


def measured_cells(layout: str, of: Callable[[Any], BandConfirmation], library: str) -> list[Cells]:
    """Return the columns of measurements that `MEASURED` names; ``of`` takes one from an entry of the table."""

    def found(row: Any) -> str:
        return MISSING if of(row).n_detected is None else f"{of(row).n_detected}/{of(row).realisations}"

    def recovered(row: Any) -> str:
        value, error = of(row).recovered_contrast, of(row).contrast_error
        return MISSING if value is None or error is None else f"{value:.2e} ± {error:.0e}"

    def outcome(row: Any) -> str:
        item = of(row)
        if item.status != "ok":
            return status_cell(item.status, item.reason)
        if item.detected:
            return f"{words.STATUS_SYMBOLS['ok']} confirmed"
        at_place = 2 * (item.n_significant or 0) >= (item.realisations or 1)
        return f"{words.STATUS_SYMBOLS['unreachable']} {'seen at its place' if at_place else 'not found'}"

    legend = f"realisations in which {LIBRARIES[library].found}"
    seen = "seen at its place means significant there, but not found blind"
    return row_cells(
        BandConfirmation,
        layout,
        of=of,
        n_detected=Cells("found", found, legend=legend, fields=("n_detected", "realisations")),
        recovered_contrast=recovered,
        outcome=Cells("outcome", outcome, right=False, legend=seen),
    )


def print_comparison(
    result: results.ImagedResult, bands: Sequence[BandConfirmation], console: Console, *, measured: bool = True
) -> None:
    """Print what is altered in the images, how they compare with the prediction, and where a tier is not enough."""
    if altered := overrides_sentence(result):
        print_plain(console, altered, bold=True)
    if measured:
        print_plain(console, calibration_sentence(result), bold=True)
    print_plain(console, *dict.fromkeys(f"{band.band}: {band.message}" for band in bands if band.status == "invalid"))


_SHOWN = 5


def print_confirm(result: results.ConfirmResult, console: Console, *, full: bool = True) -> None:
    """Print measurements, blind candidates, positions and albedo fits of a scene, and how the ETC stands.

    Parameters
    ----------
    result : ConfirmResult
    console : Console
    full : bool
        Also what was run frame by frame, and how images were made.
    """
    several = len({item.planet for item in result.bands}) > 1
    layout = f"{'planet ' * several}band {MEASURED.format(more=' true_contrast/7 recovered_contrast/2')}"
    cells = measured_cells(layout, lambda item: item, result.reference_library)
    rows = sorted(result.bands, key=lambda item: item.planet) if several else result.bands
    if rows:
        title = f"{result.scene}: {outcome_text(rows)}, {counted(result.realisations, 'realisation')} a band"
        print_table(console, title, cells, rows, explained=True, legend=not full)
    else:
        print_plain(console, f"{result.scene}: no planet, {LIBRARIES[result.reference_library].searched}", bold=True)
    if full:
        print_plain(console, *_audit_lines(result.bands))
    if result.searches:
        _print_searches(result.searches, console)
    print_note(console, *programme_sentences(result))
    if result.positions:
        print_table(console, "Measured places, beside the true ones", _PLACES, result.positions)
    print_plain(console, *map(albedo_text, result.albedos))
    print_comparison(result, result.bands, console, measured=bool(rows))
    if full:
        print_note(console, *filter(None, [modelled_sentence(result.bands)]), setup_text(result))


def _audit_lines(bands: Sequence[BandConfirmation]) -> Iterator[str]:
    """Yield what came of the realisations that were run frame by frame."""
    for item, audit in ((band, band.audit) for band in bands if band.audit is not None):
        run = f"{audit.frames_run} of {audit.frames_in_all} frames one by one"
        snr = f"SNR {significant(audit.recovered_snr)} ({significant(audit.predicted_snr)} predicted)"
        off = f"contrast off by {decimals(audit.deviation_sigma, 1)} of its errors"
        found = "found" if audit.detected else "not found"
        yield f"{item.planet}, {item.band}, with every effect ({run}): {snr}, {off}, {found}"


_Candidate = tuple[SearchRecord, CandidateRecord | None]


def _print_searches(searches: list[SearchRecord], console: Console) -> None:
    def name(row: _Candidate) -> str:
        item = row[1]
        if item is None:
            return "nothing"
        return item.planet or ("no planet of the scene" if item.detected else "below the threshold")

    rows: list[_Candidate] = []
    for search in searches:
        named = sorted(search.candidates, key=lambda item: -item.snr)
        shown = [item for number, item in enumerate(named) if item.detected or item.planet or number == 0][:_SHOWN]
        rows += [(search, item) for item in shown] or [(search, None)]
    cells = [
        *row_cells(SearchRecord, "band visits frames/2 em_gain/2", of=itemgetter(0)),
        *row_cells(CandidateRecord, "separation_arcsec pa_deg snr threshold/1", of=itemgetter(1)),
        Cells("is", name, right=False),
    ]
    elsewhere = sum(search.false_detections for search in searches)
    total = sum(search.realisations for search in searches)
    print_table(console, "What the blind search names, first realisation", cells, rows, last_width=30)
    word = "detection that is" if elsewhere == 1 else "detections that are"
    print_note(console, f"{elsewhere} {word} no planet of the scene, in {total} searches.")


def _with_error(value: float, error: float, places: int) -> str:
    return f"{decimals(value, places)} ± {decimals(error, places)}"


_PLACES = [
    Cells("planet", lambda item: item.planet, right=False),
    Cells("sep ″", lambda item: _with_error(item.separation_arcsec, item.separation_error_arcsec, 4)),
    Cells("true", lambda item: decimals(item.true_separation_arcsec, 4)),
    Cells("PA deg", lambda item: _with_error(item.pa_deg, item.pa_error_deg, 2)),
    Cells("true", lambda item: decimals(item.true_pa_deg, 2)),
    Cells("bands", lambda item: ", ".join(item.bands), right=False),
]


def albedo_text(albedo: results.AlbedoRecord) -> str:
    """Return what contrasts say of metallicity and clouds."""
    about = {"bands": ", ".join(albedo.bands), "status": words.ALBEDO_STATUS[albedo.status]}
    return words.text("texts.albedo", albedo=albedo, **about)


MEASURED_NOTE = "measurements as a table: `measurements.csv`. Times, host and package versions of the run: `run.json`."
"""Which files have the measurements and the story of a run."""


def instrument_fact(result: results.ImagedResult) -> doc.Inline:
    """Return which instrument images and predictions are of, and how the images are made."""
    preset = "Every default value has its source and confidence in the instrument preset."
    return [doc.code(result.instrument), f", {words.dial_text(result)}. {preset}"]


def outcome(band: BandConfirmation) -> doc.Mark:
    """Return the badge of what became of a planet in the images of a band."""
    if band.status != "ok":
        return doc.badge(band.status, words.status_text(band.status))
    return doc.badge("ok", "detected") if band.detected else doc.badge("unreachable", "not detected")


def _quantities() -> list[doc.Column[BandConfirmation]]:
    """Return the rows of the table of measurements, one a quantity."""

    def of_realisations(name: str) -> Callable[[BandConfirmation], str]:
        return lambda band: MISSING if getattr(band, name) is None else f"{getattr(band, name)} of {band.realisations}"

    def contrast_error(band: BandConfirmation) -> doc.Inline:
        if band.contrast_error is None:
            return MISSING
        return doc.lines(*(f"± {contrast_text(error, 2)}" for error in (band.contrast_error, band.contrast_mean_error)))

    def position(band: BandConfirmation) -> doc.Inline:
        if band.found_separation_arcsec is None:
            return MISSING
        return doc.lines(
            f"{decimals(band.found_separation_arcsec, 4)} ± {decimals(band.found_separation_error_arcsec, 4)}″",
            f"PA {decimals(band.found_pa_deg, 2)} ± {decimals(band.found_pa_error_deg, 2)}°",
        )

    def star_flux(band: BandConfirmation) -> str:
        error = "" if band.star_flux_error is None else f" ({words.percent_text(band.star_flux_error)})"
        return words.STAR_FLUX.get(band.star_flux, band.star_flux) + error if band.star_flux else MISSING

    def verdict(band: BandConfirmation) -> str:
        why = band.message or words.reason_text(band.reason)
        return words.plus_minus(band.verdict) + (f": {why}" if why else "")

    def predicted_error(band: BandConfirmation) -> str:
        return words.error_text(band.modelled.predicted_error) if band.modelled else MISSING

    def realisations(band: BandConfirmation) -> doc.Inline:
        drawn = words.DRAWN_AS[band.drawn_as] if band.drawn_as else ""
        return doc.lines(count_text(band.realisations), doc.small(drawn))

    return doc.row_columns(
        BandConfirmation,
        "outcome separation_arcsec pa_deg frames em_gain integration_s time_s realisations predicted_error "
        "predicted_snr recovered_snr etc_ratio predicted_significance recovered_significance threshold n_detected "
        "search_snr search_threshold n_significant false_detections found true_contrast recovered_contrast "
        "contrast_error star_flux rdi_throughput rdi_modes_used core_throughput n_background_apertures "
        "saturated_in_hole saturated_outside verdict",
        outcome=Cells("", outcome, label="outcome"),
        realisations=realisations,
        predicted_error=Cells("", predicted_error, label="predicted error of the images", unit="beside the reference"),
        n_detected=of_realisations("n_detected"),
        n_significant=of_realisations("n_significant"),
        found=Cells("", position, label="found at", unit="first realisation that finds it"),
        contrast_error=Cells("", contrast_error, label="its error", unit="one observation; mean"),
        star_flux=star_flux,
        verdict=verdict,
    )


def measure_table(name: str, bands: Sequence[BandConfirmation], caption: str, chosen: str | None = None) -> doc.Table:
    """Return what was predicted and measured, a row a quantity and a column a band.

    Parameters
    ----------
    name : str
        Target or planet.
    bands : sequence of BandConfirmation
    caption : str
        What the table is of.
    chosen : str, optional
        Band whose column is shaded.
    """

    def column(band: BandConfirmation) -> doc.Column[doc.Column[BandConfirmation]]:
        picked = band.band == chosen
        heading: doc.Inline = [band.band, " ", doc.small("(chosen)")] if picked else band.band
        return doc.Column(heading, lambda quantity: quantity.value(band), look="pick" if picked else "")

    def named(quantity: doc.Column[BandConfirmation]) -> doc.Inline:
        return [quantity.heading, " ", doc.small(f"({quantity.unit})")] if quantity.unit else quantity.heading

    first: doc.Column[doc.Column[BandConfirmation]] = doc.Column("Quantity", named, look="row left")
    text = f"{caption} Recovered numbers are those of one observation, averaged over the realisations."
    if any(band.search_threshold is not None for band in bands):
        text = f"{text} {words.prose()['two_statistics']}"
    return doc.table(f"Bands of {name}", text, [first, *map(column, bands)], _quantities(), look="bands")


def audit_blocks(name: str, bands: Iterable[BandConfirmation]) -> Iterator[doc.Block]:
    """Yield the table of the realisations that were run frame by frame, if there are any."""
    if audited := [(band, band.audit) for band in bands if band.audit is not None]:
        yield doc.row_table(
            f"Frame by frame, {name}",
            words.text("texts.audit"),
            results.AuditRecord,
            "band:row frames_run frames_in_all predicted_snr recovered_snr true_contrast contrast deviation_sigma "
            "detected false_detections hits rejected_fraction saturated_in_hole saturated_outside",
            audited,
            of=itemgetter(1),
            band=Cells("", lambda case: case[0].band, right=False, label="band"),
            true_contrast=Cells("", lambda case: contrast_text(case[0].true_contrast), label="true contrast"),
            detected=lambda case: _yes_or_no(case[1].detected, "found", "not found"),
        )


def _yes_or_no(found: bool, yes: str, no: str) -> doc.Mark:
    return doc.badge("ok", yes) if found else doc.badge("unreachable", no)


def picture_blocks(images: Mapping[str, Picture], keys: Iterable[str], name: str) -> Iterator[doc.Block]:
    """Yield image panels, those that there are of some keys, and before them how to read them."""
    shown = [shown_in_both_lights(images[key]) for key in keys if key in images]
    if shown:
        yield doc.Paragraph(words.text("texts.panels"), "note")
    yield from (doc.Figure(picture, before=name) for picture in shown)


_Effect = tuple[ModelledRow, Counter[str]]
"""One effect in all images of a report: its largest size, and what became of it in how many of them."""


def _effects(groups: Sequence[ModelledGroup]) -> list[_Effect]:
    """Return every effect once, largest first."""
    every: dict[str, list[tuple[ModelledGroup, ModelledRow]]] = {}
    for group in groups:
        for row in group.rows:
            every.setdefault(row.effect.effect, []).append((group, row))
    rows = []
    for found in every.values():
        group, row = max(found, key=lambda item: item[1].order)
        decisions: Counter[str] = Counter()
        for other, same in found:
            decisions[same.word] += len(other.names)
        alike = len({same.size for _, same in found}) == 1
        where = row.where or ("" if alike else group.names[0])
        rows.append((ModelledRow(row.effect, where, row.size, row.word), decisions))
    return sorted(rows, key=lambda item: -item[0].order)


def modelled_blocks(named: Sequence[tuple[str, ModellingRecord]]) -> Iterator[doc.Block]:
    """Yield how images were made, each distinct way in a paragraph, and a folded table of all effects."""

    def decision(item: _Effect) -> doc.Inline:
        """Return what became of an effect; where that differs between images, in how many."""
        row, decisions = item
        kept = "ok" if row.effect.decision == "kept" else "unreachable"
        others = ", ".join(f"{word} in {count}" for word, count in decisions.items())
        return doc.lines(doc.badge(kept, row.word), doc.small(others) if len(decisions) > 1 else "")

    groups = modelled_groups(named)
    if not groups:
        yield doc.Paragraph("No image was made.")
        return
    for group in groups:
        knobs = group.knobs[:1].upper() + group.knobs[1:]
        made = f": {', '.join(group.names)}. {knobs}. Predicted error beside the reference: {group.errors}."
        yield doc.Paragraph([doc.strong(group.title), made])
    columns: tuple[doc.Column[_Effect], ...] = (
        doc.Column("Effect", lambda item: item[0].effect.effect, look="row left"),
        doc.Column("Predicted size", lambda item: item[0].size or MISSING, "largest of flux and SNR"),
        doc.Column("Largest in", lambda item: item[0].where, look="left"),
        doc.Column("Modelled", decision, look="left"),
        doc.Column("How, or why not", lambda item: item[0].effect.reason, look="left wide"),
    )
    rows = _effects(groups)
    made_table = doc.table("Effects in the images", words.text("texts.modelled"), columns, rows)
    yield doc.Fold(f"All effects ({len(rows)})", [made_table])


def not_modelled_blocks(items: Sequence[str]) -> Iterator[doc.Block]:
    """Yield what neither images drawn as sums nor predictions hold."""
    yield doc.Items(items) if items else doc.Paragraph("Nothing is listed.")
    yield doc.Paragraph(words.text("texts.not_modelled"), "note")


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
    def calibration(self) -> str:
        """How the prediction holds; empty without planets."""
        return calibration_sentence(self.result) if self.result.bands else ""


CONFIRM_SECTIONS: Registry[doc.Section[ConfirmReport]] = Registry("section")
"""Sections of the report, in their order."""


def confirm_document(report: ConfirmReport) -> doc.Document:
    """Return the report of a confirmed scene."""
    result = report.result
    heading = f"{result.scene}: {outcome_text(result.bands)}" if result.bands else result.scene
    altered = overrides_sentence(result)
    summary = [doc.Paragraph(doc.strong(altered), "altered")] if altered else []
    summary.append(doc.Paragraph(" ".join(_confirm_sentences(result)), "lead"))
    if report.calibration:
        summary.append(doc.Paragraph(doc.strong(report.calibration), "lead"))
    return doc.document_of(
        CONFIRM_SECTIONS,
        report,
        title=f"CPI-C: {heading}, configuration {result.config_hash}",
        heading=heading,
        about=words.text("texts.confirm_about", library=LIBRARIES[result.reference_library]),
        summary=summary,
    )


@doc.section_of(CONFIRM_SECTIONS, "planets", "Planets")
def _planets(report: ConfirmReport) -> Iterator[doc.Block]:
    by_planet: dict[str, list[BandConfirmation]] = {}
    for item in report.result.bands:
        by_planet.setdefault(item.planet, []).append(item)
    for number, (name, bands) in enumerate(by_planet.items(), 1):
        blocks = [measure_table(name, bands, f"{name} by band."), *audit_blocks(name, bands)]
        yield doc.Group(f"planet-{number}", name, blocks)


@doc.section_of(CONFIRM_SECTIONS, "search", "Blind search")
def _search(report: ConfirmReport) -> Iterator[doc.Block]:
    def of_search(text: Callable[[SearchRecord], str]) -> Callable[[_Candidate], str]:
        """Return the cell of a search, in its first row alone."""
        return lambda row: text(row[0]) if row[1] is None or row[1] is row[0].candidates[0] else ""

    def of_candidate(text: Callable[[CandidateRecord], doc.Inline]) -> Callable[[_Candidate], doc.Inline]:
        return lambda row: MISSING if row[1] is None else text(row[1])

    def separation(row: _Candidate) -> doc.Inline | doc.Span:
        return doc.Span("nothing is named", 6) if row[1] is None else decimals(row[1].separation_arcsec, 3)

    searches = report.result.searches
    if not searches:
        yield doc.Paragraph(words.text("texts.no_search"))
        return
    elements = of_search(lambda search: count_text(round(search.resolution_elements)))
    elsewhere = of_search(lambda search: f"{search.false_detections} of {search.realisations}")
    detected = of_candidate(lambda item: _yes_or_no(item.detected, "detected", "below"))
    columns: tuple[doc.Column[_Candidate], ...] = (
        doc.Column("Band", lambda row: row[0].band, look="row left"),
        doc.Column("Frames × exposure", of_search(frames_text), "s"),
        doc.Column("EM gain", of_search(lambda search: significant(search.em_gain))),
        doc.Column("Resolution elements", elements),
        doc.Column("Detections elsewhere", elsewhere, "of searches"),
        doc.Column("Separation", separation, "arcsec"),
        doc.Column("PA", of_candidate(lambda item: decimals(item.pa_deg, 1)), "deg"),
        doc.Column("SNR", of_candidate(lambda item: significant(item.snr)), "matched filter"),
        doc.Column("Threshold", of_candidate(lambda item: significant(item.threshold))),
        doc.Column("Detected", detected, look="left"),
        doc.Column("Planet", of_candidate(lambda item: item.planet or MISSING), look="left"),
    )
    rows: list[_Candidate] = []
    for search in searches:
        rows += [(search, item) for item in search.candidates] or [(search, None)]
    yield doc.table("Blind search", words.text("texts.search"), columns, rows)


_POSITIONS: tuple[doc.Column[results.PositionRecord], ...] = (
    doc.Column("Planet", lambda item: item.planet, look="row left"),
    doc.Column("Bands", lambda item: ", ".join(item.bands), look="left"),
    doc.Column("Separation", lambda one: _with_error(one.separation_arcsec, one.separation_error_arcsec, 4), "arcsec"),
    doc.Column("true", lambda item: decimals(item.true_separation_arcsec, 4)),
    doc.Column("PA", lambda item: _with_error(item.pa_deg, item.pa_error_deg, 2), "deg"),
    doc.Column("true", lambda item: decimals(item.true_pa_deg, 2)),
)


def _interval(median: float, interval: Sequence[float]) -> str:
    return f"{decimals(median, 2)}; {words.interval_text(interval[0], interval[1])}"


_ALBEDOS: tuple[doc.Column[results.AlbedoRecord], ...] = (
    doc.Column("Planet", lambda item: item.planet, look="row left"),
    doc.Column("Bands", lambda item: ", ".join(item.bands), look="left"),
    doc.Column("log10 M/H", lambda item: _interval(item.log10_mh, item.log10_mh_interval), "median; interval"),
    doc.Column("log10 f_sed", lambda item: _interval(item.log10_fsed, item.log10_fsed_interval), "median; interval"),
    doc.Column("Correlation", lambda item: decimals(item.correlation, 2)),
    doc.Column("χ²", lambda item: f"{decimals(item.chi2, 2)} ({item.degrees_of_freedom})", "degrees of freedom"),
    doc.Column("Standing", lambda item: words.ALBEDO_STATUS[item.status], look="left wide"),
)


@doc.section_of(CONFIRM_SECTIONS, "found", "Positions and albedos")
def _positions_and_albedos(report: ConfirmReport) -> Iterator[doc.Block]:
    result = report.result
    if result.positions:
        caption = "Fitted positions, first realisation that shows the planet in each band, mean of the bands."
        yield doc.table("Positions", caption, _POSITIONS, result.positions)
    if result.albedos:
        yield doc.table("Albedo fits", words.text("texts.albedo_fits"), _ALBEDOS, result.albedos)


@doc.section_of(CONFIRM_SECTIONS, "images", "Images")
def _images(report: ConfirmReport) -> Iterator[doc.Block]:
    if report.images:
        return picture_blocks(report.images, report.images, report.result.scene)
    return iter([doc.Paragraph("No band was observed.")])


@doc.section_of(CONFIRM_SECTIONS, "figures", "Figures")
def _figures(report: ConfirmReport) -> Iterator[doc.Block]:
    for key, picture in report.figures.items():
        more = report.calibration if key == "calibration" else ""
        yield doc.Figure(picture, CONFIRM_FIGURES.get(key, key), more=more)


@doc.section_of(CONFIRM_SECTIONS, "assumptions", "Assumptions")
def _assumptions(report: ConfirmReport) -> Iterator[doc.Block]:
    result, library = report.result, LIBRARIES[report.result.reference_library]
    subtracted = f"{counted(result.rdi_modes, 'mode')} subtracted."
    yield doc.Facts(
        [
            ("Instrument", instrument_fact(result)),
            ("Reference library", [f"{library.meaning} (", doc.code(library.name), f"); {subtracted}"]),
            ("Detection threshold", words.text("texts.confirm_threshold", sigma=result.sigma, found=library.found)),
        ]
    )


@doc.section_of(CONFIRM_SECTIONS, "modelled", "What was modelled")
def _modelled(report: ConfirmReport) -> Iterator[doc.Block]:
    return modelled_blocks([(band.band, band.modelled) for band in report.result.bands if band.modelled])


@doc.section_of(CONFIRM_SECTIONS, "missing", "What is not modelled")
def _missing(report: ConfirmReport) -> Iterator[doc.Block]:
    return not_modelled_blocks(report.result.not_modelled)


@doc.section_of(CONFIRM_SECTIONS, "glossary", "Glossary")
def _glossary(report: ConfirmReport) -> Iterator[doc.Block]:
    yield doc.Facts(words.terms(_WORDS))


@doc.section_of(CONFIRM_SECTIONS, "reproduce", "Reproducing this")
def _reproduce(report: ConfirmReport) -> Iterator[doc.Block]:
    yield from doc.reproduced_blocks(report.result, doc.marked(f"Numbers in full: `confirm.json`; {MEASURED_NOTE}"))
    yield doc.Items(words.prose()["credits"])


_MODEL_COLUMNS = ("fidelity", "region", "epochs")
_KNOB_COLUMNS = ("pupil_samples", "wavelength_nodes", "pixel_nodes", "precision")
_ERROR_COLUMNS: tuple[Quantity, ...] = ("planet_flux", "snr")
MEASUREMENT_COLUMNS: tuple[str, ...] = (
    "target",
    "hip",
    "chosen",
    *(name for name in results.names_of(BandConfirmation) if name != "image"),
    *_MODEL_COLUMNS,
    *_KNOB_COLUMNS,
    *(f"predicted_error_{name}" for name in _ERROR_COLUMNS),
    *results.names_of(results.AuditRecord, before="audit_"),
)
"""Columns, in order: those of `BandConfirmation`, of its `ModellingRecord`, and, with ``audit_`` before their names, of
`AuditRecord`."""


def measurements_csv(result: results.PlanResult | results.StarImagesResult | results.ConfirmResult) -> str:
    """Return one line for each planet and band; units stand in the names, missing numbers are empty."""
    if isinstance(result, results.ConfirmResult):
        rows = [_band_values(band) | {"target": result.scene} for band in result.bands]
    else:
        rows = [
            _band_values(band) | {"target": target.name, "hip": target.hip, "chosen": band.band == target.chosen_band}
            for target in result.targets
            for band in target.bands
        ]
    return results.csv_text(MEASUREMENT_COLUMNS, rows)


def _band_values(band: BandConfirmation) -> dict[str, Any]:
    cells = results.values_of(band)
    if (made := band.modelled) is not None:
        cells |= {name: getattr(made, name) for name in _MODEL_COLUMNS}
        cells |= {name: getattr(made.knobs, name) for name in _KNOB_COLUMNS}
        cells |= {f"predicted_error_{name}": made.predicted_error.get(name) for name in _ERROR_COLUMNS}
    return cells | ({} if band.audit is None else results.values_of(band.audit, before="audit_"))
