"""Cells of tables for people: made from the columns of rows, for terminals and for pages alike.

Tables on a terminal: columns that give way where it is narrow, and what its encoding can show.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

from pydantic import BaseModel

from cpic_core import InputError, visible
from cpic_planner import results
from cpic_planner.report.words import (
    LIMITED_BY,
    MISSING,
    STATUS_SYMBOLS,
    VERDICTS,
    contrast_text,
    formatted,
    significant,
    status_text,
)
from cpic_planner.version import __version__
from simulator.config import nearest

if TYPE_CHECKING:
    from rich.console import Console
    from rich.text import Text


_SOON = 9


_NEUTRAL = "·"


_WITH_UNIT = ("time", "bytes")
"""Formats that write the unit themselves."""


_MARKS = re.compile(f"^[→·{''.join(STATUS_SYMBOLS.values())}\\s]+")


@dataclass(frozen=True)
class Cells:
    """One column of a table.

    Attributes
    ----------
    header : str
        Heading on a terminal.
    text : callable
        Cell of a row.
    right : bool
        Side.
    gives_way : int
        How soon the column gives way on a narrow terminal; 0: never; the highest goes first.
    label, unit : str
        Heading in pages, and the unit below it.
    legend : str
        What the heading means, for the legend below a table.
    fields : tuple of str
        Fields of the row that stand in files for the column, as `cpic_planner.results.taken_of` takes them.
    of : callable
        The row of an entry of the table.
    kind : type, optional
        Kind of that row.
    numbers : tuple of Taken
        What stands in files for a column whose numbers are no fields of the row.
    for_files : bool
        Whether people see the column only where they ask for it by name.
    look : str
        Classes of its cells in pages, see `cpic_planner.report.document.Column`.
    """

    header: str
    text: Callable[[Any], Any]
    right: bool = True
    gives_way: int = 0
    label: str = ""
    unit: str = ""
    legend: str = ""
    fields: tuple[str, ...] = ()
    of: Callable[[Any], Any] = lambda row: row
    kind: type[results.Result] | None = None
    numbers: tuple[results.Taken, ...] = ()
    for_files: bool = False
    look: str = ""

    def cell(self, row: Any) -> str:
        """Return the text of a row's cell as every writer has it: names may hold what steers a terminal."""
        return visible(str(self.text(row)))

    @property
    def taken(self) -> Sequence[results.Taken]:
        """Columns that stand in files for it: numbers, else fields, else its text without marks."""
        if self.numbers:
            return self.numbers
        if self.fields and self.kind is not None:
            return results.taken_of(self.kind, *self.fields, of=self.of)
        name = re.sub(r"\W+", "_", self.header.casefold()).strip("_") or "text"
        return [results.Taken(results.Column(name, "string", self.legend), lambda row: plain_text(self, row))]


def plain_text(cells: Cells, row: Any) -> str:
    """Return the text of a cell without the marks in front of it."""
    return _MARKS.sub("", cells.cell(row))


def computed(
    header: str,
    value: Callable[[Any], Any],
    text: Callable[[Any], str],
    legend: str = "",
    name: str = "",
    unit: str = "",
) -> Cells:
    """Return a column whose numbers are worked out from the entry, and stand in files under a name of their own."""
    column = results.Column(name or header.replace(" ", "_"), "float64", legend, unit)
    taken = (results.Taken(column, value),)
    return Cells(header, lambda entry: text(value(entry)), legend=legend, numbers=taken)


Special: TypeAlias = Callable[[Any], Any] | Cells
"""What is written in a column instead of the row's own value."""


def row_cells(
    kind: type[results.Result],
    layout: str,
    /,
    *,
    of: Callable[[Any], results.Result | None] = lambda row: row,
    page: bool = False,
    **special: Special,
) -> list[Cells]:
    """Return the columns of a table from those of its rows.

    Parameters
    ----------
    kind : type
        Kind of the rows: headings, sides and formats are those of its columns.
    layout : str
        Names of the columns, in order; ``:row,star`` behind a name: looks of its cells in pages; ``/3`` behind that:
        how soon it gives way. ``frames`` stands for number and
        exposure of frames, ``status`` for verdict and reason. Columns that ask for it (``console=True``) and are not
        named stand before the last one.
    of : callable
        The row of an entry of the table; cells without a row are dashes.
    page : bool
        Write numbers as pages do: powers of ten.
    **special
        What is written in a column instead, from the entry; a `Cells` where the row has no such field.

    Returns
    -------
    list of Cells
    """
    shared = _SHARED if "verdict" in kind.model_fields else {"frames": _SHARED["frames"]}
    columns, named = [], []
    for each in layout.split():
        word, _, way = each.partition("/")
        name, _, look = word.partition(":")
        own = special.get(name)
        if own is None and name in shared:
            own = replace(shared[name], text=_through(of, shared[name].text))
        if not isinstance(own, Cells):
            own = _column_cells(results.column_of(kind, name), own, of, page)
        columns.append(replace(own, gives_way=int(way or 0), look=look.replace(",", " "), kind=kind, of=of))
        named.append(name)
    more = [column for column in results.columns_of(kind) if column.console and column.name not in named]
    new = (_column_cells(column, None, of, page) for column in more)
    columns[-1:-1] = [replace(cells, gives_way=_SOON, kind=kind, of=of) for cells in new]
    return columns


def own_cells(rows: Sequence[Any]) -> list[Cells]:
    """Return the columns of a user's table that rows carry; see `cpic_planner.results.own_taken`."""
    found = ((item.column.name, _taken_cells(item)) for item in results.own_taken(rows))
    return [replace(cells, header=name, label=name, for_files=True) for name, cells in found]


def offered(columns: Sequence[Cells]) -> dict[str, Cells]:
    """Return the columns that a table can have, by their names in files: those of its rows, then those shown beside."""
    shown = {cells.taken[0].column.name: cells for cells in columns if len(cells.taken) == 1}
    kinds = dict.fromkeys((cells.kind, cells.of) for cells in columns if cells.kind is not None)
    every = [item for kind, of in kinds if kind is not None for item in results.taken_of(kind, of=of)]
    every += [item for cells in columns for item in cells.taken]
    return {item.column.name: shown.get(item.column.name) or _taken_cells(item) for item in every}


def chosen(columns: Sequence[Cells], names: Sequence[str], key: str = "--columns") -> list[Cells]:
    """Return columns of a table by their names in files, in the given order; none of them gives way.

    Raises
    ------
    InputError
        For a name that the table does not have, or that is given twice.
    """
    every = offered(columns)
    for number, name in enumerate(names):
        if name not in every:
            raise InputError(key, name, allowed=f"{key} help lists them", hint=nearest(name, every))
        if name in names[:number]:
            raise InputError(key, name, allowed="each column once")
    return [replace(every[name], gives_way=0, for_files=False) for name in names]


def _taken_cells(item: results.Taken) -> Cells:
    column, form = item.column, item.column.format.partition(" ± ")[0]
    unit = "%" if form == "%" else "" if form in _WITH_UNIT else column.unit
    heading = column.short or f"{column.label} {unit}".strip()
    look: dict[str, Any] = {"label": column.label, "unit": unit, "legend": column.description}
    return Cells(heading, lambda entry: formatted(item.value(entry), form), column.right, numbers=(item,), **look)


def _column_cells(
    column: results.Column, own: Callable[[Any], Any] | None, of: Callable[[Any], Any], page: bool
) -> Cells:
    text = own or _through(of, _cell_text(column, page))
    form = column.format
    fields = (column.name, f"{column.name}_error") if " ± " in form else (column.name,)
    unit = "%" if form == "%" else "" if form in _WITH_UNIT else column.unit
    legend = column.description.partition(";")[0] if column.short and column.right else ""
    legend = legend.removesuffix(f", {column.unit}")  # the cells may be in another one
    heading = column.label if form in _WITH_UNIT and not column.short else column.heading
    return Cells(heading, text, column.right, 0, column.label, unit, legend, fields, of)


def _through(of: Callable[[Any], Any], text: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda entry: MISSING if of(entry) is None else text(of(entry))


def _cell_text(column: results.Column, page: bool) -> Callable[[Any], str]:
    """Return the value of a column, with its error behind it where the format has one."""
    form, _, error = column.format.partition(" ± ")

    def written(value: Any, form: str) -> str:
        power = page and form.startswith(".") and form.endswith("e")
        return contrast_text(value, int(form[1:-1]) + 1) if power else formatted(value, form)

    def text(row: Any) -> str:
        spread = getattr(row, f"{column.name}_error") if error else None
        value = written(getattr(row, column.name), form)
        return value if spread is None else f"{value} ± {written(spread, error)}"

    return text


def status_cell(status: str, reason: str) -> str:
    """Return the symbol and the short reason; `explain_symbols` explains the symbols below the table."""
    return f"{STATUS_SYMBOLS.get(status, '')} {reason.replace('_', ' ') or status_text(status)}".strip()


def verdict_cell(item: results.EtcAnswer | results.RankedTarget | results.BandStanding) -> str:
    """Return the verdict of an answer in a cell; the mark of a success stands before a detection only."""
    if item.status == "ok":
        if item.verdict == "detected":
            return f"{STATUS_SYMBOLS['ok']} {VERDICTS['detected']}"
        return status_text("ok") if item.verdict is None else f"{_NEUTRAL} {VERDICTS[item.verdict]}"
    if item.reason in ("speckle_floor", "common_speckle_floor") and item.limited_by in ("photons", "background"):
        return f"{STATUS_SYMBOLS[item.status]} {LIMITED_BY[item.limited_by][0]}"
    return status_cell(item.status, item.reason)


def frames_text(
    item: results.RankedTarget | results.BandConfirmation | results.EtcAnswer | results.SearchRecord,
) -> str:
    """Return the number of frames and their exposure."""
    if item.exposure_s is None or item.n_frames is None:
        return MISSING
    return f"{item.n_frames} × {significant(item.exposure_s)}"


_SHARED = {
    "frames": Cells("frames × s", frames_text, label="frames × exposure", unit="s", fields=("n_frames", "exposure_s")),
    "status": Cells("status", verdict_cell, right=False, label="status", fields=("verdict", "status", "reason")),
}


class Sheet:
    """Stands where a console does, and takes the first table alone: what follows it is left out.

    Parameters
    ----------
    console : Console
    form : str
        ``table``: printed on the console with what stands before it; else kept in ``taken`` for
        `cpic_planner.report.cells.form_text`, with all columns.
    columns : sequence of str
        Names of the columns that are asked for; the table then stands alone.
    """

    columns: Sequence[str] = ()

    def __init__(self, console: Console, form: str = "table", columns: Sequence[str] = ()) -> None:
        self._console, self.form, self.columns = console, form, columns
        self.width, self.encoding = console.width, console.encoding
        self.taken: tuple[str, Sequence[Cells], list[Any]] | None = None

    def take(self, title: str, columns: Sequence[Cells], entries: list[Any]) -> None:
        """Keep a table, if it is the first."""
        self.taken = self.taken or (title, columns, entries)

    def print(self, *objects: Any, **look: Any) -> None:
        """Print what stands before the table, and the table."""
        if self.form == "table" and self.taken is None and not self.columns:
            self._console.print(*objects, **look)

    def print_table(self, table: Any, width: int) -> None:
        """Print the table; one of chosen columns as wide as it is."""
        if self.columns:
            self._console.width = max(width, self.width)
        self._console.print(table)


_STYLE = {"ok": "green", "unreachable": "yellow", "saturated": "red", "outside_field": "magenta", "invalid": "red"}


_GAP = 2


_LAST_COLUMN = 18


def print_table(
    console: Console,
    title: str,
    columns: Sequence[Cells],
    rows: Iterable[Any],
    *,
    last_width: int = _LAST_COLUMN,
    explained: bool = False,
    legend: bool = False,
) -> None:
    """Print a table of the columns that fit; the last one (status) always stays and may wrap.

    Parameters
    ----------
    console : Console
    title : str
    columns : sequence of Cells
    rows : iterable
        What `Cells.text` takes.
    last_width : int
        Width beyond which the last column wraps.
    explained : bool
        Explain the symbols of the rows' statuses below the table.
    legend : bool
        Explain the headings below the table.
    """
    from rich import box
    from rich.cells import cell_len
    from rich.table import Table
    from rich.text import Text

    entries = list(rows)
    sheet = console if isinstance(console, Sheet) else None
    if sheet is not None and sheet.columns and sheet.taken is None:
        columns, last_width = chosen(columns, sheet.columns), sheet.width
    elif sheet is None or sheet.form in ("table", "page"):
        columns = [column for column in columns if not column.for_files]
    if sheet is not None and (sheet.taken is not None or sheet.form != "table"):
        sheet.take(title, columns, entries)
        return
    rows = [[column.cell(row) for column in columns] for row in entries]
    widths = [max([cell_len(c.header), *(cell_len(row[i]) for row in rows)]) + _GAP for i, c in enumerate(columns)]
    widths[-1] = min(widths[-1], last_width + _GAP)
    shown = fitting(columns, widths, console.width)
    look: dict[str, Any] = {"box": box.SIMPLE_HEAD, "padding": (0, _GAP - 1, 0, 0)}
    heading = Text(displayable(console, title), style="bold")
    table = Table(title=heading, title_justify="left", pad_edge=False, show_edge=False, **look)
    for i in shown:
        last = i == len(columns) - 1
        look = {"no_wrap": not last, "overflow": "fold" if last else "ellipsis", "vertical": "top"}
        header = Text(displayable(console, columns[i].header))
        table.add_column(header, justify="right" if columns[i].right else "left", **look)
    for row in rows:
        table.add_row(*(_cell(console, row[i]) for i in shown))
    if sheet is None:
        console.print(table)
    else:
        sheet.print_table(table, sum(widths))
        sheet.taken = title, columns, entries
    if explained:
        explain_symbols(console, [entry.status for entry in entries if entry.status != "ok"])
    if legend:
        said = [f"{columns[i].header}: {columns[i].legend}" for i in shown if columns[i].legend]
        print_note(console, "; ".join(said))


def fitting(columns: Sequence[Cells], widths: Sequence[int], room: int) -> list[int]:
    """Return the places of the columns that fit, after those that give way soonest are left out."""
    shown = list(range(len(columns)))
    for i in sorted(shown, key=lambda i: -columns[i].gives_way):
        if sum(widths[j] for j in shown) > room and columns[i].gives_way > 0:
            shown.remove(i)
    return shown


def displayable(console: Console, text: str) -> str:
    """Return what a terminal can show: no control characters, and question marks for what its encoding has not."""
    return visible(text, "\n").encode(console.encoding, "replace").decode(console.encoding)


def _cell(console: Console, text: str) -> Text:
    """Return the text without markup (names may hold brackets), coloured when it starts with a status symbol."""
    from rich.text import Text

    for status, symbol in STATUS_SYMBOLS.items():
        if text.startswith(symbol):
            return Text(displayable(console, text), style=_STYLE[status])
    return Text(displayable(console, text))


def print_note(console: Console, *texts: str) -> None:
    """Print lines below a table."""
    from rich.text import Text

    for text in texts:
        console.print(Text(displayable(console, text), style="dim"))


def print_plain(console: Console, *texts: str, bold: bool = False, wraps: bool = True) -> None:
    """Print lines of text, which wrap as words do on a terminal unless they are to be copied whole."""
    from rich.text import Text

    for text in texts:
        console.print(Text(displayable(console, text), style="bold" if bold else ""), soft_wrap=not wraps)


def explain_symbols(console: Console, statuses: list[str]) -> None:
    """Explain the symbols of a table."""
    used = [status for status in STATUS_SYMBOLS if status in statuses]
    if used and used != ["ok"]:
        print_note(console, "   ".join(f"{STATUS_SYMBOLS[status]} {status_text(status)}" for status in used))


_LATEX_WIDTH, _LATEX_GAP = 82, 2  # letters of \\footnotesize on a line of an article, and between two columns


_POWER = re.compile(r"(\d\.?\d*)e([-+]\d+)")


_LATEX = {"\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "#": r"\#", "_": r"\_", "$": r"\$", "{": r"\{", "}": r"\}"}


_LATEX |= {"~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "–": r"\ldots{}", "×": r"$\times$", "±": r"$\pm$"}


_LATEX |= {
    "−": "$-$",
    "″": "$''$",
    "′": "$'$",
    "°": r"$^\circ$",
    "<": "$<$",
    ">": "$>$",
    "\u202f": r"\,",
}


_LATEX |= {"≥": r"$\ge$", "≤": r"$\le$", "λ": r"$\lambda$", "⊕": r"$\oplus$", "…": r"\ldots{}"}


def form_text(
    form: str,
    result: BaseModel,
    taken: tuple[str, Sequence[Cells], Sequence[Any]],
    *,
    columns: Sequence[str] = (),
    caption: str = "",
    label: str = "",
) -> str:
    """Return a table of the terminal as text of another form.

    Parameters
    ----------
    form : str
        ``csv`` and ``ecsv`` have the fields of the rows, units in the names or the header, numbers in full and empty
        cells for null; ``latex`` (a ``table`` with the columns that fit a page) and ``markdown`` have the cells of
        the terminal.
    result : BaseModel
        The result that the table is of: it says where its data are from.
    taken : tuple
        Title, columns and entries of the table, as `cpic_planner.report.cells.Sheet` keeps them.
    columns : sequence of str
        Names of the columns that are asked for; those of the table by default.
    caption, label : str
        Of a ``table`` in LaTeX; by default the title with the data and the version, and the kind of result.

    Raises
    ------
    InputError
        For columns that the table does not have.
    """
    title, shown, rows = visible(taken[0], "\n"), *taken[1:]
    shown = chosen(shown, columns) if columns else shown
    if form in ("latex", "markdown"):
        shown = [column for column in shown if not column.for_files]
        cells = [[plain_text(column, row) for column in shown] for row in rows]
        if form == "latex":
            label = label or f"tab:{getattr(result, 'kind', 'table')}"
            return _latex(caption or _caption(title, result), label, shown, cells)
        heads = [f"{column.label or column.header}{f' ({column.unit})' * bool(column.unit)}" for column in shown]
        return _markdown(title, heads, [column.right for column in shown], cells)
    items = {item.column.name: item for column in shown for item in column.taken}
    if form == "ecsv":
        meta = {"title": title, "flag_separator": results.FLAG_SEPARATOR}
        return results.ecsv_text(list(items.values()), rows, meta)
    table = ({name: item.value(row) for name, item in items.items()} for row in rows)
    return results.csv_text(tuple(items), table, joined=results.FLAG_SEPARATOR)


def offered_text(taken: tuple[str, Sequence[Cells], Sequence[Any]]) -> str:
    """Return the columns that a table can have, a line each: name, unit, meaning."""
    lines = []
    for name, cells in offered(taken[1]).items():
        column = next(item.column for item in cells.taken if item.column.name == name)
        unit = f" [{column.unit}]" if column.unit else ""
        lines.append(f"{name}{unit}{f': {column.description}' if column.description else ''}\n")
    return "".join(lines)


def _caption(title: str, result: BaseModel) -> str:
    """Return what a table is, of which date and data, and the version that made it, as sentences."""
    date = str(getattr(result, "date_utc", ""))[:10]
    said = (
        *title.split("\n"),
        f"Date: {date}" if date else "",
        str(getattr(result, "catalogue", "")).partition(" (")[0],
    )
    return " ".join(f"{text.strip().rstrip('.')}." for text in (*said, f"cpic-planner {__version__}") if text.strip())


def _markdown(title: str, heads: Sequence[str], right: Sequence[bool], cells: Sequence[Sequence[str]]) -> str:
    def line(words: Sequence[str]) -> str:
        return f"| {' | '.join(word.replace('|', chr(92) + '|') for word in words)} |\n"

    rule = line(["---:" if side else "---" for side in right])
    return f"{title}\n\n{line(heads)}{rule}{''.join(map(line, cells))}"


def _latex(caption: str, label: str, columns: Sequence[Cells], cells: Sequence[Sequence[str]]) -> str:
    heads = [
        f"{item.header} ({item.unit})" if item.unit and item.header == item.label else item.header for item in columns
    ]
    widths = [max(len(line[i]) for line in [heads, *cells]) + _LATEX_GAP for i in range(len(heads))]
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
    made = []
    for part in re.split(r"(\d\.?\d*e[-+]\d+)", visible(text)):
        power = _POWER.fullmatch(part)
        if power is not None:
            made.append(rf"${power[1]}\times10^{{{int(power[2])}}}$")
            continue
        made.append("".join(map(_latex_sign, part)))
    return "".join(made)


def _latex_sign(sign: str) -> str:
    name = unicodedata.name(sign, "")
    if name.startswith("GREEK SMALL LETTER "):
        letter = name.rsplit(" ", 1)[1].lower()
        return "o" if letter == "omicron" else rf"$\{letter}$"
    if name.startswith(("SUPERSCRIPT", "SUBSCRIPT")):
        kind = "^" if name.startswith("SUPER") else "_"
        return f"${kind}{{{unicodedata.normalize('NFKD', sign).replace(chr(0x2212), '-')}}}$"
    return _LATEX.get(sign, sign)
