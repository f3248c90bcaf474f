"""The plan on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from operator import itemgetter
from typing import TYPE_CHECKING

from cpic_planner.models import BandConfirmation, ConfirmResult, PlanResult
from cpic_planner.registry.libraries import LIBRARIES
from cpic_planner.report.cells import Cells, row_cells, status_cell
from cpic_planner.report.modelled import dial_text, modelled_sentence
from cpic_planner.report.names import pretty_name, short_name
from cpic_planner.report.numbers import MISSING, count_text
from cpic_planner.report.summary import calibration_sentence, overrides_sentence
from cpic_planner.report.terminal import explain_symbols, print_note, print_plain, print_table
from cpic_planner.report.words import STATUS_SYMBOLS, plus_minus

if TYPE_CHECKING:
    from rich.console import Console

MEASURED = (
    "separation_arcsec/3 frames/4 em_gain/6 time_s/5 predicted_snr/1 recovered_snr/1 etc_ratio n_detected{more} outcome"
)
"""What is shown of each measurement; the rest is in the files."""


def print_plan(plan: PlanResult, console: Console) -> None:
    """Print the confirmed targets of a plan, band by band, their verdicts, and how the ETC stands.

    Parameters
    ----------
    plan : PlanResult
    console : Console
    """
    rows = [
        (
            short_name(target.name) if number == 0 else "",
            ("→ " if item.band == target.chosen_band else "  ") + item.band,
            item,
        )
        for target in plan.targets
        for number, item in enumerate(target.bands)
    ]
    cells = [
        Cells("target", itemgetter(0), right=False),
        Cells("band", itemgetter(1), right=False),
        *row_cells(
            BandConfirmation,
            MEASURED.format(more=""),
            of=itemgetter(2),
            n_detected=lambda row: found_cell(row[2]),
            outcome=Cells("outcome", lambda row: outcome_cell(row[2]), right=False),
        ),
    ]
    count = len(plan.targets)
    title = f"Confirmed by simulated images: {count} target{'s' * (count != 1)}, {plan.realisations} realisations each"
    print_table(console, title, cells, rows)
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


def found_cell(item: BandConfirmation) -> str:
    """Return in how many of the realisations the planet is found."""
    return MISSING if item.n_detected is None else f"{item.n_detected}/{item.realisations}"


def print_comparison(result: PlanResult | ConfirmResult, console: Console, *, measured: bool = True) -> None:
    """Print what is altered in the images, and how prediction and images compare where planets were measured."""
    altered = overrides_sentence(result)
    if altered:
        print_plain(console, altered, bold=True)
    if measured:
        print_plain(console, calibration_sentence(result), bold=True)


def print_modelled(bands: Sequence[BandConfirmation], console: Console) -> None:
    """Print how the images were drawn, what that is predicted to cost, and where a tier is not good enough.

    Parameters
    ----------
    bands : sequence of BandConfirmation
        What was measured in each band.
    console : Console
    """
    for text in dict.fromkeys(f"{band.band}: {band.message}" for band in bands if band.status == "invalid"):
        print_plain(console, text)
    made = modelled_sentence(bands)
    if made:
        print_note(console, made)


def outcome_cell(item: BandConfirmation) -> str:
    """Return what the images say of a planet, with the symbol of its status."""
    if item.status != "ok":
        return status_cell(item.status, item.reason)
    if item.detected:
        return f"{STATUS_SYMBOLS['ok']} confirmed"
    at_place = 2 * (item.n_significant or 0) >= (item.realisations or 1)
    return f"{STATUS_SYMBOLS['unreachable']} {'seen at its place' if at_place else 'not found'}"
