"""Refreshed tables on disk: where they lie, what they are called, and when one is not to be used unseen.

They stand beside the shipped tables, not in their place: in ``$CPIC_DATA_DIR``, or the user's data folder
(platformdirs), one dated ECSV file each. A table that lacks more than :data:`MOST_LOST` of what was known is set aside
under another name for a person to look at, and is never ``latest``.
"""

import io
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np

from catalogs.table_cells import Column
from catalogs.table_files import TableBytes, astropy_table
from cpic_core import InputError, guarded, unguarded

Kind = Literal["simbad", "archive"]
"""Where a table is from: stars from SIMBAD, planets from the NASA Exoplanet Archive."""
MOST_LOST = 0.1
"""Largest fraction of what was known that a refreshed table may lack.

Honest changes take less: of the archive's 176 planets of 2019 its list of July 2026 lacks 10 (6 %), refuted and
reclassified ones; a star of the snapshot well within the cuts goes only if it changes its class. A service that is not
whole loses more.
"""
FORMATS: Mapping[str, str] = {"simbad": "cpic_star_table", "archive": "cpic_planet_table"}
"""Key of the header that says what kind of table it is."""
_VERSION = 1
_SUFFIX = ".ecsv"
_STAMP = "%Y-%m-%dT%H%M%SZ"
_SET_ASIDE = "set_aside_"
DAMAGED = "damaged, or made by another version: make a new one with cpic catalog refresh"
"""What may be wrong with a stored table, and what to do about it, for messages."""


@dataclass(frozen=True, kw_only=True)
class Refresh:
    """The story of a refreshed table: when, where and what was asked, what came of it and what is new.

    Parameters
    ----------
    kind : {"simbad", "archive"}
    queried_utc : datetime
    url : str
        Address that was asked.
    queries : tuple of str
        ADQL.
    counts : mapping of str to int
        Rows at each step.
    left_out : mapping of str to str
        The archive's name of what is not among the rows -> why.
    changes : mapping of str to object
        Differences from the shipped table, as plain values: lists, or numbers of rows.
    refusal : str
        Why the table is set aside; empty if it is not.
    """

    kind: Kind
    queried_utc: datetime
    url: str
    queries: tuple[str, ...]
    counts: Mapping[str, int]
    left_out: Mapping[str, str]
    changes: Mapping[str, Any]
    refusal: str


@dataclass(frozen=True)
class StoredTable:
    """A refreshed table in the data folder, by its file name."""

    path: Path
    queried_utc: datetime


def data_dir() -> Path:
    """Return the folder of the refreshed tables (not created here)."""
    chosen = os.environ.get("CPIC_DATA_DIR")
    if chosen:
        return Path(chosen)
    from platformdirs import user_data_path

    return user_data_path("cpic-planner", appauthor=False)


def file_name(queried_utc: datetime, kind: Kind = "simbad") -> str:
    """Return the name of the file of a table queried at that time."""
    return f"{kind}_{queried_utc:{_STAMP}}{_SUFFIX}"


def set_aside(path: Path) -> Path:
    """Return where a table is put that is not to be used unseen."""
    return path.with_name(_SET_ASIDE + path.name)


def loss_refused(lost: int, known: int, what: str) -> str:
    """Say in a sentence why a table is set aside; empty if it lacks no more than may be.

    Parameters
    ----------
    lost, known : int
        How many of how many known ones it lacks.
    what : str
        What they are.
    """
    if lost <= MOST_LOST * known:
        return ""
    return f"{lost} of {known} {what} are not in the new table, more than {MOST_LOST:.0%}: is the service whole?"


def stored_tables(kind: Kind = "simbad") -> list[StoredTable]:
    """Return the refreshed tables in the data folder, newest first; files of other names are passed over."""
    found = []
    for path in data_dir().glob(f"{kind}_*{_SUFFIX}"):
        try:
            when = datetime.strptime(path.name, f"{kind}_{_STAMP}{_SUFFIX}").replace(tzinfo=UTC)
        except ValueError:
            continue
        found.append(StoredTable(path, when))
    return sorted(found, key=lambda item: item.queried_utc, reverse=True)


def latest_table(kind: Kind, *, key: str, instead: str, command: str) -> Path:
    """Return the newest refreshed table.

    Parameters
    ----------
    kind : {"simbad", "archive"}
    key : str
        What it is asked for as, for messages.
    instead : str
        What may be given instead, for messages.
    command : str
        What makes one, for messages.

    Raises
    ------
    InputError
        If there is none.
    """
    found = stored_tables(kind)
    if not found:
        hint = f"none in {data_dir()}: run {command}"
        raise InputError(key, "latest", allowed=f"{instead}, or latest once there is a refreshed table", hint=hint)
    return found[0].path


def ecsv_of(
    made: Refresh, columns: Iterable[Column], values: Mapping[str, Any], versions: Mapping[str, str], **about: object
) -> str:
    """Return a refreshed table as ECSV 1.0: units and descriptions of its columns, and its story in the header.

    Parameters
    ----------
    made : Refresh
        What came of asking.
    columns : iterable of Column
        The columns.
    values : mapping of str to sequence
        Their cells by name; nan where a number is missing. Texts are `cpic_core.guarded`.
    versions : mapping of str to str
        Software that made it.
    **about : object
        What else the header says: plain values.
    """
    from astropy.table import MaskedColumn, Table

    table = Table()
    for column in columns:
        cells, gone = values[column.name], False
        if column.kind == "float":
            gone = ~np.isfinite(cells)
        elif column.kind == "text":
            cells = list(map(guarded, cells))
        table[column.name] = MaskedColumn(cells, mask=gone, unit=column.unit or None, description=column.description)
    table.meta |= {FORMATS[made.kind]: _VERSION} | about
    table.meta |= {
        "queried_utc": made.queried_utc.isoformat(),
        "service": made.url,
        "queries": list(made.queries),
        "counts": dict(made.counts),
        "left_out": dict(made.left_out),
        "changes_to_snapshot": {
            name: part if isinstance(part, int) else len(part) for name, part in made.changes.items()
        },
        "software": dict(versions),
    }
    text = io.StringIO()
    table.write(text, format="ascii.ecsv", delimiter=",")
    return text.getvalue()


def parse_ecsv(text: str, name: str, kind: Kind) -> Any:
    """Read the text of a refreshed table as an astropy table, its header checked for what kind it is.

    Parameters
    ----------
    text : str
        ECSV as `ecsv_of` writes it.
    name : str
        File name, for messages.
    kind : {"simbad", "archive"}
        Where it must be from.

    Raises
    ------
    InputError
        If it is damaged, of another version, or another table.
    """
    try:
        table, _ = astropy_table(TableBytes(name, text.encode(), ""), "ecsv")
    except Exception as error:
        reason = " ".join(str(error).split())[:120]
        raise InputError(name, "unreadable", allowed="a refreshed table", hint=f"{DAMAGED}; {reason}") from None
    if (found := table.meta.get(FORMATS[kind])) != _VERSION:
        raise InputError(f"{name} {FORMATS[kind]}", str(found), allowed=str(_VERSION), hint=DAMAGED)
    for column in table.itercols():
        if column.dtype.kind in "OU":
            column[:] = [unguarded(cell) if isinstance(cell, str) else cell for cell in column]
    return table
