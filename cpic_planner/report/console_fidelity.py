"""Print how firm answers are (stated errors, checks in images), and speed against accuracy."""

from __future__ import annotations

from operator import itemgetter
from typing import TYPE_CHECKING

from cpic_planner import results
from cpic_planner.report.cells import (
    Cells,
    explain_symbols,
    print_note,
    print_plain,
    print_table,
    row_cells,
    status_cell,
)
from cpic_planner.report.console_etc import answer_name
from cpic_planner.report.numbers import MISSING, significant
from cpic_planner.report.summary import error_text

if TYPE_CHECKING:
    from rich.console import Console


_DRAWS = {"sums": "sums of frames", "frames": "every frame, every effect"}


def print_fidelity(result: results.EtcResult, console: Console) -> None:
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
        error = error_text(item.predicted_error or {})
        print_note(console, f"{answer_name(row)}: closed forms are enough; their stated error is at most {error}.")
    for text in dict.fromkeys(item.message for item, _ in rows if item.message):
        names = ", ".join(answer_name(row) for item, row in rows if item.message == text)
        print_note(console, f"{names}: {text}.")
    if not rows:
        print_note(console, "No answer has frames that could be checked in images.")


def _print_checks(
    record: results.EtcFidelity, rows: list[tuple[results.AnswerFidelity, results.EtcAnswer]], console: Console
) -> None:
    cells = [
        *row_cells(results.EtcAnswer, "band separation_arcsec/1 contrast/4", of=itemgetter(1)),
        *row_cells(
            results.ImageCheck,
            "predicted_snr snr etc_ratio flux_ratio/2 light_ratio/3 realisations/1 n_found/5 agrees",
            of=lambda pair: pair[0].images,
            predicted_snr=lambda pair: significant(pair[0].images.predicted_snr if pair[0].images else pair[1].snr),
            n_found=_detections,
            agrees=Cells("", _agreement, right=False),
        ),
    ]
    drawn = [item.images.draw for item, _ in rows if item.images is not None]
    how = " and ".join(_DRAWS[name] for name in dict.fromkeys(drawn))
    dial = f"tolerance {record.tolerance:g}" if record.tolerance else record.fidelity
    print_table(console, f"Checked in images ({dial}{f': {how}' if how else ''})", cells, rows)
    explain_symbols(console, [item.status for item, _ in rows])
    if not drawn:
        return
    print_note(
        console,
        "Errors of one sigma. SNR: closed form of what the images hold; of images: mean flux over its measured error; "
        "pred/rec: predicted over recovered SNR, that of the closed form over that of images. "
        "Light: planet's light in images without noise over that of the closed form. Found: by a blind search.",
    )


def _detections(pair: tuple[results.AnswerFidelity, results.EtcAnswer]) -> str:
    images = pair[0].images
    return MISSING if images is None else f"{images.n_found} of {images.realisations}"


def _agreement(pair: tuple[results.AnswerFidelity, results.EtcAnswer]) -> str:
    item = pair[0]
    if item.images is None:
        return status_cell(item.status, item.reason)
    return "agrees" if item.images.agrees else "differs"


def print_tradeoff(result: results.TradeoffResult, console: Console) -> None:
    """Print one table a scene: every way with its time, memory and errors."""

    def way(row: results.TradeoffRow) -> str:
        title = row.title if row.machine == result.machine.key else f"{row.title} (another machine)"
        return title if row.status == "ok" else f"{title}: {row.status}, {row.reason.replace('_', ' ')}"

    cells = row_cells(
        results.TradeoffRow,
        "title wall_s cpu_s peak_memory_mb/2 flux_error/1 snr_error",
        flux_error=lambda row: _error(row.flux_error, None),
        snr_error=lambda row: _error(row.snr_error, row.snr_uncertainty),
        title=Cells("way", way, right=False),
    )
    for scene in result.scenes:
        rows = [row for row in result.rows if row.scene == scene.name]
        title = f"{scene.title} ({scene.name}, {scene.band})"
        print_table(console, title, cells, rows)
    for name, ratio in result.speed_ups.items():
        print_plain(console, f"{name}: one call of the closed forms is {ratio:.0f} times faster than the reference")


def _error(value: float | None, uncertainty: float | None) -> str:
    if value is None:
        return ""
    return f"{100 * value:+.2g} %" if not uncertainty else f"{100 * value:+.2g} ± {100 * uncertainty:.1g} %"
