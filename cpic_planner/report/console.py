"""Short tables for the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from cpic_planner.models import BandConfirmation, EtcResult, EtcRow, PlanResult, RankedTarget, RankResult
from cpic_planner.report.names import full_name, pretty_name
from cpic_planner.report.numbers import MISSING, count_text, decimals, duration_text, significant
from cpic_planner.report.words import STATUS_SYMBOLS, library_text, reason_text, status_text

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

__all__ = ["print_etc", "print_plan", "print_rank"]

_STYLE = {"ok": "green", "unreachable": "yellow", "saturated": "red", "outside_field": "magenta", "invalid": "red"}


class _Column(NamedTuple):
    """Header, side, and how soon the column gives way on a narrow terminal (0: never; the highest goes first)."""

    header: str
    right: bool = True
    gives_way: int = 0


_GAP = 2
_LAST_COLUMN = 18
_NAME_LENGTH = 18


def _table(console: Console, title: str, columns: list[_Column], rows: list[list[str]]) -> Table:
    """Table of the columns that fit; the last one (status) always stays and may wrap."""
    from rich import box
    from rich.cells import cell_len
    from rich.table import Table
    from rich.text import Text

    widths = [max([cell_len(c.header), *(cell_len(row[i]) for row in rows)]) + _GAP for i, c in enumerate(columns)]
    widths[-1] = min(widths[-1], _LAST_COLUMN + _GAP)
    shown = list(range(len(columns)))
    for i in sorted(shown, key=lambda i: -columns[i].gives_way):
        if sum(widths[j] for j in shown) > console.width and columns[i].gives_way > 0:
            shown.remove(i)
    table = Table(
        title=Text(_fit(console, title), style="bold"),
        title_justify="left",
        box=box.SIMPLE_HEAD,
        padding=(0, _GAP - 1, 0, 0),
        pad_edge=False,
        show_edge=False,
    )
    for i in shown:
        last = i == len(columns) - 1
        table.add_column(
            Text(_fit(console, columns[i].header)),
            justify="right" if columns[i].right else "left",
            no_wrap=not last,
            overflow="fold" if last else "ellipsis",
            vertical="top",
        )
    for row in rows:
        table.add_row(*(_cell(console, row[i]) for i in shown))
    return table


def _name(identifier: str) -> str:
    name = pretty_name(identifier)
    return name if len(name) <= _NAME_LENGTH else f"{name[: _NAME_LENGTH - 1]}…"


def _ratio(value: float | None) -> str:
    """A flux ratio in the compact form of terminals."""
    return MISSING if value is None else f"{value:.2e}"


def _fit(console: Console, text: str) -> str:
    """What the terminal's encoding can show; anything else becomes a question mark instead of an error."""
    return text.encode(console.encoding, "replace").decode(console.encoding)


def _cell(console: Console, text: str) -> Text:
    """Text without markup (names may hold brackets), coloured when it starts with a status symbol."""
    from rich.text import Text

    for status, symbol in STATUS_SYMBOLS.items():
        if text.startswith(symbol):
            return Text(_fit(console, text), style=_STYLE[status])
    return Text(_fit(console, text))


def _note(console: Console, text: str) -> None:
    from rich.text import Text

    console.print(Text(_fit(console, text), style="dim"))


def _status(status: str, reason: str) -> str:
    """Symbol and the short reason; the symbols are explained below the table."""
    return f"{STATUS_SYMBOLS.get(status, '')} {reason.replace('_', ' ') or status_text(status)}".strip()


def _symbols(console: Console, statuses: list[str]) -> None:
    """Explain the symbols of a table."""
    used = [status for status in STATUS_SYMBOLS if status in statuses]
    if used and used != ["ok"]:
        _note(console, "   ".join(f"{STATUS_SYMBOLS[status]} {status_text(status)}" for status in used))


def _frames(item: RankedTarget | BandConfirmation | EtcRow) -> str:
    if item.exposure_s is None or item.n_frames is None:
        return MISSING
    return f"{item.n_frames} × {significant(item.exposure_s)}"


def print_rank(rank: RankResult, console: Console, limit: int = 20) -> None:
    """Print the first ``limit`` rows of a ranking, and what its numbers refer to."""
    columns = [
        _Column("#"),
        _Column("star", False),
        _Column("V mag"),
        _Column("dist pc", True, 3),
        _Column("band", False),
        _Column("sep ″", True, 2),
        _Column("contrast", True, 1),
        _Column("frames × s", True, 4),
        _Column("gain", True, 5),
        _Column("wall", True, 6),
        _Column("SNR", True, 2),
        _Column("margin"),
        _Column("status", False),
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
    console.print(_table(console, f"Ranking: first {shown} of {count_text(len(rank.targets))} stars", columns, rows))
    _symbols(console, [row.status for row in rank.targets[:limit]])
    counts = ", ".join(f"{count} {'ok' if key == 'ok' else reason_text(key)}" for key, count in rank.counts.items())
    planet = rank.reference_planet
    _note(console, f"Outcomes: {counts}.")
    _note(
        console,
        f"Reference planet: {planet.radius_rjup:g} R_J, phase {planet.phase_deg:g} deg, {planet.albedo} albedo, "
        f"{planet.position}; wall time up to {duration_text(rank.time_s)} per target and band.",
    )
    _note(
        console,
        f"Margin = significance / threshold; threshold keeps the false-alarm probability of {rank.sigma:g} sigma. "
        f"Reference frames: {library_text(rank.reference_library)}.",
    )
    _note(console, f"Stars: {rank.sample}. {rank.catalogue}")


def print_plan(plan: PlanResult, console: Console) -> None:
    """Print the confirmed targets of a plan, band by band, and the calibration."""
    columns = [
        _Column("target", False),
        _Column("band", False),
        _Column("sep ″", True, 3),
        _Column("frames × s", True, 1),
        _Column("gain", True, 4),
        _Column("wall", True, 5),
        _Column("SNR pred"),
        _Column("SNR rec"),
        _Column("signif", True, 2),
        _Column("thresh", True, 2),
        _Column("outcome", False),
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
        _table(
            console,
            f"Confirmed by simulated images: {len(plan.targets)} target{'s' * (len(plan.targets) != 1)}",
            columns,
            rows,
        )
    )
    _symbols(console, [item.status for target in plan.targets for item in target.bands if item.status != "ok"])
    ratio, error = plan.calibration.get("ratio"), plan.calibration.get("error")
    if ratio is not None and error is not None:
        _note(
            console,
            f"Recovered / predicted SNR: {ratio:.2f} ± {error:.2f} over {plan.calibration.get('n_bands')} bands.",
        )
    _note(console, "→ marks the band to observe in. SNR: planet noise included; significance and threshold: detection.")
    _note(
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
        _Column("band", False),
        _Column("answer"),
        _Column("sep ″", True, 1),
        _Column("contrast", True, 3),
        _Column("frames × s", True, 1),
        _Column("gain", True, 2),
        _Column("wall", True, 5),
        _Column("SNR", True, 3),
        _Column("signif", True, 4),
        _Column("thresh", True, 4),
        _Column("status", False),
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
    console.print(_table(console, head, columns, rows))
    _symbols(console, [row.status for row in result.answers])
    for text in dict.fromkeys(row.message for row in result.answers if row.message):
        _note(console, f"{', '.join(row.band for row in result.answers if row.message == text)}: {text}.")
    if result.reference_planet is not None:
        planet = result.reference_planet
        _note(
            console,
            f"Reference planet: {planet.radius_rjup:g} R_J, phase {planet.phase_deg:g} deg, {planet.albedo} albedo.",
        )
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
    return _ratio(row.value) if row.unit == "contrast" else significant(row.value)
