"""Read the tables in CSV that are shipped with this package.

The largest of them ships a second time as arrays, which one star's answer has not to wait for: ``python -m
tools.parsed`` makes these files, and a test holds them against their tables.
"""

import csv
import functools
import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from cpic_core import NDArray, read_npz

T = TypeVar("T")
PARSED = Path(__file__).resolve().parent / "parsed"
"""Folder of the tables as arrays."""
_DATA = Path(__file__).resolve().parent / "data"
_READERS: dict[Any, Callable[[str], Any]] = {float: lambda text: float(text or math.nan), int: int, str: str}


def shipped_rows(name: str) -> list[dict[str, str]]:
    """Return the rows of a table by its headings."""
    headings, *rows = shipped_lines(name)
    return [dict(zip(headings, row, strict=True)) for row in rows]


@functools.cache
def _word_rows() -> list[dict[str, str]]:
    return shipped_rows("words.csv")


def shipped_words(name: str, rule: str = "") -> dict[str, str]:
    """Return the words of a list of ``data/words.csv``, each with its meaning, in their order.

    Parameters
    ----------
    name : str
        Name of the list.
    rule : str
        A word of the column ``rules`` that they have; by default all words of the list.
    """
    rows = (row for row in _word_rows() if row["list"] == name)
    return {row["word"]: row["meaning"] for row in rows if not rule or rule in row["rules"].split()}


def shipped_lines(name: str) -> list[list[str]]:
    """Return the cells of a table line by line, the headings first: half the time for thousands of lines."""
    with (_DATA / name).open(encoding="utf-8", newline="") as stream:
        return list(csv.reader(stream))


def shipped_objects(name: str, kind: type[T]) -> tuple[T, ...]:
    """Return the rows of a table as objects of a dataclass whose fields are its headings; nan for no number.

    Parameters
    ----------
    name : str
        Name of the file.
    kind : type
        A dataclass of texts, whole numbers and numbers.
    """
    readers = {field.name: _READERS[field.type] for field in fields(kind)}  # type: ignore[arg-type]
    return tuple(kind(**{key: readers[key](text) for key, text in row.items()}) for row in shipped_rows(name))


@functools.cache
def parsed(name: str) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Return the columns of a table that ships as arrays, and the texts about it.

    Numbers lie by column as whole ones of their last decimal, which are small, the least of all for nan; and of texts,
    which repeat themselves, the places among words.
    """
    stored = read_npz(PARSED / f"{name}.npz")
    head = json.loads(stored["head"].tobytes())
    whole, places = stored["whole"], iter(stored["places"])
    numbers = iter(np.where(whole == np.iinfo(whole.dtype).min, np.nan, whole / 10.0 ** stored["decimals"][:, None]))
    columns = {
        column: np.array(head["words"][column])[next(places)] if column in head["words"] else next(numbers).astype(kind)
        for column, kind in head["columns"].items()
    }
    return columns, head["about"]


def shipped_digest(name: str) -> str:
    """Return the first digits of the sha256 of a table."""
    return hashlib.sha256((_DATA / name).read_bytes()).hexdigest()[:12]
