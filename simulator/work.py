"""Announcements of work that takes a while: to a logger, silent unless somebody listens."""

from __future__ import annotations

import logging

__all__ = ["LOGGER", "announce"]

LOGGER = "simulator.work"
_LOG = logging.getLogger(LOGGER)


def announce(text: str) -> None:
    """Say what is done from now on, at level INFO: the command line shows it, a script only if it asks for it.

    Parameters
    ----------
    text : str
        The work, and about how long it takes where that is known.
    """
    _LOG.info("%s", text)
