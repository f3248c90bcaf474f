"""The ranking on the terminal: table, sensitivity, and why one star stands where it stands."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cpic_planner.models import (
    BandStanding,
    Explanation,
    RankedTarget,
    RankResult,
    SensitivityResult,
    SensitivityRow,
)
from cpic_planner.registry.libraries import LIBRARIES
from cpic_planner.registry.scores import SCORES
from cpic_planner.report.cells import Cells, row_cells
from cpic_planner.report.names import full_name, short_name
from cpic_planner.report.numbers import MISSING, count_text, duration_text, significant
from cpic_planner.report.summary import limits_text, population_text
from cpic_planner.report.terminal import print_note, print_plain, print_table
from cpic_planner.report.words import cap_sentence, limit_text, remedy_text, score_number, tau_text, term_text

if TYPE_CHECKING:
    from rich.console import Console

_SMALLEST_GAIN = 1.005


def print_rank(rank: RankResult, console: Console, limit: int = 20) -> None:
    """Print the first ``limit`` rows of a ranking, and what its numbers refer to."""
    shown = rank.targets[:limit]
    title = f"Ranking: first {len(shown)} of {count_text(len(rank.targets))} stars, by {SCORES[rank.score_name].title}"
    own = "" if SCORES[rank.score_name].column else "score "  # a column shows it already
    cells = row_cells(
        RankedTarget,
        f"rank name v_mag/3 distance_pc/2 {own}completeness completeness_band/7 band/1 separation_arcsec/4 contrast/5 "
        "frames/9 em_gain/10 time_s/8 snr/2 detection_margin detection_probability status",
        score=_score(rank.score_name),
    )
    print_table(console, title, cells, shown, explained=True)
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


def _score(name: str) -> Cells:
    return Cells(SCORES[name].label, lambda row: score_number(row.score, name))


def print_sensitivity(result: SensitivityResult, console: Console) -> None:
    """Print how the ranking depends on what is assumed.

    Parameters
    ----------
    result : SensitivityResult
    console : Console
    """
    cells = row_cells(
        SensitivityRow,
        "n_ok kendall_tau_b n_compared/1 kept/2 best/3 largest_fall/4 text",
        kept=lambda row: f"{row.kept}/{result.top}",
        largest_fall=lambda row: (
            f"{short_name(row.largest_fall)} −{row.largest_fall_ranks}" if row.largest_fall_ranks > 0 else MISSING
        ),
    )
    title = f"What the first {result.top} stars by {SCORES[result.score_name].title} become under other assumptions"
    print_table(console, title, cells, result.rows, last_width=44)
    print_plain(console, result.statement)
    print_note(
        console,
        f"detected: stars whose reference planet is detected ({result.n_ok} nominally); tau: {tau_text(result.top)}; "
        f"of: their number; kept: how many of the nominal first {result.top} stay there; biggest fall: in ranks.",
    )


def print_explanation(told: Explanation, console: Console) -> None:
    """Print why a star stands where it stands.

    Parameters
    ----------
    told : Explanation
    console : Console
    """
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
    cells = row_cells(
        RankedTarget,
        "rank name score completeness/1 completeness_band/5 v_mag/3 distance_pc/4 detection_margin/2 status",
        score=_score(told.score_name),
    )
    rows = [row for row in (told.better, told.star, told.worse) if row is not None]
    print_table(console, "Between its neighbours", cells, rows)


def _bands(told: Explanation, console: Console) -> None:
    cells = row_cells(
        BandStanding,
        "band completeness in_zone/3 observable/4 separation_arcsec/4 contrast/2 contrast_limit/2 time_s/7 snr/6 "
        "detection_margin floor_margin/1 dominant/5 status",
        dominant=lambda band: term_text(band.dominant),
    )
    print_table(console, "Its reference planet and its population, band by band", cells, told.bands, explained=True)
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
