"""Known planets on the terminal.

Visibility on the terminal: one star in words, several as a table.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from catalogs.known_planets import FLAGS
from cpic_core import listed
from cpic_planner import results
from cpic_planner.report.cells import Cells, Sheet, computed, print_note, print_plain, print_table, row_cells
from cpic_planner.report.numbers import MISSING, count_text, decimals, formatted, full_name, ratio_text
from cpic_planner.report.priorities import best_window, known_planet_name, lacking_lines
from cpic_planner.report.summary import pointing_sentence
from cpic_planner.report.words import BLOCK_WORDS

if TYPE_CHECKING:
    from rich.console import Console

_DECIDES = ("phase_unknown", *(flag for flag in FLAGS if flag.endswith("_err_unknown")))
"""Flags that say what decides where a planet stands."""
_WINDOWS = 6
"""Windows of a planet that are printed."""


def print_known(result: results.KnownResult, console: Console, limit: int = 40, *, full: bool = True) -> None:
    """Print the planets, widest on the sky first unless a star was asked for, and what the headings mean.

    With ``full`` also every window, orbit and status with its reference, and what the numbers are from.
    """
    band = result.holes[0].band
    counted = [row for row in result.planets if row.counted]
    listed = [row for row in result.planets if not row.counted]
    shown = sorted(counted, key=lambda row: -row.bands[0].hole_share)[:limit]
    if result.years is not None:
        shown = [*counted[:limit], *listed]
    stars = len({row.star for row in counted})
    told = (
        f"{len(counted[:limit])} of {count_text(len(counted))} around {count_text(stars)} star{'s' * (stars != 1)}"
        if counted
        else "none that is counted"
    )
    more = f"; {count_text(len(listed))} {'more ' * bool(counted)}listed and not counted" if listed else ""
    title = f"Known planets: {told}, {result.date_utc[:10]}, {band}{more}"
    print_table(console, title, _cells(result), shown, legend=not full)
    told_of = {row.planet: [flag for flag in row.flags if full or _told(flag, row)] for row in shown}
    lines = lacking_lines(told_of if result.years is not None else {}, result.columns_not_used)
    if not full:
        if result.years is not None:
            print_note(
                console,
                f"Window: the days, within {result.years:g} years from {result.date_utc[:10]}, on which the planet is "
                "more likely than not between the corners of the dark hole, in the band that covers it best; of "
                "several windows, that of the best day (-v: all of them, orbits, references).",
            )
            print_note(console, *filter(None, [_caveats(shown)]))
        print_note(console, *lines)
        return
    if result.years is not None:
        years = f"{result.years:g} years from {result.date_utc[:10]}"
        never = ", ".join(known_planet_name(row) for row in counted[:limit] if not row.windows)
        if never:
            print_plain(console, f"In no band more likely than not in the dark hole within {years}: {never}.")
        for row in counted[:limit]:
            _print_windows(row, result, console)
            _print_standing(row, console)
    for row in listed:
        _print_standing(row, console)
    print_note(
        console,
        "Numbers: median +- half of the width that holds 68 % of the draws. in hole: share of the draws between inner "
        f"and outer corner of the dark hole of {band} ({result.holes[0].inner_arcsec:.2f} to "
        f"{result.holes[0].outer_arcsec:.2f} arcsec); at a given roll the position angle decides as well.",
        *(lines if result.years is not None else ()),
        f"{result.planets_table}; {count_text(result.n_draws)} draws of each planet with seed {result.seed}, "
        f"{result.albedo} albedo.",
    )


def _told(flag: str, row: results.KnownPlanetRow) -> bool:
    """Return whether a flag says what decides where a planet stands, or what an unused column may tell."""
    return flag in _DECIDES or ("columns_not_used" in row.flags and flag.endswith("_unknown"))


def _caveats(rows: Sequence[results.KnownPlanetRow]) -> str:
    """Return which of these planets have an orbit or a status that is in doubt, in one sentence; empty for none."""
    kinds = (
        ("a later orbit contradicts that of", [row for row in rows if row.superseded_by]),
        ("published orbits disagree on", [row for row in rows if len(row.orbits) > 1]),
        ("these planets are not counted:", [row for row in rows if not row.counted]),
    )
    said = [f"{text} {', '.join(map(known_planet_name, named))}" for text, named in kinds if named]
    return f"In doubt: {'; '.join(said)} (-v: who says so)." if said else ""


def _cells(result: results.KnownResult) -> list[Cells]:
    hole = result.holes[0]
    inside = (
        f"share of the draws between the corners of the dark hole of {hole.band}, {hole.inner_arcsec:.2f} to "
        f"{hole.outer_arcsec:.2f} arcsec; at a given roll the position angle decides as well"
    )
    windows = "" if result.years is None else "window/1 best_day/1 "
    return row_cells(
        results.KnownPlanetRow,
        "planet distance_pc/5 period_days/4 semi_major_axis_au/3 eccentricity/6 mass_mjup/7 radius_rjup/8 "
        f"separation_arcsec phase_deg/1 contrast in_hole/2 phase_known/3 {windows}status",
        planet=known_planet_name,
        separation_arcsec=Cells(
            "sep ″",
            lambda row: _with_width(row.separation_arcsec, 3),
            label="separation",
            legend="projected separation, the median of the draws ± half of the width that holds 68 % of them",
            fields=("separation_arcsec",),
        ),
        phase_deg=lambda row: _with_width(row.phase_deg, 0),
        contrast=computed("contrast", lambda row: row.bands[0].contrast.median, ratio_text, f"in {hole.band}"),
        in_hole=computed(
            "in hole", lambda row: row.bands[0].hole_share, lambda share: f"{100.0 * share:.0f} %", inside
        ),
        phase_known=Cells("phase known", lambda row: "no" if "phase_unknown" in row.flags else "yes", right=False),
        window=Cells("window", _window, right=False),
        best_day=Cells("best day", _best_day, legend="that on which it stands there most likely, and how likely"),
    )


def _window(row: results.KnownPlanetRow) -> str:
    """Return the window of the best day."""
    if not row.windows:
        return MISSING
    best = best_window(row)
    return best.start_utc if best.end_utc == best.start_utc else f"{best.start_utc} to {best.end_utc}"


def _best_day(row: results.KnownPlanetRow) -> str:
    return f"{best_window(row).best_utc}, {best_window(row).best_share:.0%}" if row.windows else MISSING


def _print_standing(row: results.KnownPlanetRow, console: Console) -> None:
    """Print how sure a planet is, who says so, and where its orbit was published."""
    words = {(False, True): ", not counted unless candidates are asked for", (True, True): ", counted as asked"}
    asked = words.get((row.counted, row.status == "candidate"), "" if row.counted else ", not counted")
    sentences = [f"{known_planet_name(row)}: {row.status}{asked}"]
    sentences += [f"Status from {row.status_reference}"] if row.status_reference else []
    sentences += [row.note[0].upper() + row.note[1:]] if row.note else []
    if len(row.orbits) > 1:
        told = "; ".join(
            f"{orbit.share:.0%} of the draws from {orbit.reference}{_elements(orbit)}" for orbit in row.orbits
        )
        sentences += [f"{len(row.orbits)} published orbits disagree: {told}"]
    elif row.reference:
        sentences += [f"Orbit from {row.reference}"]
    if row.superseded_by:
        sentences += [f"This orbit is contradicted by a later one: {row.superseded_by}"]
    print_plain(console, ". ".join(sentences) + ".")


def _with_width(value: results.Quantiles, digits: int) -> str:
    return f"{value.median:.{digits}f} ± {0.5 * (value.high - value.low):.{digits}f}"


def _elements(orbit: results.KnownOrbit) -> str:
    """Return period and eccentricity of an orbit in brackets."""
    told = {"P": (orbit.period_days, "d"), "a": (orbit.semi_major_axis_au, "au"), "e": (orbit.eccentricity, "")}
    words = [f"{name} {value:.4g} {unit}".strip() for name, (value, unit) in told.items() if value is not None]
    return f" ({', '.join(words)})" if words else ""


def _print_windows(row: results.KnownPlanetRow, result: results.KnownResult, console: Console) -> None:
    """Print the days on which the dark hole covers a planet, bands with the same days together."""
    bands: dict[str, list[str]] = {}
    for hole in result.holes:
        mine = [window for window in row.windows if window.band == hole.band]
        bands.setdefault(listed([*map(_span, mine)], _WINDOWS), []).append(hole.band)
    for spans, names in bands.items():
        inside = f"more likely than not in the dark hole {spans}" if spans else "at no time more likely than not in it"
        if row.windows:
            print_plain(console, f"{known_planet_name(row)}, {', '.join(names)}: {inside}")


def _span(window: results.KnownWindow) -> str:
    days = f"{window.start_utc} to {window.end_utc}" if window.end_utc != window.start_utc else f"on {window.start_utc}"
    best = f"best {window.best_utc}: " if window.end_utc != window.start_utc else ""
    return f"{days} ({best}{window.best_share:.0%})"


_SEASONS = 6
_LAST_COLUMN = 36
_YEAR_DAYS = 366.0
_ENDS = (
    "Windows end where the Earth covers the star; passages through the South Atlantic Anomaly are not cut out of them."
)
_BLOCKED = {"sun": "Sun", "moon": "Moon", "panel": "panels", "limb": "limb"}


def print_visibility(result: results.VisibilityResult, console: Console, *, full: bool = True) -> None:
    """Print seasons, what blocks the rest, and what an orbit gives; with ``full`` how that is worked out."""
    asked = isinstance(console, Sheet) and (bool(console.columns) or console.form not in ("table", "page"))
    several = len(result.targets) > 1 or asked
    if several:
        years = result.mjd[-1] - result.mjd[0] > _YEAR_DAYS
        title = f"Visibility of {len(result.targets)} stars, {result.n_days} days from {result.start_utc[:10]}"
        cells = _visibility_cells(years)
        print_table(console, title, cells, result.targets, last_width=_LAST_COLUMN, legend=not full)
    else:
        _print_star(result, console)
    if not full:
        print_note(console, _ENDS)
        print_note(console, pointing_sentence(result.pointing))
        return
    step = "day" if result.step_days == 1 else f"step of {result.step_days:g} days"
    orbit = f"circular, {result.altitude_km:g} km, {result.inclination_deg:g} deg, node drifting"
    print_note(
        console,
        f"Each {step} is its middle orbit of {result.period_s / 60:.1f} min ({orbit}). {_ENDS} "
        "A season goes on behind a passage of the Moon.",
    )
    print_note(console, pointing_sentence(result.pointing))


def _print_star(result: results.VisibilityResult, console: Console) -> None:
    target = result.targets[0]
    where = f"ecliptic latitude {decimals(target.ecliptic_latitude_deg, 1)} deg"
    print_plain(
        console,
        f"{full_name(target.name, target.hip)}, {where}: {result.n_days} days from {result.start_utc[:10]}",
        bold=True,
    )
    for season in target.seasons:
        print_plain(console, f"  season {season.start_utc[:16]} to {season.end_utc[:16]}: seen on {season.days:g} days")
    blocked = [f"{days:g} {BLOCK_WORDS[name]}" for name, days in target.blocked_days.items() if days > 0]
    print_plain(console, f"  {target.observable_days:g} days seen; blocked: {', '.join(blocked) or 'never'}")
    if target.visible_s is None:
        print_plain(console, "  never seen in this time")
        return
    best = f"{formatted(target.best_visible_s, 'min')} min on the best day, {(target.best_utc or '')[:10]}"
    print_plain(console, f"  per orbit {formatted(target.visible_s, 'min')} min (median), {best}")
    longest = target.longest_window_s or 0.0
    endless = longest >= result.period_s * (1 - 1e-9)
    window = "without end: on some days it never sets" if endless else f"{formatted(longest, 'min')} min"
    print_plain(console, f"  longest window {window}")
    print_plain(console, f"  roll free by {decimals(target.roll_half_range_deg, 1)} deg either way (median)")


def _visibility_cells(years: bool) -> list[Cells]:
    def blocked(name: str, header: str) -> Cells:
        legend = f"days blocked, {BLOCK_WORDS[name]}"
        return computed(
            header, lambda row: row.blocked_days[name], "{:g}".format, legend, name=f"blocked_{name}_days", unit="d"
        )

    days: dict[str, Any] = {name: blocked(name, header) for name, header in _BLOCKED.items()}
    return row_cells(
        results.VisibleTarget,
        "name ecliptic_latitude_deg/3 observable_days sun/2 moon/2 panel/2 limb/5 visible_s best_visible_s best_utc/1 "
        "longest_window_s/4 roll_half_range_deg/6 seasons",
        best_utc=lambda row: MISSING if row.best_utc is None else row.best_utc[:10],
        seasons=Cells("seasons", lambda row: _seasons(row, years), right=False),
        **days,
    )


def _seasons(target: results.VisibleTarget, years: bool) -> str:
    cut = 0 if years else 5
    seasons = [f"{one.start_utc[:10][cut:]} to {one.end_utc[:10][cut:]}" for one in target.seasons]
    return listed(seasons, _SEASONS) or MISSING
