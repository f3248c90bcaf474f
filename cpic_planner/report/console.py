"""The plan on the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cpic_planner.models import BandConfirmation, PlanResult
from cpic_planner.report.numbers import count_text, decimals, duration_text, significant
from cpic_planner.report.terminal import (
    Column,
    explain_symbols,
    frames_text,
    print_note,
    short_name,
    status_cell,
    text_table,
)
from cpic_planner.report.words import STATUS_SYMBOLS

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["print_plan"]


def print_plan(plan: PlanResult, console: Console) -> None:
    """Print the confirmed targets of a plan, band by band, and the calibration."""
    columns = [
        Column("target", False),
        Column("band", False),
        Column("sep ″", True, 3),
        Column("frames × s", True, 1),
        Column("gain", True, 4),
        Column("wall", True, 5),
        Column("SNR pred"),
        Column("SNR rec"),
        Column("signif", True, 2),
        Column("thresh", True, 2),
        Column("outcome", False),
    ]
    rows = []
    for target in plan.targets:
        for number, item in enumerate(target.bands):
            name = short_name(target.name) if number == 0 else ""
            chosen = "→ " if item.band == target.chosen_band else "  "
            rows.append(
                [
                    name,
                    chosen + item.band,
                    decimals(item.separation_arcsec, 3),
                    frames_text(item),
                    significant(item.em_gain),
                    duration_text(item.time_s),
                    significant(item.predicted_snr),
                    significant(item.recovered_snr),
                    significant(item.recovered_significance),
                    significant(item.threshold),
                    _outcome(item),
                ]
            )
    console.print(
        text_table(
            console,
            f"Confirmed by simulated images: {len(plan.targets)} target{'s' * (len(plan.targets) != 1)}",
            columns,
            rows,
        )
    )
    explain_symbols(console, [item.status for target in plan.targets for item in target.bands if item.status != "ok"])
    ratio, error = plan.calibration.get("ratio"), plan.calibration.get("error")
    if ratio is not None and error is not None:
        print_note(
            console,
            f"Recovered / predicted SNR: {ratio:.2f} ± {error:.2f} over {plan.calibration.get('n_bands')} bands.",
        )
    print_note(
        console, "→ marks the band to observe in. SNR: planet noise included; significance and threshold: detection."
    )
    print_note(
        console,
        f"{count_text(plan.n_ranked)} stars ranked. Seed {plan.seed}, fidelity {plan.fidelity}, configuration "
        f"{plan.config_hash}.",
    )


def _outcome(item: BandConfirmation) -> str:
    if item.status != "ok":
        return status_cell(item.status, item.reason)
    symbol = STATUS_SYMBOLS["ok"] if item.detected else STATUS_SYMBOLS["unreachable"]
    return f"{symbol} {item.verdict}".strip()
