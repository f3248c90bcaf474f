"""A column of a table: its name and unit, what else people call it, and the range of values that is believed."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Column:
    """One column of a shipped table or of a user's own.

    Parameters
    ----------
    name : str
        Its name, which is always accepted as a heading.
    description : str
        What it holds, in one line.
    kind : {"text", "float", "bool", "int"}
        How cells are read; the whole number that people give is that of Hipparcos.
    unit : str
        Unit in which it is kept (astropy's spelling); of a column that names none, the unit that is assumed.
    aliases : str
        Other headings as reduced by :func:`heading`, blanks between them.
    low, high : float
        Range that is believed, inclusive.
    decimals : int
        Digits that a shipped table has after the point.
    """

    name: str
    description: str = ""
    kind: str = "text"
    unit: str = ""
    aliases: str = ""
    low: float = 0.0
    high: float = 0.0
    decimals: int = 0

    @property
    def headings(self) -> tuple[str, ...]:
        """Other headings than the name."""
        return tuple(self.aliases.split())

    @property
    def allowed(self) -> str:
        """Return what a cell may hold, in words."""
        if self.kind == "float":
            return f"a number, {self.range}"
        return {"bool": "yes or no, true or false, 1 or 0", "int": f"a Hipparcos number, {self.range}"}.get(
            self.kind, "text"
        )

    @property
    def range(self) -> str:
        """The range in words."""
        return f"{self.low:g} to {self.high:g} {self.unit}".strip()


def heading(text: str) -> str:
    """Reduce a column heading to its letters and digits, lower case: ``Sp_Type``, ``sp type``, ``SpType`` are one."""
    return re.sub(r"[^a-z0-9]", "", text.lower())


class Columns(dict[str, Column]):
    """The columns that a table may have, by name."""

    def __init__(self, columns: Iterable[Column]) -> None:
        super().__init__((column.name, column) for column in columns)
        self._by_heading = {form: item for item in self.values() for form in (heading(item.name), *item.headings)}

    def meant_by(self, text: str) -> tuple[Column | None, str]:
        """Return the column that a heading means and the unit written in it (``plx [mas]``), None if unknown."""
        if item := self._by_heading.get(heading(text)):
            return item, ""
        if found := re.fullmatch(r"\s*(.*\w.*?)\s*[\[(]([^\])]*)[\])]\s*", text):
            return self._by_heading.get(heading(found[1])), found[2].strip()
        return None, ""
