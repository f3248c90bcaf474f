"""Rankings: in words, on the terminal, and as priorities in reports."""

from __future__ import annotations

import re
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from cpic_planner import results
from cpic_planner.queries import LIBRARIES
from cpic_planner.registry import SCORES
from cpic_planner.report import document as doc, words
from cpic_planner.report.known import lacking_lines
from cpic_planner.report.ranking_figures import N_BARS, ensemble_picture
from cpic_planner.report.words import MISSING, count_text, counted, duration_text, pretty_name, significant
from cpic_planner.results import RankedTarget, RankResult, SensitivityRow

_MOST_NAMED = 5
TIERS = {int(tier): meaning for tier, meaning in words.WORDS["tiers"].items()}
"""Tiers of priority, in words."""


def planet_text(result: results.PlanResult | RankResult) -> str:
    """Return the reference planet in words."""
    planet = result.reference_planet
    albedo = planet.albedo[:1].upper() + planet.albedo[1:]
    return f"{planet.radius_rjup:g} Jupiter radius, phase {planet.phase_deg:g}°, {albedo} albedo, {planet.position}"


def population_text(population: results.PopulationRecord) -> str:
    """Return the population in words."""
    often = "" if population.planets_per_star is None else f"{population.planets_per_star:g} planets per star"
    if often and population.planets_per_star_range is not None:
        low, high = population.planets_per_star_range
        often = f"{often}, {low:g} to {high:g} by different surveys"
    details = ", ".join(filter(None, (population.description, often)))
    name = f"{population.name} ({details})" if details else population.name
    meaning = "fraction of it that one observation detects"
    if population.name == results.KNOWN_PLANETS:
        meaning = "probability that at least one of the star's own planets is detected"
    elif population.exclusions:
        *first, last = (words.EXCLUSIONS[name] for name in population.exclusions)
        excluding = f"{', '.join(first)} and {last}" if first else last
        meaning = f"{meaning} and that {excluding} do not exclude"
    drawn = f"{count_text(population.n_planets)} drawn with seed {population.seed}"
    return f"{name}, {drawn}; completeness is the {meaning}"


def expected_sentence(rank: RankResult) -> str:
    """Return how many planets one observation of every star would find, with and without what is known; may be empty.

    The interval is that of the occurrence alone, by which surveys differ.
    """
    found = [row.expected_planets for row in rank.targets if row.expected_planets is not None]
    of_all = [row.expected_planets_unconditional for row in rank.targets]
    rate, between = rank.population.planets_per_star, rank.population.planets_per_star_range
    if not found or rate is None:
        return ""
    total = sum(found)
    ends = [] if between is None else [significant(total * end / rate, 2) for end in between]
    interval = f" ({' to '.join(ends)})" if ends else ""
    said = f"One observation of each star would find {significant(total, 2)}{interval} planets"
    if not rank.population.exclusions or None in of_all:
        return f"{said}."
    without = significant(sum(filter(None, of_all)), 2)
    return f"{said} that nobody knows; {without} if nothing were known of the stars."


def unprobed_stars(rank: RankResult, first: int) -> list[RankedTarget]:
    """Return where among the first stars more radial velocities would change the ranking, most completeness first.

    Their reference planets are those that velocities do not exclude yet.
    """
    open_stars = [
        row
        for row in rank.targets[:first]
        if row.completeness > 0.0 and row.rv_amplitude_m_s is not None and "excluded_by_rv" not in row.flags
    ]
    return sorted(open_stars, key=lambda row: -row.completeness) if "rv" in rank.population.exclusions else []


def velocities_sentence(rank: RankResult, first: int) -> str:
    """Return around which of the first stars velocities exclude the reference planet, and where more would help."""
    found = []
    excluded = [pretty_name(row.name) for row in rank.targets[:first] if "excluded_by_rv" in row.flags]
    if excluded:
        found.append(f"Radial velocities already exclude the reference planet around {', '.join(excluded)}.")
    stars = [
        f"{pretty_name(row.name)} {significant(row.rv_amplitude_m_s, 2)} m/s at "
        f"{significant(row.ref_planet_distance_au, 2)} au"
        for row in unprobed_stars(rank, first)[:_MOST_NAMED]
    ]
    if stars:
        found.append(words.text("texts.rank_velocities", stars=", ".join(stars)))
    return " ".join(found)


def limits_text(counts: Mapping[str, int]) -> str:
    """Return how many stars are limited by what, most first but for the detected ones."""
    order = sorted(counts, key=lambda name: (name != "none", -counts[name], name))
    said = {name: "detected" if name == "none" else f"limited by {words.LIMITED_BY[name][1]}" for name in order}
    return ", ".join(f"{count_text(counts[name])} {said[name]}" for name in order)


def programme_text(rank: RankResult) -> str:
    """Return how reference planets are looked for, in how many visits, and under which drift."""
    visits = "the best number of visits for each" if rank.visits is None else counted(rank.visits, "visit")
    if all(row.visits is None for row in rank.targets):
        visits = "1 visit"
    drift = "" if rank.drift_nm is None else f", a wavefront that drifts by {rank.drift_nm:g} nm between visits"
    return f"{words.SEARCHES[words.mode_of(rank)]}, {visits}{drift}"


def detected_sentence(rank: RankResult) -> str:
    """Return how many reference planets are detected blind and at known places, and in how many visits and days.

    Empty where no law tells.
    """
    told = [row for row in rank.targets if row.detection_probability is not None and row.visits is not None]
    if not told:
        return ""
    blind = [row for row in told if (row.detection_probability or 0.0) >= 0.5]
    placed = [row for row in told if (row.detection_probability_known_place or 0.0) >= 0.5]
    places = "its known place" if len(told) == 1 else "their known places"
    shown = f"{counted(len(blind), 'reference planet')} blind and {len(placed)} at {places}"
    said = f"Half of such observations or more show {shown}"
    if not (seen := blind or placed):
        return f"{said}."
    visits = sorted(row.visits or 1 for row in seen)
    extent = f"{visits[0]} to {counted(visits[-1], 'visit')}" if visits[0] < visits[-1] else counted(visits[0], "visit")
    days = [row.span_days for row in seen if row.span_days is not None]
    span = f", which span {significant(statistics.median(days), 2)} days in the median, without slews" if days else ""
    paid = words.orbits_text(seen)
    return f"{said}, in {extent}{span}{f'; {paid}' if paid else ''}."


def rank_blocks(rank: RankResult, limit: int = 20, *, full: bool = True) -> Iterator[doc.Block]:
    """Yield the first ``limit`` rows of a ranking, and what its numbers refer to; in two sentences unless ``full``."""
    shown, total = rank.targets[:limit], len(rank.targets)
    some = f"first {len(shown)} of " if total > 1 else ""
    stars = words.chosen_text(total, rank.n_in_catalogue)
    title = f"Ranking: {some}{stars}, by {SCORES[rank.score_name].title}"
    own = "" if SCORES[rank.score_name].column else "score "  # a column shows it already
    columns = doc.row_columns(
        RankedTarget,
        f"rank {'rank_in_catalogue ' * rank.filtered}name:row v_mag/5 distance_pc/5 {own}completeness "
        "completeness_known_place completeness_unconditional/3 "
        "completeness_band/9 band/1 separation_arcsec/6 contrast/7 frames/11 em_gain/12 visits visit_time_s/8 "
        "time_s/10 snr/4 detection_margin/2 detection_probability detection_probability_known_place/3 status",
        score=score_column(rank.score_name),
    )
    yield doc.Table(title, [*columns, *doc.user_columns(shown)], shown, legend=not full)
    if rank.counts_limited_by:
        limits = f"{programme_text(rank)}: {limits_text(rank.counts_limited_by)}"
        yield doc.Paragraph(f"Reference planets in {duration_text(rank.time_s)}, {limits}.")
    yield from doc.notes(*(_about_rank(rank, limit) if full else [_zeros(rank).strip()]), look="")
    yield from doc.notes(*lacking_lines({}, rank.population.columns_not_used))
    if rank.ensemble is not None:
        yield from _ensemble_blocks(rank.ensemble, shown)


def _about_rank(rank: RankResult, limit: int) -> list[str]:
    """Return what the numbers of a ranking refer to."""
    search, of_mode = words.SEARCHES[rank.search], words.SEARCHES[words.mode_of(rank)]
    return [
        f"Score: {SCORES[rank.score_name].meaning}.{_zeros(rank)}",
        words.text("texts.rank_population", population=population_text(rank.population), search=search),
        detected_sentence(rank),
        *filter(None, (expected_sentence(rank), velocities_sentence(rank, limit))),
        words.text("texts.rank_planet", rank=rank, planet=rank.reference_planet),
        words.text("texts.rank_margin", rank=rank, of_mode=of_mode, library=LIBRARIES[rank.reference_library]),
        f"Stars{f' on {rank.date_utc[:10]}' * bool(rank.date_utc)}: {rank.sample}. {rank.catalogue}",
    ]


def _zeros(rank: RankResult) -> str:
    """Return a sentence about stars of score 0, which the score does not order; empty if there are none."""
    above = sum(row.score > 0.0 for row in rank.targets)
    if not SCORES[rank.score_name].from_zero or above == len(rank.targets):
        return ""
    stars = "1 star has a score" if above == 1 else f"{count_text(above)} stars have a score"
    return f" {stars} above zero; the others follow by the margin of the reference planet, not by the score."


def score_column(name: str) -> results.Column:
    """Return the column of a score, in files with the unit of that score."""
    score = SCORES[name]
    (taken,) = results.taken_of(RankedTarget, "score")
    own = replace(taken, unit=score.unit)
    unit = score.written[1]
    return doc.own_column(
        score.label, lambda row: words.score_number(row.score, name), unit, label=score.title, files=[own]
    )


def ranking_csv(rank: RankResult, limit: int | None = None) -> str:
    """Return the ranking as CSV: one line a target, header with units in the names, empty cells for null.

    Numbers keep full precision (shortest text that reads back to the same double); flags are joined with ``|``. With
    a ``limit`` the first stars alone.
    """
    rows = rank.targets[:limit]
    names = (*results.names_of(RankedTarget), *(item.name for item in results.own_taken(rows)))
    return results.csv_text(names, (results.values_of(row) | row.own for row in rows), joined=results.FLAG_SEPARATOR)


def ranking_ecsv(rank: RankResult, limit: int | None = None) -> str:
    """Return the ranking as ECSV 1.0: units and descriptions of every column, and what the ranking is, in the header.

    Reads back with ``astropy.table.Table.read(..., format="ascii.ecsv")``; missing numbers are masked. With a
    ``limit`` the first stars alone, and the header says of how many.
    """
    rows = rank.targets[:limit]
    meta = rank.model_dump(mode="json", exclude={"targets"}) | {"flag_separator": results.FLAG_SEPARATOR}
    if len(rows) < len(rank.targets):
        meta |= {"rows": len(rows), "rows_in_all": len(rank.targets)}
    columns = [*results.taken_of(RankedTarget), *results.own_taken(rows)]
    (score,) = score_column(rank.score_name).files
    return results.ecsv_text([score if item.name == "score" else item for item in columns], rows, meta)


def sensitivity_blocks(result: results.SensitivityResult) -> Iterator[doc.Block]:
    """Yield how the ranking depends on what is assumed."""

    def kept(name: str, first: int) -> results.Column:
        """Return the column of how many of the first stars stay among them."""
        about: dict[str, Any] = {"label": f"kept of first {first}", "fields": name, "of": (SensitivityRow, doc.itself)}
        about["legend"] = f"how many of the nominal first {first} stay among them"
        return doc.own_column(f"of {first}", f"{{{name}:d}}", **about)

    columns = doc.row_columns(
        SensitivityRow,
        "n_ok kept_first kendall_tau_b n_compared/5 kept/2 best/3 largest_fall/4 largest_fall_ranks/4 text:row,text",
        kept_first=kept("kept_first", result.first),
        kept=kept("kept", result.top),
    )
    title = f"What the first {result.top} stars by {SCORES[result.score_name].title} become under other assumptions"
    caption = words.text("texts.sensitivity", sensitivity=result, tau=words.tau_text(result.top))
    yield doc.Table(title, columns, result.rows, caption, last_width=44, legend=True)
    yield doc.Paragraph(result.statement)


def move_blocks(result: results.RankComparison, limit: int = 20) -> Iterator[doc.Block]:
    """Yield what moves from one ranking to another one, of the first ``limit`` stars of either."""

    def setting(item: results.SettingChange) -> str:
        """Return a setting before and after; of texts in several parts, such as samples, those that differ."""
        before, after = item.before.split("; "), item.after.split("; ")
        gone, new = ([part for part in own if part not in other] for own, other in ((before, after), (after, before)))
        return f"{item.key} {'; '.join(gone) or MISSING} → {'; '.join(new) or MISSING}"

    old = sorted(result.targets, key=lambda move: move.before.rank)[:limit]
    rows = [move for i, move in enumerate(result.targets) if i < limit or move in old]
    of = (results.RankMove, doc.itself)
    legend = "rank among all stars of the sample"
    columns = [
        doc.own_column("before", "{before.rank:d}", legend=legend, fields="before.rank", of=of),
        doc.own_column("after", "{after.rank:d}", legend=legend, fields="after.rank", of=of),
        *doc.row_columns(results.RankMove, "name:row score_ratio/1 why"),
    ]
    count = len(result.targets)
    first = f"the first {f'{limit} ' * (limit > 1)}of either" if limit < count else counted(count, "star")
    title = f"What moves from {result.before.name} (before) to {result.after.name} (after): {first}"
    yield doc.Table(title, columns, rows, words.text("texts.move_columns"), last_width=70, legend=True)
    named = {*result.only_before, *result.only_after, *(move.name for move in result.targets)}
    spoken = "|".join(re.escape(name) for name in sorted(named, key=len, reverse=True))
    statement = re.sub(rf"(?<!\w)(?:{spoken})(?!\w)", lambda found: pretty_name(found[0]), result.statement)
    said = "The file does not say how its ranking was made: settings are not compared."
    if result.settings is not None:
        said = f"Settings that differ: {'; '.join(map(setting, result.settings)) or 'none'}."
    yield from doc.notes(statement, said, look="")


def explanation_blocks(explanation: results.Explanation) -> Iterator[doc.Block]:
    """Yield why a star stands where it stands."""
    star = explanation.star
    yield doc.Heading(words.full_name(star.name, star.hip))
    yield from doc.notes(*explanation.sentences, look="")
    columns = doc.row_columns(
        RankedTarget,
        "rank name:row score completeness/1 completeness_unconditional/5 completeness_band/5 v_mag/3 distance_pc/4 "
        "detection_margin/2 status",
        score=score_column(explanation.score_name),
    )
    rows = [row for row in (explanation.better, star, explanation.worse) if row is not None]
    yield doc.Table("Between its neighbours", columns, rows)
    columns = doc.row_columns(
        results.BandStanding,
        "band completeness completeness_unconditional/4 in_zone/3 observable/4 separation_arcsec/4 contrast/2 "
        "contrast_limit/2 time_s/7 snr/6 detection_margin floor_margin/1 dominant/5 status",
        dominant=lambda band: words.term_text(band.dominant),
    )
    title = "Its reference planet and its population, band by band"
    yield doc.Table(title, columns, explanation.bands, legend=True)
    band = next((item for item in explanation.bands if item.band == star.band), None)
    if band is not None and band.exposure_s is not None:
        said = words.held_texts(band)
        said += [
            f"in frames of {significant(band.exposure_s)} s {words.cap_sentence(*cap)}"
            for cap in band.gain_caps.items()
        ]
        if helpful := words.remedies_text(band.remedies):
            said.append(f"what would raise the SNR: {helpful}")
        yield from doc.notes(*(f"{band.band}: {text}." for text in said))
    if explanation.ranks:
        ranks = (f"{count_text(rank)} ({name.replace('_', ' ')})" for name, rank in explanation.ranks.items())
        yield doc.Paragraph(f"Rank under other assumptions: {', '.join(ranks)}.", "note")


_BETWEEN = doc.own_column("5 to 95 %", "{rank_p05:.0f} to {rank_p95:.0f}")


def _ensemble_blocks(ensemble: results.EnsembleRecord, shown: Sequence[RankedTarget]) -> Iterator[doc.Block]:
    """Yield what becomes of the shown stars under an ensemble of instruments, and what changes it."""
    columns = doc.row_columns(
        RankedTarget,
        "rank name:row tier rank_median between p_rank_le_10 p_reachable detection_time_s/3 detection_visits/2 "
        "limited_by/1",
        between=_BETWEEN,
    )
    title = f"The same stars under {count_text(ensemble.n_instruments)} instruments that fit what is known"
    yield doc.Table(title, columns, shown)
    bars = [
        *doc.row_columns(results.EnsembleBar, "label"),
        doc.own_column("values, 5 to 95 %", "{low} to {high}", look="left"),
        doc.own_column("planets", "{planets_low:.2g} to {planets_high:.2g}"),
        doc.own_column("stars detected", "{n_reachable_low} to {n_reachable_high}"),
        doc.own_column("tau", "{tau_low:.2f} to {tau_high:.2f}", way=1),
    ]
    title = "What the expected planets of one observation of every star hang on, one number at a time"
    nominal = f"{ensemble.planets_nominal:.2g} planets, {ensemble.n_reachable_nominal} stars"
    caption = words.text("texts.ensemble_columns", ensemble=ensemble, nominal=nominal)
    yield doc.Table(title, bars, ensemble.bars[:N_BARS], caption)
    yield doc.Paragraph(ensemble.statement)


def priority_blocks(
    rank: RankResult,
    rows: Sequence[RankedTarget],
    named: Callable[[RankedTarget], doc.Inline] = lambda row: pretty_name(row.name),
) -> Iterator[doc.Block]:
    """Yield the priorities of the first stars: a table, and what an ensemble of instruments says where one was asked.

    Parameters
    ----------
    rank : RankResult
    rows : sequence of RankedTarget
        The stars that are shown.
    named : callable
        Writes the name of a star.
    """
    sure = "" if rank.ensemble is None else " p_reachable rank_median between p_rank_le_10"
    columns = doc.row_columns(
        RankedTarget,
        "rank name:row,star tier detection_time_s detection_visits limit drift brighter expected_planets "
        f"expected_planets_unconditional{sure}",
        name=named,
        limit=doc.own_column("limit", lambda row: words.LIMITED_BY[row.limited_by][0] if row.limited_by else MISSING),
        drift=doc.own_column("drift factor", "×{required_drift_factor:.2g}"),
        brighter=doc.own_column("planet factor", "×{required_contrast_factor:.2g}"),
        between=_BETWEEN,
    )
    caption = words.text("texts.priorities", tiers="; ".join(f"{tier}: {text}" for tier, text in TIERS.items()))
    yield doc.Table("Priorities", columns, rows, caption)
    if rank.ensemble is not None:
        yield doc.Figure(ensemble_picture(rank), "How sure the order is, and what changes it", "ensemble")
