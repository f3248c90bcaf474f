"""Tables of simulated sequences and of what a check of products found."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cpic_planner.models import CheckResult, PlannedSequenceRow, SimulatedSequence, SimulationEstimate, SimulationResult
from cpic_planner.report.modelled import modelled_groups
from cpic_planner.report.numbers import count_text, duration_text, significant
from cpic_planner.report.terminal import Column, print_note, print_plain, text_table

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["print_check", "print_planned", "print_simulation", "size_text"]

_FEW = 3
_NAME_LENGTH = 18


def size_text(size_bytes: float) -> str:
    """Return a size in the unit that people would use: kB, MB or GB."""
    for unit, scale in (("GB", 1e9), ("MB", 1e6)):
        if size_bytes >= scale:
            return f"{significant(size_bytes / scale)} {unit}"
    return f"{significant(size_bytes / 1e3)} kB"


def _short(name: str) -> str:
    return name if len(name) <= _NAME_LENGTH else f"{name[: _NAME_LENGTH - 1]}…"


def print_simulation(result: SimulationResult, out: Path, console: Console, *, limit: int = 40) -> None:
    """Print what the frames of each sequence hold, and where its files are."""
    columns = [
        Column("OBSID", False),
        Column("kind", False),
        Column("target", False, 2),
        Column("band", False),
        Column("frames × s"),
        Column("gain"),
        Column("ADU"),
        Column("sat. px"),
        Column("cosmics", True, 1),
        Column("size"),
    ]
    rows = [
        [
            item.obsid,
            _kind(item),
            _short(item.target),
            item.band,
            f"{item.n_frames} × {_exposure(item.exposure_s)}",
            f"{item.em_gain:g}",
            f"{item.adu_min}–{item.adu_max}",
            count_text(item.saturated_pixels),
            count_text(item.cosmic_rays),
            size_text(item.size_bytes),
        ]
        for item in result.sequences[:limit]
    ]
    console.print(text_table(console, _title(result.name, len(result.sequences)), columns, rows))
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
        [(f"{_short(item.target)} {item.band}", item.modelled) for item in sequences if item.modelled is not None]
    ):
        gone = [row for row in group.rows if row.effect.decision == "skipped" and row.effect.size]
        columns = [Column("left out", False), Column("predicted size"), Column("", False)]
        rows = [[row.effect.effect, row.size, row.where] for row in gone]
        print_plain(console, f"Left out of {_shortened(group.members)} for the tolerance:", bold=True)
        console.print(text_table(console, "", columns, rows, last_width=console.width))
        print_note(console, f"Predicted error: {group.errors}.")
        # All of a frame is kept here: what is said of its region does not apply.
        print_note(console, f"Optics: {group.knobs.split('; ', 1)[1]}.")


def _shortened(members: str) -> str:
    names = members.split(", ")
    more = f" and {len(names) - _FEW} more" if len(names) > _FEW else ""
    return f"{', '.join(names[:_FEW])}{more}"


def _title(name: str, count: int) -> str:
    return f"{name}: {count_text(count)} sequence{'s' * (count != 1)}"


def _kind(item: PlannedSequenceRow) -> str:
    return f"{item.kind} {item.role}" if item.role == "reference" else item.kind


def _exposure(exposure_s: float) -> str:
    return f"{exposure_s:g}"


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
    columns = [
        Column("OBSID", False),
        Column("kind", False),
        Column("target", False, 2),
        Column("band", False),
        Column("frames × s"),
        Column("gain", True, 1),
        Column("begins (UTC)", False, 3),
    ]
    rows = [
        [
            item.obsid,
            _kind(item),
            _short(item.target),
            item.band,
            f"{item.n_frames} × {_exposure(item.exposure_s)}",
            f"{item.em_gain:g}",
            item.start_utc[:19],
        ]
        for item in plan.sequences[:limit]
    ]
    console.print(text_table(console, _title(plan.name, plan.n_sequences), columns, rows, last_width=19))
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
    """Print what a check found, file by file."""
    columns = [Column("HDU"), Column("keyword", False), Column("severity", False), Column("finding", False)]
    for path in dict.fromkeys(item.path for item in result.findings):
        rows = [
            ["" if item.hdu is None else str(item.hdu), item.keyword, item.severity, item.message]
            for item in result.findings
            if item.path == path
        ]
        console.print(path, markup=False, soft_wrap=True)
        console.print(text_table(console, "", columns, rows, last_width=console.width))
    count = f"{count_text(result.n_files)} Level-0 file{'s' * (result.n_files != 1)} checked"
    errors, warnings = (
        f"{number} {word}{'s' * (number != 1)}"
        for number, word in ((result.n_errors, "error"), (result.n_warnings, "warning"))
    )
    console.print(f"{count}: {f'{errors}, {warnings}' if result.findings else 'nothing wrong'}", markup=False)
