"""An answer as a document: sentences, tables, figures and lists, which a terminal and a page write each in its way.

Texts are plain, or hold marks (`badge`, `small`, ...): nothing here is markup, so that names from outside stay text.
The columns of a table are those of its rows (`row_columns`), or made (`own_column`). A report is a document of
sections; each is one entry of a registry: an anchor, a title, and a function that makes its blocks from the data of the
page. One that makes no block is not shown.
"""

from __future__ import annotations

import re
import string
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Generic, Literal, TypeAlias, TypeVar, Union

from cpic_core import Record, Registry, visible
from cpic_planner import results
from cpic_planner.report.drawing import Picture
from cpic_planner.report.words import LIMITED_BY, MISSING, STATUS_SYMBOLS, VERDICTS, formatted, status_text
from cpic_planner.results import Column, Result

D = TypeVar("D")


class Mark(Record):
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


def marked(text: str) -> Inline:
    """Return a text of ours in which backticks stand around what a computer reads."""
    return [code(part) if number % 2 else part for number, part in enumerate(text.split("`"))]


def plain(text: Inline) -> str:
    """Return a text without marks: symbols in front of badges, and brackets around asides below a line."""
    if isinstance(text, str):
        return text
    if isinstance(text, Mark):
        return {"break": " ", "badge": f"{text.symbol} {text.text}"}.get(text.kind, text.text)
    parts, said = list(text), ""
    for before, part in zip(["", *parts], parts, strict=False):
        below = isinstance(part, Mark) and part.kind == "small" and isinstance(before, Mark) and before.kind == "break"
        aside = below and not plain(part).startswith(("(", "±"))
        said += f"({plain(part)})" if aside else plain(part)
    return said


class Paragraph(Record):
    """Text; ``look`` is ``lead``, ``note``, ``altered`` or, of lines that are copied and do not wrap, ``whole``."""

    text: Inline
    look: str = ""


class Heading(Record):
    """A heading inside a section."""

    text: Inline


class Table(Record):
    """A table: what it is called, its columns, and what they are of, one a row.

    Attributes
    ----------
    title : str
        What it is, and in further lines what it is about.
    columns : sequence of Column
        The text of one that is no field is a template, see `cell`, or a function of the entry.
    entries : sequence
    caption : Inline
        How to read it. Without one the headings are explained, each by its description.
    look : str
        Class of the table in pages.
    picked : callable
        Whether the row of an entry is shaded.
    last_width : int
        Width beyond which the last column wraps on a terminal.
    legend : bool
        Whether a terminal explains the headings.
    """

    title: str
    columns: Sequence[Column]
    entries: Sequence[Any]
    caption: Inline = ""
    look: str = ""
    picked: Callable[[Any], bool] = lambda _: False
    last_width: int = 18
    legend: bool = False


class Figure(Record):
    """A picture with its caption, after which ``more`` is said; the anchor is that of ``key``.

    ``panels`` are what it shows, as JSON, where the page itself holds that (`cpic_planner.report.plotted`).
    """

    picture: Picture
    title: str = ""
    key: str = ""
    before: str = ""
    more: str = ""
    panels: str = ""


class Facts(Record):
    """Terms and what there is to say of them; ``wide`` ones take a line each."""

    items: Sequence[tuple[Inline, Inline]]
    wide: bool = True


class Items(Record):
    """A list."""

    texts: Sequence[Inline]


class Group(Record):
    """Blocks that belong together, under a heading with an anchor."""

    anchor: str
    title: str
    blocks: Sequence[Block]


class Fold(Record):
    """Blocks that show when asked for, with an anchor where something leads to them."""

    summary: str
    blocks: Sequence[Block]
    open: bool = False
    anchor: str = ""


Block: TypeAlias = Paragraph | Heading | Table | Figure | Facts | Items | Group | Fold


def notes(*texts: str, look: str = "note") -> list[Block]:
    """Return paragraphs of remarks; none of empty texts."""
    return [Paragraph(text, look) for text in texts if text]


def notes_fact(texts: Sequence[str]) -> list[tuple[Inline, Inline]]:
    """Return remarks on the reading of a user's tables as a term and its text; none without remarks."""
    return [("Remarks on your tables", lines(*texts))] if texts else []


def itself(entry: Any) -> Any:
    """Return the entry of a table, where that is the row."""
    return entry


class _Missing(Exception):
    """A value that a template names is not there."""


class _Template(string.Formatter):
    """Writes fields of an entry, places of a tuple among them, as `cpic_planner.report.words.formatted` does."""

    def get_field(self, field_name: str, args: Any, kwargs: Any) -> tuple[Any, str]:
        value = args[0]
        for part in filter(None, field_name.split(".")):
            value = None if value is None else value[int(part)] if part.isdigit() else getattr(value, part)
        if value is None:
            raise _Missing
        return value, field_name

    def format_field(self, value: Any, format_spec: str) -> str:
        return formatted(value, format_spec)


def _line(template: str, entry: Any) -> str:
    try:
        return _Template().format(template, entry)
    except _Missing:
        return ""


def cell(column: Column, entry: Any) -> Inline:
    """Return what stands in a column of an entry.

    A template holds fields in braces, with dots between those of records, and numbers in place of names for the parts
    of a tuple: ``{0.band}``, ``{snr:.3g}``. Further lines of it are asides. A line of which a value is missing is left
    out; where it is the first one, a dash stands there.
    """
    if callable(column.text):
        text: Inline = column.text(entry)
        return text
    if isinstance(column.text, str):
        first, *below = (_line(line, entry) for line in column.text.split("\n"))
        return lines(first or MISSING, *map(small, below)) if below else first or MISSING
    assert column.value is not None
    form, _, error = column.format.partition(" ± ")
    value = formatted(column.value(entry), form)
    spread = column.files[1].value(entry) if error and column.files[1].value is not None else None
    return value if spread is None else f"{value} ± {formatted(spread, error)}"


def facts_of(entry: Any, terms: Mapping[str, str | Callable[[Any], Inline]]) -> list[tuple[Inline, Inline]]:
    """Return terms with what there is to say of an entry, by templates as of `cell`; none of what is missing."""
    said = ((term, cell(own_column("", text), entry)) for term, text in terms.items())
    return [(term, text) for term, text in said if text not in ("", MISSING)]


def cell_text(column: Column, entry: Any) -> str:
    """Return the text of a cell as terminals and files have it: names may hold what steers a terminal."""
    return visible(plain(cell(column, entry)))


_SIGNS = re.compile(f"^[→·{''.join(STATUS_SYMBOLS.values())}\\s]+")


def bare_text(column: Column, entry: Any) -> str:
    """Return the text of a cell without the signs in front of it."""
    return _SIGNS.sub("", cell_text(column, entry))


def files_of(column: Column) -> Sequence[Column]:
    """Return the columns that stand in files for one: numbers where it has some, else its text without signs."""
    if column.files or column.value is not None:
        return column.files or (column,)
    name = re.sub(r"\W+", "_", column.heading.casefold()).strip("_") or "text"
    return (Column(name, "string", column.description, value=lambda entry: bare_text(column, entry)),)


def own_column(
    heading: str,
    text: str | Callable[[Any], Inline],
    unit: str = "",
    look: str = "",
    *,
    label: str = "",
    legend: str = "",
    way: int = 0,
    fields: str = "",
    of: tuple[type[Result], Callable[[Any], Any]] | None = None,
    files: Sequence[Column] = (),
) -> Column:
    """Return a column that is no field of a row.

    Parameters
    ----------
    heading : str
        On terminals, and in pages where there is no ``label``.
    text : str or callable
        Template, see `cell`, or what returns a cell of an entry.
    unit : str
        Unit or remark below the heading in pages.
    look : str
        Classes of the cells in pages; with ``left`` the column holds texts.
    label, legend : str
        Heading in pages, and what it means.
    way : int
        How soon the column gives way on a narrow terminal.
    fields : str
        Fields of the row that stand in files for it.
    of : (type, callable), optional
        Kind of the row, and what returns it of an entry.
    files : sequence of Column
        Columns that stand in files for it.
    """
    dtype = "string" if "left" in look.split() else ""
    taken = tuple(files) or (results.taken_of(of[0], *fields.split(), of=of[1]) if fields and of else ())
    return Column("", dtype, legend, unit, label, heading, "", False, None, text, way, look, tuple(taken), of)


def computed(
    heading: str,
    value: Callable[[Any], Any],
    text: Callable[[Any], str],
    legend: str = "",
    name: str = "",
    unit: str = "",
) -> Column:
    """Return a column whose numbers are worked out from the entry, and stand in files under a name of their own."""
    taken = Column(name or heading.replace(" ", "_"), "float64", legend, unit, value=value)
    return own_column(heading, lambda entry: text(value(entry)), legend=legend, files=[taken])


Special: TypeAlias = str | Callable[[Any], Any] | Column
"""Text, function or column that stands in a table instead of the row's own value."""
_SOON = 9
"""How soon columns give way that nobody named."""


def row_columns(
    kind: type[Result], layout: str, /, *, of: Callable[[Any], Result | None] = itself, **special: Special
) -> list[Column]:
    """Return the columns of a table from those of its rows.

    Parameters
    ----------
    kind : type
        Kind of the rows: headings, sides and formats are those of its columns.
    layout : str
        Names of the columns, in order; ``:row,star`` behind a name: looks of its cells in pages; ``/3`` behind that:
        how soon it gives way. ``frames`` stands for number and exposure of frames, ``status`` for verdict and reason.
        Columns that ask for it (``console=True``) and are not named stand before the last one.
    of : callable
        The row of an entry of the table; cells without a row are dashes.
    **special
        What is written in a column instead, from the entry; an `own_column` where the row has no such field.

    Returns
    -------
    list of Column
    """
    shared = _SHARED if "verdict" in kind.model_fields else {"frames": _SHARED["frames"]}
    columns, named = [], []
    for each in layout.split():
        word, _, way = each.partition("/")
        name, _, look = word.partition(":")
        own = special.get(name)
        if own is None and name in shared:
            own = shared[name](kind, of)
        made = own if isinstance(own, Column) else _field(kind, name, own, of)
        looks = " ".join(filter(None, (look.replace(",", " "), "" if made.right or "left" in look else "left")))
        columns.append(replace(made, gives_way=int(way or 0), look=looks or made.look, row=(kind, of)))
        named.append(name)
    more = [column.name for column in results.columns_of(kind) if column.console and column.name not in named]
    columns[-1:-1] = [replace(_field(kind, name, None, of), gives_way=_SOON, row=(kind, of)) for name in more]
    return columns


def _field(kind: type[Result], name: str, text: str | Callable[[Any], Any] | None, of: Callable[[Any], Any]) -> Column:
    """Return the column of a field, with its error where the format has one."""
    column = results.column_of(kind, name)
    names = [name, f"{name}_error"] if " ± " in column.format else [name]
    files = results.taken_of(kind, *names, of=of)
    legend = column.description.partition(";")[0] if column.short and column.right else ""
    legend = legend.removesuffix(f", {column.unit}")  # the cells may be in another one
    value = (lambda entry: getattr(of(entry), name, None)) if text is None else None
    short = column.label if column.format in WITH_UNIT and not column.short else column.short
    return replace(column, description=legend, short=short, files=tuple(files), text=text, value=value)


WITH_UNIT = ("time", "bytes")
"""Formats that write the unit themselves."""


_UNITS = {"AU": "au", "solLum": "L☉", "electron": "e-", "electron/s": "e-/s"}
"""Units as people write them, where astropy has another way."""


def unit_shown(column: Column) -> str:
    """Return the unit that people read at the heading of a column."""
    form = column.format.partition(" ± ")[0]
    return form if form in ("%", "min") else "" if form in WITH_UNIT else _UNITS.get(column.unit, column.unit)


def name_shown(column: Column) -> str:
    """Return the heading of a column in pages, without the unit."""
    name = column.label or column.heading
    return name if name.startswith("e-") else name[:1].upper() + name[1:]


def meaning(column: Column) -> str:
    """Return what the heading of a column means; empty where it says so itself."""
    told = column.description
    return "" if told.casefold() in (column.heading.casefold(), name_shown(column).casefold()) else told


def user_columns(rows: Sequence[Any]) -> list[Column]:
    """Return the columns of a user's table that rows carry, which stand in files alone unless they are named."""
    return [replace(column, short=column.name, title=column.name, look="files") for column in results.own_taken(rows)]


_MEDIA = {"files", "terminal", "page"}
"""Looks of columns that stand nowhere else: in files, on terminals, in pages."""


def shown_columns(table: Table, medium: Literal["files", "terminal", "page"]) -> list[Column]:
    """Return the columns of a table that stand in files, on terminals or in pages."""
    others = _MEDIA - {medium} - ({"terminal"} if medium == "files" else set())
    return [column for column in table.columns if others.isdisjoint(column.look.split())]


def status_cell(status: str, reason: str) -> str:
    """Return the symbol and the short reason of a status."""
    return f"{STATUS_SYMBOLS.get(status, '')} {reason.replace('_', ' ') or status_text(status)}".strip()


def verdict_cell(item: results.EtcAnswer | results.RankedTarget | results.BandStanding) -> str:
    """Return the verdict of an answer in a cell; the mark of a success stands before a detection only."""
    if item.status == "ok":
        if item.verdict == "detected":
            return f"{STATUS_SYMBOLS['ok']} {VERDICTS['detected']}"
        return status_text("ok") if item.verdict is None else f"· {VERDICTS[item.verdict]}"
    if item.reason in ("speckle_floor", "common_speckle_floor") and item.limited_by in ("photons", "background"):
        return f"{STATUS_SYMBOLS[item.status]} {LIMITED_BY[item.limited_by][0]}"
    return status_cell(item.status, item.reason)


FRAMES = "{n_frames} × {exposure_s:.3g}"
"""Number of frames and their exposure."""


def frames_text(item: Any) -> str:
    """Return the number of frames and their exposure."""
    return MISSING if item is None else _line(FRAMES, item) or MISSING


def _frames(kind: type[Result], of: Callable[[Any], Any]) -> Column:
    about: dict[str, Any] = {"label": "frames × exposure", "fields": "n_frames exposure_s", "of": (kind, of)}
    return own_column("frames × s", lambda entry: frames_text(of(entry)), "s", **about)


def _verdict(kind: type[Result], of: Callable[[Any], Any]) -> Column:
    def text(entry: Any) -> str:
        return MISSING if of(entry) is None else verdict_cell(of(entry))

    return own_column("status", text, "", "left", fields="verdict status reason", of=(kind, of))


_SHARED = {"frames": _frames, "status": _verdict}


class Section(Record, Generic[D]):
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


class Document(Record):
    """A report: title of the window, heading, what it is, its summary, and its sections as (anchor, title, blocks).

    ``opening`` is the heading of the summary.
    """

    title: str
    heading: str
    about: str
    summary: Sequence[Block]
    sections: Sequence[tuple[str, str, Sequence[Block]]]
    opening: str = "Summary"


def document_of(page: Registry[Section[D]], data: D, *, summary: Iterable[Block], **head: str) -> Document:
    """Return the document that a page makes of its data.

    Parameters
    ----------
    page : Registry
        Sections, in order.
    data
        What they are made of.
    summary : iterable of Block
        Shown before all sections.
    **head
        Texts of the `Document`.
    """
    made = ((entry.name, entry.title, list(entry.blocks(data))) for entry in page.values())
    return Document(summary=list(summary), sections=[section for section in made if section[2]], **head)


def parts(document: Document, *names: str) -> list[Block]:
    """Return the summary of a document and the blocks of some of its sections: what a terminal shows of it."""
    named = [block for name, _, blocks in document.sections if name in names for block in blocks]
    return [*document.summary, *named]


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
