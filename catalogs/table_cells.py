"""A column of a table: its name and unit, what else people call it, and the range of values that is believed.

The one reader of users' tables: which column is which, cells in their unit and range, and what a row must have.
"""

import math
import re
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from catalogs.table_files import RawColumn, RawTable
from cpic_core import InputError


@dataclass(frozen=True)
class Column:
    """One column of a shipped table or of a user's own.

    Parameters
    ----------
    name : str
        Its name, which is always accepted as a heading.
    description : str
        What it holds, in one line.
    kind : {"text", "float", "whole", "bool", "int"}
        How cells are read; ``int`` is the number of Hipparcos, which people write with and without its letters.
    unit : str
        Unit in which it is kept (astropy's spelling); of a column that names none, the unit that is assumed.
    aliases : str
        Other headings as reduced by `catalogs.table_cells.heading`, blanks between them. One with a capital letter is
        meant as it is written: ``Omega`` is another angle than ``omega``.
    low, high : float
        Range that is believed, inclusive.
    decimals : int
        Digits that a shipped table has after the point.
    fills : bool
        Whether a number such as 9999 or -99.99 stands for a missing one.
    """

    name: str
    description: str = ""
    kind: str = "text"
    unit: str = ""
    aliases: str = ""
    low: float = 0.0
    high: float = 0.0
    decimals: int = 0
    fills: bool = False

    @property
    def headings(self) -> tuple[str, ...]:
        """Other headings than the name."""
        return tuple(self.aliases.split())

    @property
    def allowed(self) -> str:
        """Return what a cell may hold, in words."""
        if self.kind in ("float", "whole"):
            return f"a {'whole ' * (self.kind == 'whole')}number, {self.range}"
        words = {"bool": "yes or no, true or false, 1 or 0", "int": f"a Hipparcos number, {self.range}"}
        return words.get(self.kind, "text")

    @property
    def range(self) -> str:
        """The range in words."""
        return f"{self.low:g} to {self.high:g} {self.unit}".strip()

    def is_fill(self, value: float) -> bool:
        """Tell whether a number of the file is one that tables write where they have none: nothing but nines.

        No star has a V of exactly -1 either, while differences of magnitudes may be that; -99.9 km/s may be measured.
        """
        if not self.fills or set(f"{abs(value):.12g}".replace(".", "")) != {"9"}:
            return self.fills and value == -1.0 and self.unit == "mag" and self.low > -2.0
        return value < -9.9 if self.unit == "mag" else value < -99.9 or value > 999.0


def heading(text: str) -> str:
    """Reduce a column heading to its letters and digits, lower case: ``Sp_Type``, ``sp type``, ``SpType`` are one."""
    return _plain(text).lower()


def _plain(text: str) -> str:
    """Return a heading's letters and digits; a sign at its end is part of its meaning (``DE-`` of split angles)."""
    return re.sub(r"[^A-Za-z0-9]", "", text) + ("sign" if re.search(r"[-+]\s*$", text) else "")


class Columns(dict[str, Column]):
    """The columns that a table may have, by name.

    Parameters
    ----------
    *columns : Column
    cased : mapping of str to str, optional
        Headings as reduced by `catalogs.table_cells.heading` that mean something else with a capital letter, and the
        names of the columns that may be meant.
    """

    def __init__(self, *columns: Column, cased: Mapping[str, str] | None = None) -> None:
        super().__init__((column.name, column) for column in columns)
        self._by_heading = {form: item for item in self.values() for form in (heading(item.name), *item.headings)}
        self._cased = cased or {}

    def meant_by(self, text: str) -> tuple[Column | None, str]:
        """Return the column that a heading means and the unit written in it (``plx [mas]``), None if unknown.

        Raises
        ------
        InputError
            For a heading whose capitals leave open what it means (``OMEGA``).
        """
        if item := self._known(text):
            return item, ""
        if found := re.fullmatch(r"\s*(.*\w.*?)\s*[\[(]([^\])]*)[\])]\s*", text):
            return self._known(found[1]), found[2].strip()
        return None, ""

    def _known(self, text: str) -> Column | None:
        form = _plain(text)
        if (names := self._cased.get(form.lower())) is None:
            return self._by_heading.get(form, self._by_heading.get(form.lower()))
        if form[1:2].isupper() or (item := self._by_heading.get(form[0] + form[1:].lower())) is None:
            raise InputError(f"column {text}", "more than one meaning", allowed=names, hint="name it as it is meant")
        return item


Row = dict[str, Any]
"""One row by the names of columns; what is missing is left out."""
Groups = Sequence[Sequence[str]]
"""Names of columns; of each group a table, or a row, must have one."""

_YES, _NO = ("1", "1.0", "true", "t", "yes", "y"), ("0", "0.0", "false", "f", "no", "n")
_HOURS = ("h", "hour", "hours", "hourangle")
_PLURALS = {"days": "d", "degrees": "deg", "years": "yr", "hours": "h"}
_WORDS = {"name": "a unique name", "sp_type": "a spectral type such as G2V"}
_SHOWN = 40
_MANY = 12


@dataclass(frozen=True)
class Rows:
    """The rows of a table whose columns were understood.

    Parameters
    ----------
    label : str
        Name of the file.
    columns : Columns
        What the table may have.
    headings : dict of str to str
        What the file calls each column that it has.
    rows : list of Row
    about : str
        Name of the column that says what a row is about.
    notes : tuple of str
        Remarks on the reading.
    unused : tuple of str
        Headings of the file that were not used.
    """

    label: str
    columns: Columns
    headings: dict[str, str]
    rows: list[Row]
    about: str
    notes: tuple[str, ...]
    unused: tuple[str, ...] = ()

    def __iter__(self) -> Iterator[tuple[str, Row]]:
        """Return each row after the words by which messages name it."""
        for number, row in enumerate(self.rows, start=1):
            yield f"{self.label} row {number}" + (f" ({row[self.about]})" if self.about in row else ""), row

    def refuse_missing(self, where: str, row: Row, groups: Groups) -> None:
        """Refuse a row that has nothing of one of the groups.

        Parameters
        ----------
        where : str
            Words for the row.
        row : Row
        groups : sequence of sequence of str

        Raises
        ------
        InputError
            Naming the columns and what they may hold.
        """
        for names in groups:
            if not any(name in row for name in names):
                own = [name for name in names if name in self.headings] or list(names)
                allowed = " or ".join(_WORDS.get(name) or self.columns[name].allowed for name in own)
                column = " or ".join(self.headings.get(name, name) for name in own)
                raise InputError(f"{where} column {column}", "missing", allowed=allowed)

    def refuse_twins(self, key: Callable[[Row], Hashable], *, remedy: str = "") -> None:
        """Refuse a table in which two rows are about one thing.

        Parameters
        ----------
        key : callable
            What is the same for all names of one thing.
        remedy : str
            What to do about it.

        Raises
        ------
        InputError
            Naming both rows.
        """
        first: dict[Hashable, int] = {}
        for number, (where, row) in enumerate(self, start=1):
            before = first.setdefault(key(row), number)
            if before != number:
                hint = "; ".join(filter(None, (f"rows {before} and {number} are of one name", remedy)))
                allowed = f"every {self.about} once"
                raise InputError(f"{where} column {self.about}", row[self.about], allowed=allowed, hint=hint)


def read_rows(raw: RawTable, columns: Columns, required: Groups, *, about: str) -> Rows:
    """Return the rows of a table, every cell in the unit of its column and checked.

    Parameters
    ----------
    raw : RawTable
        What :func:`catalogs.table_files.parse_table` read.
    columns : Columns
        What it may have.
    required : sequence of sequence of str
        Of each of these groups the table must have a column.
    about : str
        Name of the column that says what a row is about.

    Raises
    ------
    InputError
        Naming file, row, column, value, unit and range: a required column is missing, two columns claim to be one, a
        unit is not understood, or a cell is not what its column holds.
    """
    chosen, unused = _chosen(raw, columns, required)
    said = f"{raw.name}: columns not used: {listed(unused)}"
    left = tuple(f"{raw.name} row {bad.row} is left out: {bad.value}, allowed {bad.reason}" for bad in raw.rejects)
    notes = raw.notes + left + ((said,) if unused else ())
    names = chosen[about].cells.tolist() if about in chosen else [None] * len(raw)
    cells = {name: _read(raw.name, columns[name], column, names) for name, column in chosen.items()}
    rows = [{name: values[i] for name, values in cells.items() if values[i] is not None} for i in range(len(raw))]
    headings = {name: column.heading for name, column in chosen.items()}
    return Rows(raw.name, columns, headings, rows, about, notes, unused)


def _chosen(raw: RawTable, columns: Columns, required: Groups) -> tuple[dict[str, RawColumn], tuple[str, ...]]:
    """Return the column of the file for each of ours, and the headings of the others."""
    candidates: dict[str, list[RawColumn]] = {}
    ignored = []
    for column in raw.columns:
        try:
            meant, unit = columns.meant_by(column.heading)
        except InputError as error:
            raise InputError(f"{raw.name} {error.key}", error.value, allowed=error.allowed, hint=error.hint) from None
        if meant is None:
            ignored.append(column.heading or "(no heading)")
        else:
            own = RawColumn(column.heading, column.unit or unit, column.cells)
            candidates.setdefault(meant.name, []).append(own)
    chosen = {}
    for name, found in candidates.items():
        exact = [column for column in found if column.heading == name]
        if len(found) > 1 and len(exact) != 1:
            both = " and ".join(column.heading for column in found)
            raise InputError(f"{raw.name} columns", both, allowed=f"one column for {name}", hint=f"name it {name}")
        chosen[name] = exact[0] if exact else found[0]
        ignored += [column.heading for column in found if column is not chosen[name]]
    lacking = [group for group in required if not any(name in chosen for name in group)]
    if lacking:
        needed = [name for group in lacking for name in group]
        forms = "; ".join(f"{name} ({', '.join(columns[name].headings[:6])}, ...)" for name in needed)
        wanted = ", ".join(" or ".join(group) for group in lacking)
        # With one known column or none it may be any file at all, and is not quoted.
        names = f": {listed([column.heading for column in raw.columns])}"
        hint = f"the file has{names if len(chosen) > 1 else f' {len(raw.columns)} columns'}"
        raise InputError(f"{raw.name} column {wanted}", "missing", allowed=forms, hint=hint)
    return chosen, tuple(ignored)


def listed(words: Sequence[str]) -> str:
    """Return words with commas, and how many more there are than can be read."""
    return ", ".join(words[:_MANY]) + (f" and {len(words) - _MANY} more" if words[_MANY:] else "")


def _read(label: str, column: Column, given: RawColumn, names: Sequence[Any]) -> list[Any]:
    """Return the cells in the unit of the column, checked; None where missing."""
    number = column.kind in ("float", "whole")
    convert = _converter(label, column, given) if number else None
    values = []
    for i, cell in enumerate(given.cells.tolist()):
        fill = False
        try:
            value = None if cell is None else _READERS[column.kind](cell)
            if value is not None and convert is not None:
                if fill := column.is_fill(value):
                    raise ValueError
                value = convert(value)
                if not column.low <= value <= column.high or (column.kind == "whole" and value % 1):
                    raise ValueError
        except (ValueError, OverflowError):
            who = "" if names[i] is None else f" ({names[i]})"
            key = f"{label} row {i + 1}{who} column {given.heading}"
            unit = (given.unit or column.unit) if number else ""
            hint = "write a decimal point" if isinstance(cell, str) and "," in cell else ""
            hint = "it stands for a missing number: leave the cell empty" if fill else hint
            raise InputError(key, str(cell)[:_SHOWN], unit=unit, allowed=column.allowed, hint=hint) from None
        values.append(value)
    return values


def _text(cell: Any) -> str | None:
    return " ".join(str(cell).split()) or None


def _number(cell: Any) -> float:
    if isinstance(cell, bool) or (isinstance(cell, str) and "_" in cell):  # Python reads 1_000, people do not
        raise ValueError
    value = float(cell)
    if not math.isfinite(value):
        raise ValueError
    return value


def _flag(cell: Any) -> bool:
    text = str(cell).strip().lower()
    if text not in _YES + _NO:
        raise ValueError
    return text in _YES


def _hip(cell: Any) -> int | None:
    found = re.fullmatch(r"(?:HIP\s*)?(\d+)(?:\.0*)?", str(cell).strip(), re.IGNORECASE)
    if not found or int(found[1]) > 120404:
        raise ValueError
    return int(found[1]) or None


_READERS: dict[str, Callable[[Any], Any]] = {
    "text": _text,
    "bool": _flag,
    "int": _hip,
    "float": _number,
    "whole": _number,
}


def _converter(label: str, column: Column, given: RawColumn) -> Callable[[float], float]:
    """Return the conversion from the unit of the file, the identity where it names none or the same."""
    if given.unit.replace(" ", "") in ("", column.unit.replace(" ", ""), "---", "-", "none"):
        return float
    from astropy import units

    text = _PLURALS.get(given.unit.strip().lower(), given.unit)  # as archives write them
    logarithmic = column.name in ("log_g", "metallicity")
    if column.name == "log_g":  # dex(cm/s2), [cm/s2] and log(cm.s**-2) are all in use
        text = re.sub(r"^(?:\[(.*)\]|(?:dex|log|log10)\((.*)\))$", r"\1\2", text.strip())
    try:
        clock = column.name == "ra_deg" and text.lower() in _HOURS
        unit = units.hourangle if clock else units.Unit(text)
        if column.name == "metallicity" or text == "dex":
            factor = (1.0 * unit).to_value(units.dex)
        else:
            factor = (1.0 * unit).to_value("cm / s2" if logarithmic else column.unit)
        shift = math.log10(factor) if column.name == "log_g" and text != "dex" else 0.0
    except (ValueError, TypeError):
        allowed = f"a unit like {column.unit or 'none'}"
        raise InputError(f"{label} column {given.heading}", f"unit {given.unit}", allowed=allowed) from None
    if logarithmic:
        return lambda value: value + shift
    return lambda value: value * factor
