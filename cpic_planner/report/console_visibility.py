"""Visibility on the terminal: one star in words, several as a table."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from cpic_planner.models import VisibilityResult, VisibleTarget
from cpic_planner.report.cells import Cells, row_cells
from cpic_planner.report.names import full_name
from cpic_planner.report.numbers import MISSING, decimals, formatted
from cpic_planner.report.summary import day_text, pointing_sentence
from cpic_planner.report.terminal import print_note, print_plain, print_table
from cpic_planner.report.words import BLOCK_WORDS

if TYPE_CHECKING:
    from rich.console import Console

_SEASONS = 6
_LAST_COLUMN = 36
_YEAR_DAYS = 366.0
_BLOCKED = {"sun": "Sun", "moon": "Moon", "panel": "panels", "limb": "limb"}


def print_visibility(result: VisibilityResult, console: Console) -> None:
    """Print seasons, what blocks the rest, and what an orbit gives.

    Parameters
    ----------
    result : VisibilityResult
    console : Console
    """
    several = len(result.targets) > 1
    if several:
        years = result.mjd[-1] - result.mjd[0] > _YEAR_DAYS
        print_table(console, _title(result), _cells(years), result.targets, last_width=_LAST_COLUMN)
    else:
        _print_star(result, console)
    step = "day" if result.step_days == 1 else f"step of {result.step_days:g} days"
    orbit = f"circular, {result.altitude_km:g} km, {result.inclination_deg:g} deg, node drifting"
    print_note(
        console,
        f"Each {step} is its middle orbit of {result.period_s / 60:.1f} min ({orbit}). Windows are between limbs of "
        "the Earth, the anomaly not cut out. A season goes on behind a passage of the Moon.",
    )
    print_note(console, pointing_sentence(result.pointing))


def _title(result: VisibilityResult) -> str:
    return f"Visibility of {len(result.targets)} stars, {result.n_days} days from {day_text(result.start_utc)}"


def _print_star(result: VisibilityResult, console: Console) -> None:
    target = result.targets[0]
    where = f"ecliptic latitude {decimals(target.ecliptic_latitude_deg, 1)} deg"
    print_plain(
        console,
        f"{full_name(target.name, target.hip)}, {where}: {result.n_days} days from {day_text(result.start_utc)}",
        bold=True,
    )
    for season in target.seasons:
        print_plain(console, f"  season {season.start_utc[:16]} to {season.end_utc[:16]}: seen on {season.days:g} days")
    blocked = [f"{days:g} {BLOCK_WORDS[name]}" for name, days in target.blocked_days.items() if days > 0]
    print_plain(console, f"  {target.observable_days:g} days seen; blocked: {', '.join(blocked) or 'never'}")
    if target.visible_s is None:
        print_plain(console, "  never seen in this time")
        return
    best = f"{formatted(target.best_visible_s, 'min')} min on the best day, {day_text(target.best_utc or '')}"
    print_plain(console, f"  per orbit {formatted(target.visible_s, 'min')} min (median), {best}")
    longest = target.longest_window_s or 0.0
    endless = longest >= result.period_s * (1 - 1e-9)
    window = "without end: on some days it never sets" if endless else f"{formatted(longest, 'min')} min"
    print_plain(console, f"  longest window {window}")
    print_plain(console, f"  roll free by {decimals(target.roll_half_range_deg, 1)} deg either way (median)")


def _cells(years: bool) -> list[Cells]:
    def blocked(name: str) -> Callable[[VisibleTarget], str]:
        return lambda row: f"{row.blocked_days[name]:g}"

    days: dict[str, Any] = {name: Cells(header, blocked(name)) for name, header in _BLOCKED.items()}
    return row_cells(
        VisibleTarget,
        "name ecliptic_latitude_deg/3 observable_days sun/2 moon/2 panel/2 limb/5 visible_s best_visible_s best_utc/1 "
        "longest_window_s/4 roll_half_range_deg/6 seasons",
        best_utc=lambda row: MISSING if row.best_utc is None else day_text(row.best_utc),
        seasons=Cells("seasons", lambda row: _seasons(row, years), right=False),
        **days,
    )


def _seasons(target: VisibleTarget, years: bool) -> str:
    cut = 0 if years else 5
    seasons = [f"{day_text(one.start_utc)[cut:]} to {day_text(one.end_utc)[cut:]}" for one in target.seasons]
    more = [f"and {len(seasons) - _SEASONS} more"] if len(seasons) > _SEASONS else []
    return ", ".join([*seasons[:_SEASONS], *more]) or MISSING
