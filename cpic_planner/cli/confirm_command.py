"""``cpic confirm``."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

import typer

from cpic_planner.cli.options import DIAL_HELP, OVERRIDES_HELP, DryRunOption, JsonOption, tell_overrides
from cpic_planner.cli.output import console, note, print_cost, print_json, progress

if TYPE_CHECKING:
    from cpic_planner.queries.confirm import ConfirmQuestion

HELP = f"""Observe one scene in simulated images and measure it blind, beside what the exposure-time calculator expects.

SCENE is a preset or a YAML file, with any number of planets (none: the blind search alone) and other stars. Science
and reference visits are simulated, --realisations times a band, the star is subtracted, and the dark hole is searched
blind; forced photometry, positions, and a fit of metallicity and clouds follow. One more realisation a band runs frame
by frame with every effect of the camera (--no-audit leaves it out).

Frames are the best ones for the first planet within --time-s, or those that --exposure-s and --frames give; a gain that
is not given is the best one. With --out it writes confirm.json, measurements.csv, report.html, panels-BAND.png and
run.json; stopped half way, it continues when started again on the same folder.

Examples:

  cpic confirm paper_example

  cpic confirm my_scene.yaml --band F520 --band F662 --time-s 7200 --out my-scene

  cpic confirm paper_science --exposure-s 17 --frames 30 --em-gain 20 --band F520 --no-audit

  cpic confirm paper_example --realisations 40 --workers 2 --json > confirm.json

  cpic confirm paper_example --library roll --roll-deg 30 --dry-run

  cpic confirm paper_example --band F520 --tolerance 0.02

  cpic confirm paper_example --band F520 --realisations 2 --fidelity reference --dry-run

  cpic simulate --list-presets

{DIAL_HELP}

{OVERRIDES_HELP}"""


def confirm(question: ConfirmQuestion, dry_run: DryRunOption = False, as_json: JsonOption = False) -> None:
    """Confirm and print."""
    from cpic_planner.jobs.job import estimate
    from cpic_planner.scene_confirmation import confirm_job, confirm_scene

    tell_overrides(question.simulator_overrides)
    if dry_run:
        cost = estimate(confirm_job(question), workers=question.workers)
        what = f"{cost['n_tasks']} band{'s' * (cost['n_tasks'] != 1)} of {question.scene.name}"
        print_cost(cost, what, question.workers, as_json)
        return
    with progress("confirming", total=len(question.band_names())) as advance:
        done = confirm_scene(
            question,
            question.out,
            workers=question.workers,
            scheduler=question.scheduler,
            force=question.force,
            advance=advance,
            command=sys.argv[1:],
        )
    if done.resumed_parts:
        note(f"reused {done.resumed_parts} finished band{'s' * (done.resumed_parts != 1)} of an earlier run")
    if as_json:
        print_json(done.result)
        return
    from cpic_planner.report.console_confirm import print_confirm

    print_confirm(done.result, console())
    if question.out is None:
        note("--out DIR writes a report with the images")
    else:
        typer.echo(f"report: {question.out / 'report.html'}")
