"""A report as a document: sections of paragraphs, tables, figures and lists.

A section is one entry of a page's registry: an anchor, a title, and a function that makes its blocks from the data of
the page. One that makes no block is not shown. Texts are plain, or hold marks (`badge`, `small`, ...): nothing here is
markup, so that names from outside stay text.
"""

from __future__ import annotations

import base64
import functools
import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeAlias, TypeVar, Union

from cpic_core import Registry, visible
from cpic_planner.report.cells import Special, row_cells
from cpic_planner.report.drawing import Picture
from cpic_planner.report.words import STATUS_SYMBOLS
from cpic_planner.results import Result

if TYPE_CHECKING:
    from jinja2 import Environment


D = TypeVar("D")


T = TypeVar("T")


@dataclass(frozen=True)
class Mark:
    """Text with a meaning: a badge of a status, code, a unit or aside, something important, a link, a line's end."""

    kind: Literal["badge", "code", "small", "strong", "link", "page", "sub", "break"]
    text: str = ""
    target: str = ""
    symbol: str = ""


Inline: TypeAlias = Union[str, Mark, "Sequence[Inline]"]
"""What a cell or a paragraph holds."""


def badge(status: str, text: str) -> Mark:
    """Return a badge in the colour and with the symbol of a status."""
    return Mark("badge", text, status, STATUS_SYMBOLS.get(status, ""))


def code(text: str) -> Mark:
    """Return what a computer reads: a name of a file, a key, a hash."""
    return Mark("code", text)


def small(text: str) -> Mark:
    """Return a unit or an aside."""
    return Mark("small", text)


def strong(text: str) -> Mark:
    """Return what must not be missed."""
    return Mark("strong", text)


def link(anchor: str, text: str) -> Mark:
    """Return a link to an anchor of the same document."""
    return Mark("link", text, anchor)


def page_link(address: str, text: str) -> Mark:
    """Return a link to another page of the same server."""
    return Mark("page", text, address)


def lines(*parts: Inline) -> Inline:
    """Return parts below each other; empty ones are left out."""
    kept = [part for part in parts if part and (not isinstance(part, Mark) or part.text)]
    return [item for part in kept for item in (Mark("break"), part)][1:]


def notes_fact(notes: Sequence[str]) -> list[tuple[str, Inline]]:
    """Return remarks on the reading of a user's tables as a term and its text; none without remarks."""
    return [("Remarks on your tables", lines(*notes))] if notes else []


class _Templated:
    """A part that the page writes by the macro of its own name."""

    @property
    def template(self) -> str:
        """Name of the macro."""
        return type(self).__name__.lower()


@dataclass(frozen=True)
class Paragraph(_Templated):
    """Text; ``look`` is ``lead``, ``note`` or ``altered``."""

    text: Inline
    look: str = ""


@dataclass(frozen=True)
class Heading(_Templated):
    """A heading inside a section."""

    text: Inline


@dataclass(frozen=True)
class Span:
    """A cell that stands in the place of several."""

    text: Inline
    columns: int


@dataclass(frozen=True)
class Column(Generic[T]):
    """One column of a table: heading, cells, and how they look.

    Attributes
    ----------
    heading : Inline
        Without the unit.
    value : callable
        Cell of an item.
    unit : str
        Unit or remark below the heading.
    look : str
        Classes of the cells: ``left``, ``wide``, ``star``, ...; with ``row`` the cell is the heading of its row.
    """

    heading: Inline
    value: Callable[[T], Inline | Span]
    unit: str = ""
    look: str = ""


@dataclass(frozen=True)
class Cell:
    """One cell: text, classes, whether it heads its row, and over how many columns it goes."""

    text: Inline
    look: str = ""
    heads: bool = False
    span: int = 1


@dataclass(frozen=True)
class Table(_Templated):
    """A table with a label and a caption; ``heads`` are its first row, ``picked`` the rows that are shaded."""

    label: str
    caption: Inline
    heads: tuple[Cell, ...]
    rows: tuple[tuple[Cell, ...], ...]
    look: str = ""
    picked: frozenset[int] = frozenset()


def table(
    label: str,
    caption: Inline,
    columns: Sequence[Column[T]],
    items: Iterable[T],
    *,
    look: str = "",
    picked: Callable[[T], bool] = lambda _: False,
) -> Table:
    """Return the table of some items.

    Parameters
    ----------
    label : str
        Name for people who do not see it.
    caption : Inline
        What it shows.
    columns : sequence of Column
    items : iterable
        One a row.
    look : str
        Class of the table.
    picked : callable
        Whether the row of an item is shaded.
    """
    rows = list(items)
    heads = tuple(Cell(lines(one.heading, small(one.unit)), _of_heading(one.look)) for one in columns)
    marked = frozenset(i for i, item in enumerate(rows) if picked(item))
    return Table(label, caption, heads, tuple(tuple(_cells(columns, item)) for item in rows), look, marked)


def row_table(
    label: str,
    caption: Inline,
    kind: type[Result],
    layout: str,
    items: Iterable[T],
    *,
    of: Callable[[Any], Any] = lambda row: row,
    look: str = "",
    **special: Special,
) -> Table:
    """Return the table of rows: headings, units, formats and sides of its columns are said with the fields of these.

    Parameters
    ----------
    label, caption, items, look
        As of `table`.
    kind, layout, of, **special
        As of `cpic_planner.report.cells.row_cells`.
    """
    return table(label, caption, row_columns(kind, layout, of=of, **special), items, look=look)


def row_columns(
    kind: type[Result], layout: str, /, *, of: Callable[[Any], Any] = lambda row: row, **special: Special
) -> list[Column[Any]]:
    """Return columns of a table from those of its rows, as `cpic_planner.report.cells.row_cells` takes them."""
    columns = []
    for cell in row_cells(kind, layout, of=of, page=True, **special):
        heading, unit = cell.label[:1].upper() + cell.label[1:], _UNITS.get(cell.unit, cell.unit)
        columns.append(Column(heading, cell.text, unit, cell.look if cell.right else f"left {cell.look}"))
    return columns


_UNITS = {"AU": "au", "solLum": "L☉"}
"""Units as people write them, where astropy has another way."""


def _of_heading(look: str) -> str:
    """Return the classes of a column that its heading shares."""
    return " ".join(name for name in look.split() if name in ("left", "pick"))


def _cells(columns: Sequence[Column[T]], item: T) -> Iterator[Cell]:
    left = 0
    for column in columns:
        if left:
            left -= 1
            continue
        value = column.value(item)
        looks = column.look.split()
        look = " ".join(name for name in looks if name != "row")
        span = value if isinstance(value, Span) else Span(value, 1)
        left = span.columns - 1
        yield Cell(span.text, look, "row" in looks, span.columns)


@dataclass(frozen=True)
class Figure(_Templated):
    """A picture with its caption, after which ``more`` is said; the anchor is that of ``key``.

    ``panels`` are what it shows, as JSON, where the page itself holds that (`cpic_planner.report.plotted`).
    """

    picture: Picture
    title: str = ""
    key: str = ""
    before: str = ""
    more: str = ""
    panels: str = ""


@dataclass(frozen=True)
class Facts(_Templated):
    """Terms and what there is to say of them; ``wide`` ones take a line each."""

    items: Sequence[tuple[Inline, Inline]]
    wide: bool = True


@dataclass(frozen=True)
class Items(_Templated):
    """A list."""

    texts: Sequence[Inline]


@dataclass(frozen=True)
class Group(_Templated):
    """Blocks that belong together, under a heading with an anchor."""

    anchor: str
    title: str
    blocks: Sequence[Block]


@dataclass(frozen=True)
class Fold(_Templated):
    """Blocks that show when asked for, with an anchor where something leads to them."""

    summary: str
    blocks: Sequence[Block]
    open: bool = False
    anchor: str = ""


Block: TypeAlias = Paragraph | Heading | Table | Figure | Facts | Items | Group | Fold


@dataclass(frozen=True)
class Section(Generic[D]):
    """One entry of a page: anchor, title, and what it shows of the page's data; nothing where it is left out."""

    name: str
    title: str
    blocks: Callable[[D], Iterable[Block]]


def section_of(
    page: Registry[Section[D]], name: str, title: str, *, after: str = ""
) -> Callable[[Callable[[D], Iterable[Block]]], Callable[[D], Iterable[Block]]]:
    """Register the decorated function as a section of a page.

    Parameters
    ----------
    page : Registry
    name : str
        Anchor.
    title : str
        Heading.
    after : str
        Name of the section that it follows; the last so far by default.
    """

    def registered(blocks: Callable[[D], Iterable[Block]]) -> Callable[[D], Iterable[Block]]:
        page.register(Section(name, title, blocks), after=after)
        return blocks

    return registered


@dataclass(frozen=True)
class Document:
    """A report: title of the window, heading, what it is, its summary, and its sections as (anchor, title, blocks).

    ``opening`` is the heading of the summary.
    """

    title: str
    heading: str
    about: str
    summary: Sequence[Block]
    sections: Sequence[tuple[str, str, Sequence[Block]]]
    opening: str = "Summary"


def document_of(
    page: Registry[Section[D]],
    data: D,
    *,
    title: str,
    heading: str,
    about: str,
    summary: Iterable[Block],
    opening: str = "Summary",
) -> Document:
    """Return the document that a page makes of its data.

    Parameters
    ----------
    page : Registry
        Sections, in order.
    data
        What they are made of.
    title, heading, about : str
        Title of the window, heading, and the line below it.
    summary : iterable of Block
        Shown before all sections.
    opening : str
        Heading of that.
    """
    made = ((entry.name, entry.title, list(entry.blocks(data))) for entry in page.values())
    return Document(title, heading, about, list(summary), [section for section in made if section[2]], opening)


def reproduced_blocks(
    result: Any, note: Inline, hashes: Sequence[tuple[str, str]] = (), *, seed: Any = None
) -> list[Block]:
    """Return what is needed to make the numbers of a result again.

    Parameters
    ----------
    result : Result
        With its version, hash and seed.
    note : Inline
        Which files have what.
    hashes : sequence of (str, str)
        Hashes of what it was made from, with their names.
    seed : optional
        Where the result has none of its own.
    """
    facts: list[tuple[Inline, Inline]] = [("Version", f"cpic-planner {result.version}")]
    facts += [(name, code(text)) for name, text in (("Configuration", result.config_hash), *hashes)]
    facts += [("Seed", str(result.seed if seed is None else seed)), ("Schema version", str(result.schema_version))]
    same = "The same configuration and seed give the same numbers with any number of workers."
    return [Paragraph(same), Facts(facts, wide=False), Paragraph(note, "note")]


def marked(text: str) -> Inline:
    """Return a text of ours in which backticks stand around what a computer reads."""
    return [code(part) if number % 2 else part for number, part in enumerate(text.split("`"))]


def page_html(document: Document) -> str:
    """Return a document as one HTML file: style, images and the one script that may run are in it, nothing is fetched.

    The script sorts, filters and copies tables; the page says all without it.
    """
    environment = templates("cpic_planner.report")
    script = environment.get_template("page.js").render()
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return environment.get_template("page.html.j2").render(document=document, digest=digest)


@functools.cache
def templates(*packages: str) -> Environment:
    """Return the templates of packages; of one name that of the first package counts.

    Values are escaped for HTML, and what steers the order or look of signs is made visible.
    """
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    trimmed: dict[str, Any] = {"trim_blocks": True, "lstrip_blocks": True}
    loader = ChoiceLoader([PackageLoader(package) for package in packages])
    return Environment(loader=loader, autoescape=True, finalize=_seen, undefined=StrictUndefined, **trimmed)


def _seen(value: Any) -> Any:
    """Return plain text with control characters as escapes; markup of templates as it is."""
    return visible(value, "\n") if type(value) is str else value
