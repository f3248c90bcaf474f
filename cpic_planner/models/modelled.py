"""What images contain and what they leave out, with the error that this is predicted to cost."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from cpic_planner.models.base import Result
from simulator.knobs import Knobs, Quantity


class EffectRecord(Result):
    """One row of the effect ledger."""

    key: str = Field(default="", description="code of the effect")
    effect: str
    decision: Literal["kept", "skipped"]
    reason: str
    size: float | None = Field(
        default=None,
        description="predicted relative size on the measured quantities, the largest of them; null: no bound",
    )


class ModellingRecord(Result):
    """How the images of one band were made."""

    fidelity: Literal["quick", "standard", "reference", "custom"] = Field(description="custom: by a tolerance")
    tolerance: dict[Quantity, float] = Field(description="largest relative error of each quantity that is asked for")
    predicted_error: dict[Quantity, float | None] = Field(
        description="relative error that knobs and skipped effects are predicted to cost, beside the reference; null: "
        "no bound"
    )
    draw: Literal["sums", "frames"] = Field(description="sums of frames over the dark hole, or every frame")
    region: Literal["hole", "full"] = Field(description="pixels that are simulated: around the hole, or whole frames")
    epochs: int = Field(description="epochs of a visit at which the walk of the wavefront is sampled")
    knobs: Knobs
    effects: list[EffectRecord] = Field(description="the effect ledger, in the order of the simulation")
