"""``cpic confirm``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from catalogs.errors import InputError
from cpic_planner.cli.image_options import DIAL_HELP, ImageOptions, renamed, takes_images
from cpic_planner.cli.options import OnOff
from cpic_planner.cli.output import console, note, print_cost, print_json, progress
from cpic_planner.cli.override_option import OVERRIDES_HELP
from cpic_planner.cli.strategy_options import refuse_together

if TYPE_CHECKING:
    from simulator.config import Scene

__all__ = ["HELP", "confirm"]

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

_OPTIONS = {
    "exposure_s": "--exposure-s",
    "n_frames": "--frames",
    "em_gain": "--em-gain",
    "time_s": "--time-s",
    "band": "--band",
    "bands": "--band",
    "realisations": "--realisations",
    "audit": "--audit",
    "tolerance": "--tolerance",
}


@takes_images
def confirm(
    scene: Annotated[str, typer.Argument(metavar="SCENE", help="Scene: a preset or a YAML file.")],
    time_s: Annotated[
        float | None,
        typer.Option(
            "--time-s", help="Wall time per band in s, readouts and reference frames included [default: 36000]."
        ),
    ] = None,
    exposure_s: Annotated[float | None, typer.Option("--exposure-s", help="Exposure of one frame in s.")] = None,
    frames: Annotated[int | None, typer.Option("--frames", help="Science frames; needs --exposure-s.")] = None,
    em_gain: Annotated[float | None, typer.Option("--em-gain", help="Actual EM gain [default: the best one].")] = None,
    companions: Annotated[
        OnOff | None,
        typer.Option("--companions", help="Put the scene's companions on the images [default: as it says]."),
    ] = None,
    audit: Annotated[
        bool | None,
        typer.Option(
            "--audit/--no-audit",
            help="Run one more realisation frame by frame, with every effect [default: with --fidelity standard].",
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Output folder [default: print only].")] = None,
    *,
    images: ImageOptions,
) -> None:
    """Confirm and print."""
    from cpic_planner.jobs.job import estimate
    from cpic_planner.scene_confirmation import ConfirmConfig, confirm_job, confirm_scene
    from simulator.config import load_instrument
    from simulator.config.base import validate

    refuse_together({"--time-s": time_s, "--frames": frames}, "the time sets the number of frames")
    if frames is not None and exposure_s is None:
        raise InputError("--frames", frames, allowed="together with --exposure-s")
    if exposure_s is not None and frames is None and time_s is None:
        raise InputError("--exposure-s", exposure_s, unit="s", allowed="together with --frames or --time-s")
    if images.force and out is None:
        raise InputError("--force", "given", allowed="together with --out")
    nominal = load_instrument(images.instrument)
    chosen = _scene(scene)
    tree = images.config_tree(nominal) | {
        "scene": chosen if companions is None else chosen.model_copy(update={"companions": companions.value}),
        "time_s": time_s,
        "exposure_s": exposure_s,
        "n_frames": frames,
        "em_gain": em_gain,
        "audit": audit,
    }
    try:
        config = validate(ConfirmConfig, tree, where="confirm")
    except InputError as error:
        raise renamed(error, "confirm", _OPTIONS) from None
    if images.dry_run:
        cost = estimate(confirm_job(config), workers=images.workers)
        what = f"{cost['n_tasks']} band{'s' * (cost['n_tasks'] != 1)} of {config.scene.name}"
        print_cost(cost, what, images.workers, images.as_json)
        return
    total = len(config.bands or nominal.visible_bands())
    with progress("confirming", total=total) as advance:
        done = confirm_scene(
            config,
            out,
            workers=images.workers,
            scheduler=images.scheduler,
            force=images.force,
            advance=advance,
            command=sys.argv[1:],
        )
    if done.resumed_parts:
        note(f"reused {done.resumed_parts} finished band{'s' * (done.resumed_parts != 1)} of an earlier run")
    if images.as_json:
        print_json(done.result)
        return
    from cpic_planner.report.console_confirm import print_confirm

    print_confirm(done.result, console())
    if out is None:
        note("--out DIR writes a report with the images")
    else:
        typer.echo(f"report: {out / 'report.html'}")


def _scene(source: str) -> Scene:
    """Scene of a preset or a file; says what to do with the name of a star."""
    from cpic_planner.targets import find_target
    from simulator.config import load_scene

    try:
        return load_scene(source)
    except InputError as error:
        if error.key != "scene" or Path(source).exists():
            raise
        try:
            find_target(source)
        except InputError:
            raise error from None
        raise InputError(
            error.key,
            source,
            allowed=error.allowed,
            hint="this is a star of the catalogue: write a scene with it as cstar, or see cpic plan",
        ) from None
