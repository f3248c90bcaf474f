"""Short tables for the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from cpic_planner.models import BandConfirmation, EtcResult, EtcRow, PlanResult, RankedTarget, RankResult
from cpic_planner.report.names import full_name, pretty_name
from cpic_planner.report.numbers import MISSING, contrast_text, count_text, decimals, duration_text, significant
from cpic_planner.report.words import STATUS_SYMBOLS, library_text, reason_text, status_text

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

__all__ = ["print_etc", "print_plan", "print_rank"]

_STYLE = {"ok": "green", "unreachable": "yellow", "saturated": "red", "outside_field": "magenta", "invalid": "red"}


class _Column(NamedTuple):
    """Header, whether numbers stand right, and the least terminal width at which the column is shown."""

    header: str
    right: bool = True
    from_width: int = 0


def _table(console: Console, title: str, columns: list[_Column], rows: list[list[str]]) -> Table:
    """Table with the columns that fit; the last one (status) always stays and may wrap."""
    from rich import box
    from rich.table import Table
    from rich.text import Text
    from rich.text import Text

    shown = [i for i, column in enumerate(columns) if console.width >= column.from_width]
    table = Table(title=Text(title, style="bold"), title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1), pad_edge=False)
    for i in shown:
        last = i == len(columns) - 1
        table.add_column(Text(columns[i].header), justify="right" if columns[i].right else "left", no_wrap=columns[i].right,
                         overflow="fold" if last else "ellipsis", vertical="top")  # fmt: skip
    for row in rows:
        table.add_row(*(_cell(row[i]) for i in shown))
    return table


def _cell(text: str) -> Text:
    """Text without markup (names may hold brackets), coloured when it starts with a status symbol."""
    from rich.text import Text

    for status, symbol in STATUS_SYMBOLS.items():
        if text.startswith(symbol):
            return Text(text, style=_STYLE[status])
    return Text(text)


def _note(console: Console, text: str) -> None:
    from rich.text import Text

    console.print(Text(text, style="dim"))


def _status(status: str, reason: str) -> str:
    head = f"{STATUS_SYMBOLS.get(status, '')} {status_text(status)}".strip()
    return f"{head}: {reason_text(reason)}" if reason else head


def _frames(item: RankedTarget | BandConfirmation | EtcRow) -> str:
    if item.exposure_s is None or item.n_frames is None:
        return MISSING
    return f"{item.n_frames} × {significant(item.exposure_s)}"


def print_rank(rank: RankResult, console: Console, limit: int = 20) -> None:
    """Print the first ``limit`` rows of a ranking, and what its numbers refer to."""
    columns = [
        _Column("#"), _Column("star", False), _Column("V mag"), _Column("dist pc", from_width=70), _Column("band", False),
        _Column("sep ″", from_width=60), _Column("contrast"), _Column("frames × s", from_width=90),
        _Column("gain", from_width=104), _Column("wall", from_width=120), _Column("SNR", from_width=60), _Column("margin"),
        _Column("status", False),
    ]  # fmt: skip
    rows = [
        [str(row.rank), pretty_name(row.name), decimals(row.v_mag, 2), decimals(row.distance_pc, 2), row.band,
         decimals(row.separation_arcsec, 3), contrast_text(row.contrast), _frames(row), significant(row.em_gain),
         duration_text(row.time_s), significant(row.snr), significant(row.detection_margin), _status(row.status, row.reason)]
        for row in rank.targets[:limit]
    ]  # fmt: skip
    shown = min(limit, len(rank.targets))
    console.print(_table(console, f"Ranking: first {shown} of {count_text(len(rank.targets))} stars", columns, rows))
    counts = ", ".join(f"{count} {'ok' if key == 'ok' else reason_text(key)}" for key, count in rank.counts.items())
    planet = rank.reference_planet
    _note(console, f"Outcomes: {counts}.")
    _note(console, f"Reference planet: {planet.radius_rjup:g} R_J, phase {planet.phase_deg:g} deg, {planet.albedo} albedo, "
          f"{planet.position}; wall time {duration_text(rank.time_s)} per target and band.")  # fmt: skip
    _note(console, f"Margin = significance / threshold; threshold keeps the false-alarm probability of {rank.sigma:g} sigma. "
          f"Reference frames: {library_text(rank.reference_library)}.")  # fmt: skip
    _note(console, f"Stars: {rank.sample}. {rank.catalogue}")


def print_plan(plan: PlanResult, console: Console) -> None:
    """Print the confirmed targets of a plan, band by band, and the calibration."""
    columns = [
        _Column("target", False), _Column("band", False), _Column("sep ″", from_width=90), _Column("frames × s"),
        _Column("gain", from_width=76), _Column("wall", from_width=100), _Column("SNR pred"), _Column("SNR rec"),
        _Column("signif", from_width=100), _Column("thresh", from_width=100), _Column("outcome", False),
    ]  # fmt: skip
    rows = []
    for target in plan.targets:
        for number, item in enumerate(target.bands):
            name = pretty_name(target.name) if number == 0 else ""
            chosen = "→ " if item.band == target.chosen_band else "  "
            rows.append([name, chosen + item.band, decimals(item.separation_arcsec, 3), _frames(item), significant(item.em_gain),
                         duration_text(item.time_s), significant(item.predicted_snr), significant(item.recovered_snr),
                         significant(item.recovered_significance), significant(item.threshold), _outcome(item)])  # fmt: skip
    console.print(_table(console, f"Confirmed by simulated images: {len(plan.targets)} targets", columns, rows))
    ratio, error = plan.calibration.get("ratio"), plan.calibration.get("error")
    if ratio is not None and error is not None:
        _note(console, f"Recovered / predicted SNR: {ratio:.2f} ± {error:.2f} over {plan.calibration.get('n_bands')} bands.")
    _note(console, "→ marks the band to observe in. SNR: planet noise included; significance and threshold: detection.")
    _note(console, f"{count_text(plan.n_ranked)} stars ranked. Seed {plan.seed}, fidelity {plan.fidelity}, configuration "
          f"{plan.config_hash}.")  # fmt: skip


def _outcome(item: BandConfirmation) -> str:
    if item.status != "ok":
        return _status(item.status, item.reason)
    symbol = STATUS_SYMBOLS["ok"] if item.detected else STATUS_SYMBOLS["unreachable"]
    return f"{symbol} {item.verdict}".strip()


_QUESTION = {"exposure_time": "wall time for the SNR", "signal_to_noise": "SNR in the time", "contrast_limit": "contrast limit"}


def print_etc(result: EtcResult, console: Console) -> None:
    """Print the answers of the exposure-time calculator for one target."""
    columns = [
        _Column("band", False), _Column("answer"), _Column("sep ″"), _Column("contrast", from_width=60),
        _Column("frames × s"), _Column("gain"), _Column("wall", from_width=90), _Column("SNR", from_width=70),
        _Column("signif", from_width=100), _Column("thresh", from_width=110), _Column("status", False),
    ]  # fmt: skip
    rows = [
        [("→ " if row.band == result.best_band else "  ") + row.band, _answer(row), decimals(row.separation_arcsec, 3),
         contrast_text(row.contrast), _frames(row), significant(row.em_gain), duration_text(row.time_s), significant(row.snr),
         significant(row.significance), significant(row.threshold), _status(row.status, row.reason)]
        for row in result.answers
    ]  # fmt: skip
    asked = " / ".join(dict.fromkeys(_QUESTION[row.question] for row in result.answers))
    head = f"{full_name(result.target, result.hip)}: V {result.v_mag:.2f} mag, {significant(result.distance_pc, 4)} pc; {asked}"
    console.print(_table(console, head, columns, rows))
    for text in dict.fromkeys(row.message for row in result.answers if row.message):
        _note(console, f"{', '.join(row.band for row in result.answers if row.message == text)}: {text}.")
    if result.reference_planet is not None:
        planet = result.reference_planet
        _note(console, f"Reference planet: {planet.radius_rjup:g} R_J, phase {planet.phase_deg:g} deg, {planet.albedo} albedo.")
    flags = list(dict.fromkeys(flag for row in result.answers for flag in row.flags))
    if flags:
        _note(console, f"Flags: {', '.join(flags)}.")
    if result.note:
        _note(console, f"Note: {result.note}")
    _note(console, "Positions on the diagonal of a quadrant. Wall time counts readouts and reference frames.")


def _answer(row: EtcRow) -> str:
    if row.value is None:
        return MISSING
    if row.unit == "s":
        return duration_text(row.value)
    return contrast_text(row.value) if row.unit == "contrast" else significant(row.value)
