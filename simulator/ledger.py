"""What an observation models and what it leaves out, row by row, with the reason."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from simulator.config import Instrument, Scene

__all__ = ["EffectRow", "effect_ledger", "not_modelled"]


@dataclass(frozen=True)
class EffectRow:
    """One effect: kept or skipped, and why."""

    effect: str
    decision: Literal["kept", "skipped"]
    reason: str

    def to_dict(self) -> dict[str, Any]:
        """Plain dict for JSON and FITS headers."""
        return asdict(self)


_KEPT = (
    ("apodizer, cross mask, pixel integration", "exact on the step grid"),
    ("wavefront drift", "visit offset and random walk"),
    ("photon noise, dark current, clock-induced charge", "Poisson"),
    ("EM register", "exact mean and variance of the 604-stage cascade"),
    ("pixel and register full well, ADC range", "cut off and counted"),
    ("read noise, bias level, quantisation", "Gaussian, constant, rounding"),
    ("sky", "uniform, solar colour"),
)
_SKIPPED = (
    (
        "static wavefront error and deformable mirror",
        "the wavefront is taken as flat before drift: the dark hole is the apodizer's own",
    ),
    ("pointing jitter", "not modelled"),
    ("cosmic rays", "not modelled; frames are kept short enough that few are lost"),
    (
        "blooming and register tails",
        "the settings keep the central star from blooming or trailing into the hole; elsewhere charge is cut off",
    ),
    ("blooming and register tails of companions", "not modelled; a target whose companion saturates is flagged"),
    ("charge transfer, flat field, bad pixels, bias structure", "not modelled"),
    (
        "exozodiacal light and position-dependent zodiacal light",
        "not modelled; the uniform sky is brighter than most of the sky",
    ),
)


def not_modelled() -> list[str]:
    """Effects that neither predictions nor images contain, one sentence each."""
    return [f"{effect}: {reason}" for effect, reason in _SKIPPED]


def effect_ledger(scene: Scene, instrument: Instrument) -> tuple[EffectRow, ...]:
    """Ledger of one observation.

    Parameters
    ----------
    scene : Scene
    instrument : Instrument

    Returns
    -------
    tuple of EffectRow
    """
    rows = [EffectRow(effect, "kept", reason) for effect, reason in _KEPT]
    if instrument.drift.visit_nm == 0 and instrument.drift.walk_nm_per_sqrt_hour == 0:
        rows[1] = EffectRow("wavefront drift", "skipped", "both rms are zero")
    if scene.stars:
        on = scene.companions == "on"
        rows.append(
            EffectRow("light of companions", "kept" if on else "skipped", "own PSF wings" if on else "switched off")
        )
    rows += [EffectRow(effect, "skipped", reason) for effect, reason in _SKIPPED]
    return tuple(rows)
