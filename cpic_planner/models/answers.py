"""Results of the exposure-time calculator."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from cpic_planner.models.base import (
    DETECTION_PROBABILITY,
    DETECTION_PROBABILITY_KNOWN_PLACE,
    LIMITED_BY,
    VERDICT_MODE,
    DetectionMode,
    LimitText,
    Result,
    StatusText,
    VerdictText,
)
from cpic_planner.models.checked import EtcFidelity
from cpic_planner.models.ranked import ReferencePlanetRecord

__all__ = ["EtcResult", "EtcRow"]


class EtcRow(Result):
    """One answer of the exposure-time calculator; see `cpic_planner.etc.questions.EtcAnswer`."""

    target: str
    band: str
    question: Literal["exposure_time", "signal_to_noise", "contrast_limit"]
    value: float | None
    unit: str
    status: StatusText = Field(description="ok: there is a number; verdict says whether the planet is detected")
    reason: str
    message: str
    separation_arcsec: float
    contrast: float | None
    exposure_s: float | None
    n_frames: int | None
    em_gain: float | None
    integration_s: float | None
    time_s: float | None
    snr: float | None
    significance: float | None
    threshold: float | None
    snr_paper: float | None = Field(description="SNR by Eqs. 3 and 4 of Zhu et al. 2025, for comparison")
    level: float | None = Field(description="SNR or significance that the answer reaches or refers to")
    core_throughput: float | None
    exposure_limited_by: str = Field(description="limit that binds the exposure; empty: the optimum")
    gain_limited_by: str = Field(description="limit that binds the EM gain; empty: the optimum")
    gain_caps: dict[str, float] = Field(description="largest EM gains by what they spare: hole, register_tail, frame")
    budget: dict[str, float] = Field(description="signal in electrons and terms of its variance in electrons^2")
    dominant: str = Field(description="largest term of the variance")
    remedies: dict[str, float] = Field(description="factors of SNR if one thing is changed")
    flags: list[str]
    verdict: VerdictText | None = Field(
        default=None,
        description="of the planet: detected (half of the visits show it at its known place), measured_not_detected, "
        "unreachable (every status but ok); null for a contrast limit, which is about no planet, and in older results",
    )
    verdict_mode: DetectionMode | None = VERDICT_MODE
    detection_probability: float | None = DETECTION_PROBABILITY
    detection_probability_known_place: float | None = DETECTION_PROBABILITY_KNOWN_PLACE
    limited_by: LimitText | None = LIMITED_BY


class EtcResult(Result):
    """Answers of the exposure-time calculator for one target."""

    schema_version: Literal[1] = 1
    kind: Literal["etc"] = "etc"
    config_hash: str
    target: str
    hip: int | None
    v_mag: float
    distance_pc: float
    catalogue: str = Field(description="what the star table is, its vintage or file name, and its checksum")
    note: str
    reference_planet: ReferencePlanetRecord | None
    best_band: str | None
    answers: list[EtcRow]
    fidelity: EtcFidelity | None = Field(default=None, description="how firm the answers are; null in older results")
