"""The machine on which something was timed."""

from __future__ import annotations

import os
import platform
from importlib import metadata
from pathlib import Path

from cpic_planner.models.tradeoff import MachineRecord
from simulator.config.base import content_hash


def this_machine() -> MachineRecord:
    """Processor, memory and software of this machine; nothing that names it."""
    import numpy as np
    from threadpoolctl import threadpool_info

    np.ones((2, 2)) @ np.ones((2, 2))
    libraries = sorted(
        {f"{item['internal_api']} {item['version']}" for item in threadpool_info() if item["user_api"] == "blas"}
    )
    tree = {
        "processor": _processor(),
        "cores": _cores(),
        "memory_gb": _memory_gb(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "numpy": metadata.version("numpy"),
        "scipy": metadata.version("scipy"),
        "numba": metadata.version("numba"),
        "blas": ", ".join(libraries) or "unknown",
        "blas_threads": 1,
    }
    return MachineRecord(key=content_hash(tree), **tree)


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _memory_gb() -> float:
    try:
        return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9, 1)
    except (ValueError, OSError, AttributeError):
        return 0.0
