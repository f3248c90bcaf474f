"""Ask a TAP service with pyvo, one question at a time, in a process that `catalogs.archives` starts and ends.

``python -m catalogs.tap_session`` reads questions from its standard input and writes answers to its standard output,
each a line of JSON. An answer is read whole, within one limit of size, and comes back as plain columns or as words for
what went wrong. Nothing here watches the clock: whoever asked ends the process when the time is up, whatever it is
doing then; and its memory has a limit, whatever an answer is packed like.
"""

import contextlib
import http.client
import io
import json
import os
import resource
import select
import signal
import sys
import warnings
from typing import Any
from urllib.parse import urlsplit

import requests
from pyvo.dal.exceptions import DALFormatError, DALQueryError, DALServiceError
from pyvo.dal.tap import TAPQuery, TAPResults
from urllib3.exceptions import ProtocolError
from urllib3.response import HTTPResponse

from catalogs.archives import IDLE_S, TapService, is_here, may_be_asked
from catalogs.table_files import TableBytes, raw_column, remarks, votable_document
from cpic_core import InputError

_LEFT_ALONE_S = 60
_MEMORY_BYTES = 4 * 2**30
_CHUNK_BYTES = 2**16
_MOST_REDIRECTS = 5
_MOST_TEXT = 20_000


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
        super().__init__(text)
        self.kind = kind


def refuse_place(service: TapService, first: str, url: str) -> None:
    """Refuse an address that a redirect may not lead to.

    Parameters
    ----------
    service : TapService
        What is allowed.
    first : str
        Address that was asked.
    url : str
        Where the request goes.

    Raises
    ------
    Problem
        If it is another host and that is not asked for, plain http likewise, or this very machine for a service that
        is elsewhere.
    """
    asked, now = urlsplit(first), urlsplit(url)
    where = f"the service redirects to {now.scheme}://{now.netloc}"
    inwards = is_here(now.hostname) and not is_here(asked.hostname)
    if inwards or not may_be_asked(url, plain_http=service.plain_http):
        raise Problem(f"{where}, which is not asked", "final")
    if (asked.hostname, asked.port) != (now.hostname, now.port) and not service.other_hosts:
        raise Problem(f"{where}, another host, which is not asked", "final")


class _Session(requests.Session):
    """A session that goes only where it may, through no proxy to this very machine, and reads no more than it may."""

    def __init__(self, service: TapService, first: str) -> None:
        super().__init__()
        self.service, self.first = service, first
        self.headers["Accept-Encoding"] = "identity"
        self.max_redirects = _MOST_REDIRECTS
        self.trust_env = not is_here(urlsplit(first).hostname)
        self.hooks["response"].append(self._read)

    def get_adapter(self, url: str) -> Any:
        """Return what sends a request, or one of the requests that it was redirected to."""
        adapter = super().get_adapter(url)
        refuse_place(self.service, self.first, url)
        return adapter

    def _read(self, response: requests.Response, **_: object) -> None:
        """Read what is sent and unpack it, of redirects and refusals too: others would do so without a limit."""
        body = bytearray()
        for chunk in response.raw.stream(_CHUNK_BYTES, decode_content=True):
            body += chunk
            if len(body) > self.service.max_bytes:
                raise Problem(f"the answer is larger than {self.service.max_bytes / 2**20:.3g} MB", "final")
        response.raw = HTTPResponse(io.BytesIO(body), status=response.status_code, preload_content=False)


def answer(service: TapService, url: str, query: str) -> list[tuple[str, str, list[Any]]]:
    """Put a question, and return heading, unit and cells of each column of the answer.

    Parameters
    ----------
    service : TapService
        Limits of what is done for it.
    url : str
        Address of the TAP service, without its ``/sync``.
    query : str
        ADQL.

    Raises
    ------
    Problem
        If there is no answer, or it is not whole.
    """
    try:
        with _Session(service, url) as session:
            asked = TAPQuery(url, query, maxrec=service.maxrec, session=session)
            body = asked.execute_raw()
    except (Problem, MemoryError):
        raise
    except Exception as error:
        raise _explained(error) from None
    refusal = ""
    try:
        return _columns(body, service.maxrec)
    except Problem as problem:
        refusal = str(problem) if problem.kind == "query" else ""
        raise
    finally:  # a status of error is worse than any answer, but for a refusal with its reason
        try:
            asked.raise_if_error()
        except DALServiceError as error:
            again = error.code >= 500 or error.code in (408, 429)
            if again or not refusal:
                status = f"HTTP {error.code} {error.cause.response.reason or ''}".strip()
                raise Problem(": ".join(filter(None, (status, refusal))), "way" if again else "final") from None


def _columns(body: bytes, maxrec: int) -> list[tuple[str, str, list[Any]]]:
    """Return the columns of an answer's table.

    Raises
    ------
    Problem
        If it is a refusal, is no VOTable, refers to something outside, or is not whole.
    """
    if body.lstrip()[:14].lower().startswith((b"<!doctype html", b"<html")):
        raise Problem("the answer is a web page, no VOTable (does the network want a login?)")
    try:
        document, said = votable_document(TableBytes("the answer", body, ""))
        table = TAPResults(document).to_table()
        cut = remarks("the answer", said)  # wherever it is said: pyvo looks at one place
        columns = [raw_column("the answer", name, table[name]) for name in table.colnames]
    except DALQueryError as error:
        raise Problem(" ".join(error.reason.split())[:300], "query") from None
    except (DALFormatError, InputError) as error:
        raise Problem(str(error) if isinstance(error, InputError) else "the answer holds no table", "final") from None
    except MemoryError:
        raise
    except Exception:
        start = body.lstrip()[:40]
        said = "breaks off or is damaged" if start.lower().startswith((b"<?xml", b"<votable")) else ""
        said = (
            f"the answer is a VOTable that {said}"
            if said
            else f"the answer is no VOTable (it starts {start.decode('ascii', 'replace').strip()!r})"
        )
        raise Problem(said if start else "the answer is empty") from None
    if len(table) >= maxrec or cut:
        kind = "cut" if len(table) >= maxrec else "limit"
        raise Problem(f"the answer was cut off at {len(table)} rows (allowed: {maxrec})", kind)
    for column in columns:
        if any(isinstance(cell, str) and len(cell) > _MOST_TEXT for cell in column.cells.tolist()):
            raise Problem(f"the answer holds a text of more than {_MOST_TEXT} letters ({column.heading})", "final")
    return [(column.heading, column.unit, column.cells.tolist()) for column in columns]


def _explained(error: BaseException) -> Problem:
    """Turn an exception into words: the innermost reason is the one that people understand."""
    final: dict[type[BaseException], str] = {
        requests.TooManyRedirects: f"the service redirects more than {_MOST_REDIRECTS} times",
        requests.exceptions.InvalidSchema: f"the service redirects to what is not followed ({error})",  # file: ...
        requests.exceptions.InvalidURL: str(error),
    }
    if type(error) in final:
        return Problem(final[type(error)], "final")
    dropped = isinstance(error, ProtocolError)
    while inner := error.__cause__ or error.__context__:
        error = inner
    if dropped or isinstance(error, http.client.HTTPException | ConnectionResetError):
        return Problem("the connection was dropped")
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return Problem(f"no connection ({text})" if isinstance(error, OSError) else f"no answer ({text})")


def main() -> None:
    """Answer the questions of standard input, until it is closed or nothing is asked for a while.

    A question is a JSON object of ``service``, the fields of `TapService`; ``url`` and ``query``; and ``environment``,
    that of the process that asks.
    """
    warnings.simplefilter("ignore")  # what astropy forgives is no reason to refuse an answer
    with contextlib.suppress(ValueError, OSError):  # systems without such a limit
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY_BYTES, _MEMORY_BYTES))
    said, sys.stdout = sys.stdout, sys.stderr
    print("ready", file=said, flush=True)
    while select.select([sys.stdin], [], [], IDLE_S)[0] and (line := sys.stdin.readline()):
        asked = json.loads(line)
        service = TapService(**asked["service"])
        signal.alarm(int(service.timeout_s) + _LEFT_ALONE_S)  # should the one who asks be gone
        os.environ.clear()
        os.environ.update(asked["environment"])
        try:
            found: dict[str, Any] = {"columns": answer(service, asked["url"], asked["query"])}
        except Problem as problem:
            found = {"problem": str(problem), "kind": problem.kind}
        except MemoryError:
            found = {"problem": f"the answer takes more than {_MEMORY_BYTES / 2**30:g} GB of memory", "kind": "final"}
        print(json.dumps(found, default=str), file=said, flush=True)
        signal.alarm(0)


if __name__ == "__main__":
    main()
