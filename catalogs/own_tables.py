"""Tables of a user's own: how strictly they are read, what was left out of them, and what their columns are taken for.

Commands and functions open tables in many places. What a user asks of all of them, and the list of what was left out
of any, is kept here while one question is answered.
"""

import contextlib
import logging
from collections import Counter
from collections.abc import Iterator
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from catalogs.table_cells import ROW_OUT, LeftOut, Rows, Use
from catalogs.table_files import RawTable, parse_table, read_bytes
from cpic_core import InputError

_LOG = logging.getLogger(__name__)
TableKind = Literal["stars", "planets"]


@dataclass
class OwnTables:
    """The tables of a user's own that were read for one question.

    Parameters
    ----------
    strict : bool
        Whether a table is refused for the first row or cell that cannot be used.
    aloud : bool
        Whether remarks on the reading are logged.
    tables : dict
        What was left out of each table, by its name and what its columns were taken for, in the order of reading.
    told : set of str
        Remarks that were logged.
    """

    strict: bool = False
    aloud: bool = True
    tables: dict[tuple[str, tuple[Use, ...]], list[LeftOut]] = field(default_factory=dict)
    told: set[str] = field(default_factory=set)

    @property
    def left_out(self) -> list[tuple[str, LeftOut]]:
        """Rows and cells that were not used, after the name of their table; by row."""
        tables = ((name, sorted(items, key=lambda item: item.row)) for (name, _), items in self.tables.items())
        return [(name, item) for name, items in tables for item in items]


_READ: ContextVar[OwnTables | None] = ContextVar("own_tables", default=None)


@contextlib.contextmanager
def own_tables(*, strict: bool = False, aloud: bool = True, apart: bool = False) -> Iterator[OwnTables]:
    """Read tables of a user's own as one question asks, and yield those that were read.

    Parameters
    ----------
    strict, aloud : bool
        As of `OwnTables`.
    apart : bool
        Whether it is no part of a question around it; else it is as strict, and as quiet, as that.
    """
    outer = _READ.get()
    made = OwnTables(strict, aloud)
    if outer is not None and not apart:
        made = OwnTables(strict or outer.strict, aloud and outer.aloud, outer.tables, outer.told)
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
    """Log remarks on the reading of a table, each once for a question."""
    asked = _READ.get() or OwnTables()
    for remark in remarks if asked.aloud else ():
        if remark not in asked.told:
            asked.told.add(remark)
            _LOG.warning("%s", remark)


@dataclass(frozen=True)
class Taken:
    """What a file is taken for as a table of one kind.

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
        first: dict[tuple[str, str, str], LeftOut] = {}
        counts: Counter[tuple[str, str, str]] = Counter()
        for item in sorted(self.left_out, key=lambda item: item.row):
            reason = (item.done != ROW_OUT, item.column, item.why)
            first.setdefault(reason, item)
            counts[reason] += 1
        return [(first[reason], count) for reason, count in sorted(counts.items(), key=lambda item: (item[0][0], -item[1]))]


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
    raw = parse_table(read_bytes(source))
    made, refused = [], []
    for one, read in (("stars", _stars), ("planets", _planets)):
        if kind not in (None, one):
            continue
        with own_tables(strict=strict, aloud=False, apart=True) as asked:
            try:
                made.append(read(raw, strict))
            except InputError as error:
                known = max((sum(bool(use.quantity) for use in uses) for _, uses in asked.tables), default=0)
                refused.append((known, error))
    if not made:
        raise max(refused, key=lambda item: item[0])[1]
    return made


def _stars(raw: RawTable, strict: bool) -> Taken:
    from catalogs.user_table import user_table

    found = user_table(raw, strict=strict)
    return Taken("stars", raw.name, len(raw), len(found.table), found.uses, found.left_out, found.notes)


def _planets(raw: RawTable, strict: bool) -> Taken:
    from catalogs.known_planets import own_rows

    _, given = own_rows(raw, strict=strict)
    notes = given.notes + given.told()
    return Taken("planets", raw.name, len(raw), len(given.rows), given.uses, tuple(given.left_out), notes)
