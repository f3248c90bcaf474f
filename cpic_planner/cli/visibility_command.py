"""``cpic visibility``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cpic_planner.cli.options import CatalogOption, InstrumentOption, JsonOption
from cpic_planner.cli.output import console, note, print_json

if TYPE_CHECKING:
    from cpic_planner.models import VisibilityResult

__all__ = ["HELP", "visibility"]

HELP = """Say when stars can be seen from the orbit of the telescope, and for how long per orbit.

Counts the angles from Sun and Moon, the dark and the sunlit limb of the Earth, the solar panels (which also limit the
roll) and, as a fraction of all time, the South Atlantic Anomaly. All limits can be changed: --visibility takes a YAML
file with what differs from the preset, for example moon_deg: 40. The orbit is that of the instrument (mission.orbit), a
model whose node is assumed: seasons hold, but which weeks have the longest windows depends on it.

Examples:

  cpic visibility "tau Cet"

  cpic visibility "alpha Cen B" --start 2029-06-01 --days 730 --plot visibility.png

  cpic visibility "tau Cet" "eps Eri" "61 Cyg A" "eps Ind" --plot calendar.png

  cpic visibility "tau Cet" --visibility my_limits.yaml --out days.csv

  cpic visibility "tau Cet" --step-days 0.25 --days 30 --json

  cpic visibility "my star" --catalog my_stars.csv"""


def visibility(
    targets: Annotated[
        list[str], typer.Argument(metavar="TARGET...", help='Stars: "HIP 8102", "tau Cet", "alpha Cen B" ...')
    ],
    start: Annotated[
        str | None, typer.Option("--start", help="First day, UTC, e.g. 2028-01-01 [default: that of the mission].")
    ] = None,
    days: Annotated[int, typer.Option("--days", help="How many days.")] = 365,
    step_days: Annotated[
        float, typer.Option("--step-days", help="Time between orbits that are looked at; of the Moon, at most 1.")
    ] = 1.0,
    limits: Annotated[
        str | None,
        typer.Option("--visibility", help="Limits of pointing: preset, or YAML file [default: default]."),
    ] = None,
    instrument: InstrumentOption = None,
    catalog: CatalogOption = "snapshot",
    plot: Annotated[
        Path | None,
        typer.Option("--plot", help="Draw FILE.png, .pdf or .svg: the days of one star, a calendar of several."),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Also write every step of every star to FILE.csv.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Find out and print."""
    from catalogs.catalogue import open_catalogue
    from catalogs.errors import InputError
    from cpic_planner.survey.visibility import load_visibility
    from cpic_planner.survey.visibility.result import visibility_result
    from cpic_planner.targets import Targets, find_target
    from simulator.config import load_instrument

    if out is not None and out.suffix != ".csv":
        raise InputError("--out", str(out), allowed="a name that ends in .csv")
    if plot is not None:
        from cpic_planner.report.etc_figures import check_figure_name

        check_figure_name(plot)
    config, mission = load_visibility(limits), load_instrument(instrument).mission
    table = open_catalogue(catalog)
    for remark in table.notes:
        note(remark)
    stars: dict[str, Targets] = {}
    for target in targets:
        star, remark = find_target(target, catalog=table)
        if remark:
            note(remark)
        stars.setdefault(str(star.name[0]), star)
    result = visibility_result(
        Targets.joined(list(stars.values())),
        config,
        mission.orbit,
        start_utc=mission.start_utc if start is None else start,
        n_days=days,
        step_days=step_days,
        catalogue=table.provenance,
    )
    _write(result, out, plot)
    if as_json:
        print_json(result)
        return
    from cpic_planner.report.console_visibility import print_visibility

    print_visibility(result, console())


def _write(result: VisibilityResult, out: Path | None, plot: Path | None) -> None:
    """Write the table and the figure that were asked for."""
    if out is not None:
        from catalogs.errors import InputError
        from cpic_planner.report.visibility_words import visibility_csv
        from simulator.files import write_text

        try:
            write_text(out, visibility_csv(result))
        except OSError as error:
            raise InputError("--out", str(out), allowed="a writable file", hint=error.strerror or "") from None
        note(f"wrote {len(result.targets) * len(result.mjd)} rows to {out}")
    if plot is not None:
        from cpic_planner.report.etc_figures import write_figure
        from cpic_planner.report.visibility_figure import visibility_figure

        write_figure(visibility_figure(result), plot)
        note(f"wrote {plot}")
