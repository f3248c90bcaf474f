"""Pages: what one is about, its form, its answer as the command line says it, its figures, and the same elsewhere."""

from __future__ import annotations

import base64
import functools
import hashlib
import json
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from pydantic import BaseModel
from starlette.exceptions import HTTPException
from starlette.responses import JSONResponse, Response

from cpic_core import InputError, Record, dump_json
from cpic_planner import report
from cpic_planner.results import Result
from cpic_planner.version import __version__
from cpic_planner.web.addresses import Pairs, Submission, address
from cpic_planner.web.forms import Form, own_form
from cpic_planner.web.guard import line

if TYPE_CHECKING:
    from jinja2 import Environment
    from matplotlib.figure import Figure

MEDIA = {
    "json": "application/json",
    "csv": "text/csv; charset=utf-8",
    "ecsv": "text/plain; charset=utf-8",
    "latex": "text/plain; charset=utf-8",
    "markdown": "text/plain; charset=utf-8",
}
"""Media type of each form of an answer beside the page."""
_NAMES = {"latex": "LaTeX", "markdown": "Markdown"}
FigureForm: TypeAlias = Literal["svg", "png", "values"]
FIGURE_MEDIA: dict[FigureForm, str] = {"svg": "image/svg+xml", "png": "image/png", "values": "text/html; charset=utf-8"}
"""Media type of each form of a figure; its values are a page of tables."""
_PENCIL = threading.Lock()
"""Matplotlib's settings are those of the process: one figure is drawn at a time."""


class Problem(BaseModel):
    """An error in a question, for programs."""

    schema_version: Literal[1] = 1
    kind: Literal["error"] = "error"
    type: Literal["invalid_input"] = "invalid_input"
    parameter: str
    value: str
    unit: str
    allowed: str
    hint: str
    message: str

    @classmethod
    def of(cls, error: InputError) -> Problem:
        """Return the problem that a refusal states."""
        texts = {name: getattr(error, name) for name in ("unit", "allowed", "hint")}
        return cls(parameter=error.key, value=str(error.value)[:200], message=str(error), **texts)


class Answer(Record, eq=False):
    """The answer of a page to its parameters.

    Attributes
    ----------
    title : str
    result : Result
    blocks : callable
        Returns the answer as blocks of the page; its first table has other forms than JSON.
    """

    title: str
    result: Result
    blocks: Callable[[], Iterable[report.Block]]

    def text(self, form: str) -> str:
        """Return the answer in a form of `MEDIA`, to the byte as the command line prints it."""
        if form == "json":
            return dump_json(self.result.model_dump(mode="json"))
        table = report.first_table(self.blocks())
        if table is None:
            raise InputError("format", form, allowed="html or json: this answer has no table")
        return report.form_text(form, self.result, table)


class Page(Record, eq=False):
    """A page that answers a question.

    Attributes
    ----------
    path, title, about : str
    pairs : callable
        Returns the parameters of an address in order, without empty ones; refuses others.
    form : callable
        Returns the form, with what is filled in and what is wrong with it.
    answer : callable
        Returns the `Answer` to such parameters and, where files may be sent with it, to these.
    result : type of Result
        Kind of the answer as data.
    figure : callable, optional
        Returns what draws the figure of a name, for such parameters.
    figures : tuple of str
        Names of the figures; empty for the only one.
    media : tuple of str
        Forms of the answer beside the page, of `MEDIA`.
    takes_files : bool
        Whether files may be sent with it.
    answers_all : bool
        Whether it answers without parameters; else it is its form then.
    """

    path: str
    title: str
    about: str
    pairs: Callable[[Sequence[tuple[str, str]]], Pairs]
    form: Callable[[Sequence[tuple[str, str]], InputError | None], Form]
    answer: Callable[[Pairs, Submission | None], Answer]
    result: type[Result]
    figure: Callable[[Pairs, str], Callable[[], Figure]] | None = None
    figures: tuple[str, ...] = ()
    media: tuple[str, ...] = ("json",)
    takes_files: bool = False
    answers_all: bool = False

    @functools.cached_property
    def has_own(self) -> bool:
        """Whether it has a second form, which takes files."""
        return self.takes_files and not self.form((), None).sends

    def drawing(self, name: str, form: str) -> str:
        """Return the path of a figure."""
        return f"{self.path}{'/' * bool(name)}{name}.{form}"

    def sources(self, pairs: Pairs) -> list[tuple[str, str]]:
        """Return links to an answer in other forms, as (name, address)."""
        found = [(_NAMES.get(form, form.upper()), address(self.path, pairs, format=form)) for form in self.media]
        drawn = ("png", "svg") if self.figures == ("",) else ()
        return [*found, *((form.upper(), address(self.drawing("", form), pairs)) for form in drawn)]

    def asked(self, given: Sequence[tuple[str, str]], error: InputError | None = None, *, sends: bool = False) -> str:
        """Return the page without an answer; ``sends`` is the form that takes files."""
        made = self.form(given, error)
        own = f"{self.path}/own" if self.has_own and not given and not sends else ""
        return page(self.title, self.about, own_form(made) if sends else made, own=own)

    def answered(self, answer: Answer, pairs: Pairs, submission: Submission | None) -> str:
        """Return the page of an answer, with the files that were sent with the question."""
        form = self.form(pairs, None)
        if submission is not None:
            return page(answer.title, self.about, own_form(form), [*answer.blocks(), *_sent_blocks(submission)])
        own = address(f"{self.path}/own", pairs) if self.has_own else ""
        return page(answer.title, self.about, form, list(answer.blocks()), self.sources(pairs), own)


def html(text: str, status: int = 200, headers: Mapping[str, str] | None = None) -> Response:
    """Return a page as an answer."""
    return Response(text, status, media_type="text/html; charset=utf-8", headers=headers)


def data(model: BaseModel, status: int = 200) -> Response:
    """Return a model as an answer, in JSON."""
    return JSONResponse(model.model_dump(mode="json"), status)


def refused(error: InputError, form: str, page: Callable[[], str]) -> Response:
    """Answer bad input: with a page, its parts in JSON, or one line, by the form of the answer that was asked for."""
    if form == "json":
        return data(Problem.of(error), 400)
    return line(str(error), 400) if form else html(page(), 400)


def page_or_json(form: str) -> bool:
    """Return whether data is asked for instead of a page, by the parameter ``format``.

    Raises
    ------
    HTTPException
        For another form, with the line that refuses it.
    """
    if form not in ("", "html", "json"):
        raise HTTPException(400, str(InputError("format", form[:40], allowed="html or json")))
    return form == "json"


def _templates() -> Environment:
    return report.templates("cpic_planner.web", "cpic_planner.report", star_page="/star")


@functools.lru_cache(maxsize=1)
def style_sheet() -> bytes:
    """Return the style of all pages: that of the reports, and that of forms."""
    environment = _templates()
    return "".join(environment.get_template(name).render() for name in ("plan.css", "web.css")).encode()


@functools.lru_cache(maxsize=1)
def script() -> bytes:
    """Return the script of all pages; they work without it."""
    environment = _templates()
    assert environment.loader is not None
    return environment.loader.get_source(environment, "page.js")[0].encode()


def page(
    title: str, about: str, form: Form, blocks: Sequence[report.Block] = (), sources: Sequence[Any] = (), own: str = ""
) -> str:
    """Return a page with the form of a question.

    Parameters
    ----------
    title, about : str
    form : Form
    blocks : sequence of Block
        The answer; none without a question.
    sources : sequence
        Links to the same answer in other forms, as (name, address).
    own : str
        Address of the form that takes files; none where it is empty.
    """
    told = {"title": title, "about_text": about, "form": form, "blocks": blocks, "sources": sources, "own": own}
    return _rendered("asked.html.j2", told)


def plain_page(title: str, about: str, heading: str, blocks: Sequence[report.Block], **more: Any) -> str:
    """Return a page without a form of a question.

    Parameters
    ----------
    title, about, heading : str
    blocks : sequence of Block
    **more
        ``refresh_s``, after which the browser asks again; ``share``, finished and all pieces; ``sources``, as of
        `page`; ``cancel``, address and token of a button.
    """
    told: dict[str, Any] = {"refresh_s": 0, "share": (), "sources": (), "cancel": ()} | more
    return _rendered("told.html.j2", told | {"title": title, "about_text": about, "heading": heading, "blocks": blocks})


def _rendered(name: str, told: Mapping[str, Any]) -> str:
    template = _templates().get_template(name)
    return template.render(version=__version__, **told)


def _sent_blocks(submission: Submission) -> list[report.Block]:
    told = [report.lines(name, report.code(f"sha256 {own}")) for name, own in submission.hashes]
    return [report.Heading("Files that were sent, and not kept"), report.Items(told)]


def notes_blocks(notes: Sequence[str]) -> list[report.Block]:
    """Return remarks on the reading of tables as blocks; none without remarks."""
    return [report.Heading("Remarks on your tables"), report.Items(list(notes))] if notes else []


def cited(result: Any) -> str:
    """Return what is cited of a result beside the version: its hash and its catalogue."""
    return f", configuration {result.config_hash}; {result.catalogue}"


def elsewhere(commands: Sequence[str], cited: str | None = "", python: str = "") -> list[report.Block]:
    """Return the same question on the command line and in Python, where there are such, and how to cite the answer.

    Parameters
    ----------
    commands : sequence of str
    cited : str, optional
        What is cited beside the version; None where the answer is nothing to cite.
    python : str
        Lines of Python; empty for none.
    """
    facts: list[tuple[Any, Any]] = []
    if commands:
        facts.append((f"Command{'s' * (len(commands) > 1)}", report.lines(*map(report.code, commands))))
    if python:
        facts.append(("Python", report.lines(*map(report.code, filter(None, python.split("\n"))))))
    if cited is not None:
        facts.append(("To cite", f"cpic-planner {__version__}{cited}"))
    return [report.Heading("The same elsewhere"), report.Facts(facts)]


def tag_of(kind: str, pairs: Pairs) -> str:
    """Return the tag of an answer: a hash of the question and of the version that answers it.

    Parameters
    ----------
    kind : str
        What the answer is: a figure, a form.
    pairs : sequence of (str, str)
    """
    text = dump_json({"version": __version__, "kind": kind, "asked": pairs})
    return f'"{hashlib.sha256(text.encode()).hexdigest()[:32]}"'


def drawn(figure: Callable[[], Figure], form: FigureForm) -> bytes:
    """Return a figure in a form, while no other is drawn.

    Parameters
    ----------
    figure : callable
    form : {"svg", "png", "values"}
        The last is the JSON of what it shows.
    """
    with _PENCIL, report.style():
        made = figure()
        if form == "values":
            return _panels(made).encode()
        return base64.b64decode(report.save(made, form, alt="", caption="").uri.partition(",")[2])


def figure_blocks(place: str, figure: Callable[[], Figure], alt: str, caption: str) -> list[report.Block]:
    """Return the figure of an answer by its address or, where it has none as files were sent, with its values."""
    if place:
        return [report.Figure(report.Picture(place, alt, caption))]
    with _PENCIL, report.style():
        made = figure()
        panels, picture = _panels(made), report.save(made, "svg", alt=alt, caption=caption)
    values = report.Fold("Values of the figure", list(report.values_blocks(json.loads(panels))))
    return [report.Figure(picture, panels=panels), values]


def _panels(made: Figure) -> str:
    return json.dumps(report.panels_of(made), separators=(",", ":"))


def values_page(title: str, figure: str, answer: str, panels: bytes) -> str:
    """Return the page of what a figure shows, in tables.

    Parameters
    ----------
    title : str
    figure, answer : str
        Addresses of the figure, as ``.svg``, and of the page that it is on.
    panels : bytes
        Its values, as `drawn` gives them.
    """
    picture = report.Picture(figure, "The figure whose values are in the tables below", "The values are as plotted.")
    blocks: list[report.Block] = [report.Figure(picture, panels=panels.decode())]
    blocks.append(report.Paragraph(report.page_link(answer, "Back to the answer")))
    blocks += report.values_blocks(json.loads(panels))
    return plain_page(title, "What the figure shows, in tables.", "Values of the figure", blocks)
