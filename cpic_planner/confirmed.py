"""Confirmation of whole targets: which images to make of a star, and what they say together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from catalogs.errors import InputError
from cpic_planner.etc.model import EtcModel, Strategy
from cpic_planner.etc.planet import ReferencePlanet
from cpic_planner.jobs.job import Cost, Runner, Task
from cpic_planner.models import BandConfirmation, ConfirmedTarget, RankedTarget
from cpic_planner.overrides import SimulatorOverrides
from cpic_planner.ranking import rank_targets
from cpic_planner.targets import Targets
from cpic_planner.validation.calibration import calibrate
from cpic_planner.validation.confirm import confirm_task
from cpic_planner.validation.cost import task_cost
from cpic_planner.validation.task import ConfirmTask, images_of, prepare_task
from cpic_planner.validation.verdict import refusals_of, seen_at_place, target_verdict
from cpic_planner.version import __version__
from simulator.config import FrozenModel, Instrument
from simulator.knobs import Dial, dial_of
from simulator.ledger import not_modelled

REALISATIONS = 8
"""Draws of drift and noise of every target and band: an SNR of 10 from 12 apertures is then known to 9 %."""

RESULT_VERSION = 5
"""Raised when the same configuration gives other numbers, so that old folders are not resumed."""


class ImageConfig(FrozenModel):
    """What decides images that are measured; the part that a plan and a scene share.

    ``fidelity`` or ``tolerance`` set the dial of speed against accuracy, ``standard`` without any.
    ``simulator_overrides`` alter the images alone.
    """

    instrument: Instrument
    bands: tuple[str, ...] | None = None
    strategy: Strategy = Strategy()
    realisations: Annotated[int, Field(ge=1, le=100_000)] = REALISATIONS
    simulator_overrides: SimulatorOverrides = SimulatorOverrides()
    fidelity: Literal["quick", "standard", "reference"] | None = None
    tolerance: float | None = None
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 1

    @model_validator(mode="after")
    def _imaged(self) -> ImageConfig:
        refuse_counting(self.strategy)
        self.simulator_overrides.instrument(self.instrument)  # refuses unknown keys
        dial_of(self.fidelity, self.tolerance)
        return self

    @property
    def dial(self) -> Dial:
        """Speed against accuracy."""
        return dial_of(self.fidelity, self.tolerance)

    def hashed(self) -> dict[str, Any]:
        """Plain data of everything here; the dial by what it does, not by the name that it was given."""
        tree = self.model_dump(mode="json", exclude={"fidelity", "tolerance"})
        return tree | {"dial": self.dial.model_dump(mode="json")}

    @property
    def image_settings(self) -> dict[str, Any]:
        """Settings of `cpic_planner.validation.task.task_of`."""
        return {
            "seed": self.seed,
            "fidelity": self.fidelity,
            "tolerance": self.tolerance,
            "realisations": self.realisations,
            "overrides": self.simulator_overrides,
        }

    def told(self, digest: str, measured: Sequence[BandConfirmation]) -> dict[str, Any]:
        """Return what every result of images says of itself.

        Parameters
        ----------
        digest : str
            Hash of everything that decides the result.
        measured : sequence of BandConfirmation
            What the ratio of recovered and predicted SNR is taken over.
        """
        mean = calibrate(measured)
        return {
            "version": __version__,
            "config_hash": digest,
            "seed": self.seed,
            "fidelity": self.dial.fidelity,
            "tolerance": self.dial.tolerance,
            "instrument": self.instrument.name,
            "sigma": self.strategy.sigma,
            "reference_library": self.strategy.library,
            "rdi_modes": self.strategy.n_modes,
            "realisations": self.realisations,
            "simulator_overrides": self.simulator_overrides.as_mapping(),
            "calibration": {"ratio": mean.ratio, "error": mean.error, "n_bands": mean.n_bands},
            "calibration_text": mean.text,
            "not_modelled": not_modelled(images_of(self.instrument)),
        }


def audited(dial: Dial, asked: bool | None = None) -> bool:
    """Whether one more realisation runs frame by frame beside those that are drawn as sums.

    Parameters
    ----------
    dial : Dial
    asked : bool, optional
        What was asked for; ``standard`` has an audit and no other setting without.

    Raises
    ------
    InputError
        Where one is asked of the reference.
    """
    if asked and dial.fidelity == "reference":
        raise InputError(
            "audit",
            "given",
            allowed="quick, standard or a tolerance",
            hint="the reference runs every realisation frame by frame",
        )
    return dial.fidelity == "standard" if asked is None else asked


def refuse_counting(strategy: Strategy) -> None:
    """Refuse photon counting, which is predicted but not measured in images."""
    if strategy.mode != "analogue":
        raise InputError(
            "strategy.mode",
            strategy.mode,
            allowed="analogue",
            hint="photon counting is predicted, not yet measured in images",
        )


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
) -> tuple[list[ConfirmTask], dict[str, BandConfirmation]]:
    """Return work to do, and the bands that need none because the answer is already a refusal, by their keys.

    Where the dial has audits, the band of each target that promises most gets one: a realisation frame by frame.
    """
    tasks: list[ConfirmTask] = []
    refused: dict[str, BandConfirmation] = {}
    for star, row in zip(stars, rows, strict=True):
        own = []
        for band in model.bands:
            ready = prepare_task(model, star, band, **settings)
            answers = [ready] if isinstance(ready, BandConfirmation) else refusals_of(ready)
            if isinstance(ready, ConfirmTask) and not answers:
                own.append(ready)
            else:
                (refused[f"{row.name} {band}"],) = answers
        best = max(own, key=_margin, default=None)
        tasks.extend(replace(task, audit=task is best and audited(task.dial)) for task in own)
    return tasks, refused


def _margin(task: ConfirmTask) -> float:
    expected = task.predictions[0]
    return float(expected["significance"] / expected["threshold"])


def image_tasks(tasks: Sequence[ConfirmTask]) -> list[Task]:
    """Return tasks of `cpic_planner.validation.confirm.confirm_task`."""
    return [Task(task.key, (task.to_dict(),)) for task in tasks]


def images_cost(tasks: Sequence[ConfirmTask], **counts: float) -> Cost:
    """Return the expected cost of simulating and measuring tasks, see `cpic_planner.validation.cost`."""
    costs = [task_cost(task) for task in tasks]
    own = {
        "n_tasks": len(tasks),
        "n_realisations": sum(cost.realisations for cost in costs),
        "n_frames": sum(cost.frames for cost in costs),
    }
    return Cost(
        counts=counts | own,
        times_s=[cost.work_s for cost in costs],
        start_s=4.0,
        memory_mb=max((cost.memory_mb for cost in costs), default=0.0),
        disk_mb=1.0 + 0.35 * len(tasks),
    )


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
    bodies = Runner(workers=workers).finish(confirm_task, image_tasks(tasks))
    return [confirmed_target(model, row, refused, bodies) for row in rows]


def confirmed_target(
    model: EtcModel,
    row: RankedTarget,
    refused: Mapping[str, BandConfirmation],
    bodies: Mapping[str, Mapping[str, Any]],
) -> ConfirmedTarget:
    """Return one target's bands in order, and the best of them, from refusals and bodies by the keys of tasks."""
    keys = [f"{row.name} {band}" for band in model.bands]
    bands = [
        BandConfirmation.model_validate(bodies[key]["confirmations"][0]) if key in bodies else refused[key]
        for key in keys
    ]

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
