"""Plans: in words, on the terminal, and as reports with a page a star."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import itemgetter
from typing import TYPE_CHECKING

from catalogs import data_credits
from cpic_core import Registry, listed
from cpic_planner import results
from cpic_planner.registry import LIBRARIES, SCORES
from cpic_planner.report import document as doc
from cpic_planner.report.cells import Cells, explain_symbols, frames_text, print_note, print_plain, print_table
from cpic_planner.report.confirm import (
    MEASURED,
    MEASURED_NOTE,
    audit_blocks,
    calibration_sentence,
    instrument_fact,
    measure_table,
    measured_cells,
    modelled_blocks,
    not_modelled_blocks,
    outcome,
    overrides_sentence,
    picture_blocks,
    print_comparison,
    print_invalid,
    print_modelled,
    setup_text,
    visits_facts,
)
from cpic_planner.report.drawing import Picture
from cpic_planner.report.image_figures import Panels, PanelSheet, snr_figure
from cpic_planner.report.known import known_blocks, known_planet_name, windows_text
from cpic_planner.report.ranking import (
    TIERS,
    detected_sentence,
    expected_sentence,
    limits_text,
    planet_text,
    population_text,
    priority_blocks,
    programme_text,
    sensitivity_blocks,
    unprobed_stars,
)
from cpic_planner.report.ranking_figures import HoleEdges, LimitCurve, contrast_diagram, margin_figure, sky_map
from cpic_planner.report.words import (
    LIMITED_BY,
    MISSING,
    chosen_text,
    contrast_text,
    count_text,
    counted,
    dec_text,
    decimals,
    duration_text,
    flag_text,
    formatted,
    full_name,
    percent_text,
    plus_minus,
    pretty_name,
    prose,
    ra_text,
    reason_text,
    score_number,
    sentence,
    share_text,
    short_name,
    significant,
    terms,
    unused_text,
    verdict_text,
)
from cpic_planner.results import PlanResult, RankResult

if TYPE_CHECKING:
    from rich.console import Console


_MOST_LEFT_OUT = 10


def targets_sentences(plan: PlanResult) -> list[str]:
    """Return where the targets come from: stars that are seen in a period, or the visits of a schedule."""
    found = []
    if plan.schedule is not None:
        made = plan.schedule
        left = made.n_stars - len(plan.targets)
        found.append(
            f"Targets, frames and numbers of visits are those of a schedule, {made.source}: the images stand for "
            f"{made.n_imaged} of {counted(made.n_visits, 'visit')}"
            + (f"; {counted(left, 'more star')} can be imaged (a larger --top)." if left else ".")
        )
        found.append(
            "All visits of a star and band are reduced together, in images with the planet at one place: of months "
            "between visits they know that the wavefront has changed, not that the planet moves."
        )
    if plan.period is not None:
        period = plan.period
        found.append(
            f"Targets are seen for as long as their best observation takes in the {counted(period.n_days, 'day')} from "
            f"{period.start_utc[:10]} on (limits of pointing: {period.pointing})."
        )
        if period.not_checked:
            names = ", ".join(map(pretty_name, period.not_checked))
            found.append(f"Visibility is not known of {names}: the star table has no coordinates.")
        if period.left_out:
            named = [
                f"{pretty_name(row.name)}, rank {row.rank} ({row.message})" for row in period.left_out[:_MOST_LEFT_OUT]
            ]
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


def chosen(target: results.ConfirmedTarget) -> results.BandConfirmation | None:
    """Return the confirmation of the chosen band, if any."""
    return next((band for band in target.bands if band.band == target.chosen_band), None)


_STAR = tuple(results.taken_of(results.ConfirmedTarget, "name", "hip", of=itemgetter(3)))


_BAND = tuple(results.taken_of(results.BandConfirmation, "band", of=itemgetter(2)))


def print_plan(plan: results.PlanResult, console: Console, *, full: bool = True) -> None:
    """Print the confirmed targets of a plan, band by band, and how the ETC stands.

    Parameters
    ----------
    plan : PlanResult
    console : Console
    full : bool
        Also the verdicts of the targets, how images were made, and where targets come from.
    """
    rows = []
    for target in plan.targets:
        for number, item in enumerate(target.bands):
            arrow = "→ " if item.band == target.chosen_band else "  "
            rows.append((short_name(target.name) if number == 0 else "", arrow + item.band, item, target))
    cells = [
        Cells("target", itemgetter(0), right=False, numbers=_STAR),
        Cells("band", itemgetter(1), right=False, legend="→ marks the one to observe in", numbers=_BAND),
        *measured_cells(MEASURED.format(more=""), itemgetter(2), plan.reference_library),
    ]
    found = sum(any(band.detected for band in target.bands) for target in plan.targets)
    of = f"{found} of {counted(len(plan.targets), 'target')}"
    title = f"Confirmed by simulated images: {of}, {counted(plan.realisations, 'realisation')} each"
    print_table(console, title, cells, rows, legend=not full)
    explain_symbols(console, [row[2].status for row in rows if row[2].status != "ok"])
    bands = [band for target in plan.targets for band in target.bands]
    print_note(console, *filter(None, [unused_text(bands)]))
    for target in plan.targets if full else ():
        print_plain(console, f"{pretty_name(target.name)}: {plus_minus(target.verdict)}")
    print_comparison(plan, console)
    print_invalid(bands, console)
    if not full:
        print_note(console, *filter(None, [_left_out_sentence(plan)]))
        return
    print_modelled(bands, console)
    criterion = LIBRARIES[plan.reference_library].found
    print_note(
        console,
        "→ marks the band to observe in. SNR of one observation, planet noise included: predicted, and recovered with "
        f"the error of its mean; found: realisations in which {criterion}; seen at its place: "
        "significant at the known place, but not found blind.",
        *targets_sentences(plan),
        *not_imaged_lines(plan),
        f"{chosen_text(plan.n_ranked, plan.n_in_catalogue)} ranked. {setup_text(plan)}",
    )


def _left_out_sentence(plan: results.PlanResult) -> str:
    """Return how many stars and rows there are no images of; empty for none."""
    stars = 0 if plan.period is None else len(plan.period.left_out)
    rows = 0 if plan.schedule is None else len(plan.schedule.not_imaged)
    parts = [f"{counted(stars, 'star')} left out for visibility"] * bool(stars)
    parts += [f"{counted(rows, 'row')} of the schedule without images"] * bool(rows)
    return f"{' and '.join(parts)}: -v names them." if parts else ""


_MOST_NAMED, _SEASONS = 6, 3


Pick = tuple[int, results.ConfirmedTarget, results.BandConfirmation | None]
"""Number of a target in the plan, the target, and what its images say of its chosen band."""


Named = Callable[[results.RankedTarget], doc.Inline]


def picks_of(plan: results.PlanResult) -> list[Pick]:
    """Return the targets of a plan with their chosen bands."""
    return [(number, target, chosen(target)) for number, target in enumerate(plan.targets, 1)]


def of_band(text: Callable[[results.BandConfirmation], doc.Inline]) -> Callable[[Pick], doc.Inline]:
    """Return the cell of what a chosen band says; a dash without one."""
    return lambda pick: MISSING if pick[2] is None else text(pick[2])


def star_cell(name: doc.Inline, hip: int | None) -> doc.Inline:
    """Return the name of a star with its Hipparcos number below."""
    return doc.lines(name, doc.small(f"HIP {hip}") if hip is not None else "")


def verdict_cell(pick: Pick) -> doc.Inline:
    """Return the badge of a target, and its verdict over all bands."""
    return doc.lines(_badge(pick), plus_minus(pick[1].verdict))


def _badge(pick: Pick) -> doc.Mark:
    return doc.badge("unreachable", "not confirmed") if pick[2] is None else outcome(pick[2])


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
    """Return what to observe first and when, what comes next, and how long all of it takes."""
    if not plan.targets:
        return ["No star was simulated as images, so that none is proposed."]
    ready = [(target, best) for _, target, best in picks_of(plan) if best is not None]
    if not ready:
        stars = counted(len(plan.targets), "star")
        return [f"None is proposed: the images of {stars} show the reference planet in no band."]
    (first, best), *others = ready
    visits = "" if best.visits is None else f"{counted(best.visits, 'visit')}, in all "
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
    doubted = "5 to 95 % of instruments" if rank.ensemble else f"under {counted(n_assumptions, 'assumption')}"
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
    return hip if star.ra_deg is None else [*hip, f"{ra_text(star.ra_deg)} {dec_text(star.dec_deg)}"]


def _least_cell(target: results.ConfirmedTarget) -> doc.Inline:
    if target.detection_telescope_h is None:
        return asks_text(target.ranked)
    return doc.lines(_hours_text(target.detection_telescope_h), doc.small(asks_text(target.ranked)))


def _reference_text(plan: results.PlanResult) -> str:
    """Return where the reference frames come from; of another star what it has to be."""
    text = sentence(LIBRARIES[plan.reference_library].meaning)
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
        facts.append((f"Tier {tier}: {counted(len(rows), 'star')}", [f"{meaning}: ", names, f"{more}."]))
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
    if altered := overrides_sentence(plan):
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
    facts.append(("Does the prediction hold?", calibration_sentence(plan)))
    yield doc.Facts(facts)


def summary_sentences(plan: results.PlanResult, rank: results.RankResult) -> list[str]:
    """Return the summary of the plan, one sentence an item."""
    sentences = [
        f"{chosen_text(plan.n_ranked, plan.n_in_catalogue)} {'was' if plan.n_ranked == 1 else 'were'} ranked by "
        f"{_score_words(rank)}, in at most "
        f"{duration_text(plan.time_s)} of wall time per target and band.",
        f"A reference planet ({planet_text(plan)}) is predicted to be detected around "
        f"{count_text(plan.counts.get('ok', 0))} of them, {programme_text(rank)}"
        + (f" ({limits_text(rank.counts_limited_by)})." if rank.counts_limited_by else "."),
        *filter(None, [detected_sentence(rank)]),
        *([] if rank.ensemble is None else [rank.ensemble.statement]),
    ]
    if not plan.targets:
        return [*sentences, "No target was simulated as images."]
    picks = [(target, chosen(target)) for target in plan.targets]
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


Facts = Sequence[tuple[doc.Inline, doc.Inline]]


def anchors_of(plan: results.PlanResult, rows: Sequence[results.RankedTarget]) -> dict[str, str]:
    """Return the anchor of every star that has a page: targets, and the other stars that are shown.

    Parameters
    ----------
    plan : PlanResult
    rows : sequence of RankedTarget
        Stars of the ranking that are shown.
    """
    targets = {target.name: f"target-{number}" for number, target in enumerate(plan.targets, 1)}
    return {row.name: f"star-{row.rank}" for row in rows} | targets


def star_pages(
    plan: results.PlanResult,
    rows: Sequence[results.RankedTarget],
    images: Mapping[str, Picture],
    known: results.KnownResult | None,
) -> Iterator[doc.Block]:
    """Yield the pages of the targets, and a folded one for every other star that is shown.

    Parameters
    ----------
    plan : PlanResult
    rows : sequence of RankedTarget
        Stars of the ranking that are shown.
    images : mapping of str to Picture
        Image panels by ``BandConfirmation.image``.
    known : KnownResult, optional
        Known planets of the first stars.
    """
    anchors = anchors_of(plan, rows)
    for target in plan.targets:
        title = f"{target.ranked.rank}. {full_name(target.name, target.hip)}"
        seasons = seasons_texts(plan, target.name)
        seen: Facts = [("Can be seen", doc.lines(*seasons))] if seasons else []
        blocks = star_blocks(target, images, [*seen, *_known_facts(target.ranked, known)])
        yield doc.Group(anchors[target.name], title, list(blocks))
    others = [row for row in rows if row.name not in {target.name for target in plan.targets}]
    if others:
        yield doc.Heading("Stars without images")
    for row in others:
        facts = [*_star_facts(row), *_priority_facts(row), *_known_facts(row, known)]
        title = f"{row.rank}. {full_name(row.name, row.hip)}"
        tier = "" if row.tier is None else f", tier {row.tier}"
        yield doc.Fold(f"{title}{tier}", [doc.Facts(facts, wide=False), *_caveats(row)], anchor=anchors[row.name])


def _caveats(star: results.RankedTarget) -> list[doc.Block]:
    return [doc.Facts([("Caveats", "; ".join(map(flag_text, star.flags)))])] if star.flags else []


def _companion_text(star: results.RankedTarget) -> str:
    """Return where the nearest companion stands, with the error of its place."""
    angle, error = star.companion_pa_deg, star.companion_position_error_arcsec
    text = f"{significant(star.companion_separation_arcsec, 3)} arcsec"
    text += "" if error is None else f" ± {significant(error, 1)}"
    return text + (", position angle not known" if angle is None else f", position angle {round(angle)} deg")


def _star_facts(star: results.RankedTarget) -> Facts:
    facts: list[tuple[doc.Inline, doc.Inline]] = [
        ("Catalogue name", star.name),
        ("Position (ICRS)", f"{ra_text(star.ra_deg)}, {dec_text(star.dec_deg)}"),
        ("Type, V", f"{star.sp_type}, {decimals(star.v_mag, 2)} mag"),
        ("Distance", f"{significant(star.distance_pc, 4)} pc"),
    ]
    if star.luminosity_lsun is not None:
        facts.append(("Luminosity", [f"{significant(star.luminosity_lsun)} L", doc.Mark("sub", "☉")]))
    if star.companion_separation_arcsec is not None:
        facts.append(("Nearest known companion", _companion_text(star)))
    sunlight = star.ref_planet_insolation_au
    lit = "" if sunlight is None else f" (sunlight of {significant(sunlight)} au)"
    reference = f"{significant(star.ref_planet_distance_au)} au from the star{lit}"
    return [*facts, ("Reference planet", f"{reference}, contrast {contrast_text(star.contrast)}")]


def _priority_facts(star: results.RankedTarget) -> Facts:
    """Return what a detection asks for, what is missing, and how sure that is."""
    facts: list[tuple[doc.Inline, doc.Inline]] = []
    if star.tier is not None:
        facts.append(("Tier", f"{star.tier}: {TIERS[star.tier]}"))
    facts.append(("A detection asks for", asks_text(star)))
    if star.limited_by is not None and star.limited_by != "none":
        facts.append(("Limited by", LIMITED_BY[star.limited_by][1]))
    missing = [
        f"a drift ×{significant(star.required_drift_factor, 2)}" if star.required_drift_factor else "",
        f"a planet ×{significant(star.required_contrast_factor, 2)} as bright" if star.required_contrast_factor else "",
    ]
    if any(missing):
        facts.append(("Enough would be", " or ".join(filter(None, missing))))
    facts.append(("Completeness", _completeness_text(star)))
    if star.expected_planets is not None:
        of_all = star.expected_planets_unconditional
        known = "" if of_all is None else f"; {significant(of_all, 2)} if nothing were known of the star"
        facts.append(("Expected planets of one observation", f"{significant(star.expected_planets, 2)}{known}"))
    if star.p_reachable is not None and star.rank_p05 is not None and star.rank_p95 is not None:
        share = f"detected by {percent_text(star.p_reachable)} of them"
        facts.append(("Under the ensemble of instruments", f"{share}, rank {star.rank_p05:.0f} to {star.rank_p95:.0f}"))
    return facts


def _completeness_text(star: results.RankedTarget) -> str:
    fact = f"{share_text(star.completeness)} % in {star.completeness_band}"
    of_all, placed = star.completeness_unconditional, star.completeness_known_place
    if placed is not None:
        fact = f"{fact} by a blind search, {share_text(placed)} % at known places"
    return fact if of_all is None else f"{fact}; blind {share_text(of_all)} % whatever is known of the star"


def _known_facts(star: results.RankedTarget, known: results.KnownResult | None) -> Facts:
    """Return the known planets of the star, each with its next days in the dark hole."""
    rows = [] if known is None else [row for row in known.planets if row.counted and row.star == star.name]
    none = "at no time more likely than not in a dark hole"
    return [(f"Known planet {known_planet_name(row)}", windows_text(row) if row.windows else none) for row in rows]


def star_blocks(
    target: results.ConfirmedTarget, images: Mapping[str, Picture], more: Facts = ()
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
    facts = [*_star_facts(star), *_priority_facts(star)]
    facts.append(("Predicted margin", f"{significant(star.detection_margin)} in {star.band}"))
    facts += [(title, text) for title, text in visits_facts(target).items()]
    yield doc.Facts([*facts, *more], wide=False)
    yield from _caveats(star)
    if target.verdict:
        yield doc.Paragraph(doc.strong(sentence(target.verdict)))
    picked = f"The chosen band is {target.chosen_band}." if target.chosen_band else "No band was chosen."
    yield measure_table(name, target.bands, f"{name} by band. {picked}", target.chosen_band)
    yield from audit_blocks(name, target.bands)
    yield from picture_blocks(images, [band.image for band in target.bands if band.image], name)


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
        summary=decision_blocks(plan, report.rank, report.sensitivity, report.named),
    )


def _recovered(best: results.BandConfirmation) -> doc.Inline:
    error = best.recovered_snr_error
    return doc.lines(significant(best.recovered_snr), "" if error is None else doc.small(f"± {significant(error, 2)}"))


def _significance(best: results.BandConfirmation) -> str:
    return f"{significant(best.recovered_significance)} / {significant(best.threshold)}"


_NOWHERE = doc.Span("the images show the planet in no band; see its page", 6)


_IMAGED: tuple[doc.Column[Pick], ...] = (
    doc.Column(
        "Star",
        lambda pick: star_cell(doc.link(f"target-{pick[0]}", pretty_name(pick[1].name)), pick[1].hip),
        look="row left star",
    ),
    doc.Column("Band", lambda pick: _NOWHERE if pick[2] is None else pick[2].band, look="left"),
    doc.Column("Separation", of_band(lambda best: decimals(best.separation_arcsec, 3)), "arcsec"),
    doc.Column("Contrast", of_band(lambda best: contrast_text(best.true_contrast))),
    doc.Column("SNR", of_band(lambda best: significant(best.predicted_snr)), "predicted"),
    doc.Column("SNR", of_band(_recovered), "recovered"),
    doc.Column("Significance", of_band(_significance), "/ threshold"),
    doc.Column("Verdict", verdict_cell, look="left verdict"),
)


@doc.section_of(PLAN_SECTIONS, "first", "What the images show")
def _images(report: PlanReport) -> Iterator[doc.Block]:
    plan = report.plan
    yield doc.Items(summary_sentences(plan, report.rank))
    if plan.targets:
        caption = (
            "Targets simulated as images, in order of the ranking; each in the band of highest predicted "
            f"margin among those in which {LIBRARIES[plan.reference_library].found} in at least half of the "
            f"{plan.realisations} realisations or, without any, among those that show it at its known place. "
            "Separation and contrast are those of the reference planet; the verdict is of all bands."
        )
        yield doc.table("What the images show", caption, _IMAGED, picks_of(plan))
    else:
        yield doc.Paragraph("No target was simulated as images.")
    for text in (*targets_sentences(plan), *not_imaged_lines(plan)):
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
            more = calibration_sentence(report.plan) if key == "calibration" else ""
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
                f"{planet_text(plan)}. Its separation is where significance over threshold is highest. The "
                "contrast, SNR and margin of ranked stars refer to this planet.",
            ),
            ("Population", f"{population_text(report.rank.population)}."),
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
                f"at each separation. Reference planets are looked for {programme_text(report.rank)}; a "
                f"realisation is a detection if {library.found}.",
            ),
            ("Realisations", f"{plan.realisations} of each target and band{once}."),
            ("Sample", f"{plan.sample}."),
            ("Catalogue", f"{plan.catalogue}."),
            *doc.notes_fact(plan.notes),
            ("Places of stars and companions", f"those of {plan.date_utc[:10] or 'no date that is recorded'}."),
            ("Instrument", instrument_fact(plan)),
        ]
    )


@doc.section_of(PLAN_SECTIONS, "modelled", "What was modelled")
def _modelled(report: PlanReport) -> Iterator[doc.Block]:
    bands = ((pretty_name(target.name), band) for target in report.plan.targets for band in target.bands)
    made = [(f"{name} {band.band}", band.modelled) for name, band in bands if band.modelled is not None]
    return modelled_blocks(made)


@doc.section_of(PLAN_SECTIONS, "missing", "What is not modelled")
def _missing(report: PlanReport) -> Iterator[doc.Block]:
    return not_modelled_blocks(report.plan.not_modelled)


def _completeness(row: results.RankedTarget) -> doc.Inline:
    if not row.completeness > 0:
        return share_text(row.completeness)
    error = significant(100 * row.completeness_error, 1)
    return doc.lines(f"{share_text(row.completeness)} ± {error}", doc.small(row.completeness_band))


def _standing(row: results.RankedTarget) -> doc.Inline:
    limit = LIMITED_BY[row.limited_by][0] if row.limited_by else row.reason.replace("_", " ")
    return doc.lines(doc.badge(row.status, verdict_text(row.verdict, row.status)), limit if row.reason else "")


@doc.section_of(PLAN_SECTIONS, "ranking", "Ranking")
def _ranking(report: PlanReport) -> Iterator[doc.Block]:
    rank, rows, score = report.rank, report.rows, SCORES[report.rank.score_name]
    columns = doc.row_columns(
        results.RankedTarget,
        f"rank {'rank_in_catalogue ' * rank.filtered}name:row,star v_mag sp_type distance_pc score completeness "
        "completeness_unconditional band "
        "separation_arcsec contrast frames em_gain snr detection_margin status:wide flags:flags",
        name=lambda row: star_cell(report.named(row), row.hip),
        distance_pc=lambda row: significant(row.distance_pc, 4),
        score=Cells("", lambda row: score_number(row.score, score.name), label="score", unit=score.written[1]),
        completeness=_completeness,
        status=_standing,
        flags=lambda row: doc.marked(" ".join(f"`{flag}`" for flag in row.flags)),
    )
    stars = chosen_text(len(rank.targets), rank.n_in_catalogue, "ranked star")
    caption = (
        f"First {len(rows)} of {stars}, by {score.title}: {score.meaning}. "
        "Completeness and the band it is for are about the population, the columns from Band to Margin about the "
        "reference planet. All rows and columns are in `ranking.csv` and `ranking.ecsv`."
    )
    yield doc.table("Ranking", doc.marked(caption), columns, rows, look="compact")
    yield from _velocities(report)
    if reasons := sorted({row.reason for row in rows if row.reason}):
        yield doc.Heading("Reasons used here")
        yield doc.Facts([(reason.replace("_", " "), reason_text(reason)) for reason in reasons])
    shown = [*rows, *(target.ranked for target in report.plan.targets)]
    if flags := sorted({flag for row in shown for flag in row.flags}):
        yield doc.Heading("Flags used here")
        yield doc.Facts([(doc.code(flag), flag_text(flag)) for flag in flags])


def _velocities(report: PlanReport) -> Iterator[doc.Block]:
    """Yield what is expected with what is known, and where more velocities would change it."""
    if expected := expected_sentence(report.rank):
        yield doc.Paragraph(expected)
    if rows := unprobed_stars(report.rank, len(report.rows)):
        columns = doc.row_columns(
            results.RankedTarget,
            "rank name:row,star completeness completeness_unconditional rv_amplitude_m_s ref_planet_distance_au",
            name=lambda row: star_cell(report.named(row), row.hip),
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
    note = doc.marked(f"Numbers in full: `plan.json`{more}; {MEASURED_NOTE}")
    return iter(doc.reproduced_blocks(report.plan, note, [("Ranking configuration", report.rank.config_hash)]))


@doc.section_of(PLAN_SECTIONS, "credits", "Credits")
def _credits(report: PlanReport) -> Iterator[doc.Block]:
    yield doc.Items((*data_credits(report.plan.catalogue), *prose()["credits"]))
