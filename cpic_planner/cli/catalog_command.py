"""Refresh the star table from SIMBAD and leave it, whole, beside the snapshot; the snapshot itself never changes.

``cpic catalog``.
"""

from __future__ import annotations

import hashlib
import os
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import catalogs
from catalogs import (
    POSITION_ERROR_ARCSEC,
    Cuts,
    Refreshed,
    RefreshError,
    TapService,
    data_dir,
    ecsv_text,
    file_name,
    parse_refreshed,
)
from catalogs.refresh import refresh
from cpic_core import InputError, write_text
from cpic_planner.cli.options import JsonOption, console, error_line, note, print_json
from cpic_planner.cli.progress import progress
from cpic_planner.version import DISTRIBUTION, __version__

if TYPE_CHECKING:
    from rich.console import Console

    from catalogs import Column


_EMBEDDED = Path(catalogs.__file__).resolve().parent
_SOFTWARE = ("astroquery", "pyvo", "astropy", "numpy")


@dataclass(frozen=True)
class Written:
    """A refreshed table on disk."""

    path: Path
    sha256: str
    made: Refreshed

    def summary(self) -> dict[str, Any]:
        """What happened, as plain values: file, source, counts, and what differs from the snapshot."""
        made, changes = self.made, self.made.changes
        return {
            "schema_version": 1,
            "kind": "catalog_refresh",
            "file": str(self.path),
            "sha256": self.sha256,
            "queried_utc": made.queried_utc.isoformat(),
            "service": made.url,
            "queries": list(made.queries),
            "cuts": {"v_mag_max": made.cuts.v_mag_max, "parallax_min_mas": made.cuts.parallax_min_mas},
            "counts": dict(made.counts),
            "changes_to_snapshot": {
                "same": changes.same,
                "added": list(changes.added),
                "removed": dict(changes.removed),
                "v_mag_changed": list(changes.v_mag),
                "parallax_changed": list(changes.parallax),
            },
            "left_out": dict(made.left_out),
        }


def target_path(out: str | Path | None) -> Path:
    """Where a refreshed table goes: ``out``, or the data folder (the name then has the date of the query).

    Raises
    ------
    InputError
        If ``out`` does not end in ``.ecsv``, lies in the installed package, is a folder, or cannot be written.
    """
    if out is None:
        return data_dir()
    path = Path(out).expanduser()
    if path.suffix != ".ecsv" or path.is_dir():
        raise InputError("--out", str(out), allowed="a file name that ends in .ecsv")
    if path.resolve().is_relative_to(_EMBEDDED):
        raise InputError("--out", str(out), allowed="a place outside the package: its own table never changes")
    if not path.parent.is_dir():
        raise InputError("--out", str(out), allowed="a file in a folder that exists")
    return path


def refresh_catalog(
    *,
    out: str | Path | None = None,
    service: TapService | None = None,
    cuts: Cuts | None = None,
    step: Callable[[str], None] = lambda text: None,
    tell: Callable[[str], None] = lambda text: None,
) -> Written:
    """Ask SIMBAD for the stars and write them as one ECSV file, all or nothing.

    Parameters
    ----------
    out : str or Path, optional
        File to write, replaced when it is there; by default a dated file in the data folder
        (`catalogs.refresh.data_dir`), where ``--catalog latest`` finds it.
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
    place = target_path(out)
    _check_writable(place)
    made = refresh(service or TapService(), cuts or Cuts(), step=step, tell=tell)
    text = ecsv_text(made, _versions())
    path = place / file_name(made.queried_utc) if out is None else place
    parse_refreshed(text, path.name)  # what cannot be read back is not worth writing
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
    except OSError as error:
        raise _unwritable(path, error.strerror) from None
    return Written(path, hashlib.sha256(text.encode()).hexdigest(), made)


def _check_writable(place: Path) -> None:
    """Refuse before the long question what would fail after it."""
    folder = place if place.suffix != ".ecsv" else place.parent
    while not folder.exists() and folder != folder.parent:
        folder = folder.parent
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        raise _unwritable(place, f"{folder} is not a writable folder")


def _unwritable(path: Path, reason: str | None) -> RefreshError:
    return RefreshError(f"cannot write {path}: {reason}", "choose another place with --out or CPIC_DATA_DIR")


def _versions() -> dict[str, str]:
    return {DISTRIBUTION: __version__} | {name: metadata.version(name) for name in _SOFTWARE}


HELP = "The star tables: what ships with the package, and a fresh one from SIMBAD."
app = typer.Typer(help=HELP, no_args_is_help=True)

_NAMES_SHOWN = 8
_WORTH_A_REMARK = 0.1


@app.callback()
def root() -> None:
    """Group of catalogue commands."""


@app.command("info")
def info(as_json: JsonOption = False) -> None:
    """Show the star tables: the snapshot's vintage, counts, sources and licences, and refreshed ones.

    Example: cpic catalog info
    """
    facts, stored = catalogs.catalogue_info(), catalogs.stored_tables()
    refreshed = [
        {"file": str(item.path), "queried_utc": item.queried_utc.isoformat(), "size_bytes": item.path.stat().st_size}
        for item in stored
    ]
    if as_json:
        latest = refreshed[0]["file"] if stored else None
        print_json(facts | {"data_folder": str(data_dir()), "refreshed": refreshed, "latest": latest})
        return
    screen = console()
    screen.print(f"[bold]{facts['vintage']}[/bold]")
    _table(screen, "Counts per cut", ("cut", "stars"), ((row["cut"], str(row["count"])) for row in facts["counts"]))
    grades = Counter(row["grade"] for row in facts["binary_orbits"])
    rows = ((str(grade), str(count), f"{POSITION_ERROR_ARCSEC[grade]:g}") for grade, count in sorted(grades.items()))
    heads = ("grade of the orbit", "pairs", "error of a place (arcsec)")
    _table(screen, "Companions that follow their orbits (--json lists them; --catalog simbad_2012: none)", heads, rows)
    files = ((row["file"], row["packages"], row["licence"]) for row in facts["files"])
    _table(screen, "Data files and where they come from", ("file", "packages", "licence"), files)
    planets = facts["known_planets"]
    screen.print(f"Known planets: {planets['vintage']}; {'; '.join(planets['notes'])}.")
    new = planets["updates"]
    screen.print(
        f"Updated {new['date']}: {new['n_rows']} planets ({new['file']}, each with its source). "
        f"Refuted, listed and not counted: {', '.join(new['refuted'])}. "
        f"Controversial, counted: {', '.join(new['controversial'])}."
    )
    for line in facts["credits"]:
        screen.print(line)
    if not stored:
        screen.print(f"No refreshed table in {data_dir()} (cpic catalog refresh makes one).", soft_wrap=True)
        return
    rows = (
        (item.path.name, f"{item.queried_utc:%Y-%m-%d %H:%M} UTC", "--catalog latest" if item is stored[0] else "")
        for item in stored
    )
    _table(screen, f"Refreshed tables in {data_dir()}", ("file", "asked", "used by"), rows)


@app.command("columns")
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
        _table(screen, f"Columns of a table of {title} of your own", headings, cells)
    screen.print(
        "Upper and lower case, blanks and _ make no difference. Units are those of an ECSV or VOTable, or are "
        "written in the heading: plx [mas]. What a star lacks is filled and labelled; what a planet lacks is "
        "unknown, and drawn."
    )


def _column_rows(columns: Mapping[str, Column], needed: Mapping[str, str]) -> list[dict[str, Any]]:
    """What is said of each column."""
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


@app.command("refresh")
def refresh_catalogue(
    out: Annotated[
        Path | None, typer.Option("--out", help="Write FILE.ecsv [default: dated, in the data folder].")
    ] = None,
    v_mag_max: Annotated[
        float, typer.Option("--v-mag-max", help="Faintest V; rankings end at 7, the rest is margin.")
    ] = 7.5,
    parallax_min_mas: Annotated[float, typer.Option("--parallax-min-mas", help="Smallest parallax.")] = 25.0,
    url: Annotated[
        str, typer.Option("--url", help="TAP service [default: $CPIC_SIMBAD_URL, or astroquery's SIMBAD server].")
    ] = "",
    timeout_s: Annotated[float, typer.Option("--timeout-s", help="Most time for one answer.")] = 180.0,
    retries: Annotated[int, typer.Option("--retries", help="How often a failure on the way is tried again.")] = 3,
    maxrec: Annotated[int, typer.Option("--maxrec", help="Most rows of one answer.")] = 200_000,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show the queries and the place, ask nothing.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Ask SIMBAD for the nearby F, G and K stars and keep the answer beside the embedded snapshot.

    This is the only command that uses the network. It writes one dated ECSV file into the data folder
    (CPIC_DATA_DIR moves it), or --out, whole or not at all; the snapshot and earlier files stay as they are. Use it
    with --catalog latest, or --catalog FILE.

    Companions are not part of the answer: they are taken over from the snapshot for the stars that it has.

    Examples:

      cpic catalog refresh

      cpic catalog refresh --dry-run

      cpic catalog refresh --out stars.ecsv --v-mag-max 6 --json

      cpic catalog refresh --url https://simbad.harvard.edu/simbad/sim-tap --timeout-s 600
    """
    service = TapService(url=url, timeout_s=timeout_s, retries=retries, maxrec=maxrec)
    cuts = Cuts(v_mag_max=v_mag_max, parallax_min_mas=parallax_min_mas)
    if dry_run:
        _show_plan(out, service, cuts, as_json=as_json)
        return
    try:
        with progress("asking SIMBAD", total=3) as step:
            done = refresh_catalog(out=out, service=service, cuts=cuts, step=step, tell=note)
    except RefreshError as error:
        raise typer.Exit(error_line(str(error), 1)) from None
    lost, before = len(done.made.changes.removed), done.made.changes.before
    if lost > _WORTH_A_REMARK * before:
        missing = f"{lost} of {before} stars of the snapshot within the cuts are not in the new table"
        note(f"{missing}: is the service whole?")
    if as_json:
        print_json(done.summary())
        return
    _show_result(done, console())


def _show_plan(out: Path | None, service: Any, cuts: Any, *, as_json: bool) -> None:
    place = target_path(out)
    where = str(place) if out is not None else f"{place}, dated file"
    plan = {"service": catalogs.service_url(service), "queries": list(catalogs.queries(cuts)), "out": where}
    if as_json:
        print_json(plan)
        return
    typer.echo(f"would ask {plan['service']}:")
    for query in plan["queries"]:
        typer.echo(f"\n  {query}")
    typer.echo(f"\nand write {where}")


def _show_result(done: Written, screen: Console) -> None:
    made, changes = done.made, done.made.changes
    rows = [(what, str(count)) for what, count in made.counts.items()]
    _table(screen, f"SIMBAD of {made.queried_utc:%Y-%m-%d %H:%M} UTC", ("rows", "number"), rows)
    differences = (
        ("the same", changes.same, ()),
        ("added", len(changes.added), changes.added),
        ("removed", len(changes.removed), tuple(changes.removed)),
        ("V differs by 0.05 mag or more", len(changes.v_mag), changes.v_mag),
        ("parallax differs by 1 % or more", len(changes.parallax), changes.parallax),
    )
    cells = (
        (what, str(count), ", ".join(names[:_NAMES_SHOWN]) + (", ..." if names[_NAMES_SHOWN:] else ""))
        for what, count, names in differences
    )
    _table(screen, "Compared with the snapshot", ("", "stars", "first of them (--json lists all, with reasons)"), cells)
    screen.print(f"wrote {done.path}", soft_wrap=True)


def _table(screen: Console, title: str, headings: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> None:
    from rich.table import Table
    from rich.text import Text

    table = Table(title=title, title_justify="left")
    for heading in headings:
        right = heading in ("stars", "number")
        table.add_column(heading, justify="right" if right else "left", overflow="fold")
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    screen.print(table)
