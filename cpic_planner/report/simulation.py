"""Simulated sequences, how images are made, checks, values of instruments and columns of tables on the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cpic_core import listed
from cpic_planner import results
from cpic_planner.report import words
from cpic_planner.report.cells import Cells, print_note, print_plain, print_table, row_cells
from cpic_planner.report.words import count_text, counted, shortened
from cpic_planner.results import ModellingRecord
from simulator.knobs import Quantity

if TYPE_CHECKING:
    from rich.console import Console


_WIDE = 60
_FEW = 3
_OPTION = {"stars": "--catalog", "planets": "--known-planets"}
"""Option that takes a table of each kind."""


_COARSER = ("wavelength_nodes", "pixel_nodes", "precision", "drift_epochs", "pupil_samples")


@dataclass(frozen=True)
class ModelledRow:
    """One effect of a table.

    Attributes
    ----------
    effect : EffectRecord
        With its largest size.
    where : str
        Image set in which it is that large; empty where all are alike.
    size : str
        In per cent.
    word : str
        What became of it.
    """

    effect: results.EffectRecord
    where: str
    size: str
    word: str

    @property
    def order(self) -> float:
        """What effects are sorted by; those without a size stand before what is not there."""
        size = self.effect.size
        return size if size else 0.5 * words.LEAST_SIZE * words.LEAST_SIZE if size is None else 0.0


@dataclass(frozen=True)
class ModelledGroup:
    """Image sets that are made alike.

    Attributes
    ----------
    title : str
        How they are made.
    names : tuple of str
        Their names.
    knobs, errors : str
        Settings of the optics; largest predicted errors, and what was asked for.
    rows : tuple of ModelledRow
        Largest size first.
    """

    title: str
    names: tuple[str, ...]
    knobs: str
    errors: str
    rows: tuple[ModelledRow, ...]


def modelled_groups(named: Sequence[tuple[str, ModellingRecord]]) -> list[ModelledGroup]:
    """Return one table for every distinct way to make images.

    Parameters
    ----------
    named : sequence of (str, ModellingRecord)
        Name of each image set, and how it was made. Sets that differ in nothing but sizes share a table, which shows
        the largest.
    """
    groups: dict[tuple[object, ...], list[tuple[str, ModellingRecord]]] = {}
    for name, record in named:
        kept = tuple((row.effect, row.decision) for row in record.effects)
        content = (record.draw, record.region, record.epochs, record.knobs.content_hash, kept)
        groups.setdefault(content, []).append((name, record))
    return [_group(members) for members in groups.values()]


def _group(members: list[tuple[str, ModellingRecord]]) -> ModelledGroup:
    record, knobs, ways = members[0][1], members[0][1].knobs, words.WORDS["draws"][members[0][1].draw]
    about = {"wavelengths": counted(knobs.wavelength_nodes, "wavelength"), "epochs": counted(record.epochs, "epoch")}
    about["region"] = words.WORDS["regions"][record.region]
    rows = []
    for effects in zip(*(record.effects for _, record in members), strict=True):
        sizes = ["" if effect.size is None else words.error_percent(effect.size) for effect in effects]
        each = [
            ModelledRow(effect, name, size, _decision(effect))
            for (name, _), effect, size in zip(members, effects, sizes, strict=True)
        ]
        largest, alike = max(each, key=lambda row: row.order), len({effect.size for effect in effects}) == 1
        rows.append(ModelledRow(largest.effect, "" if alike else largest.where, largest.size, largest.word))
    asked = f" (asked: at most {words.error_text(record.tolerance)})" if any(record.tolerance.values()) else ""
    return ModelledGroup(
        title=ways[:1].upper() + ways[1:],
        names=tuple(dict.fromkeys(name for name, _ in members)),
        knobs=words.text("texts.modelled_knobs", knobs=knobs, **about),
        errors=f"{words.error_text(largest_errors([item for _, item in members]))}{asked}",
        rows=tuple(sorted(rows, key=lambda row: -row.order)),
    )


def _decision(row: results.EffectRecord) -> str:
    if row.decision == "kept":
        return "kept"
    return "coarser" if row.key in _COARSER else "as sums" if row.key == "summed_frames" else "left out"


def largest_errors(records: Iterable[ModellingRecord]) -> dict[Quantity, float | None]:
    """Return the largest predicted error of each quantity; None where one is not known."""
    largest: dict[Quantity, float | None] = {}
    for record in records:
        for name, value in record.predicted_error.items():
            before = largest.get(name, 0.0)
            largest[name] = None if value is None or before is None else max(value, before)
    return largest


def print_columns(result: results.ColumnsResult, console: Console) -> None:
    """Print what the columns of a file are taken for, and how many of its rows can be used."""

    def unit(row: results.ColumnTaken) -> str:
        return f"{row.unit} (assumed)" if row.unit_assumed else row.unit or words.MISSING

    def remark(row: results.ColumnTaken) -> str:
        unknown = "heading not known" if row.reason == "not known" else row.reason
        return row.convention if row.quantity else unknown

    def first(row: results.ReasonLeftOut) -> str:
        return f"row {row.row}{f' ({row.name})' * bool(row.name)}: {row.value}"

    def is_shown(note: str) -> bool:
        """Tell whether a remark says what the tables show."""
        said = note.removeprefix(f"{result.file}: ")
        return said.startswith("columns not used") or " left out: " in said or " taken as missing: " in said

    taken: dict[str, Any] = {"quantity": lambda row: row.quantity or "not used", "unit": unit, "reason": remark}
    left_out: dict[str, Any] = {"first": Cells("first", first, right=False, label="first of them")}
    for table in result.tables:
        rows = f"{table.n_usable} of {table.n_rows} row{'s' * (table.n_rows != 1)} can be used"
        title = f"{result.file} as a table of {table.taken_as} ({_OPTION[table.taken_as]}): {rows}"
        cells = row_cells(results.ColumnTaken, "heading quantity unit reason", **taken)
        print_table(console, title, cells, table.columns, last_width=_WIDE)
        if table.left_out:
            cells = row_cells(results.ReasonLeftOut, "done count column first reason", **left_out)
            print_table(console, "Left out, by reason", cells, table.left_out, last_width=_WIDE)
        print_plain(console, *(note for note in table.notes if not is_shown(note)))
    if len(result.tables) > 1:
        print_note(console, "The file can be read both as stars and as planets: the option decides.")
    if any(row.unit_assumed for table in result.tables for row in table.columns):
        print_note(console, "(assumed): the file names no unit, and this one is taken.")


def _sequence_cells(
    kind: type[results.Result], sequences: Sequence[results.PlannedSequenceRow], more: str
) -> list[Cells]:
    """Return the columns of sequences, with the visit where there are programmes."""
    visit = " visit" if any(item.visit for item in sequences) else ""
    special: dict[str, Any] = {
        "kind": lambda item: f"{item.kind} {item.role}" if item.role == "reference" else item.kind,
        "target": lambda item: shortened(item.target),
        "frames": Cells(
            "frames × s", lambda item: f"{item.n_frames} × {item.exposure_s:g}", fields=("n_frames", "exposure_s")
        ),
        "adu": Cells("ADU", lambda item: f"{item.adu_min}–{item.adu_max}", fields=("adu_min", "adu_max")),
        "start_utc": lambda item: item.start_utc[:19],
    }
    return row_cells(kind, f"obsid kind{visit} target/2 band frames {more}", **special)


def print_simulation(result: results.SimulationResult, out: Path, console: Console, *, limit: int = 40) -> None:
    """Print what the frames of each sequence hold, and where its files are."""
    sequences = result.sequences
    more = "em_gain adu saturated_pixels cosmic_rays/1 size_bytes"
    cells = _sequence_cells(results.SimulatedSequence, sequences, more)
    print_table(console, f"{result.name}: {counted(len(sequences), 'sequence')}", cells, sequences[:limit])
    if len(sequences) > limit:
        print_note(console, f"... and {len(sequences) - limit} more: see {out / 'simulation.json'}")
    note = "Sat. px: most pixels of one frame that a limit cut off. Cosmics: particles in all frames together."
    print_note(console, note)
    for programme in result.programmes:
        _print_programme(programme, out, console, limit)
    _print_left_out(sequences, console)
    files = [str(out / item.file) for item in sequences]
    if len(sequences) > _FEW:
        folders = dict.fromkeys(str((out / item.file).parent) for item in sequences)
        files = [f"files in {listed([*folders], _FEW)}"]
    print_plain(console, *files, wraps=False)


def _print_programme(programme: results.SimulatedProgramme, out: Path, console: Console, limit: int) -> None:
    """Print when the visits of a programme are, and where its list is."""
    title = f"{programme.target}: {counted(programme.visits, 'science visit')}"
    if programme.reference_visits:
        title += f" and {counted(programme.reference_visits, 'reference visit')}"
        title += f" of {programme.reference}" if programme.reference != programme.target else ""
    visits: dict[tuple[str, str, float, float], list[results.VisitRow]] = {}
    for row in programme.sequences:
        visits.setdefault((row.folder, row.band, row.exposure_s, row.em_gain), []).append(row)
    cells = row_cells(
        results.VisitRow,
        "folder band/2 start_utc n_frames window/1 roll_deg/3",
        of=itemgetter(0),
        start_utc=lambda rows: rows[0].start_utc[:19],
        n_frames=Cells("frames × s", lambda rows: f"{sum(row.n_frames for row in rows)} × {rows[0].exposure_s:g}"),
        window=Cells("windows", lambda rows: str(len(rows))),
    )
    print_table(console, title, cells, list(visits.values())[:limit])
    more = len(visits) - limit
    scheme = f" with the scheme {programme.reference_scheme} of references" if programme.reference_visits else ""
    said = [f"{count_text(more)} more are not shown."] * (more > 0)
    said += [f"The programme spans {words.decimals(programme.span_days, 2)} days{scheme}."]
    print_note(console, " ".join([*said, f"The visits are listed in {out / programme.file}."]))


def _print_left_out(sequences: Sequence[results.PlannedSequenceRow], console: Console) -> None:
    """Print what tolerances leave out, one table for each distinct content, with the largest sizes."""
    cells = [
        Cells("left out", lambda row: row.effect.effect, right=False),
        Cells("predicted size", lambda row: row.size),
        Cells("", lambda row: row.where, right=False),
    ]
    modelled = [(f"{shortened(item.target)} {item.band}", item.modelled) for item in sequences if item.modelled]
    for group in modelled_groups(modelled):
        gone = [row for row in group.rows if row.effect.decision == "skipped" and row.effect.size]
        print_plain(console, f"Left out of {listed(group.names, _FEW)} for the tolerance:", bold=True)
        print_table(console, "", cells, gone, last_width=console.width)
        # All of a frame is kept here: what is said of its region does not apply.
        print_note(console, f"Predicted error: {group.errors}.", f"Optics: {group.knobs.split('; ', 1)[1]}.")


def print_planned(plan: results.SimulationEstimate, console: Console, *, limit: int = 40) -> None:
    """Print the sequences of a simulation that has not been run, and what it would plan."""
    cells = _sequence_cells(results.PlannedSequenceRow, plan.sequences, "em_gain/1 start_utc/3")
    title = f"{plan.name}: {counted(plan.n_sequences, 'sequence')}"
    print_table(console, title, cells, plan.sequences[:limit], last_width=19)
    if plan.n_sequences > limit:
        print_note(console, f"... and {plan.n_sequences - limit} more")
    _print_left_out(plan.sequences, console)
    time, disk = words.duration_text(plan.wall_s), words.size_text(1e6 * plan.disk_mb)
    memory = f"{words.significant(plan.memory_mb)} MB memory a worker"
    cost = f"about {time} with {plan.workers} worker(s), {memory}, {disk} disk"
    print_plain(console, f"{count_text(plan.n_frames)} frames, {cost}", wraps=False)


def print_check(result: results.CheckResult, console: Console) -> None:
    """Print what a check found, file by file."""
    layout, unit = "hdu keyword severity message", lambda item: "" if item.hdu is None else str(item.hdu)
    cells = row_cells(results.FindingRecord, layout, hdu=unit)
    for path in dict.fromkeys(item.path for item in result.findings):
        print_plain(console, path, wraps=False)
        rows = [item for item in result.findings if item.path == path]
        print_table(console, "", cells, rows, last_width=console.width)
    severities = f"{counted(result.n_errors, 'error')}, {counted(result.n_warnings, 'warning')}"
    said = severities if result.findings else "nothing wrong"
    print_plain(console, f"{counted(result.n_files, 'Level-0 file')} checked: {said}")


def print_instrument(result: results.InstrumentResult, layout: str, console: Console) -> None:
    """Print values of an instrument, in the columns that ``layout`` names."""
    print_table(console, result.title, row_cells(results.InstrumentValue, layout), result.values, last_width=60)
