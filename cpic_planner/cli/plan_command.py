"""``cpic plan``."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import typer

from cpic_planner.cli.options import DIAL_HELP, OVERRIDES_HELP, DryRunOption, JsonOption, tell_overrides
from cpic_planner.cli.output import console, note, print_cost, print_json, progress

if TYPE_CHECKING:
    from cpic_planner.queries.plan import PlanQuestion

HELP = f"""The main job: rank the catalogue, confirm the best targets with simulated images, write the report.

Each of the best targets is simulated in every band with the frames that the exposure-time calculator chooses,
--realisations times, the star is subtracted, and the images are searched blind and measured. In the band that promises
most one more realisation runs frame by frame with every effect of the camera. The report compares: confirmed or not,
ETC optimistic or pessimistic by how much.

Writes plan.json, sensitivity.json, run.json, ranking.csv, ranking.ecsv, measurements.csv and report.html into --out.
Stopped half way, it continues when started again on the same folder; the result is the same for any number of workers.

Examples:

  cpic plan

  cpic plan --top 10 --workers 2 --out my-plan

  cpic plan --top 2 --band F520 --band F662 --time-s 7200 --json > plan.json

  cpic plan --top 20 --realisations 20 --dry-run

  cpic plan --top 20 --fidelity quick

  cpic plan --top 3 --tolerance 0.02

  cpic plan --score detection_margin --population solar_system --top 3

  cpic plan --catalog my_stars.ecsv --top 3

  cpic plan --known-planets snapshot --date 2027-06-01 --top 3

  cpic plan --library reference_star --reference-v-mag 3 --top 3

{DIAL_HELP}

{OVERRIDES_HELP}"""


def plan(question: PlanQuestion, dry_run: DryRunOption = False, as_json: JsonOption = False) -> None:
    """Plan and print."""
    from catalogs.catalogue import open_catalogue
    from cpic_planner.jobs.job import estimate
    from cpic_planner.known_completeness import KnownChoice, counted_planets
    from cpic_planner.plan import make_plan, plan_job

    tell_overrides(question.simulator_overrides)
    counted = counted_planets(question)
    table = open_catalogue(question.catalog)
    for remark in (*(counted.table.notes if isinstance(counted, KnownChoice) else ()), *table.notes):
        note(remark)
    if dry_run:
        cost = estimate(plan_job(question, table), workers=question.workers)
        what = f"{cost['n_tasks']} image sets ({cost['n_targets']} targets x bands)"
        print_cost(cost, what, question.workers, as_json)
        return
    with progress("confirming", total=question.top * len(question.band_names())) as advance:
        done = make_plan(
            question,
            question.out,
            catalog=table,
            workers=question.workers,
            scheduler=question.scheduler,
            force=question.force,
            advance=advance,
            command=sys.argv[1:],
        )
    if done.resumed_parts:
        note(f"reused {done.resumed_parts} finished pieces of an earlier run")
    if as_json:
        print_json(done.result)
        return
    from cpic_planner.report.console import print_plan

    print_plan(done.result, console())
    typer.echo(f"report: {question.out / 'report.html'}")
