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


_OPTICS = "apodizer, cross mask, pixel integration"
_STATIC = "static wavefront error and deformable mirror"
_KEPT = (
    (_OPTICS, "exact on the step grid"),
    ("wavefront drift", "visit offset and random walk"),
    (_STATIC, "one dark hole per band, its field known perfectly"),
    ("pointing jitter", "incoherent sum over a Gaussian"),
    ("photon noise, dark current, clock-induced charge", "Poisson"),
    ("EM register", "exact mean and variance of the 604-stage cascade"),
    ("pixel and register full well, ADC range", "cut off and counted"),
    ("read noise, bias level, quantisation", "Gaussian, constant, rounding"),
    ("sky", "uniform, solar colour"),
)
_SKIPPED = (
    ("cosmic rays", "not modelled; frames are kept short enough that few are lost"),
    (
        "blooming and register tails",
        "the settings keep the central star from blooming or trailing into the hole; elsewhere charge is cut off",
    ),
    ("blooming and register tails of companions", "not modelled; a target whose companion saturates is flagged"),
    ("charge transfer, flat field, bad pixels, bias structure", "not modelled"),
    (
        "position-dependent zodiacal light",
        "not modelled; the uniform sky is brighter than most of the sky. Exozodiacal discs only where a scene has one",
    ),
)


def not_modelled() -> list[str]:
    """Effects that neither predictions nor images contain, one sentence each."""
    return [f"{effect}: {reason}" for effect, reason in _SKIPPED]


def effect_ledger(
    scene: Scene, instrument: Instrument, *, scene_model: str = "exact", hole_state: str = "reached"
) -> tuple[EffectRow, ...]:
    """Ledger of one observation.

    Parameters
    ----------
    scene : Scene
    instrument : Instrument
    scene_model : {"exact", "paper"}
        How sources other than the star are placed.
    hole_state : {"reached", "not_reached", "none", "external"}
        State of the dark hole; external where the point-spread functions come from a file.

    Returns
    -------
    tuple of EffectRow
    """
    rows = {row[0]: EffectRow(row[0], "kept", row[1]) for row in _KEPT}

    def skip(effect: str, reason: str) -> None:
        rows[effect] = EffectRow(effect, "skipped", reason)

    wavefront, hole = instrument.wavefront, instrument.dark_hole
    if instrument.drift.visit_nm == 0 and instrument.drift.walk_nm_per_sqrt_hour == 0:
        skip("wavefront drift", "both rms are zero")
    if hole.control == "single_jacobian":
        reason = "one dark hole per band, set with one Jacobian of the design"
        rows[_STATIC] = EffectRow(_STATIC, "kept", reason)
    elif hole.control == "surface":
        rows[_STATIC] = EffectRow(_STATIC, "kept", "the mirror's surface is loaded from a file")
    elif hole.control == "off" and wavefront.perfect:
        skip(_STATIC, "no aberrations, flat mirror")
    elif hole.control == "off":
        rows[_STATIC] = EffectRow(_STATIC, "kept", "aberrations with a flat mirror: no dark hole")
    if wavefront.jitter_mas == 0:
        skip("pointing jitter", "rms is zero")
    if hole_state == "not_reached":
        rows[_STATIC] = EffectRow(_STATIC, "kept", "the dark hole is brighter than asked of the instrument")
    if hole_state == "external":
        for effect in (_OPTICS, _STATIC, "wavefront drift", "pointing jitter"):
            skip(effect, "the point-spread functions come from a file")
    if scene_model == "paper":
        rows["source positions"] = EffectRow(
            "source positions", "skipped", "nearest of 4 x 4 cells a pixel, no mask in front of off-axis sources"
        )
    if scene.stars:
        on = scene.companions == "on"
        rows["light of companions"] = EffectRow(
            "light of companions", "kept" if on else "skipped", "own PSF wings" if on else "switched off"
        )
    if scene.extended:
        rows["extended sources"] = EffectRow("extended sources", "kept", "a grid of half pixels through the PSF")
    return (*rows.values(), *(EffectRow(effect, "skipped", reason) for effect, reason in _SKIPPED))
