"""A page a star: when it is seen, its known planets and their next windows, its priority, and what is missing."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from urllib.parse import urlencode

from catalogs import open_catalogue, velocity_limit
from cpic_core import InputError, only_sent_files
from cpic_planner import report
from cpic_planner.api import prepared, visibility_of
from cpic_planner.api.one_star import star_or_planet
from cpic_planner.queries import EtcQuestion, KnownQuestion, RankQuestion, VisibilityQuestion, called_as, observed_utc
from cpic_planner.results import Explanation, KnownResult, RankedTarget, Result, StarResult, VisibilityResult
from cpic_planner.targets import Targets
from cpic_planner.version import __version__
from cpic_planner.web import answers
from cpic_planner.web.asking import ETC, Pairs
from cpic_planner.web.blocks import blocks_of
from cpic_planner.web.forms import Field, Form, Group

if TYPE_CHECKING:
    from cpic_planner.api.runs import Prepared

PAGE, FIGURES = "/star", ("seasons", "planets")
_YEARS = 5.0
"""How far known planets are followed."""
_ASKED = {
    "name": ("Star or known planet", "A star by any of its names.", "tau Cet, HIP 8102, 61 Cyg A"),
    "date_utc": ("From (UTC)", "First day of the seasons and windows. Without: the mission's start.", "2028-06-01"),
}


@dataclass(frozen=True)
class View:
    """A page about something that is no question of a command.

    Attributes
    ----------
    path, title, about : str
    pairs : callable
        Parameters of an address in order, without empty ones, as `star_pairs`.
    form : callable
        The form, as `star_form`.
    blocks : callable
        The answer, as `star_blocks`.
    result : callable
        The same as data, as `star_result`.
    heading : callable
        Title of an answer.
    takes_files : bool
        Whether files may be sent with it; ``blocks`` and ``result`` take them second.
    """

    path: str
    title: str
    about: str
    pairs: Callable[[Sequence[tuple[str, str]]], Pairs]
    form: Callable[[Sequence[tuple[str, str]], InputError | None], Form]
    blocks: Callable[..., list[report.Block]]
    result: Callable[..., Result]
    heading: Callable[[Pairs], str]
    takes_files: bool = False


def star_form(given: Sequence[tuple[str, str]], error: InputError | None = None) -> Form:
    """Return the form that asks for a star; parameters as of `cpic_planner.web.forms.etc_form`."""
    values, key = dict(given), "" if error is None else error.key
    fields = tuple(
        Field(name, label, hint, "text", (), (values[name],) if values.get(name) else (), wrong, example)
        for name, (label, hint, example) in _ASKED.items()
        for wrong in (str(error) if key == name else "",)
    )
    return Form(PAGE, (Group("Which star", fields),), "Show", "" if key in ("", *_ASKED) else str(error))


def star_pairs(given: Sequence[tuple[str, str]]) -> Pairs:
    """Return the parameters of an address in order, without empty ones.

    Raises
    ------
    InputError
        For an unknown parameter, one that is given twice, or a value that is too long.
    """
    for name, text in given:
        if name not in _ASKED:
            raise InputError(name[:40], "given", allowed=", ".join(_ASKED))
        if len(text) > 100 or not text.isprintable():
            raise InputError(name, f"{len(text)} characters", allowed="at most 100 printable ones")
        if sum(key == name for key, _ in given) > 1:
            raise InputError(name, "given twice", allowed="once")
    values = {name: text for name, text in given if text}
    return tuple((name, values[name]) for name in _ASKED if name in values)


@dataclass(frozen=True, eq=False)
class StarAnswer:
    """The facts about a star.

    Attributes
    ----------
    star : Targets
        At the date.
    note : str
        On the name that was given.
    date_utc, catalogue : str
    explanation : Explanation or None
        Why it stands where it stands in the ranking; None where it is not ranked.
    known : KnownResult or None
        None where there are no known planets.
    seasons : VisibilityResult
    """

    star: Targets
    note: str
    date_utc: str
    catalogue: str
    explanation: Explanation | None
    known: KnownResult | None
    seasons: VisibilityResult

    @property
    def name(self) -> str:
        """Name in the table."""
        return str(self.star.name[0])


@functools.lru_cache(maxsize=1)
def _prepared() -> Prepared:
    return prepared(RankQuestion())


@functools.lru_cache(maxsize=64)
@only_sent_files({})
def star_answer(pairs: Pairs) -> StarAnswer:
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
    with called_as({"target": "name", "star": "name", "epoch_utc": "date_utc"}):
        date = {"date_utc": given["date_utc"]} if "date_utc" in given else {}
        table = open_catalogue()
        star, note, _ = star_or_planet(EtcQuestion.of({"target": given["name"]} | date), given["name"], table)
        name, ready = str(star.name[0]), _prepared()
        question = KnownQuestion.of({"star": name} | date)
        utc = observed_utc(question)
        rank = answers.ranking(())
        explanation = None
        if any(row.name == name for row in rank.targets):
            stars = ready.stars.targets
            explanation = explain_star(ready.model, stars, name, rank=rank, **ready.asked)
        drawn: dict[str, Any] = {"n_draws": question.n_draws, "seed": question.seed}
        choice = KnownChoice.at("snapshot", utc, question.albedo, question.instrument, **drawn)
        known = None
        if choice.table.listed_rows_of(name):
            known = known_answer(ready.model, star, choice, years=_YEARS, catalogue=table.provenance)
        seasons = visibility_of(VisibilityQuestion.of({"target": name, "start_utc": utc}))
    return StarAnswer(star, note, utc, table.provenance, explanation, known, seasons)


@functools.lru_cache(maxsize=32)
def star_figure(pairs: Pairs, which: str, form: answers.FigureForm) -> bytes:
    """Return a figure of a star; the last ones are kept.

    Parameters
    ----------
    pairs : sequence of (str, str)
    which : {"seasons", "planets"}
    form : str
        As of `cpic_planner.web.answers.drawn`.

    Raises
    ------
    InputError
        As `star_answer`; and for the planets of a star that has none.
    """
    answer = star_answer(pairs)
    if which == "seasons":
        return answers.drawn(functools.partial(report.visibility_figure, answer.seasons), form)
    if answer.known is None or not _followed(answer.known):
        raise InputError("name", dict(pairs)["name"], allowed="a star with a planet that is counted")
    return answers.drawn(functools.partial(report.known_figure, answer.known), form)


def _followed(known: KnownResult) -> bool:
    return any(row.track is not None for row in known.planets)


def star_blocks(pairs: Pairs) -> list[report.Block]:
    """Return what is known of the star of an address as blocks of a page."""
    answer = star_answer(pairs)
    return [*_star(answer), *_priority(answer), *_planets(answer, pairs), *_seasons(answer, pairs), *_same(answer)]


def star_result(pairs: Pairs) -> StarResult:
    """Return what is known of the star of an address as a result."""
    answer = star_answer(pairs)
    return StarResult.of(answer, answer.star, at=0, hip=int(answer.star.hip[0]) or None)


def _star(answer: StarAnswer) -> Iterator[report.Block]:
    star = answer.star
    if answer.note:
        yield report.Paragraph(answer.note, "note")
    target = ETC.address([("target", answer.name)])
    asked = [
        report.page_link(target, "SNR in ten hours"),
        report.page_link(f"{target}&detect=on", "time of a detection"),
        report.page_link(f"{target}&contrast_limit=on", "contrast limit"),
    ]
    companion = float(star.companion_separation_arcsec[0])
    facts: list[tuple[Any, Any]] = [
        ("V", f"{star.v_mag[0]:.2f} mag"),
        ("Distance", f"{star.distance_pc[0]:.4g} pc"),
        ("Spectral type", str(star.sp_type[0]) or "not known"),
        ("Temperature", f"{star.teff_k[0]:.0f} K"),
        ("Luminosity", f"{star.luminosity_lsun[0]:.3g} L☉"),
        (
            "Companion",
            "none that counts" if companion != companion else f"at {companion:.3g}″ on {answer.date_utc[:10]}",
        ),
    ]
    yield report.Facts(facts, wide=False)
    yield report.Paragraph(["Ask the calculator: ", asked[0], ", ", asked[1], ", ", asked[2], "."])


def _priority(answer: StarAnswer) -> Iterator[report.Block]:
    yield report.Heading("Priority, and what is missing")
    why = answer.explanation
    if why is None:
        yield report.Paragraph("The ranking does not have this star: it ends at V 7.")
        return
    rank = answers.ranking(())
    if why.star.tier is not None:
        yield report.Paragraph(f"Tier {why.star.tier}: {report.TIERS[why.star.tier]}.", "lead")
    yield from report.priority_blocks(rank, [why.star])
    yield from blocks_of(functools.partial(report.print_explanation, why))
    yield from _velocities(answer.name, why.star)


def _velocities(name: str, row: RankedTarget) -> Iterator[report.Block]:
    """Yield what radial velocities say."""
    limit = velocity_limit(name)
    if limit is None:
        yield report.Paragraph("No published search by radial velocities excludes planets of this star.")
        return
    counted = f"{limit.n_velocities} velocities" if limit.n_velocities else "Velocities"
    lost = (row.completeness_unconditional or row.completeness) - row.completeness
    found = f"; what is known of the star excludes {lost:.2%} of the population that would be detected" * (lost > 0)
    yield report.Paragraph(
        f"{counted} over {limit.baseline_years:.3g} years exclude planets out to {limit.reach_au:.3g} au{found}. "
        f"{limit.reference}."
    )


def _planets(answer: StarAnswer, pairs: Pairs) -> Iterator[report.Block]:
    yield report.Heading("Known planets")
    known = answer.known
    if known is None:
        yield report.Paragraph("None is listed.")
        return
    if any(row.counted and row.windows for row in known.planets):
        yield from report.known_blocks(known)
    yield from blocks_of(functools.partial(report.print_known, known))
    if _followed(known):
        alt = f"Separation of the known planets of {report.pretty_name(answer.name)} against time, with the dark holes"
        yield report.Figure(report.Picture(_address(pairs, "planets"), alt, f"{alt}."))


def _seasons(answer: StarAnswer, pairs: Pairs) -> Iterator[report.Block]:
    yield report.Heading("When it is seen")
    yield from blocks_of(functools.partial(report.print_visibility, answer.seasons))
    alt = f"Time per orbit in which {report.pretty_name(answer.name)} is seen, day by day, and the angles"
    yield report.Figure(report.Picture(_address(pairs, "seasons"), alt, f"{alt}."))


def _address(pairs: Pairs, which: str) -> str:
    return f"{PAGE}/{which}.svg?{urlencode(pairs)}"


def _same(answer: StarAnswer) -> list[report.Block]:
    quoted, start = f'"{answer.name}"', answer.date_utc[:10]
    commands = [f"cpic rank --explain {quoted}", f"cpic visibility {quoted} --start {start}"]
    if answer.known is not None:
        commands.append(f"cpic known {quoted} --date {start}")
    cited = f"cpic-planner {__version__}; {answer.catalogue}"
    facts: list[tuple[Any, Any]] = [("Commands", report.lines(*map(report.code, commands))), ("To cite", cited)]
    return [report.Heading("The same elsewhere"), report.Facts(facts)]


STAR = View(
    PAGE,
    "A star for CPI-C",
    "When it is seen, its known planets and their next windows, its place among the priorities, and what a detection "
    "lacks.",
    star_pairs,
    star_form,
    star_blocks,
    star_result,
    lambda pairs: report.full_name(star_answer(pairs).name, int(star_answer(pairs).star.hip[0])),
)
"""The page a star."""
