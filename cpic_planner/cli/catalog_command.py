"""``cpic catalog``: what the shipped and refreshed tables are, and which columns one of a user's own may have."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

import catalogs
from catalogs import POSITION_ERROR_ARCSEC, data_dir
from cpic_core import InputError, listed, visible
from cpic_planner import report
from cpic_planner.cli.asking import Commands, RejectsOption, check_rejects, write_rejects
from cpic_planner.cli.options import JsonOption, Output, console, help_alone, print_json
from cpic_planner.cli.progress import heard

if TYPE_CHECKING:
    from rich.console import Console

    from catalogs import StoredTable


HELP = "Show the tables of stars and planets that ship with the package, and fetch fresh ones from their archives."
app = Commands(help=HELP, invoke_without_command=True)

_SHOWN = 6
"""Other headings of a column that are shown."""
_REFRESHED: dict[str, Literal["simbad", "archive"]] = {"--catalog": "simbad", "--known-planets": "archive"}


class TableKind(StrEnum):
    """Kinds of tables of a user's own."""

    STARS = "stars"
    PLANETS = "planets"


app.callback(invoke_without_command=True)(help_alone)


@app.command("info")
@heard
def info(as_json: JsonOption = False) -> None:
    """Show the tables: the snapshot's vintage, counts, sources and licences, and refreshed ones of stars and planets.

    Example: cpic catalog info
    """
    facts = catalogs.catalogue_info()
    stored = {option: catalogs.stored_tables(kind) for option, kind in _REFRESHED.items()}
    if as_json:
        stars, planets = ([_about(item) for item in items] for items in stored.values())
        newest = [items[0]["file"] if items else None for items in (stars, planets)]
        tables = {"refreshed": stars, "latest": newest[0], "refreshed_planets": planets, "latest_planets": newest[1]}
        print_json(facts | {"data_folder": str(data_dir())} | tables)
        return
    screen = console()
    report.print_plain(screen, facts["vintage"], bold=True)
    table(screen, "Counts per cut", ("cut", "stars"), ((row["cut"], str(row["count"])) for row in facts["counts"]))
    grades = Counter(row["grade"] for row in facts["binary_orbits"])
    graded = ((str(grade), str(count), f"{POSITION_ERROR_ARCSEC[grade]:g}") for grade, count in sorted(grades.items()))
    heads = ("grade of the orbit", "pairs", "error of a place (arcsec)")
    table(screen, "Companions that follow their orbits (--json lists them; --catalog simbad_2012: none)", heads, graded)
    published = facts["published_parameters"]
    report.print_plain(
        screen,
        f"Temperatures of {len({row['star'] for row in published})} stars are medians of {len(published)} published "
        "values (--catalog simbad_2012: without them); cpic catalog info --json lists them with their sources.",
    )
    files = ((row["file"], row["packages"], row["licence"]) for row in facts["files"])
    table(screen, "Data files and where they come from", ("file", "packages", "licence"), files)
    planets = facts["known_planets"]
    report.print_plain(screen, f"Known planets: {planets['vintage']}; {'; '.join(planets['notes'])}.")
    new = planets["updates"]
    report.print_plain(
        screen,
        f"Updated {new['date']}: {new['n_rows']} planets ({new['file']}, each with its source). "
        f"Refuted, listed and not counted: {', '.join(new['refuted'])}. "
        f"Controversial, counted: {', '.join(new['controversial'])}.",
    )
    report.print_plain(screen, *facts["credits"])
    rows = [
        (item.path.name, f"{item.queried_utc:%Y-%m-%d %H:%M} UTC", f"{option} latest" if item is items[0] else "")
        for option, items in stored.items()
        for item in items
    ]
    if not rows:
        report.print_plain(screen, f"No refreshed table in {data_dir()} (cpic catalog refresh makes one).", wraps=False)
        return
    table(screen, f"Refreshed tables in {data_dir()}", ("file", "asked", "used by"), rows)


def _about(item: StoredTable) -> dict[str, Any]:
    size = item.path.stat().st_size
    return {"file": str(item.path), "queried_utc": item.queried_utc.isoformat(), "size_bytes": size}


@app.command("columns")
@heard
def columns(
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE]", help="A table of your own, of stars or of planets.")
    ] = None,
    taken_as: Annotated[
        TableKind | None,
        typer.Option("--as", help="Take FILE as a table of this kind [default: each kind that it can be]."),
    ] = None,
    rejects: RejectsOption = None,
    strict: Annotated[
        bool, typer.Option("--strict", help="Refuse FILE for the first row or cell that cannot be used.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Show which columns a table of your own may have, or what the columns of a FILE are taken for.

    Without a file: the columns of a table of stars (--catalog FILE of other commands) and of planets (--known-planets
    FILE), and what else they may be called. With one: for each of its columns what it is taken for and in which unit,
    which columns are not used and why, how many rows can be used, and how many are left out by which reason.

    Examples:

      cpic catalog columns

      cpic catalog columns my_stars.csv

      cpic catalog columns my_stars.csv --rejects left_out.csv

      cpic catalog columns my_planets.csv --as planets --json
    """
    if file is not None:
        _taken(file, taken_as, rejects, strict, as_json)
        return
    for option, value in (("--as", taken_as), ("--rejects", rejects), ("--strict", strict or None)):
        if value is not None:
            raise InputError(option, "given" if value is True else str(value), allowed="only with a FILE")
    _possible(as_json)


def _taken(file: Path, taken_as: TableKind | None, rejects: Path | None, strict: bool, as_json: bool) -> None:
    """Show what the columns of a file are taken for."""
    from cpic_planner.results import ColumnsResult

    check_rejects(rejects, [file])
    found = catalogs.taken_for(file, None if taken_as is None else taken_as.value, strict=strict)
    if rejects is not None:
        left_out = dict.fromkeys((one.file, item) for one in found for item in one.left_out)
        write_rejects(rejects, list(left_out))
    result = ColumnsResult.of_files(found)
    Output("json" if as_json else "table").show(result, partial(report.print_columns, result))


def _possible(as_json: bool) -> None:
    """Show the columns that tables may have."""
    rows, planets = (_column_rows(kind) for kind in ("stars", "planets"))
    if as_json:
        print_json({"columns": rows, "planet_columns": planets})
        return
    screen = console()
    for title, listed_rows in (("stars", rows), ("known planets", planets)):
        cells = (
            (row["name"], row["required"], listed(row["also_called"], _SHOWN), row["allowed"]) for row in listed_rows
        )
        headings = ("column", "required", "also called", "allowed")
        table(screen, f"Columns of a table of {title} of your own", headings, cells)
    report.print_plain(
        screen,
        "Upper and lower case, blanks and _ make no difference, but where it is said. Units are those of an ECSV or "
        "VOTable, or are written in the heading: plx [mas]. What a star lacks is filled and labelled; what a planet "
        "lacks is unknown, and drawn. --json lists every heading; cpic catalog columns FILE says what those of a file "
        "are taken for.",
    )


def _column_rows(kind: Literal["stars", "planets"]) -> list[dict[str, Any]]:
    """Return what is said of each column of a kind of table."""
    words = {"text": "text", "bool": "yes or no", "int": "Hipparcos number"}
    columns, groups = catalogs.possible_columns(kind)
    needed = {name: "yes" if len(group) == 1 else f"one of {len(group)}" for group in groups for name in group}
    needed |= {"status": "or this alone"} if kind == "planets" else {}
    return [
        {
            "name": item.name,
            "required": needed.get(item.name, ""),
            "also_called": list(dict.fromkeys(form.heading for form in columns.synonyms_of(item.name))),
            "unit": item.unit,
            "allowed": words.get(item.kind, item.range),
        }
        for item in columns.values()
    ]


def table(screen: Console, title: str, headings: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> None:
    """Print a table of texts; columns of counts are set to the right."""
    from rich.table import Table
    from rich.text import Text

    grid = Table(title=report.displayable(screen, title), title_justify="left")
    for heading in headings:
        right = heading in ("stars", "planets", "number")
        grid.add_column(heading, justify="right" if right else "left", overflow="fold")
    for row in rows:
        grid.add_row(*(Text(report.displayable(screen, visible(cell))) for cell in row))
    screen.print(grid)
