"""Pages: the form, the answer as the command line says it, its figure, and the same question elsewhere."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, cast

from cpic_planner import report
from cpic_planner.results import RankedTarget
from cpic_planner.version import __version__
from cpic_planner.web import answers
from cpic_planner.web.asking import ETC, RANK, Asking, Pairs, python_lines
from cpic_planner.web.forms import Form

if TYPE_CHECKING:
    from rich.console import Console


_NAMES = {"latex": "LaTeX", "markdown": "Markdown"}


class Blocks(report.Sheet):
    """Stands where a console does, and keeps what is printed as blocks of a page."""

    def __init__(self) -> None:
        self.form, self.width, self.encoding, self.taken = "page", 0, "utf-8", None
        self.blocks: list[report.Block] = []

    def take(self, title: str, columns: Sequence[report.Cells], entries: list[Any]) -> None:
        """Keep a table, and what its headings mean."""
        named = [(column.label or column.header, column.unit) for column in columns]
        looks = ["" if column.right else "left" for column in columns]
        looks[-1] += " verdict" * (not columns[-1].right)
        texts: list[Any] = [[f"{name} ", report.small(unit)] if unit else name for name, unit in named]
        heads = tuple(map(report.Cell, texts, looks))
        rows = [[_cell(column, entry) for column in columns] for entry in entries]
        picked = frozenset(number for number, row in enumerate(rows) if str(row[0]).startswith("→"))
        first_heads = [True] + [False] * (len(columns) - 1)
        cells = tuple(tuple(map(report.Cell, row, looks, first_heads)) for row in rows)
        first, *more = title.split("\n")
        caption: Any = [report.strong(f"{first}."), *(f" {text}." for text in more)]
        self.blocks.append(report.Table(first, caption, heads, cells, "", picked))
        said = [f"{column.label or column.header}: {column.legend}." for column in columns if column.legend]
        if said:
            self.blocks.append(report.Fold("What the headings mean", [report.Items(said)]))

    def print(self, *objects: Any, **look: Any) -> None:
        """Keep a line."""
        text = " ".join(str(item) for item in objects).strip()
        if text:
            self.blocks.append(report.Paragraph(text, "note" if text.startswith(("!", "Note")) else ""))


def _cell(column: report.Cells, entry: Any) -> Any:
    """Text of a cell; a ranked star leads to the calculator."""
    text = str(column.text(entry)).strip()
    if isinstance(entry, RankedTarget) and column.fields == ("name",):
        return report.page_link(ETC.address([("target", f"HIP {entry.hip}" if entry.hip else entry.name)]), text)
    return text


def blocks_of(tables: Callable[[Console], None]) -> list[report.Block]:
    """Return what a function prints on a console as blocks of a page."""
    sheet = Blocks()
    tables(cast("Console", sheet))
    return sheet.blocks


@functools.lru_cache(maxsize=1)
def style_sheet() -> bytes:
    """Return the style of all pages: that of the reports, and that of forms."""
    environment = report.templates("cpic_planner.web", "cpic_planner.report")
    return "".join(environment.get_template(name).render() for name in ("plan.css", "web.css")).encode()


def page(title: str, about: str, form: Form, blocks: Sequence[report.Block] = (), sources: Sequence[Any] = ()) -> str:
    """Return a page.

    Parameters
    ----------
    title, about : str
    form : Form
    blocks : sequence of Block
        The answer; none without a question.
    sources : sequence
        Links to the same answer in other forms, as (name, address).
    """
    template = report.templates("cpic_planner.web", "cpic_planner.report").get_template("asked.html.j2")
    told = {"title": title, "about_text": about, "form": form, "blocks": blocks, "sources": sources}
    return template.render(version=__version__, **told)


def etc_blocks(pairs: Pairs) -> list[report.Block]:
    """Return the answer of the calculator to an address as blocks.

    Parameters
    ----------
    pairs : sequence of (str, str)
    """
    answer = answers.etc_answer(pairs)
    blocks = blocks_of(answer.print)
    question = report.question_text(answer.question)
    if any(row.budget for row in answer.result.answers):
        alt = f"SNR against wall time, contrast limit against separation, and noise budget of {answer.result.target}"
        caption = f"{alt}; asked: {question}."
        blocks.append(report.Figure(report.Picture(ETC.address(pairs, ".svg"), alt, caption)))
    lines = python_lines(answer.question, pairs)
    catalogue = answer.result.catalogue
    return blocks + elsewhere(ETC.command_line(pairs), lines, answer.result.config_hash, catalogue)


def rank_blocks(pairs: Pairs, limit: int) -> list[report.Block]:
    """Return a ranking as blocks.

    Parameters
    ----------
    pairs : sequence of (str, str)
    limit : int
        Rows that are shown.
    """
    result = answers.ranking(pairs)
    blocks = blocks_of(functools.partial(report.print_rank, result, limit=limit, full=False))
    if result.targets:
        alt = f"Scores of the first {min(limit, len(result.targets), report.MOST_STARS)} stars"
        address = RANK.address(pairs, ".svg", limit=str(limit))
        blocks.append(report.Figure(report.Picture(address, alt, f"{alt}.")))
    command = f"{RANK.command_line(pairs)} --limit {limit}"
    return blocks + elsewhere(command, "", result.config_hash, result.catalogue)


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
