"""A comparison of survey strategies on the terminal."""

from __future__ import annotations

from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cpic_planner.models.surveyed import DifferenceRecord, StrategyOutcome, SurveyTarget, WhatIfResult
from cpic_planner.report.cells import Cells, row_cells
from cpic_planner.report.numbers import MISSING, count_text, decimals
from cpic_planner.report.terminal import print_note, print_plain, print_table
from cpic_planner.report.whatif_looks import shown_rows
from cpic_planner.report.whatif_words import extent_text, interval_text, lead_sentences, planets_text

if TYPE_CHECKING:
    from rich.console import Console

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
    print_table(console, title, _STRATEGIES, shown, last_width=_LAST_COLUMN)
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


_STRATEGIES = row_cells(
    StrategyOutcome,
    "planets interval/2 survey/5 new/1 any_planet/4 hours visits/6 bound/7 alarms/8 name",
    planets=lambda item: decimals(item.planets.mean, 2),
    interval=Cells("interval", lambda item: interval_text(item.planets.low, item.planets.high)),
    survey=Cells("survey", lambda item: f"{item.planets.survey_low:.3g} to {item.planets.survey_high:.3g}"),
    new=Cells("new", lambda item: decimals(item.new_planets.mean, 2)),
    hours=lambda item: decimals(item.hours.mean, 0),
    visits=Cells("visits", lambda item: decimals(sum(target.visits for target in item.targets), 1)),
    bound=Cells("bound %", lambda item: decimals(100.0 * item.schedule.distance, 1)),
    alarms=Cells("alarms", lambda item: planets_text(item.noise_alarms.mean + item.background_alarms.mean)),
)


def _print_differences(result: WhatIfResult, names: set[str], console: Console) -> None:
    """Paired differences with the first strategy."""
    reference = result.strategies[0].name
    by = {(item.first, item.quantity): item for item in result.differences if item.second == reference}
    found = [(item.name, by.get((item.name, "planets"))) for item in result.strategies[1:] if item.name in names]
    rows = [(name, item) for name, item in found if item is not None]

    def mean(name: str, quantity: Any, places: int) -> str:
        item = by.get((name, quantity))
        return MISSING if item is None else _signed(item.mean, places)

    cells = [
        Cells("planets", lambda row: _signed(row[1].mean, 2)),
        Cells("interval", lambda row: interval_text(row[1].low, row[1].high), gives_way=2),
        Cells("new", lambda row: mean(row[0], "new_planets", 2), gives_way=3),
        Cells("hours", lambda row: mean(row[0], "hours", 0), gives_way=1),
        Cells("verdict", lambda row: _likely(row[1]), right=False, gives_way=4),
        Cells("strategy", itemgetter(0), right=False),
    ]
    title = f"Difference with {reference} in the same universes"
    print_table(console, title, cells, rows, last_width=_LAST_COLUMN)


def _likely(item: DifferenceRecord) -> str:
    return "more" if item.low > 0 else "fewer" if item.high < 0 else "may be chance"


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
    rows = best.targets[:limit]
    if not rows:
        print_plain(console, f"{best.name} visits no star.")
        return
    title = f"{best.name}: first {len(rows)} of {count_text(len(best.targets))} stars by planets per hour"
    print_table(console, title, _VISITS, rows)
    print_note(console, "Visits and hours made, and planets found, are means of a survey; wall: of one visit.")


_VISITS = row_cells(
    SurveyTarget,
    "rank name planets planets_per_100h visits visit_time_s/3 hours/1 first_utc/2 bands",
    planets=Cells("planets", lambda star: planets_text(star.new_planets + star.known_seen)),
    hours=Cells("hours", lambda star: decimals(star.search_h + star.follow_up_h, 0)),
    first_utc=lambda star: star.first_utc or MISSING,
)
