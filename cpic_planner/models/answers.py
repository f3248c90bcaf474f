"""Results of the exposure-time calculator."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, PrivateAttr

from cpic_planner.models.base import DetectionMode, LimitText, Result, Row, VerdictText
from cpic_planner.models.checked import AnswerFidelity, EtcFidelity
from cpic_planner.models.columns import column
from cpic_planner.models.ranked import ReferencePlanetRecord
from simulator.outcome import Reason, Status

Question = Literal["exposure_time", "signal_to_noise", "contrast_limit"]


class EtcAnswer(Row):
    """One answer of the exposure-time calculator for one target, band and planet.

    ``value`` (in ``unit``) is null unless ``status`` is ``ok``; the other numbers describe the chosen setting and are
    null where there is none. SNR by Eqs. 3 and 4 of Zhu et al. 2025 is that of `cpic_planner.etc.paper`, the
    probabilities are those of `cpic_planner.etc.detection`, ``limited_by`` is that of `cpic_planner.etc.limiting`.
    """

    target: str
    band: str
    question: Question
    value: float | None = column(label="answer")
    unit: str
    status: Status = column("ok: there is a number; verdict says whether the planet is detected")
    reason: Reason
    message: str
    separation_arcsec: float
    contrast: float | None
    exposure_s: float | None = None
    n_frames: int | None = None
    em_gain: float | None = None
    integration_s: float | None = None
    time_s: float | None = None
    snr: float | None = None
    significance: float | None = None
    threshold: float | None = None
    snr_paper: float | None = column("SNR by Eqs. 3 and 4 of Zhu et al. 2025, for comparison", default=None)
    level: float | None = column("SNR or significance that the answer reaches or refers to", default=None)
    core_throughput: float | None = None
    exposure_limited_by: str = ""
    gain_limited_by: str = ""
    gain_caps: dict[str, float] = column(default={})
    budget: dict[str, float] = column("signal in electrons and terms of its variance in electrons^2", default={})
    dominant: str = ""
    remedies: dict[str, float] = column(default={})
    flags: tuple[str, ...] = ()
    verdict: VerdictText | None = column(
        "of the planet: detected (half of the visits show it at its known place), measured_not_detected, unreachable "
        "(every status but ok); null for a contrast limit, which is about no planet, and in older results",
        default=None,
    )
    verdict_mode: DetectionMode | None = None
    detection_probability: float | None = None
    detection_probability_known_place: float | None = None
    limited_by: LimitText | None = None
    _fidelity: AnswerFidelity | None = PrivateAttr(default=None)

    @property
    def fidelity(self) -> AnswerFidelity | None:
        """Stated error and check in images, where a fidelity or a tolerance was asked for."""
        return self._fidelity

    def checked(self, fidelity: AnswerFidelity) -> EtcAnswer:
        """Return the same answer with its stated error and its check in images."""
        answer = self.model_copy()
        answer._fidelity = fidelity
        return answer

    def to_dict(self) -> dict[str, Any]:
        """Return a plain dict for JSON; ``fidelity`` is in it where it was asked for."""
        tree = self.model_dump(mode="json")
        return tree if self.fidelity is None else tree | {"fidelity": self.fidelity.model_dump(mode="json")}


class EtcResult(Result):
    """Answers of the exposure-time calculator for one target."""

    schema_version: Literal[1] = 1
    kind: Literal["etc"] = "etc"
    config_hash: str
    target: str
    hip: int | None
    v_mag: float
    distance_pc: float
    catalogue: str
    note: str
    reference_planet: ReferencePlanetRecord | None
    best_band: str | None
    answers: list[EtcAnswer]
    fidelity: EtcFidelity | None = Field(default=None, description="how firm the answers are; null in older results")
