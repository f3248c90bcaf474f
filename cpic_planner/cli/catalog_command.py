"""``cpic catalog``."""

from __future__ import annotations

import sys

import typer

from cpic_planner.cli.options import JsonOption
from cpic_planner.cli.output import console

__all__ = ["app"]

app = typer.Typer(help="The star table and the other facts that ship with the package.", no_args_is_help=True)


@app.callback()
def root() -> None:
    """Group of catalogue commands."""


@app.command("info")
def info(as_json: JsonOption = False) -> None:
    """Show what the snapshot is: vintage, counts per cut, name coverage, sources and licences.

    Example: cpic catalog info
    """
    from catalogs.info import catalogue_info
    from simulator.files import dump_json

    found = catalogue_info()
    if as_json:
        sys.stdout.write(dump_json(found))
        return
    from rich.table import Table

    screen = console()
    screen.print(f"[bold]{found['vintage']}[/bold]")
    counts = Table(title="Counts per cut", title_justify="left")
    counts.add_column("cut")
    counts.add_column("stars", justify="right")
    for row in found["counts"]:
        counts.add_row(row["cut"], str(row["count"]))
    screen.print(counts)
    sources = Table(title="Data files and where they come from", title_justify="left")
    for heading in ("file", "packages", "licence"):
        sources.add_column(heading, overflow="fold")
    for row in found["files"]:
        sources.add_row(row["file"], row["packages"], row["licence"])
    screen.print(sources)
    for line in found["credits"]:
        screen.print(line)
