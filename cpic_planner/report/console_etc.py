"""Answers of the exposure-time calculator on the terminal: table, noise budget, what binds and what would help.

With several instruments, band by band below each other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import TYPE_CHECKING

from cpic_planner.report import numbers, words
from cpic_planner.report.cells import Cells, print_note, print_plain, print_table, row_cells
from cpic_planner.report.priorities import lacking_lines
from cpic_planner.results import EtcAnswer, EtcResult, SearchedProgramme, Taken, taken_of

if TYPE_CHECKING:
    from rich.console import Console

    from cpic_planner.queries import EtcQuestion


_ENDS = ("median", "low", "high")
_SENTENCES = 2
"""Most sentences under a table."""
_QUESTION = {"exposure_time": "wall time", "signal_to_noise": "SNR", "contrast_limit": "contrast limit"}
_BAR_CELLS, _FEWEST_CELLS = 24, 6
_SMALLEST_SHARE = 5e-4


def best_row(result: EtcResult) -> EtcAnswer | None:
    """Return the row of the best answer in the best band: least time, clearest detection, or faintest limit."""
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
        Say more: which gains spare what, how likely detections are, what the visits are, how messages go on.
    """
    best = best_row(result)
    _print_answers(result, console, best, asked)
    print_note(console, *_verdict_sentences(result, best, placed, explain))
    if explain:
        _explain(result, console)
    budgeted = [row for row in result.answers if row.value is not None] if every_budget else [best] if best else []
    for row in budgeted:
        console.print()
        _print_budget(row, console)
        _print_binding(row, console, explain)
    look = next((row.known_planet for row in result.answers if row.known_planet is not None), None)
    more = [] if look is None else lacking_lines({look.planet: look.flags}, look.columns_not_used)
    lines = [*flag_lines(result.answers, result.note), *(f"! {text}" for text in more)]
    if lines:
        console.print()
        print_note(console, *lines)


def _print_answers(result: EtcResult, console: Console, best: EtcAnswer | None, asked: str) -> None:
    errors = {item.answer: item.predicted_error or {} for item in result.fidelity.answers} if result.fidelity else {}
    own = {id(row): errors.get(number, {}).get("snr") for number, row in enumerate(result.answers)}
    known = any(row.known_planet is not None for row in result.answers)
    given = any(row.question != "contrast_limit" for row in result.answers)  # else it is the answer
    cells = row_cells(
        EtcAnswer,
        f"band value {'range ' * known}separation_arcsec/1 {'contrast/4 ' * given}visits/2 frames/5 em_gain/9 time_s/7 "
        "snr/3 significance/5 detection_probability/6 detection_probability_known_place/7 held/8 status",
        band=lambda row: ("→ " if row is best else "  ") + row.band,
        value=replace(ANSWER, numbers=_in_one_unit(result.answers)),
        range=_RANGE,
        separation_arcsec=_within("separation_arcsec", 3),
        contrast=_within("contrast", 0),
        snr=replace(_SNR, text=lambda row: _with_error(row.snr, own[id(row)])),
        held=Cells("held by", _limits_cell, right=False, legend="what binds exposure (t) and gain (g)"),
    )
    question = asked or " / ".join(dict.fromkeys(_QUESTION[row.question] for row in result.answers))
    look = next((row.known_planet for row in result.answers if row.known_planet is not None), None)
    star = numbers.star_text(result)
    if look is not None:
        star = f"{numbers.pretty_name(look.planet)} ({look.status}) on {look.date_utc[:10]}; {star}"
    title = f"{star}; {question}\n{_about_text(result)}"
    print_table(console, title, cells, result.answers, explained=True, legend=True)


def _in_one_unit(answers: Sequence[EtcAnswer]) -> tuple[Taken, ...]:
    """Return value and unit of answers for files; the unit is that of the column where all have the same."""
    value, unit = taken_of(EtcAnswer, "value", "unit")
    units = {row.unit for row in answers}
    return replace(value, column=replace(value.column, unit="s" if units == {"s"} else "")), unit


def _within(name: str, places: int) -> Callable[[EtcAnswer], str]:
    """Return the cell of a planet's number; of a known one its median and half of the width of 68 % of draws."""

    def written(value: float | None) -> str:
        return numbers.MISSING if value is None else f"{value:.{places}f}" if places else numbers.ratio_text(value)

    def text(row: EtcAnswer) -> str:
        if row.known_planet is None:
            return written(getattr(row, name))
        spread = getattr(row.known_planet, name)
        half = 0.5 * (spread.high - spread.low)
        return f"{written(spread.median)} ± {half:.{places}f}" if places else f"{written(spread.median)} ± {half:.0e}"

    return text


def _with_error(value: float | None, share: float | None) -> str:
    if value is None or not share:
        return numbers.significant(value)
    told = numbers.significant(value)
    return f"{told} ± {value * share:.{len(told.partition('.')[2])}f}"


def _range_text(row: EtcAnswer) -> str:
    """Return the answers that the errors of a known planet leave open."""
    look = row.known_planet
    if look is None or not look.value.answered_share:
        return numbers.MISSING
    middle, low, high = (_value_text(row, getattr(look.value, end)) for end in _ENDS)
    return f"{middle} ({low} to {high})"


def _about_text(result: EtcResult) -> str:
    """Return what the answers are about: planet and place."""
    where = f"on the diagonal of {_quadrant_text(result)}"
    planet = result.reference_planet
    if planet is not None:
        return f"{planet.radius_rjup:g} R_J, phase {planet.phase_deg:g} deg, {planet.albedo} albedo, {where}"
    look = next((row.known_planet for row in result.answers if row.known_planet is not None), None)
    if look is None:
        return f"{where[0].upper()}{where[1:]}"
    radius, phase = look.radius_rjup, look.phase_deg
    return f"{radius.median:.2f} R_J, phase {phase.median:.0f} deg (medians), {look.albedo} albedo, {where}"


def _verdict_sentences(result: EtcResult, best: EtcAnswer | None, placed: bool, explained: bool) -> list[str]:
    """Say in at most two sentences what is a detection, or why not, and the least change that would make it one."""
    rated = [row for row in result.answers if row.status == "ok" and row.verdict is not None]
    missed = [row for row in rated if row.verdict == "measured_not_detected"]
    told = []
    if best is not None and best.verdict == "measured_not_detected":
        searched = best.verdict_mode == "blind"
        chance = best.detection_probability if searched else best.detection_probability_known_place
        significance, threshold = map(numbers.significant, (best.significance, best.threshold))
        levels = f"the significance is {significance} and the threshold {threshold}"
        why = levels if chance is None else f"{numbers.share_text(chance)} % of such programmes show the planet"
        inner = (
            "; it was put where the level takes the least time, often at the inner edge of the dark hole, where the "
            "threshold is highest (a question for a detection takes that into account)"
        )
        text = f"The answer in {best.band} is not a detection: {why}"
        told.append(f"{text}{inner * (best.question == 'exposure_time' and not placed)}.")
        if needed := _required_text(best):
            limit = words.LIMITED_BY[best.limited_by or "none"][1]
            told.append(f"Limited by {limit}. Any one of these would be enough: {needed}.")
    elif best is not None and best.verdict == "detected":
        how = "by a search that knows no place" if best.verdict_mode == "blind" else "where one knows to look"
        told.append(f"Detected: at least half of such programmes show the planet {how}.")
    if len(told) < _SENTENCES and (limits := _bands_of(missed, "limited_by")):
        causes = "; ".join(f"{bands} by {words.LIMITED_BY[limit][1]}" for limit, bands in limits.items())
        told.append(f"Not detected in this time; limited: {causes}.")
    if len(told) < _SENTENCES and not explained and (reasons := _bands_of(result.answers, "message")):
        told.append(f"{'; '.join(f'{bands}: {text}' for text, bands in reasons.items())}.")
    return told


def _bands_of(rows: Sequence[EtcAnswer], name: str) -> dict[str, str]:
    """Return the bands, with commas, of each value that a field of answers has; of none without one."""
    found: dict[str, dict[str, None]] = {}
    for row in rows:
        if value := getattr(row, name):
            found.setdefault(value, {})[row.band] = None
    return {value: ", ".join(bands) for value, bands in found.items()}


def _explain(result: EtcResult, console: Console) -> None:
    """Print what the two sentences leave out: probabilities, changes that would detect planets, visits and orbits."""
    rated = [row for row in result.answers if row.status == "ok" and row.verdict is not None]
    odds = []
    for row in rated:
        blind, known_place = row.detection_probability, row.detection_probability_known_place
        if blind is not None and known_place is not None:
            odds.append(f"{answer_name(row)} {numbers.share_text(blind)} and {numbers.share_text(known_place)} %")
    if odds:
        print_note(console, f"Probability of a detection by a blind search and at the known place: {'; '.join(odds)}.")
    needs = [(row, _required_text(row)) for row in rated if row.verdict != "detected"]
    wanted = [f"{answer_name(row)} {needed}" for row, needed in needs if needed]
    if wanted:
        print_note(console, f"One of these alone would make it a detection: {'; '.join(wanted)}.")
    print_note(console, *(f"{bands}: {text}." for text, bands in _bands_of(result.answers, "message").items()))
    if programme := _programme_text(result.answers):
        print_note(console, f"Each visit has a wavefront of its own and all are reduced together: {programme}.")
    days = [row.span_days for row in result.answers if row.span_days is not None]
    if days and (paid := words.orbits_text(result.answers)):
        print_note(console, f"They span up to {numbers.significant(max(days), 2)} days; {paid}.")
    look = next((row.known_planet for row in result.answers if row.known_planet is not None), None)
    if look is not None:
        print_note(console, f"Orbit from {look.reference}; {look.planets_table}.")


def _required_text(row: EtcAnswer) -> str:
    """Return the changes that would make the planet of an answer detected, one at a time; none where none would."""
    parts = []
    if row.required_visits is not None:
        parts.append(f"{row.required_visits} such visits")
    if row.required_time_s is not None:
        parts.append(f"{numbers.duration_text(row.required_time_s)} in as many visits")
    if row.required_drift_factor is not None:
        parts.append(f"{numbers.significant(row.required_drift_factor, 2)} of the drift")
    if row.required_contrast_factor is not None:
        parts.append(f"a contrast {numbers.significant(row.required_contrast_factor, 3)} times as high")
    return ", ".join(parts)


def _programme_text(rows: list[EtcAnswer]) -> str:
    """Return the visits of the answers, in words."""
    seen = dict.fromkeys(
        f"{row.visits} {'visit' if row.visits == 1 else 'visits'} of {numbers.duration_text(row.visit_time_s)}"
        for row in rows
        if row.visits is not None and row.visit_time_s is not None
    )
    return ", ".join(seen)


def _limits_cell(row: EtcAnswer) -> str:
    """Return what binds exposure and gain, in few words."""
    limits = ("t", row.exposure_limited_by), ("g", row.gain_limited_by)
    parts = [f"{name}: {words.short_limit(limit)}" for name, limit in limits if limit]
    return ", ".join(parts) or numbers.MISSING


def _print_budget(row: EtcAnswer, console: Console) -> None:
    terms = {name.removesuffix("_e2"): value for name, value in row.budget.items() if name.endswith("_e2")}
    total = sum(terms.values())
    if total <= 0:
        return
    shown = sorted((name for name in terms if terms[name] >= _SMALLEST_SHARE * total), key=lambda name: -terms[name])
    largest = max(terms.values())
    cells = [
        Cells("term", words.term_text, right=False),
        Cells("e- rms", lambda name: numbers.significant(terms[name] ** 0.5)),
        Cells("% of variance", lambda name: f"{100.0 * terms[name] / total:.1f}"),
    ]
    taken = sum(max(len(cell.header), *(len(cell.text(name)) for name in shown)) + 2 for cell in cells)
    room = min(_BAR_CELLS, console.width - taken)
    if room >= _FEWEST_CELLS:
        cells.append(Cells("", lambda name: _bar(terms[name] / largest, room, console), right=False))
    signal = numbers.significant(row.budget.get("signal_e"))
    title = f"Noise in {answer_name(row)}: {numbers.significant(total**0.5)} e- rms under a signal of {signal} e-"
    print_table(console, title, cells, shown, last_width=_BAR_CELLS)


def _bar(share: float, room: int, console: Console) -> str:
    """Return the bar of blocks in eighths, or of signs where the terminal has no blocks."""
    try:
        "█▏".encode(console.encoding)
    except (UnicodeEncodeError, LookupError):
        return "#" * max(round(share * room), 1)
    eighths = max(round(share * room * 8), 1)
    return "█" * (eighths // 8) + " ▏▎▍▌▋▊▉"[eighths % 8].strip()


def _print_binding(row: EtcAnswer, console: Console, explain: bool) -> None:
    limits = ("exposure", row.exposure_limited_by), ("EM gain", row.gain_limited_by)
    if held := [f"the {name} is held by {words.limit_text(limit)}" for name, limit in limits if limit]:
        print_note(console, words.sentence("; ".join(held)))
    helpful = words.remedies_text(row.remedies)
    if row.remedies.get("twice_the_time", 2.0) < 1.0:
        helpful += "; longer visits would lower it, because the wavefront drifts during a visit"
    if helpful:
        print_note(console, f"What would raise the SNR: {helpful.removeprefix('; ')}.")
    if explain and row.gain_caps and row.exposure_s is not None:
        print_note(console, f"In frames of {numbers.significant(row.exposure_s)} s:")
        for name, gain in row.gain_caps.items():
            print_note(console, f"  {words.cap_sentence(name, gain)}.")


def flag_lines(rows: Sequence[EtcAnswer | SearchedProgramme], note: str) -> list[str]:
    """Return what is to be known of star, planet and bands beside the numbers, a line each.

    Parameters
    ----------
    rows : sequence of EtcAnswer or SearchedProgramme
    note : str
        On the star; empty for none.
    """
    flags = dict.fromkeys(flag for row in rows for flag in row.flags)
    bands = {row.band for row in rows}
    lines = [f"Note: {note}"] if note else []
    lines += filter(None, [numbers.unused_text(rows)])
    for flag in flags:
        mine = list(dict.fromkeys(row.band for row in rows if flag in row.flags))
        where = "" if len(mine) == len(bands) else f"{', '.join(mine)}: "
        lines.append(f"! {where}{words.flag_text(flag)} ({flag})")
    return lines


def _quadrant_text(result: EtcResult) -> str:
    """Return the quadrants of the planets, by band where they differ, and the roll."""
    quadrants = _bands_of(result.answers, "quadrant")
    if not quadrants:
        return "a quadrant"
    several = len(quadrants) > 1
    parts = [f"the {quadrant}{f' ({bands})' * several}" for quadrant, bands in quadrants.items()]
    return f"{' and '.join(parts)} quadrant at roll {result.answers[0].roll_deg:g} deg"


def _value_text(row: EtcAnswer, value: float | None) -> str:
    """Return a value in the unit of an answer."""
    if row.unit == "s":
        return "never" if value is None else numbers.duration_text(value)
    if row.unit == "contrast":
        return "none" if value is None else numbers.ratio_text(value)
    return numbers.significant(value)


def _answer(row: EtcAnswer) -> str:
    return numbers.MISSING if row.value is None else _value_text(row, row.value)


ANSWER = Cells("answer", _answer, fields=("value", "unit"))
_RANGE = Cells(
    "range",
    _range_text,
    legend="median, and 16 to 84 %, of what the errors of place and light leave open: the answer is that of the median "
    "place and light, which may lie elsewhere",
    fields=tuple(f"known_planet.{name}.{end}" for name in ("value", "separation_arcsec", "contrast") for end in _ENDS),
)
_SNR = Cells(
    "SNR",
    lambda row: numbers.significant(row.snr),
    legend="photometric SNR of the stack, with the planet's own noise, and its predicted error",
    fields=("snr",),
)


def question_text(question: EtcQuestion) -> str:
    """Return what is asked, in words."""
    level = numbers.level_text(question.snr, question.sigma)
    if question.asks_time:
        return f"wall time for {level}"
    time = numbers.duration_text(question.wall_s)
    if question.strategy.visits is not None and question.visit_time_s is not None:
        time = f"{question.strategy.visits} × {numbers.duration_text(question.visit_time_s)}"
    if question.n_frames is not None and question.exposure_s is not None:
        time = f"{question.n_frames} × {question.exposure_s:g} s"
    return f"contrast limit for {level} in {time}" if question.contrast_limit else f"SNR in {time}"


def answer_name(row: EtcAnswer) -> str:
    """Return band and separation of an answer."""
    return f"{row.band} at {row.separation_arcsec:.3f}″"


@dataclass(frozen=True)
class _Row:
    """An answer, the instrument that it is of, and the first instrument's answer to the same."""

    instrument: str
    answer: EtcAnswer
    base: EtcAnswer | None

    @property
    def ratio(self) -> str:
        base, own = self.base, self.answer
        if base is None or not base.value or own.value is None:
            return numbers.MISSING
        same = ["separation_arcsec"] + ["contrast"] * (own.question != "contrast_limit")  # there it is the answer
        alike = all(math.isclose(getattr(own, name), getattr(base, name), rel_tol=_ALIKE) for name in same)
        return numbers.significant(own.value / base.value, 3) if alike else _UNLIKE


_ALIKE = 1e-3
"""Relative difference up to which two separations or contrasts are the same in every digit that is shown."""
_UNLIKE = "other planet"


def print_both(results: Sequence[tuple[str, EtcResult]], console: Console) -> None:
    """Print answers with several instruments, and their ratio to those of the first one.

    Parameters
    ----------
    results : sequence of (str, EtcResult)
        Name of each instrument, and what is answered with it.
    console : Console
    """
    rows = []
    for band in dict.fromkeys(row.band for _, result in results for row in result.answers):
        answers = [(name, [row for row in result.answers if row.band == band]) for name, result in results]
        rows += [_Row(name, row, base) for name, own in answers for row, base in zip_longest(own, answers[0][1]) if row]
    cells = row_cells(
        EtcAnswer,
        "band instrument value ratio separation_arcsec contrast visits frames snr significance limit status",
        of=lambda row: row.answer,
        instrument=Cells("instrument", lambda row: row.instrument, right=False),
        value=replace(ANSWER, text=lambda row: ANSWER.text(row.answer)),
        ratio=Cells("ratio", lambda row: row.ratio, legend="answer over that of the first instrument in the same band"),
        limit=Cells("limit", lambda row: words.LIMITED_BY[row.answer.limited_by or "none"][0], right=False),
    )
    title = f"{numbers.full_name(results[0][1].target, results[0][1].hip)} with each instrument"
    print_table(console, title, cells, rows, explained=True, legend=True)
    if any(row.ratio == _UNLIKE for row in rows):
        why = "each instrument has its own best place, and planets of other separations or contrasts do not compare"
        print_plain(console, f"No ratio is given where it says {_UNLIKE}: {why}. A stated separation is that of both.")
