"""The commands ``cpic known`` and ``cpic visibility``."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cpic_planner import report
from cpic_planner.cli import options
from cpic_planner.cli.progress import is_verbose

if TYPE_CHECKING:
    from catalogs import Catalogue
    from cpic_planner.queries import KnownQuestion, VisibilityQuestion
    from cpic_planner.ranking import KnownChoice


def known(
    question: KnownQuestion,
    output: options.Output,
    limit: Annotated[int, typer.Option("--limit", min=1, help="Rows to print (--json holds all).")] = 40,
    plot: Annotated[
        Path | None, typer.Option("--plot", help="Draw separation against time into FILE.png, .pdf or .svg as well.")
    ] = None,
    scene: Annotated[
        Path | None,
        typer.Option(
            "--scene", help="Write one draw of the star's planets into FILE.yaml, for cpic simulate or confirm."
        ),
    ] = None,
) -> None:
    """Say where the known planets are at a date, how bright, and when the dark hole covers them.

    Published orbits are drawn within their errors: with time the place of a planet gets less certain, and where no
    time of periastron or conjunction is published its phase is unknown. Without a star all stars with known planets
    are listed, with one also the days of the next years on which it stands in a dark hole. With -v: also why some
    planets are not counted, every window, and where orbits and status are from.

    Examples:

      cpic known

      cpic known "eps Eri"

      cpic known "pi Men" --date 2031-05-01 --years 8 --plot separation.png

      cpic known "47 UMa" --band F520 --json

      cpic known "eps Eri" --date 2034-03-01 --scene eps_eri.yaml

      cpic known --known-planets my_planets.csv

      cpic known "alpha Cen A" --candidates

    Every planet has a status. Confirmed and controversial planets are counted by cpic rank, plan and whatif;
    candidates and refuted planets are listed here with the reference. --candidates, an option of those commands
    too, counts candidates as well; refuted planets are never counted.

    Where publications disagree on an orbit, each draw takes one of them by its weight, and the answer says which.
    An orbit that a later publication contradicts is flagged orbit_superseded.

    The shipped table is that of the NASA Exoplanet Archive of 2019 with the updates since that change what can be
    seen. A table of your own (cpic catalog columns lists its columns) is laid over it: a planet of the same name is
    replaced, the others stay. It may be one of the archive (default solutions, CSV). A row with a star, a planet
    and a status changes the status alone. --known-planets none+my_planets.csv takes the file alone, archive_2019
    the table without updates, latest the newest of the archive (cpic catalog refresh --planets).
    """
    from catalogs import open_catalogue
    from cpic_core import InputError
    from cpic_planner.api.named import planet_named
    from cpic_planner.etc import build_model
    from cpic_planner.queries import DEFAULT_YEARS
    from cpic_planner.ranking import KnownChoice
    from cpic_planner.ranking.known_answer import known_answer
    from cpic_planner.targets import find_target, rank_sample

    star = question.star
    for name, value in (("--plot", plot), ("--scene", scene)):
        if star is None and value is not None:
            raise InputError(name, str(value), allowed="only with a STAR")
    options.check_file(scene, (".yaml", ".yml"), "--scene")
    options.check_plot(plot)
    table = open_catalogue(question.catalog)
    model = build_model(question.instrument, question.bands)
    choice = KnownChoice.at(
        question.known_planets or "snapshot",
        question.date_utc,
        question.albedo,
        question.instrument,
        n_draws=question.n_draws,
        seed=question.seed,
        candidates=question.candidates,
    )
    planet = None
    if star is None:
        targets = rank_sample(catalog=table, v_mag_max=question.v_mag_max, date_utc=choice.date_utc)
    else:
        try:
            targets, remark = find_target(star, catalog=table, date_utc=choice.date_utc)
        except InputError as error:
            only = planet_named(choice, star, error)
            planet = only.name
            targets, remark = find_target(only.star, catalog=table, date_utc=choice.date_utc)
        options.note(*filter(None, [remark]))
        name = str(targets.name[0])
        if not choice.table.listed_rows_of(name):
            raise InputError("star", star, allowed="a star with known planets", hint=choice.table.provenance)
        if (plot is not None or scene is not None) and not choice.table.rows_of(name):
            allowed, hint = "a star with a confirmed or controversial planet", "its planets are only listed"
            raise InputError("--plot" if scene is None else "--scene", star, hint=hint, allowed=allowed)
    span = None if star is None else DEFAULT_YEARS if question.years is None else question.years
    told: dict[str, Any] = {"years": span, "bands": question.bands, "catalogue": table.provenance}
    result = known_answer(model, targets, choice, planet=planet, notes=table.notes, **told)
    if plot is not None:
        options.write_plot(plot, report.known_figure(result))
    if scene is not None:
        _write_scene(scene, str(targets.name[0]), choice, table)
    options.tell_rows(output, limit, len(result.planets))
    output.show(result, partial(report.print_known, result, limit=limit, full=is_verbose()))


def _write_scene(path: Path, star: str, choice: KnownChoice, table: Catalogue) -> None:
    """Write the first draw of a star's planets as a scene file."""
    from cpic_core import dump_json, one_line, write_named
    from cpic_planner.ranking import known_scene

    about = f"# {star} with its known planets on {choice.date_utc}, one draw with seed {choice.seed}."
    source = f"# Orbits: {choice.table.provenance}. Node, and what else is unknown, is as likely as any other."
    body = dump_json(known_scene(star, choice, catalog=table))  # JSON is YAML
    write_named(path, f"{one_line(about)}\n{one_line(source)}\n{body}", key="--scene")
    options.note(f"wrote {options.place_of(path)}")


def visibility(
    question: VisibilityQuestion,
    output: options.Answer,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", help="Draw FILE.png, .pdf or .svg: the days of one star, a calendar of several."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Also write every step of every star to FILE.csv.")
    ] = None,
) -> None:
    """Say when stars can be seen from the orbit of the telescope, and for how long per orbit.

    Counts the angles from Sun and Moon, the dark and the sunlit limb of the Earth, the solar panels (which also
    limit the roll) and, as a fraction of all time, the South Atlantic Anomaly. All limits can be changed:
    --visibility takes a YAML file with what differs from the preset, for example moon_deg: 40. The orbit is that of
    the instrument (mission.orbit), a model whose node is assumed: seasons hold, but which weeks have the longest
    windows depends on it.

    Examples:

      cpic visibility "tau Cet"

      cpic visibility "alpha Cen B" --start 2029-06-01 --days 730 --plot visibility.png

      cpic visibility "tau Cet" "eps Eri" "61 Cyg A" "eps Ind" --plot calendar.png

      cpic visibility "tau Cet" --visibility my_limits.yaml --out days.csv

      cpic visibility "tau Cet" --step-days 0.25 --days 30 --json

      cpic visibility "my star" --catalog my_stars.csv
    """
    from cpic_planner.api import visibility_of

    options.check_file(out, (".csv",), "--out")
    options.check_plot(plot)
    result = visibility_of(question, options.note)
    if out is not None:
        rows = len(result.targets) * len(result.mjd)
        options.write_out(out, lambda: report.visibility_csv(result), rows, rows)
    if plot is not None:
        options.write_plot(plot, report.visibility_figure(result))
    seen = any(target.observable_days for target in result.targets)
    output.show(result, partial(report.print_visibility, result, full=is_verbose()), seen)
