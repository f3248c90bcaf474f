"""Say how images are made; print simulated sequences, checks, values of instruments and columns of tables."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any

from cpic_core import Record, listed
from cpic_planner import results
from cpic_planner.report import document as doc, words
from cpic_planner.report.words import count_text, counted, shortened
from cpic_planner.results import ModellingRecord
from simulator.knobs import Quantity

_WIDE, _WIDEST = 60, 1000
"""Widths of last columns that hold sentences."""
_FEW, _MOST = 3, 40
_OPTION = {"stars": "--catalog", "planets": "--known-planets"}
"""Option that takes a table of each kind."""


_COARSER = ("wavelength_nodes", "pixel_nodes", "precision", "drift_epochs", "pupil_samples")


class EffectRow(Record):
    """One effect in several image sets.

    Attributes
    ----------
    effect : EffectRecord
        With its largest size.
    where : str
        Image set in which it is that large; empty where all are alike.
    decisions : Counter
        What became of it, and in how many of them.
    """

    effect: results.EffectRecord
    where: str
    decisions: Counter[str]


def effect_rows(named: Sequence[tuple[str, ModellingRecord]]) -> list[EffectRow]:
    """Return every effect once, the largest first; those without a size stand before what is not there.

    Parameters
    ----------
    named : sequence of (str, ModellingRecord)
        Name of each image set, and how it was made.
    """

    def order(item: tuple[str, results.EffectRecord]) -> float:
        size = item[1].size
        return 0.5 * words.LEAST_SIZE**2 if size is None else size

    every: dict[str, list[tuple[str, results.EffectRecord]]] = {}
    for name, record in named:
        for effect in record.effects:
            every.setdefault(effect.effect, []).append((name, effect))
    rows = []
    for found in sorted(every.values(), key=lambda found: -max(map(order, found))):
        where, largest = max(found, key=order)
        alike = len({effect.size for _, effect in found}) == 1
        rows.append(EffectRow(largest, "" if alike else where, Counter(_decision(effect) for _, effect in found)))
    return rows


def _decision(row: results.EffectRecord) -> str:
    if row.decision == "kept":
        return "kept"
    return "coarser" if row.key in _COARSER else "as sums" if row.key == "summed_frames" else "left out"


def _size(row: EffectRow) -> str:
    return words.MISSING if row.effect.size is None else words.error_percent(row.effect.size)


def ways_texts(named: Sequence[tuple[str, ModellingRecord]]) -> list[tuple[str, str]]:
    """Return every distinct way to make images, and for which of them it is, with settings and predicted errors."""
    ways: dict[tuple[object, ...], list[tuple[str, ModellingRecord]]] = {}
    for name, record in named:
        content = (record.draw, record.region, record.epochs, record.knobs.content_hash)
        ways.setdefault(content, []).append((name, record))
    texts = []
    for members in ways.values():
        record, knobs = members[0][1], members[0][1].knobs
        about = {
            "wavelengths": counted(knobs.wavelength_nodes, "wavelength"),
            "epochs": counted(record.epochs, "epoch"),
        }
        about["region"] = words.WORDS["regions"][record.region]
        made = words.text("texts.modelled_knobs", knobs=knobs, **about)
        errors = words.error_text(largest_errors([item for _, item in members]))
        asked = f" (asked: at most {words.error_text(record.tolerance)})" if any(record.tolerance.values()) else ""
        names = ", ".join(dict.fromkeys(name for name, _ in members))
        said = f"{names}. {made[:1].upper()}{made[1:]}. Predicted error beside the reference: {errors}{asked}."
        way = words.WORDS["draws"][record.draw]
        texts.append((way[:1].upper() + way[1:], said))
    return texts


def modelled_blocks(named: Sequence[tuple[str, ModellingRecord]]) -> Iterator[doc.Block]:
    """Yield how images were made, each distinct way in a paragraph, and a folded table of all effects."""

    def decision(row: EffectRow) -> doc.Inline:
        """Return what became of an effect; where that differs between images, in how many."""
        kept = "ok" if row.effect.decision == "kept" else "unreachable"
        others = ", ".join(f"{word} in {count}" for word, count in row.decisions.items())
        several = len(row.decisions) > 1
        return doc.lines(doc.badge(kept, _decision(row.effect)), doc.small(others if several else ""))

    if not named:
        yield doc.Paragraph("No image was made.")
        return
    yield from (doc.Paragraph([doc.strong(way), ": ", said]) for way, said in ways_texts(named))
    columns = [
        doc.own_column("effect", "{effect.effect}", look="row left"),
        doc.own_column("predicted size", _size, "largest of flux and SNR"),
        doc.own_column("largest in", "{where}", look="left"),
        doc.own_column("modelled", decision, look="left"),
        doc.own_column("how, or why not", "{effect.reason}", look="left wide"),
    ]
    rows = effect_rows(named)
    table = doc.Table("Effects in the images", columns, rows, words.text("texts.modelled"))
    yield doc.Fold(f"All effects ({len(rows)})", [table])


def largest_errors(records: Iterable[ModellingRecord]) -> dict[Quantity, float | None]:
    """Return the largest predicted error of each quantity; None where one is not known."""
    largest: dict[Quantity, float | None] = {}
    for record in records:
        for name, value in record.predicted_error.items():
            before = largest.get(name, 0.0)
            largest[name] = None if value is None or before is None else max(value, before)
    return largest


def columns_blocks(result: results.ColumnsResult) -> Iterator[doc.Block]:
    """Yield what the columns of a file are taken for, and how many of its rows can be used."""

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

    special: dict[str, Any] = {"quantity": lambda row: row.quantity or "not used", "unit": unit, "reason": remark}
    for table in result.tables:
        rows = f"{table.n_usable} of {table.n_rows} row{'s' * (table.n_rows != 1)} can be used"
        title = f"{result.file} as a table of {table.taken_as} ({_OPTION[table.taken_as]}): {rows}"
        columns = doc.row_columns(results.ColumnTaken, "heading quantity unit reason", **special)
        yield doc.Table(title, columns, table.columns, last_width=_WIDE)
        if table.left_out:
            example = doc.own_column("first", first, look="left", label="first of them")
            columns = doc.row_columns(results.ReasonLeftOut, "done count column first reason", first=example)
            yield doc.Table("Left out, by reason", columns, table.left_out, last_width=_WIDE)
        yield from doc.notes(*(note for note in table.notes if not is_shown(note)), look="")
    if len(result.tables) > 1:
        yield doc.Paragraph("The file can be read both as stars and as planets: the option decides.", "note")
    if any(row.unit_assumed for table in result.tables for row in table.columns):
        yield doc.Paragraph("(assumed): the file names no unit, and this one is taken.", "note")


def _sequence_columns(
    kind: type[results.Result], sequences: Sequence[results.PlannedSequenceRow], more: str
) -> list[results.Column]:
    """Return the columns of sequences, with the visit where there are programmes."""
    visit, of = " visit" if any(item.visit for item in sequences) else "", (kind, doc.itself)
    return doc.row_columns(
        kind,
        f"obsid kind{visit} target/2 band frames {more}",
        kind=lambda item: f"{item.kind} {item.role}" if item.role == "reference" else item.kind,
        target=lambda item: shortened(item.target),
        frames=doc.own_column("frames × s", "{n_frames} × {exposure_s:g}", fields="n_frames exposure_s", of=of),
        adu=doc.own_column("ADU", "{adu_min}–{adu_max}", fields="adu_min adu_max" * ("adu" in more.split()), of=of),
        start_utc=lambda item: item.start_utc[:19],
    )


def simulation_blocks(result: results.SimulationResult, out: Path) -> Iterator[doc.Block]:
    """Yield what the frames of each sequence hold, and where its files are."""
    sequences = result.sequences
    more = "em_gain adu saturated_pixels cosmic_rays/1 size_bytes"
    columns = _sequence_columns(results.SimulatedSequence, sequences, more)
    yield doc.Table(f"{result.name}: {counted(len(sequences), 'sequence')}", columns, sequences[:_MOST])
    left = len(sequences) - _MOST
    note = "Sat. px: most pixels of one frame that a limit cut off. Cosmics: particles in all frames together."
    yield from doc.notes(f"... and {left} more: see {out / 'simulation.json'}" * (left > 0), note)
    for programme in result.programmes:
        yield from _programme_blocks(programme, out)
    yield from _left_out_blocks(sequences)
    files = [str(out / item.file) for item in sequences]
    if len(sequences) > _FEW:
        folders = dict.fromkeys(str((out / item.file).parent) for item in sequences)
        files = [f"files in {listed([*folders], _FEW)}"]
    yield from doc.notes(*files, look="whole")


def reduction_blocks(result: results.ReductionResult, out: Path) -> Iterator[doc.Block]:
    """Yield what was reduced, what with, and where the files are."""
    rows, of = result.sequences, (results.ReducedSequence, doc.itself)
    columns = doc.row_columns(
        results.ReducedSequence,
        "kind target band frames em_gain median_e/2 error_e/2 hit",
        target=lambda item: shortened(item.target),
        frames=doc.own_column("frames × s", "{n_frames} × {exposure_s:g}", fields="n_frames exposure_s", of=of),
        hit=doc.own_column("hit pixels", lambda item: str(item.mask_counts["cosmic_ray"])),
    )
    yield doc.Table(f"{counted(len(rows), 'sequence')} reduced, e- a pixel and frame", columns, rows[:_MOST])
    used: dict[str, None] = {}
    missing: dict[str, list[str]] = {}
    for item in rows:
        used |= dict.fromkeys(f"{step}: {item.steps[step]}" for step in ("bias", "dark", "flat", "cosmic_rays"))
        for text in item.assumed:
            missing.setdefault(text, []).append(Path(item.level0).name)
    lacking = [f"not in the header of {listed(names, 1)}: {text}" for text, names in missing.items()]
    said = [*used, *lacking, *(f"left out: {text}" for text in result.left_out)]
    more = f"... and {len(said) - _MOST} more: see {out / 'reduction.json'}" * (len(said) > _MOST)
    yield from doc.notes(*said[:_MOST], more, f"files below {out}")


def _programme_blocks(programme: results.SimulatedProgramme, out: Path) -> Iterator[doc.Block]:
    """Yield when the visits of a programme are, and where its list is."""
    title = f"{programme.target}: {counted(programme.visits, 'science visit')}"
    if programme.reference_visits:
        title += f" and {counted(programme.reference_visits, 'reference visit')}"
        title += f" of {programme.reference}" if programme.reference != programme.target else ""
    visits: dict[tuple[str, str, float, float], list[results.VisitRow]] = {}
    for row in programme.sequences:
        visits.setdefault((row.folder, row.band, row.exposure_s, row.em_gain), []).append(row)
    columns = doc.row_columns(
        results.VisitRow,
        "folder band/2 start_utc n_frames window/1 roll_deg/3",
        of=itemgetter(0),
        start_utc=lambda rows: rows[0].start_utc[:19],
        n_frames=doc.own_column(
            "frames × s", lambda rows: f"{sum(row.n_frames for row in rows)} × {rows[0].exposure_s:g}"
        ),
        window=doc.own_column("windows", lambda rows: str(len(rows))),
    )
    yield doc.Table(title, columns, list(visits.values())[:_MOST])
    more = len(visits) - _MOST
    scheme = f" with the scheme {programme.reference_scheme} of references" if programme.reference_visits else ""
    said = [f"{count_text(more)} more are not shown."] * (more > 0)
    calibrations = programme.calibrations
    said += [f"{counted(len(calibrations), 'sequence')} of calibrations belong to it."] * bool(calibrations)
    said += [f"The programme spans {words.decimals(programme.span_days, 2)} days{scheme}."]
    yield doc.Paragraph(" ".join([*said, f"The visits are listed in {out / programme.file}."]), "note")


def _left_out_blocks(sequences: Sequence[results.PlannedSequenceRow]) -> Iterator[doc.Block]:
    """Yield what tolerances leave out, with the largest sizes, and how images are made then."""
    columns = [
        doc.own_column("left out for the tolerance", "{effect.effect}", look="left"),
        doc.own_column("predicted size", _size),
        doc.own_column("largest in", "{where}", look="left"),
    ]
    modelled = [(f"{shortened(item.target)} {item.band}", item.modelled) for item in sequences if item.modelled]
    gone = [row for row in effect_rows(modelled) if row.effect.decision == "skipped" and row.effect.size]
    if gone:
        yield doc.Table("", columns, gone, last_width=_WIDE)
    yield from doc.notes(*(f"{way}: {said}" for way, said in ways_texts(modelled)))


def planned_blocks(plan: results.SimulationEstimate) -> Iterator[doc.Block]:
    """Yield the sequences of a simulation that has not been run, and what it would plan."""
    columns = _sequence_columns(results.PlannedSequenceRow, plan.sequences, "em_gain/1 start_utc/3")
    title = f"{plan.name}: {counted(plan.n_sequences, 'sequence')}"
    yield doc.Table(title, columns, plan.sequences[:_MOST], last_width=19)
    yield from doc.notes(f"... and {plan.n_sequences - _MOST} more" * (plan.n_sequences > _MOST))
    yield from _left_out_blocks(plan.sequences)
    time, disk = words.duration_text(plan.wall_s), words.size_text(1e6 * plan.disk_mb)
    memory = f"{words.significant(plan.memory_mb)} MB memory a worker"
    cost = f"about {time} with {plan.workers} worker(s), {memory}, {disk} disk"
    yield doc.Paragraph(f"{count_text(plan.n_frames)} frames, {cost}", "whole")


def check_blocks(result: results.CheckResult) -> Iterator[doc.Block]:
    """Yield what a check found, file by file."""
    layout, unit = "hdu keyword severity message", lambda item: "" if item.hdu is None else str(item.hdu)
    columns = doc.row_columns(results.FindingRecord, layout, hdu=unit)
    for path in dict.fromkeys(item.path for item in result.findings):
        rows = [item for item in result.findings if item.path == path]
        yield doc.Paragraph(path, "whole")
        yield doc.Table("", columns, rows, last_width=_WIDEST)
    severities = f"{counted(result.n_errors, 'error')}, {counted(result.n_warnings, 'warning')}"
    said = severities if result.findings else "nothing wrong"
    yield doc.Paragraph(f"{counted(result.n_files, 'Level-0 file')} checked: {said}")


def instrument_blocks(result: results.InstrumentResult, layout: str) -> Iterator[doc.Block]:
    """Yield values of an instrument, in the columns that ``layout`` names."""
    yield doc.Table(result.title, doc.row_columns(results.InstrumentValue, layout), result.values, last_width=_WIDE)
