"""Known planets and the visibility of stars: in words, on the terminal, and drawn against the date."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from catalogs.known_planets import FLAGS
from cpic_core import FloatArray, NDArray, listed
from cpic_planner import results
from cpic_planner.report import document as doc, drawing, words
from cpic_planner.report.drawing import BAND_STYLE, Look, literal, with_style
from cpic_planner.report.words import BLOCK_WORDS, MISSING, count_text, pretty_name
from cpic_planner.results import KnownPlanetRow, KnownResult, VisibilityResult, VisibleTarget

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch


_EXACT = ": taken as exact"
_N_WINDOWS = 3
"""Windows of a planet in pages."""


def known_planet_name(row: KnownPlanetRow) -> str:
    """Return the name of the star as people write it, and the letter of the planet."""
    return f"{pretty_name(row.star)} {row.planet.rpartition(' ')[2]}"


def best_window(row: KnownPlanetRow) -> results.KnownWindow:
    """Return the window with the day on which a dark hole covers the planet most likely; the earliest of equals."""
    return min(row.windows, key=lambda window: (-window.best_share, window.best_utc))


def windows_text(row: KnownPlanetRow) -> doc.Inline:
    """Return the next windows of the band of the best one."""
    band = best_window(row).band
    own = [window for window in row.windows if window.band == band]
    spans = [f"{window.start_utc} to {window.end_utc}" for window in own[:_N_WINDOWS]]
    more = f"and {len(own) - _N_WINDOWS} more" if len(own) > _N_WINDOWS else ""
    return doc.lines(f"{band}: {', '.join(spans)}", doc.small(more))


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


_DECIDES = ("phase_unknown", *(flag for flag in FLAGS if flag.endswith("_err_unknown")))
"""Flags that say what decides where a planet stands."""


def known_blocks(result: KnownResult, limit: int = 40, *, full: bool = True) -> Iterator[doc.Block]:
    """Yield the planets, widest on the sky first unless a star was asked for, and what the headings mean.

    Parameters
    ----------
    result : KnownResult
    limit : int
        Most planets.
    full : bool
        Also every window, orbit and status with its reference, and what the numbers are from.
    """
    hole, of_star = result.holes[0], result.years is not None
    counted = [row for row in result.planets if row.counted]
    others = [row for row in result.planets if not row.counted]
    shown = [*counted[:limit], *others]
    if not of_star:
        shown = sorted(counted, key=lambda row: -row.bands[0].hole_share)[:limit]
    stars = words.counted(len({row.star for row in counted}), "star")
    told = f"{len(counted[:limit])} of {count_text(len(counted))} around {stars}" if counted else "none that is counted"
    more = f"; {count_text(len(others))} {'more ' * bool(counted)}listed and not counted" if others else ""
    title = f"Known planets: {told}, {result.date_utc[:10]}, {hole.band}{more}"
    window = "" if result.years is None else "window/1 best_day/1 "
    yield doc.Table(title, _columns(result, f"{_LAYOUT} {window}status"), shown, legend=not full)
    flags = {row.planet: [flag for flag in row.flags if full or _decides(flag, row)] for row in shown}
    lacking = lacking_lines(flags if of_star else {}, result.columns_not_used)
    since = f"within {result.years:g} years from {result.date_utc[:10]}" if of_star else ""
    if not full:
        if of_star:
            yield from doc.notes(words.text("texts.known_window", since=since), *_caveats(shown))
        yield from doc.notes(*lacking)
        return
    if of_star:
        if never := ", ".join(known_planet_name(row) for row in counted[:limit] if not row.windows):
            yield doc.Paragraph(f"In no band more likely than not in the dark hole {since}: {never}.")
        for row in counted[:limit]:
            yield from doc.notes(*_windows_lines(row, result), _standing_text(row), look="")
    yield from doc.notes(*map(_standing_text, others), look="")
    numbers = words.text("texts.known_columns", hole=hole)
    yield from doc.notes(numbers, *(lacking if of_star else ()), words.text("texts.known_draws", result=result))


def window_blocks(known: KnownResult) -> Iterator[doc.Block]:
    """Yield the known planets of the first stars with the next days on which the dark hole covers them.

    Parameters
    ----------
    known : KnownResult
        With windows.
    """

    def contrast(row: KnownPlanetRow) -> str:
        band = next(item for item in row.bands if item.band == best_window(row).band)
        return words.ratio_text(band.contrast.median)

    columns = _columns(
        known,
        "planet:row,text status semi_major_axis_au separation_arcsec contrast window:wide best_day",
        contrast=doc.own_column("contrast", contrast),
        window=doc.own_column("next in the dark hole", windows_text, look="left"),
    )
    rows = [row for row in known.planets if row.counted]
    caption = words.text("texts.known_windows", known=known, date=known.date_utc[:10])
    seen = [row for row in rows if row.windows]
    yield doc.Table("Known planets and their next windows", columns, seen, caption, look="firm")
    if never := [known_planet_name(row) for row in rows if not row.windows]:
        yield doc.Paragraph(f"In no dark hole more likely than not in that time: {', '.join(never)}.", "note")
    yield from doc.notes(*lacking_lines({}, known.columns_not_used))


def _decides(flag: str, row: KnownPlanetRow) -> bool:
    """Return whether a flag says what decides where a planet stands, or what an unused column may tell."""
    return flag in _DECIDES or ("columns_not_used" in row.flags and flag.endswith("_unknown"))


def _caveats(rows: Sequence[KnownPlanetRow]) -> list[str]:
    """Return which of these planets have an orbit or a status that is in doubt, in one sentence; none without one."""
    kinds = {
        "a later orbit contradicts that of": [row for row in rows if row.superseded_by],
        "published orbits disagree on": [row for row in rows if len(row.orbits) > 1],
        "these planets are not counted:": [row for row in rows if not row.counted],
    }
    said = [f"{text} {', '.join(map(known_planet_name, named))}" for text, named in kinds.items() if named]
    return [f"In doubt: {'; '.join(said)} (-v: who says so)."] if said else []


_LAYOUT = (
    "planet:row,text distance_pc/5 period_days/4 semi_major_axis_au/3 eccentricity/6 mass_mjup/7 radius_rjup/8 "
    "separation_arcsec phase_deg/1 contrast in_hole/2 phase_known/3"
)


def _columns(result: KnownResult, layout: str, **special: doc.Special) -> list[results.Column]:
    hole = result.holes[0]
    inside = words.text("texts.known_in_hole", hole=hole)

    def window(row: KnownPlanetRow) -> str:
        if not row.windows:
            return MISSING
        best = best_window(row)
        return best.start_utc if best.end_utc == best.start_utc else f"{best.start_utc} to {best.end_utc}"

    def best_day(row: KnownPlanetRow) -> str:
        if not row.windows:
            return MISSING
        return f"{best_window(row).best_utc}: {100.0 * best_window(row).best_share:.0f} %"

    separation = "projected separation, the median of the draws ± half of the width that holds 68 % of them"
    of: dict[str, Any] = {"fields": "separation_arcsec", "of": (KnownPlanetRow, doc.itself), "legend": separation}
    likely = "that on which it stands there most likely, and how likely"
    unknown = {True: "no", False: "yes"}
    made: dict[str, Any] = {
        "planet": known_planet_name,
        "separation_arcsec": doc.own_column("sep ″", "{separation_arcsec:±.3f}", label="separation", **of),
        "phase_deg": "{phase_deg:±.0f}",
        "contrast": doc.computed(
            "contrast", lambda row: row.bands[0].contrast.median, words.ratio_text, f"in {hole.band}"
        ),
        "in_hole": doc.computed("in hole", lambda row: row.bands[0].hole_share, lambda x: f"{100.0 * x:.0f} %", inside),
        "phase_known": doc.own_column("phase known", lambda row: unknown["phase_unknown" in row.flags], look="left"),
        "window": doc.own_column("window", window, look="left"),
        "best_day": doc.own_column("best day", best_day, legend=likely),
    }
    return doc.row_columns(KnownPlanetRow, layout, **(made | special))


def _standing_text(row: KnownPlanetRow) -> str:
    """Return how sure a planet is, who says so, and where its orbit was published."""
    if row.status == "candidate":
        asked = ", counted as asked" if row.counted else ", not counted unless candidates are asked for"
    else:
        asked = "" if row.counted else ", not counted"
    sentences = [f"{known_planet_name(row)}: {row.status}{asked}"]
    sentences += [f"Status from {row.status_reference}"] if row.status_reference else []
    sentences += [row.note[0].upper() + row.note[1:]] if row.note else []
    if len(row.orbits) > 1:
        told = "; ".join(f"{one.share:.0%} of the draws from {one.reference}{_elements(one)}" for one in row.orbits)
        sentences += [f"{len(row.orbits)} published orbits disagree: {told}"]
    elif row.reference:
        sentences += [f"Orbit from {row.reference}"]
    if row.superseded_by:
        sentences += [f"This orbit is contradicted by a later one: {row.superseded_by}"]
    return ". ".join(sentences) + "."


def _elements(orbit: results.KnownOrbit) -> str:
    """Return period and eccentricity of an orbit in brackets."""
    told = {"P": (orbit.period_days, "d"), "a": (orbit.semi_major_axis_au, "au"), "e": (orbit.eccentricity, "")}
    texts = [f"{name} {value:.4g} {unit}".strip() for name, (value, unit) in told.items() if value is not None]
    return f" ({', '.join(texts)})" if texts else ""


def _windows_lines(row: KnownPlanetRow, result: KnownResult) -> list[str]:
    """Return the days on which the dark hole covers a planet, bands with the same days together."""
    bands: dict[str, list[str]] = {}
    for hole in result.holes if row.windows else ():
        mine = [_span(window) for window in row.windows if window.band == hole.band]
        inside = f"more likely than not in the dark hole {listed(mine, _MOST_SPANS)}"
        bands.setdefault(inside if mine else "at no time more likely than not in it", []).append(hole.band)
    return [f"{known_planet_name(row)}, {', '.join(names)}: {inside}" for inside, names in bands.items()]


def _span(window: results.KnownWindow) -> str:
    if window.end_utc == window.start_utc:
        return f"on {window.start_utc} ({window.best_share:.0%})"
    return f"{window.start_utc} to {window.end_utc} (best {window.best_utc}: {window.best_share:.0%})"


_MOST_SPANS = 6
"""Windows of a planet, and seasons of a star, that are told."""
_YEAR_DAYS = 366.0
_ENDS = (
    "Windows end where the Earth covers the star; passages through the South Atlantic Anomaly are not cut out of them."
)
_BLOCKED = {"sun": "Sun", "moon": "Moon", "panel": "panels", "limb": "limb"}


def pointing_sentence(pointing: results.PointingRecord) -> str:
    """Return the limits of pointing in one sentence."""
    turned = f"turning by up to {pointing.panel_turn_deg:g} deg" if pointing.panel == "one_axis" else "fixed"
    return words.text("texts.pointing", pointing=pointing, turned=turned, anomaly=100 * pointing.saa_fraction)


def visibility_blocks(result: VisibilityResult, *, full: bool = True) -> Iterator[doc.Block]:
    """Yield seasons, what blocks the rest, and what an orbit gives; with ``full`` how that is worked out."""
    first, *others = result.targets
    stars = f"{len(result.targets)} stars" if others else words.full_name(first.name, first.hip)
    title = f"Visibility of {stars}, {result.n_days} days from {result.start_utc[:10]}"
    columns = _visibility_columns(years=result.mjd[-1] - result.mjd[0] > _YEAR_DAYS)
    yield doc.Table(title, columns, result.targets, last_width=36, legend=not full)
    if len(result.targets) == 1:
        yield from _star_blocks(result)
    step = "day" if result.step_days == 1 else f"step of {result.step_days:g} days"
    orbit = f"circular, {result.altitude_km:g} km, {result.inclination_deg:g} deg, node drifting"
    worked = f"Each {step} is its middle orbit of {result.period_s / 60:.1f} min ({orbit}). {_ENDS} "
    how = f"{worked}A season goes on behind a passage of the Moon." if full else _ENDS
    yield from doc.notes(how, pointing_sentence(result.pointing))


def _star_blocks(result: VisibilityResult) -> Iterator[doc.Block]:
    """Yield what the row of a single star leaves out: its seasons day by day, and where its windows have no end."""
    target = result.targets[0]
    seasons = [
        f"Season {season.start_utc[:16]} to {season.end_utc[:16]}: seen on {season.days:g} days"
        for season in target.seasons
    ]
    yield from doc.notes(*seasons, look="")
    blocked = [f"{days:g} {BLOCK_WORDS[name]}" for name, days in target.blocked_days.items() if days > 0]
    yield doc.Paragraph(f"{target.observable_days:g} days seen; blocked: {', '.join(blocked) or 'never'}")
    if target.visible_s is None:
        yield doc.Paragraph("Never seen in this time.")
        return
    longest_s = target.longest_window_s or 0.0
    endless = longest_s >= result.period_s * (1 - 1e-9)
    window = "without end: on some days it never sets" if endless else f"{longest_s / 60.0:.1f} min"
    roll = f"roll free by {target.roll_half_range_deg or 0.0:.1f} deg either way (median)"
    yield doc.Paragraph(f"Longest window {window}; {roll}.")


def _visibility_columns(*, years: bool) -> list[results.Column]:
    def blocked(name: str) -> results.Column:
        about = {"legend": f"days blocked, {BLOCK_WORDS[name]}", "name": f"blocked_{name}_days", "unit": "d"}
        return doc.computed(_BLOCKED[name], lambda row: row.blocked_days[name], "{:g}".format, **about)

    def seasons(target: VisibleTarget) -> str:
        cut = 0 if years else 5
        spans = [f"{one.start_utc[:10][cut:]} to {one.end_utc[:10][cut:]}" for one in target.seasons]
        return listed(spans, _MOST_SPANS) or MISSING

    days: dict[str, Any] = {name: blocked(name) for name in _BLOCKED}
    return doc.row_columns(
        VisibleTarget,
        "name ecliptic_latitude_deg/3 observable_days sun/2 moon/2 panel/2 limb/5 visible_s best_visible_s best_utc/1 "
        "longest_window_s/4 roll_half_range_deg/6 seasons",
        best_utc=lambda row: MISSING if row.best_utc is None else row.best_utc[:10],
        seasons=doc.own_column("seasons", seasons, look="left"),
        **days,
    )


def visibility_csv(result: VisibilityResult) -> str:
    """Return visibility as CSV: one line a target and step."""
    days = ("blocked_by", "visible_s", "window_s", "roll_half_range_deg", "sun_deg", "moon_deg")
    names = ("name", "mjd", *days)
    rows = (
        dict(zip(names, (target.name, *step), strict=True))
        for target in result.targets
        for step in zip(result.mjd, *(getattr(target.days, name) for name in days), strict=True)
    )
    return results.csv_text(names, rows)


_UNIX_MJD = 40587.0
_LINES = ("-", "--", ":", "-.")


def _days(mjd: Sequence[float]) -> np.ndarray:
    """Return the days since 1970, as the date axis counts."""
    return np.asarray(mjd, float) - _UNIX_MJD


@with_style
def known_figure(result: KnownResult) -> Figure:
    """Draw the tracks of the planets of one star.

    Parameters
    ----------
    result : KnownResult
        With tracks.
    """
    tracks = [(row, row.track) for row in result.planets if row.track is not None]
    figure, axes = drawing.panels(4.6)
    _holes(axes, result)
    for (row, track), (colour, _) in zip(tracks, BAND_STYLE * len(tracks), strict=False):
        _draw_track(axes, row, track, colour)
    axes.axvline(_days([result.mjd])[0], color="#444444", lw=0.9, ls=":")
    dates = _days([day for _, track in tracks for day in (track.mjd[0], track.mjd[-1])])
    tops = [max(track.separation_high_arcsec) for _, track in tracks] + [hole.outer_arcsec for hole in result.holes]
    axes.set(ylim=(0.0, 1.08 * max(tops)), ylabel="projected separation (arcsec)", xlim=(dates.min(), dates.max()))
    drawing.date_axis(axes, minticks=5, maxticks=None)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=3, fontsize=9, columnspacing=1.6)
    stars = ", ".join(dict.fromkeys(pretty_name(row.star) for row, _ in tracks))
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


def _draw_track(axes: Axes, row: KnownPlanetRow, track: results.KnownTrack, colour: str) -> None:
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
    look: Look = {"alpha": 0.4, "lw": 0.5} if known else {"ls": (0, (2, 2)), "lw": 0.9}
    for end, edge in (("16", track.separation_low_arcsec), ("84", track.separation_high_arcsec)):
        axes.plot(days, edge, color=colour, label=f"_{label}, {end} % are below", **look)


# Light tints of Okabe-Ito colours and hatches: told apart with any colour vision, and in grey by the hatch.
_BLOCK_STYLE: dict[str, tuple[str, str]] = {
    "sun": ("#F6C48E", "////"),
    "moon": ("#C9C9C9", "...."),
    "panel": ("#E3BCD2", "\\\\\\\\"),
    "limb": ("#7A7A7A", "xxxx"),
}
_VISIBLE, _WINDOW, _SUN, _MOON = "#0072B2", "#111111", "#D55E00", "#666666"
_BELOW: Look = {"loc": "upper center", "fontsize": 9}


@with_style
def visibility_figure(result: VisibilityResult) -> Figure:
    """Draw minutes per orbit and angles of one star against the date, or minutes of several stars as a calendar."""
    middle = _days(result.mjd)
    edges = np.concatenate([middle, middle[-1:] + result.step_days]) - 0.5 * result.step_days
    figure = _year(result, edges) if len(result.targets) == 1 else _calendar(result, edges)
    figure.draw_without_rendering()
    return figure


def _year(result: VisibilityResult, edges: FloatArray) -> Figure:
    target = result.targets[0]
    figure, (top, bottom) = drawing.panels(6.6, rows=2, grid="y", sharex=True, height_ratios=(1.25, 1.0))
    causes = np.array(target.days.blocked_by)
    blocks = []
    for cause, runs, patch in _blocks(causes):
        for begin, end in runs:
            for one in (top, bottom):
                one.axvspan(edges[begin], edges[end], zorder=0.5, **_block_look(cause))
        blocks.append(patch)
    _times(top, edges, target, result.period_s, blocks)
    _angles(bottom, 0.5 * (edges[1:] + edges[:-1]), result)
    bottom.set_xlim(edges[0], edges[-1])
    drawing.date_axis(bottom)
    where = f"ecliptic latitude {target.ecliptic_latitude_deg:.1f}°".replace("-", "−")
    title = f"{words.full_name(target.name, target.hip)}, {where}: seen on {target.observable_days:g} of "
    figure.suptitle(literal(f"{title}{result.n_days} days from {result.start_utc[:10]}"), fontsize=11)
    return figure


def _block_look(cause: str) -> Look:
    colour, hatch = _BLOCK_STYLE[cause]
    return {"facecolor": colour, "edgecolor": "white", "hatch": hatch, "lw": 0.0}


def _blocks(causes: NDArray[np.str_]) -> Iterator[tuple[str, list[tuple[int, int]], Patch]]:
    """Yield each cause that blocks, its runs (first step, first step behind), and its handle for a legend."""
    from matplotlib.patches import Patch

    for cause in _BLOCK_STYLE:
        change = np.flatnonzero(np.diff(np.concatenate([[0], (causes == cause).astype(int), [0]])))
        if change.size:
            runs = [(int(begin), int(end)) for begin, end in zip(change[::2], change[1::2], strict=True)]
            yield cause, runs, Patch(label=BLOCK_WORDS[cause], **_block_look(cause))


def _times(axes: Axes, edges: FloatArray, target: VisibleTarget, period_s: float, blocks: list[Patch]) -> None:
    visible = np.array(target.days.blocked_by) == ""

    def steps(values_s: list[float], **look: Any) -> Any:
        """Return a line of steps where something is seen."""
        return axes.stairs(np.where(visible, values_s, np.nan) / 60.0, edges, baseline=None, **look)

    minutes = np.where(visible, target.days.visible_s, 0.0) / 60.0
    axes.stairs(minutes, edges, fill=True, color=_VISIBLE, alpha=0.55, lw=0.0)
    line = steps(target.days.visible_s, color=_VISIBLE, lw=1.4, label="usable, less the anomaly")
    window = steps(target.days.window_s, color=_WINDOW, lw=1.1, ls=(0, (3, 1.5)), label="longest window")
    whole = axes.axhline(period_s / 60.0, color="#8C8C8C", lw=1.0, ls=":", label="one orbit")
    axes.set(ylim=(0.0, 1.06 * period_s / 60.0), ylabel="minutes per orbit")
    axes.legend(handles=[line, window, whole, *blocks], ncols=3, bbox_to_anchor=(0.5, -0.02), **_BELOW)


def _angles(axes: Axes, middle: FloatArray, result: VisibilityResult) -> None:
    days, limits = result.targets[0].days, result.pointing
    (sun,) = axes.plot(middle, days.sun_deg, color=_SUN, lw=1.8, label="from the Sun")
    (moon,) = axes.plot(middle, days.moon_deg, color=_MOON, lw=1.0, label="from the Moon")
    reach = limits.panel_deg + (limits.panel_turn_deg if limits.panel == "one_axis" else 0.0)
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
    axes.legend(handles=[sun, moon, *handles], ncols=6, columnspacing=1.2, bbox_to_anchor=(0.5, -0.19), **_BELOW)


def _calendar(result: VisibilityResult, edges: FloatArray) -> Figure:
    import matplotlib as mpl
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    n = len(result.targets)
    minutes = np.array([target.days.visible_s for target in result.targets]) / 60.0
    causes = np.array([target.days.blocked_by for target in result.targets])
    visible = minutes[causes == ""]
    low = 5.0 * np.floor(visible.min() / 5.0) if visible.size else 0.0
    high = max(5.0 * np.ceil(visible.max() / 5.0), low + 5.0) if visible.size else 1.0
    # The lightest blues are left out: they would look like nothing.
    colours = mpl.colors.ListedColormap(mpl.colormaps["Blues"](np.linspace(0.25, 1.0, 256)))
    scale = Normalize(low, high)
    figure, axes = drawing.panels(min(12.0, 2.1 + 0.3 * n), grid="")
    extent = (edges[0], edges[-1], n - 0.5, -0.5)
    axes.imshow(colours(scale(minutes)), aspect="auto", interpolation="nearest", extent=extent)
    used: dict[str, Patch] = {}
    for row in range(n):
        for cause, runs, patch in _blocks(causes[row]):
            bars = [(edges[begin], edges[end] - edges[begin]) for begin, end in runs]
            axes.broken_barh(bars, (row - 0.5, 1.0), **_block_look(cause))
            used[cause] = patch
    drawing.name_rows(axes, [literal(pretty_name(target.name)) for target in result.targets], marks=False)
    for row in range(1, n):
        axes.axhline(row - 0.5, color="white", lw=1.6)
    axes.set(ylim=(n - 0.5, -0.5), xlim=(edges[0], edges[-1]))
    drawing.date_axis(axes)
    figure.colorbar(ScalarMappable(scale, colours), ax=axes, label="minutes per orbit", pad=0.015, aspect=max(8, 3 * n))
    if used:
        handles = [used[cause] for cause in _BLOCK_STYLE if cause in used]
        figure.legend(handles=handles, loc="outside lower center", ncols=len(used), fontsize=9)
    figure.suptitle(f"{n} stars, {result.n_days} days from {result.start_utc[:10]}", fontsize=11)
    return figure
