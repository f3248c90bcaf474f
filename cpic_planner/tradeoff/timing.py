"""Wall clock, processor time and peak memory of one piece of work."""

from __future__ import annotations

import contextlib
import gc
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

MOST_REPEATS = 5
_BLOCK_S = 0.02


@dataclass(frozen=True)
class Timing:
    """Least wall clock of some calls with the processor time of that one, and the peak memory of all.

    Attributes
    ----------
    wall_s, cpu_s : float
    peak_memory_mb : float
        Largest resident set of the process meanwhile, interpreter and libraries included.
    repeats : int
        Calls, or blocks of calls, that were timed.
    """

    wall_s: float
    cpu_s: float
    peak_memory_mb: float
    repeats: int


def timed(job: Callable[[], object], *, budget_s: float = 1.5) -> Timing:
    """Time a job: the best of up to five calls, as many as the budget allows and at least one.

    Calls of less than a fiftieth of a second are timed in blocks, long enough for the clocks.
    """
    gc.collect()
    reset_peak_memory()
    found: list[tuple[float, float]] = []
    calls, spent = 1, 0.0
    while len(found) < MOST_REPEATS and (not found or spent < budget_s):
        wall, cpu = _block(job, calls)
        spent += wall
        if wall < _BLOCK_S and calls == 1:
            calls = max(2, int(1.2 * _BLOCK_S / max(wall, 1e-7)))
            continue
        found.append((wall / calls, cpu / calls))
    best = min(found)
    return Timing(best[0], best[1], peak_memory_mb(), len(found))


def _block(job: Callable[[], object], calls: int) -> tuple[float, float]:
    cpu, wall = time.process_time(), time.perf_counter()
    for _ in range(calls):
        job()
    return time.perf_counter() - wall, time.process_time() - cpu


def reset_peak_memory() -> None:
    """Let the peak count from now on, where the system can (Linux)."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def peak_memory_mb() -> float:
    """Peak of the resident set, MB: since `reset_peak_memory` on Linux, of the whole process elsewhere."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/status").read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith("VmHWM:"):
                return float(line.split()[1]) * 1024 / 1e6
    peak = float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6
