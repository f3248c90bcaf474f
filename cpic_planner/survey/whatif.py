"""``cpic whatif``: strategies compared over the same synthetic universes, a sample of detections checked in images."""

import functools
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from cpic_core import NDArray, Record, announce
from cpic_planner.jobs import Cost, Job, RunFolder, Runner, RunSettings, Task, run
from cpic_planner.queries import MAX_FRAMES
from cpic_planner.report import WHATIF_PRODUCTS, best_by_value, hanging_text, write_whatif
from cpic_planner.results import DoubtRecord, ImageSample, StrategyOutcome, WhatIfResult
from cpic_planner.survey.detection import rolled
from cpic_planner.survey.doubt import doubt_record, doubted, plays_of, told_steps
from cpic_planner.survey.outcome import (
    VISIT_FILES,
    Columns,
    Counts,
    counts_of,
    differences,
    facts_record,
    outcome,
    rank_changes,
    taken_back,
    visit_files,
)
from cpic_planner.survey.prepare import Ground, Prepared, imaged_model, planned, read_ground
from cpic_planner.survey.simulate import TOGETHER, Survey, block_tasks, simulate_survey, survey_counts
from cpic_planner.survey.strategy import FILES, StrategiesConfig, sources_of
from cpic_planner.survey.tables import TABLES, ResultStore, packed
from cpic_planner.survey.universe import BLOCK, NEW, albedos_of, chance
from cpic_planner.survey.visibility import utc_of
from cpic_planner.validation import ConfirmTask, Frames, confirm_task, expected_of, refusals_of, star_scene, task_of
from cpic_planner.version import __version__
from simulator.config import Planet, content_hash
from simulator.products import mjd_of
from simulator.target import sky_to_detector

REALISATIONS = 4
_LEVEL = 0.90


class SampledDetection(Record):
    """A detection that is imaged: its work, whether its place is known, and the probability that a visit shows it."""

    task: ConfirmTask
    known: bool
    probability: float


def sampled_detections(
    survey: Survey, detections: Mapping[str, NDArray[Any]], n: int, seed: int
) -> tuple[list[SampledDetection], str]:
    """Draw detections of a strategy, and make the scenes that their visits saw.

    Parameters
    ----------
    survey : Survey
    detections : mapping
        The strategy's rows of the table of detections.
    n : int
        Detections to draw, each equally likely; all if there are fewer.
    seed : int

    Returns
    -------
    sampled : list of SampledDetection
    note : str
        Why there are none, or fewer.

    Notes
    -----
    The scene is turned by the roll of the visit, so that the detector of the images stands at roll 0 as in all other
    confirmations. Images have the raw contrast that a strategy assumes if it is brighter than the instrument's own;
    optics that would be darker are not known.
    """
    strategy = survey.strategy
    if len(strategy.reduction.rolls_deg) > 1:
        return [], "images of two rolls are not sampled"
    if strategy.detection.rule == "expected":
        return [], "certain detections have no law that images could confirm"
    if (total := len(detections["universe"])) == 0:
        return [], "no detections"
    order = np.argsort(chance(seed, "images", strategy.name, shape=(total,)), kind="stable")
    sampled: list[SampledDetection] = []
    left_out = 0
    for row in order[:n]:
        task = _task(survey, {name: column[row] for name, column in detections.items()}, len(sampled), seed)
        if task is None:
            left_out += 1
            continue
        planet = int(detections["known_row"][row])
        known = planet != NEW and survey.known is not None and bool(survey.known.placed[planet])
        known = known or strategy.detection.rule == "known_place"
        sampled.append(SampledDetection(task, known, float(detections["chance"][row])))
    darker = left_out and strategy.assumptions.contrast is not None
    why = ": no optics are known that leave so little light" if darker else ""
    return sampled, f"{left_out} could not be imaged{why}" if left_out else ""


def _task(survey: Survey, row: Mapping[str, Any], number: int, seed: int) -> ConfirmTask | None:
    """Return the images of one detection; None where the images cannot be made."""
    i = int(np.flatnonzero(survey.targets.name == row["star"])[0])
    setting = survey.options[i][int(row["option"])]
    model = imaged_model(survey.model, survey.strategy, setting.band)
    if model is None or not 1 <= setting.n_frames <= MAX_FRAMES:
        return None
    if (zodis := float(row["exozodi_zodis"])) != model.instrument.sky.exozodi_zodis:
        model = replace(model, instrument=model.instrument.changed({"sky": {"exozodi_zodis": zodis}}))
    turned = rolled(survey.targets.select([i]), float(row["roll_deg"]))
    pa_deg = (float(row["pa_deg"]) - float(row["roll_deg"])) % 360.0
    drawn = {key: float(row[key]) for key in ("radius_rjup", "distance_au", "phase_deg", "separation_arcsec")}
    albedo = albedos_of(survey.strategy.population)[int(row["kind"])]
    planet = Planet(name="planet", pa_deg=pa_deg, albedo=albedo, **drawn)
    name = f"{row['star']} {number}"
    scene = star_scene(turned, (planet,), name=name, exozodi_zodis=zodis)
    place = sky_to_detector(drawn["separation_arcsec"], pa_deg, parity=model.instrument.detector.parity)
    frames = Frames(setting.exposure_s, int(setting.n_frames), setting.em_gain)
    expected = [expected_of(model, turned, setting.band, place, float(row["contrast"]), frames)]
    task = task_of(
        model,
        scene,
        setting.band,
        frames,
        expected,
        seed=seed,
        fidelity="standard",
        realisations=REALISATIONS,
        audit=False,
        overrides=None,
    )
    return None if refusals_of(task) else task


def image_task(task: Mapping[str, Any]) -> dict[str, Any]:
    """Simulate and measure one detection."""
    return {"confirmations": confirm_task(dict(task), counted=True)["confirmations"]}


def image_sample(
    sampled: Sequence[SampledDetection], bodies: Sequence[Mapping[str, Any]], note: str = ""
) -> ImageSample:
    """Compare what images show with what the law of the strategy expects.

    Parameters
    ----------
    sampled : sequence of SampledDetection
    bodies : sequence of mapping
        What `cpic_planner.validation.confirm.confirm_task` made of each.
    note : str

    Notes
    -----
    Images count as independent tries of their own probability. The interval of found over expected is that of a
    Poisson number of the same mean (Garwood 1936), which is wider than the binomial one.
    """
    images = found = 0
    expected = 0.0
    for item, body in zip(sampled, bodies, strict=True):
        for answer in body["confirmations"]:
            n = int(answer["realisations"] or 0)
            images += n
            expected += n * item.probability
            found += int((answer["n_significant"] if item.known else answer["n_detected"]) or 0)
    numbers = found, *_poisson_interval(found)
    correction, low, high = (number / expected if expected > 0 else None for number in numbers)
    made = {"detections": len(sampled), "images": images, "expected": expected, "found": found, "note": note}
    return ImageSample(**made, correction=correction, low=low, high=high)


def _poisson_interval(count: int) -> tuple[float, float]:
    from scipy.special import gammaincinv

    tail = 0.5 * (1.0 - _LEVEL)
    return float(gammaincinv(count, tail)) if count else 0.0, float(gammaincinv(count + 1, 1.0 - tail))


_START_S, _PLAN_S, _AGAIN_S, _OPTICS_S, _PLAY_S, _IMAGE_S = 8.0, 1.5, 0.3, 5.0, 0.00016, 0.6
RESULT_VERSION = 10
"""Raised when the same configuration gives other numbers, so that old folders are not resumed."""
NOT_MODELLED = (
    "planets of one star are independent of each other; beside known planets and companion stars they are left out "
    "where no orbit would last",
    "companions stay where they stand at the date of the positions, the survey's begin by default",
    "second looks, follow-up and visits for orbits are not searched for further planets of the star",
    "background stars are new ones in every visit: one that was told apart from a planet is not remembered",
    "chance of one visit is independent of that of another at the same place of the hole",
    "weather of space: no safe modes, no losses but those of the calendar",
)


def decided_by(config: StrategiesConfig, ground: Ground, n_images: int) -> dict[str, Any]:
    """Return what decides the result: configuration, stars, known planets, instrument; files by what is in them."""
    populations = [item.population for item in config.strategies]
    return {
        "config": config.model_dump(mode="json", exclude={"universe": {*FILES, "changes"}}),
        "populations": [None if population is None else population.content() for population in populations],
        "ground": ground.content(),
        "images": n_images,
    }


def whatif_cost(config: StrategiesConfig, n_images: int = 0) -> Cost:
    """Return the expected cost; times are those of one core, memory that of the preset."""
    n, universes = len(config.strategies), config.universe.universes
    times = 1 + len(taken_back(config))
    blocks = n * -(-universes // BLOCK)
    tasks = n * -(-universes // (BLOCK * TOGETHER))
    holes = [(item.assumptions.contrast, band) for item in config.strategies for band in item.visit.bands]
    assumed = {(contrast, band) for contrast, band in holes if contrast is not None}
    counts = {"n_strategies": n, "n_universes": universes, "n_blocks": blocks, "n_images": n * n_images}
    doubtful = 0 if config.doubt is None else len(config.doubt.values)
    plays = times * n + plays_of(config.doubt, n)
    steps = times * (n + blocks) + told_steps(config.doubt, n, blocks // n) + n * n_images
    ways = [len(item.visit.bands) * len(item.visit.time_s) for item in config.strategies]
    plans_s = [_PLAN_S * number * (1 + doubtful) + _AGAIN_S * (times - 1) for number in ways]
    return Cost(
        counts=counts | {"n_steps": steps},
        times_s=plans_s + [(_PLAY_S * plays * universes + _IMAGE_S * n * n_images) / tasks] * tasks,
        start_s=_START_S + _OPTICS_S * len(assumed),
        memory_mb=750.0,
        worker_mb=850.0,
        disk_mb=0.5 + 0.00035 * n * universes,
    )


def simulate_block(surveys: tuple[Survey, ...], which: int, block: range, n: int, seed: int) -> bytes:
    """Work on one task: rows of one strategy in some blocks of universes, packed where they are made."""
    survey = surveys[which]
    rows = simulate_survey(survey, block=block, n=n, seed=seed).rows(survey.strategy.name, block.start * BLOCK)
    return packed(TABLES, rows)


def whatif_job(config: StrategiesConfig, *, n_images: int = 0, pages: bool = True) -> Job[WhatIfResult]:
    """Return the job that compares strategies.

    Parameters
    ----------
    config : StrategiesConfig
    n_images : int
        Detections of each strategy that are confirmed at image level.
    pages : bool
        Whether to write the report for people; its figures take as long as a small survey.
    """
    if config.doubt is not None:
        doubted(config)  # what cannot be is refused before anything is made
    states = taken_back(config)

    @functools.cache
    def grounds() -> tuple[Ground, ...]:
        """Return what strategies are planned with: with all facts, then in every state without one."""
        now = read_ground(config)
        return (now, *(read_ground(state, now) for state in states.values()))

    def work(runner: Runner[Any]) -> WhatIfResult:
        ready, *others = planned((config, *states.values()), grounds(), runner)
        folder, store, universe = runner.folder, ResultStore(runner.folder, TABLES), config.universe
        tasks = [block_tasks(item.strategy.name, which, universe) for which, item in enumerate(ready.surveys)]
        blocks = runner.finish(simulate_block, itertools.chain(*tasks), common=(ready.surveys,), store=store)
        without = _without_facts(dict(zip(states, others, strict=True)), runner)
        store.merge(list(blocks))
        tables = {table.name: store.read(table.name) for table in TABLES}
        images = _images(ready, tables["detections"], runner, n_images)
        result = assemble(ready, tables, images, without, runner.digest, doubt_record(config, runner))
        about = {name: getattr(result, name) for name in ("version", "config_hash", "catalogue")}
        about |= {"fingerprint": folder.fingerprint, "date_utc": universe.date_utc or universe.start_utc}
        for name, text in visit_files(ready.surveys, about).items():
            folder.write(name, text)
        return result

    def write(folder: RunFolder, result: WhatIfResult, bodies: Mapping[str, Any]) -> None:
        if pages:
            announce("writing the report")
            write_whatif(folder, result)

    return Job(
        kind="whatif",
        results=RESULT_VERSION,
        decides=lambda: decided_by(config, grounds()[0], n_images),
        work=work,
        write=write,
        products=(*(table.file for table in TABLES), *VISIT_FILES, *(WHATIF_PRODUCTS if pages else ())),
        cost=lambda: whatif_cost(config, n_images),
    )


def run_whatif(
    config: StrategiesConfig, out: str | Path, *, n_images: int = 0, pages: bool = True, **how: Unpack[RunSettings]
) -> Runner[WhatIfResult]:
    """Compare strategies.

    Parameters
    ----------
    config, n_images, pages
        As of `whatif_job`.
    out : str or Path
        Output folder; resumed when it holds work of the same configuration.
    **how
        As of `cpic_planner.jobs.job.run`.

    Raises
    ------
    InputError
        For bad input, or if ``out`` is in use or holds another configuration.
    """
    return run(whatif_job(config, n_images=n_images, pages=pages), out, **how)


def _without_facts(states: Mapping[str, Prepared], runner: Runner[Any]) -> dict[str, list[Counts]]:
    """Return the planets found without each fact, by strategy: planned anew, played in the same universes."""
    if not states:
        return {}
    every = {
        f"without {fact}: {survey.strategy.name}": survey for fact, ready in states.items() for survey in ready.surveys
    }
    found = iter(survey_counts(every, next(iter(states.values())).config.universe, runner).values())
    return {fact: [counts_of(next(found)) for _ in ready.surveys] for fact, ready in states.items()}


def _images(prepared: Prepared, detections: Columns, runner: Runner[Any], n: int) -> list[ImageSample | None]:
    """Simulate and measure a sample of each strategy's detections; equal images are made once."""
    if n < 1:
        return [None] * len(prepared.surveys)
    seed = prepared.config.universe.seed
    own = [_rows(detections, survey.strategy.name) for survey in prepared.surveys]
    samples = [sampled_detections(survey, rows, n, seed) for survey, rows in zip(prepared.surveys, own, strict=True)]
    tasks = [[_image_task(item) for item in sampled] for sampled, _ in samples]
    bodies = runner.finish(image_task, itertools.chain(*tasks))
    return [
        image_sample(sampled, [bodies[task.key] for task in own], note)
        for (sampled, note), own in zip(samples, tasks, strict=True)
    ]


def _image_task(item: SampledDetection) -> Task:
    tree = item.task.to_dict()
    return Task(f"image {content_hash(tree)}", (tree,), f"{item.task.name} {item.task.band}")


def assemble(
    prepared: Prepared,
    tables: Mapping[str, Columns],
    images: Sequence[ImageSample | None],
    without: Mapping[str, Sequence[Counts]],
    digest: str,
    doubt: DoubtRecord | None = None,
) -> WhatIfResult:
    """Return the result from its tables."""
    config, ground, universe = prepared.config, prepared.ground, prepared.config.universe
    outcomes, universes = [], []
    for survey, sample in zip(prepared.surveys, images, strict=True):
        own = {name: _rows(columns, survey.strategy.name) for name, columns in tables.items()}
        universes.append(own["universes"])
        outcomes.append(outcome(survey, own, _first_visits(survey), sample))
    changed = differences([item.name for item in outcomes], universes)
    begins = mjd_of(universe.start_utc) + universe.slot_days * np.arange(universe.n_slots)
    return WhatIfResult.of(
        config,
        version=__version__,
        config_hash=digest,
        universe=_named(config),
        catalogue=ground.catalogue.provenance,
        known_planets="" if ground.known is None else ground.known.provenance,
        notes=[*ground.catalogue.notes, *(() if ground.known is None else ground.known.notes)],
        observed="" if ground.log is None else ground.log.provenance,
        n_universes=config.universe.universes,
        slot_utc=[text[:10] for text in utc_of(begins)],
        strategies=outcomes,
        differences=changed,
        rank_changes=rank_changes(outcomes),
        facts=facts_record(taken_back(config), outcomes, [counts_of(own) for own in universes], without)
        if config.universe.facts
        else None,
        doubt=doubt,
        statement=statement(outcomes),
        sources=sources_of(config),
        not_modelled=[*NOT_MODELLED, *unchecked(config)],
    )


def unchecked(config: StrategiesConfig) -> list[str]:
    """Return what is left out of strategies that look at no candidate again."""
    names = [item.name for item in config.strategies if not item.checks_candidates]
    which = "" if len(names) == len(config.strategies) else f" of {', '.join(names)}"
    return [f"false alarms{which} cost no telescope time (alarms.check)"] if names else []


def _named(config: StrategiesConfig) -> dict[str, Any]:
    """Return what strategies share, files by their names without folder."""
    tree = config.universe.model_dump(mode="json")
    return tree | {name: Path(tree[name]).name if "/" in tree[name] else tree[name] for name in FILES}


def _rows(columns: Columns, strategy: str) -> dict[str, NDArray[Any]]:
    """Return the rows of a strategy, which follow each other, without a copy."""
    mine = np.flatnonzero(columns["strategy"] == strategy)
    part = slice(mine[0], mine[-1] + 1) if mine.size else slice(0)
    return {name: values[part] for name, values in columns.items()}


def _first_visits(survey: Survey) -> list[str]:
    """Return the date of the first planned visit of each star."""
    days = np.full(len(survey.targets), np.nan)
    for visit in survey.schedule.visits:
        days[visit.star] = np.fmin(days[visit.star], survey.calendar.day[visit.star, visit.slot])
    texts = utc_of(survey.calendar.start_mjd + np.nan_to_num(days)) if len(days) else []
    return [text[:10] if np.isfinite(day) else "" for text, day in zip(texts, days, strict=True)]


def statement(outcomes: Sequence[StrategyOutcome]) -> str:
    """Return the outcome in a few words: who finds most, or of a sweep what is best at each value.

    It says so where more than 30 % of the yield hangs on one planet.
    """
    if all(item.varied for item in outcomes):
        return _sweep_statement(outcomes)
    best = max(outcomes, key=lambda item: item.planets.mean)
    quick = max(outcomes, key=lambda item: item.planets.mean / item.hours.mean if item.hours.mean > 0 else 0.0)
    if best.planets.mean <= 0.0:
        return "No strategy finds a planet in any universe."
    text = (
        f"{best.name} finds most planets, {best.planets.mean:.2f} a survey ({best.planets.low:.2f} to "
        f"{best.planets.high:.2f}, of them {best.new_planets.mean:.2f} new) in {best.hours.mean:.0f} h"
    )
    if quick.name == best.name:
        text += ", and most per hour."
    else:
        text += f"; {quick.name} finds most per hour, {quick.planets.mean:.2f} in {quick.hours.mean:.0f} h."
    one = hanging_text(best)
    return f"{text} {one[0].upper()}{one[1:]}." if one else text


def _sweep_statement(outcomes: Sequence[StrategyOutcome]) -> str:
    """Return the best strategy at each value of what is varied."""
    several = len({item.base for item in outcomes}) > 1
    parts = []
    for value, best in best_by_value(outcomes).items():
        name, one = f"{best.base} " if several else "", hanging_text(best)
        found = f"{best.planets.mean:.2f} planets, {best.new_planets.mean:.2f} new"
        parts.append(f"{value}: {name}{found}{f' ({one})' if one else ''}")
    return f"Most planets a survey by value. {'; '.join(parts)}."
