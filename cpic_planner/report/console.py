"""Plans, confirmed scenes, simulated sequences, checks of products and columns of user tables on the terminal."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cpic_core import listed
from cpic_planner import results
from cpic_planner.registry import LIBRARIES
from cpic_planner.report import cells as tables, numbers, summary
from cpic_planner.report.cells import Cells, print_note, print_plain, print_table, row_cells
from cpic_planner.report.numbers import MISSING, chosen_text, count_text, decimals, shortened, significant
from cpic_planner.report.words import (
    ALBEDO_STATUS,
    STATUS_SYMBOLS,
    counted,
    not_imaged_lines,
    plus_minus,
    targets_sentences,
)

if TYPE_CHECKING:
    from rich.console import Console


_WIDE = 60
_OPTION = {"stars": "--catalog", "planets": "--known-planets"}
"""Option that takes a table of each kind."""


_WORDS = {"not known": "heading not known"}


def print_columns(result: results.ColumnsResult, console: Console) -> None:
    """Print what the columns of a file are taken for, and how many of its rows can be used."""
    for table in result.tables:
        rows = f"{table.n_usable} of {table.n_rows} row{'s' * (table.n_rows != 1)} can be used"
        title = f"{result.file} as a table of {table.taken_as} ({_OPTION[table.taken_as]}): {rows}"
        cells = row_cells(
            results.ColumnTaken,
            "heading quantity unit reason",
            quantity=lambda row: row.quantity or "not used",
            unit=_unit,
            reason=_remark,
        )
        print_table(console, title, cells, table.columns, last_width=_WIDE)
        if table.left_out:
            shown = row_cells(
                results.ReasonLeftOut,
                "done count column first reason",
                first=Cells("first", _first, right=False, label="first of them"),
            )
            print_table(console, "Left out, by reason", shown, table.left_out, last_width=_WIDE)
        print_plain(console, *(note for note in table.notes if not _is_shown(note, result.file)))
    if len(result.tables) > 1:
        print_note(console, "The file can be read both as stars and as planets: the option decides.")
    if any(row.unit_assumed for table in result.tables for row in table.columns):
        print_note(console, "(assumed): the file names no unit, and this one is taken.")


def _unit(row: results.ColumnTaken) -> str:
    return f"{row.unit} (assumed)" if row.unit_assumed else row.unit or MISSING


def _remark(row: results.ColumnTaken) -> str:
    return row.convention if row.quantity else _WORDS.get(row.reason, row.reason)


def _first(row: results.ReasonLeftOut) -> str:
    return f"row {row.row}{f' ({row.name})' * bool(row.name)}: {row.value}"


def _is_shown(note: str, file: str) -> bool:
    """Tell whether a remark says what the tables show."""
    said = note.removeprefix(f"{file}: ")
    return said.startswith("columns not used") or " left out: " in said or " taken as missing: " in said


MEASURED = (
    "separation_arcsec/3 visits frames/4 em_gain/6 time_s/5 predicted_snr/1 recovered_snr/1 etc_ratio n_detected{more} "
    "outcome"
)
"""What is shown of each measurement; the rest is in the files."""


_COUNTS = ("n_detected", "realisations")
_STAR = tuple(results.taken_of(results.ConfirmedTarget, "name", "hip", of=itemgetter(3)))
_BAND = tuple(results.taken_of(results.BandConfirmation, "band", of=itemgetter(2)))


def print_plan(plan: results.PlanResult, console: Console, *, full: bool = True) -> None:
    """Print the confirmed targets of a plan, band by band, and how the ETC stands.

    Parameters
    ----------
    plan : PlanResult
    console : Console
    full : bool
        Also the verdicts of the targets, how images were made, and where targets come from.
    """
    rows = []
    for target in plan.targets:
        for number, item in enumerate(target.bands):
            arrow = "→ " if item.band == target.chosen_band else "  "
            rows.append((numbers.short_name(target.name) if number == 0 else "", arrow + item.band, item, target))
    cells = [
        Cells("target", itemgetter(0), right=False, numbers=_STAR),
        Cells("band", itemgetter(1), right=False, legend="→ marks the one to observe in", numbers=_BAND),
        *_measured_cells(MEASURED.format(more=""), itemgetter(2), plan.reference_library),
    ]
    found = sum(any(band.detected for band in target.bands) for target in plan.targets)
    of = f"{found} of {counted(len(plan.targets), 'target')}"
    title = f"Confirmed by simulated images: {of}, {counted(plan.realisations, 'realisation')} each"
    print_table(console, title, cells, rows, legend=not full)
    tables.explain_symbols(console, [row[2].status for row in rows if row[2].status != "ok"])
    bands = [band for target in plan.targets for band in target.bands]
    print_note(console, *filter(None, [numbers.unused_text(bands)]))
    for target in plan.targets if full else ():
        print_plain(console, f"{numbers.pretty_name(target.name)}: {plus_minus(target.verdict)}")
    print_comparison(plan, console)
    _print_invalid(bands, console)
    if not full:
        print_note(console, *filter(None, [_left_out_sentence(plan)]))
        return
    print_modelled(bands, console)
    criterion = LIBRARIES[plan.reference_library].found
    print_note(
        console,
        "→ marks the band to observe in. SNR of one observation, planet noise included: predicted, and recovered with "
        f"the error of its mean; found: realisations in which {criterion}; seen at its place: "
        "significant at the known place, but not found blind.",
        *targets_sentences(plan),
        *not_imaged_lines(plan),
        f"{chosen_text(plan.n_ranked, plan.n_in_catalogue)} ranked. {_setup_text(plan)}",
    )


def _left_out_sentence(plan: results.PlanResult) -> str:
    """Return how many stars and rows there are no images of; empty for none."""
    stars = 0 if plan.period is None else len(plan.period.left_out)
    rows = 0 if plan.schedule is None else len(plan.schedule.not_imaged)
    parts = [f"{counted(stars, 'star')} left out for visibility"] * bool(stars)
    parts += [f"{counted(rows, 'row')} of the schedule without images"] * bool(rows)
    return f"{' and '.join(parts)}: -v names them." if parts else ""


def _measured_cells(layout: str, of: Callable[[Any], results.BandConfirmation], library: str) -> list[Cells]:
    found = f"realisations in which {LIBRARIES[library].found}"
    return row_cells(
        results.BandConfirmation,
        layout,
        of=of,
        n_detected=Cells("found", lambda row: detections_cell(of(row)), legend=found, fields=_COUNTS),
        recovered_contrast=lambda row: _recovered(of(row)),
        outcome=Cells(
            "outcome",
            lambda row: outcome_cell(of(row)),
            right=False,
            legend="seen at its place means significant there, but not found blind",
        ),
    )


def _setup_text(result: results.ImagedResult) -> str:
    return f"Seed {result.seed}, {summary.dial_text(result)}, configuration {result.config_hash}."


def detections_cell(item: results.BandConfirmation) -> str:
    """Return in how many of the realisations the planet is found."""
    return MISSING if item.n_detected is None else f"{item.n_detected}/{item.realisations}"


def print_comparison(result: results.ImagedResult, console: Console, *, measured: bool = True) -> None:
    """Print what is altered in the images, and how prediction and images compare where planets were measured."""
    if altered := summary.overrides_sentence(result):
        print_plain(console, altered, bold=True)
    if measured:
        print_plain(console, summary.calibration_sentence(result), bold=True)


def _print_invalid(bands: Sequence[results.BandConfirmation], console: Console) -> None:
    """Print where a tier is not good enough, and what to ask for."""
    print_plain(console, *dict.fromkeys(f"{band.band}: {band.message}" for band in bands if band.status == "invalid"))


def print_modelled(bands: Sequence[results.BandConfirmation], console: Console) -> None:
    """Print how the images were drawn, and what that is predicted to cost.

    Parameters
    ----------
    bands : sequence of BandConfirmation
        What was measured in each band.
    console : Console
    """
    if made := summary.modelled_sentence(bands):
        print_note(console, made)


def outcome_cell(item: results.BandConfirmation) -> str:
    """Return what the images say of a planet, with the symbol of its status."""
    if item.status != "ok":
        return tables.status_cell(item.status, item.reason)
    if item.detected:
        return f"{STATUS_SYMBOLS['ok']} confirmed"
    at_place = 2 * (item.n_significant or 0) >= (item.realisations or 1)
    return f"{STATUS_SYMBOLS['unreachable']} {'seen at its place' if at_place else 'not found'}"


_SHOWN = 5


def print_confirm(result: results.ConfirmResult, console: Console, *, full: bool = True) -> None:
    """Print measurements, blind candidates, positions and albedo fits of a scene, and how the ETC stands.

    Parameters
    ----------
    result : ConfirmResult
    console : Console
    full : bool
        Also what was run frame by frame, and how images were made.
    """
    several = len({item.planet for item in result.bands}) > 1
    layout = f"{'planet ' * several}band {MEASURED.format(more=' true_contrast/7 recovered_contrast/2')}"
    cells = _measured_cells(layout, lambda item: item, result.reference_library)
    rows = sorted(result.bands, key=lambda item: item.planet) if several else result.bands
    if not rows:
        print_plain(console, f"{result.scene}: no planet, {LIBRARIES[result.reference_library].searched}", bold=True)
    else:
        title = f"{result.scene}: {summary.outcome_text(rows)}, {counted(result.realisations, 'realisation')} a band"
        print_table(console, title, cells, rows, explained=True, legend=not full)
    for item in result.bands if full else ():
        if item.audit is not None:
            audit, where = item.audit, f"{item.planet}, {item.band}, with every effect"
            run = f"{audit.frames_run} of {audit.frames_in_all} frames one by one"
            snr = f"SNR {significant(audit.recovered_snr)} ({significant(audit.predicted_snr)} predicted)"
            off = f"contrast off by {decimals(audit.deviation_sigma, 1)} of its errors"
            print_plain(console, f"{where} ({run}): {snr}, {off}, {'found' if audit.detected else 'not found'}")
    if result.searches:
        _print_searches(result.searches, console)
    print_note(console, *summary.programme_sentences(result))
    _print_positions(result.positions, console)
    print_plain(console, *map(albedo_text, result.albedos))
    print_comparison(result, console, measured=bool(rows))
    _print_invalid(result.bands, console)
    if full:
        print_modelled(result.bands, console)
        print_note(console, _setup_text(result))


def _recovered(item: results.BandConfirmation) -> str:
    if item.recovered_contrast is None or item.contrast_error is None:
        return MISSING
    return f"{item.recovered_contrast:.2e} ± {item.contrast_error:.0e}"


def _print_searches(searches: list[results.SearchRecord], console: Console) -> None:
    rows: list[tuple[results.SearchRecord, results.CandidateRecord | None]] = []
    for search in searches:
        named = sorted(search.candidates, key=lambda item: -item.snr)
        shown = [item for number, item in enumerate(named) if item.detected or item.planet or number == 0][:_SHOWN]
        rows += [(search, item) for item in shown] or [(search, None)]
    cells = [
        *row_cells(results.SearchRecord, "band visits frames/2 em_gain/2", of=lambda row: row[0]),
        *row_cells(results.CandidateRecord, "separation_arcsec pa_deg snr threshold/1", of=lambda row: row[1]),
        Cells("is", lambda row: _candidate_text(row[1]), right=False),
    ]
    elsewhere = sum(search.false_detections for search in searches)
    total = sum(search.realisations for search in searches)
    print_table(console, "What the blind search names, first realisation", cells, rows, last_width=30)
    word = "detection that is" if elsewhere == 1 else "detections that are"
    print_note(console, f"{elsewhere} {word} no planet of the scene, in {total} searches.")


def _candidate_text(item: results.CandidateRecord | None) -> str:
    if item is None:
        return "nothing"
    return item.planet or ("no planet of the scene" if item.detected else "below the threshold")


def _print_positions(positions: Sequence[results.PositionRecord], console: Console) -> None:
    cells = [
        Cells("planet", lambda item: item.planet, right=False),
        Cells("sep ″", lambda item: f"{item.separation_arcsec:.4f} ± {item.separation_error_arcsec:.4f}"),
        Cells("true", lambda item: f"{item.true_separation_arcsec:.4f}"),
        Cells("PA deg", lambda item: f"{item.pa_deg:.2f} ± {item.pa_error_deg:.2f}"),
        Cells("true", lambda item: f"{item.true_pa_deg:.2f}"),
        Cells("bands", lambda item: ", ".join(item.bands), right=False),
    ]
    if positions:
        print_table(console, "Measured places, beside the true ones", cells, positions)


def albedo_text(albedo: results.AlbedoRecord) -> str:
    """Return what contrasts say of metallicity and clouds."""
    mh, fsed = albedo.log10_mh_interval, albedo.log10_fsed_interval
    return (
        f"{albedo.planet}: log10 M/H {decimals(mh[0], 2)} to {decimals(mh[1], 2)}, log10 f_sed {decimals(fsed[0], 2)} "
        f"to {decimals(fsed[1], 2)} (68 %), correlation {decimals(albedo.correlation, 2)}, from "
        f"{', '.join(albedo.bands)}: {ALBEDO_STATUS[albedo.status]}"
    )


_FEW = 3


def _columns(sequences: Sequence[results.PlannedSequenceRow]) -> str:
    """Return the names of the first columns of sequences, the visit where there are programmes."""
    visit = " visit" if any(item.visit for item in sequences) else ""
    return f"obsid kind{visit} target/2 band frames"


_OWN: dict[str, Any] = {
    "kind": lambda item: f"{item.kind} {item.role}" if item.role == "reference" else item.kind,
    "target": lambda item: shortened(item.target),
    "frames": Cells(
        "frames × s", lambda item: f"{item.n_frames} × {item.exposure_s:g}", fields=("n_frames", "exposure_s")
    ),
}


def print_simulation(result: results.SimulationResult, out: Path, console: Console, *, limit: int = 40) -> None:
    """Print what the frames of each sequence hold, and where its files are."""
    cells = row_cells(
        results.SimulatedSequence,
        f"{_columns(result.sequences)} em_gain adu saturated_pixels cosmic_rays/1 size_bytes",
        adu=Cells("ADU", lambda item: f"{item.adu_min}–{item.adu_max}", fields=("adu_min", "adu_max")),
        **_OWN,
    )
    print_table(
        console, f"{result.name}: {counted(len(result.sequences), 'sequence')}", cells, result.sequences[:limit]
    )
    if len(result.sequences) > limit:
        print_note(console, f"... and {len(result.sequences) - limit} more: see {out / 'simulation.json'}")
    note = "Sat. px: most pixels of one frame that a limit cut off. Cosmics: particles in all frames together."
    print_note(console, note)
    for programme in result.programmes:
        _print_programme(programme, out, console, limit)
    _print_left_out(result.sequences, console)
    print_plain(console, *_files_text(result.sequences, out), wraps=False)


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
    listed = f"The visits are listed in {out / programme.file}."
    scheme = f" with the scheme {programme.reference_scheme} of references" if programme.reference_visits else ""
    span = f"The programme spans {decimals(programme.span_days, 2)} days{scheme}."
    print_note(console, " ".join([f"{count_text(more)} more are not shown."] * (more > 0) + [span, listed]))


def _print_left_out(sequences: Sequence[results.PlannedSequenceRow], console: Console) -> None:
    """Print what tolerances leave out, one table for each distinct content, with the largest sizes."""
    modelled = [(f"{shortened(item.target)} {item.band}", item.modelled) for item in sequences if item.modelled]
    for group in summary.modelled_groups(modelled):
        gone = [row for row in group.rows if row.effect.decision == "skipped" and row.effect.size]
        cells = [
            Cells("left out", lambda row: row.effect.effect, right=False),
            Cells("predicted size", lambda row: row.size),
            Cells("", lambda row: row.where, right=False),
        ]
        print_plain(console, f"Left out of {listed(group.names, _FEW)} for the tolerance:", bold=True)
        print_table(console, "", cells, gone, last_width=console.width)
        print_note(console, f"Predicted error: {group.errors}.")
        # All of a frame is kept here: what is said of its region does not apply.
        print_note(console, f"Optics: {group.knobs.split('; ', 1)[1]}.")


def _files_text(sequences: Sequence[results.SimulatedSequence], out: Path) -> list[str]:
    """Return the files where there are few, folders where there are many."""
    if len(sequences) <= _FEW:
        return [str(out / item.file) for item in sequences]
    folders = dict.fromkeys(str((out / item.file).parent) for item in sequences)
    return [f"files in {listed([*folders], _FEW)}"]


def print_planned(plan: results.SimulationEstimate, console: Console, *, limit: int = 40) -> None:
    """Print the sequences of a simulation that has not been run, and what it would plan."""
    cells = row_cells(
        results.PlannedSequenceRow,
        f"{_columns(plan.sequences)} em_gain/1 start_utc/3",
        start_utc=lambda item: item.start_utc[:19],
        **_OWN,
    )
    print_table(
        console, f"{plan.name}: {counted(plan.n_sequences, 'sequence')}", cells, plan.sequences[:limit], last_width=19
    )
    if plan.n_sequences > limit:
        print_note(console, f"... and {plan.n_sequences - limit} more")
    _print_left_out(plan.sequences, console)
    time, disk = numbers.duration_text(plan.wall_s), numbers.size_text(1e6 * plan.disk_mb)
    cost = f"about {time} with {plan.workers} worker(s), {significant(plan.memory_mb)} MB memory a worker, {disk} disk"
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
