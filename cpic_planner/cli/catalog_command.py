"""``cpic catalog``: what the shipped and refreshed tables are, and which columns one of a user's own may have."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, Literal

import catalogs
from catalogs import POSITION_ERROR_ARCSEC, data_dir
from cpic_core import visible
from cpic_planner import report
from cpic_planner.cli.asking import Commands
from cpic_planner.cli.options import JsonOption, console, help_alone, print_json
from cpic_planner.cli.progress import heard

if TYPE_CHECKING:
    from rich.console import Console

    from catalogs import Column, StoredTable


HELP = "Show the tables of stars and planets that ship with the package, and fetch fresh ones from their archives."
app = Commands(help=HELP, invoke_without_command=True)

_REFRESHED: dict[str, Literal["simbad", "archive"]] = {"--catalog": "simbad", "--known-planets": "archive"}


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
def columns(as_json: JsonOption = False) -> None:
    """Show which columns a table of your own may have: of stars (--catalog FILE), of planets (--known-planets FILE).

    Example: cpic catalog columns
    """
    from catalogs.known_planet_columns import COLUMNS

    needed = {"name": "yes", "v_mag": "yes", "distance_pc": "one of two", "parallax_mas": "one of two"}
    needed |= {"sp_type": "one of two", "teff_k": "one of two"}
    of_planets = {"star": "yes", "planet": "yes", "period_days": "one of two", "semi_major_axis_au": "one of two"}
    of_planets |= dict.fromkeys(("mass_mjup", "msini_mjup", "best_mass_mjup", "radius_rjup"), "one of four")
    of_planets["status"] = "or this alone"
    rows, planets = _column_rows(catalogs.QUANTITIES, needed), _column_rows(COLUMNS, of_planets)
    if as_json:
        print_json({"columns": rows, "planet_columns": planets})
        return
    screen = console()
    for title, listed in (("stars", rows), ("known planets", planets)):
        cells = ((row["name"], row["required"], ", ".join(row["also_called"]), row["allowed"]) for row in listed)
        headings = ("column", "required", "also called", "allowed")
        table(screen, f"Columns of a table of {title} of your own", headings, cells)
    report.print_plain(
        screen,
        "Upper and lower case, blanks and _ make no difference. Units are those of an ECSV or VOTable, or are "
        "written in the heading: plx [mas]. What a star lacks is filled and labelled; what a planet lacks is "
        "unknown, and drawn.",
    )


def _column_rows(columns: Mapping[str, Column], needed: Mapping[str, str]) -> list[dict[str, Any]]:
    """Return what is said of each column."""
    kinds = {"text": "text", "bool": "yes or no", "int": "Hipparcos number"}
    return [
        {
            "name": item.name,
            "required": needed.get(item.name, ""),
            "also_called": list(item.headings),
            "unit": item.unit,
            "allowed": kinds.get(item.kind, item.range),
        }
        for item in columns.values()
    ]


def table(screen: Console, title: str, headings: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> None:
    """Print a table of texts; columns of counts are set to the right.

    Parameters
    ----------
    screen : rich.console.Console
    title : str
    headings : tuple of str
    rows : iterable of tuple of str
    """
    from rich.table import Table
    from rich.text import Text

    grid = Table(title=report.displayable(screen, title), title_justify="left")
    for heading in headings:
        right = heading in ("stars", "planets", "number")
        grid.add_column(heading, justify="right" if right else "left", overflow="fold")
    for row in rows:
        grid.add_row(*(Text(report.displayable(screen, visible(cell))) for cell in row))
    screen.print(grid)
