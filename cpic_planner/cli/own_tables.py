"""Tables of a user's own in commands: how strictly they are read, and the file of what was left out of them."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from cpic_core import InputError, at_home
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

    tables = _named_tables(question)
    check_rejects(rejects, tables)
    if rejects is not None and not tables and getattr(question, "strategies", None) is None:
        raise _no_table(rejects)
    with tables_read(strict=getattr(question, "strict", False), tell=options.note) as read:
        try:
            yield
        finally:
            if rejects is not None and read.tables:
                write_rejects(rejects, read.left_out)
    if rejects is not None and not read.tables:
        raise _no_table(rejects)


def _named_tables(question: Any) -> list[Any]:
    """Return the files that a question names as tables; a file of strategies may name others."""
    from catalogs import NAMED_TABLES, split_source

    stars, planets = getattr(question, "catalog", None), getattr(question, "known_planets", None)
    laid_over = "" if planets in (None, "off") else split_source(planets)[1]
    return [
        *([] if stars in (None, *NAMED_TABLES) else [stars]),
        *filter(None, [laid_over]),
        *getattr(question, "what", ()),
    ]


def check_rejects(rejects: Path | None, tables: Sequence[Any]) -> None:
    """Refuse a file of ``--rejects`` that cannot be written, or that is one of the tables themselves.

    Parameters
    ----------
    rejects : Path or None
    tables : sequence
        Files that are read.

    Raises
    ------
    InputError
    """
    options.check_file(rejects, REJECTS_ENDINGS, "--rejects")
    names = [table for table in tables if isinstance(table, str | Path)]
    if rejects is not None and rejects.resolve() in [at_home(name).resolve() for name in names]:
        raise InputError("--rejects", str(rejects), allowed="another file than the table that is read")


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
