"""Confirmation of whole targets: which images to make of a star, and what they say together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from catalogs.errors import InputError
from cpic_planner.engine import run_tasks
from cpic_planner.etc.model import EtcModel
from cpic_planner.etc.planet import ReferencePlanet
from cpic_planner.models import BandConfirmation, ConfirmedTarget, RankedTarget
from cpic_planner.queries.images import audited, refuse_counting
from cpic_planner.ranking import rank_targets
from cpic_planner.targets import Targets
from cpic_planner.validation.confirm import confirm_task
from cpic_planner.validation.cost import task_cost
from cpic_planner.validation.task import ConfirmTask, prepare_task
from cpic_planner.validation.verdict import refusals_of, seen_at_place, target_verdict
from simulator.config import Instrument

__all__ = [
    "RESULT_VERSION",
    "confirm_stars",
    "confirmed_target",
    "images_cost",
    "plan_tasks",
    "refuse_infrared",
]

RESULT_VERSION = 5
"""Raised when the same configuration gives other numbers, so that old folders are not resumed."""


def refuse_infrared(instrument: Instrument, bands: Sequence[str] | None) -> None:
    """Refuse unknown bands, and those of the near-infrared camera, whose images are not measured."""
    visible = instrument.visible_bands()
    for band in bands or ():
        instrument.band(band)
        if band not in visible:
            raise InputError(
                "band",
                band,
                allowed=", ".join(visible),
                hint="images of the near-infrared camera are simulated, not yet measured",
            )


def plan_tasks(
    model: EtcModel, stars: Sequence[Targets], rows: Sequence[RankedTarget], **settings: Any
) -> tuple[list[ConfirmTask], dict[tuple[str, str], BandConfirmation]]:
    """Work to do, and the bands that need none because the answer is already a refusal.

    Where the dial has audits, the band of each target that promises most gets one: a realisation frame by frame.
    """
    tasks: list[ConfirmTask] = []
    refused: dict[tuple[str, str], BandConfirmation] = {}
    for star, row in zip(stars, rows, strict=True):
        own = []
        for band in model.bands:
            ready = prepare_task(model, star, band, **settings)
            answers = [ready] if isinstance(ready, BandConfirmation) else refusals_of(ready)
            if isinstance(ready, ConfirmTask) and not answers:
                own.append(ready)
            else:
                (refused[(row.name, band)],) = answers
        best = max(own, key=_margin, default=None)
        tasks.extend(replace(task, audit=task is best and audited(task.dial)) for task in own)
    return tasks, refused


def _margin(task: ConfirmTask) -> float:
    expected = task.predictions[0]
    return float(expected["significance"] / expected["threshold"])


def images_cost(tasks: Sequence[ConfirmTask], workers: int) -> dict[str, float]:
    """Expected wall time, memory and disk of simulating and measuring tasks, see `cpic_planner.validation.cost`."""
    costs = [task_cost(task) for task in tasks]
    work = [cost.work_s for cost in costs]
    at_once = min(workers, max(len(tasks), 1))
    return {
        "n_tasks": len(tasks),
        "n_realisations": sum(cost.realisations for cost in costs),
        "n_frames": sum(cost.frames for cost in costs),
        "wall_s": 4.0 + max(sum(work) / at_once, max(work, default=0.0)),
        "memory_mb": max((cost.memory_mb for cost in costs), default=0.0),
        "disk_mb": 1.0 + 0.35 * len(tasks),
    }


def confirm_stars(
    model: EtcModel,
    stars: Sequence[Targets],
    *,
    time_s: float,
    planet: ReferencePlanet,
    workers: int = 1,
    **settings: Any,
) -> list[ConfirmedTarget]:
    """Confirm single stars without an output folder; see `cpic_planner.confirm_targets`.

    ``settings`` are those of `cpic_planner.validation.task.prepare_task`.
    """
    refuse_counting(model.strategy)
    refuse_infrared(model.instrument, model.bands)
    rows = [rank_targets(model, star, time_s=time_s, planet=planet).targets[0] for star in stars]
    tasks, refused = plan_tasks(model, stars, rows, time_s=time_s, planet=planet, **settings)
    done = run_tasks(confirm_task, [(task.to_dict(),) for task in tasks], workers=workers)
    bodies = {(tasks[i].name, tasks[i].band): body for i, body in done}
    return [confirmed_target(model, row, refused, bodies) for row in rows]


def confirmed_target(
    model: EtcModel,
    row: RankedTarget,
    refused: dict[tuple[str, str], BandConfirmation],
    bodies: dict[tuple[str, str], dict[str, Any]],
) -> ConfirmedTarget:
    """One target's bands in order, and the best of them."""
    bands = []
    for band in model.bands:
        body = bodies.get((row.name, band))
        bands.append(
            refused[(row.name, band)] if body is None else BandConfirmation.model_validate(body["confirmations"][0])
        )

    def margin(band: BandConfirmation) -> float:
        return (band.predicted_significance or 0.0) / (band.threshold or np.inf)

    # A few realisations rank bands by chance where they are close: the images veto, the prediction orders.
    blind = [band for band in bands if band.detected]
    best = max(blind or [band for band in bands if seen_at_place(band)], key=margin, default=None)
    verdict, factor, error = target_verdict(bands)
    return ConfirmedTarget(
        name=row.name,
        hip=row.hip,
        ranked=row,
        planet_distance_au=row.ref_planet_distance_au,
        chosen_band=best.band if best else None,
        verdict=verdict,
        etc_ratio=factor,
        etc_ratio_error=error,
        bands=bands,
    )
