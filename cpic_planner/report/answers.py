"""Answers of the exposure-time calculator: on the terminal, and as curves; speed against accuracy."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import zip_longest
from operator import attrgetter, itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from cpic_core import FloatArray, InputError, Record, Status, listed, write_named
from cpic_planner import etc, results
from cpic_planner.report import document as doc, drawing, words
from cpic_planner.report.drawing import BAND_STYLE, WIDTH_INCHES, Look, literal, with_style
from cpic_planner.report.words import MISSING, significant
from cpic_planner.results import EtcAnswer, EtcResult, EtcStarsResult
from cpic_planner.targets import Targets
from simulator.detectors import noise_terms

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

    from cpic_planner.queries import EtcQuestion


_Answers: TypeAlias = EtcResult | EtcStarsResult
_SENTENCES = 2
_HOW = {"blind": "by a search that knows no place", "known_place": "where one knows to look"}
"""Most sentences under a table."""
_QUESTION = {"exposure_time": "wall time", "signal_to_noise": "SNR", "contrast_limit": "contrast limit"}
_BAR_CELLS = 24
_SMALLEST_SHARE = 5e-4


def best_row(result: EtcResult) -> EtcAnswer | None:
    """Return the row of the best answer in the best band: least time, clearest detection, or faintest limit."""
    return _best_of(result.answers, result.best_band)


def _best_of(answers: Sequence[EtcAnswer], band: str | None) -> EtcAnswer | None:
    rows = [row for row in answers if row.band == band and row.value is not None]
    if not rows:
        return None
    if rows[0].question == "signal_to_noise":
        return max(rows, key=lambda row: (row.significance or 0.0) / (row.threshold or float("inf")))
    return min(rows, key=lambda row: row.value or 0.0)


def question_text(question: EtcQuestion) -> str:
    """Return what is asked, in words."""
    level = words.level_text(question.snr, question.sigma)
    if question.asks_time:
        return f"wall time for {level}"
    time = words.duration_text(question.wall_s)
    if question.strategy.visits is not None and question.visit_time_s is not None:
        time = f"{question.strategy.visits} × {words.duration_text(question.visit_time_s)}"
    if question.n_frames is not None and question.exposure_s is not None:
        time = f"{question.n_frames} × {question.exposure_s:g} s"
    return f"contrast limit for {level} in {time}" if question.contrast_limit else f"SNR in {time}"


def _known_planet(result: _Answers) -> results.KnownPlanetLook | None:
    """Return the known planet that answers are about, the first one of several, if they are about one."""
    return next((row.known_planet for row in result.answers if row.known_planet is not None), None)


def etc_blocks(
    result: EtcResult, *, asked: str = "", placed: bool = True, every_budget: bool = False, explain: bool = False
) -> Iterator[doc.Block]:
    """Yield the answers for one target.

    Parameters
    ----------
    result : EtcResult
    asked : str
        The question in words.
    placed : bool
        The question gave the separation; otherwise it was chosen.
    every_budget : bool
        Show the noise budget of every answer, not of the best one only.
    explain : bool
        Say more: which gains spare what, how likely detections are, what the visits are, how messages go on.
    """
    best, look = best_row(result), _known_planet(result)
    star = words.star_text(result)
    if look is not None:
        star = f"{words.pretty_name(look.planet)} ({look.status}) on {look.date_utc[:10]}; {star}"
    yield _answer_table(result, [best] if best else [], star, asked)
    yield from doc.notes(*_verdict_sentences(result, best, placed, explain), look="")
    yield from doc.notes(*(_explanations(result) if explain else ()), look="")
    budgeted = [row for row in result.answers if row.value is not None] if every_budget else [best] if best else []
    for row in budgeted:
        yield from _budget_blocks(row, explain)
    yield from doc.notes(*flag_lines(result.answers, result.note))
    yield from _lacking_notes(result)
    yield from _checked_blocks(result)


def etc_stars_blocks(result: EtcStarsResult, *, asked: str = "") -> Iterator[doc.Block]:
    """Yield the answers for several targets.

    Parameters
    ----------
    result : EtcStarsResult
    asked : str
        The question in words.
    """
    each: dict[str, list[EtcAnswer]] = {}
    for row in result.answers:
        each.setdefault(_target_name(row), []).append(row)
    bands = {words.pretty_name(star.planet or star.target): star.best_band for star in result.stars}
    best = {name: found for name, rows in each.items() if (found := _best_of(rows, bands[name])) is not None}
    yield _answer_table(result, list(best.values()), words.counted(len(each), "target"), asked)
    detected = [row for row in result.answers if row.verdict == "detected"]
    for mode, names in _named(detected, "verdict_mode", _target_name).items():
        yield doc.Paragraph(f"Detected: at least half of such programmes show the planet {_HOW[mode]}: {names}.")
    shown = {_target_name(row) for row in detected}
    missed = [row for name, row in best.items() if row.verdict is not None and name not in shown]
    if limits := _named(missed, "limited_by", _target_name):
        causes = "; ".join(f"{names} by {words.LIMITED_BY[limit][1]}" for limit, names in limits.items())
        yield doc.Paragraph(f"Not detected in any band; in the best one limited: {causes}.")
    reasons = _named(result.answers, "message", lambda row: f"{_target_name(row)} in {row.band}")
    yield from doc.notes(*(f"{names}: {text}." for text, names in reasons.items()), look="")
    yield from doc.notes(*(f"Note: {star.note}" for star in result.stars if star.note))
    yield from doc.notes(*flag_lines(result.answers, "", of=_target_name))
    yield from _lacking_notes(result)
    yield from _checked_blocks(result)


def _target_name(row: EtcAnswer) -> str:
    """Return the star of an answer, or its known planet."""
    return words.pretty_name(row.target if row.known_planet is None else row.known_planet.planet)


def _lacking_notes(result: _Answers) -> Iterator[doc.Block]:
    """Yield what tables of known planets lack of those that answers are about."""
    looks = [row.known_planet for row in result.answers if row.known_planet is not None]
    if looks:
        from cpic_planner.report.known import lacking_lines

        unused = list(dict.fromkeys(name for look in looks for name in look.columns_not_used))
        yield from doc.notes(
            *(f"! {text}" for text in lacking_lines({look.planet: look.flags for look in looks}, unused))
        )


def _answer_table(result: _Answers, best: Sequence[EtcAnswer], star: str, asked: str) -> doc.Table:
    marked, several = set(map(id, best)), isinstance(result, EtcStarsResult)
    errors = {item.answer: item.predicted_error or {} for item in result.fidelity.answers} if result.fidelity else {}
    own = {id(row): errors.get(number, {}).get("snr") for number, row in enumerate(result.answers)}
    look = _known_planet(result)
    given = any(row.question != "contrast_limit" for row in result.answers)  # else it is the answer
    drawn = any(row.over_instruments is not None for row in result.answers)
    columns = doc.row_columns(
        EtcAnswer,
        f"{'target:row ' * several}band value {'instruments ' * drawn}{'range ' * (look is not None)}"
        f"separation_arcsec/1 {'contrast/4 ' * given}visits/2 frames/5 "
        "em_gain/9 time_s/7 snr/3 significance/5 detection_probability/6 detection_probability_known_place/7 held/8 "
        "status",
        target=lambda row: words.shortened(_target_name(row)),
        band=lambda row: ("→ " if id(row) in marked else "  ") + row.band,
        value=replace(_ANSWER, files=_in_one_unit(result.answers)),
        range=_RANGE,
        instruments=_INSTRUMENTS,
        separation_arcsec=lambda row: _within(row, "separation_arcsec", ".3f"),
        contrast=lambda row: _within(row, "contrast", ".2e"),
        snr=doc.own_column(
            "SNR", lambda row: _with_error(row.snr, own[id(row)]), legend=_SNR_LEGEND, fields="snr", of=_ROW
        ),
        held=doc.own_column("held by", _limits_cell, look="left", legend="what binds exposure (t) and gain (g)"),
    )
    question = asked or " / ".join(dict.fromkeys(_QUESTION[row.question] for row in result.answers))
    title = f"{star}; {question}\n{_about_text(result)}"
    return doc.Table(title, columns, result.answers, legend=True)


def _in_one_unit(answers: Sequence[EtcAnswer]) -> tuple[results.Column, ...]:
    """Return value and unit of answers for files; the unit is that of the column where all have the same."""
    value, unit = results.taken_of(EtcAnswer, "value", "unit")
    units = {row.unit for row in answers}
    return replace(value, unit="s" if units == {"s"} else ""), unit


def _within(row: EtcAnswer, name: str, form: str) -> str:
    """Return a planet's number; of a known one its median and half of the width of 68 % of draws."""
    if row.known_planet is None:
        return words.formatted(getattr(row, name), form)
    return words.formatted(getattr(row.known_planet, name), f"±{form}")


def _with_error(value: float | None, share: float | None) -> str:
    told = significant(value)
    return told if value is None or not share else f"{told} ± {value * share:.{len(told.partition('.')[2])}f}"


def _value_text(row: EtcAnswer, value: float | None) -> str:
    """Return a value in the unit of an answer."""
    if value is None:
        return {"s": "never", "contrast": "none"}.get(row.unit, MISSING)
    return words.formatted(value, {"s": "time", "contrast": ".2e"}.get(row.unit, ".3g"))


def _range_text(row: EtcAnswer, left: results.OpenQuantiles | None) -> str:
    """Return the answers that something unknown leaves open."""
    if left is None or not left.answered_share:
        return MISSING
    middle, low, high = (_value_text(row, getattr(left, end)) for end in _ENDS)
    return f"{middle} ({low} to {high})"


def _limits_cell(row: EtcAnswer) -> str:
    """Return what binds exposure and gain, in few words."""
    limits = ("t", row.exposure_limited_by), ("g", row.gain_limited_by)
    return ", ".join(f"{name}: {words.short_limit(limit)}" for name, limit in limits if limit) or MISSING


_ROW = (EtcAnswer, doc.itself)
_ANSWER = doc.own_column("answer", lambda row: MISSING if row.value is None else _value_text(row, row.value))
_ENDS = ("median", "low", "high")
_RANGE = doc.own_column(
    "range",
    lambda row: _range_text(row, row.known_planet and row.known_planet.value),
    legend="median, and 16 to 84 %, of what the errors of place and light leave open: the answer is that of the median "
    "place and light, which may lie elsewhere",
    fields=" ".join(
        f"known_planet.{name}.{end}" for name in ("value", "separation_arcsec", "contrast") for end in _ENDS
    ),
    of=_ROW,
)
_INSTRUMENTS = doc.own_column(
    "over instruments",
    lambda row: _range_text(row, row.over_instruments),
    legend="median, and 16 to 84 %, of the answers with instruments drawn from what is not known of this one",
    fields=" ".join(f"over_instruments.{end}" for end in (*_ENDS, "answered_share")),
    of=_ROW,
)
_SNR_LEGEND = "photometric SNR of the stack, with the planet's own noise, and its predicted error"


def _about_text(result: _Answers) -> str:
    """Return what the answers are about: planet and place."""
    quadrants = _named(result.answers, "quadrant", _target_name if isinstance(result, EtcStarsResult) else _BAND)
    where = "on the diagonal of a quadrant"
    if quadrants:
        several = len(quadrants) > 1
        parts = [f"the {quadrant}{f' ({bands})' * several}" for quadrant, bands in quadrants.items()]
        where = f"on the diagonal of {' and '.join(parts)} quadrant at roll {result.answers[0].roll_deg:g} deg"
    planet, look = result.reference_planet, _known_planet(result)
    if planet is not None:
        return f"{planet.radius_rjup:g} R_J, phase {planet.phase_deg:g} deg, {planet.albedo} albedo, {where}"
    if look is None:
        return f"{where[0].upper()}{where[1:]}"
    radius, phase = look.radius_rjup, look.phase_deg
    return f"{radius.median:.2f} R_J, phase {phase.median:.0f} deg (medians), {look.albedo} albedo, {where}"


def _verdict_sentences(result: EtcResult, best: EtcAnswer | None, placed: bool, explained: bool) -> list[str]:
    """Say in at most two sentences what is a detection, or why not, and the least change that would make it one."""
    told = []
    if best is not None and best.verdict == "measured_not_detected":
        searched = best.verdict_mode == "blind"
        chance = best.detection_probability if searched else best.detection_probability_known_place
        levels = f"the significance is {significant(best.significance)} and the threshold {significant(best.threshold)}"
        why = levels if chance is None else f"{words.share_text(chance)} % of such programmes show the planet"
        inner = words.text("texts.etc_inner_edge") if best.question == "exposure_time" and not placed else ""
        told.append(f"The answer in {best.band} is not a detection: {why}{inner}.")
        if needed := _required_text(best):
            limit = words.LIMITED_BY[best.limited_by or "none"][1]
            told.append(f"Limited by {limit}. Any one of these would be enough: {needed}.")
    elif best is not None and best.verdict == "detected":
        told.append(f"Detected: at least half of such programmes show the planet {_HOW[best.verdict_mode or 'blind']}.")
    missed = [row for row in _with_verdict(result) if row.verdict == "measured_not_detected"]
    if len(told) < _SENTENCES and (limits := _named(missed, "limited_by")):
        causes = "; ".join(f"{bands} by {words.LIMITED_BY[limit][1]}" for limit, bands in limits.items())
        told.append(f"Not detected in this time; limited: {causes}.")
    if len(told) < _SENTENCES and not explained and (reasons := _named(result.answers, "message")):
        told.append(f"{'; '.join(f'{bands}: {text}' for text, bands in reasons.items())}.")
    return told


def _with_verdict(result: EtcResult) -> list[EtcAnswer]:
    """Return the answers that have a verdict."""
    return [row for row in result.answers if row.status == "ok" and row.verdict is not None]


_BAND: Callable[[EtcAnswer], str] = attrgetter("band")


def _named(rows: Sequence[EtcAnswer], name: str, of: Callable[[EtcAnswer], str] = _BAND) -> dict[str, str]:
    """Return the bands, or what else to call answers by, for each value that a field of these has; of none without."""
    found: dict[str, dict[str, None]] = {}
    for row in rows:
        if value := getattr(row, name):
            found.setdefault(value, {})[of(row)] = None
    return {value: listed(list(names)) for value, names in found.items()}


def _explanations(result: EtcResult) -> list[str]:
    """Return what two sentences leave out: probabilities, changes that would detect planets, visits and orbits."""
    said = []
    odds = [
        f"{answer_name(row)} {words.share_text(row.detection_probability)} and "
        f"{words.share_text(row.detection_probability_known_place)} %"
        for row in _with_verdict(result)
        if row.detection_probability is not None and row.detection_probability_known_place is not None
    ]
    if odds:
        said.append(f"Probability of a detection by a blind search and at the known place: {'; '.join(odds)}.")
    needs = {answer_name(row): _required_text(row) for row in _with_verdict(result) if row.verdict != "detected"}
    if wanted := [f"{name} {needed}" for name, needed in needs.items() if needed]:
        said.append(f"One of these alone would make it a detection: {'; '.join(wanted)}.")
    said += [f"{bands}: {text}." for text, bands in _named(result.answers, "message").items()]
    visits = dict.fromkeys(
        f"{words.counted(row.visits, 'visit')} of {words.duration_text(row.visit_time_s)}"
        for row in result.answers
        if row.visits is not None and row.visit_time_s is not None
    )
    if visits:
        said.append(f"Each visit has a wavefront of its own and all are reduced together: {', '.join(visits)}.")
    days = [row.span_days for row in result.answers if row.span_days is not None]
    if days and (paid := words.orbits_text(result.answers)):
        said.append(f"They span up to {significant(max(days), 2)} days; {paid}.")
    if (look := _known_planet(result)) is not None:
        said.append(f"Orbit from {look.reference}; {look.planets_table}.")
    return said


def _required_text(row: EtcAnswer) -> str:
    """Return the changes that would make the planet of an answer detected, one at a time; none where none would."""
    parts = {
        "{} such visits": row.required_visits,
        "{} in as many visits": row.required_time_s and words.duration_text(row.required_time_s),
        "{} of the drift": row.required_drift_factor and significant(row.required_drift_factor, 2),
        "a contrast {} times as high": row.required_contrast_factor and significant(row.required_contrast_factor, 3),
    }
    return ", ".join(text.format(value) for text, value in parts.items() if value is not None)


def answer_name(row: EtcAnswer) -> str:
    """Return band and separation of an answer."""
    return f"{row.band} at {row.separation_arcsec:.3f}″"


def _noise_terms(row: EtcAnswer) -> dict[str, float]:
    """Return the variance of an answer by its terms."""
    return {name.removesuffix("_e2"): value for name, value in row.budget.items() if name.endswith("_e2")}


def _budget_blocks(row: EtcAnswer, explain: bool) -> Iterator[doc.Block]:
    """Yield the noise of an answer by its terms, and what binds its frames."""
    terms = _noise_terms(row)
    total, largest = sum(terms.values()), max(terms.values(), default=0.0)
    if total > 0:
        shown = sorted(
            (name for name in terms if terms[name] >= _SMALLEST_SHARE * total), key=lambda name: -terms[name]
        )
        columns = [
            doc.own_column("term", words.term_text, look="left"),
            doc.own_column("e- rms", lambda name: significant(terms[name] ** 0.5)),
            doc.own_column("", lambda name: _bar(terms[name] / largest), look="left terminal", way=1),
            doc.own_column("% of variance", lambda name: f"{100.0 * terms[name] / total:.1f}"),
        ]
        signal = significant(row.budget.get("signal_e"))
        title = f"Noise in {answer_name(row)}: {significant(total**0.5)} e- rms under a signal of {signal} e-"
        yield doc.Table(title, columns, shown)
    yield from doc.notes(words.sentence("; ".join(words.held_texts(row))))
    helpful = words.remedies_text(row.remedies)
    if row.remedies.get("twice_the_time", 2.0) < 1.0:
        helpful += "; longer visits would lower it, because the wavefront drifts during a visit"
    yield from doc.notes(f"What would raise the SNR: {helpful.removeprefix('; ')}." * bool(helpful))
    if explain and row.gain_caps and row.exposure_s is not None:
        caps = "; ".join(words.cap_sentence(name, gain) for name, gain in row.gain_caps.items())
        yield doc.Paragraph(f"In frames of {significant(row.exposure_s)} s: {caps}.", "note")


def _bar(share: float) -> str:
    """Return a bar of blocks in eighths."""
    eighths = max(round(share * _BAR_CELLS * 8), 1)
    return "█" * (eighths // 8) + " ▏▎▍▌▋▊▉"[eighths % 8].strip()


def flag_lines(
    rows: Sequence[EtcAnswer | results.SearchedProgramme], note: str, of: Callable[[Any], str] = _BAND
) -> list[str]:
    """Return what is to be known of star, planet and bands beside the numbers, a line each.

    Parameters
    ----------
    rows : sequence of EtcAnswer or SearchedProgramme
    note : str
        On the star; empty for none.
    of : callable
        Names what a flag is about where not all rows have it.
    """
    every = set(map(of, rows))
    lines = [f"Note: {note}"] if note else []
    lines += filter(None, [words.unused_text(rows)])
    for flag in dict.fromkeys(flag for row in rows for flag in row.flags):
        mine = list(dict.fromkeys(of(row) for row in rows if flag in row.flags))
        where = "" if len(mine) == len(every) else f"{listed(mine)}: "
        lines.append(f"! {where}{words.flag_text(flag)} ({flag})")
    return lines


_Both = tuple[EtcAnswer, str, EtcAnswer | None]
"""An answer, the instrument that it is of, and the first instrument's answer to the same."""
_ALIKE = 1e-3
"""Relative difference up to which two separations or contrasts are the same in every digit that is shown."""
_UNLIKE = "other planet"


def _ratio(row: _Both) -> str:
    """Return an answer over that of the first instrument, where both are of the same planet."""
    own, _, base = row
    if base is None or not base.value or own.value is None:
        return MISSING
    same = ["separation_arcsec"] + ["contrast"] * (own.question != "contrast_limit")  # there it is the answer
    alike = all(math.isclose(getattr(own, name), getattr(base, name), rel_tol=_ALIKE) for name in same)
    return significant(own.value / base.value, 3) if alike else _UNLIKE


def both_blocks(each: Sequence[tuple[str, EtcResult]], noun: str) -> Iterator[doc.Block]:
    """Yield answers with several instruments or to several questions, and their ratio to those of the first one.

    Parameters
    ----------
    each : sequence of (str, EtcResult)
        Name of each instrument or question, and what is answered.
    noun : str
        What they are: ``instrument`` or ``question``.
    """
    rows: list[_Both] = []
    for band in dict.fromkeys(row.band for _, result in each for row in result.answers):
        answers = [(name, [row for row in result.answers if row.band == band]) for name, result in each]
        rows += [(row, name, base) for name, own in answers for row, base in zip_longest(own, answers[0][1]) if row]
    columns = doc.row_columns(
        EtcAnswer,
        "band which value ratio separation_arcsec contrast visits frames snr significance limit status",
        of=itemgetter(0),
        which=doc.own_column(noun, "{1}", look="left"),
        value=doc.own_column("answer", lambda row: doc.cell(_ANSWER, row[0])),
        ratio=doc.own_column("ratio", _ratio, legend=f"answer over that of the first {noun} in the same band"),
        limit=doc.own_column("limit", lambda row: words.LIMITED_BY[row[0].limited_by or "none"][0], look="left"),
    )
    stars = dict.fromkeys(words.full_name(result.target, result.hip) for _, result in each)
    yield doc.Table(f"{' and '.join(stars)} with each {noun}", columns, rows)
    if any(_ratio(row) == _UNLIKE for row in rows):
        why = f"each {noun} has its own best place, and planets of other separations or contrasts do not compare"
        yield doc.Paragraph(f"No ratio is given where it says {_UNLIKE}: {why}. A stated separation is that of both.")


_DRAWS = {"sums": "sums of frames", "frames": "every frame, every effect"}
_Checked = tuple[results.AnswerFidelity, EtcAnswer]


def _checked_blocks(result: _Answers) -> Iterator[doc.Block]:
    """Yield what images say of the answers, and the stated error of those that need none; nothing for ``quick``."""
    record = result.fidelity
    if record is None or record.fidelity == "quick":
        return
    rows: list[_Checked] = [(item, result.answers[item.answer]) for item in record.answers]
    several = isinstance(result, EtcStarsResult)

    def name(row: EtcAnswer) -> str:
        return f"{_target_name(row)} in {answer_name(row)}" if several else answer_name(row)

    alone = [pair for pair in rows if pair[0].fidelity == "quick" and pair[0].status == "ok"]
    if asked := [pair for pair in rows if pair not in alone]:
        yield from _check_table(record, asked, several)
    for item, row in alone:
        error = words.error_text(item.predicted_error or {})
        said = f"{name(row)}: closed forms are enough; their stated error is at most {error}."
        yield doc.Paragraph(said, "note")
    for text in dict.fromkeys(item.message for item, _ in rows if item.message):
        names = ", ".join(name(row) for item, row in rows if item.message == text)
        yield doc.Paragraph(f"{names}: {text}.", "note")
    if not rows:
        yield doc.Paragraph("No answer has frames that could be checked in images.", "note")


def _check_table(record: results.EtcFidelity, rows: list[_Checked], several: bool) -> Iterator[doc.Block]:
    def agreement(pair: _Checked) -> str:
        item = pair[0]
        if item.images is None:
            return doc.status_cell(item.status, item.reason)
        return "agrees" if item.images.agrees else "differs"

    columns = [
        *doc.row_columns(
            EtcAnswer,
            f"{'target:row ' * several}band separation_arcsec/1 contrast/4",
            of=itemgetter(1),
            target=lambda pair: words.shortened(_target_name(pair[1])),
        ),
        *doc.row_columns(
            results.ImageCheck,
            "predicted_snr snr etc_ratio flux_ratio/2 light_ratio/3 realisations/1 n_found/5 agrees",
            of=lambda pair: pair[0].images,
            predicted_snr=lambda pair: significant(pair[0].images.predicted_snr if pair[0].images else pair[1].snr),
            n_found="{0.images.n_found} of {0.images.realisations}",
            agrees=doc.own_column("", agreement, look="left"),
        ),
    ]
    drawn = [item.images.draw for item, _ in rows if item.images is not None]
    how = " and ".join(_DRAWS[name] for name in dict.fromkeys(drawn))
    dial = f"tolerance {record.tolerance:g}" if record.tolerance else record.fidelity
    yield doc.Table(f"Checked in images ({dial}{f': {how}' if how else ''})", columns, rows)
    yield from doc.notes(words.text("texts.etc_checks") * bool(drawn))


def tradeoff_blocks(result: results.TradeoffResult) -> Iterator[doc.Block]:
    """Yield one table a scene: every way with its time, memory and errors."""

    def way(row: results.TradeoffRow) -> str:
        title = row.title if row.machine == result.machine.key else f"{row.title} (another machine)"
        return title if row.status == "ok" else f"{title}: {row.status}, {row.reason.replace('_', ' ')}"

    def error(value: float | None, uncertainty: float | None) -> str:
        if value is None:
            return ""
        return f"{100 * value:+.2g} %" if not uncertainty else f"{100 * value:+.2g} ± {100 * uncertainty:.1g} %"

    columns = doc.row_columns(
        results.TradeoffRow,
        "title wall_s cpu_s peak_memory_mb/2 flux_error/1 snr_error",
        flux_error=lambda row: error(row.flux_error, None),
        snr_error=lambda row: error(row.snr_error, row.snr_uncertainty),
        title=doc.own_column("way", way, look="left"),
    )
    for scene in result.scenes:
        rows = [row for row in result.rows if row.scene == scene.name]
        yield doc.Table(f"{scene.title} ({scene.name}, {scene.band})", columns, rows)
    for name, ratio in result.speed_ups.items():
        yield doc.Paragraph(f"{name}: one call of the closed forms is {ratio:.0f} times faster than the reference")


N_TIMES, N_PLACES = 90, 25
"""Points of a curve: straight lines between those of a limit miss at most 0.5 % of it."""
TIME_SPAN = (1.0 / 300.0, 30.0)


class TimeCurve(Record):
    """SNR and significance of one planet in one band against the wall time of as many visits; NaN without a frame.

    ``point`` holds time, SNR and significance of the answer, if there is one.
    """

    label: str
    time_s: FloatArray
    snr: FloatArray
    significance: FloatArray
    threshold: float
    point: tuple[float, float, float] | None


class SeparationCurve(Record):
    """Contrast limit in one band against separation; NaN where there is none. ``planets``: separation and contrast."""

    label: str
    separation_arcsec: FloatArray
    contrast: FloatArray
    planets: tuple[tuple[float, float], ...]


class EtcCurves(Record):
    """The contents of a figure of an answer; ``limit_time_s`` is the time of the limits, ``limit_level`` the level."""

    times: tuple[TimeCurve, ...]
    limits: tuple[SeparationCurve, ...]
    limit_time_s: float
    limit_level: str


def etc_curves(
    model: etc.EtcModel,
    star: Targets,
    answers: Sequence[EtcAnswer],
    *,
    time_s: float,
    best_band: str | None = None,
    snr: float | None = None,
    sigma: float | None = None,
    exposure_s: float | None = None,
    em_gain: float | None = None,
) -> EtcCurves:
    """Return the curves around the answers to one question about one star.

    Parameters
    ----------
    model : etc.EtcModel
    star : Targets
        One star.
    answers : sequence of EtcAnswer
    time_s : float
        Wall time that the limits are for; the middle of the axis of times where an answer has none.
    best_band : str, optional
        Band of the lines against time where there are several planets; with one planet every band has its line.
    snr, sigma : float, optional
        Level of the limits; the small-sample threshold where neither is given.
    exposure_s, em_gain : float, optional
        What was fixed.
    """
    fixed: dict[str, Any] = {"exposure_s": exposure_s, "em_gain": em_gain}
    detects = any(answer.question != "signal_to_noise" for answer in answers)
    objective: etc.Objective = "snr" if sigma is None and (snr is not None or not detects) else "significance"
    several = len(answers) > len({answer.band for answer in answers})
    drawn = [answer for answer in answers if answer.band == best_band or not several]
    times = _against_time(model, star, drawn, time_s, objective, fixed, several)
    bands = dict.fromkeys(answer.band for answer in answers)
    ends = {band: etc.separation_grid(model, band)[[0, -1]] for band in bands}
    grids = {band: np.geomspace(inner, outer, N_PLACES) for band, (inner, outer) in ends.items()}
    found = etc.contrast_limits(model, star, grids, time_s=time_s, snr=snr, sigma=sigma, **fixed)
    planets = {
        band: tuple((row.separation_arcsec, row.contrast) for row in answers if row.band == band and row.contrast)
        for band in bands
    }
    limits = (SeparationCurve(band, grid, found[band], planets[band]) for band, grid in grids.items())
    return EtcCurves(times, tuple(limits), time_s, words.level_text(snr, sigma))


def _against_time(
    model: etc.EtcModel,
    star: Targets,
    answers: Sequence[EtcAnswer],
    time_s: float,
    objective: etc.Objective,
    fixed: dict[str, Any],
    several: bool,
) -> tuple[TimeCurve, ...]:
    """Return the lines of SNR against time; none of planets that are outside the field or send no light."""
    shown = [
        one
        for one in answers
        if one.contrast is not None and 0.0 < one.contrast <= 1.0 and one.status is not Status.OUTSIDE_FIELD
    ]
    centre = np.array([one.time_s or time_s for one in shown])
    visits = np.array([one.visits or model.strategy.visits or 1 for one in shown])
    grid = np.geomspace(TIME_SPAN[0] * centre, TIME_SPAN[1] * centre, N_TIMES, axis=-1)
    planets = [etc.planets_of([one.separation_arcsec] * N_TIMES, None, one.contrast) for one in shown]
    cameras = [model.camera(one.band) for one in shown]
    threshold = np.empty(len(shown))
    lines = np.full((2, *grid.shape), np.nan)
    for camera in dict.fromkeys(cameras):
        mine = np.flatnonzero([one == camera for one in cameras])
        many, visit_time_s = visits[mine, None, None], (grid / visits[:, None])[mine, None]
        alike = etc.cases_of(model, star, [shown[i].band for i in mine], [planets[i] for i in mine], **fixed)
        threshold[mine] = alike.threshold[:, 0, 0]
        cases = alike.in_programme(etc.Programme.of(model.strategy, many, visit_time_s))
        choice = etc.best_in_visit(cases.problem(objective), model.visit_s(visit_time_s))
        if model.strategy.n_modes:  # what they change follows the frames slowly
            cases = alike.in_programme(alike.programme_of(many, visit_time_s, choice))
            choice = etc.best_in_visit(cases.problem(objective), model.visit_s(visit_time_s))
        noise, framed = cases.noise(choice), choice.n_frames >= 1
        lines[:, mine] = np.where(framed, (noise.snr, noise.significance), np.nan)[:, :, 0]
    curves = []
    for i, one in enumerate(shown):
        point = None
        if one.time_s is not None and one.snr is not None and one.significance is not None:
            point = (one.time_s, one.snr, one.significance)
        label = _label(one, several)
        curves.append(TimeCurve(label, grid[i], lines[0, i], lines[1, i], float(threshold[i]), point))
    return tuple(curves)


def _label(row: EtcAnswer, several: bool) -> str:
    return row.band + (f", {row.separation_arcsec:.3f}″" if several else "")


FIGURE_FORMATS = ("png", "pdf", "svg")
_UNDATED: dict[str, dict[str, Any]] = {
    "png": {"Software": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
    "svg": {"Date": None, "Creator": None},
}


def check_figure_name(path: Path) -> str:
    """Return the format of a figure's file by its name.

    Raises
    ------
    InputError
        If the name ends in none of the known formats.
    """
    ending = path.suffix.lower().lstrip(".")
    if ending not in FIGURE_FORMATS:
        raise InputError("--plot", str(path), allowed=f"a name that ends in {', '.join(FIGURE_FORMATS)}")
    return ending


@with_style
def write_figure(figure: Figure, path: Path) -> Path:
    """Write a figure whole; no date goes into it.

    Raises
    ------
    InputError
        If the name has no known ending, or the file cannot be written.
    """
    ending = check_figure_name(path)
    buffer = io.BytesIO()
    figure.savefig(buffer, format=ending, dpi=drawing.IMAGE_DPI, metadata=_UNDATED[ending])
    try:
        return write_named(path, buffer.getvalue(), key="--plot")
    except OSError as error:
        raise InputError("--plot", str(path), allowed="a writable file", hint=error.strerror or "") from None


_HIGH, _LEFT, _BETWEEN, _RIGHT, _ABOVE = 4.6, 0.8, 1.0, 0.16, 0.49
"""Height of the figure without a budget, and room for words beside and above axes, inches."""
_LEAST_SHARE = 0.02
_BELOW: Look = {
    "loc": "upper center",
    "bbox_to_anchor": (0.5, 0.0),
    "borderaxespad": 4.6,
    "fontsize": 8.5,
    "columnspacing": 1.2,
}
_TITLE: dict[str, Any] = {"fontsize": 10, "y": 1.0}  # where it stands anyway: looking for room takes a tenth longer
_REST = "#D0D0D0"
_TERM_COLOURS = words.WORDS["term_colours"] | {term: effect.colour for term, effect in noise_terms().items()}
_SNR_LOOK: Look = {"lw": 1.7, "ls": "-"}
_SIGNIFICANCE_LOOK: Look = {"lw": 1.3, "ls": (0, (4, 2))}
_THRESHOLD_LOOK: Look = {"lw": 1.0, "ls": ":"}


@with_style
def etc_figure(result: EtcResult, curves: EtcCurves) -> Figure:
    """Draw SNR against time, contrast limit against separation, and the noise budget of each answer.

    Parameters
    ----------
    result : EtcResult
    curves : EtcCurves
        Of the same answers, see `cpic_planner.report.answers.etc_curves`.
    """
    rows = [row for row in result.answers if row.budget]
    tall = _HIGH + (0.75 + 0.3 * len(rows) if rows else 0.0)
    figure = drawing.new_figure(tall, layout=None)

    def place(axes: Axes, left: float, bottom: float, width: float, height: float) -> None:
        """Put axes at a place of the figure; all are inches."""
        axes.set_position((left / WIDTH_INCHES, bottom / tall, width / WIDTH_INCHES, height / tall))

    looks = drawing.band_style([curve.label for curve in curves.limits])
    times, limits = figure.add_subplot(), figure.add_subplot()
    upper = max(_times(times, curves, looks), _limits(limits, curves, looks))
    left, bottom = _LEFT, 0.0
    if rows:
        budgets = figure.add_subplot()
        lower, longest = _budgets(budgets, rows)
        left, bottom = max(left, 0.2 + 0.072 * longest), _below(lower)
    # Room for words is counted instead of looked for: that costs more than drawing them.
    free = tall - _ABOVE - _below(upper) - bottom
    wide, high = (WIDTH_INCHES - left - _BETWEEN - _RIGHT) / 2.0, free * _HIGH / tall
    foot = tall - _ABOVE - high
    place(times, left, foot, wide, high)
    place(limits, left + wide + _BETWEEN, foot, wide, high)
    if rows:
        place(budgets, left, bottom, WIDTH_INCHES - left - _RIGHT, free - high)
    title = f"{words.pretty_name(result.target)}, V {result.v_mag:.2f} mag, {result.distance_pc:.2f} pc"
    figure.suptitle(literal(title), fontsize=12, y=1.0 - 0.05 / tall)
    return figure


def _below(legend_rows: int) -> float:
    """Return the room for an axis and a legend below it, inches."""
    return 0.75 + 0.18 * legend_rows


def _legend(axes: Axes, columns: int, handles: Sequence[Any] | None = None) -> int:
    """Put a legend below, and return its rows."""
    legend = axes.legend(handles=handles, ncols=columns, **_BELOW)
    return math.ceil(len(legend.get_texts()) / columns)


def _few_ticks(*axes: Axis) -> None:
    """Mark 2 and 5 of each decade between numbers: every mark takes as long as a line of the figure."""
    from matplotlib.ticker import LogLocator

    for axis in axes:
        axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))


def _times(axes: Axes, curves: EtcCurves, looks: dict[str, tuple[str, str]]) -> int:
    """Draw SNR against time; return the rows of the legend, as the other two do."""
    from matplotlib.lines import Line2D

    axes.grid(visible=True)
    axes.set(xscale="log", yscale="log", xlabel="wall time allowed (h)", ylabel="SNR, significance")
    handles, lows, highs = [], [], []
    for number, curve in enumerate(curves.times, len(looks)):
        # Where each line is of another planet, their colours follow those of the bands.
        colour, marker = looks.get(curve.label, BAND_STYLE[number % len(BAND_STYLE)])
        hours = curve.time_s / 3600.0
        axes.plot(hours, curve.snr, color=colour, label=f"_{curve.label}, SNR", **_SNR_LOOK)
        axes.plot(hours, curve.significance, color=colour, label=f"_{curve.label}, significance", **_SIGNIFICANCE_LOOK)
        if np.isfinite(curve.threshold):
            look = _THRESHOLD_LOOK | {"zorder": 1, "label": f"_{curve.label}, threshold"}
            axes.axhline(curve.threshold, color=colour, **look)
            highs.append(curve.threshold)
        if curve.point is not None:
            for value, face in ((curve.point[1], colour), (curve.point[2], "white")):
                look = {"marker": marker, "ms": 7, "mfc": face, "mec": colour, "mew": 1.3, "ls": "none"}
                axes.plot(curve.point[0] / 3600.0, value, zorder=5, **look)
        if curve.label not in looks:  # bands have their names below the other panel
            handles.append(Line2D([], [], color=colour, lw=1.7, marker=marker, ms=6, label=curve.label))
        for values in (curve.snr, curve.significance):
            good = values[np.isfinite(values) & (values > 0)]
            lows += [good.max()] * bool(good.size)
            highs += [good.max()] * bool(good.size)
    if highs:
        axes.set_ylim(min(lows, default=1.0) / 30.0, 1.6 * max(highs))
    lines = {"SNR": _SNR_LOOK, "significance": _SIGNIFICANCE_LOOK, "threshold": _THRESHOLD_LOOK}
    handles += [Line2D([], [], color="#444444", label=label, **look) for label, look in lines.items()]
    drawing.plain_ticks(axes.yaxis, 1.0, 3.0)
    drawing.plain_ticks(axes.xaxis, 1.0)
    _few_ticks(axes.xaxis, axes.yaxis)
    axes.set_title("The answer's visits, shorter or longer", **_TITLE)
    if not curves.times:
        axes.text(0.5, 0.5, "no planet to be seen here", transform=axes.transAxes, ha="center")
        return 0
    return _legend(axes, 3, handles)


def _limits(axes: Axes, curves: EtcCurves, looks: dict[str, tuple[str, str]]) -> int:
    from matplotlib.lines import Line2D

    axes.grid(visible=True)
    axes.set(yscale="log", xlabel="separation on the diagonal (arcsec)")
    axes.set_ylabel("planet-to-star contrast (flux ratio)", fontsize=9)
    shown: list[float] = []
    handles = []
    for curve in curves.limits:
        colour, marker = looks[curve.label]
        axes.plot(curve.separation_arcsec, curve.contrast, color=colour, lw=1.7, label=f"_{curve.label} limit")
        handles.append(Line2D([], [], color=colour, lw=1.7, marker=marker, ms=6, label=curve.label))
        good = curve.contrast[np.isfinite(curve.contrast)]
        shown += np.percentile(good, [0, 92]).tolist() if good.size else []
        for place, contrast in curve.planets:
            axes.plot(place, contrast, marker=marker, ms=8, mfc=colour, mec="white", mew=0.8, ls="none", zorder=5)
            shown.append(contrast)
    if shown:
        axes.set_ylim(min(shown) / 2.5, max(shown) * 3.0)
    _few_ticks(axes.yaxis)
    time = words.duration_text(curves.limit_time_s)
    axes.set_title(f"Limit for {curves.limit_level} in {time}, and planet", **_TITLE)
    return _legend(axes, min(len(handles), 4), handles)


def _budgets(axes: Axes, rows: Sequence[EtcAnswer]) -> tuple[int, int]:
    """Draw one stacked bar an answer; small terms are one piece. Return rows of the legend and the longest label."""
    shares = []
    for row in rows:
        terms = _noise_terms(row)
        total = sum(terms.values()) or 1.0
        shares.append({name: value / total for name, value in terms.items()})
    names = [name for name in _TERM_COLOURS if any(share.get(name, 0.0) >= _LEAST_SHARE for share in shares)]
    names.sort(key=lambda name: -sum(share.get(name, 0.0) for share in shares))
    left = np.zeros(len(rows))
    several = len({row.band for row in rows}) < len(rows)
    labels = [_label(row, several) for row in rows]
    for name in names:
        widths = np.array([100.0 * share.get(name, 0.0) for share in shares])
        look: Look = {"color": _TERM_COLOURS[name], "edgecolor": "white", "linewidth": 0.6}
        axes.barh(range(len(rows)), widths, left=left, height=0.66, label=words.term_text(name), **look)
        left += widths
    axes.barh(range(len(rows)), 100.0 - left, left=left, height=0.66, color=_REST, label="all other terms")
    axes.set_yticks(range(len(rows)), labels)
    axes.invert_yaxis()
    axes.set(xlim=(0, 100), xlabel="share of the variance of the answer (%)")
    return _legend(axes, 3), max(map(len, labels))
