"""Priorities in reports: what each star still lacks, how sure its rank is, and what the ranking hangs on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from catalogs.known_planets import FLAGS
from cpic_core import listed
from cpic_planner import results
from cpic_planner.report import document as doc, words
from cpic_planner.report.cells import Cells, print_note, print_plain, print_table, row_cells
from cpic_planner.report.drawing import Picture, literal, new_figure, save, style
from cpic_planner.report.numbers import (
    MISSING,
    contrast_text,
    count_text,
    decimals,
    duration_text,
    pretty_name,
    significant,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from rich.console import Console

TIERS = {
    1: "the reference planet is detected in the given time",
    2: "it would be in at most ten times the time, or with a tenth of the drift or more, one of the two changed",
    3: "a planet at most ten times as bright would be",
    4: "none of these",
}
"""Tiers of priority, in words."""
N_BARS, N_STARS, N_WINDOWS = 12, 25, 3
_LOW, _HIGH, _INK = "#4477aa", "#cc6677", "#222222"


def priority_blocks(
    rank: results.RankResult,
    rows: Sequence[results.RankedTarget],
    named: Callable[[results.RankedTarget], doc.Inline] = lambda row: pretty_name(row.name),
) -> Iterator[doc.Block]:
    """Yield the priorities of the first stars: a table, and what an ensemble of instruments says where one was asked.

    Parameters
    ----------
    rank : RankResult
    rows : sequence of RankedTarget
        The stars that are shown.
    named : callable
        Writes the name of a star.
    """
    ensemble = rank.ensemble
    sure = "" if ensemble is None else " p_reachable rank_median between p_rank_le_10"
    columns = doc.row_columns(
        results.RankedTarget,
        "rank name:row,star tier detection_time_s detection_visits limit drift brighter expected_planets "
        "expected_planets_unconditional"
        f"{sure}",
        name=named,
        limit=Cells("", lambda row: words.LIMITED_BY[row.limited_by][0] if row.limited_by else MISSING, label="limit"),
        drift=Cells("", lambda row: _factor(row.required_drift_factor), label="drift factor", right=True),
        brighter=Cells("", lambda row: _factor(row.required_contrast_factor), label="planet factor", right=True),
        between=Cells("", _between, label="5 to 95 %", right=True),
    )
    tiers = "; ".join(f"{tier}: {text}" for tier, text in TIERS.items())
    caption = (
        f"What a detection of the reference planet by a search of the strategy asks for. Tier {tiers}. Detection time: "
        "the least of all visits in any band, whatever was given; drift factor, planet factor: the largest "
        "drift, or the least brightness of the planet, over that assumed, with which the given time is enough, each "
        "changed alone. Expected planets are of one observation: those that nothing known excludes, and all."
    )
    yield doc.table("Priorities", caption, columns, rows)
    if ensemble is not None:
        yield doc.Figure(ensemble_picture(rank), "How sure the order is, and what changes it", "ensemble")


def sensitivity_blocks(sensitivity: results.SensitivityResult) -> Iterator[doc.Block]:
    """Yield how the ranking depends on assumptions."""
    columns = doc.row_columns(
        results.SensitivityRow,
        "text:row,text n_ok kept_first kept kendall_tau_b n_compared largest_fall largest_fall_ranks best",
        kept_first=Cells("", lambda row: str(row.kept_first), label=f"kept of first {sensitivity.first}"),
        kept=Cells("", lambda row: str(row.kept), label=f"kept of first {sensitivity.top}"),
        largest_fall=lambda row: pretty_name(row.largest_fall),
        best=lambda row: pretty_name(row.best),
    )
    caption = (
        f"The same {count_text(sensitivity.n_ranked)} stars ranked under other assumptions, one at a time. Nominally "
        f"{count_text(sensitivity.n_ok)} reference planets are detected. Kept of first "
        f"{sensitivity.first}, of first {sensitivity.top}: how many of the nominal first stars stay there. "
        f"Tau: {words.tau_text(sensitivity.top)}."
    )
    yield doc.Paragraph(sensitivity.statement)
    yield doc.table("Sensitivity of the ranking", caption, columns, sensitivity.rows)


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


def _factor(value: float | None) -> str:
    return MISSING if value is None else f"×{significant(value, 2)}"


def _between(row: results.RankedTarget) -> str:
    return MISSING if row.rank_p05 is None else f"{row.rank_p05:.0f} to {row.rank_p95:.0f}"


def print_ensemble(ensemble: results.EnsembleRecord, shown: Sequence[results.RankedTarget], console: Console) -> None:
    """Print what becomes of the shown stars under an ensemble of instruments, and what changes it."""
    cells = row_cells(
        results.RankedTarget,
        "rank name tier rank_median between p_rank_le_10 p_reachable detection_time_s/3 detection_visits/2 "
        "limited_by/1",
        between=Cells("5 to 95 %", lambda row: f"{row.rank_p05:.0f} to {row.rank_p95:.0f}", True),
    )
    title = f"The same stars under {count_text(ensemble.n_instruments)} instruments that fit what is known"
    print_table(console, title, cells, shown)
    bars = [
        *row_cells(results.EnsembleBar, "label"),
        Cells("values, 5 to 95 %", lambda bar: f"{bar.low} to {bar.high}", right=False),
        Cells("planets", lambda bar: f"{significant(bar.planets_low, 2)} to {significant(bar.planets_high, 2)}"),
        Cells("stars detected", lambda bar: f"{bar.n_reachable_low} to {bar.n_reachable_high}"),
        Cells("tau", lambda bar: f"{decimals(bar.tau_low, 2)} to {decimals(bar.tau_high, 2)}", gives_way=1),
    ]
    title = "What the expected planets of one observation of every star hang on, one number at a time"
    print_table(console, title, bars, ensemble.bars[:N_BARS])
    print_plain(console, ensemble.statement)
    print_note(
        console,
        "Values, or factors on the instrument asked, that 5 and 95 % of what each number may be are below; planets, "
        "stars whose reference planet is detected, and Kendall's tau of the order of the first ten at these two; with "
        f"all numbers as asked {ensemble.planets_nominal:.2g} planets, {ensemble.n_reachable_nominal} stars. "
        f"All {count_text(ensemble.n_instruments)} instruments rank {count_text(ensemble.n_stars)} stars; of the "
        "others none has its reference planet detected under the few that rank all. Ensemble "
        f"{ensemble.name}, seed {ensemble.seed}.",
    )


def ensemble_figure(rank: results.RankResult, n_stars: int = N_STARS) -> Figure:
    """Draw the ranks of the first stars over an ensemble, and what the number of planets hangs on.

    Parameters
    ----------
    rank : RankResult
        With an ensemble.
    n_stars : int
        How many stars are drawn, at most 100.
    """
    ensemble = rank.ensemble
    assert ensemble is not None
    rows, bars = rank.targets[: min(n_stars, 100)], ensemble.bars[:N_BARS]
    with style():
        figure = new_figure(max(4.2, 1.4 + 0.24 * max(len(rows), len(bars))))
        left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.05))
        _draw_ranks(left, rows)
        _draw_bars(right, bars, ensemble.planets_nominal)
        title = f"{count_text(ensemble.n_instruments)} instruments that fit what is known"
        figure.suptitle(literal(f"{title}; up to {duration_text(rank.time_s)} per star and band"), fontsize=11)
        figure.draw_without_rendering()
    return figure


def ensemble_picture(rank: results.RankResult) -> Picture:
    """Return that figure for a page."""
    ensemble = rank.ensemble
    assert ensemble is not None
    first = ", ".join(pretty_name(row.name) for row in rank.targets[:5])
    return save(
        ensemble_figure(rank),
        alt=f"Left: median rank and its 5 to 95 % interval of the first stars ({first}, ...). Right: bars of the "
        f"expected planets for low and high values of {len(ensemble.bars[:N_BARS])} uncertain numbers, the longest "
        f"for {ensemble.bars[0].label}.",
        caption="Left: the median rank of each star over the ensemble, and between which ranks it is under 90 % of the "
        "instruments; the share beside it is how many detect the reference planet in the given time. Right: expected "
        "planets of one observation of every star with one number at the value that 5 % (blue) or 95 % (red) of its "
        "law are below, all others as assumed; the line is the instrument as assumed.",
    )


def _draw_ranks(axes: Axes, rows: Sequence[results.RankedTarget]) -> None:
    for at, row in enumerate(rows):
        if row.rank_median is None or row.rank_p05 is None or row.rank_p95 is None:
            continue
        axes.plot([row.rank_p05, row.rank_p95], [at, at], color=_LOW, lw=2.2, solid_capstyle="butt")
        axes.plot([row.rank_median], [at], "o", color=_INK, ms=4.5)
        text = f" {100 * (row.p_reachable or 0.0):.0f} %"
        axes.annotate(text, (row.rank_p95, at), fontsize=7.5, va="center", color=_INK, annotation_clip=False)
    axes.set_yticks(range(len(rows)), [literal(f"{row.rank}  {pretty_name(row.name)}") for row in rows])
    last = max((row.rank_p95 or 1.0 for row in rows), default=1.0)
    axes.set(xlabel="rank (and share that reaches it)", ylim=(len(rows) - 0.4, -0.6), xlim=(0, 1.18 * last + 1))
    axes.grid(visible=True, axis="x")


def _draw_bars(axes: Axes, bars: Sequence[results.EnsembleBar], nominal: float) -> None:
    for at, bar in enumerate(bars):
        for value, text, colour in ((bar.planets_low, bar.low, _LOW), (bar.planets_high, bar.high, _HIGH)):
            axes.barh(at, value - nominal, left=nominal, height=0.6, color=colour)
            side = "left" if value >= nominal else "right"
            gap = " " if side == "left" else ""
            axes.annotate(
                literal(f"{gap}{text}{'' if gap else ' '}"), (value, at), fontsize=7.0, va="center", ha=side, color=_INK
            )
    axes.axvline(nominal, color=_INK, lw=1.0)
    axes.set_yticks(range(len(bars)), [literal(bar.label) for bar in bars])
    ends = [value for bar in bars for value in (bar.planets_low, bar.planets_high)] or [nominal]
    width = max(max(ends) - min(ends), 1e-12)
    axes.set(xlabel="planets of one observation each", ylim=(len(bars) - 0.4, -0.6))
    axes.set_xlim(min(ends) - 0.22 * width, max(ends) + 0.22 * width)
    axes.grid(visible=True, axis="x")
