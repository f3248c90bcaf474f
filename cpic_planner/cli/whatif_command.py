"""``cpic whatif``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from catalogs.errors import InputError
from cpic_planner.cli.options import ForceOption, JsonOption, KnownPlanetsOption
from cpic_planner.cli.output import console, note, print_json, progress
from cpic_planner.jobs.engine import check_address

if TYPE_CHECKING:
    from cpic_planner.survey.strategy_file import StrategiesConfig

__all__ = ["HELP", "whatif"]

HELP = """Compare survey strategies over the same synthetic universes: planets found, time used, and how sure that is.

STRATEGIES is a preset (survey_default) or a YAML file. Every strategy gets a calendar from the visibility of its stars;
then it is played in made-up universes (--universes), each with its own planets, drift of calibration and luck, the same
for all strategies, so that differences are known far better than yields. A sample of the detections is simulated as
images and searched blind. Writes whatif.json, universes.parquet, detections.parquet, stars.parquet, targets.csv,
run.json and report.html into --out. Stopped half way, it continues when started again on the same folder; the result
is the same for any number of workers.

Examples:

  cpic whatif survey_default

  cpic whatif survey_default --strategy few_and_deep --vary contrast=1e-8,3e-9,1e-9

  cpic whatif survey_default --strategy few_and_deep --vary drift=x0.5,x1,0.1nm

  cpic whatif my_strategies.yaml --universes 5000 --workers 2 --out my-survey

  cpic whatif survey_default --observed log.csv --start 2030-01-01

  cpic whatif survey_default --known-planets my_planets.csv

  cpic whatif my_strategies.yaml --scheduler tcp://cluster:8786

  cpic whatif survey_default --vary max_visits=1,4,16 --images 0 --json > whatif.json

A strategies file names only what differs from the preset:

\b
  kind: strategies
  universe: {universes: 500}
  strategies:
    - {name: one_hour, visit: {time_s: 3600}, revisits: {max_visits: 10}}
    - {name: ten_hours, visit: {time_s: 36000}, revisits: {max_visits: 10}}

--vary takes any key of a strategy (dotted) or a short name: contrast, drift, throughput, exozodi, budget_h, time_s,
max_visits, max_targets, rule, library. A value is a number with a unit (time_s=1h), a factor with an x (budget_h=x0.5),
a number alone where the key ends in its unit or the quantity has none, or a word. drift, throughput and exozodi always
need a unit or an x: drift=0.1nm makes the offset of a visit 0.1 nm rms and scales the walk within the visit in the same
ratio; drift=x2 doubles both; throughput=x0.7; exozodi=3zodi. --observed takes a table of visits made so far, with the
columns star, start_utc, band, exposure_s, n_frames, em_gain, and telescope_h, roll_deg, planets if known: the rest is
planned."""


def whatif(
    strategies: Annotated[str, typer.Argument(help="Preset (survey_default) or YAML file.")],
    strategy: Annotated[
        list[str] | None, typer.Option("--strategy", help="Only this strategy of them; repeat for several.")
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            "--vary",
            help="KEY=VALUE,VALUE...: every strategy with each value, as drift=0.1nm,x3; repeat for several keys.",
        ),
    ] = None,
    universes: Annotated[
        int | None, typer.Option("--universes", min=2, help="Synthetic universes [default: 1000].")
    ] = None,
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="Seed of every random number.")] = None,
    start: Annotated[str | None, typer.Option("--start", help="Begin of the survey, UTC.")] = None,
    days: Annotated[float | None, typer.Option("--days", help="Length of the survey in days.")] = None,
    images: Annotated[
        int, typer.Option("--images", min=0, help="Detections of each strategy that are simulated as images.")
    ] = 6,
    observed: Annotated[
        str | None, typer.Option("--observed", help="Observation log (CSV): plan what is left of the survey.")
    ] = None,
    catalog: Annotated[
        str | None, typer.Option("--catalog", help="Star table: snapshot, latest, simbad_2012, or a file.")
    ] = None,
    instrument: Annotated[str | None, typer.Option("--instrument", help="Preset name or YAML file.")] = None,
    known_planets: KnownPlanetsOption = None,
    workers: Annotated[int, typer.Option("--workers", min=1, max=256, help="Local worker processes.")] = 2,
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", callback=check_address, help="Dask scheduler to use instead, tcp://host:port."),
    ] = None,
    out: Annotated[Path, typer.Option("--out", help="Output folder.")] = Path("cpic-whatif"),
    force: ForceOption = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would be done and how long it takes.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Compare and print."""
    from cpic_planner.survey.prepare import known_table
    from cpic_planner.survey.strategy_file import load_strategies, with_universe
    from cpic_planner.survey.sweeps import told, varied
    from cpic_planner.survey.whatif import run_whatif, whatif_cost

    config = _chosen(load_strategies(strategies), strategy)
    shared = {
        "universes": universes,
        "seed": seed,
        "start_utc": start,
        "duration_days": days,
        "observed": observed,
        "catalog": catalog,
        "instrument": instrument,
        "known_planets": known_planets,
    }
    config = with_universe(config, {key: value for key, value in shared.items() if value is not None})
    config = varied(config, vary) if vary else config
    for line in told(config):
        note(f"varied: {line}")
    table = known_table(config.universe)
    for remark in () if table is None else table.notes:
        note(remark)
    cost = whatif_cost(config, images).at(workers)
    if dry_run:
        _print_cost(cost, workers, as_json)
        return
    with progress("what if", total=int(cost["n_steps"])) as advance:
        done = run_whatif(
            config,
            out,
            workers=workers,
            scheduler=scheduler,
            force=force,
            n_images=images,
            advance=advance,
            command=sys.argv[1:],
        )
    if done.resumed_parts:
        note(f"reused {done.resumed_parts} finished pieces of an earlier run")
    if as_json:
        print_json(done.result)
        return
    from cpic_planner.report.console_whatif import print_whatif

    print_whatif(done.result, console())
    typer.echo(f"report: {out / 'report.html'}")


def _chosen(config: StrategiesConfig, names: list[str] | None) -> StrategiesConfig:
    """The strategies that are asked for, in the order of the file."""
    if not names:
        return config
    known = [item.name for item in config.strategies]
    for name in names:
        if name not in known:
            raise InputError("--strategy", name, allowed=", ".join(known))
    return config.model_copy(update={"strategies": tuple(item for item in config.strategies if item.name in names)})


def _print_cost(cost: dict[str, float], workers: int, as_json: bool) -> None:
    from simulator.files import dump_json

    line = (
        f"{cost['n_strategies']} strategies, {cost['n_universes']} universes, {cost['n_blocks']} blocks, up to "
        f"{cost['n_images']} sets of images: about {cost['wall_s']:.0f} s with {workers} worker(s), "
        f"{cost['memory_mb']:.0f} MB memory, {cost['disk_mb']:.1f} MB disk\n"
    )
    sys.stdout.write(dump_json(cost) if as_json else line)
