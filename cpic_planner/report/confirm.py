"""Planets measured in simulated images: in words, on the terminal, and as reports of scenes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from cpic_core import Registry
from cpic_planner import results
from cpic_planner.registry import LIBRARIES
from cpic_planner.report import document as doc
from cpic_planner.report.cells import Cells, frames_text, print_note, print_plain, print_table, row_cells, status_cell
from cpic_planner.report.drawing import Picture
from cpic_planner.report.image_figures import PANEL_NOTE, shown_in_both_lights
from cpic_planner.report.words import (
    ALBEDO_STATUS,
    DRAWN_AS,
    LEAST_SIZE,
    MISSING,
    STAR_FLUX,
    STATUS_SYMBOLS,
    _percent,
    contrast_text,
    count_text,
    counted,
    decimals,
    dial_text,
    duration_text,
    error_text,
    orbits_text,
    overrides_text,
    percent_text,
    plus_minus,
    prose,
    reason_text,
    sentence,
    significant,
    status_text,
    terms,
    unused_text,
)
from simulator.knobs import Quantity

if TYPE_CHECKING:
    from rich.console import Console


def calibration_sentence(result: results.ImagedResult) -> str:
    """Return predicted over recovered SNR and what it says; a bias is named only beyond two standard errors."""
    return sentence(result.calibration_text)


def outcome_text(bands: Sequence[results.BandConfirmation]) -> str:
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
    altered = overrides_text(result.simulator_overrides)
    return f"Images altered: {altered}. Predictions are nominal." if altered else ""


def confirm_sentences(result: results.ConfirmResult) -> list[str]:
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
        if not measured:
            sentences.append(f"{planet} was not observed: {', '.join(sorted({band.message for band in own}))}.")
            continue
        detected = [f"{one.band} ({one.n_detected} of {one.realisations})" for one in measured if one.detected]
        sentences.append(f"{planet} is found in {', '.join(detected) or 'no band'}.")
    if not planets:
        sentences.append("The scene has no planet in the field: there is nothing to compare with a prediction.")
    return [*sentences, *programme_sentences(result)]


def programme_sentences(result: results.ConfirmResult) -> list[str]:
    """Return for whom visits and frames of a scene were chosen, and what they leave unused of the time."""
    every: list[results.SearchRecord | results.BandConfirmation] = [*result.searches, *result.bands]
    rows = {row.band: row for row in every if row.exposure_s is not None}
    chosen: dict[str, list[str]] = {}
    for row in rows.values():
        if row.chosen_for:
            each = row.frames_per_visit if isinstance(row, results.BandConfirmation) else row.n_frames
            text = f"{row.band} {counted(row.visits or 1, 'visit')} of {each} × {significant(row.exposure_s)} s"
            chosen.setdefault(row.chosen_for, []).append(text)
    said = [
        f"Programme of highest SNR for {name}, as cpic etc chooses it: {', '.join(each)}."
        for name, each in chosen.items()
    ]
    unused = unused_text(rows.values())
    return [*said, *[f"{unused}."] * bool(unused)]


_REGIONS = {"hole": "pixels around the dark hole", "full": "whole frames, of which the dark hole is kept"}


_DRAWS = {"sums": "sums of frames over the dark hole", "frames": "every frame, one by one"}


_COARSER = ("wavelength_nodes", "pixel_nodes", "precision", "drift_epochs", "pupil_samples")


@dataclass(frozen=True)
class ModelledRow:
    """One effect of a table.

    Attributes
    ----------
    effect : EffectRecord
        With its largest size.
    where : str
        Image set in which it is that large; empty where all are alike.
    size : str
        In per cent.
    word : str
        What became of it.
    """

    effect: results.EffectRecord
    where: str
    size: str
    word: str


@dataclass(frozen=True)
class ModelledGroup:
    """Image sets that are made alike.

    Attributes
    ----------
    title : str
        How they are made.
    names : tuple of str
        Their names.
    knobs, errors : str
        Settings of the optics; largest predicted errors, and what was asked for.
    rows : tuple of ModelledRow
        Largest size first.
    """

    title: str
    names: tuple[str, ...]
    knobs: str
    errors: str
    rows: tuple[ModelledRow, ...]

    @property
    def members(self) -> str:
        """Their names, with commas."""
        return ", ".join(self.names)


def modelled_sentence(bands: Iterable[results.BandConfirmation]) -> str:
    """Return how images were drawn and the largest error that is predicted of them; empty without images."""
    made = [band.modelled for band in bands if band.modelled is not None and band.status != "invalid"]
    if not made:
        return ""
    ways = " and ".join(dict.fromkeys(_DRAWS[item.draw] for item in sorted(made, key=lambda item: item.draw)))
    return f"Images: {ways}; predicted error beside the reference: {error_text(_largest(made))}."


def modelled_groups(named: Sequence[tuple[str, results.ModellingRecord]]) -> list[ModelledGroup]:
    """Return one table for every distinct way to make images.

    Parameters
    ----------
    named : sequence of (str, ModellingRecord)
        Name of each image set, and how it was made. Sets that differ in nothing but sizes share a table, which shows
        the largest.
    """
    groups: dict[tuple[object, ...], list[tuple[str, results.ModellingRecord]]] = {}
    for name, record in named:
        kept = tuple((row.effect, row.decision) for row in record.effects)
        content = (record.draw, record.region, record.epochs, record.knobs.content_hash, kept)
        groups.setdefault(content, []).append((name, record))
    return [_group(members) for members in groups.values()]


def _group(members: list[tuple[str, results.ModellingRecord]]) -> ModelledGroup:
    record = members[0][1]
    largest = _largest([item for _, item in members])
    asked = f" (asked: at most {error_text(record.tolerance)})" if any(record.tolerance.values()) else ""
    knobs = record.knobs
    rows = [_row(index, members) for index in range(len(record.effects))]
    ways = _DRAWS[record.draw]
    return ModelledGroup(
        title=ways[:1].upper() + ways[1:],
        names=tuple(dict.fromkeys(name for name, _ in members)),
        knobs=f"{_REGIONS[record.region]}; {knobs.pupil_samples} samples across the pupil, {knobs.wavelength_nodes} "
        f"wavelength{'s' * (knobs.wavelength_nodes != 1)} a band, {knobs.pixel_nodes} × {knobs.pixel_nodes} nodes a "
        f"pixel, {knobs.precision} precision; wavefront at {record.epochs} epoch{'s' * (record.epochs != 1)} a visit",
        errors=f"{error_text(largest)}{asked}",
        rows=tuple(sorted(rows, key=lambda row: -size_order(row.effect))),
    )


def _row(index: int, members: list[tuple[str, results.ModellingRecord]]) -> ModelledRow:
    name, record = max(members, key=lambda member: size_order(member[1].effects[index]))
    sizes = {item.effects[index].size for _, item in members}
    row = record.effects[index]
    size = "" if row.size is None else _percent(row.size)
    return ModelledRow(row, name if len(sizes) > 1 else "", size, _decision_text(row))


def _decision_text(row: results.EffectRecord) -> str:
    if row.decision == "kept":
        return "kept"
    if row.key in _COARSER:
        return "coarser"
    return "as sums" if row.key == "summed_frames" else "left out"


def size_order(row: results.EffectRecord) -> float:
    """Return what effects are sorted by, largest first; those without a size stand before what is not there."""
    return row.size if row.size else 0.5 * LEAST_SIZE * LEAST_SIZE if row.size is None else 0.0


def _largest(records: Iterable[results.ModellingRecord]) -> dict[Quantity, float | None]:
    largest: dict[Quantity, float | None] = {}
    for record in records:
        for name, value in record.predicted_error.items():
            before = largest.get(name, 0.0)
            largest[name] = None if value is None or before is None else max(value, before)
    return largest


MEASURED_NOTE = "measurements as a table: `measurements.csv`. Times, host and package versions of the run: `run.json`."
"""Which files have the measurements and the story of a run."""


def instrument_fact(result: results.ImagedResult) -> doc.Inline:
    """Return which instrument images and predictions are of, and how the images are made."""
    more = f", {dial_text(result)}. Every default value has its source and confidence in the instrument preset."
    return [doc.code(result.instrument), more]


def outcome(band: results.BandConfirmation) -> doc.Mark:
    """Return the badge of what became of a planet in the images of a band."""
    if band.status != "ok":
        return doc.badge(band.status, status_text(band.status))
    return doc.badge("ok", "detected") if band.detected else doc.badge("unreachable", "not detected")


def _of(count: int | None, n: int | None) -> str:
    return MISSING if count is None else f"{count} of {n}"


def _predicted_error(band: results.BandConfirmation) -> str:
    return error_text(band.modelled.predicted_error) if band.modelled else MISSING


def _contrast_error(band: results.BandConfirmation) -> doc.Inline:
    if band.contrast_error is None:
        return MISSING
    return doc.lines(f"± {contrast_text(band.contrast_error, 2)}", f"± {contrast_text(band.contrast_mean_error, 2)}")


def _position(band: results.BandConfirmation) -> doc.Inline:
    if band.found_separation_arcsec is None:
        return MISSING
    return doc.lines(
        f"{decimals(band.found_separation_arcsec, 4)} ± {decimals(band.found_separation_error_arcsec, 4)}″",
        f"PA {decimals(band.found_pa_deg, 2)} ± {decimals(band.found_pa_error_deg, 2)}°",
    )


def _star_flux(band: results.BandConfirmation) -> str:
    error = "" if band.star_flux_error is None else f" ({percent_text(band.star_flux_error)})"
    return STAR_FLUX.get(band.star_flux, band.star_flux) + error if band.star_flux else MISSING


def _verdict(band: results.BandConfirmation) -> str:
    why = band.message or reason_text(band.reason)
    return plus_minus(band.verdict) + (f": {why}" if why else "")


def _quantities() -> list[doc.Column[results.BandConfirmation]]:
    """Return the rows of the table of measurements, one a quantity."""
    return doc.row_columns(
        results.BandConfirmation,
        "outcome separation_arcsec pa_deg frames em_gain integration_s time_s realisations predicted_error "
        "predicted_snr recovered_snr etc_ratio predicted_significance recovered_significance threshold n_detected "
        "search_snr search_threshold n_significant false_detections found true_contrast recovered_contrast "
        "contrast_error star_flux rdi_throughput rdi_modes_used core_throughput n_background_apertures "
        "saturated_in_hole saturated_outside verdict",
        outcome=Cells("", outcome, label="outcome"),
        realisations=lambda band: doc.lines(
            count_text(band.realisations), doc.small(DRAWN_AS[band.drawn_as] if band.drawn_as else "")
        ),
        predicted_error=Cells("", _predicted_error, label="predicted error of the images", unit="beside the reference"),
        n_detected=lambda band: _of(band.n_detected, band.realisations),
        n_significant=lambda band: _of(band.n_significant, band.realisations),
        found=Cells("", _position, label="found at", unit="first realisation that finds it"),
        contrast_error=Cells("", _contrast_error, label="its error", unit="one observation; mean"),
        star_flux=_star_flux,
        verdict=_verdict,
    )


def measure_table(
    name: str, bands: Sequence[results.BandConfirmation], caption: str, chosen: str | None = None
) -> doc.Table:
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

    def column(band: results.BandConfirmation) -> doc.Column[doc.Column[results.BandConfirmation]]:
        picked = band.band == chosen
        heading: doc.Inline = [band.band, " ", doc.small("(chosen)")] if picked else band.band
        return doc.Column(heading, lambda quantity: quantity.value(band), look="pick" if picked else "")

    def named(quantity: doc.Column[results.BandConfirmation]) -> doc.Inline:
        return [quantity.heading, " ", doc.small(f"({quantity.unit})")] if quantity.unit else quantity.heading

    first: doc.Column[doc.Column[results.BandConfirmation]] = doc.Column("Quantity", named, look="row left")
    text = f"{caption} Recovered numbers are those of one observation, averaged over the realisations."
    if any(band.search_threshold is not None for band in bands):
        text = f"{text} {prose()['two_statistics']}"
    return doc.table(f"Bands of {name}", text, [first, *map(column, bands)], _quantities(), look="bands")


def _audit_columns() -> list[doc.Column[tuple[results.BandConfirmation, results.AuditRecord]]]:
    return doc.row_columns(
        results.AuditRecord,
        "band:row frames_run frames_in_all predicted_snr recovered_snr true_contrast contrast deviation_sigma detected "
        "false_detections hits rejected_fraction saturated_in_hole saturated_outside",
        of=itemgetter(1),
        band=Cells("", lambda case: case[0].band, right=False, label="band"),
        true_contrast=Cells("", lambda case: contrast_text(case[0].true_contrast), label="true contrast"),
        detected=lambda case: doc.badge("ok", "found") if case[1].detected else doc.badge("unreachable", "not found"),
    )


def audit_blocks(name: str, bands: Iterable[results.BandConfirmation]) -> Iterator[doc.Block]:
    """Yield the table of the realisations that were run frame by frame, if there are any."""
    audited = [(band, band.audit) for band in bands if band.audit is not None]
    if audited:
        caption = (
            "Audited: one more realisation of the programme with every effect of the camera, calibrated and cleaned of "
            "particles. The stated part of its frames is run one by one, beside frames of the same light and random "
            "numbers without these effects; what they change is carried to all frames. Deviation: measured less true "
            "contrast, in units of its error."
        )
        yield doc.table(f"Frame by frame, {name}", caption, _audit_columns(), audited)


def picture_blocks(images: Mapping[str, Picture], keys: Iterable[str], name: str) -> Iterator[doc.Block]:
    """Yield image panels, those that there are of some keys, and before them how to read them."""
    shown = [shown_in_both_lights(images[key]) for key in keys if key in images]
    if shown:
        yield doc.Paragraph(PANEL_NOTE, "note")
    yield from (doc.Figure(picture, before=name) for picture in shown)


@dataclass(frozen=True)
class _EffectRow:
    """One effect in all images of a report: its largest size, and what became of it in how many of them."""

    row: ModelledRow
    where: str
    words: dict[str, int]

    @property
    def decision(self) -> doc.Inline:
        """What became of the effect; where that differs between images, in how many."""
        kept = "ok" if self.row.effect.decision == "kept" else "unreachable"
        others = ", ".join(f"{word} in {count}" for word, count in self.words.items())
        return doc.lines(doc.badge(kept, self.row.word), doc.small(others) if len(self.words) > 1 else "")


_EFFECTS: tuple[doc.Column[_EffectRow], ...] = (
    doc.Column("Effect", lambda item: item.row.effect.effect, look="row left"),
    doc.Column("Predicted size", lambda item: item.row.size or MISSING, "largest of flux and SNR"),
    doc.Column("Largest in", lambda item: item.where, look="left"),
    doc.Column("Modelled", lambda item: item.decision, look="left"),
    doc.Column("How, or why not", lambda item: item.row.effect.reason, look="left wide"),
)


def _effect_rows(groups: Sequence[ModelledGroup]) -> list[_EffectRow]:
    """Return every effect once, largest first."""
    every: dict[str, list[tuple[ModelledGroup, ModelledRow]]] = {}
    for group in groups:
        for row in group.rows:
            every.setdefault(row.effect.effect, []).append((group, row))
    rows = []
    for found in every.values():
        group, largest = max(found, key=lambda item: size_order(item[1].effect))
        words: Counter[str] = Counter()
        for other, row in found:
            words[row.word] += len(other.names)
        alike = len({row.size for _, row in found}) == 1
        rows.append(_EffectRow(largest, largest.where or ("" if alike else group.names[0]), dict(words)))
    return sorted(rows, key=lambda item: -size_order(item.row.effect))


def modelled_blocks(named: Sequence[tuple[str, results.ModellingRecord]]) -> Iterator[doc.Block]:
    """Yield how images were made, each distinct way in a paragraph, and a folded table of all effects."""
    groups = modelled_groups(named)
    if not groups:
        yield doc.Paragraph("No image was made.")
        return
    for group in groups:
        knobs = group.knobs[:1].upper() + group.knobs[1:]
        made = f": {group.members}. {knobs}. Predicted error beside the reference: {group.errors}."
        yield doc.Paragraph([doc.strong(group.title), made])
    rows = _effect_rows(groups)
    caption = (
        "Sizes are closed-form predictions of the relative change of what is measured if the effect is left out or "
        "done more coarsely, after the reduction; a dash where none can be given. What is left out is left out because "
        "the sum of such sizes stays within what was asked for, or because it is not there."
    )
    yield doc.Fold(f"All effects ({len(rows)})", [doc.table("Effects in the images", caption, _EFFECTS, rows)])


def not_modelled_blocks(items: Sequence[str]) -> Iterator[doc.Block]:
    """Yield what neither images drawn as sums nor predictions hold."""
    yield doc.Items(items) if items else doc.Paragraph("Nothing is listed.")
    yield doc.Paragraph(
        "Realisations that are drawn as sums of frames leave these out, and so does the prediction. The audited ones, "
        "a part of whose frames are run one by one, hold whatever the camera of the instrument has switched on. An "
        "effect that is missing from both sides does not show in their comparison.",
        "note",
    )


def visits_facts(target: results.ConfirmedTarget) -> dict[str, str]:
    """Return the visits of a confirmed target, in words by heading: those of the ranking, or of a schedule."""
    if target.roll_deg is not None:
        own = ", ".join(f"{band.visits} in {band.band}" for band in target.bands if band.visits is not None)
        return {"Visits": f"{own or 'none'}, reduced together", "Roll": f"{target.roll_deg:g} deg"}
    star = target.ranked
    if star.visits is None or star.visit_time_s is None:
        return {}
    span = "" if star.span_days is None else f" over {significant(star.span_days, 2)} days"
    paid = orbits_text([star])
    visits = f"{star.visits} of {duration_text(star.visit_time_s)}{span}, reduced together"
    return {"Visits": f"{visits}; {paid}" if paid else visits}


MEASURED = (
    "separation_arcsec/3 visits frames/4 em_gain/6 time_s/5 predicted_snr/1 recovered_snr/1 etc_ratio n_detected{more} "
    "outcome"
)
"""What is shown of each measurement; the rest is in the files."""


_COUNTS = ("n_detected", "realisations")


def measured_cells(layout: str, of: Callable[[Any], results.BandConfirmation], library: str) -> list[Cells]:
    """Return the columns of measurements that `MEASURED` names; ``of`` takes one from an entry of the table."""
    found = f"realisations in which {LIBRARIES[library].found}"
    return row_cells(
        results.BandConfirmation,
        layout,
        of=of,
        n_detected=Cells("found", lambda row: detections_cell(of(row)), legend=found, fields=_COUNTS),
        recovered_contrast=lambda row: _recovered(of(row)),
        outcome=Cells(
            "outcome",
            lambda row: outcome_cell(of(row)),
            right=False,
            legend="seen at its place means significant there, but not found blind",
        ),
    )


def setup_text(result: results.ImagedResult) -> str:
    """Return what images are to be made again with."""
    return f"Seed {result.seed}, {dial_text(result)}, configuration {result.config_hash}."


def detections_cell(item: results.BandConfirmation) -> str:
    """Return in how many of the realisations the planet is found."""
    return MISSING if item.n_detected is None else f"{item.n_detected}/{item.realisations}"


def print_comparison(result: results.ImagedResult, console: Console, *, measured: bool = True) -> None:
    """Print what is altered in the images, and how prediction and images compare where planets were measured."""
    if altered := overrides_sentence(result):
        print_plain(console, altered, bold=True)
    if measured:
        print_plain(console, calibration_sentence(result), bold=True)


def print_invalid(bands: Sequence[results.BandConfirmation], console: Console) -> None:
    """Print where a tier is not good enough, and what to ask for."""
    print_plain(console, *dict.fromkeys(f"{band.band}: {band.message}" for band in bands if band.status == "invalid"))


def print_modelled(bands: Sequence[results.BandConfirmation], console: Console) -> None:
    """Print how the images were drawn, and what that is predicted to cost.

    Parameters
    ----------
    bands : sequence of BandConfirmation
        What was measured in each band.
    console : Console
    """
    if made := modelled_sentence(bands):
        print_note(console, made)


def outcome_cell(item: results.BandConfirmation) -> str:
    """Return what the images say of a planet, with the symbol of its status."""
    if item.status != "ok":
        return status_cell(item.status, item.reason)
    if item.detected:
        return f"{STATUS_SYMBOLS['ok']} confirmed"
    at_place = 2 * (item.n_significant or 0) >= (item.realisations or 1)
    return f"{STATUS_SYMBOLS['unreachable']} {'seen at its place' if at_place else 'not found'}"


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
    if not rows:
        print_plain(console, f"{result.scene}: no planet, {LIBRARIES[result.reference_library].searched}", bold=True)
    else:
        title = f"{result.scene}: {outcome_text(rows)}, {counted(result.realisations, 'realisation')} a band"
        print_table(console, title, cells, rows, explained=True, legend=not full)
    for item in result.bands if full else ():
        if item.audit is not None:
            audit, where = item.audit, f"{item.planet}, {item.band}, with every effect"
            run = f"{audit.frames_run} of {audit.frames_in_all} frames one by one"
            snr = f"SNR {significant(audit.recovered_snr)} ({significant(audit.predicted_snr)} predicted)"
            off = f"contrast off by {decimals(audit.deviation_sigma, 1)} of its errors"
            print_plain(console, f"{where} ({run}): {snr}, {off}, {'found' if audit.detected else 'not found'}")
    if result.searches:
        _print_searches(result.searches, console)
    print_note(console, *programme_sentences(result))
    _print_positions(result.positions, console)
    print_plain(console, *map(albedo_text, result.albedos))
    print_comparison(result, console, measured=bool(rows))
    print_invalid(result.bands, console)
    if full:
        print_modelled(result.bands, console)
        print_note(console, setup_text(result))


def _recovered(item: results.BandConfirmation) -> str:
    if item.recovered_contrast is None or item.contrast_error is None:
        return MISSING
    return f"{item.recovered_contrast:.2e} ± {item.contrast_error:.0e}"


def _print_searches(searches: list[results.SearchRecord], console: Console) -> None:
    rows: list[tuple[results.SearchRecord, results.CandidateRecord | None]] = []
    for search in searches:
        named = sorted(search.candidates, key=lambda item: -item.snr)
        shown = [item for number, item in enumerate(named) if item.detected or item.planet or number == 0][:_SHOWN]
        rows += [(search, item) for item in shown] or [(search, None)]
    cells = [
        *row_cells(results.SearchRecord, "band visits frames/2 em_gain/2", of=lambda row: row[0]),
        *row_cells(results.CandidateRecord, "separation_arcsec pa_deg snr threshold/1", of=lambda row: row[1]),
        Cells("is", lambda row: _candidate_text(row[1]), right=False),
    ]
    elsewhere = sum(search.false_detections for search in searches)
    total = sum(search.realisations for search in searches)
    print_table(console, "What the blind search names, first realisation", cells, rows, last_width=30)
    word = "detection that is" if elsewhere == 1 else "detections that are"
    print_note(console, f"{elsewhere} {word} no planet of the scene, in {total} searches.")


def _candidate_text(item: results.CandidateRecord | None) -> str:
    if item is None:
        return "nothing"
    return item.planet or ("no planet of the scene" if item.detected else "below the threshold")


def _print_positions(positions: Sequence[results.PositionRecord], console: Console) -> None:
    cells = [
        Cells("planet", lambda item: item.planet, right=False),
        Cells("sep ″", lambda item: f"{item.separation_arcsec:.4f} ± {item.separation_error_arcsec:.4f}"),
        Cells("true", lambda item: f"{item.true_separation_arcsec:.4f}"),
        Cells("PA deg", lambda item: f"{item.pa_deg:.2f} ± {item.pa_error_deg:.2f}"),
        Cells("true", lambda item: f"{item.true_pa_deg:.2f}"),
        Cells("bands", lambda item: ", ".join(item.bands), right=False),
    ]
    if positions:
        print_table(console, "Measured places, beside the true ones", cells, positions)


def albedo_text(albedo: results.AlbedoRecord) -> str:
    """Return what contrasts say of metallicity and clouds."""
    mh, fsed = albedo.log10_mh_interval, albedo.log10_fsed_interval
    return (
        f"{albedo.planet}: log10 M/H {decimals(mh[0], 2)} to {decimals(mh[1], 2)}, log10 f_sed {decimals(fsed[0], 2)} "
        f"to {decimals(fsed[1], 2)} (68 %), correlation {decimals(albedo.correlation, 2)}, from "
        f"{', '.join(albedo.bands)}: {ALBEDO_STATUS[albedo.status]}"
    )


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
        table = measure_table(name, bands, f"{name} by band.")
        blocks = [table, *audit_blocks(name, bands)]
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
    modes = f"{result.rdi_modes} mode{'s' * (result.rdi_modes != 1)} subtracted"
    yield doc.Facts(
        [
            ("Instrument", instrument_fact(result)),
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
    return modelled_blocks([(band.band, band.modelled) for band in report.result.bands if band.modelled])


@doc.section_of(CONFIRM_SECTIONS, "missing", "What is not modelled")
def _missing(report: ConfirmReport) -> Iterator[doc.Block]:
    return not_modelled_blocks(report.result.not_modelled)


@doc.section_of(CONFIRM_SECTIONS, "glossary", "Glossary")
def _glossary(report: ConfirmReport) -> Iterator[doc.Block]:
    yield doc.Facts(terms(_WORDS))


@doc.section_of(CONFIRM_SECTIONS, "reproduce", "Reproducing this")
def _reproduce(report: ConfirmReport) -> Iterator[doc.Block]:
    note = doc.marked(f"Numbers in full: `confirm.json`; {MEASURED_NOTE}")
    yield from doc.reproduced_blocks(report.result, note)
    yield doc.Items(prose()["credits"])


_MODEL_COLUMNS = ("fidelity", "region", "epochs")


_KNOB_COLUMNS = ("pupil_samples", "wavelength_nodes", "pixel_nodes", "precision")


_ERROR_COLUMNS: tuple[Quantity, ...] = ("planet_flux", "snr")


MEASUREMENT_COLUMNS: tuple[str, ...] = (
    "target",
    "hip",
    "chosen",
    *(name for name in results.names_of(results.BandConfirmation) if name != "image"),
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
        rows = [_measured(band) | {"target": result.scene} for band in result.bands]
    else:
        rows = [
            _measured(band) | {"target": target.name, "hip": target.hip, "chosen": band.band == target.chosen_band}
            for target in result.targets
            for band in target.bands
        ]
    return results.csv_text(MEASUREMENT_COLUMNS, rows)


def _measured(band: results.BandConfirmation) -> dict[str, Any]:
    cells = results.values_of(band)
    if (made := band.modelled) is not None:
        cells |= {name: getattr(made, name) for name in _MODEL_COLUMNS}
        cells |= {name: getattr(made.knobs, name) for name in _KNOB_COLUMNS}
        cells |= {f"predicted_error_{name}": made.predicted_error.get(name) for name in _ERROR_COLUMNS}
    return cells | ({} if band.audit is None else results.values_of(band.audit, before="audit_"))
