"""What an observation models and what it leaves out, row by row, with the reason."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

from simulator.config import Instrument, Scene

__all__ = ["EffectRow", "camera_ledger", "effect_ledger", "not_modelled"]


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
)
_VISIBLE = {
    "photon_noise": ("photon noise", "Poisson"),
    "flat": ("flat field", "response of every pixel"),
    "dark": ("dark current", "plateau and law of temperature"),
    "dark_structure": ("structure of the dark current", "every pixel its own"),
    "bad_pixels": ("hot and dead pixels", "from the calibration set"),
    "bad_columns": ("bad columns", "from the calibration set"),
    "smear": ("frame-transfer smear", "light during the line shifts, no shutter"),
    "cosmic_rays": ("cosmic rays", "tracks at the rate of the date"),
    "nonlinearity": ("non-linearity", "pixels and output of the register"),
    "blooming": ("pixel full well", "the excess blooms along the column"),
    "parallel_cti": ("parallel transfer losses", "charge left behind, electron by electron"),
    "clock_charge": ("clock-induced charge", "Poisson, once a frame"),
    "serial_cti": ("serial transfer losses", "charge left behind, electron by electron"),
    "em_register": ("noise of the EM register", "law of the stage-by-stage cascade"),
    "register_clock_charge": ("clock-induced charge of the register", "electrons made between the stages"),
    "register_full_well": ("register full well", "the excess trails along the row"),
    "read_noise": ("read noise", "Gaussian"),
    "stripes": ("stripes of the bias", "one offset a column"),
    "interference": ("interference of the bias", "a wave in the order of readout"),
    "bias_drift": ("drift of the bias", "one offset a frame"),
}
_INFRARED = {
    "photon_noise": ("photon noise", "Poisson"),
    "flat": ("flat field", "response of every pixel"),
    "dark": ("dark current", "constant"),
    "dark_structure": ("structure of the dark current", "every pixel its own"),
    "bad_pixels": ("hot and dead pixels", "from the calibration set"),
    "cosmic_rays": ("cosmic rays", "tracks at the rate of the date"),
    "persistence": ("persistence", "charge of earlier frames"),
    "nonlinearity": ("non-linearity", "one curve for all pixels"),
    "interpixel_capacitance": ("inter-pixel capacitance", "coupling to four neighbours"),
    "reset_noise": ("reset noise", "one level per pixel and reset"),
    "read_noise": ("read noise", "Gaussian in every read"),
}


def camera_ledger(instrument: Instrument, camera: str = "VIS") -> tuple[EffectRow, ...]:
    """Ledger of a camera: one row per switch, and the converter.

    Parameters
    ----------
    instrument : Instrument
    camera : {"VIS", "NIR"}
    """
    visible = camera == "VIS"
    switches = (instrument.detector if visible else instrument.near_infrared.detector).switches
    rows = [
        EffectRow(effect, "kept", reason) if getattr(switches, name) else EffectRow(effect, "skipped", "switched off")
        for name, (effect, reason) in (_VISIBLE if visible else _INFRARED).items()
    ]
    return (*rows, EffectRow("bias level, quantisation, range of the converter", "kept", "cut off and counted"))


def not_modelled(instrument: Instrument) -> list[str]:
    """Effects that the images of a visible instrument lack, one sentence each."""
    rows = (*camera_ledger(instrument), *_sky_rows(instrument))
    return [f"{row.effect}: {row.reason}" for row in rows if row.decision == "skipped"]


def _sky_rows(instrument: Instrument) -> tuple[EffectRow, ...]:
    uniform = instrument.sky.model == "uniform"
    zodiacal = EffectRow(
        "position-dependent zodiacal light",
        "skipped" if uniform else "kept",
        "the uniform sky is brighter than most of the sky; exozodiacal discs only where a scene has one"
        if uniform
        else "by ecliptic position and date",
    )
    return (EffectRow("sky", "kept", "uniform over the frame, solar colour"), zodiacal)


def effect_ledger(
    scene: Scene,
    instrument: Instrument,
    *,
    band: str = "",
    scene_model: str = "exact",
    hole_state: str = "reached",
) -> tuple[EffectRow, ...]:
    """Ledger of one observation.

    Parameters
    ----------
    scene : Scene
    instrument : Instrument
    band : str
        Names the camera; the visible one if empty.
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
    camera = instrument.band(band).camera if band else "VIS"
    return (*rows.values(), *_sky_rows(instrument), *camera_ledger(instrument, camera))
