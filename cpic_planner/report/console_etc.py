"""Answers of the exposure-time calculator on the terminal: table, noise budget, what binds and what would help.

How firm answers of the exposure-time calculator are, on the terminal: stated errors, and checks in images.
"""

from __future__ import annotations

from operator import itemgetter
from typing import TYPE_CHECKING

from cpic_planner.report import words
from cpic_planner.report.cells import Cells, explain_symbols, print_note, print_table, row_cells, status_cell
from cpic_planner.report.numbers import MISSING, duration_text, full_name, ratio_text, share_text, significant
from cpic_planner.report.summary import error_text
from cpic_planner.results import AnswerFidelity, EtcAnswer, EtcFidelity, EtcResult, ImageCheck

if TYPE_CHECKING:
    from rich.console import Console


_QUESTION = {"exposure_time": "wall time", "signal_to_noise": "SNR", "contrast_limit": "contrast limit"}
_BAR_CELLS, _FEWEST_CELLS = 24, 6
_SMALLEST_SHARE = 5e-4


def best_row(result: EtcResult) -> EtcAnswer | None:
    """Row of the best answer in the best band: least time, clearest detection, or faintest limit."""
    rows = [row for row in result.answers if row.band == result.best_band and row.value is not None]
    if not rows:
        return None
    if rows[0].question == "signal_to_noise":
        return max(rows, key=lambda row: (row.significance or 0.0) / (row.threshold or float("inf")))
    return min(rows, key=lambda row: row.value or 0.0)


def print_etc(
    result: EtcResult,
    console: Console,
    *,
    asked: str = "",
    placed: bool = True,
    every_budget: bool = False,
    explain: bool = False,
) -> None:
    """Print the answers for one target.

    Parameters
    ----------
    result : EtcResult
    console : Console
    asked : str
        The question in words.
    placed : bool
        The question gave the separation; otherwise it was chosen.
    every_budget : bool
        Print the noise budget of every answer, not of the best one only.
    explain : bool
        Say which gains spare what.
    """
    best = best_row(result)
    _print_answers(result, console, best, asked)
    _print_verdicts(result, console, best, placed)
    budgeted = [row for row in result.answers if row.value is not None] if every_budget else [best] if best else []
    for row in budgeted:
        console.print()
        _print_budget(row, console)
        _print_binding(row, console, explain)
    console.print()
    _print_remarks(result, console)


def _print_answers(result: EtcResult, console: Console, best: EtcAnswer | None, asked: str) -> None:
    cells = row_cells(
        EtcAnswer,
        "band value separation_arcsec/1 contrast/4 visits/2 frames/5 em_gain/9 time_s/7 snr/4 significance/5 "
        "detection_probability/6 held/8 status",
        band=lambda row: ("→ " if row is best else "  ") + row.band,
        value=Cells("answer", _answer),
        held=Cells("held by", _limits_cell, right=False),
    )
    question = asked or " / ".join(dict.fromkeys(_QUESTION[row.question] for row in result.answers))
    star = f"{full_name(result.target, result.hip)}: V {result.v_mag:.2f} mag, {significant(result.distance_pc, 4)} pc"
    print_table(console, f"{star}; {question}", cells, result.answers, explained=True)
    for text in dict.fromkeys(row.message for row in result.answers if row.message):
        bands = ", ".join(dict.fromkeys(row.band for row in result.answers if row.message == text))
        print_note(console, f"{bands}: {text}.")


def _print_verdicts(result: EtcResult, console: Console, best: EtcAnswer | None, placed: bool) -> None:
    """Say what of the answers is a detection, how likely it is, and what is missing."""
    rated = [row for row in result.answers if row.status == "ok" and row.verdict is not None]
    if not rated:
        return
    many = len({row.band for row in rated}) < len(rated)
    if best is not None and best.verdict == "measured_not_detected":
        searched = best.verdict_mode == "blind"
        chance = best.detection_probability if searched else best.detection_probability_known_place
        levels = f"the significance is {significant(best.significance)} and the threshold {significant(best.threshold)}"
        why = levels if chance is None else f"{share_text(chance)} % of such programmes show the planet"
        text = f"The answer in {_answer_name(best, many)} is not a detection: {why}."
        if best.question == "exposure_time" and not placed:
            text += (
                " The planet was put where the level takes the least time, often at the inner edge of the dark "
                "hole, where the threshold is highest; --detect asks for a detection."
            )
        print_note(console, text)
    missed = [row for row in rated if row.verdict == "measured_not_detected"]
    causes = []
    for limit in dict.fromkeys(row.limited_by for row in missed if row.limited_by is not None):
        where = ", ".join(_answer_name(row, many) for row in missed if row.limited_by == limit)
        causes.append(f"{where} by {words.LIMITED_BY[limit][1]}")
    if causes:
        print_note(console, f"Not detected in this time; limited: {'; '.join(causes)}.")
    odds = []
    for row in rated:
        blind, known_place = row.detection_probability, row.detection_probability_known_place
        if blind is not None and known_place is not None:
            odds.append(f"{_answer_name(row, many)} {share_text(blind)} and {share_text(known_place)} %")
    if odds:
        print_note(console, f"Probability of a detection by a blind search and at the known place: {'; '.join(odds)}.")
    wanted = [needed for row in rated if (needed := _required_text(row)) and row.verdict != "detected"]
    if wanted:
        print_note(console, f"One of these alone would make it a detection: {'; '.join(wanted)}.")
    modes = [row.verdict_mode for row in rated if row.verdict == "detected"]
    for mode in dict.fromkeys(modes):
        how = "by a search that knows no place" if mode == "blind" else "if one knows where to look"
        print_note(console, f"Detected: at least half of such programmes show the planet {how}.")


def _required_text(row: EtcAnswer) -> str:
    """Return the changes that would make the planet of an answer detected, one at a time; none where none would."""
    parts = []
    if row.required_visits is not None:
        parts.append(f"{row.required_visits} such visits")
    if row.required_time_s is not None:
        parts.append(f"{duration_text(row.required_time_s)} in as many visits")
    if row.required_drift_factor is not None:
        parts.append(f"{significant(row.required_drift_factor, 2)} of the drift")
    if row.required_contrast_factor is not None:
        parts.append(f"a contrast {significant(row.required_contrast_factor, 3)} times as high")
    return f"{_answer_name(row)} {', '.join(parts)}" if parts else ""


def _programme_text(rows: list[EtcAnswer]) -> str:
    """Visits of the answers, in words."""
    seen = dict.fromkeys(
        f"{row.visits} {'visit' if row.visits == 1 else 'visits'} of {duration_text(row.visit_time_s)}"
        for row in rows
        if row.visits is not None and row.visit_time_s is not None
    )
    return ", ".join(seen)


def _limits_cell(row: EtcAnswer) -> str:
    """What binds exposure and gain, in few words."""
    limits = ("t", row.exposure_limited_by), ("g", row.gain_limited_by)
    parts = [f"{name}: {words.short_limit(limit)}" for name, limit in limits if limit]
    return ", ".join(parts) or MISSING


def _print_budget(row: EtcAnswer, console: Console) -> None:
    terms = {name.removesuffix("_e2"): value for name, value in row.budget.items() if name.endswith("_e2")}
    total = sum(terms.values())
    if total <= 0:
        return
    shown = sorted((name for name in terms if terms[name] >= _SMALLEST_SHARE * total), key=lambda name: -terms[name])
    largest = max(terms.values())
    cells = [
        Cells("term", words.term_text, right=False),
        Cells("e- rms", lambda name: significant(terms[name] ** 0.5)),
        Cells("% of variance", lambda name: f"{100.0 * terms[name] / total:.1f}"),
    ]
    taken = sum(max(len(cell.header), *(len(cell.text(name)) for name in shown)) + 2 for cell in cells)
    room = min(_BAR_CELLS, console.width - taken)
    if room >= _FEWEST_CELLS:
        cells.append(Cells("", lambda name: _bar(terms[name] / largest, room, console), right=False))
    signal = significant(row.budget.get("signal_e"))
    title = f"Noise in {_answer_name(row)}: {significant(total**0.5)} e- rms under a signal of {signal} e-"
    print_table(console, title, cells, shown, last_width=_BAR_CELLS)


def _bar(share: float, room: int, console: Console) -> str:
    """Bar of blocks in eighths, or of signs where the terminal has no blocks."""
    try:
        "█▏".encode(console.encoding)
    except (UnicodeEncodeError, LookupError):
        return "#" * max(round(share * room), 1)
    eighths = max(round(share * room * 8), 1)
    return "█" * (eighths // 8) + " ▏▎▍▌▋▊▉"[eighths % 8].strip()


def _print_binding(row: EtcAnswer, console: Console, explain: bool) -> None:
    for name, limit in (("exposure", row.exposure_limited_by), ("EM gain", row.gain_limited_by)):
        if limit:
            print_note(console, f"The {name} is held by {words.limit_text(limit)}.")
    if explain and row.gain_caps and row.exposure_s is not None:
        print_note(console, f"In frames of {significant(row.exposure_s)} s:")
        for name, gain in row.gain_caps.items():
            print_note(console, f"  {words.cap_sentence(name, gain)}.")
    if helpful := words.remedies_text(row.remedies):
        print_note(console, f"What would raise the SNR: {helpful}.")
    if row.remedies.get("twice_the_time", 2.0) < 1.0:
        print_note(console, "Longer visits would lower it: the wavefront walks away.")


def _print_remarks(result: EtcResult, console: Console) -> None:
    if result.reference_planet is not None:
        planet = result.reference_planet
        shown = f"{planet.radius_rjup:g} R_J, phase {planet.phase_deg:g} deg, {planet.albedo} albedo"
        print_note(console, f"Reference planet: {shown}.")
    for flag in dict.fromkeys(flag for row in result.answers for flag in row.flags):
        bands = list(dict.fromkeys(row.band for row in result.answers if flag in row.flags))
        where = "" if len(bands) == len({row.band for row in result.answers}) else f"{', '.join(bands)}: "
        print_note(console, f"! {where}{words.flag_text(flag)} ({flag}).")
    if result.note:
        print_note(console, f"Note: {result.note}")
    print_note(
        console,
        f"Positions on the diagonal of {_quadrant_text(result)}. Wall time is that of all visits: readouts, reference "
        "frames and the overhead of each. SNR has the planet's own noise, significance has not.",
    )
    if programme := _programme_text(result.answers):
        print_note(console, f"Each visit has a wavefront of its own and all are reduced together: {programme}.")
    days = [row.span_days for row in result.answers if row.span_days is not None]
    if days and (paid := words.orbits_text(result.answers)):
        print_note(console, f"They span up to {significant(max(days), 2)} days; {paid}.")


def _quadrant_text(result: EtcResult) -> str:
    """The quadrants of the planets, by band where they differ, and the roll."""
    quadrants = {row.band: row.quadrant for row in result.answers if row.quadrant is not None}
    if not quadrants:
        return "a quadrant"
    roll = f"at roll {result.answers[0].roll_deg:g} deg"
    if len(set(quadrants.values())) == 1:
        return f"the {next(iter(quadrants.values()))} quadrant {roll}"
    parts = [
        f"the {quadrant} ({', '.join(band for band in quadrants if quadrants[band] == quadrant)})"
        for quadrant in dict.fromkeys(quadrants.values())
    ]
    return f"{' and '.join(parts)} quadrant {roll}"


def _answer(row: EtcAnswer) -> str:
    if row.value is None:
        return MISSING
    if row.unit == "s":
        return duration_text(row.value)
    return ratio_text(row.value) if row.unit == "contrast" else significant(row.value)


_DRAWS = {"sums": "sums of frames", "frames": "every frame, every effect"}


def print_fidelity(result: EtcResult, console: Console) -> None:
    """Print what images say of the answers, and the stated error of those that need none; nothing for ``quick``.

    Parameters
    ----------
    result : EtcResult
    console : Console
    """
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
        print_note(console, f"{_answer_name(row)}: closed forms are enough; their stated error is at most {error}.")
    for text in dict.fromkeys(item.message for item, _ in rows if item.message):
        names = ", ".join(_answer_name(row) for item, row in rows if item.message == text)
        print_note(console, f"{names}: {text}.")
    if not rows:
        print_note(console, "No answer has frames that could be checked in images.")


def _print_checks(record: EtcFidelity, rows: list[tuple[AnswerFidelity, EtcAnswer]], console: Console) -> None:
    cells = [
        *row_cells(EtcAnswer, "band separation_arcsec/1 contrast/4", of=itemgetter(1)),
        *row_cells(
            ImageCheck,
            "predicted_snr snr snr_ratio flux_ratio/2 light_ratio/3 realisations/1 n_found/5 agrees",
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
        "Errors of one sigma. SNR: closed form of what the images hold; of images: mean flux over its measured error. "
        "Light: planet's light in images without noise over that of the closed form. Found: by a blind search.",
    )


def _detections(pair: tuple[AnswerFidelity, EtcAnswer]) -> str:
    images = pair[0].images
    return MISSING if images is None else f"{images.n_found} of {images.realisations}"


def _agreement(pair: tuple[AnswerFidelity, EtcAnswer]) -> str:
    item = pair[0]
    if item.images is None:
        return status_cell(item.status, item.reason)
    return "agrees" if item.images.agrees else "differs"


def _answer_name(row: EtcAnswer, placed: bool = True) -> str:
    return f"{row.band} at {row.separation_arcsec:.3f}″" if placed else row.band
