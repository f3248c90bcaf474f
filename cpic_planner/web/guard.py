"""What stands before every request: hosts, methods, lengths, each refused in one line; headers of every answer."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from starlette.responses import PlainTextResponse, Response

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

LONGEST_ADDRESS = 4096
"""Bytes of an address with its parameters."""
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; style-src 'self'; img-src 'self'; form-action 'self'; "
    "base-uri 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
}
"""Of every answer that does not say otherwise."""
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
        try:
            await self._app(scope, receive, told)
        except Exception:
            logging.getLogger(__name__).exception("a request failed")
            if not started:
                await line(FAILED, 500)(scope, receive, told)

    def _refusal(self, scope: Scope) -> Response | None:
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        if host_name(headers.get("host", "")) not in self._hosts:
            return line("This server is not asked under that name (cpic serve --allow-host NAME adds one).", 421)
        if scope["method"] not in ("GET", "HEAD"):
            return line("Only GET and HEAD are answered.", 405, Allow="GET, HEAD")
        if len(scope.get("raw_path") or scope["path"].encode()) + len(scope["query_string"]) > LONGEST_ADDRESS:
            return line(f"An address has at most {LONGEST_ADDRESS} bytes.", 414)
        if headers.get("content-length", "0").strip("0") or "transfer-encoding" in headers:
            return line("A request has no body.", 413, Connection="close")
        return None


def host_name(given: str) -> str:
    """Return the name of a Host header without its port, in lower case; empty for what is no name."""
    try:
        return urlsplit(f"//{given}").hostname or ""
    except ValueError:
        return ""


def _missing(given: Any) -> list[tuple[bytes, bytes]]:
    """Headers that an answer does not have yet."""
    there = {name.decode("latin-1").lower() for name, _ in given}
    rest: Mapping[str, str] = {name: value for name, value in HEADERS.items() if name.lower() not in there}
    return [(name.lower().encode(), value.encode()) for name, value in rest.items()]
