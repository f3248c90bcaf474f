"""Answers of the pages: the calculator, the ranking, a star, two instruments, and the columns of a table.

Each ends in one `Page`; a page says nothing that its command does not say.
"""

from __future__ import annotations

import contextlib
import functools
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl, urlencode

from catalogs import open_catalogue, table_readings, tables_read, velocity_limit
from cpic_core import InputError, only_sent_files, was_sent
from cpic_planner import queries, report, results
from cpic_planner.api import Answered, answered, prepared, visibility_of
from cpic_planner.api.comparison import Compared, compared_answers
from cpic_planner.api.one_star import star_or_planet
from cpic_planner.web.addresses import ETC, RANK, Addresses, Pairs, Q, Submission, address, check_shipped, python_lines
from cpic_planner.web.forms import Field, Form, Group, etc_form, rank_form
from cpic_planner.web.pages import MEDIA, Answer, Page, cited, elsewhere, figure_blocks, notes_blocks
from simulator.config import preset_names

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from cpic_planner.api.runs import Prepared

_RANKER = threading.Lock()
DEFAULT_ROWS, MOST_ROWS = 50, 1500


@contextlib.contextmanager
def _question(addresses: Addresses[Q], pairs: Pairs, submission: Submission | None) -> Iterator[Q]:
    """Yield the question of an address; the files that were sent are the only ones that are read."""
    with only_sent_files({} if submission is None else submission.files), queries.called_as(addresses.names):
        question: Any = addresses.question(pairs)
        if submission is not None and submission.files:
            check_shipped(question.instrument, question.band_names())
        with tables_read(strict=getattr(question, "strict", False), tell=lambda remark: None):  # the answer has them
            yield question


def _one_of(name: str, given: Sequence[tuple[str, str]]) -> tuple[list[tuple[str, str]], str]:
    """Return the parameters without those of a name, and its only value; empty without.

    Raises
    ------
    InputError
        If it has several.
    """
    values = [text for key, text in given if key == name and text]
    if len(values) > 1:
        raise InputError(name, f"{len(values)} values", allowed="one value")
    return [pair for pair in given if pair[0] != name], "".join(values)


def _without(pairs: Pairs, *names: str) -> Pairs:
    return tuple(pair for pair in pairs if pair[0] not in names)


# The calculator.


@functools.lru_cache(maxsize=128)
def etc_answer(pairs: Pairs) -> Answered:
    """Return the answer of the calculator to an address; the last ones are kept.

    Raises
    ------
    InputError
        For the first fault, naming the parameter.
    """
    return _fresh_etc(pairs, None)


def _fresh_etc(pairs: Pairs, submission: Submission | None) -> Answered:
    with _question(ETC, pairs, submission) as question:
        return answered(question)


def _etc(pairs: Pairs, submission: Submission | None) -> Answer:
    answer = etc_answer(pairs) if submission is None else _fresh_etc(pairs, submission)
    title = f"{report.pretty_name(answer.result.target)}: {ETC_PAGE.title}"
    return Answer(title, answer.result, partial(_etc_blocks, answer, pairs, submission))


def _etc_blocks(answer: Answered, pairs: Pairs, submission: Submission | None) -> list[report.Block]:
    """Return an answer as blocks; with files the figure is in the page, and there are no lines of Python."""
    blocks, result = list(answer.blocks()), answer.result
    if any(row.budget for row in result.answers):
        alt = f"SNR against wall time, contrast limit against separation, and noise budget of {result.target}"
        place = address(ETC_PAGE.drawing("", "svg"), pairs) if submission is None else ""
        caption = f"{alt}; asked: {report.question_text(answer.question)}."
        blocks += figure_blocks(place, answer.figure, alt, caption)
    blocks += notes_blocks(result.notes)
    if answer.question.catalog == "snapshot" and answer.question.v_mag is None:
        more = report.page_link(address(STAR.path, (), name=result.target), "its page")
        blocks.append(report.Paragraph(["Seasons, known planets and priority of the star: ", more, "."]))
    lines = ""
    if submission is None:
        lines = python_lines(answer.question, pairs)
        other = report.page_link(address(COMPARE.path, pairs), "Compare it with another question")
        blocks.append(report.Paragraph([other, "."]))
    return blocks + elsewhere([ETC.command_line(pairs)], cited(result), lines)


ETC_PAGE = Page(
    ETC.page,
    "CPI-C exposure-time calculator",
    "Wall time for an SNR or a detection, SNR in a time, or the contrast limit, of one star or known planet. "
    "The address of an answer is its question: share it.",
    ETC.canonical,
    etc_form,
    _etc,
    results.EtcResult,
    lambda pairs, name: etc_answer(pairs).figure,
    figures=("",),
    media=tuple(MEDIA),
    takes_files=True,
)


# The ranking.


@functools.lru_cache(maxsize=16)
def ranking(pairs: Pairs) -> results.RankResult:
    """Return the ranking of an address; the last ones are kept, and filters choose from the kept ranking of all stars.

    Cuts (``v_mag_max``, ``dwarfs_only``, ``singles_only``) rank anew: they say which stars are ranked at all, so that
    the rank in the catalogue and the hash are others, and with another number of stars at once the last digits are.

    Raises
    ------
    InputError
        As `etc_answer`.
    """
    with queries.called_as(RANK.names):
        ready = prepared(RANK.question(pairs))
        if ready.stars.chosen is None:
            return _whole_ranking(pairs)
        return ready.of_all(_whole_ranking(_without(pairs, *queries.FILTERS)))


@functools.lru_cache(maxsize=4)
def _kept_ranking(pairs: Pairs) -> results.RankResult:
    return prepared(RANK.question(pairs)).ranked()


def _whole_ranking(pairs: Pairs) -> results.RankResult:
    """Return the ranking of all stars; who asks while it is worked out waits for it."""
    with _RANKER:
        return _kept_ranking(pairs)


def rank_pairs(given: Sequence[tuple[str, str]]) -> Pairs:
    """Return the parameters of a ranking in order: those of the question, and the rows that are shown (``limit``).

    Raises
    ------
    InputError
        As `cpic_planner.web.addresses.Addresses.canonical`; and for rows that are no number from 1 to `MOST_ROWS`.
    """
    rest, limit = _one_of("limit", given)
    if limit and not (limit.isascii() and limit.isdecimal() and 1 <= int(limit[:6]) <= MOST_ROWS):
        raise InputError("limit", limit[:40], allowed=f"1 to {MOST_ROWS}")
    return (*RANK.canonical(rest), *((("limit", limit),) if limit else ()))


def _rows(pairs: Pairs) -> int:
    return int(dict(pairs).get("limit", DEFAULT_ROWS))


def _rank(pairs: Pairs, submission: Submission | None) -> Answer:
    asked = _without(pairs, "limit")
    if submission is None:
        result = ranking(asked)
    else:
        with _question(RANK, asked, submission) as question:
            result = prepared(question).ranked()
    return Answer(RANK_PAGE.title, result, partial(_rank_blocks, result, pairs, submission))


def _rank_figure(pairs: Pairs, name: str) -> Callable[[], Figure]:
    return partial(report.rank_figure, ranking(_without(pairs, "limit")), min(_rows(pairs), report.MOST_STARS))


def _rank_blocks(result: results.RankResult, pairs: Pairs, submission: Submission | None) -> list[report.Block]:
    asked, limit = _without(pairs, "limit"), _rows(pairs)
    blocks = list(report.rank_blocks(result, limit=limit, full=False))
    if result.targets:
        alt = f"Scores of the first {min(limit, len(result.targets), report.MOST_STARS)} stars"
        place = address(RANK_PAGE.drawing("", "svg"), asked, limit=str(limit)) if submission is None else ""
        blocks += figure_blocks(place, partial(report.rank_figure, result, limit), alt, f"{alt}.")
    blocks += notes_blocks(result.notes)
    return blocks + elsewhere([f"{RANK.command_line(asked)} --limit {limit}"], cited(result))


RANK_PAGE = Page(
    RANK.page,
    "CPI-C priorities",
    "Which stars promise most planets per hour of telescope time, among 1077 nearby ones.",
    rank_pairs,
    rank_form,
    _rank,
    results.RankResult,
    _rank_figure,
    figures=("",),
    media=tuple(MEDIA),
    takes_files=True,
    answers_all=True,
)


# Pages of few fields.


_NO_FIELD = Field("", "", "")


def _few_pairs(fields: Mapping[str, Field], given: Sequence[tuple[str, str]]) -> Pairs:
    """Return the parameters of a page of few fields in order, without empty ones.

    Raises
    ------
    InputError
        For an unknown parameter, one that is given twice, or a value that is too long or none of the choices.
    """
    for name, text in given:
        if name not in fields:
            raise InputError(name[:40], "given", allowed=", ".join(fields))
        if len(text) > 100 or not text.isprintable():
            raise InputError(name, f"{len(text)} characters", allowed="at most 100 printable ones")
        if fields[name].choices and text not in ("", *fields[name].choices):
            raise InputError(name, text[:40], allowed=" or ".join(fields[name].choices))
        if sum(key == name for key, _ in given) > 1:
            raise InputError(name, "given twice", allowed="once")
    values = {name: text for name, text in given if text}
    return tuple((name, values[name]) for name in fields if name in values)


def _few_fields(
    fields: Mapping[str, Field], given: Sequence[tuple[str, str]], error: InputError | None, *, other: str = ""
) -> tuple[Field, ...]:
    """Return the fields of such a page, with what is filled in and what is wrong; ``other`` takes all other errors."""
    values = {name: text for name, text in given if text and fields.get(name, _NO_FIELD).kind != "file"}
    wrong = "" if error is None else error.key if error.key in fields else other
    return tuple(
        replace(field, values=(values[name],) if name in values else (), error=str(error) if name == wrong else "")
        for name, field in fields.items()
    )


# A star: when it is seen, its known planets and their next windows, its priority, and what is missing.


_YEARS = 5.0
"""How far known planets are followed."""
_DATE = "First day of the seasons and windows. Without: the mission's start."
_STAR_FIELDS = {
    "name": Field("name", "Star or known planet", "A star by any of its names.", example="tau Cet, HIP 8102, 61 Cyg A"),
    "date_utc": Field("date_utc", "From (UTC)", _DATE, example="2028-06-01"),
}


def _star_form(given: Sequence[tuple[str, str]], error: InputError | None = None) -> Form:
    rest = "" if error is None or error.key in _STAR_FIELDS else str(error)
    return Form(STAR.path, (Group("Which star", _few_fields(_STAR_FIELDS, given, error)),), "Show", rest)


@functools.lru_cache(maxsize=1)
def _prepared() -> Prepared:
    return prepared(queries.RankQuestion())


@functools.lru_cache(maxsize=64)
@only_sent_files({})
def star_answer(pairs: Pairs) -> results.StarResult:
    """Return what is known of the star of an address; the last ones are kept.

    Raises
    ------
    InputError
        For an unknown star, or what is no date.
    """
    from cpic_planner.ranking import KnownChoice, explain_star
    from cpic_planner.ranking.known_answer import known_answer

    given = dict(pairs)
    if "name" not in given:
        raise InputError("name", "missing", allowed="a star")
    with queries.called_as({"target": "name", "star": "name", "epoch_utc": "date_utc"}):
        date = {"date_utc": given["date_utc"]} if "date_utc" in given else {}
        table = open_catalogue()
        star, note, _ = star_or_planet(queries.EtcQuestion.of({"target": given["name"]} | date), given["name"], table)
        name, ready = str(star.name[0]), _prepared()
        question = queries.KnownQuestion.of({"star": name} | date)
        utc = queries.observed_utc(question)
        rank = ranking(())
        explanation = known = None
        if any(row.name == name for row in rank.targets):
            stars = ready.stars.targets
            explanation = explain_star(ready.model, stars, name, rank=rank, **ready.asked)
        drawn: dict[str, Any] = {"n_draws": question.n_draws, "seed": question.seed}
        choice = KnownChoice.at("snapshot", utc, question.albedo, question.instrument, **drawn)
        if choice.table.listed_rows_of(name):
            known = known_answer(ready.model, star, choice, years=_YEARS, catalogue=table.provenance)
        seasons = visibility_of(queries.VisibilityQuestion.of({"target": name, "start_utc": utc}))
    told = {"name": name, "note": note, "date_utc": utc, "catalogue": table.provenance}
    found: dict[str, Any] = {"explanation": explanation, "known": known, "seasons": seasons}
    return results.StarResult.of(star, at=0, hip=int(star.hip[0]) or None, **told, **found)


def _followed(known: results.KnownResult | None) -> bool:
    """Return whether there is a known planet whose place is followed in time."""
    return known is not None and any(row.track is not None for row in known.planets)


def _star_figure(pairs: Pairs, name: str) -> Callable[[], Figure]:
    answer = star_answer(pairs)
    if name == "seasons":
        return partial(report.visibility_figure, answer.seasons)
    if answer.known is None or not _followed(answer.known):
        raise InputError("name", dict(pairs)["name"], allowed="a star with a planet that is counted")
    return partial(report.known_figure, answer.known)


def _star(pairs: Pairs, submission: Submission | None) -> Answer:
    answer = star_answer(pairs)
    return Answer(report.full_name(answer.name, answer.hip or 0), answer, partial(_star_blocks, answer, pairs))


def _star_blocks(answer: results.StarResult, pairs: Pairs) -> Iterator[report.Block]:
    yield from _facts(answer)
    yield report.Heading("Priority, and what is missing")
    yield from _priority(answer)
    yield report.Heading("Known planets")
    yield from _planets(answer, pairs)
    yield report.Heading("When it is seen")
    yield from report.visibility_blocks(answer.seasons)
    alt = f"Time per orbit in which {report.pretty_name(answer.name)} is seen, day by day, and the angles"
    yield report.Figure(report.Picture(address(STAR.drawing("seasons", "svg"), pairs), alt, f"{alt}."))
    quoted, start = f'"{answer.name}"', answer.date_utc[:10]
    commands = [f"cpic rank --explain {quoted}", f"cpic visibility {quoted} --start {start}"]
    if answer.known is not None:
        commands.append(f"cpic known {quoted} --date {start}")
    yield from elsewhere(commands, f"; {answer.catalogue}")


_STAR_FACTS = {
    "V": "{v_mag:.2f} mag",
    "Distance": "{distance_pc:.4g} pc",
    "Spectral type": "{sp_type}",
    "Temperature": "{teff_k:.0f} K",
    "Luminosity": "{luminosity_lsun:.3g} L☉",
    "Companion": "at {companion_separation_arcsec:.3g}″ on {date_utc}",
}


def _facts(star: results.StarResult) -> Iterator[report.Block]:
    if star.note:
        yield report.Paragraph(star.note, "note")
    yield report.Facts(report.facts_of(star, _STAR_FACTS), wide=False)
    target = address(ETC.page, [("target", star.name)])
    asked = [
        report.page_link(target, "SNR in ten hours"),
        report.page_link(f"{target}&detect=on", "time of a detection"),
        report.page_link(f"{target}&contrast_limit=on", "contrast limit"),
    ]
    yield report.Paragraph(["Ask the calculator: ", asked[0], ", ", asked[1], ", ", asked[2], "."])


def _priority(answer: results.StarResult) -> Iterator[report.Block]:
    why = answer.explanation
    if why is None:
        yield report.Paragraph("The ranking does not have this star: it ends at V 7.")
        return
    rank = ranking(())
    if why.star.tier is not None:
        yield report.Paragraph(f"Tier {why.star.tier}: {report.TIERS[why.star.tier]}.", "lead")
    yield from report.priority_blocks(rank, [why.star])
    yield from report.explanation_blocks(why)
    yield report.Paragraph(_velocities(answer.name, why.star))


def _velocities(name: str, row: results.RankedTarget) -> str:
    """Return what radial velocities say."""
    limit = velocity_limit(name)
    if limit is None:
        return "No published search by radial velocities excludes planets of this star."
    counted = f"{limit.n_velocities} velocities" if limit.n_velocities else "Velocities"
    lost = (row.completeness_unconditional or row.completeness) - row.completeness
    found = f"; what is known of the star excludes {lost:.2%} of the population that would be detected" * (lost > 0)
    reach = f"over {limit.baseline_years:.3g} years exclude planets out to {limit.reach_au:.3g} au"
    return f"{counted} {reach}{found}. {limit.reference}."


def _planets(answer: results.StarResult, pairs: Pairs) -> Iterator[report.Block]:
    known = answer.known
    if known is None:
        yield report.Paragraph("None is listed.")
        return
    if any(row.counted and row.windows for row in known.planets):
        yield from report.window_blocks(known)
    yield from report.known_blocks(known)
    if _followed(known):
        alt = f"Separation of the known planets of {report.pretty_name(answer.name)} against time, with the dark holes"
        yield report.Figure(report.Picture(address(STAR.drawing("planets", "svg"), pairs), alt, f"{alt}."))


STAR = Page(
    "/star",
    "A star for CPI-C",
    "When it is seen, its known planets and their next windows, its place among the priorities, and what a detection "
    "lacks.",
    partial(_few_pairs, _STAR_FIELDS),
    _star_form,
    _star,
    results.StarResult,
    _star_figure,
    figures=("seasons", "planets"),
)


# Two questions, which may be about two instruments: what differs in them and in what the calculator answers.


OTHER, SECOND = "other", "second"
_QUESTIONS = ("the first question", "the second question")
_LONGEST_SECOND = 2000
_FIRST = ("The first instrument", "Changes below are changes of this one.")
_OTHER = ("The other instrument", "What the first one is compared with; its values are as shipped.")
_SECOND_HINT = "What the second question has instead, as in an address; or the whole address of its answer."
_SECOND = Field(SECOND, "The second question", _SECOND_HINT, example="time_s=7200&bands=F662")


def _compare_form(given: Sequence[tuple[str, str]], error: InputError | None = None) -> Form:
    own = error is not None and error.key in (OTHER, SECOND)
    form = etc_form([pair for pair in given if pair[0] not in (OTHER, SECOND)], None if own else error)
    fields = {field.name: field for group in form.groups for field in group.fields}
    presets = {
        name: Field(name, *told, "choice", preset_names("instrument"))
        for name, told in (("instrument", _FIRST), (OTHER, _OTHER))
    }
    shown = _few_fields(presets | {SECOND: _SECOND}, given, error)
    which = Group("What is compared", (*shown[:2], fields["set"], shown[2]))
    kept = (
        replace(group, fields=tuple(item for item in group.fields if item.name not in ("instrument", "set")))
        for group in form.groups
    )
    return Form(COMPARE.path, (which, *kept), "Compare", form.error)


def _compare_pairs(given: Sequence[tuple[str, str]]) -> Pairs:
    """Return the parameters of an address in order: the first question, the other instrument, the second question."""
    rest, other = _one_of(OTHER, given)
    rest, second = _one_of(SECOND, rest)
    if other and other not in preset_names("instrument") and not was_sent(other):
        raise InputError(OTHER, "another word", allowed=", ".join(preset_names("instrument")))
    if len(second) > _LONGEST_SECOND or not second.isprintable():
        raise InputError(SECOND, f"{len(second)} characters", allowed=f"at most {_LONGEST_SECOND} printable ones")
    with _of_second(second):
        told = urlencode(ETC.canonical(parse_qsl(second.rpartition("?")[2].strip(), strict_parsing=bool(second))))
    named = [(name, text) for name, text in ((OTHER, other), (SECOND, told)) if text]
    return (*ETC.canonical(rest), *named)


@contextlib.contextmanager
def _of_second(text: str) -> Iterator[None]:
    """Let refusals of the body name the second question."""
    try:
        yield
    except InputError as error:
        raise InputError(SECOND, text, allowed="a question that can be answered", hint=str(error)) from None
    except ValueError:
        raise InputError(SECOND, text, allowed="NAME=VALUE&NAME=VALUE, or the address of an answer") from None


def _second_pairs(pairs: Pairs) -> Pairs:
    """Return the second question: whole where it names a star, else the first one with what it has instead."""
    names, first = dict(pairs), _without(pairs, OTHER, SECOND)
    own = tuple(parse_qsl(names.get(SECOND, "")))
    if {"target", "v_mag"} & dict(own).keys():
        first = ()
    elif OTHER in names or not own:
        first = _without(first, "instrument", "set")
    other = (("instrument", names[OTHER]),) if OTHER in names and "instrument" not in dict(own) else ()
    return ETC.canonical((*_without(first, *dict(own)), *other, *own))


def _compare(pairs: Pairs, submission: Submission | None) -> Answer:
    """Return two questions with the answers of both where they name a star, else two instruments alone."""
    both, names = (_without(pairs, OTHER, SECOND), _second_pairs(pairs)), dict(pairs)
    star = "target" in names or "v_mag" in names
    if SECOND in names and not star:
        raise InputError("target", "missing", allowed="a star in the first question")
    with queries.called_as(ETC.names):
        first = ETC.question(both[0] if star else (*both[0], ("target", "tau Cet")))
    with queries.called_as(ETC.names), _of_second(names[SECOND]) if SECOND in names else contextlib.nullcontext():
        second = ETC.question(both[1] if star else (*both[1], ("target", "tau Cet")))
    if submission is not None and submission.files:
        check_shipped(first.instrument, first.band_names())
        check_shipped(second.instrument, second.band_names(), OTHER)
    title = f"{queries.instrument_title(first.instrument)} beside {queries.instrument_title(second.instrument)}"
    rows = queries.instrument_rows(first.instrument, other=second.instrument)
    differing = results.InstrumentResult(title=title, values=rows)
    found = tuple(map(answered, (first, second))) if star else ()
    labels = _QUESTIONS
    if SECOND not in names:
        labels = (first.instrument.name, second.instrument.name)
        if labels[0] == labels[1]:
            labels = (f"{labels[0]}, first", f"{labels[1]}, other")
    answers = [answer.result for answer in found]
    compared = compared_answers(*map(Compared, labels, answers)) if found else None
    result = results.TwoInstrumentsResult(differences=differing, answers=answers, comparison=compared)
    heading = f"{names.get('instrument', 'cpic_default')} beside {names.get(OTHER, 'cpic_default')}"
    if SECOND in names:
        heading = "Two questions to the calculator"

    def blocks() -> Iterator[report.Block]:
        yield from _differences(result, labels, found)
        yield from _same_comparison(pairs, both if star else ())

    return Answer(heading, result, lambda: list(blocks()))


def _differences(
    result: results.TwoInstrumentsResult, labels: tuple[str, str], answers: Sequence[Answered]
) -> Iterable[report.Block]:
    values, compared, noun = result.differences, result.comparison, "question"
    if labels != _QUESTIONS:
        noun = "instrument"
    elif compared is not None:
        yield report.Paragraph(compared.statement, "lead")
    if values.values:
        yield from report.instrument_blocks(values, "key value other unit")
    elif noun == "instrument":
        yield report.Paragraph(f"{values.title}: the same in every value.")
    if compared is None:
        yield report.Paragraph("With a star below, both answer the same question.", "note")
        return
    both = list(zip(labels, answers, strict=True))
    yield from report.both_blocks([(name, answer.result) for name, answer in both], noun)
    yield report.Fold("All values that differ", list(report.comparison_blocks(compared)))
    for name, answer in both:
        yield report.Fold(f"All that {name} answers", list(answer.blocks()))


def _same_comparison(pairs: Pairs, both: Sequence[Pairs]) -> list[report.Block]:
    names = dict(pairs)
    commands = []
    if SECOND not in names:
        words = ["cpic instrument diff", names.get("instrument", "cpic_default"), names.get(OTHER, "cpic_default")]
        commands = [" ".join([*words, *(f"--set {text}" for name, text in pairs if name == "set")])]
    lines = [ETC.command_line(one) for one in both]
    if SECOND in names:
        files = ("first.json", "second.json")
        lines = [f"{line} --json > {file}" for line, file in zip(lines, files, strict=True)]
        lines.append(f"cpic compare {' '.join(files)}")
    return elsewhere([*commands, *lines])


COMPARE = Page(
    "/compare",
    "Two questions for CPI-C",
    "What differs in what the calculator answers to two questions, which may be about two instruments, and why.",
    _compare_pairs,
    _compare_form,
    _compare,
    results.TwoInstrumentsResult,
    takes_files=True,
)


# What the columns of a table that is sent are taken for, in the words of ``cpic catalog columns``.


_TABLE, _KIND = "table", "as"
_KIND_HINT = "A table of stars or of planets; by default each kind that it can be."
_TABLE_HINT = "Stars or planets, in any format that tables are read in. It is not kept."
_COLUMNS_FIELDS = {
    _TABLE: Field(_TABLE, "Table, at most 2 MB", _TABLE_HINT, "file"),
    _KIND: Field(_KIND, "Taken as", _KIND_HINT, "choice", ("stars", "planets")),
}


def _columns_form(given: Sequence[tuple[str, str]], error: InputError | None = None) -> Form:
    fields = _few_fields(_COLUMNS_FIELDS, given, error, other=_TABLE)
    return Form(COLUMNS.path, (Group("A table of your own", fields),), "Show its columns", method="post")


def _columns(pairs: Pairs, submission: Submission | None) -> Answer:
    given: dict[str, Any] = dict(pairs)
    if submission is None or given.get(_TABLE) not in submission.files:
        raise InputError(_TABLE, "missing", allowed="a file that is sent with the form")
    result = results.ColumnsResult.of_files(table_readings(given[_TABLE], given.get(_KIND)))
    command = f"cpic catalog columns {result.file}{f' --as {given[_KIND]}' if _KIND in given else ''}"
    return Answer(
        f"Columns of {given[_TABLE]}", result, lambda: [*report.columns_blocks(result), *elsewhere([command], None)]
    )


COLUMNS = Page(
    "/columns",
    "Columns of a table",
    "What the columns of a table of your own are taken for, and which of its rows can be used.",
    partial(_few_pairs, _COLUMNS_FIELDS),
    _columns_form,
    _columns,
    results.ColumnsResult,
    takes_files=True,
)

PAGES = (ETC_PAGE, RANK_PAGE, STAR, COMPARE, COLUMNS)
"""Pages that answer a question at once."""
