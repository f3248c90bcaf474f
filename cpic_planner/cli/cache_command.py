"""``cpic cache``."""

from __future__ import annotations

import sys

import typer

from cpic_planner.cli.options import JsonOption

__all__ = ["app"]

app = typer.Typer(
    help="What the disk cache holds, and how to empty it. Emptying it is always safe.", no_args_is_help=True
)


@app.command("info")
def info(as_json: JsonOption = False) -> None:
    """Show folder, entries and size (example: cpic cache info)."""
    from simulator.cache import cache_info
    from simulator.files import dump_json

    found = cache_info()
    if as_json:
        sys.stdout.write(
            dump_json({"folder": str(found.folder), "n_entries": found.n_entries, "size_bytes": found.size_bytes})
        )
    else:
        typer.echo(
            f"{found.folder}: {found.n_entries} entries, {found.size_bytes / 1e6:.1f} MB (CPIC_CACHE_DIR moves it)"
        )


@app.command("clear")
def clear() -> None:
    """Remove every entry (example: cpic cache clear)."""
    from simulator.cache import clear_cache

    was = clear_cache()
    typer.echo(f"removed {was.n_entries} entries, {was.size_bytes / 1e6:.1f} MB from {was.folder}")
