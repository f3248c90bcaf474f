"""An HTTP session that keeps to a time limit for the whole answer and remembers what went wrong.

``requests`` limits each read of a socket, so that a server that trickles holds its client for ever; and pyvo turns
what happened on the way into an error of format. Here an answer is read whole, against one deadline and one limit of
size, and what failed is kept in words.

Imported by :mod:`catalogs.simbad` when a query is sent, never before.
"""

import http.client
import io
import time
import zlib
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

import requests
from urllib3.exceptions import HTTPError, ProtocolError
from urllib3.response import HTTPResponse

from catalogs.table_files import reference_in

MAX_ANSWER_BYTES = 256 * 2**20
_CHUNK_BYTES = 2**16
_LOOPBACK = frozenset(("localhost", "127.0.0.1", "::1"))
_REASON_DEPTH = 12
_DROPPED = ("IncompleteRead", "RemoteDisconnected", "ConnectionResetError")


@dataclass(frozen=True)
class Problem:
    """What went wrong on the way, in words, and whether asking again may help."""

    text: str
    again: bool = True


class PatientSession(requests.Session):
    """A session with a deadline per answer.

    Parameters
    ----------
    timeout_s : float
        Most time for connecting and reading one whole answer.

    Attributes
    ----------
    problem : Problem or None
        What was wrong with the last answer, if anything.
    start : bytes or None
        First bytes of the last answer, None if there was none.
    """

    def __init__(self, timeout_s: float) -> None:
        super().__init__()
        self.timeout_s = timeout_s
        self.problem: Problem | None = None
        self.start: bytes | None = None
        self.headers["Accept-Encoding"] = "identity"

    def send(self, request: requests.PreparedRequest, **kwargs: Any) -> requests.Response:
        """Send a request and read its whole answer; other parameters as in ``requests``."""
        self.problem, self.start = None, None
        deadline = time.monotonic() + self.timeout_s
        try:
            response = super().send(request, **(kwargs | {"timeout": self.timeout_s, "stream": True}))
            body = self._unpacked(self._read(response, deadline), response.headers.get("Content-Encoding", ""))
        except (requests.RequestException, HTTPError, http.client.HTTPException, OSError) as error:
            self.problem = self.problem or self._explain(error)
            raise
        self.start = body[:80]
        found = reference_in(body)
        if found:  # in front of any parser: astropy's would go and get it
            if not body.lstrip()[:14].lower().startswith((b"<!doctype html", b"<html")):  # a page has its own words
                self.problem = Problem(f"the answer holds {found}, and references are not followed", again=False)
            raise requests.RequestException(f"the answer holds {found}")
        status = response.status_code
        if status >= 400:
            again = status >= 500 or status in (408, 429)
            self.problem = Problem(f"HTTP {status} {response.reason or ''}".strip(), again)
        response.raw = HTTPResponse(body=io.BytesIO(body), status=status, preload_content=False)
        return response

    def merge_environment_settings(self, url: Any, *args: Any, **kwargs: Any) -> Any:
        """Take proxies and certificates from the environment, but never a proxy to this very machine."""
        self.trust_env = urlsplit(str(url)).hostname not in _LOOPBACK
        return super().merge_environment_settings(url, *args, **kwargs)

    def _read(self, response: requests.Response, deadline: float) -> bytes:
        parts: list[bytes] = []
        size = 0
        while chunk := response.raw.read1(_CHUNK_BYTES, decode_content=False):
            parts.append(chunk)
            size += len(chunk)
            if time.monotonic() > deadline:
                self.problem = self._late()
                raise requests.ReadTimeout(self.problem.text)
            if size > MAX_ANSWER_BYTES:
                raise self._too_large()
        promised = response.headers.get("Content-Length", "")
        if promised.isdigit() and size < int(promised):
            self.problem = Problem(f"the connection was dropped after {size} of {promised} bytes")
            raise requests.ConnectionError(self.problem.text)
        return b"".join(parts)

    def _unpacked(self, body: bytes, coding: str) -> bytes:
        """Content of an answer that was sent packed, within the limit of size."""
        if coding.lower() in ("", "identity"):
            return body
        unpacker = zlib.decompressobj(wbits=47)  # gzip or zlib, as its first bytes say
        try:
            data = unpacker.decompress(body, MAX_ANSWER_BYTES + 1)
        except zlib.error:
            self.problem = Problem(f"the answer cannot be unpacked ({coding})")
            raise requests.RequestException(self.problem.text) from None
        if len(data) > MAX_ANSWER_BYTES:
            raise self._too_large()
        return data

    def _too_large(self) -> requests.RequestException:
        self.problem = Problem(f"the answer is larger than {MAX_ANSWER_BYTES / 2**20:.3g} MB", again=False)
        return requests.RequestException(self.problem.text)

    def _late(self) -> Problem:
        return Problem(f"no complete answer within {self.timeout_s:g} s")

    def _explain(self, error: BaseException) -> Problem:
        """Turn an exception into words: the innermost reason is the one that people understand."""
        if isinstance(error, requests.exceptions.InvalidURL | requests.exceptions.MissingSchema):
            return Problem(str(error), again=False)
        innermost = error
        for _ in range(_REASON_DEPTH):
            reason = getattr(innermost, "reason", None)
            inner = reason if isinstance(reason, BaseException) else None
            inner = inner or next((item for item in innermost.args if isinstance(item, BaseException)), None)
            inner = inner or innermost.__cause__ or innermost.__context__
            if inner is None:
                break
            innermost = inner
        if isinstance(error, requests.Timeout) or "timed out" in str(innermost).lower():
            return self._late()
        if isinstance(error, ProtocolError) or type(innermost).__name__ in _DROPPED:
            return Problem("the connection was dropped")
        text = getattr(innermost, "strerror", None) or str(innermost) or type(innermost).__name__
        return Problem(f"no connection ({text})" if isinstance(innermost, OSError) else f"no answer ({text})")
