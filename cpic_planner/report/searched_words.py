"""Contrast curves and operating characteristics in words, and on the terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from cpic_planner import results
from cpic_planner.report.cells import print_note, print_table, row_cells
from cpic_planner.report.console_etc import flag_lines
from cpic_planner.report.numbers import duration_text, share_text, significant, star_text
from cpic_planner.report.words import status_text

if TYPE_CHECKING:
    from rich.console import Console

_HALF_STEPS = 2.0
"""Levels of a search that the terminal shows, in each unit."""


def curve_sentences(result: results.CurveResult) -> list[str]:
    """Return what contrast curves say, in sentences."""
    said = []
    for band in result.bands:
        rows = [row for row in result.points if row.band == band.band and row.contrast_limit_blind is not None]
        best = min(rows, key=lambda row: row.contrast_limit_blind or math.inf, default=None)
        if best is None:
            said.append(f"{band.band}: no limit: {band.message or status_text(band.status)}.")
            continue
        assert best.contrast_limit_blind is not None  # as the rows are chosen
        said.append(
            f"{band.band}: half of the planets of contrast {best.contrast_limit_blind:.1e} at "
            f"{best.separation_arcsec:.2f} arcsec are found blind in {_programme_text(band)}."
        )
        if band.images_message:
            said.append(f"No images in {band.band}: {band.images_message}.")
        ratios = [
            row.measured_limit / row.contrast_limit_threshold
            for row in rows
            if row.measured_limit is not None and row.contrast_limit_threshold
        ]
        if ratios:
            mean = math.exp(sum(map(math.log, ratios)) / len(ratios))
            said.append(
                f"In {band.images} simulated images the limit at the threshold is {significant(mean, 2)} times the "
                f"predicted one, mean of {len(ratios)} separation{'s' * (len(ratios) != 1)}."
            )
    if result.recovered:
        n, hits = (sum(getattr(row, name) for row in result.recovered) for name in ("n_injected", "n_recovered"))
        expected = sum(row.n_injected * row.predicted for row in result.recovered)
        said.append(f"Of {n} injected planets blind searches find {hits}; the law of detection expects {expected:.0f}.")
    return said


def roc_sentences(result: results.RocResult) -> list[str]:
    """Return what an operating characteristic says, in sentences."""
    said = []
    for band in result.bands:
        row = next((one for one in result.levels if one.band == band.band and one.sigma == result.sigma), None)
        if row is None or band.contrast is None or band.separation_arcsec is None:
            said.append(f"{band.band}: no answer: {band.message or status_text(band.status)}.")
            continue
        said.append(
            f"{band.band}: a planet of contrast {band.contrast:.2e} at {band.separation_arcsec:.2f} arcsec is found "
            f"blind with {share_text(row.detection_probability)} % and at its known place with "
            f"{share_text(row.detection_probability_known_place)} %, at {result.sigma:g}σ ({row.false_alarms:.1e} "
            f"false alarms a search), in {_programme_text(band)}."
        )
        if row.n_planets:
            said.append(
                f"Searches of {row.n_planets} simulated images find it in {row.n_detected}, and have {row.n_false} "
                f"false alarm{'s' * (row.n_false != 1)} in {row.n_searches} without it."
            )
        if band.images_message:
            said.append(f"No images in {band.band}: {band.images_message}.")
    return said


def _programme_text(band: results.SearchedProgramme) -> str:
    """Return a programme in words."""
    if band.time_s is None or band.visits is None:
        return "no programme"
    visits = f"{band.visits} visit{'s' * (band.visits != 1)}"
    return f"{visits}, {duration_text(band.time_s)} in all"


def print_curve(result: results.CurveResult, console: Console, *, full: bool = False) -> None:
    """Print contrast limits, recovered planets, and what they say.

    Parameters
    ----------
    result : CurveResult
    console : Console
    full : bool
        Also the programme of each band.
    """
    title = f"{star_text(result)}; contrast limits at {result.sigma:g}σ in {duration_text(result.time_s)}"
    measured = any(row.measured_limit is not None for row in result.points)
    layout = (
        "band separation_arcsec contrast_limit_blind contrast_limit_known_place/4 contrast_limit_threshold/3 "
        f"{'measured_limit/1 measured_throughput/5 ' * measured}core_throughput/7 azimuth_share/6 threshold/8 status"
    )
    cells = row_cells(results.CurveRow, layout)
    print_table(console, title, cells, result.points, explained=True, legend=True)
    if result.recovered:
        layout = (
            "band separation_arcsec contrast n_injected/2 n_recovered/1 recovered recovered_low/3 recovered_high/3 "
            "predicted"
        )
        console.print()
        print_table(console, "Injected planets", row_cells(results.RecoveredRow, layout), result.recovered, legend=True)
    if full:
        _print_programmes(results.SearchedProgramme, result.bands, console)
    _print_below(console, curve_sentences(result), flag_lines(result.bands, result.note))


def print_roc(result: results.RocResult, console: Console, *, full: bool = False) -> None:
    """Print levels of a search, its false alarms and detections, and what they say.

    Parameters
    ----------
    result : RocResult
    console : Console
    full : bool
        Also the programme of each band, and every level.
    """
    title = f"{star_text(result)}; detections and false alarms"
    images = any(row.n_searches for row in result.levels)
    counted = "n_searches/3 n_false/2 n_planets/3 n_detected/2 recovered/1 " if images else ""
    layout = (
        f"band sigma false_alarms detection_probability {counted}false_alarms_known_place/5 "
        "detection_probability_known_place/4"
    )
    rows = [row for row in result.levels if full or row.sigma == result.sigma or not row.sigma * _HALF_STEPS % 1.0]
    print_table(console, title, row_cells(results.RocRow, layout), rows, legend=True)
    if full:
        _print_programmes(results.RocProgramme, result.bands, console)
    _print_below(console, roc_sentences(result), flag_lines(result.bands, result.note))


def _print_below(console: Console, said: Sequence[str], flags: Sequence[str]) -> None:
    """Say what numbers mean, and what is to be known beside them."""
    print_note(console, *said)
    if flags:
        console.print()
        print_note(console, *flags)


def _print_programmes(
    kind: type[results.SearchedProgramme], rows: Sequence[results.SearchedProgramme], console: Console
) -> None:
    layout = "band separation_arcsec contrast visits frames em_gain visit_time_s/1 time_s resolution_elements/2"
    console.print()
    print_table(console, "Programmes", row_cells(kind, layout), rows, legend=True)
