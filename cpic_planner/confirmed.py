"""Confirmation of whole targets: which images to make of a star, and what they say together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from catalogs.errors import InputError
from cpic_planner.engine import run_tasks
from cpic_planner.etc.model import EtcModel, Strategy
from cpic_planner.etc.planet import ReferencePlanet
from cpic_planner.models import BandConfirmation, ConfirmedTarget, RankedTarget
from cpic_planner.overrides import SimulatorOverrides
from cpic_planner.ranking import rank_targets
from cpic_planner.targets import Targets
from cpic_planner.validation.confirm import confirm_task
from cpic_planner.validation.task import ConfirmTask, prepare_task
from cpic_planner.validation.verdict import seen_at_place, target_verdict
from simulator.config import Instrument
from simulator.knobs import FIDELITIES

__all__ = [
    "REALISATIONS",
    "confirm_stars",
    "confirmed_target",
    "images_cost",
    "plan_tasks",
    "refuse_counting",
    "refuse_infrared",
]

REALISATIONS = 8
"""Draws of drift and noise of every target and band: an SNR of 10 from 12 apertures is then known to 9 %."""


def refuse_counting(strategy: Strategy) -> None:
    """Refuse photon counting, which is predicted but not measured in images."""
    if strategy.mode != "analogue":
        raise InputError("strategy.mode", strategy.mode, allowed="analogue",
                         hint="photon counting is predicted, not yet measured in images")  # fmt: skip


def refuse_infrared(instrument: Instrument, bands: Sequence[str] | None) -> None:
    """Refuse unknown bands, and those of the near-infrared camera, whose images are not measured."""
    visible = instrument.visible_bands()
    for band in bands or ():
        instrument.band(band)
        if band not in visible:
            raise InputError("band", band, allowed=", ".join(visible),
                             hint="images of the near-infrared camera are simulated, not yet measured")  # fmt: skip


def plan_tasks(
    model: EtcModel, stars: Sequence[Targets], rows: Sequence[RankedTarget], **settings: Any
) -> tuple[list[ConfirmTask], dict[tuple[str, str], BandConfirmation]]:
    """Work to do, and the bands that need none because the answer is already a refusal.

    The band of each target that promises most is audited: one more realisation frame by frame.
    """
    tasks: list[ConfirmTask] = []
    refused: dict[tuple[str, str], BandConfirmation] = {}
    for star, row in zip(stars, rows, strict=True):
        own = []
        for band in model.bands:
            ready = prepare_task(model, star, band, **settings)
            if isinstance(ready, BandConfirmation):
                refused[(row.name, band)] = ready
            else:
                own.append(ready)
        best = max(own, key=_margin, default=None)
        tasks.extend(replace(task, audit=task is best) for task in own)
    return tasks, refused


def _margin(task: ConfirmTask) -> float:
    expected = task.predictions[0]
    return float(expected["significance"] / expected["threshold"])


def images_cost(tasks: Sequence[ConfirmTask], fidelity: str, workers: int) -> dict[str, float]:
    """Expected wall time, memory and disk of simulating and measuring tasks, from the frames to simulate."""
    frames = sum(2 * task.n_frames for task in tasks if task.audit)
    pixels = FIDELITIES[fidelity].stamp_pixels ** 2
    draws = sum(task.realisations for task in tasks)
    work = 1.2 * len(tasks) + 0.2 * draws + 8e-3 * frames
    largest = max((task.n_frames for task in tasks if task.audit), default=0)
    return {
        "n_tasks": len(tasks),
        "n_realisations": draws,
        "n_frames": frames,
        "wall_s": 4.0 + work / min(workers, max(len(tasks), 1)),
        "memory_mb": 250.0 + 2 * largest * pixels * 8 * 3 / 1e6,
        "disk_mb": 1.0 + 0.35 * len(tasks),
    }


def confirm_stars(
    model: EtcModel,
    stars: Sequence[Targets],
    *,
    time_s: float,
    planet: ReferencePlanet,
    seed: int,
    fidelity: str,
    realisations: int = REALISATIONS,
    overrides: SimulatorOverrides | None = None,
    workers: int = 1,
) -> list[ConfirmedTarget]:
    """Confirm single stars without an output folder; see `cpic_planner.confirm_targets`."""
    refuse_counting(model.strategy)
    refuse_infrared(model.instrument, model.bands)
    rows = [rank_targets(model, star, time_s=time_s, planet=planet).targets[0] for star in stars]
    tasks, refused = plan_tasks(model, stars, rows, time_s=time_s, planet=planet, seed=seed, fidelity=fidelity,
                            realisations=realisations, overrides=overrides)  # fmt: skip
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
