"""Kill worker processes at random while a run goes on, to see that its results do not change."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import psutil

__all__ = ["Kills", "random_kills", "worker_pids"]


@dataclass
class Kills:
    """Process ids that were killed, in order."""

    pids: list[int] = field(default_factory=list)


def worker_pids(parent: int | None = None) -> list[int]:
    """Local workers below the process ``parent`` (this one by default) that live now."""
    found = []
    with contextlib.suppress(psutil.Error):
        for child in psutil.Process(parent).children(recursive=True):
            with contextlib.suppress(psutil.Error):
                if "cpic_planner.jobs.worker" in child.cmdline():
                    found.append(child.pid)
    return sorted(found)


@contextlib.contextmanager
def random_kills(pids: Callable[[], list[int]], seed: int, every_s: float) -> Iterator[Kills]:
    """Send SIGKILL to one process of ``pids()`` after random waits while the block runs.

    Parameters
    ----------
    pids : callable
        Returns the candidates, asked anew before each kill, for example `worker_pids`.
    seed : int
        Decides the waits and the choices among the candidates.
    every_s : float
        Mean wait in s; waits are exponential.

    Yields
    ------
    kills : Kills
        What was killed so far.
    """
    rng = np.random.default_rng(seed)
    done, stop = Kills(), threading.Event()

    def work() -> None:
        while not stop.wait(rng.exponential(every_s)):
            candidates = pids()
            if not candidates:
                continue
            chosen = candidates[int(rng.integers(len(candidates)))]
            with contextlib.suppress(ProcessLookupError):
                os.kill(chosen, signal.SIGKILL)
                done.pids.append(chosen)

    thread = threading.Thread(target=work, name="random-kills", daemon=True)
    thread.start()
    try:
        yield done
    finally:
        stop.set()
        thread.join()
