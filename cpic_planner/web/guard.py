"""Limits of the server: of requests (hosts, methods, lengths, bodies), of connections, and of the threads that compute.

What is refused is refused in one line, and every answer has the headers of `HEADERS`. Connections keep no place for
the slow: heads have to arrive, and answers to be taken, in time. Answers are kept for whoever asks the same.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import Counter, OrderedDict
from collections.abc import Callable, Hashable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar
from urllib.parse import urlsplit

import h11
from starlette.responses import PlainTextResponse, Response
from uvicorn.protocols.http.h11_impl import H11Protocol

from cpic_core import numeric_context

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

T = TypeVar("T")
K = TypeVar("K", bound=Hashable)

LONGEST_ADDRESS = 4096
"""Bytes of an address with its parameters."""
FILES = 2_000_000
"""Most bytes of all files of a question together."""
POSTED = {"jobs": 20_000} | dict.fromkeys(("etc", "priorities", "compare", "columns"), FILES + 50_000)
"""Most bytes of a posted body, by the first word of the address that takes one."""
BODY_S = 10.0
"""Longest time that a body may take to arrive."""
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; style-src 'self'; img-src 'self'; form-action 'self'; "
    "script-src 'self'; connect-src 'self'; base-uri 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
}
"""Of every answer that does not say otherwise."""
MOST_HEADERS = 16_384
"""Bytes of all headers of a request."""
FAILED = "The server could not answer; what went wrong is in its own log."
HEAD_S = 10.0
"""Longest time from the beginning of a connection, or of a further request, to the end of its head."""
WHOLE_S = 180.0
"""Longest time from the end of a head until its answer is taken."""
MOST_IDLE = 40
"""Most connections without a request under way; one more ends the oldest of the address that has most of them."""


def line(text: str, status: int, **headers: str) -> Response:
    """Return an answer of one line.

    Parameters
    ----------
    text : str
    status : int
    **headers
    """
    return PlainTextResponse(" ".join(text.split()) + "\n", status, headers=headers)


class Guard:
    """Refuses requests that no page is asked, in one line, and gives every answer the headers of `HEADERS`.

    Parameters
    ----------
    app : ASGIApp
    hosts : frozenset of str
        Names under which the server may be asked, without the port.
    """

    def __init__(self, app: ASGIApp, hosts: frozenset[str]) -> None:
        self._app, self._hosts = app, frozenset(host.lower() for host in hosts)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            return
        started = False

        async def told(message: Message) -> None:
            nonlocal started
            if message["type"] == "http.response.start":
                started = True
                message["headers"] = [*message["headers"], *_missing(message["headers"])]
            await send(message)

        refusal = self._refusal(scope)
        if refusal is not None:
            await refusal(scope, receive, told)
            return
        if scope["method"] == "POST":
            body = await _body(receive, POSTED[_first_word(scope)])
            if isinstance(body, Response):
                await body(scope, receive, told)
                return
            receive = _handing(body, receive)
        try:
            await self._app(scope, receive, told)
        except Exception:
            logging.getLogger(__name__).exception("a request failed")
            if not started:
                await line(FAILED, 500)(scope, receive, told)

    def _refusal(self, scope: Scope) -> Response | None:
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        if scope.get("http_version", "1.1") not in ("1.0", "1.1"):
            return line("HTTP 1.1 is spoken here.", 400, Connection="close")
        if host_name(headers.get("host", "")) not in self._hosts:
            return line("This server is not asked under that name (cpic serve --allow-host NAME adds one).", 421)
        posts = scope["method"] == "POST" and _first_word(scope) in POSTED
        if scope["method"] not in ("GET", "HEAD") and not posts:
            return line("Only GET and HEAD are answered there.", 405, Allow="GET, HEAD")
        if len(scope.get("raw_path") or scope["path"].encode()) + len(scope["query_string"]) > LONGEST_ADDRESS:
            return line(f"An address has at most {LONGEST_ADDRESS} bytes.", 414)
        if sum(len(name) + len(value) for name, value in scope["headers"]) > MOST_HEADERS:
            return line(f"The headers of a request have at most {MOST_HEADERS} bytes.", 431)
        if posts:
            return _posted_refusal(headers, POSTED[_first_word(scope)])
        if headers.get("content-length", "0").strip("0") or "transfer-encoding" in headers:
            return line("A request has no body.", 413, Connection="close")
        return None


def _first_word(scope: Scope) -> str:
    return str(scope["path"]).split("/")[1:2][0] if "/" in scope["path"] else ""


def _posted_refusal(headers: Mapping[str, str], most: int) -> Response | None:
    """Refuse what another site has a browser post, and bodies of no length or too long a one."""
    origin = headers.get("origin")
    foreign = origin is not None and urlsplit(origin).netloc.lower() != headers.get("host", "").lower()
    if foreign or headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
        return line("Only pages of this server may post to it.", 403, Connection="close")
    length = headers.get("content-length", "")
    if "transfer-encoding" in headers or not (length.isascii() and length.isdecimal()):
        return line("A posted body says how long it is (Content-Length).", 411, Connection="close")
    if len(length) > 9 or int(length) > most:
        return line(f"A posted body has at most {most} bytes.", 413, Connection="close")
    return None


async def _body(receive: Receive, most: int) -> bytes | Response:
    """Return a body that arrives in time, or the refusal of one that does not."""
    body = b""
    try:
        async with asyncio.timeout(BODY_S):
            while True:
                message = await receive()
                body += bytes(message.get("body", b""))
                if message["type"] != "http.request" or len(body) > most:
                    return line(f"A posted body is whole and has at most {most} bytes.", 400, Connection="close")
                if not message.get("more_body", False):
                    return body
    except TimeoutError:
        return line(f"A posted body arrives within {BODY_S:g} s.", 408, Connection="close")


def _handing(body: bytes, receive: Receive) -> Receive:
    """Hand over a body that has arrived, then what comes after it."""
    left: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def handed() -> Message:
        return left.pop() if left else await receive()

    return handed


def host_name(given: str) -> str:
    """Return the name of a Host header without its port, in lower case; empty for what is no name."""
    try:
        return urlsplit(f"//{given}").hostname or ""
    except ValueError:
        return ""


def _missing(given: Any) -> list[tuple[bytes, bytes]]:
    """Return the headers that an answer does not have yet."""
    there = {name.decode("latin-1").lower() for name, _ in given}
    rest: Mapping[str, str] = {name: value for name, value in HEADERS.items() if name.lower() not in there}
    return [(name.lower().encode(), value.encode()) for name, value in rest.items()]


class TimedProtocol(H11Protocol):
    """HTTP of uvicorn with limits of time; what exceeds them is cut off.

    Bodies have their own limit, see `cpic_planner.web.guard`; so has the pause between requests, which is uvicorn's.
    """

    _timer: asyncio.TimerHandle | None = None
    _cycle: Any = None
    _began = 0.0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for a head."""
        self._began = self.loop.time()
        super().connection_made(transport)
        self._limit(HEAD_S, self._late)
        idle = [line for line in self.connections if isinstance(line, TimedProtocol) and line.idle and line is not self]
        if len(idle) >= MOST_IDLE:
            peers = Counter(line.client and line.client[0] for line in idle)
            oldest = max(idle, key=lambda line: (peers[line.client and line.client[0]], -line._began))
            self.connections.discard(oldest)  # it ends with the next turn of the loop; more may come before
            oldest.transport.abort()

    @property
    def idle(self) -> bool:
        """Tell whether no request is under way."""
        return self._cycle is None or bool(self._cycle.response_complete)

    def data_received(self, data: bytes) -> None:
        """Wait for the rest of a head that begins, or for the answer to one that is whole."""
        idle = self._cycle is not None and self.idle
        super().data_received(data)
        if self.cycle is not self._cycle:
            self._cycle = self.cycle
            self._limit(WHOLE_S)
        elif idle and self._timer is None:
            self._limit(HEAD_S, self._late)

    def on_response_complete(self) -> None:
        """Leave the time until the next request to uvicorn, once the answer is taken."""
        super().on_response_complete()
        if self.transport.get_write_buffer_size() == 0:
            self._limit(None)

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait for nothing more."""
        self._limit(None)
        super().connection_lost(exc)

    def send_400_response(self, msg: str) -> None:
        """Refuse what is no HTTP, unless an answer is under way."""
        if self.conn.our_state is h11.IDLE or self.conn.our_state is h11.SEND_RESPONSE:
            self._refuse("400 Bad Request", msg)
        else:
            self.transport.abort()

    def _late(self) -> None:
        """Refuse a head that does not arrive."""
        self._refuse("408 Request Timeout", f"The head of a request arrives within {HEAD_S:g} s.")

    def _refuse(self, status: str, text: str) -> None:
        """Send a line of our own, and close."""
        head = f"HTTP/1.1 {status}\r\ncontent-type: text/plain; charset=utf-8\r\nconnection: close\r\n"
        self.transport.write(f"{head}content-length: {len(text) + 1}\r\n\r\n{text}\n".encode())
        self.transport.close()

    def _limit(self, seconds: float | None, end: Callable[[], None] | None = None) -> None:
        if self._timer is not None:
            self._timer.cancel()
        end = end or self.transport.abort
        self._timer = None if seconds is None else self.loop.call_later(seconds, end)


class Busy(Exception):
    """More requests wait than may."""


class AnswerCache(Generic[K]):
    """The last answers, as many as fit.

    Parameters
    ----------
    most_bytes : int
        Size of all together.
    """

    def __init__(self, most_bytes: int = 64_000_000) -> None:
        self._most, self._size, self._lock = most_bytes, 0, threading.Lock()
        self._answers: OrderedDict[K, tuple[bytes, str]] = OrderedDict()

    def get(self, key: K) -> tuple[bytes, str] | None:
        """Return body and media type of an answer; None where it is not there."""
        with self._lock:
            found = self._answers.get(key)
            if found is not None:
                self._answers.move_to_end(key)
            return found

    def put(self, key: K, body: bytes, media: str) -> None:
        """Keep an answer; those that nobody asked for again for longest make place."""
        with self._lock:
            if key in self._answers or len(body) > self._most:
                return
            self._answers[key] = body, media
            self._size += len(body)
            while self._size > self._most:
                _, (old, _) = self._answers.popitem(last=False)
                self._size -= len(old)


@dataclass
class _Shared:
    """Work that is under way, and how many wait for it."""

    future: Future[Any]
    askers: int = 0


class Workers:
    """A few threads that compute.

    Parameters
    ----------
    threads : int
        How many compute at once.
    waiting : int
        How many requests may wait for them beside those.
    limit_s : float
        Longest time of a request, waiting included. What a thread has begun it brings to an end: until then it is not
        free.
    """

    def __init__(self, threads: int = 2, waiting: int = 30, limit_s: float = 60.0) -> None:
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix="cpic-answer")
        self._most, self._limit_s, self._taken = threads + waiting, limit_s, 0
        self._shared: dict[Hashable, _Shared] = {}

    async def do(self, work: Callable[..., T], *given: Any, key: Hashable = None) -> T:
        """Return what a function gives, which is called in one of the threads.

        Parameters
        ----------
        work : callable
        *given
            What it is called with.
        key : hashable, optional
            Work of one key that is asked for by several at once is done once, and takes one place.

        Raises
        ------
        Busy
            If too many wait.
        TimeoutError
            If it takes too long.
        """
        shared = self._shared.get(key)
        if shared is None or shared.future.cancelled():
            if self._taken >= self._most:
                raise Busy
            self._taken += 1
            loop = asyncio.get_running_loop()
            shared = _Shared(self._pool.submit(numeric_context()(work), *given))
            if key is not None:
                self._shared[key] = shared
            shared.future.add_done_callback(lambda _: self._leave(loop, key))
        shared.askers += 1
        try:
            result: T = await asyncio.wait_for(asyncio.shield(asyncio.wrap_future(shared.future)), self._limit_s)
            return result
        finally:
            shared.askers -= 1
            if not shared.askers:
                shared.future.cancel()  # nobody waits for it any more: it need not begin

    def _leave(self, loop: asyncio.AbstractEventLoop, key: Hashable) -> None:
        """Free a place; this is called in the thread that worked."""
        if not loop.is_closed():
            loop.call_soon_threadsafe(self._free, key)

    def _free(self, key: Hashable) -> None:
        self._taken -= 1
        self._shared.pop(key, None)
