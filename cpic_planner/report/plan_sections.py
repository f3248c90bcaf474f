"""The prioritisation report of a plan: its sections, each an entry of `PLAN_SECTIONS`."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from catalogs import data_credits
from cpic_core import Registry
from cpic_planner import results
from cpic_planner.registry import LIBRARIES, SCORES
from cpic_planner.report import decision, document as doc, image_figures, numbers, summary, words
from cpic_planner.report.cells import Cells
from cpic_planner.report.drawing import Picture
from cpic_planner.report.figures import PLAN_FIGURES
from cpic_planner.report.numbers import decimals, duration_text, pretty_name, significant
from cpic_planner.report.plan_stars import anchors_of, star_pages
from cpic_planner.report.priorities import known_blocks, priority_blocks, sensitivity_blocks
from cpic_planner.report.words import prose, terms


@dataclass(frozen=True)
class PlanReport:
    """The contents of the report of a plan.

    Attributes
    ----------
    plan : PlanResult
    rank : RankResult
    figures : mapping of str to Picture
        Any of `PLAN_FIGURES`.
    images : mapping of str to Picture
        Image panels by ``BandConfirmation.image``.
    sensitivity : SensitivityResult, optional
        How the ranking depends on assumptions.
    known : KnownResult, optional
        Known planets of the first stars, and when the dark hole covers them.
    top_rows : int
        Rows of the ranking to print.
    """

    plan: results.PlanResult
    rank: results.RankResult
    figures: Mapping[str, Picture]
    images: Mapping[str, Picture]
    sensitivity: results.SensitivityResult | None = None
    known: results.KnownResult | None = None
    top_rows: int = 50

    @cached_property
    def anchors(self) -> dict[str, str]:
        """Anchors of the pages of stars, by name."""
        return anchors_of(self.plan, self.rows)

    def named(self, row: results.RankedTarget) -> doc.Inline:
        """Return the name of a star, as a link where it has a page."""
        name = pretty_name(row.name)
        return doc.link(self.anchors[row.name], name) if row.name in self.anchors else name

    @property
    def rows(self) -> list[results.RankedTarget]:
        """Rows of the ranking that are printed."""
        return self.rank.targets[: self.top_rows]


PLAN_SECTIONS: Registry[doc.Section[PlanReport]] = Registry("section")
"""Sections of the report, in their order."""


def plan_document(report: PlanReport) -> doc.Document:
    """Return the report of a plan."""
    plan = report.plan
    return doc.document_of(
        PLAN_SECTIONS,
        report,
        title=f"CPI-C target plan, configuration {plan.config_hash}",
        heading="CPI-C target plan",
        about="Which nearby stars to observe first, in which band and with which settings; predicted analytically, "
        "and the first of them simulated as images.",
        opening="What to observe first",
        summary=decision.decision_blocks(plan, report.rank, report.sensitivity, report.named),
    )


def _recovered(best: results.BandConfirmation) -> doc.Inline:
    error = best.recovered_snr_error
    return doc.lines(significant(best.recovered_snr), "" if error is None else doc.small(f"± {significant(error, 2)}"))


def _significance(best: results.BandConfirmation) -> str:
    return f"{significant(best.recovered_significance)} / {significant(best.threshold)}"


_NOWHERE = doc.Span("the images show the planet in no band; see its page", 6)
_IMAGED: tuple[doc.Column[decision.Pick], ...] = (
    doc.Column(
        "Star",
        lambda pick: decision.star_cell(doc.link(f"target-{pick[0]}", pretty_name(pick[1].name)), pick[1].hip),
        look="row left star",
    ),
    doc.Column("Band", lambda pick: _NOWHERE if pick[2] is None else pick[2].band, look="left"),
    doc.Column("Separation", decision.of_band(lambda best: decimals(best.separation_arcsec, 3)), "arcsec"),
    doc.Column("Contrast", decision.of_band(lambda best: numbers.contrast_text(best.true_contrast))),
    doc.Column("SNR", decision.of_band(lambda best: significant(best.predicted_snr)), "predicted"),
    doc.Column("SNR", decision.of_band(_recovered), "recovered"),
    doc.Column("Significance", decision.of_band(_significance), "/ threshold"),
    doc.Column("Verdict", decision.verdict_cell, look="left verdict"),
)


@doc.section_of(PLAN_SECTIONS, "first", "What the images show")
def _images(report: PlanReport) -> Iterator[doc.Block]:
    plan = report.plan
    yield doc.Items(decision.summary_sentences(plan, report.rank))
    if plan.targets:
        caption = (
            "Targets simulated as images, in order of the ranking; each in the band of highest predicted "
            f"margin among those in which {LIBRARIES[plan.reference_library].found} in at least half of the "
            f"{plan.realisations} realisations or, without any, among those that show it at its known place. "
            "Separation and contrast are those of the reference planet; the verdict is of all bands."
        )
        yield doc.table("What the images show", caption, _IMAGED, decision.picks_of(plan))
    else:
        yield doc.Paragraph("No target was simulated as images.")
    for text in (*words.targets_sentences(plan), *words.not_imaged_lines(plan)):
        yield doc.Paragraph(text, "note")


@doc.section_of(PLAN_SECTIONS, "priorities", "Priorities")
def _priorities(report: PlanReport) -> Iterator[doc.Block]:
    yield from priority_blocks(report.rank, report.rows, report.named)
    if report.known is not None:
        yield from known_blocks(report.known)


@doc.section_of(PLAN_SECTIONS, "sensitivity", "What the ranking depends on")
def _sensitivity(report: PlanReport) -> Iterator[doc.Block]:
    if report.sensitivity is not None:
        yield from sensitivity_blocks(report.sensitivity)


@doc.section_of(PLAN_SECTIONS, "figures", "Figures")
def _figures(report: PlanReport) -> Iterator[doc.Block]:
    for key, title in PLAN_FIGURES.items():
        if key in report.figures:
            more = summary.calibration_sentence(report.plan) if key == "calibration" else ""
            yield doc.Figure(report.figures[key], title, key, more=more)


@doc.section_of(PLAN_SECTIONS, "targets", "A page a star")
def _stars(report: PlanReport) -> Iterator[doc.Block]:
    return star_pages(report.plan, report.rows, report.images, report.known)


@doc.section_of(PLAN_SECTIONS, "assumptions", "Assumptions")
def _assumptions(report: PlanReport) -> Iterator[doc.Block]:
    plan, library = report.plan, LIBRARIES[report.plan.reference_library]
    audited = any(band.audit for target in plan.targets for band in target.bands)
    scheduled = "" if plan.schedule is None else " Visits of the schedule take that of their frames."
    once = (
        ", and one more with every effect of single frames in the band of each target that promises most"
        if audited
        else ""
    )
    yield doc.Facts(
        [
            (
                "Reference planet",
                f"{summary.planet_text(plan)}. Its separation is where significance over threshold is highest. The "
                "contrast, SNR and margin of ranked stars refer to this planet.",
            ),
            ("Population", f"{summary.population_text(report.rank.population)}."),
            ("Score", f"{SCORES[report.rank.score_name].meaning}."),
            (
                "Wall time",
                f"at most {duration_text(plan.time_s)} per target and band (less where more time would not help): "
                f"science frames, reference frames and readouts; no orbit duty cycle.{scheduled}",
            ),
            (
                "Reference library",
                [f"{library.meaning} (", doc.code(library.name), f"); {plan.rdi_modes} modes are subtracted."],
            ),
            (
                "Detection threshold",
                f"the false-alarm probability of {plan.sigma:g}σ per resolution element, corrected for the few of them "
                f"at each separation. Reference planets are looked for {summary.programme_text(report.rank)}; a "
                f"realisation is a detection if {library.found}.",
            ),
            ("Realisations", f"{plan.realisations} of each target and band{once}."),
            ("Sample", f"{plan.sample}."),
            ("Catalogue", f"{plan.catalogue}."),
            *doc.notes_fact(plan.notes),
            ("Places of stars and companions", f"those of {plan.date_utc[:10] or 'no date that is recorded'}."),
            ("Instrument", image_figures.instrument_fact(plan)),
        ]
    )


@doc.section_of(PLAN_SECTIONS, "modelled", "What was modelled")
def _modelled(report: PlanReport) -> Iterator[doc.Block]:
    bands = ((pretty_name(target.name), band) for target in report.plan.targets for band in target.bands)
    made = [(f"{name} {band.band}", band.modelled) for name, band in bands if band.modelled is not None]
    return image_figures.modelled_blocks(made)


@doc.section_of(PLAN_SECTIONS, "missing", "What is not modelled")
def _missing(report: PlanReport) -> Iterator[doc.Block]:
    return image_figures.not_modelled_blocks(report.plan.not_modelled)


def _completeness(row: results.RankedTarget) -> doc.Inline:
    if not row.completeness > 0:
        return numbers.share_text(row.completeness)
    error = significant(100 * row.completeness_error, 1)
    return doc.lines(f"{numbers.share_text(row.completeness)} ± {error}", doc.small(row.completeness_band))


def _standing(row: results.RankedTarget) -> doc.Inline:
    limit = words.LIMITED_BY[row.limited_by][0] if row.limited_by else row.reason.replace("_", " ")
    return doc.lines(doc.badge(row.status, words.verdict_text(row.verdict, row.status)), limit if row.reason else "")


@doc.section_of(PLAN_SECTIONS, "ranking", "Ranking")
def _ranking(report: PlanReport) -> Iterator[doc.Block]:
    rank, rows, score = report.rank, report.rows, SCORES[report.rank.score_name]
    columns = doc.row_columns(
        results.RankedTarget,
        f"rank {'rank_in_catalogue ' * rank.filtered}name:row,star v_mag sp_type distance_pc score completeness "
        "completeness_unconditional band "
        "separation_arcsec contrast frames em_gain snr detection_margin status:wide flags:flags",
        name=lambda row: decision.star_cell(report.named(row), row.hip),
        distance_pc=lambda row: significant(row.distance_pc, 4),
        score=Cells("", lambda row: words.score_number(row.score, score.name), label="score", unit=score.written[1]),
        completeness=_completeness,
        status=_standing,
        flags=lambda row: doc.marked(" ".join(f"`{flag}`" for flag in row.flags)),
    )
    stars = numbers.chosen_text(len(rank.targets), rank.n_in_catalogue, "ranked star")
    caption = (
        f"First {len(rows)} of {stars}, by {score.title}: {score.meaning}. "
        "Completeness and the band it is for are about the population, the columns from Band to Margin about the "
        "reference planet. All rows and columns are in `ranking.csv` and `ranking.ecsv`."
    )
    yield doc.table("Ranking", doc.marked(caption), columns, rows, look="compact")
    yield from _velocities(report)
    if reasons := sorted({row.reason for row in rows if row.reason}):
        yield doc.Heading("Reasons used here")
        yield doc.Facts([(reason.replace("_", " "), words.reason_text(reason)) for reason in reasons])
    shown = [*rows, *(target.ranked for target in report.plan.targets)]
    if flags := sorted({flag for row in shown for flag in row.flags}):
        yield doc.Heading("Flags used here")
        yield doc.Facts([(doc.code(flag), words.flag_text(flag)) for flag in flags])


def _velocities(report: PlanReport) -> Iterator[doc.Block]:
    """Yield what is expected with what is known, and where more velocities would change it."""
    if expected := summary.expected_sentence(report.rank):
        yield doc.Paragraph(expected)
    if rows := summary.unprobed_stars(report.rank, len(report.rows)):
        columns = doc.row_columns(
            results.RankedTarget,
            "rank name:row,star completeness completeness_unconditional rv_amplitude_m_s ref_planet_distance_au",
            name=lambda row: decision.star_cell(report.named(row), row.hip),
        )
        caption = (
            "Where more radial velocities would change the ranking: stars whose reference planet they do not exclude "
            "yet. Velocity is the amplitude that it gives its star with the least mass of its radius, on an orbit "
            "inclined by 60 deg: what has to be shown or ruled out."
        )
        yield doc.table("Where velocities are missing", caption, columns, rows)


@doc.section_of(PLAN_SECTIONS, "glossary", "Glossary")
def _glossary(report: PlanReport) -> Iterator[doc.Block]:
    yield doc.Facts(terms())


@doc.section_of(PLAN_SECTIONS, "reproduce", "Reproducing this")
def _reproduce(report: PlanReport) -> Iterator[doc.Block]:
    beside = {"sensitivity.json": report.sensitivity, "known.json": report.known}
    more = "".join(f", `{name}`" for name, result in beside.items() if result is not None)
    note = doc.marked(f"Numbers in full: `plan.json`{more}; {image_figures.MEASURED_NOTE}")
    return iter(doc.reproduced_blocks(report.plan, note, [("Ranking configuration", report.rank.config_hash)]))


@doc.section_of(PLAN_SECTIONS, "credits", "Credits")
def _credits(report: PlanReport) -> Iterator[doc.Block]:
    yield doc.Items((*data_credits(report.plan.catalogue), *prose()["credits"]))
