"""Visibility on the terminal: one star in words, several as a table."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cpic_planner.models import VisibilityResult, VisibleTarget
from cpic_planner.report.names import full_name
from cpic_planner.report.numbers import MISSING, decimals
from cpic_planner.report.terminal import Column, print_note, print_plain, short_name, text_table
from cpic_planner.report.visibility_words import BLOCK_WORDS, day_text, pointing_sentence

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["print_visibility"]

_SEASONS = 6
_LAST_COLUMN = 36
_YEAR_DAYS = 366.0


def print_visibility(result: VisibilityResult, console: Console) -> None:
    """Print seasons, what blocks the rest, and what an orbit gives."""
    several = len(result.targets) > 1
    if several:
        years = result.mjd[-1] - result.mjd[0] > _YEAR_DAYS
        console.print(
            text_table(
                console,
                _title(result),
                _COLUMNS,
                [_row(target, years) for target in result.targets],
                last_width=_LAST_COLUMN,
            )
        )
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
    best = f"{_minutes(target.best_visible_s)} min on the best day, {day_text(target.best_utc or '')}"
    print_plain(console, f"  per orbit {_minutes(target.visible_s)} min (median), {best}")
    longest = target.longest_window_s or 0.0
    endless = longest >= result.period_s * (1 - 1e-9)
    window = "without end: on some days it never sets" if endless else f"{_minutes(longest)} min"
    print_plain(console, f"  longest window {window}")
    print_plain(console, f"  roll free by {decimals(target.roll_half_range_deg, 1)} deg either way (median)")


_COLUMNS = [
    Column("star", False),
    Column("ecl. lat", True, 3),
    Column("days"),
    Column("Sun", True, 2),
    Column("Moon", True, 2),
    Column("panels", True, 2),
    Column("limb", True, 5),
    Column("min/orbit"),
    Column("best"),
    Column("best day", False, 1),
    Column("window", True, 4),
    Column("roll ±", True, 6),
    Column("seasons", False),
]


def _row(target: VisibleTarget, years: bool) -> list[str]:
    blocked = [f"{target.blocked_days[name]:g}" for name in BLOCK_WORDS]
    cut = 0 if years else 5
    seasons = [f"{day_text(one.start_utc)[cut:]} to {day_text(one.end_utc)[cut:]}" for one in target.seasons]
    more = [f"and {len(seasons) - _SEASONS} more"] if len(seasons) > _SEASONS else []
    return [
        short_name(target.name),
        decimals(target.ecliptic_latitude_deg, 1),
        f"{target.observable_days:g}",
        *blocked,
        _minutes(target.visible_s),
        _minutes(target.best_visible_s),
        MISSING if target.best_utc is None else day_text(target.best_utc),
        _minutes(target.longest_window_s),
        decimals(target.roll_half_range_deg, 0),
        ", ".join([*seasons[:_SEASONS], *more]) or MISSING,
    ]


def _minutes(value_s: float | None) -> str:
    return decimals(None if value_s is None else value_s / 60.0, 1)
