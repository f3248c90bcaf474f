"""A comparison of survey strategies on the terminal."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cpic_planner.models.surveyed import StrategyOutcome, WhatIfResult
from cpic_planner.report.numbers import MISSING, count_text, decimals, duration_text, share_text, significant
from cpic_planner.report.terminal import Column, print_note, print_plain, short_name, text_table
from cpic_planner.report.whatif_looks import shown_rows
from cpic_planner.report.whatif_words import extent_text, interval_text, lead_sentences, planets_text

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["print_visits", "print_whatif"]

_LAST_COLUMN = 24
_MOST_STRATEGIES = 20
_MOST_STARS = 10


def print_whatif(result: WhatIfResult, console: Console, report: Path | None = None) -> None:
    """Print the summary, the strategies, their differences with the first one, and where the report is.

    Parameters
    ----------
    result : WhatIfResult
    console : Console
    report : Path, optional
        The written report.
    """
    for i, text in enumerate(lead_sentences(result)):
        print_plain(console, text, bold=i == 0)
    print_plain(console, f"Compared: {extent_text(result)}.")
    console.print()
    rows = shown_rows(result.strategies, _MOST_STRATEGIES)
    shown = [result.strategies[i] for i in rows]
    universes = f"{count_text(result.n_universes)} universes"
    title = f"{result.name or 'strategies'}: mean of {universes} and its 90 % interval"
    console.print(text_table(console, title, _COLUMNS, [_row(item) for item in shown], last_width=_LAST_COLUMN))
    if len(shown) < len(result.strategies):
        print_note(console, f"The first and the {len(shown) - 1} of {len(result.strategies)} that find most.")
    print_note(
        console,
        "survey: 5 to 95 % of single surveys; any: share that finds a planet; visits: made, mean; bound: how far the "
        "calendar is below what no calendar can pass; alarms: false ones, mean.",
    )
    if len(shown) > 1:
        console.print()
        _print_differences(result, {item.name for item in shown}, console)
    _print_images(shown, console)
    print_note(console, f"Seed {result.universe['seed']}, configuration {result.config_hash}.")
    if report is not None:
        print_plain(console, f"report: {report}")


_COLUMNS = [
    Column("planets"),
    Column("interval", True, 2),
    Column("survey", True, 5),
    Column("new", True, 1),
    Column("any %", True, 4),
    Column("hours"),
    Column("visits", True, 6),
    Column("bound %", True, 7),
    Column("alarms", True, 8),
    Column("strategy", False),
]


def _row(item: StrategyOutcome) -> list[str]:
    return [
        decimals(item.planets.mean, 2),
        interval_text(item.planets.low, item.planets.high),
        f"{item.planets.survey_low:.3g} to {item.planets.survey_high:.3g}",
        decimals(item.new_planets.mean, 2),
        share_text(item.any_planet),
        decimals(item.hours.mean, 0),
        decimals(sum(target.visits for target in item.targets), 1),
        decimals(100.0 * item.schedule.distance, 1),
        planets_text(item.noise_alarms.mean + item.background_alarms.mean),
        item.name,
    ]


def _print_differences(result: WhatIfResult, names: set[str], console: Console) -> None:
    """Paired differences with the first strategy."""
    reference = result.strategies[0].name
    by = {(item.first, item.quantity): item for item in result.differences if item.second == reference}
    columns = [
        Column("planets"),
        Column("interval", True, 2),
        Column("new", True, 3),
        Column("hours", True, 1),
        Column("verdict", False, 4),
        Column("strategy", False),
    ]
    rows = []
    for item in result.strategies[1:]:
        found = by.get((item.name, "planets"))
        if item.name not in names or found is None:
            continue
        new, hours = by.get((item.name, "new_planets")), by.get((item.name, "hours"))
        rows.append(
            [
                _signed(found.mean, 2),
                interval_text(found.low, found.high),
                MISSING if new is None else _signed(new.mean, 2),
                MISSING if hours is None else _signed(hours.mean, 0),
                "more" if found.low > 0 else "fewer" if found.high < 0 else "may be chance",
                item.name,
            ]
        )
    title = f"Difference with {reference} in the same universes"
    console.print(text_table(console, title, columns, rows, last_width=_LAST_COLUMN))


def _signed(value: float, places: int) -> str:
    return f"{'+' if value > 0 else ''}{decimals(value, places)}"


def _print_images(strategies: list[StrategyOutcome], console: Console) -> None:
    for item in strategies:
        sample = item.images
        if sample is None:
            continue
        if sample.images == 0:
            print_plain(
                console, f"{item.name}: no detection was simulated as images: {sample.note or 'none asked for'}"
            )
            continue
        remark = f"; {sample.note}" if sample.note else ""
        ends = "" if sample.low is None or sample.high is None else f" ({interval_text(sample.low, sample.high)})"
        print_plain(
            console,
            f"{item.name}: of {sample.detections} detections simulated as images {sample.found} are found, "
            f"{decimals(sample.expected, 1)} expected; correction {decimals(sample.correction, 2)}{ends}{remark}",
        )


def print_visits(result: WhatIfResult, console: Console, limit: int = _MOST_STARS) -> None:
    """Print the first stars of the strategy that finds most.

    Parameters
    ----------
    result : WhatIfResult
    console : Console
    limit : int
        How many stars.
    """
    best = max(result.strategies, key=lambda item: item.planets.mean)
    columns = [
        Column("#"),
        Column("star", False),
        Column("planets"),
        Column("per 100 h"),
        Column("visits"),
        Column("wall", True, 3),
        Column("hours", True, 1),
        Column("first", False, 2),
        Column("bands", False),
    ]
    rows = [
        [
            str(star.rank),
            short_name(star.name),
            planets_text(star.new_planets + star.known_seen),
            significant(star.planets_per_100h, 2),
            decimals(star.visits, 1),
            duration_text(star.visit_time_s),
            decimals(star.search_h + star.follow_up_h, 0),
            star.first_utc or MISSING,
            ", ".join(star.bands),
        ]
        for star in best.targets[:limit]
    ]
    if not rows:
        print_plain(console, f"{best.name} visits no star.")
        return
    title = f"{best.name}: first {len(rows)} of {count_text(len(best.targets))} stars by planets per hour"
    console.print(text_table(console, title, columns, rows))
    print_note(console, "Visits and hours made, and planets found, are means of a survey; wall: of one visit.")
