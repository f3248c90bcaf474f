"""The prioritisation report of a plan: its sections, each an entry of `PLAN_SECTIONS`."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from catalogs import data_credits
from cpic_core import Registry
from cpic_planner import results
from cpic_planner.registry import LIBRARIES, SCORES
from cpic_planner.report import document as doc, image_figures, numbers, summary, words
from cpic_planner.report.cells import Cells, frames_text
from cpic_planner.report.drawing import Picture
from cpic_planner.report.figures import PLAN_FIGURES
from cpic_planner.report.numbers import MISSING, count_text, decimals, duration_text, pretty_name, significant
from cpic_planner.report.priorities import known_blocks, priority_blocks, sensitivity_blocks
from cpic_planner.report.words import method_credits, terms


@dataclass(frozen=True)
class PlanReport:
    """What the report of a plan is made of.

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

    @property
    def rows(self) -> list[results.RankedTarget]:
        """Rows of the ranking that are printed."""
        return self.rank.targets[: self.top_rows]


PLAN_SECTIONS: Registry[doc.Section[PlanReport]] = Registry("section")
"""Sections of the report, in their order."""


def plan_document(report: PlanReport) -> doc.Document:
    """Return the report of a plan."""
    plan, rank = report.plan, report.rank
    lead = [doc.Paragraph(" ".join(summary.summary_sentences(plan, rank)), "lead")]
    lead.append(doc.Paragraph(doc.strong(summary.calibration_sentence(plan)), "lead"))
    if altered := summary.overrides_sentence(plan):
        lead.insert(0, doc.Paragraph(doc.strong(altered), "altered"))
    return doc.document_of(
        PLAN_SECTIONS,
        report,
        title=f"CPI-C target plan, configuration {plan.config_hash}",
        heading="CPI-C target plan",
        about="Which nearby stars to observe first, in which band and with which settings; predicted analytically, "
        "confirmed with simulated images.",
        summary=lead,
    )


_Pick = tuple[int, results.ConfirmedTarget, results.BandConfirmation | None]


def _of_band(text: Callable[[results.BandConfirmation], doc.Inline]) -> Callable[[_Pick], doc.Inline]:
    return lambda pick: MISSING if pick[2] is None else text(pick[2])


def _star(name: doc.Inline, hip: int | None) -> doc.Inline:
    return doc.lines(name, doc.small(f"HIP {hip}") if hip is not None else "")


def _picked_star(pick: _Pick) -> doc.Inline:
    return _star(doc.link(f"target-{pick[0]}", pretty_name(pick[1].name)), pick[1].hip)


def _pick_verdict(pick: _Pick) -> doc.Inline:
    _, target, best = pick
    mark = doc.badge("unreachable", "not confirmed") if best is None else image_figures.outcome(best)
    return doc.lines(mark, words.plus_minus(target.verdict))


def _recovered(best: results.BandConfirmation) -> doc.Inline:
    error = best.recovered_snr_error
    return doc.lines(significant(best.recovered_snr), "" if error is None else doc.small(f"± {significant(error, 2)}"))


def _significance(best: results.BandConfirmation) -> str:
    return f"{significant(best.recovered_significance)} / {significant(best.threshold)}"


_NOWHERE = doc.Span("the images show the planet in no band; see below", 8)
_FIRST: tuple[doc.Column[_Pick], ...] = (
    doc.Column("#", lambda pick: str(pick[1].ranked.rank)),
    doc.Column("Star", _picked_star, look="row left"),
    doc.Column("V", lambda pick: decimals(pick[1].ranked.v_mag, 2), "mag"),
    doc.Column("Distance", lambda pick: significant(pick[1].ranked.distance_pc, 4), "pc"),
    doc.Column("Band", _of_band(lambda best: best.band), look="left"),
    doc.Column("Frames × exposure", lambda pick: _NOWHERE if pick[2] is None else frames_text(pick[2]), "s"),
    doc.Column("EM gain", _of_band(lambda best: significant(best.em_gain))),
    doc.Column("Wall time", _of_band(lambda best: duration_text(best.time_s))),
    doc.Column("Separation", _of_band(lambda best: decimals(best.separation_arcsec, 3)), "arcsec"),
    doc.Column("Contrast", _of_band(lambda best: numbers.contrast_text(best.true_contrast))),
    doc.Column("SNR", _of_band(lambda best: significant(best.predicted_snr)), "predicted"),
    doc.Column("SNR", _of_band(_recovered), "recovered"),
    doc.Column("Significance", _of_band(_significance), "/ threshold"),
    doc.Column("Verdict", _pick_verdict, look="left verdict"),
)


@doc.section_of(PLAN_SECTIONS, "first", "What to observe first")
def _observe_first(report: PlanReport) -> Iterator[doc.Block]:
    plan = report.plan
    if plan.targets:
        caption = (
            "Targets confirmed with simulated images, in order of the ranking; each in the band of highest predicted "
            f"margin among those in which {LIBRARIES[plan.reference_library].found} in at least half of the "
            f"{plan.realisations} realisations or, without any, among those that show it at its known place. "
            "Separation and contrast are those of the reference planet; the verdict is of all bands."
        )
        picks = [(number, target, summary.chosen(target)) for number, target in enumerate(plan.targets, 1)]
        yield doc.table("What to observe first", caption, _FIRST, picks)
    else:
        yield doc.Paragraph("No target was confirmed.")
    for text in (*words.targets_sentences(plan), *words.not_imaged_lines(plan)):
        yield doc.Paragraph(text, "note")
    yield doc.Paragraph(
        "Wall time is all visits to one target in one band: science frames, reference frames, readouts and the "
        "overhead of each visit. Occultations and visibility are not in it.",
        "note",
    )


_REQUEST: tuple[doc.Column[tuple[results.ConfirmedTarget, results.BandConfirmation]], ...] = (
    doc.Column("Star", lambda row: _star(pretty_name(row[0].name), row[0].hip), look="row left"),
    doc.Column("RA", lambda row: words.ra_text(row[0].ranked.ra_deg), "ICRS"),
    doc.Column("Dec", lambda row: words.dec_text(row[0].ranked.dec_deg), "ICRS"),
    doc.Column("Band", lambda row: row[1].band, look="left"),
    doc.Column("Frames", lambda row: count_text(row[1].n_frames), "science"),
    doc.Column("Exposure", lambda row: significant(row[1].exposure_s), "s"),
    doc.Column("EM gain", lambda row: significant(row[1].em_gain)),
    doc.Column("Wall time", lambda row: duration_text(row[1].time_s)),
)


@doc.section_of(PLAN_SECTIONS, "request", "Observing request")
def _request(report: PlanReport) -> Iterator[doc.Block]:
    chosen = [(target, summary.chosen(target)) for target in report.plan.targets]
    rows = [(target, best) for target, best in chosen if best is not None]
    if not rows:
        yield doc.Paragraph("The images chose no band for any target, so that there is nothing to ask for.")
        return
    caption = (
        "What to ask for: one line for each target with a chosen band. The wall time holds science frames, reference "
        f"frames ({LIBRARIES[report.plan.reference_library].meaning}) and readouts; positions are those of the "
        "catalogue epoch, without proper motion."
    )
    yield doc.table("Observing request", caption, _REQUEST, rows)
    total_s = sum(best.time_s or 0.0 for _, best in rows)
    yield doc.Paragraph(f"Sum of the wall times: {duration_text(total_s)}.", "note")


@doc.section_of(PLAN_SECTIONS, "priorities", "Priorities")
def _priorities(report: PlanReport) -> Iterator[doc.Block]:
    yield from priority_blocks(report.rank, report.rows)
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


@doc.section_of(PLAN_SECTIONS, "targets", "Targets")
def _targets(report: PlanReport) -> Iterator[doc.Block]:
    for number, target in enumerate(report.plan.targets, 1):
        title = f"{target.ranked.rank}. {numbers.full_name(target.name, target.hip)}"
        yield doc.Group(f"target-{number}", title, list(star_blocks(target, report.images)))


def _companion_text(star: results.RankedTarget) -> str:
    """Where the nearest companion stands, with the error of its place."""
    angle, error = star.companion_pa_deg, star.companion_position_error_arcsec
    text = f"{significant(star.companion_separation_arcsec, 3)} arcsec"
    text += "" if error is None else f" ± {significant(error, 1)}"
    return text + (", position angle not known" if angle is None else f", position angle {round(angle)} deg")


def star_blocks(target: results.ConfirmedTarget, images: Mapping[str, Picture]) -> Iterator[doc.Block]:
    """Yield what images show of one star: facts, verdict, measurements in each band, pictures.

    Parameters
    ----------
    target : ConfirmedTarget
    images : mapping of str to Picture
        By ``BandConfirmation.image``.
    """
    star, name = target.ranked, pretty_name(target.name)
    facts: list[tuple[doc.Inline, doc.Inline]] = [
        ("Catalogue name", target.name),
        ("Position (ICRS)", f"{words.ra_text(star.ra_deg)}, {words.dec_text(star.dec_deg)}"),
        ("Type, V", f"{star.sp_type}, {decimals(star.v_mag, 2)} mag"),
        ("Distance", f"{significant(star.distance_pc, 4)} pc"),
    ]
    if star.luminosity_lsun is not None:
        facts.append(("Luminosity", [f"{significant(star.luminosity_lsun)} L", doc.Mark("sub", "☉")]))
    if star.companion_separation_arcsec is not None:
        facts.append(("Nearest known companion", _companion_text(star)))
    sunlight = star.ref_planet_insolation_au
    lit = "" if sunlight is None else f" (sunlight of {significant(sunlight)} au)"
    facts += [
        ("Reference planet", f"{significant(target.planet_distance_au)} au from the star{lit}"),
        ("Completeness", _completeness_fact(star)),
        ("Predicted margin", f"{significant(star.detection_margin)} in {star.band}"),
    ]
    facts += [(title, text) for title, text in image_figures.visits_facts(target).items()]
    yield doc.Facts(facts, wide=False)
    if star.flags:
        yield doc.Facts([("Caveats", "; ".join(words.flag_text(flag) for flag in star.flags))])
    if target.verdict:
        yield doc.Paragraph(doc.strong(words.sentence(target.verdict)))
    picked = f"The chosen band is {target.chosen_band}." if target.chosen_band else "No band was chosen."
    yield image_figures.measure_table(name, target.bands, f"{name} by band. {picked}", target.chosen_band)
    yield from image_figures.audit_blocks(name, target.bands)
    yield from image_figures.picture_blocks(images, [band.image for band in target.bands if band.image], name)


def _completeness_fact(star: results.RankedTarget) -> str:
    fact = f"{numbers.share_text(star.completeness)} % in {star.completeness_band}"
    of_all, placed = star.completeness_unconditional, star.completeness_known_place
    if placed is not None:
        fact = f"{fact} by a blind search, {numbers.share_text(placed)} % at known places"
    return fact if of_all is None else f"{fact}; blind {numbers.share_text(of_all)} % whatever is known of the star"


@doc.section_of(PLAN_SECTIONS, "assumptions", "Assumptions")
def _assumptions(report: PlanReport) -> Iterator[doc.Block]:
    plan, library = report.plan, LIBRARIES[report.plan.reference_library]
    audited = any(band.audit for target in plan.targets for band in target.bands)
    scheduled = "" if plan.schedule is None else " Visits of the schedule take that of their frames."
    once = ", and one more frame by frame in the band of each target that promises most" if audited else ""
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
        name=lambda row: _star(pretty_name(row.name), row.hip),
        distance_pc=lambda row: significant(row.distance_pc, 4),
        score=Cells("", lambda row: words.score_number(row.score, score.name), label="score", unit=score.unit),
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
    yield from _velocities(rank, len(rows))
    if reasons := sorted({row.reason for row in rows if row.reason}):
        yield doc.Heading("Reasons used here")
        yield doc.Facts([(reason.replace("_", " "), words.reason_text(reason)) for reason in reasons])
    shown = [*rows, *(target.ranked for target in report.plan.targets)]
    if flags := sorted({flag for row in shown for flag in row.flags}):
        yield doc.Heading("Flags used here")
        yield doc.Facts([(doc.code(flag), words.flag_text(flag)) for flag in flags])


def _velocities(rank: results.RankResult, first: int) -> Iterator[doc.Block]:
    """What is expected with what is known, and where more velocities would change it."""
    if expected := summary.expected_sentence(rank):
        yield doc.Paragraph(expected)
    if rows := summary.unprobed_stars(rank, first):
        columns = doc.row_columns(
            results.RankedTarget,
            "rank name:row,star completeness completeness_unconditional rv_amplitude_m_s ref_planet_distance_au",
            name=lambda row: _star(pretty_name(row.name), row.hip),
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
    yield doc.Items((*data_credits(report.plan.catalogue), *method_credits()))
