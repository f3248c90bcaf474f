"""Where a run took place: for its record, never for its results."""

from __future__ import annotations

import os
import platform
from importlib import metadata
from typing import Any

__all__ = ["host", "versions"]


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
    names = ("cpic-planner", "numpy", "scipy", "astropy", "hcipy", "photutils", "numba", "pydantic", "dask")
    found = {}
    for name in names:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found
