"""Tables of a user's own in commands: how strictly they are read, and the file of what was left out of them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from cpic_core import InputError
from cpic_planner.cli import options

if TYPE_CHECKING:
    from catalogs import LeftOut

RejectsOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--rejects",
        metavar="FILE",
        help="Write the rows and cells of a table of your own that are left out, each with its reason, to FILE.csv, "
        ".ecsv or .parquet.",
    ),
]
REJECTS_ENDINGS = (".csv", ".ecsv", ".parquet")
"""Endings of the names that ``--rejects`` takes."""


@contextlib.contextmanager
def tables_of(question: Any, rejects: Path | None) -> Iterator[None]:
    """Read tables of a user's own as a question asks, and write what was left out of them, also where they are refused.

    Parameters
    ----------
    question : Question
        It may say how strictly, and name tables.
    rejects : Path or None
        File of `RejectsOption`.

    Raises
    ------
    InputError
        If there is nothing to write about, or the file cannot be written.
    """
    from catalogs import tables_read

    options.check_file(rejects, REJECTS_ENDINGS, "--rejects")
    named = [getattr(question, name, None) for name in ("strategies", "what")]
    if rejects is not None and not any(named) and not _names_table(question):
        raise _no_table(rejects)
    with tables_read(strict=getattr(question, "strict", False), tell=options.note) as read:
        try:
            yield
        finally:
            if rejects is not None and read.tables:
                write_rejects(rejects, read.left_out)
    if rejects is not None and not read.tables:
        raise _no_table(rejects)


def _names_table(question: Any) -> bool:
    from catalogs import NAMED_TABLES, split_source

    stars, planets = getattr(question, "catalog", None), getattr(question, "known_planets", None)
    return stars not in (None, *NAMED_TABLES) or (planets not in (None, "off") and bool(split_source(planets)[1]))


def _no_table(rejects: Path) -> InputError:
    allowed = "with a table of your own: --catalog FILE, --known-planets FILE, or the table that is simulated"
    return InputError("--rejects", str(rejects), allowed=allowed)


def write_rejects(path: Path, left_out: Sequence[tuple[str, LeftOut]]) -> None:
    """Write what was left out of tables, in the form that the ending of the name asks for.

    Parameters
    ----------
    path : Path
    left_out : sequence of (str, LeftOut)
        Each after the name of its table.
    """
    from cpic_planner import results

    rows = results.left_out_cells(left_out)
    columns = results.taken_of(results.LeftOutCell)
    write: dict[str, Callable[[], str | bytes]] = {
        ".csv": lambda: results.csv_text(results.names_of(results.LeftOutCell), map(results.values_of, rows)),
        ".ecsv": lambda: results.ecsv_text(columns, rows, {"title": "left out of tables"}),
        ".parquet": lambda: results.parquet_bytes(columns, rows),
    }
    options.write_out(path, write[path.suffix], len(rows), len(rows), "--rejects")
