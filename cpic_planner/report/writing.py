"""Writers of documents: on a terminal, as HTML pages, and the tables as CSV, ECSV, LaTeX and Markdown.

Tables on a terminal have columns that give way where it is narrow, and show what its encoding can.
"""

from __future__ import annotations

import base64
import functools
import hashlib
import re
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from typing import TYPE_CHECKING, Any
from urllib.parse import urlencode

from pydantic import BaseModel

from cpic_core import InputError, visible
from cpic_planner import results
from cpic_planner.report import document as doc
from cpic_planner.report.words import MISSING, STATUS_SYMBOLS, power_of_ten, status_text
from cpic_planner.results import Column
from cpic_planner.version import __version__
from simulator.config import nearest

if TYPE_CHECKING:
    from jinja2 import Environment
    from rich.console import Console

_STYLE = {"ok": "green", "unreachable": "yellow", "saturated": "red", "outside_field": "magenta", "invalid": "red"}
_GAP = 2
_LEAST_ROWS = 3
"""Fewest rows, and lines, that are taken together."""


def first_table(blocks: Iterable[doc.Block]) -> doc.Table | None:
    """Return the table that an answer is about: the first of its blocks; None where it has none."""
    return next((block for block in blocks if isinstance(block, doc.Table)), None)


def print_blocks(blocks: Iterable[doc.Block], console: Console, *, full: bool = False) -> None:
    """Print blocks on a terminal; pictures, groups and what is folded are for pages.

    Parameters
    ----------
    blocks : iterable of Block
    console : Console
    full : bool
        Print also how tables are read.
    """
    started = False
    for block in blocks:
        if started and isinstance(block, (doc.Table, doc.Heading)):
            console.print()
        started = True
        if isinstance(block, doc.Table):
            print_table(block, console)
            if full:
                _print_text(doc.plain(block.caption), console, "dim")
        elif isinstance(block, doc.Heading):
            _print_text(doc.plain(block.text), console, "bold")
        elif isinstance(block, doc.Paragraph):
            look = {"note": "dim", "lead": "bold", "altered": "bold"}.get(block.look, "")
            _print_text(doc.plain(block.text), console, look, wraps=block.look != "whole")
        elif isinstance(block, doc.Items):
            for item in block.texts:
                _print_text(doc.plain(item), console)
        elif isinstance(block, doc.Facts):
            for term, meaning in block.items:
                _print_text(f"{doc.plain(term)}: {doc.plain(meaning)}", console)


def print_lines(console: Console, *texts: str, bold: bool = False, wraps: bool = True) -> None:
    """Print lines of text, which wrap as words do on a terminal unless they are to be copied whole."""
    for text in texts:
        _print_text(text, console, "bold" if bold else "", wraps=wraps)


def _print_text(text: str, console: Console, style: str = "", *, wraps: bool = True) -> None:
    from rich.text import Text

    if text:
        console.print(Text(displayable(console, text), style=style), soft_wrap=not wraps)


def displayable(console: Console, text: str) -> str:
    """Return what a terminal can show: no control characters, and question marks for what its encoding has not."""
    text = visible(text, "\n")
    try:
        return text.encode(console.encoding).decode(console.encoding)
    except UnicodeEncodeError:
        return text.translate(_BARS).encode(console.encoding, "replace").decode(console.encoding)


_BARS = str.maketrans("█", "#", " ▏▎▍▌▋▊▉"[1:])
"""Signs of bars for terminals that have no blocks."""


def print_table(table: doc.Table, console: Console, *, chosen: bool = False) -> None:
    """Print a table of the columns that fit; the last one (status) always stays and may wrap.

    Parameters
    ----------
    table : Table
    console : Console
    chosen : bool
        Its columns are those that were asked for: it stands alone, as wide as it is.
    """
    from rich import box
    from rich.cells import cell_len
    from rich.table import Table
    from rich.text import Text

    columns = doc.shown_columns(table, "terminal")
    rows = [[doc.cell_text(column, row) for column in columns] for row in table.entries]
    heads = [column.heading for column in columns]
    widths = [max(map(cell_len, [head, *cells])) + _GAP for head, *cells in zip(heads, *rows, strict=True)]
    if chosen:
        console.width = max(sum(widths), console.width)
    else:
        widths[-1] = min(widths[-1], table.last_width + _GAP)
    shown = fitting(columns, widths, console.width)
    _print_text(table.title, console, "bold")
    look: dict[str, Any] = {"box": box.SIMPLE_HEAD, "padding": (0, _GAP - 1, 0, 0)}
    made = Table(pad_edge=False, show_edge=False, **look)
    cut = "ellipsis" if console.encoding.startswith("utf") else "crop"
    for i in shown:
        last = i == len(columns) - 1
        look = {"no_wrap": not last, "overflow": "fold" if last else cut, "vertical": "top"}
        made.add_column(Text(displayable(console, heads[i])), justify="right" if columns[i].right else "left", **look)
    for row in rows:
        made.add_row(*(Text(displayable(console, row[i]), style=_colour(row[i])) for i in shown))
    console.print(made)
    if chosen:
        return
    begun = {row[-1][:1] for row in rows if heads[-1] in ("status", "outcome")}
    told = [f"{sign} {status_text(name)}" for name, sign in STATUS_SYMBOLS.items() if name != "ok" and sign in begun]
    _print_text("   ".join(told), console, "dim")
    if table.legend:
        told = [f"{heads[i]}: {doc.meaning(columns[i])}" for i in shown if doc.meaning(columns[i])]
        _print_text("; ".join(told), console, "dim")


def _colour(text: str) -> str:
    """Return the style of a text that begins with the symbol of a status."""
    return next((_STYLE[status] for status, symbol in STATUS_SYMBOLS.items() if text.startswith(symbol)), "")


def fitting(columns: Sequence[Column], widths: Sequence[int], room: int) -> list[int]:
    """Return the places of the columns that fit, after those that give way soonest are left out."""
    shown = list(range(len(columns)))
    for i in sorted(shown, key=lambda i: -columns[i].gives_way):
        if sum(widths[j] for j in shown) > room and columns[i].gives_way > 0:
            shown.remove(i)
    return shown


def offered(columns: Sequence[Column]) -> dict[str, Column]:
    """Return the columns that a table can have, by their names in files: those of its rows, then those shown beside."""
    stand = [(column, doc.files_of(column)) for column in columns if "page" not in column.look.split()]
    shown = {files[0].name: column for column, files in stand if len(files) == 1}
    kinds = dict.fromkeys(column.row for column in columns if column.row is not None)
    every = [item for kind, of in kinds for item in results.taken_of(kind, of=of)]
    every += [item for _, files in stand for item in files]
    return {item.name: shown.get(item.name) or _with_heading(item) for item in every}


def _with_heading(item: Column) -> Column:
    """Return a column of files with a heading for people, the unit in it."""
    return replace(item, short=item.short or f"{item.label} {doc.unit_shown(item)}".strip())


def chosen(table: doc.Table, names: Sequence[str]) -> doc.Table:
    """Return a table of columns by their names in files, in the given order; none of them gives way.

    Raises
    ------
    InputError
        For a name that the table does not have, or that is given twice.
    """
    every = offered(table.columns)
    for number, name in enumerate(names):
        if name not in every:
            raise InputError("--columns", name, allowed="--columns help lists them", hint=nearest(name, every))
        if name in names[:number]:
            raise InputError("--columns", name, allowed="each column once")
    picked = (every[name] for name in names)
    shown = [replace(one, gives_way=0, look="" if one.look == "files" else one.look) for one in picked]
    return replace(table, columns=shown)


def offered_text(table: doc.Table) -> str:
    """Return the columns that a table can have, a line each: name, unit, meaning."""
    said = []
    for name, column in offered(table.columns).items():
        item = next(item for item in doc.files_of(column) if item.name == name)
        unit = f" [{item.unit}]" if item.unit else ""
        said.append(f"{name}{unit}{f': {item.description}' if item.description else ''}\n")
    return "".join(said)


def form_text(
    form: str, result: BaseModel, table: doc.Table, *, columns: Sequence[str] = (), caption: str = "", label: str = ""
) -> str:
    """Return a table as text of another form.

    Parameters
    ----------
    form : str
        ``csv`` and ``ecsv`` have the fields of the rows, units in the names or the header, numbers in full and empty
        cells for null; ``latex`` (a ``table`` with the columns that fit a page) and ``markdown`` have the cells of
        the terminal.
    result : BaseModel
        The result that the table is of: it says where its data are from.
    table : Table
    columns : sequence of str
        Names of the columns that are asked for; those of the table by default.
    caption, label : str
        Of a ``table`` in LaTeX; by default the title with the data and the version, and the kind of result.

    Raises
    ------
    InputError
        For columns that the table does not have.
    """
    table = chosen(table, columns) if columns else table
    title, rows = visible(table.title, "\n"), table.entries
    if form in ("latex", "markdown"):
        shown = doc.shown_columns(table, "terminal")
        cells = [[doc.bare_text(column, row) for column in shown] for row in rows]
        if form == "latex":
            label = label or f"tab:{getattr(result, 'kind', 'table')}"
            return _latex(caption or _caption(title, result), label, shown, cells)
        return _markdown(title, shown, cells)
    items = {item.name: item for column in doc.shown_columns(table, "files") for item in doc.files_of(column)}
    if form == "ecsv":
        meta = {"title": title, "flag_separator": results.FLAG_SEPARATOR}
        return results.ecsv_text(list(items.values()), rows, meta)
    plain = ({name: item.value(row) for name, item in items.items() if item.value is not None} for row in rows)
    return results.csv_text(tuple(items), plain, joined=results.FLAG_SEPARATOR)


def _caption(title: str, result: BaseModel) -> str:
    """Return what a table is, of which date and data, and the version that made it, as sentences."""
    date, data = str(getattr(result, "date_utc", ""))[:10], str(getattr(result, "catalogue", "")).partition(" (")[0]
    said = (*title.split("\n"), f"Date: {date}" if date else "", data, f"cpic-planner {__version__}")
    return " ".join(f"{text.strip().rstrip('.')}." for text in said if text.strip())


def _markdown(title: str, columns: Sequence[Column], cells: Sequence[Sequence[str]]) -> str:
    def line(words: Iterable[str]) -> str:
        return f"| {' | '.join(word.replace('|', chr(92) + '|') for word in words)} |\n"

    units = map(doc.unit_shown, columns)
    heads = (f"{doc.name_shown(one)}{f' ({unit})' * bool(unit)}" for one, unit in zip(columns, units, strict=True))
    rule = line("---:" if column.right else "---" for column in columns)
    return f"{title}\n\n{line(heads)}{rule}{''.join(map(line, cells))}"


_LATEX_WIDTH = 82
"""Letters of footnotesize on a line of an article."""
_SIGNS = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "\u202f": r"\,"}
_SIGNS |= {sign: rf"\{sign}" for sign in "&%#_${}"} | dict.fromkeys("–…", r"\ldots{}")
_SIGNS |= {
    "×": r"$\times$",
    "±": r"$\pm$",
    "−": "$-$",
    "″": "$''$",
    "′": "$'$",
    "°": r"$^\circ$",
    "<": "$<$",
    ">": "$>$",
}
_SIGNS |= {"≥": r"$\ge$", "≤": r"$\le$", "λ": r"$\lambda$", "⊕": r"$\oplus$"}
_POWER = re.compile(r"\d\.?\d*e[-+]\d+")


def _latex(caption: str, label: str, columns: Sequence[Column], cells: Sequence[Sequence[str]]) -> str:
    units = [doc.unit_shown(column) if column.heading == column.label else "" for column in columns]
    heads = [f"{one.heading} ({unit})" if unit else one.heading for one, unit in zip(columns, units, strict=True)]
    widths = [max(len(line[i]) for line in [heads, *cells]) + _GAP for i in range(len(heads))]
    shown = fitting(columns, widths, _LATEX_WIDTH)

    def line(words: Sequence[str]) -> str:
        return f"{' & '.join(latex_text(words[i]) for i in shown)} \\\\\n"

    sides = "".join("r" if columns[i].right else "l" for i in shown)
    look = "\\begin{table}\n\\centering\\footnotesize\\setlength{\\tabcolsep}{3pt}\n"
    named = f"\\caption{{{latex_text(caption)}}}\n\\label{{{visible(label)}}}\n"
    tabular = f"\\begin{{tabular}}{{{sides}}}\n\\hline\n{line(heads)}\\hline\n{''.join(map(line, cells))}\\hline\n"
    return f"{look}{named}{tabular}\\end{{tabular}}\n\\end{{table}}\n"


def latex_text(text: str) -> str:
    """Return a text for LaTeX: powers of ten, Greek letters and signs in mathematics, the rest escaped."""
    made, text, end = "", visible(text), 0
    for power in _POWER.finditer(text):
        mantissa, exponent = power[0].split("e")
        made += "".join(map(_latex_sign, text[end : power.start()]))
        made, end = rf"{made}${mantissa}\times10^{{{int(exponent)}}}$", power.end()
    return made + "".join(map(_latex_sign, text[end:]))


def _latex_sign(sign: str) -> str:
    name = unicodedata.name(sign, "")
    if name.startswith("GREEK SMALL LETTER "):
        letter = name.rsplit(" ", 1)[1].lower()
        return "o" if letter == "omicron" else rf"$\{letter}$"
    if name.startswith(("SUPERSCRIPT", "SUBSCRIPT")):
        kind = "^" if name.startswith("SUPER") else "_"
        return f"${kind}{{{unicodedata.normalize('NFKD', sign).replace(chr(0x2212), '-')}}}$"
    return _SIGNS.get(sign, sign)


_PLAIN_POWER = re.compile(r"(\d\.?\d*)e([-+]\d+)")


def table_on_page(table: doc.Table, star_page: str = "") -> dict[str, Any]:
    """Return what a page shows of a table, for the template.

    Parameters
    ----------
    table : Table
    star_page : str
        Address of the page of a star, to which the names of ranked stars lead; empty where there is none.

    Returns
    -------
    dict
        ``label`` for those who do not see it, ``caption``, ``heads`` as (text, classes), ``rows`` as (whether it is
        shaded, cells as (text, classes, whether it heads the row)), and ``legend``, the meaning of headings.
    """
    columns, same = (doc.shown_columns(table, "page"), "") if table.caption else _said_once(table)
    looks = [one.look.split() or ([] if one.right else ["left"]) for one in columns]
    first = next((number for number, look in enumerate(looks) if "row" in look), 0)
    rows = []
    for entry in table.entries:
        cells = [_page_cell(column, entry, star_page) for column in columns]
        picked = table.picked(entry) or doc.plain(cells[0]).startswith("→")
        classes = (" ".join(name for name in look if name not in ("row", "page")) for look in looks)
        rows.append(
            (picked, [(one, look, i == first) for i, (one, look) in enumerate(zip(cells, classes, strict=True))])
        )
    units = map(doc.unit_shown, columns)
    names = list(map(doc.name_shown, columns))
    sides = (" ".join(name for name in look if name in ("left", "pick")) for look in looks)
    heads = [(doc.lines(name, doc.small(unit)), side) for name, unit, side in zip(names, units, sides, strict=True)]
    title, *about = table.title.split("\n")
    said = "".join(f" {text}." for text in filter(None, [*about, same]))
    caption = [doc.strong(f"{title}."), said, " " if table.caption else "", table.caption]
    told = zip(names, columns, strict=True)
    legend = [] if table.caption else [f"{name}: {doc.meaning(one)}." for name, one in told if doc.meaning(one)]
    return {"label": title, "caption": caption, "heads": heads, "rows": rows, "legend": legend}


def _page_cell(column: Column, entry: Any, star_page: str) -> doc.Inline:
    """Return a cell with powers of ten; the name of a ranked star leads to its page."""
    text = doc.cell(column, entry)
    if isinstance(text, str) and column.right:
        return _PLAIN_POWER.sub(lambda found: f"{found[1]} × {power_of_ten(int(found[2]))}", text.strip())
    if star_page and isinstance(entry, results.RankedTarget) and column.name == "name":
        name = f"HIP {entry.hip}" if entry.hip else entry.name
        return doc.page_link(f"{star_page}?{urlencode({'name': name})}", doc.plain(text))
    return text


def _said_once(table: doc.Table) -> tuple[list[Column], str]:
    """Return the columns without those that repeat another one in every row, and a sentence that says which these are.

    Fewer than three rows, and cells without a value, repeat by chance; the last column, the status, always stays.
    """
    kept: dict[tuple[str, ...], Column] = {}
    columns, same = doc.shown_columns(table, "page"), []
    for number, column in enumerate(columns):
        texts = tuple(doc.cell_text(column, entry).strip() for entry in table.entries)
        chance = len(texts) < _LEAST_ROWS or set(texts) <= {"", MISSING} or number + 1 == len(columns)
        first = kept.setdefault((str(number),) if chance else texts, column)
        if first is not column:
            same.append(f"{doc.name_shown(column)} (as {doc.name_shown(first)})")
    return list(kept.values()), f"Left out, because alike in every row: {', '.join(same)}" * bool(same)


def together(blocks: Iterable[doc.Block]) -> Iterator[doc.Block]:
    """Yield blocks, many plain paragraphs after each other as one list: a wall of them is not read."""
    for is_plain, part in groupby(blocks, lambda one: isinstance(one, doc.Paragraph) and one.look in ("", "note")):
        found = list(part)
        texts = [block.text for block in found if isinstance(block, doc.Paragraph)]
        yield from [doc.Items(texts)] if is_plain and len(texts) >= _LEAST_ROWS else found


def page_html(document: doc.Document) -> str:
    """Return a document as one HTML file: style, images and the one script that may run are in it, nothing is fetched.

    The script sorts, filters and copies tables; the page says all without it.
    """
    environment = templates("cpic_planner.report")
    script = environment.get_template("page.js").render()
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return environment.get_template("page.html.j2").render(document=document, digest=digest)


@functools.cache
def templates(*packages: str, star_page: str = "") -> Environment:
    """Return the templates of packages; of one name that of the first package counts.

    Values are escaped for HTML, and what steers the order or look of signs is made visible. Names of ranked stars lead
    to ``star_page``.
    """
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    trimmed: dict[str, Any] = {"trim_blocks": True, "lstrip_blocks": True}
    loader = ChoiceLoader([PackageLoader(package) for package in packages])
    made = Environment(loader=loader, autoescape=True, finalize=_seen, undefined=StrictUndefined, **trimmed)
    made.globals |= {"on_page": functools.partial(table_on_page, star_page=star_page), "together": together}
    return made


def _seen(value: Any) -> Any:
    """Return plain text with control characters as escapes; markup of templates as it is."""
    return visible(value, "\n") if type(value) is str else value
