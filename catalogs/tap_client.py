"""Ask a TAP service and get its whole answer, or words for why not, within a time that is kept whatever happens.

The question goes to a process of its own (`catalogs.tap_session`) that is ended when the time is up: a service that
trickles, that says "continue" for ever or whose answer takes too long to read cannot hold anybody. The time is for one
whole answer, from the first byte sent to the last cell read; it comes back as plain columns, whole or not at all.

An answer counts only if it is whole: a marker of overflow, as many rows as were allowed, a dropped connection, a status
of error or anything that is no VOTable is a `RefreshError`. Failures on the way are tried again. Addresses are https
ones, or http ones of this very machine; plain http elsewhere, and redirects to another host, only where that is asked
for; a redirect to a file never.
"""

import atexit
import contextlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from multiprocessing.connection import wait
from typing import Any
from urllib.parse import urlsplit

from catalogs.table_files import RawTable, column_of
from cpic_core import InputError, checked_scalar

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


@dataclass(frozen=True)
class TapService:
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
