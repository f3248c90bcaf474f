"""Short tables for the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cpic_planner.models import BandConfirmation, EtcResult, EtcRow, PlanResult, RankedTarget, RankResult
from cpic_planner.report.names import full_name, pretty_name
from cpic_planner.report.numbers import MISSING, count_text, decimals, duration_text, significant
from cpic_planner.report.terminal import Column, print_note, text_table
from cpic_planner.report.words import STATUS_SYMBOLS, library_text, reason_text, status_text

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["print_etc", "print_plan", "print_rank"]

_NAME_LENGTH = 18


def _name(identifier: str) -> str:
    name = pretty_name(identifier)
    return name if len(name) <= _NAME_LENGTH else f"{name[: _NAME_LENGTH - 1]}…"


def _ratio(value: float | None) -> str:
    """A flux ratio in the compact form of terminals."""
    return MISSING if value is None else f"{value:.2e}"


def _status(status: str, reason: str) -> str:
    """Symbol and the short reason; the symbols are explained below the table."""
    return f"{STATUS_SYMBOLS.get(status, '')} {reason.replace('_', ' ') or status_text(status)}".strip()


def _symbols(console: Console, statuses: list[str]) -> None:
    """Explain the symbols of a table."""
    used = [status for status in STATUS_SYMBOLS if status in statuses]
    if used and used != ["ok"]:
        print_note(console, "   ".join(f"{STATUS_SYMBOLS[status]} {status_text(status)}" for status in used))


def _frames(item: RankedTarget | BandConfirmation | EtcRow) -> str:
    if item.exposure_s is None or item.n_frames is None:
        return MISSING
    return f"{item.n_frames} × {significant(item.exposure_s)}"


def print_rank(rank: RankResult, console: Console, limit: int = 20) -> None:
    """Print the first ``limit`` rows of a ranking, and what its numbers refer to."""
    columns = [
        Column("#"),
        Column("star", False),
        Column("V mag"),
        Column("dist pc", True, 3),
        Column("band", False),
        Column("sep ″", True, 2),
        Column("contrast", True, 1),
        Column("frames × s", True, 4),
        Column("gain", True, 5),
        Column("wall", True, 6),
        Column("SNR", True, 2),
        Column("margin"),
        Column("status", False),
    ]
    rows = [
        [
            str(row.rank),
            _name(row.name),
            decimals(row.v_mag, 2),
            decimals(row.distance_pc, 2),
            row.band,
            decimals(row.separation_arcsec, 3),
            _ratio(row.contrast),
            _frames(row),
            significant(row.em_gain),
            duration_text(row.time_s),
            significant(row.snr),
            significant(row.detection_margin),
            _status(row.status, row.reason),
        ]
        for row in rank.targets[:limit]
    ]
    shown = min(limit, len(rank.targets))
    console.print(
        text_table(console, f"Ranking: first {shown} of {count_text(len(rank.targets))} stars", columns, rows)
    )
    _symbols(console, [row.status for row in rank.targets[:limit]])
    counts = ", ".join(f"{count} {'ok' if key == 'ok' else reason_text(key)}" for key, count in rank.counts.items())
    planet = rank.reference_planet
    print_note(console, f"Outcomes: {counts}.")
    print_note(
        console,
        f"Reference planet: {planet.radius_rjup:g} R_J, phase {planet.phase_deg:g} deg, {planet.albedo} albedo, "
        f"{planet.position}; wall time up to {duration_text(rank.time_s)} per target and band.",
    )
    print_note(
        console,
        f"Margin = significance / threshold; threshold keeps the false-alarm probability of {rank.sigma:g} sigma. "
        f"Reference frames: {library_text(rank.reference_library)}.",
    )
    print_note(console, f"Stars: {rank.sample}. {rank.catalogue}")


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
            name = _name(target.name) if number == 0 else ""
            chosen = "→ " if item.band == target.chosen_band else "  "
            rows.append(
                [
                    name,
                    chosen + item.band,
                    decimals(item.separation_arcsec, 3),
                    _frames(item),
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
    _symbols(console, [item.status for target in plan.targets for item in target.bands if item.status != "ok"])
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
        return _status(item.status, item.reason)
    symbol = STATUS_SYMBOLS["ok"] if item.detected else STATUS_SYMBOLS["unreachable"]
    return f"{symbol} {item.verdict}".strip()


_QUESTION = {
    "exposure_time": "wall time for the SNR",
    "signal_to_noise": "SNR in the time",
    "contrast_limit": "contrast limit",
}


def print_etc(result: EtcResult, console: Console) -> None:
    """Print the answers of the exposure-time calculator for one target."""
    columns = [
        Column("band", False),
        Column("answer"),
        Column("sep ″", True, 1),
        Column("contrast", True, 3),
        Column("frames × s", True, 1),
        Column("gain", True, 2),
        Column("wall", True, 5),
        Column("SNR", True, 3),
        Column("signif", True, 4),
        Column("thresh", True, 4),
        Column("status", False),
    ]
    rows = [
        [
            ("→ " if row.band == result.best_band else "  ") + row.band,
            _answer(row),
            decimals(row.separation_arcsec, 3),
            _ratio(row.contrast),
            _frames(row),
            significant(row.em_gain),
            duration_text(row.time_s),
            significant(row.snr),
            significant(row.significance),
            significant(row.threshold),
            _status(row.status, row.reason),
        ]
        for row in result.answers
    ]
    asked = " / ".join(dict.fromkeys(_QUESTION[row.question] for row in result.answers))
    star = f"{full_name(result.target, result.hip)}: V {result.v_mag:.2f} mag, {significant(result.distance_pc, 4)} pc"
    head = f"{star}; {asked}"
    console.print(text_table(console, head, columns, rows))
    _symbols(console, [row.status for row in result.answers])
    for text in dict.fromkeys(row.message for row in result.answers if row.message):
        print_note(console, f"{', '.join(row.band for row in result.answers if row.message == text)}: {text}.")
    if result.reference_planet is not None:
        planet = result.reference_planet
        print_note(
            console,
            f"Reference planet: {planet.radius_rjup:g} R_J, phase {planet.phase_deg:g} deg, {planet.albedo} albedo.",
        )
    flags = list(dict.fromkeys(flag for row in result.answers for flag in row.flags))
    if flags:
        print_note(console, f"Flags: {', '.join(flags)}.")
    if result.note:
        print_note(console, f"Note: {result.note}")
    print_note(console, "Positions on the diagonal of a quadrant. Wall time counts readouts and reference frames.")


def _answer(row: EtcRow) -> str:
    if row.value is None:
        return MISSING
    if row.unit == "s":
        return duration_text(row.value)
    return _ratio(row.value) if row.unit == "contrast" else significant(row.value)
