"""One typed answer of the exposure-time calculator."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from simulator.outcome import Reason, Status

__all__ = ["EtcAnswer", "Question"]

Question = Literal["exposure_time", "signal_to_noise", "contrast_limit"]


@dataclass(frozen=True)
class EtcAnswer:
    """One answer for one target, band and planet.

    ``value`` (in ``unit``) is ``None`` unless ``status`` is ``ok``; the other numbers describe the chosen setting
    and are ``None`` where there is none. ``budget`` holds the variance terms of the stack in electrons^2.
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
    threshold: float | None = None
    core_throughput: float | None = None
    budget: dict[str, float] = field(default_factory=dict)
    flags: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Plain dict for JSON."""
        return asdict(self) | {
            "status": str(self.status),
            "reason": str(self.reason),
            "flags": list(self.flags),
        }
