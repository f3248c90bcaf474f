"""Page one of the report of a plan, the decision: which stars, what to ask for, when, in which tier, what changes it.

What the decision rests on, in sentences that are computed from the numbers.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence

from cpic_core import listed
from cpic_planner import results
from cpic_planner.registry import LIBRARIES, SCORES
from cpic_planner.report import document as doc, image_figures, summary, words
from cpic_planner.report.cells import frames_text
from cpic_planner.report.numbers import (
    MISSING,
    chosen_text,
    count_text,
    duration_text,
    formatted,
    pretty_name,
    significant,
)
from cpic_planner.report.priorities import TIERS

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
    visits = "" if star.detection_visits is None else f" in {words.counted(star.detection_visits, 'visit')}"
    return f"{duration_text(star.detection_time_s)}{visits}"


def decision_sentences(plan: results.PlanResult) -> list[str]:
    """Return what to observe first and when, what comes next, and how long all of it takes."""
    if not plan.targets:
        return ["No star was simulated as images, so that none is proposed."]
    ready = [(target, best) for _, target, best in picks_of(plan) if best is not None]
    if not ready:
        stars = words.counted(len(plan.targets), "star")
        return [f"None is proposed: the images of {stars} show the reference planet in no band."]
    (first, best), *others = ready
    visits = "" if best.visits is None else f"{words.counted(best.visits, 'visit')}, in all "
    found = [
        f"Observe {pretty_name(first.name)} first, in {best.band}: {visits}{count_text(best.n_frames)} frames of "
        f"{significant(best.exposure_s)} s at EM gain {significant(best.em_gain)}. It takes {_time_text([best])}."
    ]
    if when := seasons_texts(plan, first.name):
        found.append(f"It can be seen {', '.join(when)}.")
    if not best.detected:
        found.append("Its images show the planet at a known place, but a blind search does not find it.")
    if others:
        names = [pretty_name(target.name) for target, _ in others]
        found.append(
            f"Then {listed(names, _MOST_NAMED)}, as in the table. "
            f"All {len(ready)} stars together take {_time_text([best for _, best in ready])}."
        )
    return found


def _time_text(bands: Sequence[results.BandConfirmation]) -> str:
    """Return the telescope time of observations, and the wall time of their frames."""
    wall = f"{duration_text(sum(band.time_s or 0.0 for band in bands))} of wall time"
    hours = [band.telescope_h for band in bands if band.telescope_h is not None]
    if not hours:
        return f"{wall}; the telescope time is not known"
    some = "" if len(hours) == len(bands) else f" without the {len(bands) - len(hours)} where it is not known"
    return f"{_hours_text(sum(hours))} of telescope time{some} ({wall} with references and readouts)"


def _hours_text(hours: float | None) -> str:
    return MISSING if hours is None else f"{significant(hours)} h"


def first_table(plan: results.PlanResult, rank: results.RankResult, n_assumptions: int = 0) -> doc.Table:
    """Return what to ask for: a line a target, with what a detection asks for and what the images say.

    Parameters
    ----------
    plan : PlanResult
    rank : RankResult
    n_assumptions : int
        How many other assumptions the ranking was tried under.
    """
    doubted = "5 to 95 % of instruments" if rank.ensemble else f"under {words.counted(n_assumptions, 'assumption')}"
    columns: list[doc.Column[Pick]] = [
        doc.Column("#", lambda pick: str(pick[1].ranked.rank)),
        doc.Column(
            "Star",
            lambda pick: doc.lines(
                doc.link(f"target-{pick[0]}", pretty_name(pick[1].name)),
                *map(doc.small, _place_texts(pick[1].ranked)),
            ),
            look="row left star",
        ),
        doc.Column("Band", of_band(lambda best: doc.lines(best.band, doc.small(f"gain {significant(best.em_gain)}")))),
        doc.Column(
            "Visits",
            of_band(lambda best: doc.lines(formatted(best.visits), doc.small(f"{frames_text(best)} s"))),
            "frames × exposure",
        ),
        doc.Column(
            "Telescope time",
            of_band(lambda best: doc.lines(_hours_text(best.telescope_h), doc.small(duration_text(best.time_s)))),
            "wall time",
        ),
        doc.Column("A detection asks for", lambda pick: _least_cell(pick[1]), "at least"),
        doc.Column("SNR", of_band(lambda best: significant(best.predicted_snr)), "predicted"),
        doc.Column(
            "Found blind", of_band(lambda best: formatted(best.predicted_detection_probability, "%")), "predicted, %"
        ),
        doc.Column("Rank", lambda pick: _interval_text(pick[1]), doubted),
        doc.Column("Can be seen", lambda pick: doc.lines(*seasons_texts(plan, pick[1].name)) or MISSING, look="left"),
        doc.Column("In images", _badge, look="left"),
    ]
    caption = (
        "What to ask for, in order of the ranking. Telescope time is what all visits take from the observatory: wall "
        "time (science frames, reference frames, readouts), the parts of orbits in which the star is hidden, at the "
        "mean visibility of its days, and two slews a visit with their settling. At least: the shortest observation, "
        "in any band, that shows the reference planet to the search. Positions: ICRS, without proper motion."
    )
    return doc.table("What to observe first", caption, columns, picks_of(plan), look="firm")


def _place_texts(star: results.RankedTarget) -> list[str]:
    """Return the Hipparcos number and the position of a star."""
    hip = [] if star.hip is None else [f"HIP {star.hip}"]
    return hip if star.ra_deg is None else [*hip, f"{words.ra_text(star.ra_deg)} {words.dec_text(star.dec_deg)}"]


def _least_cell(target: results.ConfirmedTarget) -> doc.Inline:
    if target.detection_telescope_h is None:
        return asks_text(target.ranked)
    return doc.lines(_hours_text(target.detection_telescope_h), doc.small(asks_text(target.ranked)))


def _reference_text(plan: results.PlanResult) -> str:
    """Return where the reference frames come from; of another star what it has to be."""
    text = words.sentence(LIBRARIES[plan.reference_library].meaning)
    if plan.reference_star_v_mag is None:
        return text
    star = f"V {significant(plan.reference_star_v_mag)} and {significant(plan.reference_star_teff_k, 4)} K"
    return f"{text} It is taken to have {star}; the plan does not choose it, and counts one slew a visit for it."


def _interval_text(target: results.ConfirmedTarget) -> str:
    """Return between which ranks a star is: under an ensemble of instruments, or else under other assumptions."""
    star = target.ranked
    low, high = target.rank_lowest, target.rank_highest
    if star.rank_p05 is not None and star.rank_p95 is not None:
        low, high = round(star.rank_p05), round(star.rank_p95)
    return MISSING if low is None or high is None else f"{low} to {high}" if low < high else f"{low}"


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
        facts.append((f"Tier {tier}: {words.counted(len(rows), 'star')}", [f"{meaning}: ", names, f"{more}."]))
    return facts


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
        yield first_table(plan, rank, 0 if sensitivity is None else len(sensitivity.rows))
    facts = tier_facts(rank, named)
    facts.append(("Reference frames", _reference_text(plan)))
    doubts = [doubted.statement for doubted in (rank.ensemble, sensitivity) if doubted is not None]
    if doubts:
        facts.append(("What would change", " ".join(doubts)))
    facts.append(("Does the prediction hold?", summary.calibration_sentence(plan)))
    yield doc.Facts(facts)


def summary_sentences(plan: results.PlanResult, rank: results.RankResult) -> list[str]:
    """Return the summary of the plan, one sentence an item."""
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
        f"{first} {words.counted(len(plan.targets), 'target')} were simulated as images, up to {plan.realisations} "
        f"times in every band in reach, reduced, {searched}: the planet is found around "
        f"{len(confirmed)} of {len(plan.targets)}, in {detections} of {words.counted(len(measured), 'measurement')}."
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
