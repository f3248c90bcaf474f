"""``cpic rank``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cpic_planner.cli.options import (
    JsonOption,
    check_file,
    check_plot,
    console,
    note,
    print_json,
    refuse_together,
    write_out,
    write_plot,
)

if TYPE_CHECKING:
    from cpic_planner.etc import EtcModel
    from cpic_planner.queries import RankQuestion
    from cpic_planner.results import RankResult
    from cpic_planner.targets import Targets

HELP = """Rank the whole catalogue (analytic, a few seconds; --explain and --sensitivity rank it several times).

The ranking is by completeness per hour: which fraction of a population of planets one observation of the star detects,
over its wall time. Stars that show none of it, with a score of zero, follow by detection margin. --score chooses
another order; the other columns are about a stated reference planet: whether it is detected (at its known place), how
likely a search finds it that does not know the place, and what limits it (limited_by: the single change that would make
it detected in the given time; see cpic etc --help).

Examples:

  cpic rank

  cpic rank --score detection_margin --band F662 --time-s 7200 --dwarfs --singles --limit 50

  cpic rank --population solar_system --planets 1000 --plot ranking.png

  cpic rank --explain "tau Cet"

  cpic rank --sensitivity

  cpic rank --json | python -m json.tool | head -40

  cpic rank --out ranking.csv

  cpic rank --catalog my_stars.csv

  cpic rank --known-planets snapshot --date 2030-06-01

--catalog takes a table with the columns name, distance_pc or parallax_mas, v_mag, and sp_type or teff_k (or the usual
other names of these); cpic catalog columns lists all that are read.

--known-planets ranks the stars that have known planets by the probability that one observation at --date detects at
least one of them, the errors of their orbits included; --planets is then the number of draws of each planet."""


def rank(
    question: RankQuestion,
    limit: Annotated[
        int, typer.Option("--limit", min=1, help="Stars to print and to draw (--json and --out hold all).")
    ] = 20,
    explain: Annotated[
        str | None, typer.Option("--explain", help="Say why this star stands where it stands, instead of the table.")
    ] = None,
    sensitivity: Annotated[
        bool, typer.Option("--sensitivity", help="Say how the order depends on assumptions, instead of the table.")
    ] = False,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", help="Draw the first --limit stars, at most 100, into FILE.png, .pdf or .svg as well."),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Also write all rows to FILE.csv or FILE.ecsv.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Rank and print."""
    from cpic_planner.api import prepared
    from cpic_planner.ranking import rank_targets
    from cpic_planner.targets import find_target

    refuse_together({"--explain": explain, "--sensitivity": sensitivity}, "two answers")
    for name, value in (("--explain", explain), ("--sensitivity", sensitivity)):
        refuse_together({name: value, "--out": out}, "it holds no ranking")
        refuse_together({name: value, "--plot": plot}, "it has no figure")
        known = question.known_planets
        refuse_together({name: value, "--known-planets": known}, "it is about a hypothetical population")
    check_file(out, (".csv", ".ecsv"), "--out")
    check_plot(plot)
    ready = prepared(question)
    for remark in ready.notes:
        note(remark)
    if explain is not None:
        star, remark = find_target(explain, companions=question.companions, catalog=ready.catalogue)
        if remark:
            note(remark)
        _explain(ready.model, ready.targets, str(star.name[0]), explain, ready.asked, as_json)
        return
    if sensitivity:
        _sensitivity(ready.model, ready.targets, ready.asked, as_json)
        return
    result = rank_targets(
        ready.model, ready.targets, sample=ready.sample, catalogue=ready.catalogue.provenance, **ready.asked
    )
    _write(result, out, plot, limit)
    if as_json:
        print_json(result)
        return
    from cpic_planner.report import print_rank

    print_rank(result, console(), limit=limit)


def _explain(model: EtcModel, targets: Targets, name: str, given: str, asked: dict[str, Any], as_json: bool) -> None:
    """Print why a star stands where it stands."""
    from cpic_core import InputError
    from cpic_planner.ranking import explain_star

    if name not in set(targets.name.tolist()):
        raise InputError(
            "--explain",
            given,
            allowed="a star of the sample that is ranked",
            hint="it is in the catalogue, but a cut leaves it out",
        )
    told = explain_star(model, targets, name, **asked)
    if as_json:
        print_json(told)
        return
    from cpic_planner.report import print_explanation

    print_explanation(told, console())


def _sensitivity(model: EtcModel, targets: Targets, asked: dict[str, Any], as_json: bool) -> None:
    """Print how the order depends on assumptions."""
    from cpic_planner.ranking.sensitivity import sensitivity

    found = sensitivity(model, targets, **asked)
    if as_json:
        print_json(found)
        return
    from cpic_planner.report import print_sensitivity

    print_sensitivity(found, console())


def _write(result: RankResult, out: Path | None, plot: Path | None, limit: int) -> None:
    """Write the table and the figure that were asked for."""
    if out is not None:
        from cpic_planner.report import ranking_csv, ranking_ecsv

        write_out(out, lambda: (ranking_csv if out.suffix == ".csv" else ranking_ecsv)(result), len(result.targets))
    if plot is not None:
        from cpic_planner.report import MOST_STARS, rank_figure

        shown = min(limit, len(result.targets))
        few = f" with the first {MOST_STARS} stars only: names of {shown} could not be read" * (shown > MOST_STARS)
        write_plot(plot, rank_figure(result, limit), few)
