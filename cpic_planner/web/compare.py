"""Two instruments compared: the values in which they differ, and what the calculator answers with each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from cpic_core import InputError, was_sent
from cpic_planner import report
from cpic_planner.api import Answered, answered
from cpic_planner.queries import called_as, instrument_rows, instrument_title, read_instrument
from cpic_planner.results import InstrumentResult, TwoInstrumentsResult
from cpic_planner.version import __version__
from cpic_planner.web.asking import ETC, Pairs
from cpic_planner.web.blocks import blocks_of
from cpic_planner.web.forms import Field, Form, Group, etc_form
from cpic_planner.web.sent import Sent, check_shipped
from cpic_planner.web.star import View
from simulator.config import preset_names

PAGE, OTHER = "/compare", "other"
_OTHER = ("The other instrument", "What the first one is compared with; its values are as shipped.")
_FIRST = ("The first instrument", "Changes below are changes of this one.")


def _choice(name: str, told: tuple[str, str], given: str, error: str) -> Field:
    return Field(name, *told, "choice", preset_names("instrument"), (given,) if given else (), error, "")


def compare_form(given: Sequence[tuple[str, str]], error: InputError | None = None) -> Form:
    """Return the form of two instruments and a question; parameters as of `cpic_planner.web.forms.etc_form`."""
    values, wrong = dict(given), ""
    if error is not None and error.key == OTHER:
        wrong, error = str(error), None
    form = etc_form([(name, text) for name, text in given if name != OTHER], error)
    fields = {field.name: field for group in form.groups for field in group.fields}
    first = _choice("instrument", _FIRST, values.get("instrument", ""), fields["instrument"].error)
    other = _choice(OTHER, _OTHER, values.get(OTHER, ""), wrong)
    which = Group("Which instruments", (first, other, fields["set"]))
    kept = (
        Group(group.title, tuple(item for item in group.fields if item.name not in ("instrument", "set")), group.folded)
        for group in form.groups
    )
    return Form(PAGE, (which, *kept), "Compare", form.error)


def compare_pairs(given: Sequence[tuple[str, str]]) -> Pairs:
    """Return the parameters of an address in order: those of the calculator, and the other instrument.

    Raises
    ------
    InputError
        As `cpic_planner.web.asking.Asking.canonical`; and for another instrument that is none.
    """
    others = [text for name, text in given if name == OTHER and text]
    if len(others) > 1:
        raise InputError(OTHER, f"{len(others)} values", allowed="one value")
    for text in others:
        if text not in preset_names("instrument") and not was_sent(text):
            raise InputError(OTHER, "another word", allowed=", ".join(preset_names("instrument")))
    return (*ETC.canonical((name, text) for name, text in given if name != OTHER), *((OTHER, text) for text in others))


@dataclass(frozen=True, eq=False)
class Compared:
    """Two instruments, and what they answer.

    Attributes
    ----------
    names : tuple of str
        What they are called beside each other.
    result : TwoInstrumentsResult
    answers : tuple of Answered
        Of both; none where no star is given.
    """

    names: tuple[str, str]
    result: TwoInstrumentsResult
    answers: tuple[Answered, ...]


def compared(pairs: Pairs, sent: Sent | None = None) -> Compared:
    """Return two instruments, and a question answered with each where one names a star.

    Parameters
    ----------
    pairs : sequence of (str, str)
        As `compare_pairs` makes them.
    sent : Sent, optional
        Files that came with it.
    """
    asked = tuple(pair for pair in pairs if pair[0] != OTHER)
    names = dict(pairs)
    star = "target" in names or "v_mag" in names
    with called_as(ETC.names):
        question = ETC.question(asked if star else (*asked, ("target", "tau Cet")))
    first, other = question.instrument, read_instrument(names.get(OTHER))
    bands = question.band_names()
    if sent is not None and sent.files:
        check_shipped(first, bands)
        check_shipped(other, question.bands or other.visible_bands(), OTHER)
    title = f"{instrument_title(first)} beside {instrument_title(other)}"
    differing = InstrumentResult(title=title, values=instrument_rows(first, other=other))
    both = (question, question.model_copy(update={"instrument": other})) if star else ()
    found = tuple(map(answered, both))
    result = TwoInstrumentsResult(differences=differing, answers=[answer.result for answer in found])
    return Compared(_labels(first.name, other.name), result, found)


def compare_result(pairs: Pairs, sent: Sent | None = None) -> TwoInstrumentsResult:
    """Return what `compared` says as a result; parameters as there."""
    return compared(pairs, sent).result


def compare_blocks(pairs: Pairs, sent: Sent | None = None) -> list[report.Block]:
    """Return what `compared` says as blocks of a page; parameters as there."""
    found = compared(pairs, sent)
    differing = found.result.differences
    blocks = blocks_of(partial(report.print_instrument, differing, "key value other unit"))
    if not differing.values:
        blocks = [report.Paragraph(f"{differing.title}: the same in every value.")]
    if not found.answers:
        return [*blocks, report.Paragraph("With a star below, both answer the same question.", "note"), *_same(pairs)]
    both = list(zip(found.names, found.answers, strict=True))
    blocks += blocks_of(partial(report.print_both, [(name, answer.result) for name, answer in both]))
    blocks += [report.Fold(f"All that {name} answers", blocks_of(answer.print)) for name, answer in both]
    return [*blocks, *_same(pairs)]


def _labels(first: str, other: str) -> tuple[str, str]:
    return (first, other) if first != other else (f"{first}, first", f"{other}, other")


def _same(pairs: Pairs) -> list[report.Block]:
    asked = [(name, text) for name, text in pairs if name in ("instrument", "set")]
    names = dict(pairs)
    words = ["cpic instrument diff", names.get("instrument", "cpic_default"), names.get(OTHER, "cpic_default")]
    words += [f"--set {text}" for name, text in asked if name == "set"]
    commands = [report.code(" ".join(words))]
    question = tuple(pair for pair in pairs if pair[0] not in (OTHER, "instrument", "set"))
    if any(name in ("target", "v_mag") for name, _ in question):
        first = tuple(pair for pair in pairs if pair[0] != OTHER)
        second = (*question, ("instrument", names[OTHER])) if OTHER in names else question
        commands += [report.code(ETC.command_line(one)) for one in (first, second)]
    facts: list[tuple[Any, Any]] = [("Commands", report.lines(*commands)), ("To cite", f"cpic-planner {__version__}")]
    return [report.Heading("The same elsewhere"), report.Facts(facts)]


COMPARE = View(
    PAGE,
    "Two instruments for CPI-C",
    "The values in which two instruments differ, and what the calculator answers with each.",
    compare_pairs,
    compare_form,
    compare_blocks,
    compare_result,
    lambda pairs: f"{dict(pairs).get('instrument', 'cpic_default')} beside {dict(pairs).get(OTHER, 'cpic_default')}",
    takes_files=True,
)
"""The page of two instruments."""
