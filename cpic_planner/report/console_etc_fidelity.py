"""How firm answers of the exposure-time calculator are, on the terminal: stated errors, and checks in images."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cpic_planner.models import AnswerFidelity, EtcFidelity, EtcResult, EtcRow
from cpic_planner.report.modelled import error_text
from cpic_planner.report.numbers import MISSING, significant
from cpic_planner.report.terminal import (
    Column,
    explain_symbols,
    print_note,
    ratio_text,
    status_cell,
    text_table,
)

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["print_fidelity"]

_DRAWS = {"sums": "sums of frames", "frames": "every frame, every effect"}


def print_fidelity(result: EtcResult, console: Console) -> None:
    """Print what images say of the answers, and the stated error of those that need none; nothing for ``quick``."""
    record = result.fidelity
    if record is None or record.fidelity == "quick":
        return
    console.print()
    rows = [(item, result.answers[item.answer]) for item in record.answers]
    alone = [pair for pair in rows if pair[0].fidelity == "quick" and pair[0].status == "ok"]
    asked = [pair for pair in rows if pair not in alone]
    if asked:
        _print_checks(record, asked, console)
    for item, row in alone:
        print_note(
            console,
            f"{_name(row)}: closed forms are enough; their stated error is at most "
            f"{error_text(item.predicted_error or {})}.",
        )
    for text in dict.fromkeys(item.message for item, _ in rows if item.message):
        names = ", ".join(_name(row) for item, row in rows if item.message == text)
        print_note(console, f"{names}: {text}.")
    if not rows:
        print_note(console, "No answer has frames that could be checked in images.")


def _print_checks(record: EtcFidelity, rows: list[tuple[AnswerFidelity, EtcRow]], console: Console) -> None:
    columns = [
        Column("band", False),
        Column("sep ″", True, 1),
        Column("contrast", True, 4),
        Column("SNR"),
        Column("of images"),
        Column("images / SNR"),
        Column("flux / true", True, 2),
        Column("light", True, 3),
        Column("runs", True, 1),
        Column("found", True, 5),
        Column("", False),
    ]
    cells = [
        [row.band, f"{row.separation_arcsec:.3f}", ratio_text(row.contrast), *_check(item, row)] for item, row in rows
    ]
    drawn = [item.images.draw for item, _ in rows if item.images is not None]
    how = " and ".join(_DRAWS[name] for name in dict.fromkeys(drawn))
    dial = f"tolerance {record.tolerance:g}" if record.tolerance else record.fidelity
    console.print(text_table(console, f"Checked in images ({dial}{f': {how}' if how else ''})", columns, cells))
    explain_symbols(console, [item.status for item, _ in rows])
    if not drawn:
        return
    print_note(
        console,
        "Errors of one sigma. SNR: closed form of what the images hold; of images: mean flux over its measured error. "
        "Light: planet's light in images without noise over that of the closed form. Found: by a blind search.",
    )


def _check(item: AnswerFidelity, row: EtcRow) -> list[str]:
    images = item.images
    if images is None:
        return [significant(row.snr), *[MISSING] * 6, status_cell(item.status, item.reason)]
    return [
        significant(images.predicted_snr),
        f"{significant(images.snr)} ± {significant(images.snr_error, 2)}",
        f"{images.snr_ratio:.2f} ± {images.snr_ratio_error:.2f}",
        f"{images.flux_ratio:.3f} ± {images.flux_ratio_error:.3f}",
        f"{images.light_ratio:.4f}",
        str(images.realisations),
        f"{images.n_found} of {images.realisations}",
        "agrees" if images.agrees else "differs",
    ]


def _name(row: EtcRow) -> str:
    return f"{row.band} at {row.separation_arcsec:.3f}″"
