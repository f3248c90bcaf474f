"""Heavy libraries, loaded on first use and without their chatter."""

from __future__ import annotations

import functools
import importlib
import os
import warnings
from pathlib import Path
from typing import Any

from simulator.work import announce

__all__ = ["load_kernels", "load_quietly"]


def load_quietly(name: str) -> Any:
    """Import a module; progress-bar packages complain, on import, where a notebook has no widgets.

    Parameters
    ----------
    name : str
        Full name of the module.

    Returns
    -------
    module

    Raises
    ------
    ImportError
        If it is not installed.
    """
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="IProgress not found")
        return importlib.import_module(name)


@functools.cache
def load_kernels(name: str) -> Any:
    """Import a module of compiled kernels; it is announced where this machine has yet to compile them.

    Parameters
    ----------
    name : str
        Full name of the module.

    Returns
    -------
    module
    """
    module = importlib.import_module(name)
    source = Path(str(module.__file__))
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    kept = (
        Path(chosen).rglob(f"{source.stem}.*.nbi") if chosen else source.parent.glob(f"__pycache__/{source.stem}.*.nbi")
    )
    if next(kept, None) is None:
        announce(f"compiling {name.rpartition('.')[2]} for this machine, once: about 10 s on a free processor")
    return module
