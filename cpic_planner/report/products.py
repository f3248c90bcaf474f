"""Tables of simulated sequences and of what a check of products found."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cpic_planner.models import (
    CheckResult,
    FindingRecord,
    PlannedSequenceRow,
    SimulatedSequence,
    SimulationEstimate,
    SimulationResult,
)
from cpic_planner.report.cells import Cells, row_cells
from cpic_planner.report.modelled import modelled_groups
from cpic_planner.report.names import shortened
from cpic_planner.report.numbers import count_text, duration_text, significant, size_text
from cpic_planner.report.terminal import print_note, print_plain, print_table

if TYPE_CHECKING:
    from rich.console import Console

_FEW = 3


_SEQUENCE = "obsid kind target/2 band frames"
_OWN: dict[str, Any] = {
    "kind": lambda item: f"{item.kind} {item.role}" if item.role == "reference" else item.kind,
    "target": lambda item: shortened(item.target),
    "frames": Cells("frames × s", lambda item: f"{item.n_frames} × {item.exposure_s:g}"),
}


def print_simulation(result: SimulationResult, out: Path, console: Console, *, limit: int = 40) -> None:
    """Print what the frames of each sequence hold, and where its files are."""
    cells = row_cells(
        SimulatedSequence,
        f"{_SEQUENCE} em_gain adu saturated_pixels cosmic_rays/1 size_bytes",
        adu=Cells("ADU", lambda item: f"{item.adu_min}–{item.adu_max}"),
        **_OWN,
    )
    print_table(console, _title(result.name, len(result.sequences)), cells, result.sequences[:limit])
    if len(result.sequences) > limit:
        print_note(console, f"... and {len(result.sequences) - limit} more: see {out / 'simulation.json'}")
    print_note(
        console, "Sat. px: most pixels of one frame that a limit cut off. Cosmics: particles in all frames together."
    )
    _print_left_out(result.sequences, console)
    for line in _places(result.sequences, out):
        console.print(line, markup=False, soft_wrap=True)


def _print_left_out(sequences: Sequence[PlannedSequenceRow], console: Console) -> None:
    """Print what tolerances leave out, one table for each distinct content, with the largest sizes."""
    for group in modelled_groups(
        [(f"{shortened(item.target)} {item.band}", item.modelled) for item in sequences if item.modelled is not None]
    ):
        gone = [row for row in group.rows if row.effect.decision == "skipped" and row.effect.size]
        cells = [
            Cells("left out", lambda row: row.effect.effect, right=False),
            Cells("predicted size", lambda row: row.size),
            Cells("", lambda row: row.where, right=False),
        ]
        print_plain(console, f"Left out of {_shortened(group.members)} for the tolerance:", bold=True)
        print_table(console, "", cells, gone, last_width=console.width)
        print_note(console, f"Predicted error: {group.errors}.")
        # All of a frame is kept here: what is said of its region does not apply.
        print_note(console, f"Optics: {group.knobs.split('; ', 1)[1]}.")


def _shortened(members: str) -> str:
    names = members.split(", ")
    more = f" and {len(names) - _FEW} more" if len(names) > _FEW else ""
    return f"{', '.join(names[:_FEW])}{more}"


def _title(name: str, count: int) -> str:
    return f"{name}: {count_text(count)} sequence{'s' * (count != 1)}"


def _places(sequences: Sequence[SimulatedSequence], out: Path) -> list[str]:
    """Files where there are few, folders where there are many."""
    if len(sequences) <= _FEW:
        return [str(out / item.file) for item in sequences]
    folders = dict.fromkeys(str((out / item.file).parent) for item in sequences)
    listed = list(folders)[:_FEW]
    more = f" and {len(folders) - _FEW} more" if len(folders) > _FEW else ""
    return [f"files in {', '.join(listed)}{more}"]


def print_planned(plan: SimulationEstimate, console: Console, *, limit: int = 40) -> None:
    """Print the sequences of a simulation that has not been run, and what it would plan."""
    cells = row_cells(
        PlannedSequenceRow,
        f"{_SEQUENCE} em_gain/1 start_utc/3",
        start_utc=lambda item: item.start_utc[:19],
        **_OWN,
    )
    print_table(console, _title(plan.name, plan.n_sequences), cells, plan.sequences[:limit], last_width=19)
    if plan.n_sequences > limit:
        print_note(console, f"... and {plan.n_sequences - limit} more")
    _print_left_out(plan.sequences, console)
    console.print(
        f"{count_text(plan.n_frames)} frames, about {duration_text(plan.wall_s)} with {plan.workers} worker(s), "
        f"{significant(plan.memory_mb)} MB memory a worker, {size_text(1e6 * plan.disk_mb)} disk",
        markup=False,
        soft_wrap=True,
    )


def print_check(result: CheckResult, console: Console) -> None:
    """Print what a check found, file by file.

    Parameters
    ----------
    result : CheckResult
    console : Console
    """
    cells = row_cells(
        FindingRecord, "hdu keyword severity message", hdu=lambda item: "" if item.hdu is None else str(item.hdu)
    )
    for path in dict.fromkeys(item.path for item in result.findings):
        console.print(path, markup=False, soft_wrap=True)
        print_table(
            console, "", cells, [item for item in result.findings if item.path == path], last_width=console.width
        )
    count = f"{count_text(result.n_files)} Level-0 file{'s' * (result.n_files != 1)} checked"
    errors, warnings = (
        f"{number} {word}{'s' * (number != 1)}"
        for number, word in ((result.n_errors, "error"), (result.n_warnings, "warning"))
    )
    console.print(f"{count}: {f'{errors}, {warnings}' if result.findings else 'nothing wrong'}", markup=False)
