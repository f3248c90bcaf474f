"""Refreshed tables on disk: where they lie, what they are called, and when one is not to be used unseen.

They stand beside the shipped tables, not in their place: in ``$CPIC_DATA_DIR``, or the user's data folder
(platformdirs), one dated ECSV file each. A table that lacks more than :data:`MOST_LOST` of what was known is set aside
under another name for a person to look at, and is never ``latest``.
"""

import io
import os
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from cpic_core import InputError, guarded, unguarded

Kind = Literal["simbad", "archive"]
"""Where a table is from: stars from SIMBAD, planets from the NASA Exoplanet Archive."""
MOST_LOST = 0.1
"""Largest fraction of what was known that a refreshed table may lack.

Honest changes take less: of the archive's 176 planets of 2019 its list of July 2026 lacks 10 (6 %), refuted and
reclassified ones; a star of the snapshot well within the cuts goes only if it changes its class. A service that is not
whole loses more.
"""
_SUFFIX = ".ecsv"
_STAMP = "%Y-%m-%dT%H%M%SZ"
_SET_ASIDE = "set_aside_"
DAMAGED = "damaged, or made by another version: make a new one with cpic catalog refresh"
"""What may be wrong with a stored table, and what to do about it, for messages."""


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


def ecsv_of(table: Any, meta: Mapping[str, Any]) -> str:
    """Return a table as ECSV 1.0 with its story in the header.

    Parameters
    ----------
    table : astropy.table.Table
        Columns with units and descriptions.
    meta : mapping
        Plain values for the header.
    """
    _each_text(table, guarded)
    table.meta |= dict(meta)
    text = io.StringIO()
    table.write(text, format="ascii.ecsv", delimiter=",")
    return text.getvalue()


def parse_ecsv(text: str, name: str, format_key: str, version: int) -> Any:
    """Read the text of a refreshed table as an astropy table, its header checked for what kind it is.

    Parameters
    ----------
    text : str
        ECSV as `ecsv_of` writes it.
    name : str
        File name, for messages.
    format_key : str
        Key of the header that says what kind of table it is.
    version : int
        What it must say.

    Raises
    ------
    InputError
        If it is damaged, of another version, or another table.
    """
    from astropy.io import ascii as text_tables

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            table = text_tables.read(text.splitlines(), format="ecsv")
    except Exception as error:
        reason = " ".join(str(error).split())[:120]
        raise InputError(name, "unreadable", allowed="a refreshed table", hint=f"{DAMAGED}; {reason}") from None
    if table.meta.get(format_key) != version:
        found = str(table.meta.get(format_key))
        raise InputError(f"{name} {format_key}", found, allowed=str(version), hint=DAMAGED)
    _each_text(table, unguarded)
    return table


def _each_text(table: Any, change: Callable[[str], str]) -> None:
    """Change the texts of an astropy table: they are `cpic_core.guarded` in files."""
    for name in table.colnames:
        column = table[name]
        cells = column.tolist()
        changed = [change(cell) if isinstance(cell, str) else cell for cell in cells]
        if changed != cells:
            new = type(column)(changed, unit=column.unit, description=column.description)
            if hasattr(column, "mask"):
                new.mask = column.mask
            table[name] = new
