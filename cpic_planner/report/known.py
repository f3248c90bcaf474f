"""Known planets and the visibility of stars: in words, on the terminal, and drawn against the date."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from catalogs.known_planets import FLAGS
from cpic_core import FloatArray, NDArray, listed
from cpic_planner import results
from cpic_planner.report import document as doc
from cpic_planner.report.cells import Cells, Sheet, computed, print_note, print_plain, print_table, row_cells
from cpic_planner.report.drawing import BAND_STYLE, Look, date_axis, literal, new_figure, style
from cpic_planner.report.words import (
    BLOCK_WORDS,
    MISSING,
    contrast_text,
    count_text,
    decimals,
    formatted,
    full_name,
    pretty_name,
    ratio_text,
    significant,
)
from cpic_planner.results import KnownPlanetRow, KnownResult, VisibilityResult, VisibleDays, VisibleTarget

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch
    from rich.console import Console


def pointing_sentence(pointing: results.PointingRecord) -> str:
    """Return the limits of pointing in one sentence."""
    turned = f"turning by up to {pointing.panel_turn_deg:g}" if pointing.panel == "one_axis" else "fixed"
    return (
        f"Limits {pointing.name}: {pointing.sun_deg:g} deg from the Sun, {pointing.moon_deg:g} from the Moon, "
        f"{pointing.dark_limb_deg:g} from a dark limb of the Earth, {pointing.bright_limb_deg:g} from a sunlit one; "
        f"panels {turned} deg, within {pointing.panel_deg:g} of the Sun; {100 * pointing.saa_fraction:g} % of all time "
        "lost to the South Atlantic Anomaly."
    ).replace("fixed deg", "fixed")


N_WINDOWS = 3


def known_blocks(known: results.KnownResult) -> Iterator[doc.Block]:
    """Yield the known planets of the first stars with the next days on which the dark hole covers them.

    Parameters
    ----------
    known : KnownResult
        With windows.
    """
    columns = doc.row_columns(
        results.KnownPlanetRow,
        "planet:row,text status semi_major_axis_au separation_arcsec contrast window:wide best",
        planet=known_planet_name,
        semi_major_axis_au=lambda row: significant(row.semi_major_axis_au.median, 3),
        separation_arcsec=Cells("", _separation, label="separation at the date (arcsec)", right=True),
        contrast=Cells("", lambda row: contrast_text(_best_band(row).contrast.median), label="contrast", right=True),
        window=Cells("", windows_text, right=False, label="next in the dark hole"),
        best=Cells("", _best_day, label="best day", right=True),
    )
    rows = [row for row in known.planets if row.counted]
    never = [known_planet_name(row) for row in rows if not row.windows]
    caption = (
        f"Known planets of these stars: the days of {known.years:g} years from {known.date_utc[:10]} on which a planet "
        "is more likely than not between the corners of the dark hole, in the band that covers it best; at a given "
        "roll the position angle decides as well. Best day: the one on which it is there most likely. Separation: "
        "median, and half of the width that holds 68 % of the draws of the published orbits."
    )
    windows = [row for row in rows if row.windows]
    yield doc.table("Known planets and their next windows", caption, columns, windows, look="firm")
    if never:
        yield doc.Paragraph(f"In no dark hole more likely than not in that time: {', '.join(never)}.", "note")
    for text in lacking_lines({}, known.columns_not_used):
        yield doc.Paragraph(text, "note")


_EXACT = ": taken as exact"


def lacking_lines(planets: Mapping[str, Sequence[str]], unused: Sequence[str]) -> list[str]:
    """Return what a table of known planets lacks or marks, a sentence each.

    Parameters
    ----------
    planets : mapping
        Flags by the names of planets, which are told where there are several.
    unused : sequence of str
        Headings of the table that were not used.
    """
    named: dict[str, list[str]] = {}
    for name, flags in planets.items():
        for flag in flags:
            named.setdefault(flag, []).append(name.rpartition(" ")[2])
    exact = [flag for flag in named if FLAGS[flag].endswith(_EXACT)]
    lines = []
    for flag, letters in named.items():
        if flag not in (*exact, "columns_not_used"):
            who = f"{', '.join(letters)}: " if len(planets) > 1 else ""
            text = FLAGS[flag]
            lines.append(f"{who}{text if who else text[0].upper() + text[1:]} ({flag}).")
    if exact:
        what = ", ".join(FLAGS[flag].removeprefix("no error of ").removesuffix(_EXACT) for flag in exact)
        lines.append(f"Taken as exact, because no error is given: {what} ({', '.join(exact)}).")
    if unused:
        lines.append(f"Columns of the table that were not used: {listed(unused)}; what is unknown may stand there.")
    return lines


def known_planet_name(row: results.KnownPlanetRow) -> str:
    """Return the name of the star as people write it, and the letter of the planet."""
    return f"{pretty_name(row.star)} {row.planet.rpartition(' ')[2]}"


def _separation(row: results.KnownPlanetRow) -> str:
    place = row.separation_arcsec
    return f"{place.median:.3f} ± {0.5 * (place.high - place.low):.3f}"


def best_window(row: results.KnownPlanetRow) -> results.KnownWindow:
    """Return the window with the day on which a dark hole covers the planet most likely; the earliest of equals."""
    return min(row.windows, key=lambda window: (-window.best_share, window.best_utc))


def _best_band(row: results.KnownPlanetRow) -> results.KnownBand:
    name = best_window(row).band
    return next(item for item in row.bands if item.band == name)


def windows_text(row: results.KnownPlanetRow) -> doc.Inline:
    """Return the next windows of the band of the best one."""
    band = _best_band(row).band
    own = [window for window in row.windows if window.band == band]
    spans = [f"{window.start_utc} to {window.end_utc}" for window in own[:N_WINDOWS]]
    more = f"and {len(own) - N_WINDOWS} more" if len(own) > N_WINDOWS else ""
    return doc.lines(f"{band}: {', '.join(spans)}", doc.small(more) if more else "")


def _best_day(row: results.KnownPlanetRow) -> str:
    window = best_window(row)
    return f"{window.best_utc}: {100.0 * window.best_share:.0f} %"


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
        best_day=Cells("best day", _best_day_text, legend="that on which it stands there most likely, and how likely"),
    )


def _window(row: results.KnownPlanetRow) -> str:
    """Return the window of the best day."""
    if not row.windows:
        return MISSING
    best = best_window(row)
    return best.start_utc if best.end_utc == best.start_utc else f"{best.start_utc} to {best.end_utc}"


def _best_day_text(row: results.KnownPlanetRow) -> str:
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


_UNIX_MJD = 40587.0


_LINES = ("-", "--", ":", "-.")


def known_figure(result: KnownResult) -> Figure:
    """Draw the tracks of the planets of one star.

    Parameters
    ----------
    result : KnownResult
        With tracks.
    """
    rows = [row for row in result.planets if row.track is not None]
    with style():
        figure = new_figure(4.6)
        axes = figure.subplots()
        _holes(axes, result)
        for number, row in enumerate(rows):
            _track(axes, row, number)
        axes.axvline(_days([result.mjd])[0], color="#444444", lw=0.9, ls=":")
        tops = [max(row.track.separation_high_arcsec) for row in rows if row.track is not None]
        highest = 1.08 * max(*tops, *(hole.outer_arcsec for hole in result.holes))
        axes.set(ylim=(0.0, highest), ylabel="projected separation (arcsec)", xlim=_ends(rows))
        date_axis(axes, minticks=5, maxticks=None)
        axes.grid(visible=True)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=3, fontsize=9, columnspacing=1.6)
        stars = ", ".join(dict.fromkeys(pretty_name(row.star) for row in rows))
        title = f"Known planets of {stars}: median, and 68 % of the draws"
        if result.columns_not_used:
            title += f"\ncolumns of the table that were not used: {listed(result.columns_not_used)}"
        figure.suptitle(literal(title), fontsize=11)
        figure.draw_without_rendering()
    return figure


def _holes(axes: Axes, result: KnownResult) -> None:
    """Draw the edges of the bands' dark holes, and shade what lies in any of them; equal edges share a line."""
    edges: dict[tuple[float, float], list[str]] = {}
    for hole in result.holes:
        edges.setdefault((hole.inner_arcsec, hole.outer_arcsec), []).append(hole.band)
    axes.axhspan(min(inner for inner, _ in edges), max(outer for _, outer in edges), color="#F2F2F2", lw=0, zorder=0)
    for number, ((inner, outer), bands) in enumerate(edges.items()):
        look: Look = {"color": "#666666", "lw": 0.8, "ls": _LINES[number % len(_LINES)], "zorder": 1}
        axes.axhline(outer, **look)
        axes.axhline(inner, label=f"dark hole {', '.join(bands)}: {inner:.2f} to {outer:.2f}″", **look)


def _track(axes: Axes, row: KnownPlanetRow, number: int) -> None:
    track = row.track
    assert track is not None
    colour = BAND_STYLE[number % len(BAND_STYLE)][0]
    days = _days(track.mjd)
    # Where the phase is unknown there is no track: lines say in which range the planet stands at any date.
    known = "phase_unknown" not in row.flags
    if known:
        low, high = track.separation_low_arcsec, track.separation_high_arcsec
        axes.fill_between(days, low, high, color=colour, alpha=0.25, lw=0)
    unknown = "".join(f", {name} unknown" for name in ("phase", "omega") if f"{name}_unknown" in row.flags)
    doubted = "" if row.status == "confirmed" else f", {row.status}"
    label = literal(f"{row.planet.rpartition(' ')[2]}{doubted}{unknown}")
    axes.plot(days, track.separation_median_arcsec, color=colour, lw=1.6 if known else 1.1, label=label)
    for end, edge in (("16", track.separation_low_arcsec), ("84", track.separation_high_arcsec)):
        look: Look = {"alpha": 0.4, "lw": 0.5} if known else {"ls": (0, (2, 2)), "lw": 0.9}
        axes.plot(days, edge, color=colour, label=f"_{label}, {end} % are below", **look)


def _ends(rows: list[KnownPlanetRow]) -> tuple[float, float]:
    dates = [day for row in rows if row.track is not None for day in (row.track.mjd[0], row.track.mjd[-1])]
    low, high = _days([min(dates), max(dates)])
    return float(low), float(high)


def _days(mjd: list[float]) -> np.ndarray:
    """Return the days since 1970, as the date axis counts."""
    return np.asarray(mjd, float) - _UNIX_MJD


# Light tints of Okabe-Ito colours and hatches: told apart with any colour vision, and in grey by the hatch.
_BLOCK_STYLE: dict[str, tuple[str, str]] = {
    "sun": ("#F6C48E", "////"),
    "moon": ("#C9C9C9", "...."),
    "panel": ("#E3BCD2", "\\\\\\\\"),
    "limb": ("#7A7A7A", "xxxx"),
}


_VISIBLE, _WINDOW, _SUN, _MOON = "#0072B2", "#111111", "#D55E00", "#666666"


_MINUTES = "Blues"


_BELOW: Look = {"loc": "upper center", "fontsize": 9}


def visibility_figure(result: VisibilityResult) -> Figure:
    """Draw minutes per orbit and angles of one star against the date, or minutes of several stars as a calendar."""
    with style():
        figure = _year(result) if len(result.targets) == 1 else _calendar(result)
        figure.draw_without_rendering()
    return figure


def _edges(result: VisibilityResult) -> FloatArray:
    """Return the begin of every step and the end of the last, dates of matplotlib."""
    middle = _days(result.mjd)
    return np.concatenate([middle, middle[-1:] + result.step_days]) - 0.5 * result.step_days


def _year(result: VisibilityResult) -> Figure:
    target = result.targets[0]
    edges = _edges(result)
    figure = new_figure(6.6)
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(1.25, 1.0))
    blocks = _shade((top, bottom), edges, target.days)
    _times(top, edges, target, result.period_s, blocks)
    _angles(bottom, edges, result)
    bottom.set_xlim(edges[0], edges[-1])
    date_axis(bottom)
    name = full_name(target.name, target.hip)
    where = f"ecliptic latitude {target.ecliptic_latitude_deg:.1f}°".replace("-", "−")
    title = f"{name}, {where}: seen on {target.observable_days:g} of {result.n_days} days from "
    figure.suptitle(literal(title + result.start_utc[:10]), fontsize=11)
    return figure


def _shade(axes: tuple[Axes, Axes], edges: FloatArray, days: VisibleDays) -> list[Patch]:
    """Shade what blocks; one handle a cause."""
    from matplotlib.patches import Patch

    handles: list[Patch] = []
    causes = np.array(days.blocked_by)
    for cause, (colour, hatch) in _BLOCK_STYLE.items():
        runs = _runs(causes == cause)
        look: Look = {"facecolor": colour, "edgecolor": "white", "hatch": hatch, "lw": 0.0}
        for begin, end in runs:
            for one in axes:
                one.axvspan(edges[begin], edges[end], zorder=0.5, **look)
        if runs:
            handles.append(Patch(label=BLOCK_WORDS[cause], **look))
    return handles


def _runs(chosen: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first step and first step behind of every run."""
    change = np.flatnonzero(np.diff(np.concatenate([[0], chosen.astype(int), [0]])))
    return [(int(begin), int(end)) for begin, end in zip(change[::2], change[1::2], strict=True)]


def _steps(axes: Axes, edges: FloatArray, values: list[float], visible: NDArray[np.bool_], **look: Any) -> Any:
    """Return a line of steps where something is seen."""
    shown = np.where(visible, values, np.nan)
    return axes.stairs(shown / 60.0, edges, baseline=None, **look)


def _times(axes: Axes, edges: FloatArray, target: VisibleTarget, period_s: float, blocks: list[Patch]) -> None:
    visible = np.array(target.days.blocked_by) == ""
    minutes = np.where(visible, target.days.visible_s, 0.0) / 60.0
    axes.stairs(minutes, edges, fill=True, color=_VISIBLE, alpha=0.55, lw=0.0)
    line = _steps(axes, edges, target.days.visible_s, visible, color=_VISIBLE, lw=1.4, label="usable, less the anomaly")
    look: Look = {"color": _WINDOW, "lw": 1.1, "ls": (0, (3, 1.5)), "label": "longest window"}
    window = _steps(axes, edges, target.days.window_s, visible, **look)
    whole = axes.axhline(period_s / 60.0, color="#8C8C8C", lw=1.0, ls=":", label="one orbit")
    axes.set(ylim=(0.0, 1.06 * period_s / 60.0), ylabel="minutes per orbit")
    axes.grid(visible=True, axis="y")
    axes.legend(handles=[line, window, whole, *blocks], ncols=3, bbox_to_anchor=(0.5, -0.02), **_BELOW)


def _angles(axes: Axes, edges: FloatArray, result: VisibilityResult) -> None:
    days, limits = result.targets[0].days, result.pointing
    middle = 0.5 * (edges[1:] + edges[:-1])
    (sun,) = axes.plot(middle, days.sun_deg, color=_SUN, lw=1.8, label="from the Sun")
    (moon,) = axes.plot(middle, days.moon_deg, color=_MOON, lw=1.0, label="from the Moon")
    turn = limits.panel_turn_deg if limits.panel == "one_axis" else 0.0
    reach = turn + limits.panel_deg
    lines = [("Sun limit", limits.sun_deg, _SUN, "--"), ("Moon limit", limits.moon_deg, _MOON, "--")]
    if 90.0 - reach > limits.sun_deg:
        lines.append(("panels from", 90.0 - reach, _SUN, ":"))
    if reach < 90.0:
        lines.append(("panels to", 90.0 + reach, _SUN, ":"))
    handles = [
        axes.axhline(value, color=colour, lw=1.1, ls=dashes, label=f"{label} {value:g}°")
        for label, value, colour, dashes in lines
    ]
    axes.set(ylim=(0.0, 180.0), ylabel="angle (deg)", yticks=range(0, 181, 30))
    axes.grid(visible=True, axis="y")
    axes.legend(handles=[sun, moon, *handles], ncols=6, columnspacing=1.2, bbox_to_anchor=(0.5, -0.19), **_BELOW)


def _calendar(result: VisibilityResult) -> Figure:
    import matplotlib as mpl
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.patches import Patch

    n = len(result.targets)
    edges = _edges(result)
    minutes = np.array([target.days.visible_s for target in result.targets]) / 60.0
    causes = np.array([target.days.blocked_by for target in result.targets])
    visible = minutes[causes == ""]
    low = 5.0 * np.floor(visible.min() / 5.0) if visible.size else 0.0
    high = max(5.0 * np.ceil(visible.max() / 5.0), low + 5.0) if visible.size else 1.0
    # The lightest blues are left out: they would look like nothing.
    colours = mpl.colors.ListedColormap(mpl.colormaps[_MINUTES](np.linspace(0.25, 1.0, 256)))
    scale = Normalize(low, high)
    figure = new_figure(min(12.0, 2.1 + 0.3 * n))
    axes = figure.subplots()
    extent = (edges[0], edges[-1], n - 0.5, -0.5)
    axes.imshow(colours(scale(minutes)), aspect="auto", interpolation="nearest", extent=extent)
    used: list[Patch] = []
    for cause, (colour, hatch) in _BLOCK_STYLE.items():
        look: Look = {"facecolor": colour, "edgecolor": "white", "hatch": hatch, "lw": 0.0}
        for row in range(n):
            bars = [(edges[begin], edges[end] - edges[begin]) for begin, end in _runs(causes[row] == cause)]
            axes.broken_barh(bars, (row - 0.5, 1.0), **look)
        if (causes == cause).any():
            used.append(Patch(**look, label=BLOCK_WORDS[cause]))
    axes.set_yticks(range(n), [literal(pretty_name(target.name)) for target in result.targets])
    for row in range(1, n):
        axes.axhline(row - 0.5, color="white", lw=1.6)
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(n - 0.5, -0.5)
    axes.set_xlim(edges[0], edges[-1])
    date_axis(axes)
    figure.colorbar(ScalarMappable(scale, colours), ax=axes, label="minutes per orbit", pad=0.015, aspect=max(8, 3 * n))
    if used:
        figure.legend(handles=used, loc="outside lower center", ncols=len(used), fontsize=9)
    figure.suptitle(f"{n} stars, {result.n_days} days from {result.start_utc[:10]}", fontsize=11)
    return figure


def visibility_csv(result: results.VisibilityResult) -> str:
    """Return visibility as CSV: one line a target and step."""
    days = ("blocked_by", "visible_s", "window_s", "roll_half_range_deg", "sun_deg", "moon_deg")
    names = ("name", "mjd", *days)
    rows = (
        dict(zip(names, (target.name, *step), strict=True))
        for target in result.targets
        for step in zip(result.mjd, *(getattr(target.days, name) for name in days), strict=True)
    )
    return results.csv_text(names, rows)
