"""Planets measured in simulated images: in words, on the terminal, and as reports of scenes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from operator import itemgetter
from typing import Any

from cpic_core import Record, Registry
from cpic_planner import results
from cpic_planner.queries import LIBRARIES
from cpic_planner.report import document as doc, words
from cpic_planner.report.drawing import Picture
from cpic_planner.report.image_figures import shown_in_both_lights
from cpic_planner.report.simulation import largest_errors, modelled_blocks
from cpic_planner.report.words import MISSING, count_text, counted, significant
from cpic_planner.results import BandConfirmation, CandidateRecord, SearchRecord
from simulator.knobs import Quantity


def calibration_sentence(result: results.ImagedResult) -> str:
    """Return predicted over recovered SNR and what it says; a bias is named only beyond two standard errors."""
    return words.sentence(result.calibration_text)


def outcome_text(bands: Sequence[BandConfirmation]) -> str:
    """Return whether images confirm planets: in how many bands, or that nothing was measured.

    Parameters
    ----------
    bands : sequence of BandConfirmation
        At least one: of one planet, or of several, each of whose bands counts.
    """
    images = "files" if any(band.drawn_as == "files" for band in bands) else "simulated images"
    if all(band.recovered_snr is None for band in bands):
        return f"not measured in {images}"
    found, tried = sum(bool(band.detected) for band in bands), len(bands)
    of = counted(tried, "band" if len({band.planet for band in bands}) == 1 else "measurement")
    where = bands[0].band if tried == 1 else f"{found or 'any'} of {of}"
    return f"{'' if found else 'not '}confirmed by {images} in {where}"


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
    if result.visits:
        return _file_sentences(result)
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


def _file_sentences(result: results.ConfirmResult) -> list[str]:
    """Return the summary of files that were measured, one sentence an item."""
    bands = list(dict.fromkeys(row.band for row in result.visits))
    frames = sum(row.n_frames for row in result.visits)
    moved = sum(row.moved or row.frames_moved > 0 for row in result.visits)
    placed = f"in {counted(moved, 'visit')} frames were moved" if moved else "the places of the headers hold"
    sentences = [
        f"{counted(frames, 'frame')} of {counted(len(result.visits), 'visit')} in {', '.join(bands)}, read from files, "
        f"registered ({placed}), reduced, {LIBRARIES[result.reference_library].searched}; the stack has the "
        "orientation of the detector.",
        *[f"{counted(len(result.sources), 'source')} detected."] * bool(result.searches),
    ]
    if result.bare:
        sentences.append("No scene is known of these files: nothing is compared with a prediction.")
    for band in result.bands:
        sentences.append(f"{band.planet} in {band.band}: {band.verdict or band.message}.")
    return sentences


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
"""Columns that are shown of each measurement; the rest is in the tables of planets and stars, and in the files."""


def measured_columns(layout: str, of: Callable[[Any], BandConfirmation], library: str) -> list[results.Column]:
    """Return the columns of measurements that `MEASURED` names; ``of`` takes one from an entry of the table."""

    def of_band(text: str | Callable[[BandConfirmation], doc.Inline]) -> Callable[[Any], doc.Inline]:
        return lambda entry: doc.cell(doc.own_column("", text), of(entry))

    def outcome_cell(item: BandConfirmation) -> str:
        if item.status != "ok":
            return doc.status_cell(item.status, item.reason)
        if item.detected:
            return f"{words.STATUS_SYMBOLS['ok']} confirmed"
        at_place = 2 * (item.n_significant or 0) >= (item.realisations or 1)
        return f"{words.STATUS_SYMBOLS['unreachable']} {'seen at its place' if at_place else 'not found'}"

    legend = f"realisations in which {LIBRARIES[library].found}"
    seen = "seen at its place means significant there, but not found blind"
    counts: dict[str, Any] = {"fields": "n_detected realisations", "of": (BandConfirmation, of), "legend": legend}
    return doc.row_columns(
        BandConfirmation,
        layout,
        of=of,
        n_detected=doc.own_column("found", of_band("{n_detected}/{realisations}"), **counts),
        recovered_contrast=of_band("{recovered_contrast:.2e} ± {contrast_error:.0e}"),
        outcome=doc.own_column("outcome", of_band(outcome_cell), look="left", legend=seen),
    )


def comparison_blocks(result: results.ImagedResult, bands: Sequence[BandConfirmation]) -> Iterator[doc.Block]:
    """Yield what is altered in the images, how they compare with the prediction, and where a tier is not enough."""
    yield from doc.notes(overrides_sentence(result), look="altered")
    yield from doc.notes(calibration_sentence(result), look="lead")
    invalid = dict.fromkeys(f"{band.band}: {band.message}" for band in bands if band.status == "invalid")
    yield from doc.notes(*invalid, look="")


def confirm_blocks(result: results.ConfirmResult, *, full: bool = True) -> Iterator[doc.Block]:
    """Yield measurements, blind candidates, positions and albedo fits of a scene, as a terminal shows them.

    Parameters
    ----------
    result : ConfirmResult
    full : bool
        Also how images were made.
    """
    names = ["files", "planets", *["search"] * bool(result.searches), "found"]
    yield from doc.parts(confirm_document(ConfirmReport(result, {}, {}, _SHOWN)), *names)
    yield from doc.notes(
        *dict.fromkeys(f"{one.band}: {one.message}" for one in result.bands if one.status == "invalid")
    )
    if full:
        yield from doc.notes(modelled_sentence(result.bands), setup_text(result))


def _scene_table(result: results.ConfirmResult) -> doc.Table:
    """Return a line for each planet and band of a scene."""
    several = len({item.planet for item in result.bands}) > 1
    layout = f"{'planet ' * several}band {MEASURED.format(more=' true_contrast/7 recovered_contrast/2')}"
    columns = measured_columns(layout, doc.itself, result.reference_library)
    rows = sorted(result.bands, key=lambda item: item.planet) if several else result.bands
    drawn = "" if result.visits else f", {counted(result.realisations, 'realisation')} a band"
    title = f"{result.scene}: {outcome_text(rows)}{drawn}"
    return doc.Table(title, columns, rows, legend=True)


_SHOWN = 5
"""Candidates of a band on a terminal."""
_Candidate = tuple[SearchRecord, CandidateRecord | None]


def _search_blocks(searches: Sequence[SearchRecord], most: int | None = None) -> Iterator[doc.Block]:
    """Yield what blind searches name in the first realisation: the clearest, all detections and planets at first."""

    def name(row: _Candidate) -> str:
        item = row[1]
        if item is None:
            return "nothing"
        known = row[0].false_detections is not None
        return item.planet or (
            ("no planet of the scene" if known else "detected") if item.detected else "below the threshold"
        )

    rows: list[_Candidate] = []
    for search in searches:
        named = sorted(search.candidates, key=lambda item: -item.snr)
        first = [item for number, item in enumerate(named) if item.detected or item.planet or number == 0]
        rows += [(search, item) for item in (named if most is None else first[:most])] or [(search, None)]
    columns = [
        *doc.row_columns(SearchRecord, "band visits frames/2 em_gain/2 resolution_elements:page", of=itemgetter(0)),
        *doc.row_columns(CandidateRecord, "separation_arcsec pa_deg snr threshold/1", of=itemgetter(1)),
        doc.own_column("is", name, look="left"),
    ]
    told = [search for search in searches if search.false_detections is not None]
    if not told:
        yield doc.Table("What the blind search names", columns, rows, last_width=30)
        return
    title = "What the blind search names, first realisation"
    yield doc.Table(title, columns, rows, words.text("texts.search"), last_width=30)
    elsewhere = sum(search.false_detections or 0 for search in told)
    total = sum(search.realisations for search in told)
    word = "detection that is" if elsewhere == 1 else "detections that are"
    yield doc.Paragraph(f"{elsewhere} {word} no planet of the scene, in {total} searches.", "note")


def _fitted_blocks(result: results.ConfirmResult) -> Iterator[doc.Block]:
    """Yield fitted positions, and what contrasts say of metallicity and clouds."""
    positions = [
        doc.own_column("planet", "{planet}", look="row left"),
        doc.own_column("sep ″", "{separation_arcsec:.4f} ± {separation_error_arcsec:.4f}"),
        doc.own_column("true", "{true_separation_arcsec:.4f}"),
        doc.own_column("PA deg", "{pa_deg:.2f} ± {pa_error_deg:.2f}"),
        doc.own_column("true", "{true_pa_deg:.2f}"),
        doc.own_column("bands", "{bands}", look="left"),
    ]
    albedos = [
        doc.own_column("planet", "{planet}", look="row left"),
        doc.own_column("log10 M/H", "{log10_mh:.2f} ({log10_mh_interval.0:.2f} to {log10_mh_interval.1:.2f})"),
        doc.own_column("log10 f_sed", "{log10_fsed:.2f} ({log10_fsed_interval.0:.2f} to {log10_fsed_interval.1:.2f})"),
        doc.own_column("correlation", "{correlation:.2f}"),
        doc.own_column("χ² (degrees)", "{chi2:.2f} ({degrees_of_freedom})", way=1),
        doc.own_column("bands", "{bands}", look="left", way=2),
        doc.own_column("standing", lambda item: words.ALBEDO_STATUS[item.status], look="left wide"),
    ]
    if result.positions:
        caption = "Fitted positions, first realisation that shows the planet in each band, mean of the bands."
        yield doc.Table("Measured places, beside the true ones", positions, result.positions, caption)
    if result.albedos:
        caption = words.text("texts.albedo_fits")
        yield doc.Table("Metallicity and clouds", albedos, result.albedos, caption, last_width=60)


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


def _quantities() -> list[results.Column]:
    """Return what is told of each measurement, one quantity a column."""

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

    place = "{found_separation_arcsec:.4f} ± {found_separation_error_arcsec:.4f}″"
    found = f"{place}\nPA {{found_pa_deg:.2f}} ± {{found_pa_error_deg:.2f}}°"
    return doc.row_columns(
        BandConfirmation,
        "outcome separation_arcsec pa_deg frames em_gain integration_s time_s realisations predicted_error "
        "predicted_snr recovered_snr etc_ratio predicted_significance recovered_significance threshold n_detected "
        "search_snr search_threshold n_significant false_detections found true_contrast recovered_contrast "
        "contrast_error star_flux rdi_throughput rdi_modes_used core_throughput n_background_apertures "
        "saturated_in_hole saturated_outside verdict",
        outcome=doc.own_column("outcome", outcome),
        realisations=realisations,
        predicted_error=doc.own_column("predicted error of the images", predicted_error, "beside the reference"),
        n_detected="{n_detected} of {realisations}",
        n_significant="{n_significant} of {realisations}",
        found=doc.own_column("found at", found, "first realisation that finds it"),
        contrast_error=doc.own_column(
            "its error", "± {contrast_error:.1e}\n± {contrast_mean_error:.1e}", "one observation; mean"
        ),
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

    def column(band: BandConfirmation) -> results.Column:
        picked = band.band == chosen
        heading = f"{band.band} (chosen)" if picked else band.band
        return doc.own_column(heading, lambda quantity: doc.cell(quantity, band), look="pick" if picked else "")

    def named(quantity: results.Column) -> doc.Inline:
        unit = doc.unit_shown(quantity)
        return [doc.name_shown(quantity), " ", doc.small(f"({unit})")] if unit else doc.name_shown(quantity)

    text = f"{caption} Recovered numbers are those of one observation, averaged over the realisations."
    if any(band.search_threshold is not None for band in bands):
        text = f"{text} {words.prose()['two_statistics']}"
    columns = [doc.own_column("quantity", named, look="row left"), *map(column, bands)]
    return doc.Table(f"Bands of {name}", columns, _quantities(), text, look="bands")


def audit_blocks(name: str, bands: Iterable[BandConfirmation]) -> Iterator[doc.Block]:
    """Yield the table of the realisations that were run frame by frame, if there are any."""
    if audited := [(band, band.audit) for band in bands if band.audit is not None]:
        columns = doc.row_columns(
            results.AuditRecord,
            "band:row planet/9 frames_run frames_in_all/3 predicted_snr/2 recovered_snr true_contrast/4 contrast "
            "deviation_sigma false_detections/5 hits/9 rejected_fraction/8 saturated_in_hole/7 saturated_outside/6 "
            "detected",
            of=itemgetter(1),
            band=doc.own_column("band", "{0.band}", look="left"),
            planet=doc.own_column("planet", "{0.planet}", look="left"),
            true_contrast=doc.own_column("true contrast", "{0.true_contrast:.2e}"),
            detected=lambda case: doc.badge(*(("ok", "found") if case[1].detected else ("unreachable", "not found"))),
        )
        yield doc.Table(f"Frame by frame, {name}", columns, audited, words.text("texts.audit"))


def picture_blocks(images: Mapping[str, Picture], keys: Iterable[str], name: str) -> Iterator[doc.Block]:
    """Yield image panels, those that there are of some keys, and before them how to read them."""
    shown = [shown_in_both_lights(images[key]) for key in keys if key in images]
    if shown:
        yield doc.Paragraph(words.text("texts.panels"), "note")
    yield from (doc.Figure(picture, before=name) for picture in shown)


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


class ConfirmReport(Record):
    """The contents of the report of a confirmed scene.

    Attributes
    ----------
    result : ConfirmResult
    figures : mapping of str to Picture
        By the keys of `CONFIRM_FIGURES`, or by a title.
    images : mapping of str to Picture
        Image panels by band.
    most : int, optional
        Most candidates of a band that are told; all by default.
    """

    result: results.ConfirmResult
    figures: Mapping[str, Picture]
    images: Mapping[str, Picture]
    most: int | None = None

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
    library = LIBRARIES[result.reference_library]
    about = words.text("texts.confirm_about", library=library)
    if result.visits:
        about = words.text("texts.files_about", library=library)
    return doc.document_of(
        CONFIRM_SECTIONS,
        report,
        title=f"CPI-C: {heading}, configuration {result.config_hash}",
        heading=heading,
        about=about,
        summary=summary,
    )


@doc.section_of(CONFIRM_SECTIONS, "files", "Files and sources")
def _files(report: ConfirmReport) -> Iterator[doc.Block]:
    result = report.result
    if not result.visits:
        return
    layout = "band source separation_arcsec pa_deg rate_e_s contrast/1 search_snr search_threshold"
    columns = doc.row_columns(
        results.SourceRecord,
        layout,
        separation_arcsec="{separation_arcsec:.4f} ± {separation_error_arcsec:.4f}",
        pa_deg="{pa_deg:.2f} ± {pa_error_deg:.2f}",
        rate_e_s="{rate_e_s:.3g} ± {rate_error_e_s:.2g}",
        contrast="{contrast:.2e} ± {contrast_error:.0e}",
    )
    if result.sources:
        yield doc.Table("Sources that the search detects", columns, result.sources, words.text("texts.sources"))
    elif result.searches:
        yield doc.Paragraph("The search detects no source.")
    read = "band role visit n_frames roll_deg shift_x_pixel shift_y_pixel moved frames_moved"
    columns = doc.row_columns(
        results.ProductVisitRecord,
        read,
        shift_x_pixel="{shift_x_pixel:.4f} ± {shift_x_error_pixel:.4f}",
        shift_y_pixel="{shift_y_pixel:.4f} ± {shift_y_error_pixel:.4f}",
    )
    yield doc.Table("Visits that were read", columns, result.visits, words.text("texts.registered"))


@doc.section_of(CONFIRM_SECTIONS, "planets", "Planets")
def _planets(report: ConfirmReport) -> Iterator[doc.Block]:
    by_planet: dict[str, list[BandConfirmation]] = {}
    for item in report.result.bands:
        by_planet.setdefault(item.planet, []).append(item)
    if by_planet:
        yield _scene_table(report.result)
    for number, (name, bands) in enumerate(by_planet.items(), 1):
        yield doc.Group(f"planet-{number}", name, [measure_table(name, bands, f"{name} by band.")])
    yield from audit_blocks(report.result.scene, report.result.bands)


@doc.section_of(CONFIRM_SECTIONS, "search", "Blind search")
def _search(report: ConfirmReport) -> Iterator[doc.Block]:
    searches = report.result.searches
    return _search_blocks(searches, report.most) if searches else iter([doc.Paragraph(words.text("texts.no_search"))])


@doc.section_of(CONFIRM_SECTIONS, "found", "Positions and albedos")
def _found(report: ConfirmReport) -> Iterator[doc.Block]:
    return _fitted_blocks(report.result)


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
    if report.result.visits:
        return iter(())
    return modelled_blocks([(band.band, band.modelled) for band in report.result.bands if band.modelled])


@doc.section_of(CONFIRM_SECTIONS, "missing", "What is not modelled")
def _missing(report: ConfirmReport) -> Iterator[doc.Block]:
    if report.result.visits:
        return iter(())
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
