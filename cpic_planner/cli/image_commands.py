"""The commands ``cpic plan``, ``cpic confirm`` and ``cpic simulate``."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer

from cpic_planner import report
from cpic_planner.cli import options
from cpic_planner.cli.options import Answer, DryRunOption, Output, note, print_cost, say, with_progress
from cpic_planner.cli.progress import is_verbose

if TYPE_CHECKING:
    from cpic_planner.queries import ConfirmQuestion, PlanQuestion, SimulateQuestion


def plan(question: PlanQuestion, output: Answer, dry_run: DryRunOption = False) -> None:
    """Rank the catalogue, confirm the best targets with simulated images, write the report.

    Each of the best targets is simulated in every band with the frames that the exposure-time calculator chooses,
    --realisations times, the star is subtracted, and the images are searched blind and measured. In the band that
    promises most one more realisation has every effect of the camera, a part of its frames run one by one. The report
    compares: confirmed or not, ETC optimistic or pessimistic by how much.

    Targets are the first stars of the ranking that are seen, in the year from --date on (--days), for as long as their
    observation takes; those that are left out for it are named. With --schedule they are the visits of a strategy:
    visits.csv as cpic whatif writes it, without the lines that have an outcome. The visits of a star and band are
    then one programme, in the frames that the schedule says, and every line without images is named with its reason.
    --stars, --sp-type, --distance-max-pc, --dec-min, --dec-max and --known-hosts choose some of the ranked stars: the
    plan proposes the first of these, and each keeps its rank in the whole ranking beside.

    Writes plan.json, sensitivity.json, known.json (known planets of the first stars, where there are any), run.json,
    ranking.csv, ranking.ecsv, measurements.csv and report.html into --out. Stopped half way, it continues when started
    again on the same folder; the result is the same for any number of workers.

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

      cpic plan --date 2028-06-01 --days 90 --top 10

      cpic plan --sp-type K --distance-max-pc 10 --top 3

      cpic plan --schedule cpic-whatif/visits.csv --strategy few_and_deep --top 3
    """
    from catalogs import open_catalogue
    from cpic_planner.confirm import make_plan, plan_job
    from cpic_planner.jobs import estimate

    options.tell_overrides(question.simulator_overrides)
    table = open_catalogue(question.catalog)
    if dry_run:
        cost = estimate(plan_job(question, table), workers=question.workers)
        what = f"{cost['n_tasks']} image sets ({cost['n_targets']} targets x bands)"
        print_cost(cost, what, question.workers, output.as_json)
        return
    start = partial(make_plan, question, question.out, catalog=table, **question.how)
    done = with_progress("confirming", _n_bands(question), start)
    confirmed = any(band.detected for target in done.result.targets for band in target.bands)
    output.show(done.result, partial(report.print_plan, done.result, full=is_verbose()), confirmed)
    if output.plain:
        say(f"report: {question.out / 'report.html'}")


def _n_bands(question: PlanQuestion) -> int:
    """Return the largest number of pairs of star and band."""
    if question.schedule is None:
        return question.top * len(question.band_names())
    from cpic_planner.survey import read_schedule

    visits, _ = read_schedule(question.schedule, question.schedule_strategy)
    pairs = dict.fromkeys((visit.star, visit.setting.band) for visit in visits if not visit.reserve)
    first = list(dict.fromkeys(star for star, _ in pairs))[: question.top]
    return sum(star in first for star, _ in pairs)


def confirm(question: ConfirmQuestion, output: Answer, dry_run: DryRunOption = False) -> None:
    """Observe one scene in simulated images and measure it blind, beside what the exposure-time calculator expects.

    SCENE is a preset or a YAML file, with any number of planets (none: the blind search alone) and other stars.
    Science and reference visits are simulated, --realisations times a band, the star is subtracted, and the dark
    hole is searched blind; forced photometry, positions, and a fit of metallicity and clouds follow. One more
    realisation a band has every effect of the camera: a stated part of its frames is run one by one, and what the
    effects change is carried to all of them (--no-audit leaves it out).

    Visits and frames are those of highest SNR within --time-s, as cpic etc --time-s chooses them, for the first planet
    of the scene that is in the dark hole; --visits, --visit-time-s, --exposure-s, --frames and --em-gain fix them. Part
    of the time that they leave unused is told. With --out it writes confirm.json, measurements.csv, report.html,
    panels-BAND.png and run.json; stopped half way, it continues when started again on the same folder.

    Examples:

      cpic confirm paper_example

      cpic confirm my_scene.yaml --band F520 --band F662 --time-s 7200 --out my-scene

      cpic confirm paper_science --exposure-s 17 --frames 30 --em-gain 20 --band F520 --no-audit

      cpic confirm paper_example --realisations 40 --workers 2 --json > confirm.json

      cpic confirm paper_example --library roll --roll-deg 30 --dry-run

      cpic confirm paper_example --band F520 --tolerance 0.02

      cpic confirm paper_example --band F520 --realisations 2 --fidelity reference --dry-run

      cpic simulate paper_science --band F662 --frames 20 --visits 4 --reference-scene paper_reference

      cpic simulate --list-presets
    """
    from cpic_planner.confirm import confirm_job, confirm_scene
    from cpic_planner.jobs import estimate

    options.tell_overrides(question.simulator_overrides)
    if dry_run:
        cost = estimate(confirm_job(question), workers=question.workers)
        what = f"{cost['n_tasks']} band{'s' * (cost['n_tasks'] != 1)} of {question.scene.name}"
        if cost["n_refused"]:
            note(f"{cost['n_refused']} of the measurements are impossible: without --dry-run the answer says why")
        print_cost(cost, what, question.workers, output.as_json)
        return
    start = partial(confirm_scene, question, question.out, **question.how)
    done = with_progress("confirming", len(question.band_names()), start, "band")
    confirmed = any(band.detected for band in done.result.bands)
    output.show(done.result, partial(report.print_confirm, done.result, full=is_verbose()), confirmed)
    if not output.plain:
        return
    if question.out is None:
        note("--out DIR writes a report with the images")
    else:
        say(f"report: {question.out / 'report.html'}")


def simulate(
    question: SimulateQuestion,
    output: Output,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show sequences, time, memory and disk, then stop.")
    ] = False,
    list_presets: Annotated[bool, typer.Option("--list-presets", help="Show the presets, then stop.")] = False,
) -> None:
    """Make Level-0 data with truth: scenes, whole simulations, every star of a table, or calibration frames.

    WHAT is a scene (preset or YAML file), a simulation (preset or YAML file: a list of sequences), or a table of
    stars (a file in any usual format; each row a scene); several may be given. Each combination of band, exposure and
    gain is one sequence of frames: one file, one number. Options that describe sequences are for scenes, tables and
    calibration kinds. A simulation has its own; --frames, --seed, --fidelity, --tolerance, --instrument, --off and
    --start-utc replace those.

    --fidelity sets the optics and leaves every effect in. --tolerance 0.02 leaves out effects, sources and nodes
    whose predicted sizes add up to at most 2 % of planet flux, of SNR and of any pixel (of the spread of one
    frame), and never takes finer optics than --fidelity; what it leaves out is printed (with --dry-run before
    anything is made), and stands in header, truth and simulation.json.

    Writes SCI, CAL, Truth and Params, simulation.json and run.json into --out. The visits of a programme (--visits,
    --reference-visits) begin where windows of the orbit open, and each has such a tree in a folder of its own,
    visit_001_science, visit_001_reference and so on; programme.json lists them. Stopped half way, it continues when
    started again on the same folder; the files are the same for any number of workers.

    Examples:

      cpic simulate paper_example --band F520 --exposure-s 17 --em-gain 20

      cpic simulate my_scene.yaml --band F520,F662 --exposure-s 30,300

      cpic simulate paper_alpha_cen_b --frames 2 --workers 2 --out paper

      cpic simulate my_stars.csv --band F662 --frames 5 --dry-run

      cpic simulate --kind BIAS --frames 10

      cpic simulate paper_example --band F520 --off cosmic_rays --off smear

      cpic simulate paper_example --band F520 --frames 20 --tolerance 0.02 --dry-run

      cpic simulate paper_science --band F662 --frames 20 --visits 4 --reference-scene paper_reference

      cpic simulate --list-presets
    """
    if list_presets:
        _print_presets(output.as_json)
        return
    from cpic_planner import simulation

    made, notes = simulation.simulation_from(question.what, **question.given)
    if dry_run:
        planned = simulation.simulation_estimate(made, truth=question.truth, workers=question.workers)
        output.show(planned, partial(report.print_planned, planned))
        return
    total = sum(entry.total_frames for entry in made.sequences)
    start = partial(simulation.simulate, made, question.out, truth=question.truth, notes=notes, **question.how)
    done = with_progress("frames", total, start, "sequence")
    output.show(done.result, partial(report.print_simulation, done.result, question.out))


def _print_presets(as_json: bool) -> None:
    from simulator.config import load_scene, load_simulation, preset_names

    simulations = {name: load_simulation(name).description for name in preset_names("simulation")}
    scenes = {name: load_scene(name).name for name in preset_names("scene")}
    if as_json:
        options.print_json({"simulations": simulations, "scenes": scenes})
        return
    width = max(map(len, (*simulations, *scenes)))
    for title, presets in (("Simulations", simulations), ("Scenes", scenes)):
        say(f"{title}:")
        for name, text in presets.items():
            say(f"  {name:{width}}  {text}")
