"""``cpic catalog``: the shipped and refreshed tables, new ones from the archives, and columns of a user's own."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

import catalogs
from cpic_core import InputError, Record, at_home, check_writable, listed, visible, write_named
from cpic_planner import report
from cpic_planner.cli import command
from cpic_planner.cli.progress import progress
from cpic_planner.version import DISTRIBUTION, __version__

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console

    from cpic_planner.cli.output import ColumnsOutput, JsonOutput, RefreshOutput

HELP = "Show the tables of stars and planets that ship with the package, and fetch fresh ones from their archives."

_SHOWN = 6
"""Other headings of a column that are shown."""
_REFRESHED: dict[str, Literal["simbad", "archive"]] = {"--catalog": "simbad", "--known-planets": "archive"}


def info(output: JsonOutput) -> None:
    """Show the tables: the snapshot's vintage, counts, sources and licences, and refreshed ones of stars and planets.

    Example: cpic catalog info
    """
    facts = catalogs.catalogue_info()
    stored = {option: catalogs.stored_tables(kind) for option, kind in _REFRESHED.items()}
    if output.as_json:
        stars, planets = ([_about(item) for item in items] for items in stored.values())
        newest = [items[0]["file"] if items else None for items in (stars, planets)]
        tables = {"refreshed": stars, "latest": newest[0], "refreshed_planets": planets, "latest_planets": newest[1]}
        command.print_json(facts | {"data_folder": str(catalogs.data_dir())} | tables)
        return
    screen = command.console()
    report.print_lines(screen, facts["vintage"], bold=True)
    table(screen, "Counts per cut", ("cut", "stars"), ((row["cut"], str(row["count"])) for row in facts["counts"]))
    grades = Counter(row["grade"] for row in facts["binary_orbits"])
    graded = (
        (str(grade), str(count), f"{catalogs.POSITION_ERROR_ARCSEC[grade]:g}")
        for grade, count in sorted(grades.items())
    )
    heads = ("grade of the orbit", "pairs", "error of a place (arcsec)")
    table(screen, "Companions that follow their orbits (--json lists them; --catalog simbad_2012: none)", heads, graded)
    published = facts["published_parameters"]
    report.print_lines(
        screen,
        f"Temperatures of {len({row['star'] for row in published})} stars are medians of {len(published)} published "
        "values (--catalog simbad_2012: without them); cpic catalog info --json lists them with their sources.",
    )
    files = ((row["file"], row["packages"], row["licence"]) for row in facts["files"])
    table(screen, "Data files and where they come from", ("file", "packages", "licence"), files)
    planets = facts["known_planets"]
    report.print_lines(screen, f"Known planets: {planets['vintage']}; {'; '.join(planets['notes'])}.")
    new = planets["updates"]
    report.print_lines(
        screen,
        f"Updated {new['date']}: {new['n_rows']} planets ({new['file']}, each with its source). "
        f"Refuted, listed and not counted: {', '.join(new['refuted'])}. "
        f"Controversial, counted: {', '.join(new['controversial'])}.",
    )
    report.print_lines(screen, *facts["credits"])
    rows = [
        (item.path.name, f"{item.queried_utc:%Y-%m-%d %H:%M} UTC", f"{option} latest" if item is items[0] else "")
        for option, items in stored.items()
        for item in items
    ]
    if not rows:
        report.print_lines(
            screen, f"No refreshed table in {catalogs.data_dir()} (cpic catalog refresh makes one).", wraps=False
        )
        return
    table(screen, f"Refreshed tables in {catalogs.data_dir()}", ("file", "asked", "used by"), rows)


def _about(item: catalogs.StoredTable) -> dict[str, Any]:
    size = item.path.stat().st_size
    return {"file": str(item.path), "queried_utc": item.queried_utc.isoformat(), "size_bytes": size}


def columns(output: ColumnsOutput) -> None:
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
    if output.file is not None:
        _taken(output.file, output)
        return
    given = {"--as": output.taken_as, "--rejects": output.rejects, "--strict": output.strict or None}
    for option, value in given.items():
        if value is not None:
            raise InputError(option, "given" if value is True else str(value), allowed="only with a FILE")
    _possible(output.as_json)


def _taken(file: Path, output: ColumnsOutput) -> None:
    """Show what the columns of a file are taken for."""
    from cpic_planner.cli.output import Output
    from cpic_planner.results import ColumnsResult

    command.check_rejects(output.rejects, [file])
    found = catalogs.table_readings(file, output.taken_as, strict=output.strict)
    if output.rejects is not None:
        left_out = dict.fromkeys((one.file, item) for one in found for item in one.left_out)
        command.write_rejects(output.rejects, list(left_out))
    result = ColumnsResult.of_files(found)
    Output(as_json=output.as_json).show(result, report.columns_blocks(result))


def _possible(as_json: bool) -> None:
    """Show the columns that tables may have."""
    rows, planets = (_column_rows(kind) for kind in ("stars", "planets"))
    if as_json:
        command.print_json({"columns": rows, "planet_columns": planets})
        return
    screen = command.console()
    for title, listed_rows in (("stars", rows), ("known planets", planets)):
        cells = (
            (row["name"], row["required"], listed(row["also_called"], _SHOWN), row["allowed"]) for row in listed_rows
        )
        headings = ("column", "required", "also called", "allowed")
        table(screen, f"Columns of a table of {title} of your own", headings, cells)
    report.print_lines(
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


_EMBEDDED = Path(catalogs.__file__).resolve().parent
_SOFTWARE = ("pyvo", "astroquery", "astropy", "numpy")

Listener = Callable[[str], None]


class Written(Record):
    """A refreshed table on disk, of stars or of planets."""

    path: Path
    sha256: str
    made: catalogs.Refreshed | catalogs.RefreshedPlanets

    def summary(self) -> dict[str, Any]:
        """Return what happened, as plain values: file, source, counts, and what differs from the shipped table."""
        made = self.made
        return {
            "schema_version": 1,
            "kind": "catalog_refresh" if isinstance(made, catalogs.Refreshed) else "planets_refresh",
            "file": str(self.path),
            "sha256": self.sha256,
            "set_aside": made.refusal,
            "queried_utc": made.queried_utc.isoformat(),
            "service": made.url,
            "queries": list(made.queries),
            "counts": dict(made.counts),
            "changes_to_snapshot": dict(made.changes),
            "left_out": dict(made.left_out),
            **({"cuts": asdict(made.cuts)} if isinstance(made, catalogs.Refreshed) else {"notes": list(made.notes)}),
        }


def target_path(out: str | Path | None) -> Path:
    """Return where a refreshed table goes: ``out``, or the data folder (the name then has the date of the query).

    Raises
    ------
    InputError
        If ``out`` does not end in ``.ecsv``, lies in the installed package, is a folder, or cannot be written.
    """
    if out is None:
        check_writable(catalogs.data_dir(), key="CPIC_DATA_DIR", folder=True)
        return catalogs.data_dir()
    path = at_home(out)
    if path.suffix != ".ecsv":
        raise InputError("--out", str(out), allowed="a file name that ends in .ecsv")
    if path.resolve().is_relative_to(_EMBEDDED):
        raise InputError("--out", str(out), allowed="a place outside the package: its own table never changes")
    check_writable(path, key="--out")
    return path


def refresh_catalog(
    *,
    planets: bool = False,
    out: str | Path | None = None,
    service: catalogs.TapService | None = None,
    cuts: catalogs.Cuts | None = None,
    step: Listener = lambda text: None,
    tell: Listener = lambda text: None,
) -> Written:
    """Ask an archive and write its stars or planets as one ECSV file, all or nothing.

    Parameters
    ----------
    planets : bool
        Ask the NASA Exoplanet Archive for planets of catalogue stars, not SIMBAD for stars.
    out : str or Path, optional
        File to write, replaced when it is there; by default a dated file in the data folder (`catalogs.data_dir`),
        where ``--catalog latest`` or ``--known-planets latest`` finds it. A table that lacks too much is set aside
        beside it.
    service : TapService, optional
        Where and how patiently to ask.
    cuts : Cuts, optional
        Which stars.
    step, tell : callable
        Told of finished steps, and of failures that are tried again.

    Raises
    ------
    RefreshError
        If the service fails, its answers cannot be right, or the file cannot be written. Files that were there stay
        as they are.
    InputError
        If ``out`` cannot be a place for it.
    """
    from importlib import metadata

    path, service = target_path(out), service or catalogs.TapService()
    versions = {DISTRIBUTION: __version__} | {name: metadata.version(name) for name in _SOFTWARE}
    made: catalogs.Refreshed | catalogs.RefreshedPlanets
    # What cannot be read back is not worth writing.
    if planets:
        made = catalogs.refresh_planets(service, step=step, tell=tell)
        text = catalogs.planets_ecsv(made, versions)
        catalogs.parse_planets(catalogs.TableBytes("the new table", text.encode(), ""))
    else:
        made = catalogs.refresh_stars(service, cuts or catalogs.Cuts(), step=step, tell=tell)
        text = catalogs.ecsv_text(made, versions)
        catalogs.parse_refreshed(text, "the new table")
    path = path / catalogs.file_name(made.queried_utc, made.kind) if out is None else path
    path = catalogs.set_aside(path) if made.refusal else path
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_named(path, text, key="--out")
    except OSError as error:
        hint = "choose another place with --out or CPIC_DATA_DIR"
        raise catalogs.RefreshError(f"cannot write {path}: {error.strerror}", hint) from None
    return Written(path, hashlib.sha256(text.encode()).hexdigest(), made)


_NAMES_SHOWN = 8
_DIFFERENCES = {
    "same": "the same",
    "added": "added",
    "removed": "removed",
    "gone": "gone",
    "v_mag_changed": "V differs by 0.05 mag or more",
    "parallax_changed": "parallax differs by 1 % or more",
    "orbit_moved": "orbit moved out of its errors",
}
_ELEMENTS = {"period_days": "period (d)", "semi_major_axis_au": "semi-major axis (au)", "eccentricity": "eccentricity"}


def refresh(output: RefreshOutput) -> None:
    """Ask SIMBAD for the nearby F, G and K stars, or the NASA Exoplanet Archive for their known planets.

    This is the only command that uses the network. It writes one dated ECSV file into the data folder
    (CPIC_DATA_DIR moves it), or --out, whole or not at all, and shows what differs from the shipped table; that and
    earlier files stay as they are. Use it with --catalog latest, or --catalog FILE; planets with --known-planets
    latest, over which the shipped updates are laid where they are newer.

    A table that lacks more than a tenth of what was known is set aside under another name for you to look at, and is
    never the latest. Companions are not part of SIMBAD's answer: they are taken over from the snapshot for the stars
    that it has.

    Examples:

      cpic catalog refresh

      cpic catalog refresh --planets

      cpic catalog refresh --dry-run

      cpic catalog refresh --out stars.ecsv --v-mag-max 6 --json

      cpic catalog refresh --url https://simbad.harvard.edu/simbad/sim-tap --timeout-s 600
    """
    planets, out = output.planets, output.out
    settings = ("url", "timeout_s", "retries", "maxrec", "plain_http", "other_hosts")
    service = catalogs.TapService(**{name: getattr(output, name) for name in settings})
    given = {name: getattr(output, name) for name in ("v_mag_max", "parallax_min_mas")}
    chosen = {name: value for name, value in given.items() if value is not None}
    if planets and chosen:
        option, value = next(iter(chosen.items()))
        raise InputError(option, value, allowed="not with --planets: it cuts a table of stars")
    cuts = catalogs.Cuts(**chosen)
    if output.dry_run:
        _show_plan(out, service, None if planets else cuts, as_json=output.as_json)
        return
    try:
        with progress("asking the archive" if planets else "asking SIMBAD", total=2 if planets else 3) as step:
            done = refresh_catalog(planets=planets, out=out, service=service, cuts=cuts, step=step, tell=command.note)
    except catalogs.RefreshError as error:
        raise typer.Exit(command.error_line(str(error), 1)) from None
    if output.as_json:
        command.print_json(done.summary())
    else:
        _show_result(done, command.console())
    if done.made.refusal:
        option = "--known-planets" if planets else "--catalog"
        remedy = f"set aside as {done.path}; if it is right, use it with {option} FILE"
        raise typer.Exit(command.error_line(f"{done.made.refusal} {remedy}", 1))


def _show_plan(out: Path | None, service: catalogs.TapService, cuts: catalogs.Cuts | None, *, as_json: bool) -> None:
    """Show what would be asked: about stars within cuts, or about planets where there are none."""
    from catalogs import PLANETS_QUERY, archive_url, queries, service_url

    place = target_path(out)
    where = str(place) if out is not None else f"{place}, dated file"
    plan = {
        "service": archive_url(service) if cuts is None else service_url(service),
        "queries": [PLANETS_QUERY] if cuts is None else list(queries(cuts)),
        "out": where,
    }
    if as_json:
        command.print_json(plan)
        return
    command.say(f"would ask {plan['service']}:")
    for query in plan["queries"]:
        command.say(f"\n  {query}")
    command.say(f"\nand write {where}")


def _show_result(done: Written, screen: Console) -> None:
    """Print counts, differences from the shipped table, and where the file is."""
    made = done.made
    name, what = ("SIMBAD", "stars") if made.kind == "simbad" else ("NASA Exoplanet Archive", "planets")
    rows = [(step, str(count)) for step, count in made.counts.items()]
    table(screen, f"{name} of {made.queried_utc:%Y-%m-%d %H:%M} UTC", ("rows", "number"), rows)
    moved = made.changes.get("orbit_moved", ())
    changes = dict(made.changes) | {"orbit_moved": list(dict.fromkeys(item["planet"] for item in moved))}
    cells = []
    for key in made.changes:
        names = [] if key == "same" else list(changes[key])
        shown = ", ".join(names[:_NAMES_SHOWN]) + (", ..." if names[_NAMES_SHOWN:] else "")
        cells.append((_DIFFERENCES[key], str(changes[key] if key == "same" else len(names)), shown))
    heads = ("", what, "first of them (--json lists all, with reasons)")
    table(screen, "Compared with the shipped table", heads, cells)
    if moved:
        columns = ("planet", "element", "shipped", "archive", "combined errors")
        table(screen, "Orbits that moved", columns, map(_moved, moved))
    report.print_lines(screen, *getattr(made, "notes", ()), wraps=False)
    if not done.made.refusal:
        report.print_lines(screen, f"wrote {command.place_of(done.path)}", wraps=False)


def _moved(item: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the cells of an element of an orbit that moved."""
    values = [
        f"{item[name]:g}" + (f" ± {error:g}" if (error := item[f"{name}_err"]) is not None else "")
        for name in ("before", "now")
    ]
    sigmas = "none given" if item["sigmas"] is None else f"{item['sigmas']:.1f}"
    return (item["planet"], _ELEMENTS[item["element"]], *values, sigmas)
