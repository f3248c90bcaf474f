"""``cpic catalog refresh``: new tables of stars and of known planets, and what differs from the shipped ones."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cpic_core import InputError
from cpic_planner import report
from cpic_planner.cli.catalog_command import table
from cpic_planner.cli.options import JsonOption, console, error_line, note, place_of, print_json, say
from cpic_planner.cli.progress import progress

if TYPE_CHECKING:
    from rich.console import Console

    from catalogs import Cuts, Refreshed, RefreshedPlanets, TapService
    from cpic_planner.cli.refreshed_files import Written

_NAMES_SHOWN = 8
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
    from cpic_planner.cli.refreshed_files import refresh_catalog, refresh_known_planets

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
            done = (
                refresh_known_planets(out=out, service=service, step=step, tell=note)
                if planets
                else refresh_catalog(out=out, service=service, cuts=cuts, step=step, tell=note)
            )
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
    from catalogs import RefreshedPlanets

    made = done.made
    name = "NASA Exoplanet Archive" if isinstance(made, RefreshedPlanets) else "SIMBAD"
    rows = [(what, str(count)) for what, count in made.counts.items()]
    table(screen, f"{name} of {made.queried_utc:%Y-%m-%d %H:%M} UTC", ("rows", "number"), rows)
    if isinstance(made, RefreshedPlanets):
        _show_planets(made, screen)
    else:
        _show_stars(made, screen)
    if not done.made.refusal:
        report.print_plain(screen, f"wrote {place_of(done.path)}", wraps=False)


def _show_stars(made: Refreshed, screen: Console) -> None:
    changes = made.changes
    differences = (
        ("the same", changes.same, ()),
        ("added", len(changes.added), changes.added),
        ("removed", len(changes.removed), tuple(changes.removed)),
        ("V differs by 0.05 mag or more", len(changes.v_mag), changes.v_mag),
        ("parallax differs by 1 % or more", len(changes.parallax), changes.parallax),
    )
    _compared(screen, "stars", differences)


def _show_planets(made: RefreshedPlanets, screen: Console) -> None:
    from cpic_planner.cli.refreshed_files import plain

    changes = made.changes
    moved = tuple(dict.fromkeys(item.planet for item in changes.moved))
    differences = (
        ("the same", changes.same, ()),
        ("new", len(changes.added), changes.added),
        ("gone", len(changes.gone), tuple(changes.gone)),
        ("orbit moved out of its errors", len(moved), moved),
    )
    _compared(screen, "planets", differences)
    if changes.moved:
        cells = (
            (
                item.planet,
                _ELEMENTS[item.element],
                _measured(item.before, item.before_err),
                _measured(item.now, item.now_err),
                "none given" if plain(item.sigmas) is None else f"{item.sigmas:.1f}",
            )
            for item in changes.moved
        )
        table(screen, "Orbits that moved", ("planet", "element", "shipped", "archive", "combined errors"), cells)
    report.print_plain(screen, *made.notes, wraps=False)


def _measured(value: float, error: float) -> str:
    return f"{value:g}" + (f" ± {error:g}" if error == error else "")


def _compared(screen: Console, what: str, differences: tuple[tuple[str, int, tuple[str, ...]], ...]) -> None:
    cells = (
        (kind, str(count), ", ".join(names[:_NAMES_SHOWN]) + (", ..." if names[_NAMES_SHOWN:] else ""))
        for kind, count, names in differences
    )
    heads = ("", what, "first of them (--json lists all, with reasons)")
    table(screen, "Compared with the shipped table", heads, cells)
