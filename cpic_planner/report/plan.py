"""Plans: in words, on the terminal, and as reports with a page a star."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from operator import itemgetter

from catalogs import data_credits
from cpic_core import Record, Registry, listed
from cpic_planner import results
from cpic_planner.queries import LIBRARIES
from cpic_planner.registry import SCORES
from cpic_planner.report import confirm, document as doc, ranking, words
from cpic_planner.report.drawing import Picture
from cpic_planner.report.image_figures import Panels, PanelSheet, snr_figure
from cpic_planner.report.known import known_planet_name, window_blocks, windows_text
from cpic_planner.report.ranking_figures import HoleEdges, LimitCurve, contrast_diagram, margin_figure, sky_map
from cpic_planner.report.simulation import modelled_blocks
from cpic_planner.report.words import MISSING, count_text, counted, duration_text, pretty_name, significant
from cpic_planner.results import BandConfirmation, ConfirmedTarget, PlanResult, RankedTarget, RankResult

_MOST_LEFT_OUT = 10


def targets_sentences(plan: PlanResult) -> list[str]:
    """Return where the targets come from: stars that are seen in a period, or the visits of a schedule."""
    found = []
    if (made := plan.schedule) is not None:
        left = made.n_stars - len(plan.targets)
        more = f"; {counted(left, 'more star')} can be imaged (a larger --top)" if left else ""
        visits = f"{made.n_imaged} of {counted(made.n_visits, 'visit')}{more}"
        found += [words.text("texts.plan_schedule", made=made, visits=visits), words.text("texts.plan_together")]
    if (period := plan.period) is not None:
        days = f"{counted(period.n_days, 'day')} from {period.start_utc[:10]} on"
        found.append(words.text("texts.plan_period", days=days, pointing=period.pointing))
        if period.not_checked:
            names = ", ".join(map(pretty_name, period.not_checked))
            found.append(f"Visibility is not known of {names}: the star table has no coordinates.")
        if period.left_out:
            first = period.left_out[:_MOST_LEFT_OUT]
            named = [f"{pretty_name(row.name)}, rank {row.rank} ({row.message})" for row in first]
            rest = len(period.left_out) - len(named)
            more = f"; and {counted(rest, 'more star')}, which plan.json names" if rest else ""
            found.append(f"Left out, limited by visibility: {'; '.join(named)}{more}.")
    return found


def not_imaged_lines(plan: PlanResult) -> list[str]:
    """Return the lines of a schedule that have no images, one text for each reason."""
    rows: dict[str, list[str]] = {}
    for row in () if plan.schedule is None else plan.schedule.not_imaged:
        rows.setdefault(row.message, []).append(f"{row.row} ({pretty_name(row.star)}, {row.band})")
    return [f"No images of row{'s' * (len(named) > 1)} {', '.join(named)}: {why}." for why, named in rows.items()]


_Measured = tuple[ConfirmedTarget, BandConfirmation]


def _measured_table(
    plan: PlanResult, named: Callable[[ConfirmedTarget], doc.Inline], *, legend: bool = False
) -> doc.Table:
    """Return a line for each target and band that was simulated as images."""
    rows = [(target, band) for target in plan.targets for band in target.bands]

    def target(row: _Measured) -> doc.Inline:
        return named(row[0]) if row[1] is row[0].bands[0] else ""

    star = results.taken_of(ConfirmedTarget, "name", "hip", of=itemgetter(0))
    band = results.taken_of(BandConfirmation, "band", of=itemgetter(1))
    chosen = "→ marks the one to observe in"
    columns = [
        doc.own_column("target", target, look="row left star", files=star),
        doc.own_column(
            "band",
            lambda row: f"{'→' if _is_chosen(row) else ' '} {row[1].band}",
            look="left",
            legend=chosen,
            files=band,
        ),
        *confirm.measured_columns(confirm.MEASURED.format(more=""), itemgetter(1), plan.reference_library),
    ]
    found = sum(any(band.detected for band in target.bands) for target in plan.targets)
    of = f"{found} of {counted(len(plan.targets), 'target')}"
    title = f"Confirmed by simulated images: {of}, {counted(plan.realisations, 'realisation')} each"
    caption = words.text("texts.plan_columns", library=LIBRARIES[plan.reference_library])
    return doc.Table(title, columns, rows, caption, picked=_is_chosen, legend=legend)


def _is_chosen(row: _Measured) -> bool:
    return row[1].band == row[0].chosen_band


def plan_blocks(plan: PlanResult, *, full: bool = True) -> Iterator[doc.Block]:
    """Yield the confirmed targets of a plan, band by band, and how the ETC stands.

    Parameters
    ----------
    plan : PlanResult
    full : bool
        Also the verdicts of the targets, how images were made, and where targets come from.
    """
    bands = [band for target in plan.targets for band in target.bands]
    yield _measured_table(plan, lambda target: words.short_name(target.name), legend=not full)
    yield from doc.notes(words.unused_text(bands))
    yield from doc.notes(*(_verdict_lines(plan) if full else ()), look="")
    yield from confirm.comparison_blocks(plan, bands)
    if not full:
        yield from doc.notes(*_left_out_lines(plan))
        return
    ranked = words.chosen_text(plan.n_ranked, plan.n_in_catalogue)
    yield from doc.notes(
        confirm.modelled_sentence(bands),
        *targets_sentences(plan),
        *not_imaged_lines(plan),
        f"{ranked} ranked. {confirm.setup_text(plan)}",
    )


def _verdict_lines(plan: PlanResult) -> list[str]:
    return [f"{pretty_name(target.name)}: {words.found_text(target.verdict)}" for target in plan.targets]


def _left_out_lines(plan: PlanResult) -> list[str]:
    """Return how many stars and rows there are no images of; none where there are none."""
    stars = 0 if plan.period is None else len(plan.period.left_out)
    rows = 0 if plan.schedule is None else len(plan.schedule.not_imaged)
    parts = [f"{counted(stars, 'star')} left out for visibility"] * bool(stars)
    parts += [f"{counted(rows, 'row')} of the schedule without images"] * bool(rows)
    return [f"{' and '.join(parts)}: -v names them."] if parts else []


_MOST_NAMED, _SEASONS = 6, 3
_Pick = tuple[int, ConfirmedTarget, BandConfirmation | None]
"""Number of a target in the plan, the target, and what its images say of its chosen band."""
_Facts = list[tuple[doc.Inline, doc.Inline]]


def _picks(plan: PlanResult) -> list[_Pick]:
    """Return the targets of a plan with their chosen bands."""
    chosen = (next((band for band in one.bands if band.band == one.chosen_band), None) for one in plan.targets)
    return [(number, *pick) for number, pick in enumerate(zip(plan.targets, chosen, strict=True), 1)]


def _star_cell(name: doc.Inline, hip: int | None) -> doc.Inline:
    """Return the name of a star with its Hipparcos number below."""
    return doc.lines(name, doc.small(f"HIP {hip}") if hip is not None else "")


def _badge(pick: _Pick) -> doc.Mark:
    return doc.badge("unreachable", "not confirmed") if pick[2] is None else confirm.outcome(pick[2])


def _seasons_texts(plan: PlanResult, name: str) -> list[str]:
    """Return the times in which a target can be seen in the period of the plan; empty where that is not known."""
    seen = () if plan.period is None else plan.period.seen
    seasons = next((row.seasons for row in seen if row.name == name), [])
    texts = [f"{season.start_utc[:10]} to {season.end_utc[:10]}" for season in seasons[:_SEASONS]]
    return [*texts, *([f"and {len(seasons) - _SEASONS} more"] if len(seasons) > _SEASONS else [])]


def _asks_text(star: RankedTarget) -> str:
    """Return the least time and visits that a detection of a star's reference planet asks for."""
    if star.detection_time_s is None:
        return "no time is enough"
    visits = "" if star.detection_visits is None else f" in {counted(star.detection_visits, 'visit')}"
    return f"{duration_text(star.detection_time_s)}{visits}"


def _decision_sentences(plan: PlanResult) -> list[str]:
    """Return what to observe first and when, what comes next, and how long all of it takes."""
    if not plan.targets:
        return ["No star was simulated as images, so that none is proposed."]
    ready = [(target, best) for _, target, best in _picks(plan) if best is not None]
    if not ready:
        stars = counted(len(plan.targets), "star")
        return [f"None is proposed: the images of {stars} show the reference planet in no band."]
    (first, best), *others = ready
    visits = "" if best.visits is None else f"{counted(best.visits, 'visit')}, in all "
    found = [words.text("texts.plan_observe", first=first, best=best, visits=visits, time=_time_text([best]))]
    if when := _seasons_texts(plan, first.name):
        found.append(f"It can be seen {', '.join(when)}.")
    if not best.detected:
        found.append("Its images show the planet at a known place, but a blind search does not find it.")
    if others:
        names = listed([pretty_name(target.name) for target, _ in others], _MOST_NAMED)
        together = _time_text([best for _, best in ready])
        found.append(f"Then {names}, as in the table. All {len(ready)} stars together take {together}.")
    return found


def _time_text(bands: Sequence[BandConfirmation]) -> str:
    """Return the telescope time of observations, and the wall time of their frames."""
    wall = f"{duration_text(sum(band.time_s or 0.0 for band in bands))} of wall time"
    hours = [band.telescope_h for band in bands if band.telescope_h is not None]
    if not hours:
        return f"{wall}; the telescope time is not known"
    some = "" if len(hours) == len(bands) else f" without the {len(bands) - len(hours)} where it is not known"
    return f"{_hours_text(sum(hours))} of telescope time{some} ({wall} with references and readouts)"


def _hours_text(hours: float | None) -> str:
    return MISSING if hours is None else f"{significant(hours)} h"


def _first_table(report: PlanReport) -> doc.Table:
    """Return what to ask for: a line a target, with what a detection asks for and what the images say."""
    plan = report.plan

    def star(pick: _Pick) -> doc.Inline:
        row = pick[1].ranked
        place = [] if row.hip is None else [f"HIP {row.hip}"]
        place += [] if row.ra_deg is None else [f"{words.ra_text(row.ra_deg)} {words.dec_text(row.dec_deg)}"]
        return doc.lines(doc.link(f"target-{pick[0]}", pretty_name(pick[1].name)), *map(doc.small, place))

    def least(pick: _Pick) -> doc.Inline:
        hours, asks = pick[1].detection_telescope_h, _asks_text(pick[1].ranked)
        return asks if hours is None else doc.lines(_hours_text(hours), doc.small(asks))

    def ranks(pick: _Pick) -> str:
        """Return between which ranks a star is: under an ensemble of instruments, or else under other assumptions."""
        target, row = pick[1], pick[1].ranked
        low, high = target.rank_lowest, target.rank_highest
        if row.rank_p05 is not None and row.rank_p95 is not None:
            low, high = round(row.rank_p05), round(row.rank_p95)
        return MISSING if low is None or high is None else f"{low} to {high}" if low < high else f"{low}"

    def seen(pick: _Pick) -> doc.Inline:
        return doc.lines(*_seasons_texts(plan, pick[1].name)) or MISSING

    n_assumptions = 0 if report.sensitivity is None else len(report.sensitivity.rows)
    doubted = "5 to 95 % of instruments" if report.rank.ensemble else f"under {counted(n_assumptions, 'assumption')}"
    columns = [
        doc.own_column("#", "{1.ranked.rank}"),
        doc.own_column("star", star, look="row left star"),
        doc.own_column("band", "{2.band}\ngain {2.em_gain:.3g}"),
        doc.own_column("visits", "{2.visits}\n{2.n_frames} × {2.exposure_s:.3g} s", "frames × exposure"),
        doc.own_column("telescope time", "{2.telescope_h:.3g} h\n{2.time_s:time}", "wall time"),
        doc.own_column("a detection asks for", least, "at least"),
        doc.own_column("SNR", "{2.predicted_snr:.3g}", "predicted"),
        doc.own_column("found blind", "{2.predicted_detection_probability:%}", "predicted, %"),
        doc.own_column("rank", ranks, doubted),
        doc.own_column("can be seen", seen, look="left"),
        doc.own_column("in images", _badge, look="left"),
    ]
    return doc.Table("What to observe first", columns, _picks(plan), words.text("texts.plan_first"), look="firm")


def _reference_text(plan: PlanResult) -> str:
    """Return where the reference frames come from; of another star what it has to be."""
    text = words.sentence(LIBRARIES[plan.reference_library].meaning)
    if plan.reference_star_v_mag is None:
        return text
    star = f"V {significant(plan.reference_star_v_mag)} and {significant(plan.reference_star_teff_k, 4)} K"
    return f"{text} It is taken to have {star}; the plan does not choose it, and counts one slew a visit for it."


def _tier_facts(report: PlanReport) -> _Facts:
    """Return how many stars are in each tier, what it means, and which come first."""
    facts: _Facts = []
    for tier, meaning in ranking.TIERS.items():
        rows = [row for row in report.rank.targets if row.tier == tier]
        if not rows:
            continue
        names: list[doc.Inline] = []
        for row in rows[:_MOST_NAMED]:
            names += [", " if names else "", report.named(row)]
        more = f" and {count_text(len(rows) - _MOST_NAMED)} more" if len(rows) > _MOST_NAMED else ""
        facts.append((f"Tier {tier}: {counted(len(rows), 'star')}", [f"{meaning}: ", names, f"{more}."]))
    return facts


def _decision_blocks(report: PlanReport) -> Iterator[doc.Block]:
    """Yield page one of a plan."""
    plan = report.plan
    if altered := confirm.overrides_sentence(plan):
        yield doc.Paragraph(doc.strong(altered), "altered")
    first, *others = _decision_sentences(plan)
    yield doc.Paragraph([doc.strong(first), " ".join(["", *others])], "lead")
    if plan.targets:
        yield _first_table(report)
    facts = [*_tier_facts(report), ("Reference frames", _reference_text(plan))]
    doubts = [doubted.statement for doubted in (report.rank.ensemble, report.sensitivity) if doubted is not None]
    if doubts:
        facts.append(("What would change", " ".join(doubts)))
    yield doc.Facts([*facts, ("Does the prediction hold?", confirm.calibration_sentence(plan))])


def summary_sentences(plan: PlanResult, rank: RankResult) -> list[str]:
    """Return the summary of the plan, one sentence an item."""
    stars = words.chosen_text(plan.n_ranked, plan.n_in_catalogue)
    ranked = f"{stars} {'was' if plan.n_ranked == 1 else 'were'} ranked by {_score_words(rank)}"
    limits = f" ({ranking.limits_text(rank.counts_limited_by)})" if rank.counts_limited_by else ""
    sentences = [
        f"{ranked}, in at most {duration_text(plan.time_s)} of wall time per target and band.",
        f"A reference planet ({ranking.planet_text(plan)}) is predicted to be detected around "
        f"{count_text(plan.counts.get('ok', 0))} of them, {ranking.programme_text(rank)}{limits}.",
        *filter(None, [ranking.detected_sentence(rank)]),
        *([] if rank.ensemble is None else [rank.ensemble.statement]),
    ]
    if not plan.targets:
        return [*sentences, "No target was simulated as images."]
    confirmed = [(target, band) for _, target, band in _picks(plan) if band is not None and band.detected]
    measured = [band for target in plan.targets for band in target.bands if band.recovered_snr is not None]
    detections = sum(bool(band.detected) for band in measured)
    searched = LIBRARIES[plan.reference_library].searched
    first = "The first" if plan.schedule is None else "Of the schedule"
    first = f"{first} {counted(len(plan.targets), 'target')}"
    found = f"{len(confirmed)} of {len(plan.targets)}, in {detections} of {counted(len(measured), 'measurement')}"
    sentences.append(words.text("texts.plan_simulated", first=first, plan=plan, searched=searched, found=found))
    if confirmed:
        target, band = confirmed[0]
        which = "Highest ranked" if plan.schedule is None else "First"
        sentences.append(words.text("texts.plan_confirmed", which=which, target=target, band=band))
        counts = Counter(band.band for _, band in confirmed)
        picked = ", ".join(f"{band} ({count})" for band, count in counts.most_common())
        sentences.append(f"Chosen bands, with number of targets: {picked}.")
    return sentences


def _score_words(rank: RankResult) -> str:
    """Return what the ranking is by, for the middle of a sentence."""
    share, hourly = f"the fraction of the population {rank.population.name} that one observation detects", "per hour"
    if rank.population.name == results.KNOWN_PLANETS:
        share = "the probability that one observation detects at least one of the star's own planets"
        hourly = "divided by its hours"
    return SCORES[rank.score_name].aim.format(share=share, hourly=hourly)


def _star_pages(report: PlanReport) -> Iterator[doc.Block]:
    """Yield the pages of the targets, and a folded one for every other star that is shown."""
    for target in report.plan.targets:
        title = f"{target.ranked.rank}. {words.full_name(target.name, target.hip)}"
        seasons = _seasons_texts(report.plan, target.name)
        seen: _Facts = [("Can be seen", doc.lines(*seasons))] if seasons else []
        blocks = star_blocks(target, report.images, [*seen, *_known_facts(target.ranked, report.known)])
        yield doc.Group(report.anchors[target.name], title, list(blocks))
    targets = {target.name for target in report.plan.targets}
    others = [row for row in report.rows if row.name not in targets]
    if others:
        yield doc.Heading("Stars without images")
    for row in others:
        facts = [*doc.facts_of(row, _STAR_FACTS), *_known_facts(row, report.known)]
        tier = "" if row.tier is None else f", tier {row.tier}"
        title = f"{row.rank}. {words.full_name(row.name, row.hip)}{tier}"
        yield doc.Fold(title, [doc.Facts(facts, wide=False), *_caveats(row)], anchor=report.anchors[row.name])


def _caveats(star: RankedTarget) -> list[doc.Block]:
    return [doc.Facts([("Caveats", "; ".join(map(words.flag_text, star.flags)))])] if star.flags else []


def _companion_text(star: RankedTarget) -> doc.Inline:
    if star.companion_separation_arcsec is None:
        return MISSING
    place = doc.own_column("", "{companion_separation_arcsec:.3g} ± {companion_position_error_arcsec:.1g} arcsec")
    turned = "not known" if star.companion_pa_deg is None else f"{round(star.companion_pa_deg)} deg"
    return doc.lines(doc.cell(place, star), doc.small(f"position angle {turned}"))


_STAR_FACTS: Mapping[str, str | Callable[[RankedTarget], doc.Inline]] = {
    "Catalogue name": "{name}",
    "Position (ICRS)": lambda star: f"{words.ra_text(star.ra_deg)}, {words.dec_text(star.dec_deg)}",
    "Type, V": "{sp_type}, {v_mag:.2f} mag",
    "Distance": "{distance_pc:.4g} pc",
    "Luminosity": "{luminosity_lsun:.3g} L☉",
    "Nearest known companion": _companion_text,
    "Reference planet": "{ref_planet_distance_au:.3g} au from the star, contrast {contrast:power}\n"
    "sunlight of {ref_planet_insolation_au:.3g} au",
    "Tier": lambda star: MISSING if star.tier is None else f"{star.tier}: {ranking.TIERS[star.tier]}",
    "A detection asks for": _asks_text,
    "Limited by": lambda star: words.LIMITED_BY[star.limited_by or "none"][1].removeprefix("nothing"),
    "Drift that would be enough": "×{required_drift_factor:.2g}",
    "Brightness of the planet that would be enough": "×{required_contrast_factor:.2g}",
    "Completeness": "{completeness:%} % in {completeness_band}\n{completeness_known_place:%} % at known places\n"
    "blind {completeness_unconditional:%} % whatever is known of the star",
    "Expected planets of one observation": "{expected_planets:.2g}\n"
    "{expected_planets_unconditional:.2g} if nothing were known of the star",
    "Under the ensemble of instruments": "detected by {p_reachable:%} % of them, rank {rank_p05:.0f} to {rank_p95:.0f}",
}


def _known_facts(star: RankedTarget, known: results.KnownResult | None) -> _Facts:
    """Return the known planets of the star, each with its next days in the dark hole."""
    rows = [] if known is None else [row for row in known.planets if row.counted and row.star == star.name]
    none = "at no time more likely than not in a dark hole"
    return [(f"Known planet {known_planet_name(row)}", windows_text(row) if row.windows else none) for row in rows]


def _visits_facts(target: ConfirmedTarget) -> _Facts:
    """Return the visits of a confirmed target, in words by heading: those of the ranking, or of a schedule."""
    if target.roll_deg is not None:
        own = ", ".join(f"{band.visits} in {band.band}" for band in target.bands if band.visits is not None)
        return [("Visits", f"{own or 'none'}, reduced together"), ("Roll", f"{target.roll_deg:g} deg")]
    star = target.ranked
    if star.visits is None or star.visit_time_s is None:
        return []
    span = "" if star.span_days is None else f" over {significant(star.span_days, 2)} days"
    paid = words.orbits_text([star])
    visits = f"{star.visits} of {duration_text(star.visit_time_s)}{span}, reduced together"
    return [("Visits", f"{visits}; {paid}" if paid else visits)]


def star_blocks(
    target: ConfirmedTarget, images: Mapping[str, Picture], more: Sequence[tuple[doc.Inline, doc.Inline]] = ()
) -> Iterator[doc.Block]:
    """Yield what images show of one star: facts, verdict, measurements in each band, pictures.

    Parameters
    ----------
    target : ConfirmedTarget
    images : mapping of str to Picture
        By ``BandConfirmation.image``.
    more : sequence of tuple
        Further facts of the star.
    """
    star, name = target.ranked, pretty_name(target.name)
    margin = ("Predicted margin", f"{significant(star.detection_margin)} in {star.band}")
    yield doc.Facts([*doc.facts_of(star, _STAR_FACTS), margin, *_visits_facts(target), *more], wide=False)
    yield from _caveats(star)
    if target.verdict:
        yield doc.Paragraph(doc.strong(words.sentence(words.found_text(target.verdict))))
    picked = f"The chosen band is {target.chosen_band}." if target.chosen_band else "No band was chosen."
    yield confirm.measure_table(name, target.bands, f"{name} by band. {picked}", target.chosen_band)
    yield from confirm.audit_blocks(name, target.bands)
    yield from confirm.picture_blocks(images, [band.image for band in target.bands if band.image], name)


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


class PlanReport(Record):
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

    plan: PlanResult
    rank: RankResult
    figures: Mapping[str, Picture]
    images: Mapping[str, Picture]
    sensitivity: results.SensitivityResult | None = None
    known: results.KnownResult | None = None
    top_rows: int = 50

    @cached_property
    def anchors(self) -> dict[str, str]:
        """Anchors of the pages of stars, by name: of targets, and of the other stars that are shown."""
        targets = {target.name: f"target-{number}" for number, target in enumerate(self.plan.targets, 1)}
        return {row.name: f"star-{row.rank}" for row in self.rows} | targets

    def named(self, row: RankedTarget) -> doc.Inline:
        """Return the name of a star, as a link where it has a page."""
        name = pretty_name(row.name)
        return doc.link(self.anchors[row.name], name) if row.name in self.anchors else name

    @property
    def rows(self) -> list[RankedTarget]:
        """Rows of the ranking that are printed."""
        return self.rank.targets[: self.top_rows]


PLAN_SECTIONS: Registry[doc.Section[PlanReport]] = Registry("section")
"""Sections of the report, in their order."""


def plan_document(report: PlanReport) -> doc.Document:
    """Return the report of a plan."""
    return doc.document_of(
        PLAN_SECTIONS,
        report,
        title=f"CPI-C target plan, configuration {report.plan.config_hash}",
        heading="CPI-C target plan",
        about=words.text("texts.plan_about"),
        opening="What to observe first",
        summary=_decision_blocks(report),
    )


@doc.section_of(PLAN_SECTIONS, "first", "What the images show")
def _images(report: PlanReport) -> Iterator[doc.Block]:
    plan = report.plan
    yield doc.Items(summary_sentences(plan, report.rank))
    if plan.targets:
        yield _measured_table(plan, lambda target: doc.link(report.anchors[target.name], pretty_name(target.name)))
        yield doc.Items(_verdict_lines(plan))
    else:
        yield doc.Paragraph("No target was simulated as images.")
    yield from doc.notes(*targets_sentences(plan), *not_imaged_lines(plan))


@doc.section_of(PLAN_SECTIONS, "priorities", "Priorities")
def _priorities(report: PlanReport) -> Iterator[doc.Block]:
    yield from ranking.priority_blocks(report.rank, report.rows, report.named)
    if report.known is not None:
        yield from window_blocks(report.known)


@doc.section_of(PLAN_SECTIONS, "sensitivity", "What the ranking depends on")
def _sensitivity(report: PlanReport) -> Iterator[doc.Block]:
    if report.sensitivity is not None:
        yield from ranking.sensitivity_blocks(report.sensitivity)


@doc.section_of(PLAN_SECTIONS, "figures", "Figures")
def _figures(report: PlanReport) -> Iterator[doc.Block]:
    for key, title in PLAN_FIGURES.items():
        if key in report.figures:
            more = confirm.calibration_sentence(report.plan) if key == "calibration" else ""
            yield doc.Figure(report.figures[key], title, key, more=more)


@doc.section_of(PLAN_SECTIONS, "targets", "A page a star")
def _stars(report: PlanReport) -> Iterator[doc.Block]:
    return _star_pages(report)


@doc.section_of(PLAN_SECTIONS, "assumptions", "Assumptions")
def _assumptions(report: PlanReport) -> Iterator[doc.Block]:
    plan, rank, library = report.plan, report.rank, LIBRARIES[report.plan.reference_library]
    audited = any(band.audit for target in plan.targets for band in target.bands)
    scheduled = "" if plan.schedule is None else " Visits of the schedule take that of their frames."
    once = (
        ", and one more with every effect of single frames in the band of each target that promises most"
        if audited
        else ""
    )
    about = {"sigma": plan.sigma, "programme": ranking.programme_text(rank), "found": library.found}
    subtracted = f"); {plan.rdi_modes} modes are subtracted."
    yield doc.Facts(
        [
            ("Reference planet", words.text("texts.plan_planet", planet=ranking.planet_text(plan))),
            ("Population", f"{ranking.population_text(rank.population)}."),
            ("Score", f"{SCORES[rank.score_name].meaning}."),
            ("Wall time", words.text("texts.plan_time", plan=plan, scheduled=scheduled)),
            ("Reference library", [f"{library.meaning} (", doc.code(library.name), subtracted]),
            ("Detection threshold", words.text("texts.plan_threshold", **about)),
            ("Realisations", f"{plan.realisations} of each target and band{once}."),
            ("Sample", f"{plan.sample}."),
            ("Catalogue", f"{plan.catalogue}."),
            *doc.notes_fact(plan.notes),
            ("Places of stars and companions", f"those of {plan.date_utc[:10] or 'no date that is recorded'}."),
            ("Instrument", confirm.instrument_fact(plan)),
        ]
    )


@doc.section_of(PLAN_SECTIONS, "modelled", "What was modelled")
def _modelled(report: PlanReport) -> Iterator[doc.Block]:
    bands = ((pretty_name(target.name), band) for target in report.plan.targets for band in target.bands)
    made = [(f"{name} {band.band}", band.modelled) for name, band in bands if band.modelled is not None]
    return modelled_blocks(made)


@doc.section_of(PLAN_SECTIONS, "missing", "What is not modelled")
def _missing(report: PlanReport) -> Iterator[doc.Block]:
    return confirm.not_modelled_blocks(report.plan.not_modelled)


@doc.section_of(PLAN_SECTIONS, "ranking", "Ranking")
def _ranking(report: PlanReport) -> Iterator[doc.Block]:
    rank, rows, score = report.rank, report.rows, SCORES[report.rank.score_name]

    def completeness(row: RankedTarget) -> doc.Inline:
        if not row.completeness > 0:
            return words.share_text(row.completeness)
        share, error = words.share_text(row.completeness), significant(100 * row.completeness_error, 1)
        return doc.lines(f"{share} ± {error}", doc.small(row.completeness_band))

    def standing(row: RankedTarget) -> doc.Inline:
        limit = words.LIMITED_BY[row.limited_by][0] if row.limited_by else row.reason.replace("_", " ")
        badge = doc.badge(row.status, words.verdict_text(row.verdict, row.status))
        return doc.lines(badge, limit if row.reason else "")

    stars = words.chosen_text(len(rank.targets), rank.n_in_catalogue, "ranked star")
    columns = doc.row_columns(
        RankedTarget,
        f"rank {'rank_in_catalogue ' * rank.filtered}name:row,star v_mag sp_type distance_pc score completeness "
        "completeness_unconditional band separation_arcsec contrast frames em_gain snr detection_margin "
        "status:left,wide flags:left,flags",
        name=lambda row: _star_cell(report.named(row), row.hip),
        distance_pc="{distance_pc:.4g}",
        score=ranking.score_column(score.name),
        completeness=completeness,
        status=standing,
        flags=lambda row: doc.marked(" ".join(f"`{flag}`" for flag in row.flags)),
    )
    caption = doc.marked(words.text("texts.plan_ranking", n_rows=len(rows), stars=stars, score=score))
    yield doc.Table("Ranking", columns, rows, caption, look="compact")
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
    if expected := ranking.expected_sentence(report.rank):
        yield doc.Paragraph(expected)
    if rows := ranking.unprobed_stars(report.rank, len(report.rows)):
        columns = doc.row_columns(
            RankedTarget,
            "rank name:row,star completeness completeness_unconditional rv_amplitude_m_s ref_planet_distance_au",
            name=lambda row: _star_cell(report.named(row), row.hip),
        )
        yield doc.Table("Where velocities are missing", columns, rows, words.text("texts.plan_velocities"))


@doc.section_of(PLAN_SECTIONS, "glossary", "Glossary")
def _glossary(report: PlanReport) -> Iterator[doc.Block]:
    yield doc.Facts(words.terms())


@doc.section_of(PLAN_SECTIONS, "reproduce", "Reproducing this")
def _reproduce(report: PlanReport) -> Iterator[doc.Block]:
    beside = {"sensitivity.json": report.sensitivity, "known.json": report.known}
    more = "".join(f", `{name}`" for name, result in beside.items() if result is not None)
    note = doc.marked(f"Numbers in full: `plan.json`{more}; {confirm.MEASURED_NOTE}")
    return iter(doc.reproduced_blocks(report.plan, note, [("Ranking configuration", report.rank.config_hash)]))


@doc.section_of(PLAN_SECTIONS, "credits", "Credits")
def _credits(report: PlanReport) -> Iterator[doc.Block]:
    yield doc.Items((*data_credits(report.plan.catalogue), *words.prose()["credits"]))
