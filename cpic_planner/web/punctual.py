"""Connections that keep no place for the slow: heads have to arrive, and answers to be taken, in time."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

HEAD_S = 10.0
"""Longest time from the beginning of a connection, or of a further request, to the end of its head."""
WHOLE_S = 180.0
"""Longest time from the end of a head until its answer is taken."""
MOST_IDLE = 40
"""Most connections without a request under way; one more ends the oldest of the address that has most of them."""


class Punctual(H11Protocol):
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
        idle = [line for line in self.connections if isinstance(line, Punctual) and line.idle and line is not self]
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
