"""Announcements of work that takes a while: to a logger, silent unless somebody listens, or to whoever counts it."""

from __future__ import annotations

import logging
from typing import Protocol

__all__ = ["LOGGER", "Advance", "announce", "untold"]

LOGGER = "simulator.work"
_LOG = logging.getLogger(LOGGER)


class Advance(Protocol):
    """Told about finished pieces of work."""

    def __call__(self, text: str, steps: int = 1, /) -> None:
        """Note ``steps`` more pieces, the last of which ``text`` names."""


def untold(text: str, steps: int = 1, /) -> None:
    """Tell nobody: the `Advance` of those who do not want to know."""


def announce(text: str) -> None:
    """Say what is done from now on, at level INFO: the command line shows it, a script only if it asks for it.

    Parameters
    ----------
    text : str
        The work, and about how long it takes where that is known.
    """
    _LOG.info("%s", text)
