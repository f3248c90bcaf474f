"""The commands ``cpic whatif`` and ``cpic tradeoff``."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cpic_core import InputError
from cpic_planner import report
from cpic_planner.cli.options import Output, note, print_json, print_line_or_json, say, time_text, with_progress
from cpic_planner.cli.progress import is_verbose

if TYPE_CHECKING:
    from cpic_planner.queries import TradeoffQuestion, WhatIfQuestion
    from cpic_planner.survey import StrategiesConfig
    from cpic_planner.tradeoff import FixedScene, Point


def whatif(
    question: WhatIfQuestion,
    output: Output,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Say what would be done and how long it takes.")] = False,
) -> None:
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
    from cpic_planner.jobs import estimate
    from cpic_planner.targets import as_catalogue

    chosen = _chosen(survey.load_strategies(question.strategies), question.strategy)
    config = survey.with_universe(chosen, question.shared(), question.share_of_time)
    config = survey.varied(config, question.vary, facts=bool(question.facts)) if question.vary else config
    config = survey.with_exact_calendars(config) if question.exact else config
    config = survey.with_doubt(config, question.doubt)
    note(*(f"varied: {line}" for line in survey.variation_lines(config)))
    # Tables that cannot be used are refused before any work.
    survey.known_table(config.universe)
    as_catalogue(config.universe.catalog)
    cost = estimate(survey.whatif_job(config, n_images=question.images), workers=question.workers)
    if dry_run:
        line = (
            f"{cost['n_strategies']} strategies, {cost['n_universes']} universes, {cost['n_blocks']} blocks, up to "
            f"{cost['n_images']} sets of images: about {time_text(cost, question.workers)}, "
            f"{cost['memory_mb']:.0f} MB memory, {cost['disk_mb']:.1f} MB disk"
        )
        print_line_or_json(line, cost, output.as_json)
        return
    out = question.out or Path("cpic-whatif")
    start = partial(survey.run_whatif, config, out, n_images=question.images, **question.how)
    done = with_progress("what if", int(cost["n_steps"]), start)
    output.show(done.result, partial(report.print_whatif, done.result, full=is_verbose()))
    if output.plain:
        say(f"visits: {out / 'visits.csv'}", f"report: {out / 'report.html'}")


def _chosen(config: StrategiesConfig, names: tuple[str, ...]) -> StrategiesConfig:
    """Return the strategies that are asked for, in the order of the file."""
    if not names:
        return config
    known = [item.name for item in config.strategies]
    for name in names:
        if name not in known:
            raise InputError("strategy", name, allowed=", ".join(known))
    return config.model_copy(update={"strategies": tuple(item for item in config.strategies if item.name in names)})


def tradeoff(
    question: TradeoffQuestion,
    output: Output,
    listed: Annotated[bool, typer.Option("--list", help="Say which scenes and ways there are, and stop.")] = False,
) -> None:
    """Measure speed against accuracy on this machine: time, memory and error of every tier, tolerance and knob.

    Fixed scenes of a single visit are observed in every way there is: closed forms, sums of frames, frames, and the
    reference with one knob changed or one effect left out; programmes of several visits, with and without modes, in
    the ways that differ for them. Errors of the planet's flux and SNR are against the reference of the scene. Writes
    results.csv, results.json, report.md, pareto.png and run.json into --out. All scenes take 40 minutes on one core;
    stopped half way, it continues when started again on the same folder.

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
    if listed:
        _print_list(work, output.as_json)
        return
    earlier = read_result(question.out) if question.only or question.scenes else None
    job = tradeoff_job(work, earlier=earlier, quick_look=question.quick_look, at_once=question.workers)
    result = with_progress("rows", n_rows(work), partial(run, job, question.out, force=question.force)).result
    note(f"{', '.join((RESULT, *FILES))} written to {question.out}")
    output.show(result, partial(report.print_tradeoff, result))


def _print_list(work: Sequence[tuple[FixedScene, tuple[Point, ...]]], as_json: bool) -> None:
    if as_json:
        listing = {
            case.name: {"title": case.title, "why": case.why, "points": {item.name: item.title for item in points}}
            for case, points in work
        }
        print_json(listing)
        return
    for case, points in work:
        say(f"{case.name}: {case.title} ({case.why})")
        width = max(len(point.name) for point in points)
        for point in points:
            say(f"  {point.name:{width}}  {point.title}")
