"""Work of requests in a bounded number of threads, with a limit of time and of how many wait.

Answers that are kept for whoever asks the same.
"""

from __future__ import annotations

import asyncio
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from cpic_core import numeric_context

T = TypeVar("T")
K = TypeVar("K", bound=Hashable)


class Busy(Exception):
    """More requests wait than may."""


class Kept(Generic[K]):
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
