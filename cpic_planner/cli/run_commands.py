"""The commands that write a folder: ``cpic plan``, ``confirm``, ``simulate``, ``whatif`` and ``tradeoff``."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cpic_planner import report
from cpic_planner.cli import command
from cpic_planner.cli.progress import is_verbose

if TYPE_CHECKING:
    from collections.abc import Mapping

    from cpic_planner import queries
    from cpic_planner.cli.output import ImagesOutput, RunOutput, SimulateOutput, TradeoffOutput
    from cpic_planner.tradeoff import FixedScene, Point


def plan(question: queries.PlanQuestion, output: ImagesOutput) -> None:
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
    ranking.csv, ranking.ecsv, measurements.csv and report.html into --out, and into its folder export astrometry.csv
    (as orbitize! reads it), astrometry.ecsv, limits.ecsv (what was not detected), photometry.ecsv with
    band_covariance.ecsv, passbands and contrast_curve.csv. Stopped half way, it continues when started again on the
    same folder, also with another --top; the result is the same for any number of workers.

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
    from cpic_planner.confirm import plan_job

    command.tell_overrides(question.simulator_overrides)
    job, out = plan_job(question, open_catalogue(question.catalog)), question.out

    def line(cost: Mapping[str, float]) -> str:
        what = f"{cost['n_tasks']} image sets ({cost['n_targets']} targets x bands)"
        return command.cost_line(what, cost, question.workers)

    steps = 0 if output.dry_run else _n_bands(question)
    how: dict[str, Any] = {"steps": steps, "out": out, "dry_run": output.dry_run}
    result = command.result_of(question, job, output, "confirming", line, **how)
    if result is not None:
        confirmed = any(band.detected for target in result.targets for band in target.bands)
        output.show(result, report.plan_blocks(result, full=is_verbose()), confirmed)
        command.tell_report(output, out)


def _n_bands(question: queries.PlanQuestion) -> int:
    """Return the largest number of pairs of star and band."""
    if question.schedule is None:
        return question.top * len(question.band_names())
    from cpic_planner.survey import read_schedule

    visits, _ = read_schedule(question.schedule, question.schedule_strategy)
    pairs = dict.fromkeys((visit.star, visit.setting.band) for visit in visits if not visit.reserve)
    first = list(dict.fromkeys(star for star, _ in pairs))[: question.top]
    return sum(star in first for star, _ in pairs)


def confirm(question: queries.ConfirmQuestion, output: ImagesOutput) -> None:
    """Observe one scene in simulated images and measure it blind, beside what the exposure-time calculator expects.

    SCENE is a preset or a YAML file, with any number of planets (none: the blind search alone) and other stars.
    Science and reference visits are simulated, --realisations times a band, the star is subtracted, and the dark
    hole is searched blind; forced photometry, positions, and a fit of metallicity and clouds follow. One more
    realisation a band has every effect of the camera: a stated part of its frames is run one by one, and what the
    effects change is carried to all of them (--no-audit leaves it out).

    Visits and frames are those of highest SNR within --time-s, as cpic etc --time-s chooses them, for the first planet
    of the scene that is in the dark hole; --visits, --visit-time-s, --exposure-s, --frames and --em-gain fix them. Part
    of the time that they leave unused is told. With --out it writes confirm.json, measurements.csv, report.html,
    panels-BAND.png and run.json, and into its folder export astrometry.csv (as orbitize! reads it), astrometry.ecsv,
    limits.ecsv (what was not detected), photometry.ecsv, band_covariance.ecsv, passband-BAND.txt, passbands.ecsv,
    spectrum-N.txt (as TauREx reads it) and contrast_curve.csv; stopped half way, it continues when started again on
    the same folder.

    With --from-products, frames are those of Level-1 files (cpic reduce writes them; so may any program: an image in
    electrons and a mask for each frame): registered by the light that the mask leaves, reduced, searched and measured
    in the same way. ROLE, VISIT and FILTER in the headers say which visit a file is of. Beside a scene, given or in the
    parameters next to the files, stands the prediction; without one the measurements are alone, and contrasts need a
    file of the star off the mask. --out has sources.csv and sources.ecsv too.

    Examples:

      cpic confirm paper_example

      cpic confirm my_scene.yaml --band F520 --band F662 --time-s 7200 --out my-scene

      cpic confirm paper_science --exposure-s 17 --frames 30 --em-gain 20 --band F520 --no-audit

      cpic confirm paper_example --realisations 40 --workers 2 --json > confirm.json

      cpic confirm paper_example --library roll --roll-deg 30 --dry-run

      cpic confirm paper_example --band F520 --tolerance 0.02

      cpic confirm paper_example --band F520 --realisations 2 --fidelity reference --dry-run

      cpic confirm --from-products level1 --out measured

      cpic confirm my_scene.yaml --from-products level1 --references "night_2/*"

      cpic simulate paper_science --band F662 --frames 20 --visits 4 --reference-scene paper_reference

      cpic simulate --list-presets
    """
    from cpic_planner.confirm import confirm_job

    command.tell_overrides(question.simulator_overrides)

    def line(cost: Mapping[str, float]) -> str:
        if cost["n_refused"]:
            command.note(
                f"{cost['n_refused']} of the measurements are impossible: without --dry-run the answer says why"
            )
        name = "the files" if question.scene is None else question.scene.name
        what = f"{cost['n_tasks']} band{'s' * (cost['n_tasks'] != 1)} of {name}"
        return command.cost_line(what, cost, question.workers)

    steps: int | str = "n_tasks" if question.from_products else len(question.band_names())
    how: dict[str, Any] = {"steps": steps, "piece": "band", "dry_run": output.dry_run}
    result = command.result_of(question, confirm_job(question), output, "confirming", line, out=question.out, **how)
    if result is None:
        return
    confirmed = any(band.detected for band in result.bands)
    output.show(result, report.confirm_blocks(result, full=is_verbose()), confirmed)
    command.tell_report(output, question.out)
    if output.plain and question.out is None:
        command.note("--out DIR writes a report with the images")


def simulate(question: queries.SimulateQuestion, output: SimulateOutput) -> None:
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
    visit_001_science, visit_001_reference and so on; programme.json lists them. With --programme it lists too, file by
    file, the calibrations that each is reduced with. Stopped half way, it continues when started again on the same
    folder; the files are the same for any number of workers.

    Examples:

      cpic simulate paper_example --band F520 --exposure-s 17 --em-gain 20

      cpic simulate my_scene.yaml --band F520,F662 --exposure-s 30,300

      cpic simulate paper_alpha_cen_b --frames 2 --workers 2 --out paper

      cpic simulate my_stars.csv --band F662 --frames 5 --dry-run

      cpic simulate --kind BIAS --frames 10

      cpic simulate paper_example --band F520 --off cosmic_rays --off smear

      cpic simulate paper_example --band F520 --frames 20 --tolerance 0.02 --dry-run

      cpic simulate paper_science --band F662 --frames 20 --visits 4 --reference-scene paper_reference

      cpic simulate paper_example --band F520 --exposure-s 17 --em-gain 20 --frames 30 --programme

      cpic simulate --list-presets
    """
    if output.list_presets:
        _print_presets(output.written == "json")
        return
    from cpic_planner import simulation

    made, notes = simulation.simulation_from(question.what, **question.given)
    if output.dry_run:
        planned = simulation.simulation_estimate(made, truth=question.truth, workers=question.workers)
        output.show(planned, report.planned_blocks(planned))
        return
    total = sum(entry.total_frames for entry in made.sequences)
    own = partial(simulation.simulate, truth=question.truth, notes=notes, cubes=question.cubes)
    start = partial(own, made, question.out, **question.how)
    done = command.with_progress("frames", total, start, "sequence")
    output.show(done.result, report.simulation_blocks(done.result, question.out))


def reduce(question: queries.ReduceQuestion, output: RunOutput) -> None:
    """Reduce Level-0 frames to Level 1: electrons of light with their error and a mask.

    WHAT are Level-0 files of any writer or folders of them. Bias, dark and flat frames that the folders hold, or that
    --masters names, are combined to masters whose noise is carried to the errors; of each kind those nearest in gain,
    exposure and band are taken. Maps without noise (flat.fits, dark.fits, cic.fits, bad_columns.fits, bias.fits) serve
    where there are no frames. Without either, the overscan gives the bias, the instrument the dark current, and the
    flat is 1: every product says what it was made with.

    Frames are flagged where a limit was reached, then come bias, level of the overscan, gain, curves, clock-induced
    charge, dark current, smear and flat; cosmic rays are found by comparing each pixel with itself in the other frames
    of its file, so that nothing is rejected in a single frame. Only frames of the visible camera are reduced.

    Writes one file a sequence, ..._L1_..., with a pair of units a frame (image, mask), the errors beside it in
    ..._ERROR.fits, Masters, reduction.json and run.json into --out. Stopped half way, it continues when started again
    on the same folder; the files are the same for any number of workers.

    Examples:

      cpic reduce level0

      cpic reduce night.fits --masters calibrations --out reduced

      cpic reduce level0 --masters bias.fits --masters dark.fits --masters flat.fits --workers 2

      cpic reduce level0 --dry-run
    """
    from cpic_planner.reduction import reduction_job

    def line(cost: Mapping[str, float]) -> str:
        what = f"{cost['n_sequences']} sequence{'s' * (cost['n_sequences'] != 1)}, {cost['n_frames']} frames"
        room = f"{cost['memory_mb']:.0f} MB memory a worker, {cost['disk_mb']:.1f} MB disk"
        return f"{what}, about {command.time_text(cost, question.workers)}, {room}"

    how: dict[str, Any] = {"steps": "n_steps", "dry_run": output.dry_run, "out": question.out}
    result = command.result_of(question, reduction_job(question), output, "reducing", line, **how)
    if result is not None:
        output.show(result, report.reduction_blocks(result, question.out))


def _print_presets(as_json: bool) -> None:
    from simulator.config import load_scene, load_simulation, preset_names

    simulations = {name: load_simulation(name).description for name in preset_names("simulation")}
    scenes = {name: load_scene(name).name for name in preset_names("scene")}
    if as_json:
        command.print_json({"simulations": simulations, "scenes": scenes})
        return
    width = max(map(len, (*simulations, *scenes)))
    for title, presets in (("Simulations", simulations), ("Scenes", scenes)):
        command.say(f"{title}:")
        for name, text in presets.items():
            command.say(f"  {name:{width}}  {text}")


def whatif(question: queries.WhatIfQuestion, output: RunOutput) -> None:
    """Compare survey strategies over the same synthetic universes: planets found, time used, and how sure that is.

    STRATEGIES is a preset (survey_default) or a YAML file. Every strategy gets a calendar from the visibility of
    its stars; then it is played in synthetic universes (--universes), each with its own planets, drift of calibration
    and luck, the same for all strategies, so that differences are known far better than yields. A sample of the
    detections is simulated as images and searched blind. Writes whatif.json, universes.parquet, detections.parquet,
    stars.parquet, orbits.parquet (how well positions determine the orbits of the planets found), targets.csv,
    visits.csv (.ecsv, .json: the calendars, one line a visit), run.json and report.html into --out.
    Stopped half way, it continues when started again on the same folder; the result is the same for any number of
    workers.

    New planets are those of the population that what is known of their star still allows (--exclusions: radial
    velocities, stability beside companion stars, known giants); what the same visits would find of the whole
    population stands beside. With --facts, as in the default strategies, every strategy is also planned and played
    without each of these facts, without what was published on known planets since 2019 and with companion stars where
    they were first listed, in the same universes, so that the report says which fact moved which number.

    With --doubt, every strategy is planned for each value of a number that nobody knows before launch, and every plan
    is played under each value with its visits and frames as they are, in the same universes: the report says which plan
    loses least at worst, which finds most by the weights of the values, and what it is worth to know the number. In a
    file, doubt: {key: drift, values: [0.05nm, 0.1nm], weights: [2, 1]} says the same; without weights those of the
    default ensemble count, if it has the number.

    Examples:

      cpic whatif survey_default

      cpic whatif survey_default --strategy few_and_deep --vary contrast=1e-8,3e-9,1e-9

      cpic whatif survey_default --strategy few_and_deep --vary drift=x0.5,x1,0.1nm

      cpic whatif my_strategies.yaml --universes 5000 --workers 2 --out my-survey

      cpic whatif survey_default --observed visits.csv --strategy few_and_deep

      cpic whatif survey_default --known-planets my_planets.csv

      cpic whatif survey_default --days 365 --share-of-time 0.05

      cpic whatif survey_default --no-facts --images 0

      cpic whatif survey_default --set drift.visit_nm=0.1nm --set throughput=x0.7

      cpic whatif survey_default --exclusions none

      cpic whatif survey_default --doubt drift=0.02nm,0.05nm,0.1nm,0.2nm --no-facts

      cpic whatif my_strategies.yaml --scheduler tcp://cluster:8786

      cpic whatif survey_default --vary max_visits=1,4,16 --images 0 --json > whatif.json

    A strategies file names only what differs from the preset:

    \b
      kind: strategies
      universe: {universes: 500}
      strategies:
        - {name: one_hour, visit: {time_s: 3600}, revisits: {max_visits: 10}}
        - {name: ten_hours, visit: {time_s: 36000}, revisits: {max_visits: 10}}

    --set changes the instrument for all strategies; in a file, universe: {changes: [throughput=x0.7]} says the same.
    --vary takes any key of a strategy (dotted) or a short name: contrast, drift, throughput, exozodi, budget_h,
    time_s, max_visits, max_targets, rule, library. A value is a number with a unit (time_s=1h), a factor with an x
    (budget_h=x0.5), a number alone where the key ends in its unit or the quantity has none, or a word. drift,
    throughput and exozodi always need a unit or an x: drift=0.1nm makes the offset of a visit 0.1 nm rms and scales
    the walk within the visit in the same ratio; drift=x2 doubles both; throughput=x0.7; exozodi=3zodi. --observed
    takes what was done so far: visits.csv (or .ecsv, .json) with start_utc and outcome (detected, not_detected or
    lost) filled in where a visit was made, and frames, roll_deg and telescope_h changed where they were other than
    planned. Lines without an outcome are planned anew. Of a table with outcomes of several strategies --strategy
    chooses one. Lines of one's own need star, start_utc, outcome, band, exposure_s, frames_per_visit and em_gain.
    """
    from cpic_planner import survey
    from cpic_planner.api import strategies_of
    from cpic_planner.targets import as_catalogue

    config = strategies_of(question)
    command.note(*(f"varied: {line}" for line in survey.variation_lines(config)))
    # Tables that cannot be used are refused before any work.
    survey.known_table(config.universe)
    as_catalogue(config.universe.catalog)

    def line(cost: Mapping[str, float]) -> str:
        return (
            f"{cost['n_strategies']} strategies, {cost['n_universes']} universes, {cost['n_blocks']} blocks, up to "
            f"{cost['n_images']} sets of images: about {command.time_text(cost, question.workers)}, "
            f"{cost['memory_mb']:.0f} MB memory, {cost['disk_mb']:.1f} MB disk"
        )

    job, out = survey.whatif_job(config, n_images=question.images), question.out or Path("cpic-whatif")
    how: dict[str, Any] = {"steps": "n_steps", "out": out, "dry_run": output.dry_run}
    result = command.result_of(question, job, output, "what if", line, **how)
    if result is not None:
        output.show(result, report.whatif_blocks(result, full=is_verbose()))
        if output.plain:
            command.say(f"visits: {out / 'visits.csv'}")
        command.tell_report(output, out)


def tradeoff(question: queries.TradeoffQuestion, output: TradeoffOutput) -> None:
    """Measure speed against accuracy on this machine: time, memory and error of every tier, tolerance and knob.

    Fixed scenes of a single visit are observed in every way there is: closed forms, sums of frames, frames, and the
    reference with one knob changed or one effect left out; programmes of several visits, with and without modes, in
    the ways that differ for them. Errors of the planet's flux and SNR are against the reference of the scene. Writes
    results.csv, results.json, report.md, pareto.png and run.json into --out. All scenes take long; stopped half
    way, it continues when started again on the same folder.

    Examples:

      cpic tradeoff --quick-look --scene faint

      cpic tradeoff --scene binary --scene edge

      cpic tradeoff --only standard --only quick

      cpic tradeoff --workers 2 --out tradeoff

      cpic tradeoff --list
    """
    from cpic_planner.jobs import run
    from cpic_planner.tradeoff import FILES, RESULT, chosen, n_rows, read_result, tradeoff_job

    work = chosen(question.scenes, question.only, quick_look=question.quick_look)
    if output.listed:
        _print_list(work, output.written == "json")
        return
    earlier = read_result(question.out) if question.only or question.scenes else None
    job = tradeoff_job(work, earlier=earlier, quick_look=question.quick_look, at_once=question.workers)
    result = command.with_progress("rows", n_rows(work), partial(run, job, question.out, force=question.force)).result
    command.note(f"{', '.join((RESULT, *FILES))} written to {question.out}")
    output.show(result, report.tradeoff_blocks(result))


def _print_list(work: Sequence[tuple[FixedScene, tuple[Point, ...]]], as_json: bool) -> None:
    if as_json:
        listing = {
            case.name: {"title": case.title, "why": case.why, "points": {item.name: item.title for item in points}}
            for case, points in work
        }
        command.print_json(listing)
        return
    for case, points in work:
        command.say(f"{case.name}: {case.title} ({case.why})")
        width = max(len(point.name) for point in points)
        for point in points:
            command.say(f"  {point.name:{width}}  {point.title}")
