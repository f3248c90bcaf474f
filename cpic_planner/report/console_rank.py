"""The ranking on the terminal: table, sensitivity, and why one star stands where it stands."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cpic_planner.models import Explanation, RankedTarget, RankResult, SensitivityResult
from cpic_planner.registry.libraries import LIBRARIES
from cpic_planner.registry.scores import SCORES
from cpic_planner.report.names import full_name
from cpic_planner.report.numbers import MISSING, count_text, decimals, duration_text, share_text, significant
from cpic_planner.report.summary import limits_text, population_text
from cpic_planner.report.terminal import (
    Column,
    explain_symbols,
    frames_text,
    print_note,
    print_plain,
    ratio_text,
    short_name,
    text_table,
    verdict_cell,
)
from cpic_planner.report.words import cap_sentence, limit_text, remedy_text, score_number, tau_text, term_text

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["print_explanation", "print_rank", "print_sensitivity"]

_SMALLEST_GAIN = 1.005


def print_rank(rank: RankResult, console: Console, limit: int = 20) -> None:
    """Print the first ``limit`` rows of a ranking, and what its numbers refer to."""
    shown = rank.targets[:limit]
    columns, rows = _table(rank, shown)
    title = f"Ranking: first {len(shown)} of {count_text(len(rank.targets))} stars, by {SCORES[rank.score_name].title}"
    console.print(text_table(console, title, columns, rows))
    explain_symbols(console, [row.status for row in shown if row.status != "ok"])
    planet = rank.reference_planet
    if rank.counts_limited_by:
        limits = limits_text(rank.counts_limited_by)
        print_note(console, f"Reference planets in {duration_text(rank.time_s)}: {limits}.")
    print_note(console, f"Score: {SCORES[rank.score_name].meaning}.{_zeros(rank)}")
    print_note(console, f"Population (compl %): {population_text(rank.population)}.")
    print_note(
        console,
        f"Reference planet (other columns): {planet.radius_rjup:g} R_J, phase {planet.phase_deg:g} deg, "
        f"{planet.albedo} albedo, {planet.position}; wall time up to {duration_text(rank.time_s)} per target and band.",
    )
    print_note(
        console,
        f"Margin = significance / threshold; threshold keeps the false-alarm probability of {rank.sigma:g} sigma. "
        "Detected: at least half of the visits show the planet if its place is known; blind %: probability that a "
        "search finds it that does not know the place. "
        f"Reference frames: {LIBRARIES[rank.reference_library].meaning}.",
    )
    print_note(console, f"Stars: {rank.sample}. {rank.catalogue}")


def _zeros(rank: RankResult) -> str:
    """A sentence about stars of score 0, which the score does not order; empty if there are none."""
    above = sum(row.score > 0.0 for row in rank.targets)
    if not SCORES[rank.score_name].from_zero or above == len(rank.targets):
        return ""
    stars = "1 star has a score" if above == 1 else f"{count_text(above)} stars have a score"
    return f" {stars} above zero; the others follow by the margin of the reference planet, not by the score."


def _table(rank: RankResult, shown: list[RankedTarget]) -> tuple[list[Column], list[list[str]]]:
    """Columns and rows; the score has a column of its own unless another shows it."""
    score = SCORES[rank.score_name].label
    columns = [
        Column("#"),
        Column("star", False),
        Column("V mag", True, 3),
        Column("dist pc", True, 2),
        Column(score),
        Column("compl %"),
        Column("in", False, 7),
        Column("band", False, 1),
        Column("sep ″", True, 4),
        Column("contrast", True, 5),
        Column("frames × s", True, 9),
        Column("gain", True, 10),
        Column("wall", True, 8),
        Column("SNR", True, 2),
        Column("margin"),
        Column("blind %"),
        Column("status", False),
    ]
    rows = [
        [
            str(row.rank),
            short_name(row.name),
            decimals(row.v_mag, 2),
            decimals(row.distance_pc, 2),
            score_number(row.score, rank.score_name),
            share_text(row.completeness),
            row.completeness_band,
            row.band,
            decimals(row.separation_arcsec, 3),
            ratio_text(row.contrast),
            frames_text(row),
            significant(row.em_gain),
            duration_text(row.time_s),
            significant(row.snr),
            significant(row.detection_margin),
            MISSING if row.detection_probability is None else share_text(row.detection_probability),
            verdict_cell(row),
        ]
        for row in shown
    ]
    if SCORES[rank.score_name].column:
        return columns[:4] + columns[5:], [row[:4] + row[5:] for row in rows]
    return columns, rows


def print_sensitivity(result: SensitivityResult, console: Console) -> None:
    """Print how the ranking depends on what is assumed."""
    columns = [
        Column("detected"),
        Column("tau"),
        Column("of", True, 1),
        Column("kept", True, 2),
        Column("first", False, 3),
        Column("biggest fall", False, 4),
        Column("assumption", False),
    ]
    rows = [
        [
            str(row.n_ok),
            decimals(row.kendall_tau_b, 2),
            str(row.n_compared),
            f"{row.kept}/{result.top}",
            short_name(row.best),
            f"{short_name(row.largest_fall)} −{row.largest_fall_ranks}" if row.largest_fall_ranks > 0 else MISSING,
            row.text,
        ]
        for row in result.rows
    ]
    title = f"What the first {result.top} stars by {SCORES[result.score_name].title} become under other assumptions"
    console.print(text_table(console, title, columns, rows, last_width=44))
    print_plain(console, result.statement)
    print_note(
        console,
        f"detected: stars whose reference planet is detected ({result.n_ok} nominally); tau: {tau_text(result.top)}; "
        f"of: their number; kept: how many of the nominal first {result.top} stay there; biggest fall: in ranks.",
    )


def print_explanation(told: Explanation, console: Console) -> None:
    """Print why a star stands where it stands."""
    star = told.star
    head = f"{full_name(star.name, star.hip)}: rank {star.rank} of {count_text(told.n_ranked)}"
    print_plain(console, f"{head} by {SCORES[told.score_name].title}", bold=True)
    for sentence in told.sentences:
        print_plain(console, sentence)
    console.print()
    _neighbours(told, console)
    console.print()
    _bands(told, console)
    _details(told, console)
    if told.ranks:
        ranks = ", ".join(f"{count_text(rank)} ({name.replace('_', ' ')})" for name, rank in told.ranks.items())
        print_note(console, f"Rank under other assumptions: {ranks}.")


def _neighbours(told: Explanation, console: Console) -> None:
    columns = [
        Column("#"),
        Column("star", False),
        Column(SCORES[told.score_name].label),
        Column("compl %", True, 1),
        Column("in", False, 5),
        Column("V mag", True, 3),
        Column("dist pc", True, 4),
        Column("margin", True, 2),
        Column("status", False),
    ]
    rows = [
        [
            str(row.rank),
            short_name(row.name),
            score_number(row.score, told.score_name),
            share_text(row.completeness),
            row.completeness_band,
            decimals(row.v_mag, 2),
            decimals(row.distance_pc, 2),
            significant(row.detection_margin),
            verdict_cell(row),
        ]
        for row in (told.better, told.star, told.worse)
        if row is not None
    ]
    console.print(text_table(console, "Between its neighbours", columns, rows))


def _bands(told: Explanation, console: Console) -> None:
    columns = [
        Column("band", False),
        Column("compl %"),
        Column("in zone %", True, 3),
        Column("whole %", True, 4),
        Column("sep ″", True, 4),
        Column("contrast", True, 2),
        Column("limit", True, 2),
        Column("wall", True, 7),
        Column("SNR", True, 6),
        Column("margin"),
        Column("at most", True, 1),
        Column("largest noise", False, 5),
        Column("status", False),
    ]
    rows = [
        [
            band.band,
            share_text(band.completeness),
            share_text(band.in_zone),
            share_text(band.observable),
            decimals(band.separation_arcsec, 3),
            ratio_text(band.contrast),
            ratio_text(band.contrast_limit),
            duration_text(band.time_s),
            significant(band.snr),
            significant(band.detection_margin),
            significant(band.floor_margin),
            term_text(band.dominant),
            verdict_cell(band),
        ]
        for band in told.bands
    ]
    console.print(text_table(console, "Its reference planet and its population, band by band", columns, rows))
    explain_symbols(console, [band.status for band in told.bands if band.status != "ok"])
    print_note(
        console,
        "compl %, in zone %, whole %: shares of the population that are detected, that lie in the dark quadrants, and "
        "whose whole aperture lies there, as a detection needs; limit: faintest contrast detected there; at most: "
        "margin that no length of visit can pass.",
    )


def _details(told: Explanation, console: Console) -> None:
    """What binds and what would help in the star's best band."""
    band = next((item for item in told.bands if item.band == told.star.band), None)
    if band is None or band.exposure_s is None:
        return
    for name, limit in (("exposure", band.exposure_limited_by), ("EM gain", band.gain_limited_by)):
        if limit:
            print_note(console, f"{band.band}: the {name} is held by {limit_text(limit)}.")
    for name, gain in band.gain_caps.items():
        print_note(console, f"{band.band}, frames of {significant(band.exposure_s)} s: {cap_sentence(name, gain)}.")
    helps = sorted(band.remedies.items(), key=lambda item: -item[1])
    good = [f"×{factor:.2f} {remedy_text(name)}" for name, factor in helps if factor >= _SMALLEST_GAIN]
    if good:
        print_note(console, f"{band.band}: what would raise the SNR: {'; '.join(good)}.")
