"""One typed answer of the exposure-time calculator."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from cpic_planner.models import AnswerFidelity
from cpic_planner.models.base import DetectionMode, LimitText, VerdictText
from simulator.outcome import Reason, Status

__all__ = ["EtcAnswer", "Question"]

Question = Literal["exposure_time", "signal_to_noise", "contrast_limit"]


@dataclass(frozen=True)
class EtcAnswer:
    """One answer for one target, band and planet.

    ``value`` (in ``unit``) is ``None`` unless ``status`` is ``ok``; the other numbers describe the chosen setting
    and are ``None`` where there is none.

    Attributes
    ----------
    level : float or None
        What the answer reaches or refers to: the SNR asked for, or the significance of a detection.
    snr_paper : float or None
        SNR by Eqs. 3 and 4 of Zhu et al. 2025; see `cpic_planner.etc.paper`.
    exposure_limited_by, gain_limited_by : str
        The limit that binds exposure and gain; empty where the optimum lies inside.
    gain_caps : dict
        Largest EM gain of the chosen exposure that spares the hole, the register's tail into it, the whole frame.
    budget : dict
        Signal in electrons, and the terms of its variance in electrons^2.
    dominant : str
        The largest term.
    remedies : dict
        Factor by which the SNR grows if one thing is changed.
    verdict : str or None
        Of the planet: ``detected`` (half of the visits show it at its known place), ``measured_not_detected``, or
        ``unreachable`` (every status but ``ok``); None for a contrast limit, which is about no planet. ``status`` says
        only that there is a number.
    verdict_mode : str or None
        How the planet is looked for: ``known_place``.
    detection_probability, detection_probability_known_place : float or None
        By the law of simulated images, of a blind search and at the known place (`cpic_planner.etc.detection`); None
        where no law was measured or there is no answer.
    limited_by : str or None
        The single change that would make the planet detected in the time of the answer, or reach the level where there
        is no answer; see `cpic_planner.etc.budget`. None for a contrast limit.
    fidelity : AnswerFidelity or None
        Its stated error and its check in images, where a fidelity or a tolerance was asked for.
    """

    target: str
    band: str
    question: Question
    value: float | None
    unit: str
    status: Status
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
    snr_paper: float | None = None
    threshold: float | None = None
    level: float | None = None
    core_throughput: float | None = None
    exposure_limited_by: str = ""
    gain_limited_by: str = ""
    gain_caps: dict[str, float] = field(default_factory=dict)
    budget: dict[str, float] = field(default_factory=dict)
    dominant: str = ""
    remedies: dict[str, float] = field(default_factory=dict)
    flags: tuple[str, ...] = ()
    verdict: VerdictText | None = None
    verdict_mode: DetectionMode | None = None
    detection_probability: float | None = None
    detection_probability_known_place: float | None = None
    limited_by: LimitText | None = None
    fidelity: AnswerFidelity | None = None

    def to_dict(self) -> dict[str, Any]:
        """Plain dict for JSON; ``fidelity`` is in it where it was asked for."""
        tree = asdict(self) | {
            "status": str(self.status),
            "reason": str(self.reason),
            "flags": list(self.flags),
        }
        del tree["fidelity"]
        return tree if self.fidelity is None else tree | {"fidelity": self.fidelity.model_dump(mode="json")}
