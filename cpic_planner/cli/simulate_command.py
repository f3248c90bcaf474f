"""``cpic simulate``."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from cpic_planner.cli.options import JsonOption
from cpic_planner.cli.output import console, note, print_json, progress

if TYPE_CHECKING:
    from cpic_planner.queries.simulate import SimulateQuestion

HELP = """Make Level-0 data with truth: scenes, whole simulations, every star of a table, or calibration frames.

WHAT is a scene (preset or YAML file), a simulation (preset or YAML file: a list of sequences), or a table of stars
(CSV, ECSV, VOTable, FITS; each row a scene); several may be given. Each combination of band, exposure and gain is one
sequence of frames: one file, one number. Options that describe sequences are for scenes, tables and calibration kinds.
A simulation has its own; --frames, --seed, --fidelity, --tolerance, --instrument, --off and --start-utc replace those.

--fidelity sets the optics and leaves every effect in. --tolerance 0.02 leaves out effects, sources and nodes whose
predicted sizes add up to at most 2 % of planet flux, of SNR and of any pixel (of the spread of one frame), and never
takes finer optics than --fidelity; what it leaves out is printed (with --dry-run before anything is made), and stands
in header, truth and simulation.json.

Writes SCI, CAL, Truth and Params, simulation.json and run.json into --out. Stopped half way, it continues when started
again on the same folder; the files are the same for any number of workers.

Examples:

  cpic simulate paper_example --band F520 --exposure-s 17 --em-gain 20

  cpic simulate my_scene.yaml --band F520,F662 --exposure-s 30,300

  cpic simulate paper_alpha_cen_b --frames 2 --workers 2 --out paper

  cpic simulate my_stars.csv --band F662 --frames 5 --dry-run

  cpic simulate --kind BIAS --frames 10

  cpic simulate paper_example --band F520 --off cosmic_rays --off smear

  cpic simulate paper_example --band F520 --frames 20 --tolerance 0.02 --dry-run

  cpic simulate --list-presets"""


def simulate(
    question: SimulateQuestion,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show sequences, time, memory and disk, then stop.")
    ] = False,
    list_presets: Annotated[bool, typer.Option("--list-presets", help="Show the presets, then stop.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Simulate and print."""
    if list_presets:
        _print_presets(as_json)
        return
    from cpic_planner.simulation.inputs import simulation_from

    simulation, remarks = simulation_from(
        question.what, settings=question.settings, changes=question.changes, instrument=question.instrument
    )
    for remark in remarks:
        note(remark)
    if dry_run:
        from cpic_planner.simulation.cost import estimate

        plan = estimate(simulation, truth=question.truth, workers=question.workers)
        if as_json:
            print_json(plan)
        else:
            from cpic_planner.report.products import print_planned

            print_planned(plan, console())
        return
    from cpic_planner.simulation.run import simulate as run

    total = sum(len(list(entry.grid())) * entry.frames for entry in simulation.sequences)
    with progress("frames", total=total) as advance:
        done = run(
            simulation,
            question.out,
            workers=question.workers,
            scheduler=question.scheduler,
            force=question.force,
            truth=question.truth,
            advance=advance,
            command=sys.argv[1:],
        )
    if done.resumed_parts:
        note(f"kept {done.resumed_parts} finished sequences of an earlier run")
    if as_json:
        print_json(done.result)
        return
    from cpic_planner.report.products import print_simulation

    print_simulation(done.result, question.out, console())


def _print_presets(as_json: bool) -> None:
    from simulator.config.presets import preset_names
    from simulator.config.scene import load_scene
    from simulator.config.simulation_file import load_simulation

    simulations = {name: load_simulation(name).description for name in preset_names("simulation")}
    scenes = {name: load_scene(name).name for name in preset_names("scene")}
    if as_json:
        from simulator.files import dump_json

        sys.stdout.write(dump_json({"simulations": simulations, "scenes": scenes}))
        return
    width = max(map(len, (*simulations, *scenes)))
    for title, presets in (("Simulations", simulations), ("Scenes", scenes)):
        typer.echo(f"{title}:")
        for name, text in presets.items():
            typer.echo(f"  {name:{width}}  {text}")
