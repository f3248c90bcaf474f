"""``cpic plan``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from catalogs.errors import InputError
from cpic_planner.cli.image_options import DIAL_HELP, ImageOptions, renamed, takes_images
from cpic_planner.cli.options import (
    DEFAULT_TIME_S,
    AlbedoOption,
    CatalogOption,
    CloudsOption,
    CompanionsOption,
    DateOption,
    DwarfsOption,
    InsolationOption,
    KnownPlanetsOption,
    MetallicityOption,
    OnOff,
    PhaseFunctionOption,
    PhaseOption,
    PlanetsOption,
    PopulationOption,
    RadiusOption,
    ScoreOption,
    SinglesOption,
    TimeOption,
    VMaxOption,
    albedo_from,
    known_from,
    planet_from,
    population_from,
    refuse_date_alone,
)
from cpic_planner.cli.output import console, note, print_cost, print_json, progress
from cpic_planner.cli.override_option import OVERRIDES_HELP
from cpic_planner.cli.strategy_options import refuse_together
from cpic_planner.registry.scores import DEFAULT_SCORE

__all__ = ["HELP", "plan"]

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

_OPTIONS = {"tolerance": "--tolerance"}


@takes_images
def plan(
    top: Annotated[int, typer.Option("--top", min=1, max=1000, help="How many targets to confirm with images.")] = 5,
    time_s: TimeOption = DEFAULT_TIME_S,
    score: ScoreOption = DEFAULT_SCORE,
    dwarfs: DwarfsOption = False,
    singles: SinglesOption = False,
    v_mag_max: VMaxOption = None,
    catalog: CatalogOption = "snapshot",
    companions: CompanionsOption = OnOff.ON,
    population: PopulationOption = None,
    planets: PlanetsOption = None,
    known_planets: KnownPlanetsOption = None,
    date: DateOption = None,
    radius_rjup: RadiusOption = 1.0,
    phase_deg: PhaseOption = 90.0,
    albedo: AlbedoOption = None,
    log10_mh: MetallicityOption = None,
    log10_fsed: CloudsOption = None,
    insolation_au: InsolationOption = None,
    phase_function: PhaseFunctionOption = None,
    out: Annotated[Path, typer.Option("--out", help="Output folder.")] = Path("cpic-plan"),
    *,
    images: ImageOptions,
) -> None:
    """Plan and print."""
    from catalogs.catalogue import open_catalogue
    from cpic_planner.jobs.job import estimate
    from cpic_planner.plan import PlanConfig, make_plan, plan_job
    from simulator.config import load_instrument
    from simulator.config.base import validate

    refuse_together(
        {"--population": population, "--known-planets": known_planets}, "completeness refers to one of them"
    )
    refuse_date_alone(date, known_planets)
    chosen = population_from(population, planets, images.seed)
    instrument = load_instrument(images.instrument)
    tree = images.config_tree(instrument) | {
        "top": top,
        "time_s": time_s,
        "dwarfs_only": dwarfs,
        "singles_only": singles,
        "v_mag_max": v_mag_max,
        "companions": companions.value,
        "planet": planet_from(
            radius_rjup, phase_deg, albedo_from(albedo, log10_mh, log10_fsed, insolation_au, phase_function)
        ),
        "n_planets": chosen.n_planets,
        "score": score,
    }
    if known_planets is None:
        tree["population"] = chosen.config
    else:
        known = known_from(known_planets, date, planets, images.seed, tree["planet"].albedo, instrument)
        for remark in known.table.notes:
            note(remark)
        tree |= {"known_planets": known_planets, "date_utc": known.date_utc, "n_planets": known.n_draws}
    try:
        config = validate(PlanConfig, tree, where="plan")
    except InputError as error:
        raise renamed(error, "plan", _OPTIONS) from None
    table = open_catalogue(catalog)
    for remark in table.notes:
        note(remark)
    if images.dry_run:
        cost = estimate(plan_job(config, table), workers=images.workers)
        what = f"{cost['n_tasks']} image sets ({cost['n_targets']} targets x bands)"
        print_cost(cost, what, images.workers, images.as_json)
        return
    with progress("confirming", total=top * len(config.band_names())) as advance:
        done = make_plan(
            config,
            out,
            catalog=table,
            workers=images.workers,
            scheduler=images.scheduler,
            force=images.force,
            advance=advance,
            command=sys.argv[1:],
        )
    if done.resumed_parts:
        note(f"reused {done.resumed_parts} finished pieces of an earlier run")
    if images.as_json:
        print_json(done.result)
        return
    from cpic_planner.report.console import print_plan

    print_plan(done.result, console())
    typer.echo(f"report: {out / 'report.html'}")
