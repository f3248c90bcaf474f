"""Page one of the report of a plan, the decision: which stars, what to ask for, when, in which tier, what decides.

What the decision rests on, in sentences that are computed from the numbers.
"""

from collections import Counter
from collections.abc import Callable, Iterator

from cpic_planner import results
from cpic_planner.registry import LIBRARIES, SCORES
from cpic_planner.report import document as doc, image_figures, summary, words
from cpic_planner.report.cells import frames_text
from cpic_planner.report.numbers import MISSING, chosen_text, count_text, duration_text, pretty_name, significant
from cpic_planner.report.priorities import TIERS
from cpic_planner.report.words import counted

_MOST_NAMED, _SEASONS = 6, 3
Pick = tuple[int, results.ConfirmedTarget, results.BandConfirmation | None]
"""Number of a target in the plan, the target, and what its images say of its chosen band."""
Named = Callable[[results.RankedTarget], doc.Inline]


def picks_of(plan: results.PlanResult) -> list[Pick]:
    """Return the targets of a plan with their chosen bands."""
    return [(number, target, summary.chosen(target)) for number, target in enumerate(plan.targets, 1)]


def of_band(text: Callable[[results.BandConfirmation], doc.Inline]) -> Callable[[Pick], doc.Inline]:
    """Return the cell of what a chosen band says; a dash without one."""
    return lambda pick: MISSING if pick[2] is None else text(pick[2])


def star_cell(name: doc.Inline, hip: int | None) -> doc.Inline:
    """Return the name of a star with its Hipparcos number below."""
    return doc.lines(name, doc.small(f"HIP {hip}") if hip is not None else "")


def verdict_cell(pick: Pick) -> doc.Inline:
    """Return the badge of a target, and its verdict over all bands."""
    return doc.lines(_badge(pick), words.plus_minus(pick[1].verdict))


def _badge(pick: Pick) -> doc.Mark:
    return doc.badge("unreachable", "not confirmed") if pick[2] is None else image_figures.outcome(pick[2])


def seasons_texts(plan: results.PlanResult, name: str) -> list[str]:
    """Return the times in which a target can be seen in the period of the plan; empty where that is not known.

    Parameters
    ----------
    plan : PlanResult
    name : str
        Name of the star in the catalogue.
    """
    seen = () if plan.period is None else plan.period.seen
    seasons = next((row.seasons for row in seen if row.name == name), [])
    texts = [f"{season.start_utc[:10]} to {season.end_utc[:10]}" for season in seasons[:_SEASONS]]
    return [*texts, *([f"and {len(seasons) - _SEASONS} more"] if len(seasons) > _SEASONS else [])]


def asks_text(star: results.RankedTarget) -> str:
    """Return the least time and visits that a detection of a star's reference planet asks for."""
    if star.detection_time_s is None:
        return "no time is enough"
    visits = "" if star.detection_visits is None else f" in {counted(star.detection_visits, 'visit')}"
    return f"{duration_text(star.detection_time_s)}{visits}"


def decision_sentences(plan: results.PlanResult) -> list[str]:
    """Return what to observe first and when, what comes next, and how long all of it takes.

    Parameters
    ----------
    plan : PlanResult
    """
    if not plan.targets:
        return ["No star was simulated as images, so that none is proposed."]
    ready = [(target, best) for _, target, best in picks_of(plan) if best is not None]
    if not ready:
        stars = counted(len(plan.targets), "star")
        return [f"None is proposed: the images of {stars} show the reference planet in no band."]
    (first, best), *others = ready
    frames = f"{count_text(best.n_frames)} frames of {significant(best.exposure_s)} s at EM gain"
    found = [
        f"Observe {pretty_name(first.name)} first, in {best.band}: {frames} {significant(best.em_gain)}, "
        f"{duration_text(best.time_s)} with references and overheads."
    ]
    if when := seasons_texts(plan, first.name):
        found.append(f"It can be seen {', '.join(when)}.")
    if not best.detected:
        found.append("Its images show the planet at a known place, but a blind search does not find it.")
    if others:
        names = [pretty_name(target.name) for target, _ in others]
        more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
        total_s = sum(best.time_s or 0.0 for _, best in ready)
        found.append(
            f"Then {', '.join(names[:_MOST_NAMED])}{more}, as in the table: "
            f"{duration_text(total_s)} for {counted(len(ready), 'star')}."
        )
    return found


_FIRST: tuple[doc.Column[Pick], ...] = (
    doc.Column("#", lambda pick: str(pick[1].ranked.rank)),
    doc.Column(
        "Star",
        lambda pick: star_cell(doc.link(f"target-{pick[0]}", pretty_name(pick[1].name)), pick[1].hip),
        look="row left star",
    ),
    doc.Column("Tier", lambda pick: MISSING if pick[1].ranked.tier is None else str(pick[1].ranked.tier)),
    doc.Column("Band", of_band(lambda best: best.band), look="left"),
    doc.Column("Frames × exposure", of_band(frames_text), "s"),
    doc.Column("EM gain", of_band(lambda best: significant(best.em_gain))),
    doc.Column("Wall time", of_band(lambda best: duration_text(best.time_s))),
)


def first_table(plan: results.PlanResult) -> doc.Table:
    """Return what to ask for: a line a target, with what a detection asks for and what the images say."""
    columns = (
        *_FIRST,
        doc.Column("Can be seen", lambda pick: doc.lines(*seasons_texts(plan, pick[1].name)) or MISSING, look="left"),
        doc.Column("A detection asks for", lambda pick: asks_text(pick[1].ranked), "at least", look="wide"),
        doc.Column(
            "Position",
            lambda pick: doc.lines(words.ra_text(pick[1].ranked.ra_deg), words.dec_text(pick[1].ranked.dec_deg)),
            "ICRS",
        ),
        doc.Column("In images", _badge, look="left"),
    )
    caption = (
        "What to ask for, in order of the ranking; positions are those of the catalogue epoch, without proper motion. "
        "Wall time holds science frames, reference frames, readouts and the overhead of each visit, but no "
        "occultations. At least: the shortest observation, in any band, that shows the reference planet to the search."
    )
    return doc.table("What to observe first", caption, columns, picks_of(plan))


def tier_facts(rank: results.RankResult, named: Named) -> list[tuple[doc.Inline, doc.Inline]]:
    """Return how many stars are in each tier, what it means, and which come first.

    Parameters
    ----------
    rank : RankResult
    named : callable
        Writes the name of a star.
    """
    facts: list[tuple[doc.Inline, doc.Inline]] = []
    for tier, meaning in TIERS.items():
        rows = [row for row in rank.targets if row.tier == tier]
        if not rows:
            continue
        names: list[doc.Inline] = []
        for row in rows[:_MOST_NAMED]:
            names += [", " if names else "", named(row)]
        more = f" and {count_text(len(rows) - _MOST_NAMED)} more" if len(rows) > _MOST_NAMED else ""
        facts.append((f"Tier {tier}: {counted(len(rows), 'star')}", [f"{meaning}: ", names, f"{more}."]))
    return facts


def decides_text(rank: results.RankResult, sensitivity: results.SensitivityResult | None) -> str:
    """Return which assumptions decide the ranking; empty where none was changed.

    Parameters
    ----------
    rank : RankResult
    sensitivity : SensitivityResult, optional
    """
    said = [] if rank.ensemble is None else [rank.ensemble.statement]
    if sensitivity is not None:
        deciding = [row.text for row in sensitivity.rows if row.assumption in sensitivity.decides]
        tried = f"{counted(len(sensitivity.rows), 'assumption')}, changed one at a time,"
        some = f"{len(deciding)} of {tried} {'decides' if len(deciding) == 1 else 'decide'} the ranking"
        said.append(f"{some}: {'; '.join(deciding)}." if deciding else f"None of {tried} decides the ranking.")
    return " ".join(said)


def decision_blocks(
    plan: results.PlanResult, rank: results.RankResult, sensitivity: results.SensitivityResult | None, named: Named
) -> Iterator[doc.Block]:
    """Yield page one of a plan.

    Parameters
    ----------
    plan : PlanResult
    rank : RankResult
    sensitivity : SensitivityResult, optional
        How the ranking depends on assumptions.
    named : callable
        Writes the name of a star.
    """
    if altered := summary.overrides_sentence(plan):
        yield doc.Paragraph(doc.strong(altered), "altered")
    first, *others = decision_sentences(plan)
    yield doc.Paragraph([doc.strong(first), " ".join(["", *others])], "lead")
    if plan.targets:
        yield first_table(plan)
    facts = tier_facts(rank, named)
    if decides := decides_text(rank, sensitivity):
        facts.append(("What decides the ranking", decides))
    facts.append(("Does the prediction hold?", summary.calibration_sentence(plan)))
    yield doc.Facts(facts)


def summary_sentences(plan: results.PlanResult, rank: results.RankResult) -> list[str]:
    """Return the summary of the plan, one sentence an item.

    Parameters
    ----------
    plan : PlanResult
    rank : RankResult
    """
    sentences = [
        f"{chosen_text(plan.n_ranked, plan.n_in_catalogue)} {'was' if plan.n_ranked == 1 else 'were'} ranked by "
        f"{_score_words(rank)}, in at most "
        f"{duration_text(plan.time_s)} of wall time per target and band.",
        f"A reference planet ({summary.planet_text(plan)}) is predicted to be detected around "
        f"{count_text(plan.counts.get('ok', 0))} of them, {summary.programme_text(rank)}"
        + (f" ({summary.limits_text(rank.counts_limited_by)})." if rank.counts_limited_by else "."),
        *filter(None, [summary.detected_sentence(rank)]),
        *([] if rank.ensemble is None else [rank.ensemble.statement]),
    ]
    if not plan.targets:
        return [*sentences, "No target was simulated as images."]
    picks = [(target, summary.chosen(target)) for target in plan.targets]
    confirmed = [(target, band) for target, band in picks if band is not None and band.detected]
    measured = [band for target in plan.targets for band in target.bands if band.recovered_snr is not None]
    detections = sum(bool(band.detected) for band in measured)
    searched = LIBRARIES[plan.reference_library].searched
    first = "The first" if plan.schedule is None else "Of the schedule"
    sentences.append(
        f"{first} {counted(len(plan.targets), 'target')} were simulated as images, up to {plan.realisations} "
        f"times in every band in reach, reduced, {searched}: the planet is found around "
        f"{len(confirmed)} of {len(plan.targets)}, in {detections} of {counted(len(measured), 'measurement')}."
    )
    if confirmed:
        target, band = confirmed[0]
        which = "Highest ranked" if plan.schedule is None else "First"
        sentences.append(
            f"{which} and confirmed is {pretty_name(target.name)} in {band.band}: SNR "
            f"{significant(band.recovered_snr)} recovered, {significant(band.predicted_snr)} predicted."
        )
        counts = Counter(band.band for _, band in confirmed)
        picked = ", ".join(f"{band} ({count})" for band, count in counts.most_common())
        sentences.append(f"Chosen bands, with number of targets: {picked}.")
    return sentences


def _score_words(rank: results.RankResult) -> str:
    """Return what the ranking is by, for the middle of a sentence."""
    share, hourly = f"the fraction of the population {rank.population.name} that one observation detects", "per hour"
    if rank.population.name == results.KNOWN_PLANETS:
        share = "the probability that one observation detects at least one of the star's own planets"
        hourly = "divided by its hours"
    return SCORES[rank.score_name].aim.format(share=share, hourly=hourly)
