"""Tables that are refreshed from archives: how a service is asked, how its answer is read, and where tables are kept.

A question goes to a process of its own (`catalogs.tap_session`) that is ended when the time is up: a service that
trickles, that says "continue" for ever or whose answer takes too long to read cannot hold anybody. The time is for one
whole answer, from the first byte sent to the last cell read; it comes back as plain columns, whole or not at all.

An answer counts only if it is whole: a marker of overflow, as many rows as were allowed, a dropped connection, a status
of error or anything that is no VOTable is a `RefreshError`. Failures on the way are tried again. Addresses are https
ones, or http ones of this very machine; plain http elsewhere, and redirects to another host, only where that is asked
for; a redirect to a file never.

Columns are read under names old and new, in our units; what cannot be right is refused. ``archive_columns.csv`` lists
what is read: SIMBAD's two answers under the names of TAP, of ``add_votable_fields`` and of astroquery before 0.4.8, and
the NASA Exoplanet Archive's table ``ps``, with its names before 2021. A measured quantity of ``ps`` has columns for
both errors and a limit beside its own: a limit is no value, unless the table has a quantity of ours for it too.

Refreshed tables stand beside the shipped ones, not in their place: in ``$CPIC_DATA_DIR``, or the user's data folder
(platformdirs), one dated ECSV file each. A table that lacks more than :data:`MOST_LOST` of what was known is set aside
under another name for a person to look at, and is never ``latest``.
"""

import atexit
import contextlib
import functools
import io
import json
import math
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, replace
from datetime import UTC, datetime
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any, Literal
from urllib.parse import urlsplit

import numpy as np

from catalogs.shipped import shipped_rows
from catalogs.stars import COLUMNS, StarTable, star_table
from catalogs.table_cells import Column, Columns, Row, read_rows, unit_of
from catalogs.table_files import RawTable, TableBytes, astropy_table, column_of
from cpic_core import InputError, Record, checked_scalar, guarded, unguarded

_PAUSE_FACTOR = 2.0
IDLE_S = 5.0
"""Time that the process that asks waits for another question, s."""
_LOOPBACK = frozenset(("localhost", "127.0.0.1", "::1"))
_REMEDY = "check the network or the address, or try later; tables already here stay as they are"


class RefreshError(RuntimeError):
    """A table could not be refreshed; the text is one line: what failed, and what to do about it."""

    def __init__(self, what: str, remedy: str = "") -> None:
        self.remedy = remedy
        super().__init__(what, remedy)

    def __str__(self) -> str:
        return " ".join("; ".join(filter(None, self.args)).split())


class TapService(Record):
    """The address of a TAP service, and how patiently it is asked.

    Parameters
    ----------
    url : str
        Address of the TAP service, with or without its ``/sync``; ``""`` for the archive's own.
    timeout_s : float
        Most time for one answer, s.
    retries : int
        How often a failure on the way is tried again, after pauses of 1, 2, 4 ... times `pause_s`.
    pause_s : float
        First pause, s.
    maxrec : int
        Most rows of one answer; as many or more count as cut off.
    max_bytes : int
        Most bytes of one answer, packed or unpacked.
    plain_http : bool
        Whether plain http, which anybody on the way can alter, will do for other machines than this one.
    other_hosts : bool
        Whether redirects to another host are followed.
    """

    url: str = ""
    timeout_s: float = 180.0
    retries: int = 3
    pause_s: float = 2.0
    maxrec: int = 200_000
    max_bytes: int = 256 * 2**20
    plain_http: bool = False
    other_hosts: bool = False

    def __post_init__(self) -> None:
        if self.url:
            self.check_url("url", self.url)
        checked_scalar("timeout_s", self.timeout_s, low=0.1, high=86400.0, unit="s")
        checked_scalar("retries", self.retries, low=0, high=20)
        checked_scalar("pause_s", self.pause_s, low=0.0, high=3600.0, unit="s")
        checked_scalar("maxrec", self.maxrec, low=1, high=2_000_000)
        checked_scalar("max_bytes", self.max_bytes, low=1, high=2**30)

    def address(self, variable: str) -> str:
        """Return the base of the address that was given, in ``url`` or an environment variable; empty without either.

        Parameters
        ----------
        variable : str
            Name of the environment variable, which counts where there is no ``url``.

        Raises
        ------
        InputError
            As `check_url`.
        """
        name, given = ("url", self.url) if self.url else (variable, os.environ.get(variable, ""))
        return self.check_url(name, given) if given else ""

    def check_url(self, name: str, url: str) -> str:
        """Return the base of an address that may be asked (its ``/sync`` is).

        Raises
        ------
        InputError
            If it is no address, or one of plain http that is not asked for.
        """
        try:
            parts = urlsplit(url)
            host = parts.hostname
        except ValueError:
            host = None
        if not host or parts.scheme not in ("https", "http"):
            raise InputError(name, url, allowed="an address that starts with https:// (http:// on this machine)")
        if not may_be_asked(url, plain_http=self.plain_http):
            hint = "--plain-http allows it"
            raise InputError(name, url, allowed="an address that starts with https://", hint=hint)
        return url.rstrip("/").removesuffix("/sync")


def may_be_asked(url: str, *, plain_http: bool) -> bool:
    """Tell whether an address may be asked: by https, or by http where that will do or on this very machine."""
    parts = urlsplit(url)
    return parts.scheme == "https" or (parts.scheme == "http" and (plain_http or is_here(parts.hostname)))


def is_here(host: str | None) -> bool:
    """Tell whether a host is this very machine."""
    return host in _LOOPBACK


def ask(
    service: TapService,
    url: str,
    query: str,
    *,
    narrower: str = "ask for less",
    tell: Callable[[str], None] = lambda text: None,
) -> RawTable:
    """Put one question and return the whole answer.

    Parameters
    ----------
    service : TapService
        How patiently to ask.
    url : str
        Where: the base address.
    query : str
        ADQL.
    narrower : str
        How to ask for less, for messages.
    tell : callable
        Called with a sentence when a failure is tried again.

    Raises
    ------
    RefreshError
        If the service cannot be reached, refuses the query, or its answer is not whole.
    """
    remedies = {
        "query": "the service may have changed; --dry-run shows the query",
        "cut": f"raise --maxrec, or {narrower}",
        "limit": narrower,
    }
    pause_s = service.pause_s
    for attempt in range(service.retries + 1):
        asked = {"service": asdict(service), "url": url, "query": query, "environment": dict(os.environ)}
        said = _PROCESS.answer(asked, service.timeout_s)
        if "columns" in said:
            return RawTable("the answer", [column_of(*column) for column in said["columns"]])
        text, kind = said["problem"], said["kind"]
        what = f"{url}{' refused the query' * (kind == 'query')}: {text}"
        if kind != "way" or attempt == service.retries:
            tries = f" ({attempt + 1} attempts)" if attempt else ""
            raise RefreshError(what + tries, remedies.get(kind, _REMEDY))
        tell(f"{what}; trying again in {pause_s:g} s")
        time.sleep(pause_s)
        pause_s *= _PAUSE_FACTOR
    raise AssertionError("unreachable: the last attempt returns or raises")


class _Process:
    """The process that questions are put to, one after another; started when there is none."""

    def __init__(self) -> None:
        self._child: Any = None
        self._idle_at = 0.0

    def answer(self, asked: dict[str, Any], time_s: float) -> dict[str, Any]:
        """Return what `catalogs.tap_session` says to a question; the process is ended if that takes longer.

        Parameters
        ----------
        asked : dict
            The question.
        time_s : float
            Most time, s; that of starting the process is not counted.
        """
        said: dict[str, Any] = {}
        problem = "the process that reads the answer ended (too little memory?)"
        try:
            with contextlib.suppress(OSError, ValueError):
                questions, answers = self._lines()
                questions.write(f"{json.dumps(asked)}\n".encode())
                questions.flush()
                if wait([answers.fileno()], time_s):
                    said = json.loads(answers.readline())
                else:
                    problem = f"no complete answer within {time_s:g} s"
        finally:  # an interruption too: the answer that is on its way is nobody's
            self._idle_at = time.monotonic()
            if not said:
                self.end()
        return said or {"problem": problem, "kind": "way"}

    def _lines(self) -> tuple[Any, Any]:
        """Return the ends of the process that is there, unless it has been idle for long, or of a new one."""
        if self._child is None or self._child.poll() is not None or time.monotonic() > self._idle_at + IDLE_S / 2.0:
            self.end()
            self._child = subprocess.Popen(
                [sys.executable, "-P", "-m", "catalogs.tap_session"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(part or os.getcwd() for part in sys.path)},
            )
            if not self._child.stdout.readline():
                raise OSError("not started")
        return self._child.stdin, self._child.stdout

    def end(self) -> None:
        """End the process, if there is one, whatever it is doing."""
        child, self._child = self._child, None
        if child is not None:
            child.kill()
            child.communicate()


_PROCESS = _Process()
atexit.register(_PROCESS.end)


@functools.cache
def answer_columns(table: str) -> Mapping[str, Mapping[str, str]]:
    """Return the rows of ``archive_columns.csv`` on an answer, by the names of its columns."""
    return {row["column"]: row for row in shipped_rows("archive_columns.csv") if row["table"] == table}


@functools.cache
def _answer_columns(table: str) -> Columns:
    def column(row: Mapping[str, str]) -> Column:
        low, high = float(row["low"] or -math.inf), float(row["high"] or math.inf)
        return Column(row["column"], "", row["kind"], row["unit"], row["headings"], low, high)

    return Columns(*map(column, answer_columns(table).values()))


def read_answer(answer: RawTable, table: str, *, unique: tuple[str, ...] = ()) -> tuple[list[Row], tuple[str, ...]]:
    """Return the rows of an answer by the names of ``archive_columns.csv``, and remarks on its columns.

    Parameters
    ----------
    answer : RawTable
        Columns under any of their names.
    table : {"simbad_stars", "simbad_measurements", "ps"}
        What was asked for.
    unique : tuple of str
        Columns in which no two rows may say the same.

    Raises
    ------
    RefreshError
        If a column is missing, in a unit that is not understood, or holds what is none of its values; if a cell is
        missing that every row must have; or if two rows are one.
    """
    columns, asked = _answer_columns(table), answer_columns(table)
    remedy = "the archive may have changed or the service is another one; tables already here stay as they are"
    try:
        known = [(item, meant) for item in answer.columns if (meant := columns.meant_by(item.heading).column)]
        given = [item if meant.unit else replace(item, unit="") for item, meant in known]  # a pure number has none
        lacking = [name for name in columns if name not in {meant.name for _, meant in known}]
        if needed := [name for name in lacking if asked[name]["needed"]]:
            raise RefreshError(f"the archive's table has no column {', '.join(needed)}", remedy)
        read = read_rows(RawTable(answer.name, given), columns, (), about=next(iter(columns)))
        cells = [[name] for name in columns if asked[name]["needed"] == "cell"]
        for number, row in enumerate(read.rows, start=1):
            read.refuse_missing(f"{answer.name} row {number}", row, cells)
    except InputError as error:
        raise RefreshError(str(error), remedy) from None
    notes = []
    for item, meant in known:
        if meant.unit and unit_of(item.unit, meant.unit) != unit_of(meant.unit):
            notes.append(f"{item.heading} is in {item.unit}, not in {meant.unit}: converted")
        if item.heading.lower() != meant.name:
            notes.append(f"{meant.name} is called {item.heading}")
    if lacking:
        notes.append(f"columns that the archive no longer has: {', '.join(lacking)}")
    for name in unique:
        value, count = max(Counter(row[name] for row in read.rows).items(), key=lambda item: item[1], default=("", 0))
        if count > 1:
            raise RefreshError(f"{answer.name}: {count} rows are of one name; same {name} {value}", remedy)
    return read.rows, tuple(notes)


Kind = Literal["simbad", "archive"]
"""Archive that a table is from: stars from SIMBAD, planets from the NASA Exoplanet Archive."""
MOST_LOST = 0.1
"""Largest fraction of what was known that a refreshed table may lack.

Honest changes take less: of the archive's 176 planets of 2019 its list of July 2026 lacks 10 (6 %), refuted and
reclassified ones; a star of the snapshot well within the cuts goes only if it changes its class. A service that is not
whole loses more.
"""
FORMATS: Mapping[str, str] = {"simbad": "cpic_star_table", "archive": "cpic_planet_table"}
"""Key of the header that says what kind of table it is."""
_VERSION = 1
_NEEDED = ("v_mag", "distance_pc", "teff_k", "log_g", "metallicity", "luminosity_lsun", "ra_deg", "dec_deg")
_SUFFIX = ".ecsv"
_STAMP = "%Y-%m-%dT%H%M%SZ"
_SET_ASIDE = "set_aside_"
DAMAGED = "damaged, or made by another version: make a new one with cpic catalog refresh"
"""Faults of a stored table and their remedy, for messages."""


class Refresh(Record, kw_only=True):
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


class StoredTable(Record):
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


def parse_refreshed(text: str, name: str) -> tuple[StarTable, dict[str, Any]]:
    """Read the text of a refreshed table back.

    Parameters
    ----------
    text : str
        ECSV as `catalogs.ecsv_text` writes it.
    name : str
        File name, for messages and as the table's label.

    Returns
    -------
    table, meta : StarTable, dict

    Raises
    ------
    InputError
        If it is damaged, of another version, or not a refreshed table.
    """
    table = parse_ecsv(text, name, "simbad")
    meta = json.loads(json.dumps(dict(table.meta), default=str))
    try:
        datetime.fromisoformat(meta["queried_utc"])
        float(meta["cuts"]["parallax_min_mas"])
        int(meta["counts"]["stars"])
        cells: dict[str, Any] = {column.name: np.ma.asarray(table[column.name]) for column in COLUMNS}
        numbers = {item.name: cells[item.name].astype(float).filled(np.nan) for item in COLUMNS if item.kind == "float"}
        others: dict[str, Any] = {key: part.filled("").tolist() for key, part in cells.items() if key not in numbers}
        made = star_table(others | numbers, name)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(name, "unreadable", allowed="a refreshed table", hint=f"{DAMAGED}; {error}") from None
    if len(made) == 0:
        raise InputError(name, "no rows", hint=DAMAGED)
    for key in _NEEDED:
        if not np.all(np.isfinite(numbers[key])):
            raise InputError(f"{name} column {key}", "a missing value", allowed="numbers", hint=DAMAGED)
    return made, meta
