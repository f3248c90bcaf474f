"""Where a run took place: for its record, never for its results."""

from __future__ import annotations

import os
import platform
import time
from datetime import UTC, datetime
from importlib import metadata
from typing import Any

from cpic_planner.models import RunRecord

__all__ = ["RunClock", "host", "versions"]


def host() -> dict[str, Any]:
    """System, machine, Python, and number of cores."""
    return {
        "system": platform.system(),
        "machine": platform.machine(),
        "python": platform.python_version(),
        "cpu_count": os.cpu_count(),
    }


def versions() -> dict[str, str]:
    """Versions of this package and of those that its results rest on."""
    names = ("cpic-planner", "numpy", "scipy", "astropy", "photutils", "numba", "pydantic", "dask")
    found = {}
    for name in names:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


class RunClock:
    """Begin of a run, from which its record is made."""

    def __init__(self) -> None:
        self.started = datetime.now(UTC)
        self.clock = time.monotonic()

    def record(
        self,
        *,
        command: list[str] | None,
        config_hash: str,
        workers: int,
        scheduler: str | None,
        resumed_parts: int,
        computed_parts: int,
    ) -> RunRecord:
        """The story of the run, up to now."""
        return RunRecord(
            command=command or [],
            config_hash=config_hash,
            started_utc=self.started.isoformat(timespec="seconds"),
            finished_utc=datetime.now(UTC).isoformat(timespec="seconds"),
            wall_s=round(time.monotonic() - self.clock, 3),
            workers=workers,
            scheduler=scheduler,
            resumed_parts=resumed_parts,
            computed_parts=computed_parts,
            host=host(),
            versions=versions(),
        )
