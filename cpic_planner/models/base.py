"""What all results share."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

__all__ = [
    "DETECTION_PROBABILITY",
    "DETECTION_PROBABILITY_KNOWN_PLACE",
    "LIMITED_BY",
    "VERDICT_MODE",
    "DetectionMode",
    "LimitText",
    "Result",
    "StatusText",
    "VerdictText",
]


StatusText = Literal["ok", "unreachable", "saturated", "outside_field", "invalid"]
VerdictText = Literal["detected", "measured_not_detected", "unreachable"]
DetectionMode = Literal["known_place"]
LimitText = Literal["geometry", "photons", "background", "speckles", "saturation", "none"]

VERDICT_MODE: Any = Field(
    default=None,
    description="how the planet is looked for: known_place, at a given place: detected where half of the visits show "
    "it there; null without a verdict",
)
DETECTION_PROBABILITY: Any = Field(
    default=None,
    description="probability that a blind search finds the planet, by the law of simulated images; null where no law "
    "was measured (near-infrared camera, photon counting) or there is no answer",
)
DETECTION_PROBABILITY_KNOWN_PLACE: Any = Field(
    default=None, description="the same for a look at the planet's known place, which the verdict is about"
)
LIMITED_BY: Any = Field(
    default=None,
    description="single change that would make the planet detected in the given time: speckles (no drift of the "
    "wavefront), background (no light and no noise but the planet's own and the speckles), photons (neither is enough: "
    "the planet is too faint); geometry: outside the dark hole; saturation: no frame is possible; none: detected; null "
    "where there is no verdict",
)


class Result(BaseModel):
    """Base of results: immutable, unknown keys refused, NaN and inf refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
