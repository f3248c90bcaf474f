"""The ranking on the terminal: table, sensitivity, and why one star stands where it stands.

Answers of the exposure-time calculator are there with noise budget, what binds and what would help.

So are a comparison of survey strategies, how firm answers are (stated errors, checks in images), and speed against
accuracy.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from cpic_planner import results
from cpic_planner.registry import LIBRARIES, SCORES
from cpic_planner.report import numbers, summary, words
from cpic_planner.report.cells import (
    Cells,
    computed,
    explain_symbols,
    own_cells,
    print_note,
    print_plain,
    print_table,
    row_cells,
    status_cell,
)
from cpic_planner.report.files import score_taken
from cpic_planner.report.numbers import (
    MISSING,
    chosen_text,
    count_text,
    decimals,
    duration_text,
    full_name,
    pretty_name,
    significant,
)
from cpic_planner.report.priorities import lacking_lines, print_ensemble
from cpic_planner.report.summary import error_text
from cpic_planner.report.whatif_maps import shown_rows
from cpic_planner.report.whatif_words import extent_text, interval_text, lead_sentences, planets_text
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


def print_rank(rank: results.RankResult, console: Console, limit: int = 20, *, full: bool = True) -> None:
    """Print the first ``limit`` rows of a ranking, and what its numbers refer to; in two sentences unless ``full``."""
    shown, total = rank.targets[:limit], len(rank.targets)
    some = f"first {len(shown)} of " if total > 1 else ""
    stars = chosen_text(total, rank.n_in_catalogue)
    title = f"Ranking: {some}{stars}, by {SCORES[rank.score_name].title}"
    own = "" if SCORES[rank.score_name].column else "score "  # a column shows it already
    cells = row_cells(
        results.RankedTarget,
        f"rank {'rank_in_catalogue ' * rank.filtered}name v_mag/5 distance_pc/5 {own}completeness "
        "completeness_known_place completeness_unconditional/3 "
        "completeness_band/9 band/1 separation_arcsec/6 contrast/7 frames/11 em_gain/12 visits visit_time_s/8 "
        "time_s/10 snr/4 detection_margin/2 detection_probability detection_probability_known_place/3 status",
        score=_score_cells(rank.score_name),
    )
    cells += own_cells(shown)
    print_table(console, title, cells, shown, explained=True, legend=not full)
    if rank.counts_limited_by:
        limits = summary.limits_text(rank.counts_limited_by)
        print_note(
            console, f"Reference planets in {duration_text(rank.time_s)}, {summary.programme_text(rank)}: {limits}."
        )
    print_note(console, *(_about_rank(rank, limit) if full else filter(None, [_zeros(rank).strip()])))
    print_note(console, *lacking_lines({}, rank.population.columns_not_used))
    if rank.ensemble is not None:
        print_ensemble(rank.ensemble, shown, console)


def _about_rank(rank: results.RankResult, limit: int) -> list[str]:
    """Return what the numbers of a ranking refer to."""
    planet = rank.reference_planet
    return [
        f"Score: {SCORES[rank.score_name].meaning}.{_zeros(rank)}",
        f"Population (compl %): {summary.population_text(rank.population)}, by a blind search; known %: each planet "
        "looked for at its place; of all %: whatever is known of the star, blind. The score counts "
        f"{words.SEARCHES[rank.search]}.",
        summary.detected_sentence(rank),
        *filter(None, (summary.expected_sentence(rank), summary.velocities_sentence(rank, limit))),
        f"Reference planet (other columns): {planet.radius_rjup:g} R_J, phase {planet.phase_deg:g} deg, "
        f"{planet.albedo} albedo, {planet.position}; wall time up to {duration_text(rank.time_s)} per target and band.",
        f"Margin = significance / threshold; threshold keeps the false-alarm probability of {rank.sigma:g} sigma. "
        f"Detected: at least half of such observations show the planet {words.SEARCHES[summary.mode_of(rank)]}; "
        "blind %, place %: probability that a search finds it that does not know its place, and one that does. "
        f"Reference frames: {LIBRARIES[rank.reference_library].meaning}.",
        f"Stars{f' on {rank.date_utc[:10]}' * bool(rank.date_utc)}: {rank.sample}. {rank.catalogue}",
    ]


def _zeros(rank: results.RankResult) -> str:
    """Return a sentence about stars of score 0, which the score does not order; empty if there are none."""
    above = sum(row.score > 0.0 for row in rank.targets)
    if not SCORES[rank.score_name].from_zero or above == len(rank.targets):
        return ""
    stars = "1 star has a score" if above == 1 else f"{count_text(above)} stars have a score"
    return f" {stars} above zero; the others follow by the margin of the reference planet, not by the score."


def _score_cells(name: str) -> Cells:
    score = SCORES[name]
    look: dict[str, Any] = {"label": score.title, "unit": score.written[1], "numbers": (score_taken(name),)}
    return Cells(score.label, lambda row: words.score_number(row.score, name), **look)


def _kept(name: str, first: int) -> Cells:
    """Return the column of how many of the first stars stay among them."""
    column: dict[str, Any] = {"fields": (name,), "kind": results.SensitivityRow}
    return Cells(f"of {first}", lambda row: count_text(getattr(row, name)), **column)


def print_sensitivity(result: results.SensitivityResult, console: Console) -> None:
    """Print how the ranking depends on what is assumed."""
    cells = row_cells(
        results.SensitivityRow,
        "n_ok kept_first kendall_tau_b n_compared/5 kept/2 best/3 largest_fall/4 largest_fall_ranks/4 text",
        kept_first=_kept("kept_first", result.first),
        kept=_kept("kept", result.top),
    )
    title = f"What the first {result.top} stars by {SCORES[result.score_name].title} become under other assumptions"
    print_table(console, title, cells, result.rows, last_width=44)
    print_plain(console, result.statement)
    print_note(
        console,
        f"detected: stars whose reference planet is detected ({result.n_ok} nominally); tau: "
        f"{words.tau_text(result.top)}; tau of: their number; of {result.first}, of {result.top}: how many of the "
        "nominal first stars stay among them; biggest fall: of these.",
    )


def print_moves(result: results.RankComparison, console: Console, limit: int = 20) -> None:
    """Print what moves from one ranking to another one, of the first ``limit`` stars of either."""
    before, after = result.before, result.after
    old = sorted(result.targets, key=lambda move: move.before.rank)[:limit]
    rows = [move for i, move in enumerate(result.targets) if i < limit or move in old]
    cells = [
        Cells("before", lambda move: count_text(move.before.rank), fields=("before.rank",), kind=results.RankMove),
        Cells("after", lambda move: count_text(move.after.rank), fields=("after.rank",), kind=results.RankMove),
        *row_cells(results.RankMove, "name score_ratio/1 why"),
    ]
    count = len(result.targets)
    first = f"the first {f'{limit} ' * (limit > 1)}of either" if limit < count else words.counted(count, "star")
    print_plain(console, f"What moves from {before.name} (before) to {after.name} (after): {first}", bold=True)
    print_table(console, "", cells, rows, last_width=70)
    named = {*result.only_before, *result.only_after, *(move.name for move in result.targets)}
    spoken = "|".join(re.escape(name) for name in sorted(named, key=len, reverse=True))
    print_plain(console, re.sub(rf"(?<!\w)(?:{spoken})(?!\w)", lambda found: pretty_name(found[0]), result.statement))
    if result.settings is None:
        print_note(console, "The file does not say how its ranking was made: settings are not compared.")
    else:
        said = "; ".join(map(_setting_text, result.settings))
        print_note(console, f"Settings that differ: {said or 'none'}.")
    print_note(
        console,
        "before, after: rank among all stars of the sample; score ×: score after over score before; Kendall's tau: "
        "tau-b of the scores, of stars among the first of either ranking with a score above zero in either (1: the "
        "same order; 0: an unrelated one; equal scores are no order).",
    )


def _setting_text(item: results.SettingChange) -> str:
    """Return a setting before and after; of texts in several parts, such as samples, those that differ."""
    parts = item.before.split("; "), item.after.split("; ")
    gone, new = ("; ".join(part for part in own if part not in other) or MISSING for own, other in (parts, parts[::-1]))
    return f"{item.key} {gone} → {new}"


def print_explanation(explanation: results.Explanation, console: Console) -> None:
    """Print why a star stands where it stands."""
    star = explanation.star
    print_plain(console, full_name(star.name, star.hip), bold=True)
    print_plain(console, *explanation.sentences)
    console.print()
    _print_neighbours(explanation, console)
    console.print()
    _print_bands(explanation.bands, console)
    _print_limits(explanation, console)
    if explanation.ranks:
        ranks = (f"{count_text(rank)} ({name.replace('_', ' ')})" for name, rank in explanation.ranks.items())
        print_note(console, f"Rank under other assumptions: {', '.join(ranks)}.")


def _print_neighbours(explanation: results.Explanation, console: Console) -> None:
    cells = row_cells(
        results.RankedTarget,
        "rank name score completeness/1 completeness_unconditional/5 completeness_band/5 v_mag/3 distance_pc/4 "
        "detection_margin/2 status",
        score=_score_cells(explanation.score_name),
    )
    rows = [row for row in (explanation.better, explanation.star, explanation.worse) if row is not None]
    print_table(console, "Between its neighbours", cells, rows)


def _print_bands(bands: Sequence[results.BandStanding], console: Console) -> None:
    cells = row_cells(
        results.BandStanding,
        "band completeness completeness_unconditional/4 in_zone/3 observable/4 separation_arcsec/4 contrast/2 "
        "contrast_limit/2 time_s/7 snr/6 detection_margin floor_margin/1 dominant/5 status",
        dominant=lambda band: words.term_text(band.dominant),
    )
    title = "Its reference planet and its population, band by band"
    print_table(console, title, cells, bands, explained=True, legend=True)


def _print_limits(explanation: results.Explanation, console: Console) -> None:
    """Print what binds and what would help in the star's best band."""
    band = next((item for item in explanation.bands if item.band == explanation.star.band), None)
    if band is None or band.exposure_s is None:
        return
    for name, limit in (("exposure", band.exposure_limited_by), ("EM gain", band.gain_limited_by)):
        if limit:
            print_note(console, f"{band.band}: the {name} is held by {words.limit_text(limit)}.")
    for name, gain in band.gain_caps.items():
        print_note(
            console, f"{band.band}, frames of {significant(band.exposure_s)} s: {words.cap_sentence(name, gain)}."
        )
    if helpful := words.remedies_text(band.remedies):
        print_note(console, f"{band.band}: what would raise the SNR: {helpful}.")


_LAST_COLUMN = 24
_MOST_STRATEGIES = 20


def print_whatif(result: results.WhatIfResult, console: Console, *, full: bool = True) -> None:
    """Print the summary, the strategies, and their differences with the first one.

    Parameters
    ----------
    result : WhatIfResult
    console : Console
    full : bool
        Also every strategy's images, and what the comparison is to be made again with.
    """
    for i, text in enumerate(lead_sentences(result)):
        print_plain(console, text, bold=i == 0)
    print_plain(console, f"Compared: {extent_text(result)}.")
    console.print()
    rows = shown_rows(result.strategies, _MOST_STRATEGIES)
    shown = [result.strategies[i] for i in rows]
    universes = f"{count_text(result.n_universes)} universes"
    title = f"{result.name or 'strategies'}: mean of {universes} and its 90 % interval"
    print_table(console, title, _STRATEGIES, shown, last_width=_LAST_COLUMN, legend=True)
    if len(shown) < len(result.strategies):
        print_note(console, f"The first and the {len(shown) - 1} of {len(result.strategies)} that find most.")
    if len(shown) > 1:
        console.print()
        _print_differences(result, {item.name for item in shown}, console)
    _print_facts(result, shown, console)
    if full:
        _print_images(shown, console)
        print_note(console, f"Seed {result.universe['seed']}, configuration {result.config_hash}.")
    else:
        print_note(console, *filter(None, [_images_sentence(result.strategies)]))


_STRATEGIES = row_cells(
    results.StrategyOutcome,
    "planets interval/2 survey/5 new/1 any_planet/4 hours visits/6 bound/7 alarms/8 name",
    planets=lambda item: decimals(item.planets.mean, 2),
    interval=Cells(
        "interval",
        lambda item: interval_text(item.planets.low, item.planets.high),
        legend="of the mean",
        fields=("planets.low", "planets.high"),
    ),
    survey=Cells(
        "survey",
        lambda item: f"{item.planets.survey_low:.3g} to {item.planets.survey_high:.3g}",
        legend="5 to 95 % of single surveys",
        fields=("planets.survey_low", "planets.survey_high"),
    ),
    new=Cells(
        "new",
        lambda item: decimals(item.new_planets.mean, 2),
        legend="planets that nobody knows",
        fields=("new_planets",),
    ),
    hours=lambda item: decimals(item.hours.mean, 0),
    visits=computed(
        "visits",
        lambda item: sum(target.visits for target in item.targets),
        lambda value: decimals(value, 1),
        "made, mean",
    ),
    bound=computed(
        "bound %",
        lambda item: item.schedule.distance,
        lambda value: decimals(100.0 * value, 1),
        "optimality gap: planets lost relative to the best possible calendar, at most",
        name="optimality_gap",
    ),
    alarms=computed(
        "alarms",
        lambda item: item.noise_alarms.mean + item.background_alarms.mean,
        planets_text,
        "false ones, mean",
        name="false_alarms",
    ),
)


def _print_differences(result: results.WhatIfResult, names: set[str], console: Console) -> None:
    """Print paired differences with the first strategy."""
    reference = result.strategies[0].name
    by = {(item.first, item.quantity): item for item in result.differences if item.second == reference}
    pairs = [(item.name, by.get((item.name, "planets"))) for item in result.strategies[1:] if item.name in names]
    rows = [(name, item) for name, item in pairs if item is not None]

    def mean(name: str, quantity: Any, places: int) -> str:
        item = by.get((name, quantity))
        return MISSING if item is None else _signed(item.mean, places)

    cells = [
        Cells("planets", lambda row: _signed(row[1].mean, 2)),
        Cells("interval", lambda row: interval_text(row[1].low, row[1].high), gives_way=2),
        Cells("new", lambda row: mean(row[0], "new_planets", 2), gives_way=3),
        Cells("hours", lambda row: mean(row[0], "hours", 0), gives_way=1),
        Cells("verdict", lambda row: _likely(row[1]), right=False, gives_way=4),
        Cells("strategy", itemgetter(0), right=False),
    ]
    title = f"Difference with {reference} in the same universes"
    print_table(console, title, cells, rows, last_width=_LAST_COLUMN)


def _print_facts(result: results.WhatIfResult, strategies: list[results.StrategyOutcome], console: Console) -> None:
    """Print planets found with all facts and without each."""
    facts = result.facts
    if facts is None or not facts.facts:
        return
    rows = {(row.strategy, row.fact): row for row in facts.rows}

    def without(fact: str) -> Callable[[results.StrategyOutcome], str]:
        return lambda item: decimals(rows[item.name, fact].planets.mean, 2)

    cells = [
        Cells("all facts", lambda item: decimals(item.planets.mean, 2)),
        *(Cells(fact.name, without(fact.name)) for fact in facts.facts),
        Cells("strategy", lambda item: item.name, right=False),
    ]
    console.print()
    print_table(console, "Planets found without each fact, planned anew", cells, strategies, last_width=_LAST_COLUMN)
    print_plain(console, facts.statement)
    console.print()


def _likely(item: results.DifferenceRecord) -> str:
    return "more" if item.low > 0 else "fewer" if item.high < 0 else "may be chance"


def _signed(value: float, places: int) -> str:
    return f"{'+' if value > 0 else ''}{decimals(value, places)}"


def _images_sentence(strategies: Sequence[results.StrategyOutcome]) -> str:
    """Return how many of the detections that were simulated as images show the planet; empty where none was."""
    samples = [item.images for item in strategies if item.images is not None and item.images.images]
    if not samples:
        return ""
    expected = decimals(sum(sample.expected for sample in samples), 1)
    found, made = (sum(getattr(sample, name) for sample in samples) for name in ("found", "images"))
    return f"{found} of {made} simulated image sequences show the planet, {expected} expected (-v: by strategy)."


def _print_images(strategies: list[results.StrategyOutcome], console: Console) -> None:
    for item in strategies:
        sample = item.images
        if sample is None:
            continue
        if sample.images == 0:
            why = sample.note or "none asked for"
            print_plain(console, f"{item.name}: no detection was simulated as images: {why}")
            continue
        remark = f"; {sample.note}" if sample.note else ""
        ends = "" if sample.low is None or sample.high is None else f" ({interval_text(sample.low, sample.high)})"
        sequences = f"{sample.images} simulated image sequences (of {sample.detections} detections)"
        counts = f"{sample.found} of {sequences} show the planet"
        expected = f"{decimals(sample.expected, 1)} expected; correction {decimals(sample.correction, 2)}{ends}"
        print_plain(console, f"{item.name}: {counts}, {expected}{remark}")
