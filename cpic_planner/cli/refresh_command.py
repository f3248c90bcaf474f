"""``cpic catalog refresh``: new tables of stars and of known planets, and what differs from the shipped ones."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cpic_core import InputError
from cpic_planner import report
from cpic_planner.cli.catalog_command import table
from cpic_planner.cli.options import JsonOption, console, error_line, note, place_of, print_json, say
from cpic_planner.cli.progress import progress

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console

    from catalogs import Cuts, TapService
    from cpic_planner.cli.refreshed_files import Written

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


def refresh(
    planets: Annotated[
        bool, typer.Option("--planets", help="Ask the NASA Exoplanet Archive for known planets, not SIMBAD for stars.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option("--out", help="Write FILE.ecsv [default: dated, in the data folder].")
    ] = None,
    v_mag_max: Annotated[
        float | None,
        typer.Option(
            "--v-mag-max", help="Faintest V of the stars; rankings end at 7, the rest is a reserve [default: 7.5]."
        ),
    ] = None,
    parallax_min_mas: Annotated[
        float | None, typer.Option("--parallax-min-mas", help="Smallest parallax of the stars [default: 25].")
    ] = None,
    url: Annotated[
        str,
        typer.Option(
            "--url",
            help="TAP service [default: $CPIC_SIMBAD_URL, or astroquery's SIMBAD server; $CPIC_ARCHIVE_URL, or the "
            "archive's].",
        ),
    ] = "",
    timeout_s: Annotated[
        float, typer.Option("--timeout-s", help="Most time for one answer, from connecting to reading its last cell.")
    ] = 180.0,
    retries: Annotated[int, typer.Option("--retries", help="How often a failure on the way is tried again.")] = 3,
    maxrec: Annotated[int, typer.Option("--maxrec", help="Most rows of one answer.")] = 200_000,
    plain_http: Annotated[
        bool,
        typer.Option(
            "--plain-http", help="Allow plain http, which anybody on the way can alter, elsewhere than on this machine."
        ),
    ] = False,
    other_hosts: Annotated[bool, typer.Option("--other-hosts", help="Follow redirects to another host.")] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Show the queries and the place, ask nothing.")] = False,
    as_json: JsonOption = False,
) -> None:
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
    from catalogs import Cuts, RefreshError, TapService
    from cpic_planner.cli.refreshed_files import refresh_catalog

    service = TapService(
        url=url,
        timeout_s=timeout_s,
        retries=retries,
        maxrec=maxrec,
        plain_http=plain_http,
        other_hosts=other_hosts,
    )
    given = {"v_mag_max": v_mag_max, "parallax_min_mas": parallax_min_mas}
    chosen = {name: value for name, value in given.items() if value is not None}
    if planets and chosen:
        option, value = next(iter(chosen.items()))
        raise InputError(f"--{option.replace('_', '-')}", value, allowed="not with --planets: it cuts a table of stars")
    cuts = Cuts(**chosen)
    if dry_run:
        _show_plan(out, service, None if planets else cuts, as_json=as_json)
        return
    try:
        with progress("asking the archive" if planets else "asking SIMBAD", total=2 if planets else 3) as step:
            done = refresh_catalog(planets=planets, out=out, service=service, cuts=cuts, step=step, tell=note)
    except RefreshError as error:
        raise typer.Exit(error_line(str(error), 1)) from None
    if as_json:
        print_json(done.summary())
    else:
        _show_result(done, console())
    if done.made.refusal:
        option = "--known-planets" if planets else "--catalog"
        remedy = f"set aside as {done.path}; if it is right, use it with {option} FILE"
        raise typer.Exit(error_line(f"{done.made.refusal} {remedy}", 1))


def _show_plan(out: Path | None, service: TapService, cuts: Cuts | None, *, as_json: bool) -> None:
    """Show what would be asked: about stars within cuts, or about planets where there are none."""
    from catalogs import PLANETS_QUERY, archive_url, queries, service_url
    from cpic_planner.cli.refreshed_files import target_path

    place = target_path(out)
    where = str(place) if out is not None else f"{place}, dated file"
    plan = {
        "service": archive_url(service) if cuts is None else service_url(service),
        "queries": [PLANETS_QUERY] if cuts is None else list(queries(cuts)),
        "out": where,
    }
    if as_json:
        print_json(plan)
        return
    say(f"would ask {plan['service']}:")
    for query in plan["queries"]:
        say(f"\n  {query}")
    say(f"\nand write {where}")


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
    report.print_plain(screen, *getattr(made, "notes", ()), wraps=False)
    if not done.made.refusal:
        report.print_plain(screen, f"wrote {place_of(done.path)}", wraps=False)


def _moved(item: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the cells of an element of an orbit that moved."""
    values = [
        f"{item[name]:g}" + (f" ± {error:g}" if (error := item[f"{name}_err"]) is not None else "")
        for name in ("before", "now")
    ]
    sigmas = "none given" if item["sigmas"] is None else f"{item['sigmas']:.1f}"
    return (item["planet"], _ELEMENTS[item["element"]], *values, sigmas)
