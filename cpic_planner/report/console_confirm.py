"""A confirmed scene on the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cpic_planner.models import (
    AlbedoRecord,
    BandConfirmation,
    CandidateRecord,
    ConfirmResult,
    PositionRecord,
    SearchRecord,
)
from cpic_planner.registry.libraries import LIBRARIES
from cpic_planner.report.cells import Cells, row_cells
from cpic_planner.report.console import MEASURED, found_cell, outcome_cell, print_comparison, print_modelled
from cpic_planner.report.modelled import dial_text
from cpic_planner.report.numbers import MISSING, decimals, significant
from cpic_planner.report.terminal import print_note, print_plain, print_table
from cpic_planner.report.words import ALBEDO_STATUS

if TYPE_CHECKING:
    from rich.console import Console

_SHOWN = 5


def print_confirm(result: ConfirmResult, console: Console) -> None:
    """Print measurements, blind candidates, positions and albedo fits of a scene, and how the ETC stands.

    Parameters
    ----------
    result : ConfirmResult
    console : Console
    """
    several = len({item.planet for item in result.bands}) > 1
    cells = row_cells(
        BandConfirmation,
        ("planet " if several else "") + "band " + MEASURED.format(more=" true_contrast/7 recovered_contrast/2"),
        n_detected=found_cell,
        recovered_contrast=_recovered,
        outcome=Cells("outcome", outcome_cell, right=False),
    )
    rows = sorted(result.bands, key=lambda item: item.planet) if several else result.bands
    count = result.realisations
    title = f"{result.scene}: confirmed by simulated images, {count} realisation{'s' * (count != 1)} a band"
    if not rows:
        print_plain(console, f"{result.scene}: no planet, {LIBRARIES[result.reference_library].searched}", bold=True)
    else:
        print_table(console, title, cells, rows, explained=True)
    for item in result.bands:
        if item.audit is not None:
            print_plain(
                console,
                f"{item.planet}, {item.band}, frame by frame with every effect: SNR "
                f"{significant(item.audit.recovered_snr)} ({significant(item.audit.predicted_snr)} predicted), "
                f"contrast off by {decimals(item.audit.deviation_sigma, 1)} of its errors, "
                f"{'found' if item.audit.detected else 'not found'}",
            )
    if result.searches:
        _print_searches(result.searches, console)
    for position in result.positions:
        print_plain(console, position_text(position))
    for albedo in result.albedos:
        print_plain(console, albedo_text(albedo))
    print_comparison(result, console, measured=bool(rows))
    print_modelled(result.bands, console)
    print_note(console, f"Seed {result.seed}, {dial_text(result)}, configuration {result.config_hash}.")


def _recovered(item: BandConfirmation) -> str:
    if item.recovered_contrast is None or item.contrast_error is None:
        return MISSING
    return f"{item.recovered_contrast:.2e} ± {item.contrast_error:.0e}"


def _print_searches(searches: list[SearchRecord], console: Console) -> None:
    rows: list[tuple[SearchRecord, CandidateRecord | None]] = []
    for search in searches:
        named = sorted(search.candidates, key=lambda item: -item.snr)
        shown = [item for number, item in enumerate(named) if item.detected or item.planet or number == 0][:_SHOWN]
        rows += [(search, item) for item in shown] or [(search, None)]
    cells = [
        *row_cells(SearchRecord, "band frames/2 em_gain/2", of=lambda row: row[0]),
        *row_cells(CandidateRecord, "separation_arcsec pa_deg snr threshold/1", of=lambda row: row[1]),
        Cells("is", lambda row: _kind(row[1]), right=False),
    ]
    elsewhere = sum(search.false_detections for search in searches)
    total = sum(search.realisations for search in searches)
    print_table(console, "What the blind search names, first realisation", cells, rows, last_width=30)
    word = "detection that is" if elsewhere == 1 else "detections that are"
    print_note(console, f"{elsewhere} {word} no planet of the scene, in {total} searches.")


def _kind(item: CandidateRecord | None) -> str:
    if item is None:
        return "nothing"
    return item.planet or ("no planet of the scene" if item.detected else "below the threshold")


def position_text(position: PositionRecord) -> str:
    """Return a measured position beside the true one."""
    return (
        f"{position.planet}: {position.separation_arcsec:.4f} ± {position.separation_error_arcsec:.4f}″ at PA "
        f"{position.pa_deg:.2f} ± {position.pa_error_deg:.2f}° ({', '.join(position.bands)}); true "
        f"{position.true_separation_arcsec:.4f}″, {position.true_pa_deg:.2f}°"
    )


def albedo_text(albedo: AlbedoRecord) -> str:
    """Return what contrasts say of metallicity and clouds."""
    mh, fsed = albedo.log10_mh_interval, albedo.log10_fsed_interval
    return (
        f"{albedo.planet}: log10 M/H {decimals(mh[0], 2)} to {decimals(mh[1], 2)}, log10 f_sed {decimals(fsed[0], 2)} "
        f"to {decimals(fsed[1], 2)} (68 %), correlation {decimals(albedo.correlation, 2)}, from "
        f"{', '.join(albedo.bands)}: {ALBEDO_STATUS[albedo.status]}"
    )
