"""Ask a TAP service one question at a time, in a process that `catalogs.tap_client` starts, waits for and ends.

``python -m catalogs.tap_session FD`` reads questions from a connection and writes answers to it, both as JSON. An
answer is read whole, against one limit of size, packed and unpacked, and comes back as plain columns or as words for
what went wrong. Nothing here watches the clock: whoever asked ends the process when the time is up, whatever it is
doing then.
"""

import contextlib
import http.client
import io
import json
import os
import resource
import signal
import sys
import warnings
import zlib
from dataclasses import dataclass
from itertools import chain
from multiprocessing.connection import Connection
from typing import Any
from urllib.parse import urlsplit

import requests
from astropy.io.votable import parse
from requests.adapters import HTTPAdapter
from urllib3.exceptions import HTTPError, ProtocolError
from urllib3.response import HTTPResponse

from catalogs.table_files import RawColumn, raw_column, reference_in
from catalogs.tap_client import is_here, may_be_asked

IDLE_S = 5.0
"""How long the process waits for another question, s."""
_LEFT_ALONE_S = 60.0
_MEMORY_BYTES = 4 * 2**30
_CHUNK_BYTES = 2**16
_MOST_REDIRECTS = 5
_MOST_TEXT = 20_000
_REASON_DEPTH = 12
_DROPPED = ("IncompleteRead", "RemoteDisconnected", "ConnectionResetError")


@dataclass(frozen=True)
class Question:
    """A question to a service, and limits of what is done for it.

    Parameters
    ----------
    url : str
        Address of the TAP service, without its ``/sync``.
    query : str
        ADQL.
    maxrec : int
        Most rows; as many or more count as cut off.
    max_bytes : int
        Most bytes of the answer, packed or unpacked.
    plain_http : bool
        Whether http will do in place of https.
    other_hosts : bool
        Whether redirects to another host are followed.
    """

    url: str
    query: str
    maxrec: int
    max_bytes: int
    plain_http: bool
    other_hosts: bool


class Problem(Exception):
    """A failed question in words.

    Parameters
    ----------
    text : str
        What it was.
    kind : {"way", "final", "query", "cut", "limit"}
        A failure on the way, after which asking again may help; one that would be the same again; a query that the
        service refuses; an answer of as many rows as were allowed; one that the service cut off before.
    """

    def __init__(self, text: str, kind: str = "way") -> None:
        self.text = text
        self.kind = kind
        super().__init__(text, kind)


def refuse_place(question: Question, url: str) -> None:
    """Refuse an address that a redirect may not lead to.

    Parameters
    ----------
    question : Question
        What was asked of whom.
    url : str
        Where the request goes.

    Raises
    ------
    Problem
        If it is another host and that is not asked for, plain http likewise, or this very machine for a service that
        is elsewhere.
    """
    first, now = urlsplit(question.url), urlsplit(url)
    where = f"the service redirects to {now.scheme}://{now.netloc}"
    inwards = is_here(now.hostname) and not is_here(first.hostname)
    if inwards or not may_be_asked(url, plain_http=question.plain_http):
        raise Problem(f"{where}, which is not asked", "final")
    if (first.hostname, first.port) != (now.hostname, now.port) and not question.other_hosts:
        raise Problem(f"{where}, another host, which is not asked", "final")


class _Adapter(HTTPAdapter):
    """Sends one request, or one of the requests that it was redirected to, and reads the whole answer within limits."""

    def __init__(self, question: Question) -> None:
        self.question = question
        super().__init__()

    def send(self, request: requests.PreparedRequest, *args: Any, **kwargs: Any) -> requests.Response:
        """Send it; other parameters as in ``requests``."""
        refuse_place(self.question, str(request.url))
        response = super().send(request, *args, **(kwargs | {"stream": True}))
        body = self._unpacked(self._read(response), response.headers.pop("Content-Encoding", ""))
        response.raw = HTTPResponse(body=io.BytesIO(body), status=response.status_code, preload_content=False)
        return response

    def _read(self, response: requests.Response) -> bytes:
        parts: list[bytes] = []
        size = 0
        while chunk := response.raw.read1(_CHUNK_BYTES, decode_content=False):
            parts.append(chunk)
            size += len(chunk)
            if size > self.question.max_bytes:
                raise self._too_large()
        promised = response.headers.pop("Content-Length", "")
        if promised.isdigit() and size < int(promised):
            raise Problem(f"the connection was dropped after {size} of {promised} bytes")
        return b"".join(parts)

    def _unpacked(self, body: bytes, coding: str) -> bytes:
        """Return the content of an answer that was sent packed, within the limit of size."""
        if coding.lower() in ("", "identity"):
            return body
        unpacker = zlib.decompressobj(wbits=47)  # gzip or zlib, as its first bytes say
        try:
            data = unpacker.decompress(body, self.question.max_bytes + 1)
        except zlib.error:
            raise Problem(f"the answer cannot be unpacked ({coding})") from None
        if len(data) > self.question.max_bytes:
            raise self._too_large()
        return data

    def _too_large(self) -> Problem:
        return Problem(f"the answer is larger than {self.question.max_bytes / 2**20:.3g} MB", "final")


class _Session(requests.Session):
    """A session that leaves this very machine's services to no proxy."""

    def __init__(self, question: Question) -> None:
        super().__init__()
        self.headers["Accept-Encoding"] = "identity"
        self.max_redirects = _MOST_REDIRECTS
        for scheme in ("https://", "http://"):
            self.mount(scheme, _Adapter(question))

    def merge_environment_settings(self, url: Any, *args: Any, **kwargs: Any) -> Any:
        """Take proxies and certificates from the environment, but never a proxy to this very machine."""
        self.trust_env = not is_here(urlsplit(str(url)).hostname)
        return super().merge_environment_settings(url, *args, **kwargs)


def answer(question: Question) -> dict[str, Any]:
    """Put a question, and return the columns of the answer.

    Returns
    -------
    dict
        ``columns``: heading, unit and cells of each.

    Raises
    ------
    Problem
        If there is no answer, or it is not whole.
    """
    form = {"REQUEST": "doQuery", "LANG": "ADQL", "QUERY": question.query, "MAXREC": question.maxrec}
    try:
        with _Session(question) as session:
            response = session.post(f"{question.url}/sync", data=form, timeout=None)
    except requests.TooManyRedirects:
        raise Problem(f"the service redirects more than {_MOST_REDIRECTS} times", "final") from None
    except requests.exceptions.InvalidSchema as error:  # a redirect to file: and the like
        raise Problem(f"the service redirects to what is not followed ({error})", "final") from None
    except (requests.RequestException, HTTPError, http.client.HTTPException, OSError) as error:
        raise _explained(error) from None
    return {"columns": [[column.heading, column.unit, column.cells] for column in _whole_table(response, question)]}


def _whole_table(response: requests.Response, question: Question) -> list[RawColumn]:
    """Return the columns of an answer's table.

    Raises
    ------
    Problem
        If it is a refusal or an error, is no VOTable, refers to something outside, or is not whole.
    """
    status = response.status_code
    failed = f"HTTP {status} {response.reason or ''}".strip() if status >= 400 else ""
    columns: list[RawColumn] = []
    said: list[tuple[str, str]] = []
    try:
        columns, said = _parsed(response.content)
    except Problem:
        if not failed:
            raise
    except MemoryError:
        raise Problem(f"the answer takes more than {_MEMORY_BYTES / 2**30:g} GB of memory", "final") from None
    except Exception:
        if not failed:
            raise Problem(_misfit(response.content)) from None
    refusal = next((" ".join(text.split())[:300] or "no reason given" for word, text in said if word == "ERROR"), "")
    if status >= 500 or status in (408, 429):
        raise Problem(": ".join(filter(None, (failed, refusal))))
    if refusal:
        raise Problem(refusal, "query")
    if failed:
        raise Problem(failed, "final")
    if not columns:
        raise Problem("the answer holds no table", "final")
    n_rows = len(columns[0].cells)
    if n_rows >= question.maxrec or any(word == "OVERFLOW" for word, _ in said):
        kind = "cut" if n_rows >= question.maxrec else "limit"
        raise Problem(f"the answer was cut off at {n_rows} rows (allowed: {question.maxrec})", kind)
    for column in columns:
        if any(isinstance(cell, str) and len(cell) > _MOST_TEXT for cell in column.cells):
            raise Problem(f"the answer holds a text of more than {_MOST_TEXT} letters ({column.heading})", "final")
    return columns


def _parsed(body: bytes) -> tuple[list[RawColumn], list[tuple[str, str]]]:
    """Return the columns of the first table of a VOTable, none if it has none, and what is said of the query's end."""
    found = reference_in(body)
    if found:  # in front of any parser: astropy's would go and get it
        raise (
            Problem(_misfit(body))
            if _is_page(body)
            else Problem(f"the answer holds {found}, and references are not followed", "final")
        )
    document = parse(io.BytesIO(body))
    tables = list(document.iter_tables())
    notes = chain(document.infos, *(item.infos for item in (*document.resources, *tables)))
    said = [(str(note.value).upper(), note.content or "") for note in notes if note.name.upper() == "QUERY_STATUS"]
    if not tables:
        return [], said
    table = tables[0].to_table(use_names_over_ids=True)
    return [raw_column("the answer", name, table[name]) for name in table.colnames], said


def _is_page(body: bytes) -> bool:
    return body.lstrip()[:14].lower().startswith((b"<!doctype html", b"<html"))


def _misfit(body: bytes) -> str:
    """Say what an answer is that cannot be read, by its first bytes."""
    start = body.lstrip()[:80]
    if not start:
        return "the answer is empty"
    if start.lower().startswith((b"<?xml", b"<votable")):
        return "the answer is a VOTable that breaks off or is damaged"
    if _is_page(body):
        return "the answer is a web page, no VOTable (does the network want a login?)"
    text = start.decode("ascii", "replace").strip()
    return f"the answer is no VOTable (it starts {text[:40]!r})" if text.isprintable() else "the answer is no VOTable"


def _explained(error: BaseException) -> Problem:
    """Turn an exception into words: the innermost reason is the one that people understand."""
    if isinstance(error, requests.exceptions.InvalidURL | requests.exceptions.MissingSchema):
        return Problem(str(error), "final")
    innermost = error
    for _ in range(_REASON_DEPTH):
        reason = getattr(innermost, "reason", None)
        inner = reason if isinstance(reason, BaseException) else None
        inner = inner or next((item for item in innermost.args if isinstance(item, BaseException)), None)
        inner = inner or innermost.__cause__ or innermost.__context__
        if inner is None:
            break
        innermost = inner
    if isinstance(error, ProtocolError) or type(innermost).__name__ in _DROPPED:
        return Problem("the connection was dropped")
    text = getattr(innermost, "strerror", None) or str(innermost) or type(innermost).__name__
    return Problem(f"no connection ({text})" if isinstance(innermost, OSError) else f"no answer ({text})")


def main(handle: int) -> None:
    """Answer the questions that come through a connection, until it is closed or nothing is asked for a while.

    Parameters
    ----------
    handle : int
        Descriptor of the connection. A question is a JSON object of ``question``, the fields of `Question`;
        ``environment``, that of the process that asks; and ``time_s``, after which it ends this one.
    """
    warnings.simplefilter("ignore")  # what astropy forgives is no reason to refuse an answer
    with contextlib.suppress(ValueError, OSError):  # systems without such a limit
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY_BYTES, _MEMORY_BYTES))
    with Connection(handle) as line:
        line.send_bytes(b"ready")
        while line.poll(IDLE_S):
            asked = json.loads(line.recv_bytes())
            signal.setitimer(signal.ITIMER_REAL, asked["time_s"] + _LEFT_ALONE_S)  # should the one who asks be gone
            os.environ.clear()
            os.environ.update(asked["environment"])
            try:
                said = answer(Question(**asked["question"]))
            except Problem as problem:
                said = {"problem": problem.text, "kind": problem.kind}
            except Exception as error:
                said = {"problem": f"no answer ({type(error).__name__}: {error})", "kind": "way"}
            line.send_bytes(json.dumps(said, default=str).encode())
            signal.setitimer(signal.ITIMER_REAL, 0.0)


if __name__ == "__main__":
    with contextlib.suppress(EOFError, ConnectionError):  # whoever asked has gone
        main(int(sys.argv[1]))
