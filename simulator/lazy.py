"""Heavy libraries, loaded on first use and without their chatter."""

from __future__ import annotations

import importlib
import warnings
from typing import Any

__all__ = ["load_quietly"]


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
