"""Pages: the form, the answer as the command line says it, its figure, and the same question elsewhere."""

from __future__ import annotations

import functools
import json
from collections.abc import Sequence
from typing import Any
from urllib.parse import urlencode

from cpic_planner import report
from cpic_planner.version import __version__
from cpic_planner.web import answers
from cpic_planner.web.asking import ETC, RANK, Asking, Pairs, python_lines
from cpic_planner.web.blocks import blocks_of
from cpic_planner.web.forms import Form
from cpic_planner.web.sent import Sent

_NAMES = {"latex": "LaTeX", "markdown": "Markdown"}


@functools.lru_cache(maxsize=1)
def style_sheet() -> bytes:
    """Return the style of all pages: that of the reports, and that of forms."""
    environment = report.templates("cpic_planner.web", "cpic_planner.report")
    return "".join(environment.get_template(name).render() for name in ("plan.css", "web.css")).encode()


@functools.lru_cache(maxsize=1)
def script() -> bytes:
    """Return the script of all pages; they work without it."""
    environment = report.templates("cpic_planner.web", "cpic_planner.report")
    assert environment.loader is not None
    return environment.loader.get_source(environment, "page.js")[0].encode()


def page(
    title: str, about: str, form: Form, blocks: Sequence[report.Block] = (), sources: Sequence[Any] = (), own: str = ""
) -> str:
    """Return a page.

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
    template = report.templates("cpic_planner.web", "cpic_planner.report").get_template("asked.html.j2")
    told = {"title": title, "about_text": about, "form": form, "blocks": blocks, "sources": sources, "own": own}
    return template.render(version=__version__, **told)


def etc_blocks(pairs: Pairs, sent: Sent | None = None) -> list[report.Block]:
    """Return the answer of the calculator to an address as blocks.

    Parameters
    ----------
    pairs : sequence of (str, str)
    sent : Sent, optional
        Files that came with it: the figure is then in the page, and there are no lines of Python.
    """
    answer = answers.etc_answer(pairs) if sent is None else answers.fresh_etc(pairs, sent)
    blocks = blocks_of(answer.print)
    question = report.question_text(answer.question)
    if any(row.budget for row in answer.result.answers):
        alt = f"SNR against wall time, contrast limit against separation, and noise budget of {answer.result.target}"
        caption = f"{alt}; asked: {question}."
        if sent is None:
            blocks.append(report.Figure(report.Picture(ETC.address(pairs, ".svg"), alt, caption)))
        else:
            blocks += answers.figure_inside(answer.figure, alt, caption)
    blocks += notes_blocks(answer.result.notes)
    if answer.question.catalog == "snapshot" and answer.question.v_mag is None:
        more = report.page_link(f"/star?{urlencode({'name': answer.result.target})}", "its page")
        blocks.append(report.Paragraph(["Seasons, known planets and priority of the star: ", more, "."]))
    lines = python_lines(answer.question, pairs) if sent is None else ""
    catalogue = answer.result.catalogue
    return blocks + elsewhere(ETC.command_line(pairs), lines, answer.result.config_hash, catalogue)


def rank_blocks(pairs: Pairs, limit: int, sent: Sent | None = None) -> list[report.Block]:
    """Return a ranking as blocks.

    Parameters
    ----------
    pairs : sequence of (str, str)
    limit : int
        Rows that are shown.
    sent : Sent, optional
        As of `etc_blocks`.
    """
    result = answers.ranking(pairs) if sent is None else answers.fresh_ranking(pairs, sent)
    blocks = blocks_of(functools.partial(report.print_rank, result, limit=limit, full=False))
    if result.targets:
        alt = f"Scores of the first {min(limit, len(result.targets), report.MOST_STARS)} stars"
        if sent is None:
            address = RANK.address(pairs, ".svg", limit=str(limit))
            blocks.append(report.Figure(report.Picture(address, alt, f"{alt}.")))
        else:
            blocks += answers.figure_inside(functools.partial(report.rank_figure, result, limit), alt, f"{alt}.")
    blocks += notes_blocks(result.notes)
    command = f"{RANK.command_line(pairs)} --limit {limit}"
    return blocks + elsewhere(command, "", result.config_hash, result.catalogue)


def notes_blocks(notes: Sequence[str]) -> list[report.Block]:
    """Return remarks on the reading of tables as blocks; none without remarks."""
    return [report.Heading("Remarks on your tables"), report.Items(list(notes))] if notes else []


def elsewhere(command: str, lines: str, config_hash: str, catalogue: str) -> list[report.Block]:
    """Return the same question on the command line and in Python, where there are such, and how to cite the answer.

    Parameters
    ----------
    command, lines : str
        Empty for none.
    config_hash, catalogue : str
    """
    cited = f"cpic-planner {__version__}, configuration {config_hash}; {catalogue}"
    facts: list[tuple[Any, Any]] = [("Command", report.code(command))] if command else []
    if lines:
        facts.append(("Python", report.lines(*map(report.code, filter(None, lines.split("\n"))))))
    return [report.Heading("The same elsewhere"), report.Facts([*facts, ("To cite", cited)])]


def sources_of(asking: Asking[Any], pairs: Pairs, **more: str) -> list[tuple[str, str]]:
    """Return links to an answer in other forms, as (name, address)."""
    found = [(_NAMES.get(form, form.upper()), asking.address(pairs, format=form, **more)) for form in answers.MEDIA]
    return [*found, ("PNG", asking.address(pairs, ".png", **more)), ("SVG", asking.address(pairs, ".svg", **more))]


def values_page(title: str, figure: str, answer: str, panels: bytes) -> str:
    """Return the page of what a figure shows, in tables.

    Parameters
    ----------
    title : str
    figure, answer : str
        Addresses of the figure, as ``.svg``, and of the page that it is on.
    panels : bytes
        Its values, as `cpic_planner.web.answers.drawn` gives them.
    """
    picture = report.Picture(figure, "The figure whose values are in the tables below", "The values are as plotted.")
    blocks: list[report.Block] = [report.Figure(picture, panels=panels.decode())]
    blocks.append(report.Paragraph(report.page_link(answer, "Back to the answer")))
    blocks += report.values_blocks(json.loads(panels))
    return told_page(title, "What the figure shows, in tables.", "Values of the figure", blocks)


def told_page(title: str, about: str, heading: str, blocks: Sequence[report.Block], **more: Any) -> str:
    """Return a page without a form of a question.

    Parameters
    ----------
    title, about, heading : str
    blocks : sequence of Block
    **more
        ``refresh_s``, after which the browser asks again; ``share``, finished and all pieces; ``sources``, as of
        `page`; ``cancel``, address and token of a button.
    """
    template = report.templates("cpic_planner.web", "cpic_planner.report").get_template("told.html.j2")
    told: dict[str, Any] = {"refresh_s": 0, "share": (), "sources": (), "cancel": ()} | more
    told |= {"title": title, "about_text": about, "heading": heading, "blocks": blocks}
    return template.render(version=__version__, **told)
