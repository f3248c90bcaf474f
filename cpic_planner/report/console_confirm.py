"""A confirmed scene on the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cpic_planner.models import AlbedoRecord, BandConfirmation, ConfirmResult, PositionRecord, SearchRecord
from cpic_planner.registry.libraries import LIBRARIES
from cpic_planner.report.console import MEASURED_COLUMNS, measured_cells, print_comparison, print_modelled
from cpic_planner.report.modelled import dial_text
from cpic_planner.report.numbers import MISSING, decimals, significant
from cpic_planner.report.terminal import (
    Column,
    explain_symbols,
    frames_text,
    print_note,
    print_plain,
    ratio_text,
    text_table,
)
from cpic_planner.report.words import ALBEDO_STATUS

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["albedo_text", "position_text", "print_confirm"]

_SHOWN = 5


def print_confirm(result: ConfirmResult, console: Console) -> None:
    """Print measurements, blind candidates, positions and albedo fits of a scene, and how the ETC stands."""
    several = len({item.planet for item in result.bands}) > 1
    columns = [
        *([Column("planet", False)] if several else []),
        Column("band", False),
        *MEASURED_COLUMNS[:-1],
        Column("contrast true", True, 7),
        Column("recovered", True, 2),
        MEASURED_COLUMNS[-1],
    ]
    ordered = sorted(result.bands, key=lambda item: item.planet) if several else result.bands
    rows = []
    for item in ordered:
        first, last = measured_cells(item)[:-1], measured_cells(item)[-1]
        contrasts = [ratio_text(item.true_contrast), _recovered(item)]
        rows.append([*([item.planet] if several else []), item.band, *first, *contrasts, last])
    count = result.realisations
    title = f"{result.scene}: confirmed by simulated images, {count} realisation{'s' * (count != 1)} a band"
    if not rows:
        print_plain(console, f"{result.scene}: no planet, {LIBRARIES[result.reference_library].searched}", bold=True)
    else:
        console.print(text_table(console, title, columns, rows))
        explain_symbols(console, [item.status for item in result.bands if item.status != "ok"])
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
    columns = [
        Column("band", False),
        Column("frames × s", True, 2),
        Column("gain", True, 2),
        Column("sep ″"),
        Column("PA °"),
        Column("SNR"),
        Column("threshold", True, 1),
        Column("is", False),
    ]
    rows = []
    for search in searches:
        named = sorted(search.candidates, key=lambda item: -item.snr)
        shown = [item for number, item in enumerate(named) if item.detected or item.planet or number == 0][:_SHOWN]
        for item in shown:
            kind = item.planet or ("no planet of the scene" if item.detected else "below the threshold")
            rows.append(
                [
                    search.band,
                    frames_text(search),
                    significant(search.em_gain),
                    decimals(item.separation_arcsec, 3),
                    decimals(item.pa_deg, 1),
                    significant(item.snr),
                    significant(item.threshold),
                    kind,
                ]
            )
        if not shown:
            rows.append([search.band, frames_text(search), significant(search.em_gain), *[MISSING] * 4, "nothing"])
    elsewhere = sum(search.false_detections for search in searches)
    total = sum(search.realisations for search in searches)
    console.print(text_table(console, "What the blind search names, first realisation", columns, rows, last_width=30))
    word = "detection that is" if elsewhere == 1 else "detections that are"
    print_note(console, f"{elsewhere} {word} no planet of the scene, in {total} searches.")


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
