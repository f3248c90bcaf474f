"""What the reports of a plan and of a confirmed scene show of images: measurements, pictures, how they were made."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from operator import itemgetter

from cpic_planner.models import AuditRecord, BandConfirmation, ConfirmResult, ModellingRecord, PlanResult
from cpic_planner.report import document as doc
from cpic_planner.report.cells import Cells
from cpic_planner.report.drawing import Picture
from cpic_planner.report.modelled import ModelledRow, dial_text, error_text, modelled_groups
from cpic_planner.report.numbers import MISSING, contrast_text, count_text, decimals, percent_text
from cpic_planner.report.panel_figure import PANEL_NOTE
from cpic_planner.report.words import DRAWN_AS, STAR_FLUX, plus_minus, reason_text, status_text

MEASURED_NOTE = "measurements as a table: `measurements.csv`. Times, host and package versions of the run: `run.json`."
"""Which files have the measurements and the story of a run."""


def instrument_fact(result: PlanResult | ConfirmResult) -> doc.Inline:
    """Return which instrument images and predictions are of, and how the images are made."""
    more = f", {dial_text(result)}. Every default value has its source and confidence in the instrument preset."
    return [doc.code(result.instrument), more]


def outcome(band: BandConfirmation) -> doc.Mark:
    """Return the badge of what became of a planet in the images of a band."""
    if band.status != "ok":
        return doc.badge(band.status, status_text(band.status))
    return doc.badge("ok", "detected") if band.detected else doc.badge("unreachable", "not detected")


def _of(count: int | None, n: int | None) -> str:
    return MISSING if count is None else f"{count} of {n}"


def _contrast_error(band: BandConfirmation) -> doc.Inline:
    if band.contrast_error is None:
        return MISSING
    return doc.lines(f"± {contrast_text(band.contrast_error, 2)}", f"± {contrast_text(band.contrast_mean_error, 2)}")


def _found_at(band: BandConfirmation) -> doc.Inline:
    if band.found_separation_arcsec is None:
        return MISSING
    return doc.lines(
        f"{decimals(band.found_separation_arcsec, 4)} ± {decimals(band.found_separation_error_arcsec, 4)}″",
        f"PA {decimals(band.found_pa_deg, 2)} ± {decimals(band.found_pa_error_deg, 2)}°",
    )


def _star_flux(band: BandConfirmation) -> str:
    error = "" if band.star_flux_error is None else f" ({percent_text(band.star_flux_error)})"
    return STAR_FLUX.get(band.star_flux, band.star_flux) + error if band.star_flux else MISSING


def _verdict(band: BandConfirmation) -> str:
    why = band.message or reason_text(band.reason)
    return plus_minus(band.verdict) + (f": {why}" if why else "")


def _quantities() -> list[doc.Column[BandConfirmation]]:
    """Rows of the table of measurements, one a quantity."""
    return doc.row_columns(
        BandConfirmation,
        "outcome separation_arcsec pa_deg frames em_gain integration_s time_s realisations predicted_error "
        "predicted_snr recovered_snr etc_ratio predicted_significance recovered_significance threshold n_detected "
        "search_snr search_threshold n_significant false_detections found true_contrast recovered_contrast "
        "contrast_error star_flux rdi_throughput rdi_modes_used core_throughput n_background_apertures "
        "saturated_in_hole saturated_outside verdict",
        outcome=Cells("", outcome, label="outcome"),
        realisations=lambda band: doc.lines(
            count_text(band.realisations), doc.small(DRAWN_AS[band.drawn_as] if band.drawn_as else "")
        ),
        predicted_error=Cells(
            "",
            lambda band: error_text(band.modelled.predicted_error) if band.modelled else MISSING,
            label="predicted error of the images",
            unit="beside the reference",
        ),
        n_detected=lambda band: _of(band.n_detected, band.realisations),
        n_significant=lambda band: _of(band.n_significant, band.realisations),
        found=Cells("", _found_at, label="found at", unit="first realisation that finds it"),
        contrast_error=Cells("", _contrast_error, label="its error", unit="one observation; mean"),
        star_flux=_star_flux,
        verdict=_verdict,
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
    return doc.table(f"Bands of {name}", text, [first, *map(column, bands)], _quantities(), look="bands")


def _audited() -> list[doc.Column[tuple[BandConfirmation, AuditRecord]]]:
    return doc.row_columns(
        AuditRecord,
        "band:row n_frames predicted_snr recovered_snr true_contrast contrast deviation_sigma detected "
        "false_detections hits rejected_fraction saturated_in_hole saturated_outside",
        of=itemgetter(1),
        band=Cells("", lambda case: case[0].band, right=False, label="band"),
        true_contrast=Cells("", lambda case: contrast_text(case[0].true_contrast), label="true contrast"),
        detected=lambda case: doc.badge("ok", "found") if case[1].detected else doc.badge("unreachable", "not found"),
    )


def audit_blocks(name: str, bands: Iterable[BandConfirmation]) -> Iterator[doc.Block]:
    """Yield the table of the realisations that were run frame by frame, if there are any."""
    audited = [(band, band.audit) for band in bands if band.audit is not None]
    if audited:
        caption = (
            "Audited: one more realisation, run frame by frame with every effect of the camera, calibrated and cleaned "
            "of particles. Deviation: measured less true contrast, in units of its error."
        )
        yield doc.table(f"Frame by frame, {name}", caption, _audited(), audited)


def picture_blocks(images: Mapping[str, Picture], keys: Iterable[str], name: str) -> Iterator[doc.Block]:
    """Yield image panels, those that there are of some keys, and before them how to read them."""
    shown = [images[key] for key in keys if key in images]
    if shown:
        yield doc.Paragraph(PANEL_NOTE, "note")
    yield from (doc.Figure(picture, before=name) for picture in shown)


_EFFECTS: tuple[doc.Column[ModelledRow], ...] = (
    doc.Column("Effect", lambda row: row.effect.effect, look="row left"),
    doc.Column("Predicted size", lambda row: row.size or MISSING, "largest of flux and SNR"),
    doc.Column("Largest in", lambda row: row.where, look="left"),
    doc.Column(
        "Modelled",
        lambda row: doc.badge("ok" if row.effect.decision == "kept" else "unreachable", row.word),
        look="left",
    ),
    doc.Column("How, or why not", lambda row: row.effect.reason, look="left wide"),
)


def modelled_blocks(named: Sequence[tuple[str, ModellingRecord]]) -> Iterator[doc.Block]:
    """Yield one table for every distinct way in which images were made; see `modelled_groups`."""
    groups = modelled_groups(named)
    for group in groups:
        caption: doc.Inline = [
            doc.strong(group.title),
            f": {group.members}. {group.knobs[:1].upper()}{group.knobs[1:]}. Predicted error beside the reference: "
            f"{group.errors}.",
        ]
        yield doc.table(f"Modelled: {group.members}", caption, _EFFECTS, group.rows)
    if not groups:
        yield doc.Paragraph("No image was made.")
        return
    yield doc.Paragraph(
        "Sizes are closed-form predictions of the relative change of what is measured if the effect is left out or "
        "done more coarsely, after the reduction; a dash where none can be given. What is left out is left out because "
        "the sum of such sizes stays within what was asked for, or because it is not there.",
        "note",
    )


def not_modelled_blocks(items: Sequence[str]) -> Iterator[doc.Block]:
    """Yield what neither images drawn as sums nor predictions hold."""
    yield doc.Items(items) if items else doc.Paragraph("Nothing is listed.")
    yield doc.Paragraph(
        "Realisations that are drawn as sums of frames leave these out, and so does the prediction. The audited ones, "
        "frame by frame, hold whatever the camera of the instrument has switched on. An effect that is missing from "
        "both sides does not show in their comparison.",
        "note",
    )
