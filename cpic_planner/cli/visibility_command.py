"""``cpic visibility``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cpic_planner.cli.options import JsonOption, check_file, check_plot, write_out, write_plot
from cpic_planner.cli.output import console, note, print_json

if TYPE_CHECKING:
    from cpic_planner.queries.visibility import VisibilityQuestion

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
    question: VisibilityQuestion,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", help="Draw FILE.png, .pdf or .svg: the days of one star, a calendar of several."),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Also write every step of every star to FILE.csv.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Find out and print."""
    from cpic_planner.api.surveys import visibility_of

    check_file(out, (".csv",), "--out")
    check_plot(plot)
    result = visibility_of(question, note)
    if out is not None:
        from cpic_planner.report.tables import visibility_csv

        write_out(out, lambda: visibility_csv(result), len(result.targets) * len(result.mjd))
    if plot is not None:
        from cpic_planner.report.visibility_figure import visibility_figure

        write_plot(plot, visibility_figure(result))
    if as_json:
        print_json(result)
        return
    from cpic_planner.report.console_visibility import print_visibility

    print_visibility(result, console())
