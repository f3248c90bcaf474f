"""Pieces of work of known kind that the jobs are divided by, and the clock of both."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

__all__ = ["Clock", "workloads"]


class Clock:
    """Processor seconds of this process, of processes that ended, and of those that report their own.

    Wall clocks would count what else the machine does.
    """

    def __init__(self) -> None:
        self.elsewhere_s = 0.0

    def __call__(self) -> float:
        """Return the seconds so far."""
        ended_s = 0.0
        try:
            import resource
        except ImportError:  # not there on Windows, where a child's time is missed
            pass
        else:
            children = resource.getrusage(resource.RUSAGE_CHILDREN)
            ended_s = children.ru_utime + children.ru_stime
        return time.process_time() + ended_s + self.elsewhere_s


def workloads() -> dict[str, Callable[[], object]]:
    """Return the workloads by kind, some 20 ms each.

    ``copy`` is bound by memory, ``draws`` by random numbers, ``dgemm`` by arithmetic, ``fft`` by both, and ``python``
    by the interpreter.
    """
    from scipy import fft

    rng = np.random.Generator(np.random.PCG64(1))
    source = rng.standard_normal((2048, 2048))
    target = np.empty_like(source)
    square = rng.standard_normal((640, 640))
    plane = source[:1024, :1024] + 1j * source[1024:, :1024]
    means = np.full(200_000, 3.0)

    def copy() -> None:
        for _ in range(3):
            np.copyto(target, source)

    def draws() -> object:
        return rng.standard_normal(800_000), rng.poisson(means)

    def dgemm() -> object:
        return square @ square

    def python() -> int:
        found: dict[str, int] = {}
        for number in range(60_000):
            name = f"{number % 997}"
            found[name] = found.get(name, 0) + number
        return len(found)

    return {"copy": copy, "draws": draws, "fft": lambda: fft.fft2(plane), "dgemm": dgemm, "python": python}
