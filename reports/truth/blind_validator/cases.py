"""Stars, bands and planets of the checks, and how blocks of realisations run side by side."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from cpic_planner.etc import EtcModel, build_model
from cpic_planner.jobs.job import run_tasks
from cpic_planner.queries import ReferencePlanet, SimulatorOverrides, Strategy
from cpic_planner.targets import find_target
from cpic_planner.validation import ConfirmTask, VisitPair, prepare_task, visit_pair
from simulator.config import load_instrument

TIME_S = 36000.0
FIVE_STARS = ("alf CMi", "alf Cen A", "alf Cen B", "eps Eri", "tau Cet")


@functools.cache
def nominal(visits: int | None = None) -> EtcModel:
    """The shipped instrument, which observes in so many visits, or in as many as are best."""
    return build_model(load_instrument(), None, Strategy(visits=visits))


def task_for(
    star: str,
    band: str,
    *,
    seed: int,
    visits: int | None = None,
    realisations: int = 1,
    audit: bool = False,
    companions: str = "on",
    overrides: Any = None,
) -> ConfirmTask:
    """The reference planet of a star where a band sees it best."""
    target, _ = find_target(star, companions="on" if companions == "on" else "off")
    task = prepare_task(
        nominal(visits),
        target,
        band,
        time_s=TIME_S,
        planet=ReferencePlanet(),
        seed=seed,
        fidelity="standard",
        realisations=realisations,
        audit=audit,
        overrides=SimulatorOverrides.of(overrides),
    )
    if not isinstance(task, ConfirmTask):
        raise RuntimeError(f"{star} {band}: {task.message}")
    return task


def without_planets(task: ConfirmTask) -> ConfirmTask:
    """The same frames of the star alone."""
    return replace(task, scene=task.scene | {"planets": []}, predictions=[], planets=[])


@functools.lru_cache(maxsize=2)
def star_alone(star: str, band: str, seed: int) -> VisitPair:
    """One visit and its reference without planets, kept for the blocks of one worker."""
    return visit_pair(without_planets(task_for(star, band, seed=seed, visits=1)))


def in_blocks(work: Callable[..., list[Any]], arguments: Sequence[tuple[Any, ...]], workers: int) -> list[Any]:
    """Rows of all blocks, in the order of the arguments."""
    found: dict[int, list[Any]] = dict(run_tasks(work, arguments, workers=workers))
    return [row for index in range(len(arguments)) for row in found[index]]
