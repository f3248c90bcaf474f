"""Check every request before it is answered (hosts, methods, lengths, bodies), and set headers of answers.

What is refused is refused in one line.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from starlette.responses import PlainTextResponse, Response

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

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
