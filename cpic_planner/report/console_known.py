"""Known planets on the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from catalogs.known_planet_columns import FLAGS
from cpic_planner.models import KnownPlanetRow, KnownResult, Quantiles
from cpic_planner.report.cells import Cells, row_cells
from cpic_planner.report.names import pretty_name
from cpic_planner.report.numbers import count_text, ratio_text
from cpic_planner.report.terminal import print_note, print_plain, print_table

if TYPE_CHECKING:
    from rich.console import Console

_LISTED = ("candidate", "refuted")
"""Statuses of planets that are listed and not counted."""


def print_known(result: KnownResult, console: Console, limit: int = 40) -> None:
    """Print the planets, widest on the sky first unless a star was asked for, and what the numbers mean."""
    band = result.holes[0].band
    counted = [row for row in result.planets if row.status not in _LISTED]
    listed = [row for row in result.planets if row.status in _LISTED]
    shown = counted
    if result.years is None:
        shown = sorted(counted, key=lambda row: -row.bands[0].hole_share)
    shown = [*shown[:limit], *listed] if result.years is not None else shown[:limit]
    stars = len({row.star for row in counted})
    title = (
        f"Known planets: {len(counted[:limit])} of {count_text(len(counted))} around {count_text(stars)} "
        f"star{'s' * (stars != 1)}, {result.date_utc[:10]}, {band}"
        + (f"; {count_text(len(listed))} more listed and not counted" if listed else "")
    )
    print_table(console, title, _cells(), shown)
    if result.years is not None:
        for row in counted[:limit]:
            _print_windows(row, result, console)
            _print_standing(row, console)
    for row in listed:
        _print_standing(row, console)
    print_note(
        console,
        "Numbers: median +- half of the width that holds 68 % of the draws. in hole: share of the draws between inner "
        f"and outer corner of the dark hole of {band}"
        + (
            f" ({result.holes[0].inner_arcsec:.2f} to {result.holes[0].outer_arcsec:.2f} arcsec); at a given roll the "
            "position angle decides as well."
        ),
    )
    if result.years is not None:
        words = dict.fromkeys(flag for row in shown for flag in row.flags)
        for flag in words:
            print_note(console, f"{flag}: {FLAGS[flag]}.")
    print_note(
        console,
        f"{result.planets_table}; {count_text(result.n_draws)} draws of each planet with seed {result.seed}, "
        f"{result.albedo} albedo.",
    )


def _cells() -> list[Cells]:
    return row_cells(
        KnownPlanetRow,
        "planet distance_pc/5 period_days/4 semi_major_axis_au/3 eccentricity/6 mass_mjup/7 radius_rjup/8 "
        "separation_arcsec phase_deg/1 contrast in_hole/2 phase_known/2 status",
        planet=_name,
        separation_arcsec=lambda row: _with_width(row.separation_arcsec, 3),
        phase_deg=lambda row: _with_width(row.phase_deg, 0),
        contrast=Cells("contrast", lambda row: ratio_text(row.bands[0].contrast.median)),
        in_hole=Cells("in hole", lambda row: f"{100.0 * row.bands[0].hole_share:.0f} %"),
        phase_known=Cells("phase known", lambda row: "no" if "phase_unknown" in row.flags else "yes", right=False),
    )


def _name(row: KnownPlanetRow) -> str:
    return f"{pretty_name(row.star)} {row.planet.rpartition(' ')[2]}"


def _print_standing(row: KnownPlanetRow, console: Console) -> None:
    """Print how sure a planet is, who says so, and where its orbit was published."""
    said = [f"{_name(row)}: {row.status}" + (", not counted" if row.status in _LISTED else "")]
    said += [f"Status from {row.status_reference}"] if row.status_reference else []
    said += [row.note[0].upper() + row.note[1:]] if row.note else []
    said += [f"Orbit from {row.reference}"] if row.reference else []
    print_plain(console, ". ".join(said) + ".")


def _with_width(value: Quantiles, digits: int) -> str:
    return f"{value.median:.{digits}f} ± {0.5 * (value.high - value.low):.{digits}f}"


def _print_windows(row: KnownPlanetRow, result: KnownResult, console: Console) -> None:
    """Print the days on which the dark hole covers a planet, band by band."""
    years = f"{result.years:g} years from {result.date_utc[:10]}"
    if not row.windows:
        print_plain(console, f"{_name(row)}: in no band more likely than not in the dark hole within {years}")
        return
    for hole in result.holes:
        mine = [window for window in row.windows if window.band == hole.band]
        spans = ", ".join(f"{w.start_utc} to {w.end_utc} (best {w.best_utc}: {w.best_share:.0%})" for w in mine[:6])
        more = f" and {len(mine) - 6} more" if len(mine) > 6 else ""
        if mine:
            print_plain(console, f"{_name(row)}, {hole.band}: in the dark hole {spans}{more}")
