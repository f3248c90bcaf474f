"""Tables of text that are part of the package."""

import csv
from pathlib import Path


def shipped_rows(file: str) -> list[dict[str, str]]:
    """Return the rows of a table in ``catalogs/data`` by its headings.

    Parameters
    ----------
    file : str
        Name of a file of the package, never one that somebody gave.
    """
    headings, *rows = shipped_lines(file)
    return [dict(zip(headings, row, strict=True)) for row in rows]


def shipped_lines(file: str) -> list[list[str]]:
    """Return the cells of such a table line by line, the headings first: half the time for thousands of lines."""
    with (Path(__file__).resolve().parent / "data" / file).open(encoding="utf-8", newline="") as stream:
        return list(csv.reader(stream))
