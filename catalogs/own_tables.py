"""Tables of a user's own: how strictly they are read, what was left out of them, and what their columns are taken for.

Commands and functions open tables in many places. What a user asks of all of them, and the list of what was left out
of any, is kept here while one question is answered.
"""

import contextlib
import logging
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from catalogs.table_cells import Columns, Groups, LeftOut, Rows, Use, reasons
from catalogs.table_files import RawTable, parse_table, read_bytes
from cpic_core import InputError

_LOG = logging.getLogger(__name__)
TableKind = Literal["stars", "planets"]


def _log(remark: str) -> None:
    _LOG.warning("%s", remark)


@dataclass
class OwnTables:
    """The tables of a user's own that were read for one question.

    Parameters
    ----------
    strict : bool
        Whether a table is refused for the first row or cell that cannot be used.
    tell : callable
        Gets remarks on the reading.
    tables : dict
        What was left out of each table, by its name and what its columns were taken for, in the order of reading.
    told : set of str
        Remarks that were told.
    """

    strict: bool = False
    tell: Callable[[str], None] = _log
    tables: dict[tuple[str, tuple[Use, ...]], list[LeftOut]] = field(default_factory=dict)
    told: set[str] = field(default_factory=set)

    @property
    def left_out(self) -> list[tuple[str, LeftOut]]:
        """Rows and cells that were not used, after the name of their table; by row."""
        tables = ((name, sorted(items, key=lambda item: item.row)) for (name, _), items in self.tables.items())
        return [(name, item) for name, items in tables for item in items]


_READ: ContextVar[OwnTables | None] = ContextVar("tables_read", default=None)


@contextlib.contextmanager
def tables_read(
    *, strict: bool = False, tell: Callable[[str], None] | None = None, apart: bool = False
) -> Iterator[OwnTables]:
    """Read tables of a user's own as one question asks, and yield those that were read.

    Parameters
    ----------
    strict : bool
        As of `OwnTables`.
    tell : callable, optional
        Gets remarks on the reading, each once; by default they are logged.
    apart : bool
        Whether it is no part of a question around it; else it is as strict as that, and tells what that tells.
    """
    outer = _READ.get()
    made = OwnTables(strict, tell or _log)
    if outer is not None and not apart:
        made = OwnTables(strict or outer.strict, tell or outer.tell, outer.tables, outer.told)
    token = _READ.set(made)
    try:
        yield made
    finally:
        _READ.reset(token)


def is_strict(strict: bool) -> bool:
    """Return whether a table is to be refused for what cannot be used: where the caller or the question says so."""
    asked = _READ.get()
    return strict or (asked is not None and asked.strict)


def keep(rows: Rows) -> Rows:
    """Put a table that is being read beside the others of the question; what is left out of it may grow."""
    asked = _READ.get()
    if asked is not None:
        asked.tables[rows.label, rows.uses] = rows.left_out
    return rows


def tell(*remarks: str) -> None:
    """Tell remarks on the reading of a table, each once for a question."""
    asked = _READ.get() or OwnTables()
    for remark in remarks:
        if remark not in asked.told:
            asked.told.add(remark)
            asked.tell(remark)


@dataclass(frozen=True)
class Taken:
    """The meaning of a file as a table of one kind.

    Parameters
    ----------
    kind : {"stars", "planets"}
    file : str
        Its name.
    rows, usable : int
        Rows of the file, and those that can be used.
    uses : tuple of Use
        What each column is taken for.
    left_out : tuple of LeftOut
        Rows and cells that cannot be used.
    notes : tuple of str
        Remarks on the reading.
    """

    kind: TableKind
    file: str
    rows: int
    usable: int
    uses: tuple[Use, ...]
    left_out: tuple[LeftOut, ...]
    notes: tuple[str, ...]

    @property
    def reasons(self) -> list[tuple[LeftOut, int]]:
        """The first row or cell of each reason for which some are left out, and how many there are; most first."""
        return reasons(self.left_out)


def taken_for(source: str | Path, kind: TableKind | None = None, *, strict: bool = False) -> list[Taken]:
    """Return what a file is taken for: as a table of stars, of planets, or of both where both can be read from it.

    Parameters
    ----------
    source : str or Path
    kind : {"stars", "planets"}, optional
        Which of the two it is; by default each that it can be.
    strict : bool
        Refuse it for the first row or cell that cannot be used.

    Raises
    ------
    InputError
        If it is neither: why it is none of the kind of which it has more columns.
    """
    raw = parse_table(read_bytes(source, key="file", presets=""))
    made, refused = [], []
    for one, read in _READERS.items():
        if kind in (None, one):
            with tables_read(apart=True):
                try:
                    made.append(read(raw, False))
                except InputError as error:
                    refused.append((_known(raw, one), error))
    if not made:
        raise max(refused, key=lambda item: item[0])[1]
    if strict:
        for taken in made:
            _READERS[taken.kind](raw, True)
    return made


def possible_columns(kind: TableKind) -> tuple[Columns, Groups]:
    """Return the columns that a table of a kind may have, and groups of those of which it needs one each.

    Parameters
    ----------
    kind : {"stars", "planets"}
    """
    if kind == "stars":
        from catalogs.star_columns import QUANTITIES
        from catalogs.user_table import REQUIRED

        return QUANTITIES, REQUIRED
    from catalogs import known_planets
    from catalogs.known_planet_columns import COLUMNS

    return COLUMNS, known_planets.REQUIRED


def _known(raw: RawTable, kind: TableKind) -> int:
    """Return how many headings of a file are known in tables of a kind."""
    columns, known = possible_columns(kind)[0], 0
    for column in raw.columns:
        with contextlib.suppress(InputError):
            known += columns.meant_by(column.heading).column is not None
    return known


def _stars(raw: RawTable, strict: bool) -> Taken:
    from catalogs.user_table import user_table

    found = user_table(raw, strict=strict)
    return Taken("stars", raw.name, len(raw), len(found.table), found.uses, found.left_out, found.notes)


def _planets(raw: RawTable, strict: bool) -> Taken:
    from catalogs.known_planets import own_rows

    _, given = own_rows(raw, strict=strict)
    notes = given.notes + given.told()
    return Taken("planets", raw.name, len(raw), len(given.rows), given.uses, tuple(given.left_out), notes)


_READERS: dict[TableKind, Callable[[RawTable, bool], Taken]] = {"stars": _stars, "planets": _planets}
