"""``cpic tradeoff``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from cpic_planner.cli.options import JsonOption
from cpic_planner.cli.output import console, note, print_json, progress

if TYPE_CHECKING:
    from cpic_planner.queries.tradeoff import TradeoffQuestion
    from cpic_planner.tradeoff.points import Point
    from cpic_planner.tradeoff.scenes import FixedScene

HELP = """Measure speed against accuracy on this machine: time, memory and error of every tier, tolerance and knob.

Seven fixed scenes are observed in every way there is: closed forms, sums of frames, frames, and the reference with one
knob changed or one effect left out. Errors of the planet's flux and SNR are against the reference of the scene. Writes
results.csv, results.json, report.md, pareto.png and run.json into --out. All scenes take half an hour on one core;
stopped half way, it continues when started again on the same folder.

Examples:

  cpic tradeoff --quick-look --scene faint

  cpic tradeoff --scene binary --scene edge

  cpic tradeoff --only standard --only quick

  cpic tradeoff --workers 2 --out tradeoff

  cpic tradeoff --list"""


def tradeoff(
    question: TradeoffQuestion,
    listed: Annotated[bool, typer.Option("--list", help="Say which scenes and ways there are, and stop.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Measure and write."""
    from cpic_planner.jobs.job import run
    from cpic_planner.tradeoff.run import chosen, n_rows, tradeoff_job
    from cpic_planner.tradeoff.write import FILES, RESULT, read_result

    work = chosen(question.scenes, question.only, quick_look=question.quick_look)
    if listed:
        _print_list(work, as_json)
        return
    earlier = read_result(question.out) if question.only or question.scenes else None
    job = tradeoff_job(work, earlier=earlier, quick_look=question.quick_look, at_once=question.workers)
    with progress("rows", total=n_rows(work)) as advance:
        result = run(job, question.out, force=question.force, advance=advance, command=sys.argv[1:]).result
    note(f"{', '.join((RESULT, *FILES))} written to {question.out}")
    if as_json:
        print_json(result)
        return
    from cpic_planner.report.console_tradeoff import print_tradeoff

    print_tradeoff(result, console())


def _print_list(work: Sequence[tuple[FixedScene, tuple[Point, ...]]], as_json: bool) -> None:
    from simulator.files import dump_json

    if as_json:
        listing = {
            case.name: {"title": case.title, "why": case.why, "points": {item.name: item.title for item in points}}
            for case, points in work
        }
        sys.stdout.write(dump_json(listing))
        return
    for case, points in work:
        typer.echo(f"{case.name}: {case.title} ({case.why})")
        width = max(len(point.name) for point in points)
        for point in points:
            typer.echo(f"  {point.name:{width}}  {point.title}")
