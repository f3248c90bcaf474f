"""The command ``cpic rank``."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cpic_core import InputError, dump_json
from cpic_planner import ranking, report
from cpic_planner.cli import options
from cpic_planner.cli.progress import is_verbose

if TYPE_CHECKING:
    from cpic_planner.queries import RankQuestion
    from cpic_planner.results import RankResult


def rank(
    question: RankQuestion,
    output: options.Answer,
    limit: Annotated[
        int | None,
        typer.Option(
            "--limit",
            min=1,
            help="Stars of every table, of --out too, and of the figure [default: 20, and all in --out]. JSON has all.",
        ),
    ] = None,
    explain: Annotated[
        str | None, typer.Option("--explain", help="Say why this star stands where it stands, instead of the table.")
    ] = None,
    sensitivity: Annotated[
        bool,
        typer.Option(
            "--sensitivity",
            help="Say how the order depends on assumptions, instead of the table; of one star with --explain.",
        ),
    ] = False,
    compare: Annotated[
        str | None,
        typer.Option(
            "--compare",
            metavar="OTHER",
            help="Say what moves from OTHER to this ranking and why, instead of the table: the file of an earlier "
            "ranking (of --out, or .json of --json), or an instrument (preset or YAML file) asked the same.",
        ),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", help="Draw the first --limit stars, at most 100, into FILE.png, .pdf or .svg as well."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help="Also write the rows to FILE.csv or .ecsv (every column, or those of --columns), .tex or .md (as on "
            "the screen), or everything to FILE.json.",
        ),
    ] = None,
) -> None:
    """Rank the whole catalogue (analytic, a few seconds; --sensitivity and --compare rank more than once).

    The ranking is by completeness per hour: which fraction of a population of planets one observation of the star
    detects, over its wall time. Planets do not count that radial velocities would have shown, that a companion star
    leaves no orbit, or that stand beside a known giant (--exclusions); the same fraction of all planets stands beside
    it. Stars that show none of it, with a score of zero, follow by detection margin.
    Planets are looked for by a search that does not know their place; what a look at known places would detect stands
    beside it (--search known_place counts that instead).
    An observation is made of as many visits as are best in the given time, each with an overhead and a wavefront of its
    own, reduced together; --visits and --visit-time-s fix them.
    --score chooses another order; the other columns are about a stated reference planet: whether it is detected, how
    likely a search finds it blind and at its place, and what limits it (limited_by: the single change that would make
    it detected in the given time; see cpic etc --help). In --json and --out: the visits, the time, the drift and the
    contrast that would detect it, each changed alone.

    --stars, --sp-type, --distance-max-pc, --dec-min, --dec-max and --known-hosts choose some of the ranked stars, those
    that pass all that are given: scores and seeds stay those of the whole ranking, and the rank in it stands beside the
    rank among the chosen (rank_in_catalogue).
    --compare says which stars move from another ranking to this one, by how much their scores change, and why.

    Under the table stands what its headings mean, and what is detected; with -v all that its numbers refer to.

    Examples:

      cpic rank

      cpic rank --score detection_margin --band F662 --time-s 7200 --dwarfs --singles --limit 50

      cpic rank --visits 4 --time-s 36000

      cpic rank --population solar_system --planets 1000 --plot ranking.png

      cpic rank --explain "tau Cet"

      cpic rank --explain "tau Cet" --sensitivity

      cpic rank --sensitivity

      cpic rank --instruments 200

      cpic rank --stars "tau Cet, eps Eri"

      cpic rank --sp-type G,K --distance-max-pc 30 --limit 30

      cpic rank --compare as_published

      cpic rank --exclusions none

      cpic rank --json | python -m json.tool | head -40

      cpic rank --out ranking.csv

      cpic rank --drift-nm 0.1 --compare ranking.csv

      cpic rank --catalog my_stars.csv

      cpic rank --known-planets snapshot --date 2030-06-01

    --catalog takes a table with the columns name, distance_pc or parallax_mas, v_mag, and sp_type or teff_k (or the
    usual other names of these); cpic catalog columns lists all that are read, and cpic catalog columns FILE says what
    those of a file are taken for. Its other columns come back in --json, --out and --format csv or ecsv, as they are
    there and under their own headings (own_ stands before one that a column of the ranking has): the first 40, and
    those that --columns names. Rows that cannot be used are left out with a remark; --rejects lists them, --strict
    refuses the table.

    --known-planets ranks the stars that have known planets by the probability that one observation at --date
    detects at least one of them, the errors of their orbits included; --planets is then the number of draws of each
    planet.
    """
    from cpic_planner.api import compared, prepared
    from cpic_planner.queries import called, called_as
    from cpic_planner.targets import find_target

    answers: dict[str, object] = {"--explain": explain, "--sensitivity": sensitivity, "--compare": compare}
    for name in ("--explain", "--sensitivity"):
        options.refuse_together({name: answers[name], "--compare": compare}, "two answers")
    for name, value in answers.items():
        options.refuse_together({name: value, "--out": out}, "it holds no ranking")
        options.refuse_together({name: value, "--plot": plot}, "it has no figure")
        known = None if name == "--compare" else question.known_planets
        options.refuse_together({name: value, "--known-planets": known}, "it is about a hypothetical population")
    if explain is not None and question.filters:
        hint = "its rank is that among all stars of the sample"
        raise InputError("--explain", explain, allowed=f"without {called(question.filters[0])}", hint=hint)
    options.check_file(out, tuple(options.FORM_OF_ENDING), "--out")
    shown = 20 if limit is None else limit
    options.check_plot(plot)
    if compare is not None:
        moved = compared(question, compare, key="--compare")
        output.show(moved, partial(report.print_moves, moved, limit=shown))
        return
    ready = prepared(question)
    if explain is not None:
        with called_as({"star": "--explain"}):
            star, remark = find_target(explain, catalog=ready.catalogue)
        options.note(*filter(None, [remark]))
        name = str(star.name[0])
        if name not in set(ready.stars.targets.name.tolist()):
            hint = "it is in the catalogue, but a cut leaves it out"
            raise InputError("--explain", explain, allowed="a star of the sample that is ranked", hint=hint)
        asked: dict[str, Any] = ready.asked | {"other_assumptions": sensitivity}
        reasons = ready.noted(ranking.explain_star(ready.model, ready.stars.targets, name, **asked))
        output.show(reasons, partial(report.print_explanation, reasons))
        return
    if sensitivity:
        from cpic_planner.ranking.sensitivity import sensitivity as sensitivity_of

        firm = ready.noted(sensitivity_of(ready.model, ready.stars.answered, **ready.asked))
        output.show(firm, partial(report.print_sensitivity, firm))
        return
    result = ready.ranked(output.columns)
    if out is not None:
        _write(out, result, output, limit)
    if plot is not None:
        drawn, most = min(shown, len(result.targets)), report.MOST_STARS
        few = f" with the first {most} stars only: names of {drawn} could not be read" * (drawn > most)
        draw = report.rank_figure if result.ensemble is None else report.ensemble_figure
        options.write_plot(plot, draw(result, shown), few)
    options.tell_rows(output, shown, len(result.targets))
    detected = any(row.verdict == "detected" for row in result.targets)
    output.show(result, partial(report.print_rank, result, limit=shown, full=is_verbose()), detected)


def _write(out: Path, result: RankResult, output: options.Answer, limit: int | None) -> None:
    """Write the ranking, or its first stars, in the form that the ending of the name asks for."""
    form, every = options.FORM_OF_ENDING[out.suffix], len(result.targets)
    rows = every if limit is None or form == "json" else min(limit, every)
    own = {"csv": report.ranking_csv, "ecsv": report.ranking_ecsv}.get(form)
    if form == "json":
        text = partial(dump_json, result.model_dump(mode="json"))
    elif own is not None and not output.columns:
        text = partial(own, result, rows)
    else:
        text = partial(output.text, form, result, partial(report.print_rank, result, limit=rows))
    options.write_out(out, text, rows, every)
