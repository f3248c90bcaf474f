"""The plan on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from cpic_planner.models import BandConfirmation, ConfirmResult, PlanResult
from cpic_planner.registry.libraries import LIBRARIES
from cpic_planner.report.modelled import dial_text, modelled_sentence
from cpic_planner.report.names import pretty_name
from cpic_planner.report.numbers import MISSING, count_text, decimals, duration_text, significant
from cpic_planner.report.summary import calibration_sentence, overrides_sentence
from cpic_planner.report.terminal import (
    Column,
    explain_symbols,
    frames_text,
    print_note,
    print_plain,
    short_name,
    status_cell,
    text_table,
)
from cpic_planner.report.words import STATUS_SYMBOLS, plus_minus

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["MEASURED_COLUMNS", "measured_cells", "print_comparison", "print_modelled", "print_plan"]

MEASURED_COLUMNS = [
    Column("sep ″", True, 3),
    Column("frames × s", True, 4),
    Column("gain", True, 6),
    Column("wall", True, 5),
    Column("SNR pred", True, 1),
    Column("SNR rec", True, 1),
    Column("pred/rec"),
    Column("found"),
    Column("outcome", False),
]
"""What is shown of each measurement; the rest is in the files."""


def print_plan(plan: PlanResult, console: Console) -> None:
    """Print the confirmed targets of a plan, band by band, their verdicts, and how the ETC stands."""
    rows = []
    for target in plan.targets:
        for number, item in enumerate(target.bands):
            name = short_name(target.name) if number == 0 else ""
            chosen = "→ " if item.band == target.chosen_band else "  "
            rows.append([name, chosen + item.band, *measured_cells(item)])
    count = len(plan.targets)
    title = f"Confirmed by simulated images: {count} target{'s' * (count != 1)}, {plan.realisations} realisations each"
    console.print(text_table(console, title, [Column("target", False), Column("band", False), *MEASURED_COLUMNS], rows))
    explain_symbols(console, [item.status for target in plan.targets for item in target.bands if item.status != "ok"])
    for target in plan.targets:
        print_plain(console, f"{pretty_name(target.name)}: {plus_minus(target.verdict)}")
    print_comparison(plan, console)
    print_modelled([band for target in plan.targets for band in target.bands], console)
    found = LIBRARIES[plan.reference_library].found
    print_note(
        console,
        "→ marks the band to observe in. SNR of one observation, planet noise included: predicted, and recovered with "
        f"the error of its mean; found: realisations in which {found}; seen at its place: "
        "significant at the known place, but not found blind.",
    )
    print_note(
        console,
        f"{count_text(plan.n_ranked)} stars ranked. Seed {plan.seed}, {dial_text(plan)}, configuration "
        f"{plan.config_hash}.",
    )


def measured_cells(item: BandConfirmation) -> list[str]:
    """Cells of one measurement under `MEASURED_COLUMNS`."""
    ratio = MISSING if item.etc_ratio is None else f"{item.etc_ratio:.2f} ± {item.etc_ratio_error or 0.0:.2f}"
    error = "" if item.recovered_snr_error is None else f" ± {significant(item.recovered_snr_error, 2)}"
    return [
        decimals(item.separation_arcsec, 3),
        frames_text(item),
        significant(item.em_gain),
        duration_text(item.time_s),
        significant(item.predicted_snr),
        significant(item.recovered_snr) + error,
        ratio,
        MISSING if item.n_detected is None else f"{item.n_detected}/{item.realisations}",
        _outcome(item),
    ]


def print_comparison(result: PlanResult | ConfirmResult, console: Console, *, measured: bool = True) -> None:
    """Print what is altered in the images, and how prediction and images compare where planets were measured."""
    altered = overrides_sentence(result)
    if altered:
        print_plain(console, altered, bold=True)
    if measured:
        print_plain(console, calibration_sentence(result), bold=True)


def print_modelled(bands: Sequence[BandConfirmation], console: Console) -> None:
    """Print how the images were drawn, what that is predicted to cost, and where a tier is not good enough."""
    for text in dict.fromkeys(f"{band.band}: {band.message}" for band in bands if band.status == "invalid"):
        print_plain(console, text)
    made = modelled_sentence(bands)
    if made:
        print_note(console, made)


def _outcome(item: BandConfirmation) -> str:
    if item.status != "ok":
        return status_cell(item.status, item.reason)
    if item.detected:
        return f"{STATUS_SYMBOLS['ok']} confirmed"
    at_place = 2 * (item.n_significant or 0) >= (item.realisations or 1)
    return f"{STATUS_SYMBOLS['unreachable']} {'seen at its place' if at_place else 'not found'}"
