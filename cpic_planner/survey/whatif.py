"""``cpic whatif``: strategies compared over the same synthetic universes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cpic_planner.engine import run_tasks
from cpic_planner.environment import RunClock
from cpic_planner.models.surveyed import ImageSample, StrategyOutcome, WhatIfResult
from cpic_planner.report.whatif_words import best_by_value, hanging_text
from cpic_planner.report.write_whatif import PRODUCTS, write_whatif
from cpic_planner.runfolder import RunFolder, open_run_folder
from cpic_planner.survey.image_check import image_sample, image_task, sampled_detections
from cpic_planner.survey.outcome import differences, outcome, rank_changes
from cpic_planner.survey.play import Survey, play
from cpic_planner.survey.prepare import Prepared, prepare
from cpic_planner.survey.store import ResultStore, table_files
from cpic_planner.survey.strategy_file import FILES, StrategiesConfig, sources_of
from cpic_planner.survey.tables import TABLES, rows_of
from cpic_planner.survey.universe import BLOCK
from cpic_planner.survey.visibility import load_visibility
from cpic_planner.version import __version__
from simulator.config import content_hash
from simulator.files import dump_json
from simulator.work import announce

__all__ = ["BLOCK", "FinishedWhatIf", "cost_of", "run_whatif", "whatif_hash"]

_START_S, _PREPARE_S, _OPTICS_S, _PLAY_S, _IMAGE_S = 6.0, 1.8, 5.0, 0.0015, 2.2
RESULT_VERSION = 2
"""Raised when the same configuration gives other numbers, so that old folders are not resumed."""
NOT_MODELLED = (
    "planets of one star are independent of each other and of its known ones; no dynamical stability",
    "companions stand where the catalogue has them; proper motion and parallax do not tell background stars apart",
    "false alarms cost no follow-up time",
    "chance of one visit is independent of that of another at the same place of the hole",
    "weather of space: no safe modes, no losses but those of the calendar",
)


@dataclass(frozen=True)
class FinishedWhatIf:
    """The result, and how much of it was already there."""

    result: WhatIfResult
    resumed_parts: int
    computed_parts: int


def whatif_hash(prepared: Prepared, n_images: int) -> str:
    """Hash of everything that decides the result: configuration, stars, known planets, instrument."""
    config = prepared.config
    return content_hash(
        {
            "kind": "whatif",
            "results": RESULT_VERSION,
            "version": __version__,
            "config": config.model_dump(mode="json", exclude={"universe": set(FILES)}),
            "populations": [
                None if item.population is None else item.population.content() for item in config.strategies
            ],
            "models": [survey.model.content() for survey in prepared.surveys],
            "stars": prepared.stars.content(),
            "catalogue": prepared.catalogue.provenance,
            "known": "" if prepared.known is None else prepared.known.provenance,
            "observed": "" if prepared.log is None else prepared.log.provenance,
            "visibility": load_visibility(config.universe.visibility).content(),
            "images": n_images,
        }
    )


def cost_of(config: StrategiesConfig, *, workers: int = 1, n_images: int = 0) -> dict[str, float]:
    """Expected wall time, memory and disk; times are those of ``reports/whatif`` on one core, nothing in the cache."""
    n, universes = len(config.strategies), config.universe.universes
    blocks = -(-universes // BLOCK)
    bands = sum(len(item.visit.bands) * len(item.visit.time_s) for item in config.strategies)
    assumed = {
        (item.assumptions.contrast, band)
        for item in config.strategies
        for band in item.visit.bands
        if item.assumptions.contrast is not None
    }
    play_s, image_s = _PLAY_S * n * universes, _IMAGE_S * n * n_images
    return {
        "n_strategies": n,
        "n_universes": universes,
        "n_blocks": n * blocks,
        "n_images": n * n_images,
        "n_steps": 1 + 2 * n + n * blocks + n * n_images,
        "wall_s": _START_S
        + _PREPARE_S * bands
        + _OPTICS_S * len(assumed)
        + (play_s + image_s) / min(workers, n * blocks),
        "memory_mb": 400.0 + 120.0 * workers,
        "disk_mb": 0.5 + 0.00035 * n * universes,
    }


def play_block(surveys: tuple[Survey, ...], which: int, block: int, n: int, seed: int) -> dict[str, Mapping[str, Any]]:
    """One task: rows of one strategy in one block of universes."""
    survey = surveys[which]
    return rows_of(play(survey, block=block, n=n, seed=seed), survey.strategy.name, block * BLOCK)


def run_whatif(
    config: StrategiesConfig,
    out: str | Path,
    *,
    workers: int = 1,
    scheduler: str | None = None,
    force: bool = False,
    n_images: int = 0,
    pages: bool = True,
    advance: Callable[[str], None] = lambda text: None,
    command: list[str] | None = None,
) -> FinishedWhatIf:
    """Compare strategies.

    Parameters
    ----------
    config : StrategiesConfig
    out : str or Path
        Output folder; resumed when it holds work of the same configuration.
    workers, scheduler, force, advance, command
        As of `cpic_planner.plan.make_plan`.
    n_images : int
        Detections of each strategy that are confirmed at image level.
    pages : bool
        Whether to write the report for people; its figures take as long as a small survey.

    Raises
    ------
    InputError
        For bad input, or if ``out`` is in use or holds another configuration.
    """
    clock = RunClock()
    prepared = prepare(config, advance=advance)
    digest = whatif_hash(prepared, n_images)
    products = (*table_files(TABLES), "whatif.json", "run.json", *(PRODUCTS if pages else ()))
    with open_run_folder(out, kind="whatif", config_hash=digest, products=products, force=force) as folder:
        store = ResultStore(folder, TABLES)
        keys, resumed = _play_all(prepared, store, workers, scheduler, advance)
        store.merge(keys)
        tables = {table.name: store.read(table.name) for table in TABLES}
        images = _images(prepared, tables["detections"], folder, n_images, (workers, scheduler), advance)
        result = assemble(prepared, tables, images, digest)
        folder.write("whatif.json", dump_json(result.model_dump(mode="json")))
        if pages:
            announce("writing the report")
            write_whatif(folder, result)
        record = clock.record(
            command=command,
            config_hash=digest,
            workers=workers,
            scheduler=scheduler,
            resumed_parts=resumed,
            computed_parts=len(keys) - resumed,
        )
        folder.write("run.json", dump_json(record.model_dump(mode="json")))
    return FinishedWhatIf(result, resumed, len(keys) - resumed)


def _play_all(
    prepared: Prepared, store: ResultStore, workers: int, scheduler: str | None, advance: Callable[[str], None]
) -> tuple[list[str], int]:
    """Play what is not there yet; every block is on disk before the next is counted."""
    universe, done = prepared.config.universe, store.finished()
    work = []
    for which, survey in enumerate(prepared.surveys):
        for block, first in enumerate(range(0, universe.universes, BLOCK)):
            n = min(BLOCK, universe.universes - first)
            work.append((f"{survey.strategy.name} {block:06d}", (which, block, n, universe.seed)))
    waiting = [(key, arguments) for key, arguments in work if key not in done]
    for key, _ in work:
        if key in done:
            advance(f"{key} (kept)")
    tasks = run_tasks(
        play_block,
        [arguments for _, arguments in waiting],
        common=(prepared.surveys,),
        workers=workers,
        scheduler=scheduler,
    )
    for position, rows in tasks:
        store.save(waiting[position][0], rows)
        advance(waiting[position][0])
    return [key for key, _ in work], len(work) - len(waiting)


def _images(
    prepared: Prepared,
    detections: Mapping[str, NDArray[Any]],
    folder: RunFolder,
    n: int,
    cluster: tuple[int, str | None],
    advance: Callable[[str], None],
) -> list[ImageSample | None]:
    """Simulate and measure a sample of each strategy's detections; equal images are made once."""
    if n < 1:
        return [None] * len(prepared.surveys)
    samples = [
        sampled_detections(survey, _rows(detections, survey.strategy.name), n, prepared.config.universe.seed)
        for survey in prepared.surveys
    ]
    tasks = {f"image {content_hash(item.task.to_dict())}": item.task for sampled, _ in samples for item in sampled}
    bodies = {key: folder.part(key) for key in tasks}
    waiting = [key for key, body in bodies.items() if body is None]
    for key, body in bodies.items():
        if body is not None:
            advance(f"{tasks[key].name} {tasks[key].band} (kept)")
    done = run_tasks(image_task, [(tasks[key].to_dict(),) for key in waiting], workers=cluster[0], scheduler=cluster[1])
    for position, body in done:
        key = waiting[position]
        bodies[key] = folder.save_part(key, {"confirmations": body["confirmations"]})
        advance(f"{tasks[key].name} {tasks[key].band}")
    found: list[ImageSample | None] = []
    for sampled, note in samples:
        own = [bodies[f"image {content_hash(item.task.to_dict())}"] for item in sampled]
        found.append(image_sample(sampled, [body for body in own if body is not None], note))
    return found


def assemble(
    prepared: Prepared,
    tables: Mapping[str, Mapping[str, NDArray[Any]]],
    images: Sequence[ImageSample | None],
    digest: str,
) -> WhatIfResult:
    """The result from its tables."""
    from cpic_planner.survey.visibility.calendar import utc_of

    config, calendar = prepared.config, prepared.calendar
    outcomes, universes = [], []
    for survey, sample in zip(prepared.surveys, images, strict=True):
        own = {name: _rows(columns, survey.strategy.name) for name, columns in tables.items()}
        universes.append(own["universes"])
        outcomes.append(outcome(survey, own, _first_visits(survey), sample))
    changed = differences([item.name for item in outcomes], universes)
    begins = calendar.start_mjd + config.universe.slot_days * np.arange(calendar.n_slots)
    return WhatIfResult(
        version=__version__,
        config_hash=digest,
        name=config.name,
        description=config.description,
        universe=_named(config),
        catalogue=prepared.catalogue.provenance,
        known_planets="" if prepared.known is None else prepared.known.provenance,
        observed="" if prepared.log is None else prepared.log.provenance,
        n_universes=config.universe.universes,
        slot_utc=[text[:10] for text in utc_of(begins)],
        strategies=outcomes,
        differences=changed,
        rank_changes=rank_changes(outcomes),
        statement=statement(outcomes),
        sources=sources_of(config),
        not_modelled=list(NOT_MODELLED),
    )


def _named(config: StrategiesConfig) -> dict[str, Any]:
    """What strategies share, files by their names without folder."""
    tree = config.universe.model_dump(mode="json")
    return tree | {name: Path(tree[name]).name if "/" in tree[name] else tree[name] for name in FILES}


def _rows(columns: Mapping[str, NDArray[Any]], strategy: str) -> dict[str, NDArray[Any]]:
    mine = columns["strategy"] == strategy
    return {name: values[mine] for name, values in columns.items()}


def _first_visits(survey: Survey) -> list[str]:
    """Date of the first planned visit of each star."""
    from cpic_planner.survey.visibility.calendar import utc_of

    days = np.full(len(survey.targets), np.nan)
    for visit in survey.schedule.visits:
        day = survey.calendar.day[visit.star, visit.slot]
        days[visit.star] = np.fmin(days[visit.star], day)
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
    """The best strategy at each value of what is varied."""
    several = len({item.base for item in outcomes}) > 1
    parts = []
    for value, best in best_by_value(outcomes).items():
        name, one = f"{best.base} " if several else "", hanging_text(best)
        found = f"{best.planets.mean:.2f} planets, {best.new_planets.mean:.2f} new"
        parts.append(f"{value}: {name}{found}{f' ({one})' if one else ''}")
    return f"Most planets a survey by value. {'; '.join(parts)}."
