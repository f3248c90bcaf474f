"""What a configuration contains and what it lacks, row by row, with the reason; no sizes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.config import Instrument, Scene
from simulator.config.detector import Detector
from simulator.config.infrared import InfraredDetector
from simulator.effects.cosmic_ray_rate import cosmic_ray_rate
from simulator.effects.sky import SOLAR_AVOIDANCE, SkyLevel
from simulator.effects.stray_light import extra_lights
from simulator.ledger.rows import EffectRow

__all__ = ["camera_ledger", "effect_ledger", "not_modelled", "sky_ledger"]


_OPTICS = "apodizer, cross mask, pixel integration"
_STATIC = "static wavefront error and deformable mirror"
_KEPT = (
    (_OPTICS, "exact on the step grid", "optics"),
    ("wavefront drift", "visit offset and random walk", "drift"),
    (_STATIC, "one dark hole per band, its field known perfectly", "static"),
    ("pointing jitter", "incoherent sum over a Gaussian", "jitter"),
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
    "persistence": ("persistence", "mean charge of the earlier frames of the sequence"),
    "nonlinearity": ("non-linearity", "one curve for all pixels"),
    "interpixel_capacitance": ("inter-pixel capacitance", "coupling to four neighbours"),
    "reset_noise": ("reset noise", "one level per pixel and reset"),
    "read_noise": ("read noise", "Gaussian in every read"),
}
_ZODIACAL = "position-dependent zodiacal light"
# What needs light, and what needs time only.
_LIGHT = ("flat", "smear")
_TIME = ("photon_noise", "dark", "dark_structure", "cosmic_rays", "persistence")
# The number of the configuration that an effect grows with: at 0 there is none of it.
_SIZES = {
    "flat": "flaws.prnu_rms",
    "dark_structure": "flaws.dsnu_rms",
    "bad_columns": "flaws.bad_columns",
    "smear": "transfer.line_shift_s",
    "parallel_cti": "transfer.parallel_cti",
    "clock_charge": "cic_e",
    "serial_cti": "transfer.serial_cti",
    "register_clock_charge": "register_cic_e",
    "read_noise": "read_noise_e",
    "stripes": "bias_structure.stripe_rms_adu",
    "interference": "bias_structure.interference_adu",
    "bias_drift": "bias_structure.drift_adu",
    "persistence": "persistence.fraction",
    "interpixel_capacitance": "interpixel_coupling",
    "reset_noise": "reset_noise_e",
}
# The calibration map that replaces an effect's numbers.
_FILES = {
    "flat": "flat",
    "dark": "dark",
    "dark_structure": "dark",
    "clock_charge": "cic",
    "bad_columns": "bad_columns",
    "stripes": "bias",
}


def camera_ledger(
    instrument: Instrument,
    camera: str = "VIS",
    *,
    lit: bool = True,
    exposure_s: float | None = None,
    start_utc: str | None = None,
) -> tuple[EffectRow, ...]:
    """Ledger of a camera: one row per switch, and the converter.

    Parameters
    ----------
    instrument : Instrument
    camera : {"VIS", "NIR"}
    lit : bool
        Whether light falls on the detector.
    exposure_s : float, optional
        Exposure of a frame: without one there is nothing to collect.
    start_utc : str, optional
        Date of the cosmic rays.
    """
    visible = camera == "VIS"
    detector: Detector | InfraredDetector = instrument.detector if visible else instrument.near_infrared.detector
    rows = []
    for name, (effect, law) in (_VISIBLE if visible else _INFRARED).items():
        file = _file_of(detector, name)
        reason = f"from the map {file}" if file else law
        why_not = _why_not(detector, name, lit=lit, exposed=exposure_s != 0)
        if name == "cosmic_rays" and not why_not:
            reason, why_not = _particles(instrument, law, start_utc)
        if name == "stripes" and file:
            # The map holds whatever structure the bias has, and no switch takes it off.
            reason, why_not = f"replaced by the map {file}, level and structure", ""
        rows.append(
            EffectRow(effect, "skipped", why_not, key=name) if why_not else EffectRow(effect, "kept", reason, key=name)
        )
    last = EffectRow("bias level, quantisation, range of the converter", "kept", "cut off and counted", "quantisation")
    return (*rows, last)


def _why_not(detector: Detector | InfraredDetector, name: str, *, lit: bool, exposed: bool) -> str:
    """Why an effect of the camera is left out, empty if it is not."""
    switches = detector.switches
    if not getattr(switches, name):
        return "switched off"
    if not exposed and name in (*_LIGHT, *_TIME):
        return "frames without exposure"
    if not lit and name in _LIGHT:
        return "no light on the detector"
    if name == "dark_structure" and not switches.dark:
        return "the dark current is switched off"
    key = _SIZES.get(name, "")
    size: Any = None if _file_of(detector, name) else detector
    for part in key.split("."):
        size = getattr(size, part, None)
    return f"{key} is 0" if size == 0 else ""


def _file_of(detector: Detector | InfraredDetector, name: str) -> str:
    """Name of the calibration map that an effect is read from."""
    if not isinstance(detector, Detector):
        return ""
    kind = _FILES.get(name)
    path = None if kind is None else getattr(detector.calibration_files, kind)
    return "" if path is None else Path(path).name


def _particles(instrument: Instrument, reason: str, start_utc: str | None) -> tuple[str, str]:
    """Why cosmic rays are kept, or why not."""
    rays = instrument.cosmic_rays
    if start_utc is None:
        return reason, "their rate is zero" if rays.peak_rate_per_s_cm2 * rays.orbit_factor == 0 else ""
    rate = cosmic_ray_rate(rays, start_utc)
    return f"{reason}, {rate:.3g} /s/cm2", "" if rate > 0 else "their rate is zero"


def not_modelled(instrument: Instrument) -> list[str]:
    """Effects that the images of a visible instrument lack, one sentence each."""
    rows = (*camera_ledger(instrument), *sky_ledger(instrument), _dust(instrument, None))
    return [f"{row.effect}: {row.reason}" for row in rows if row.decision == "skipped"]


def _dust(instrument: Instrument, scene: Scene | None) -> EffectRow:
    """Row of the dust around the star: in a scene, or wherever a planner makes the scene."""
    effect, key, zodis = "exozodiacal light", "exozodi", instrument.sky.exozodi_zodis
    if scene is not None and scene.extended:
        return EffectRow(effect, "kept", "only as extended sources of the scene", key)
    if zodis == 0:
        return EffectRow(effect, "skipped", "sky.exozodi_zodis is 0", key)
    words = f"{zodis:g} zodis, a face-on disc around the star"
    if scene is None:
        return EffectRow(effect, "kept", words, key)
    return EffectRow(effect, "skipped", f"the scene has no disc; predictions count {words}", key)


def sky_ledger(
    instrument: Instrument,
    *,
    band: str = "",
    sky: SkyLevel | None = None,
    stray: Mapping[str, NDArray[np.float64]] | None = None,
) -> tuple[EffectRow, ...]:
    """Ledger of the sky, earthshine and stray light.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Band of the maps.
    sky : SkyLevel, optional
        Rates in the band, for the sizes.
    stray : mapping of str to ndarray, optional
        Rates of `simulator.effects.stray_light.stray_light_parts`, for the sizes.
    """
    config, parts = instrument.sky, {} if sky is None else sky.parts

    def size(origin: str) -> str:
        return f", {parts[origin]:.3g} e-/s/arcsec2" if origin in parts else ""

    if config.model == "uniform":
        words = f"uniform over the frame, {config.brightness_v_mag_arcsec2:g} mag/arcsec2 in V, solar colour"
        rows = [
            EffectRow("sky", "kept", words + size("uniform"), "sky"),
            EffectRow(_ZODIACAL, "skipped", "the uniform sky is brighter than most of the sky", "zodiacal"),
        ]
    else:
        near = " (a lower limit so close to the Sun)" if sky is not None and SOLAR_AVOIDANCE in sky.flags else ""
        rows = [
            EffectRow("sky", "kept", f"zodiacal light alone, uniform over the frame{size('zodiacal')}{near}", "sky"),
            EffectRow(_ZODIACAL, "kept", "by ecliptic position and date", "zodiacal"),
        ]
    for name, light in extra_lights(instrument).items():
        effect = name.replace("_", " ")
        path = light.map_file.get(band) if isinstance(light.map_file, dict) else light.map_file
        if light.brightness_v_mag_arcsec2 is not None:
            words = f"{light.brightness_v_mag_arcsec2:g} mag/arcsec2 in V, solar colour{size(name)}"
        elif light.rate_e_s is not None:
            words = f"{light.rate_e_s:g} e-/s in every pixel" if light.rate_e_s > 0 else ""
        elif path is not None:
            mean = f", {stray[name].mean():.3g} e-/s a pixel on average" if stray and name in stray else ""
            words = f"from the map {Path(path).name}{mean}"
        elif light.map_file is not None:
            words = "from a map by band"
        else:
            rows.append(EffectRow(effect, "skipped", "none given", name))
            continue
        lit = EffectRow(effect, "kept", words, name)
        rows.append(lit if words else EffectRow(effect, "skipped", "its rate is zero", name))
    return tuple(rows)


def effect_ledger(
    scene: Scene,
    instrument: Instrument,
    *,
    band: str = "",
    scene_model: str = "exact",
    hole_state: str = "reached",
    sky: SkyLevel | None = None,
    stray: Mapping[str, NDArray[np.float64]] | None = None,
    start_utc: str | None = None,
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
    sky, stray
        As `sky_ledger`.
    start_utc : str, optional
        As `camera_ledger`.

    Returns
    -------
    tuple of EffectRow
    """
    keys = {row[0]: row[2] for row in _KEPT}
    rows = {row[0]: EffectRow(row[0], "kept", row[1], row[2]) for row in _KEPT}

    def skip(effect: str, reason: str) -> None:
        rows[effect] = EffectRow(effect, "skipped", reason, keys[effect])

    wavefront, hole = instrument.wavefront, instrument.dark_hole
    if instrument.drift.visit_nm == 0 and instrument.drift.walk_nm_per_sqrt_hour == 0:
        skip("wavefront drift", "both rms are zero")
    if hole.control == "single_jacobian":
        reason = "one dark hole per band, set with one Jacobian of the design"
        rows[_STATIC] = EffectRow(_STATIC, "kept", reason, "static")
    elif hole.control == "surface":
        rows[_STATIC] = EffectRow(_STATIC, "kept", "the mirror's surface is loaded from a file", "static")
    elif hole.control == "off" and wavefront.perfect:
        skip(_STATIC, "no aberrations, flat mirror")
    elif hole.control == "off":
        rows[_STATIC] = EffectRow(_STATIC, "kept", "aberrations with a flat mirror: no dark hole", "static")
    if wavefront.jitter_mas == 0:
        skip("pointing jitter", "rms is zero")
    if hole_state == "not_reached":
        rows[_STATIC] = EffectRow(_STATIC, "kept", "the dark hole is brighter than asked of the instrument", "static")
    if hole_state == "external":
        for effect in (_OPTICS, _STATIC, "wavefront drift", "pointing jitter"):
            skip(effect, "the point-spread functions come from a file")
    if scene_model == "paper":
        rows["source positions"] = EffectRow(
            "source positions",
            "skipped",
            "nearest of 4 x 4 cells a pixel, no mask in front of off-axis sources",
            "source_positions",
        )
    if any(star.companion for star in scene.stars):
        on = scene.companions == "on"
        rows["light of companions"] = EffectRow(
            "light of companions", "kept" if on else "skipped", "own PSF wings" if on else "switched off", "companions"
        )
    if scene.extended:
        how = "a grid of half pixels through the PSF"
        rows["extended sources"] = EffectRow("extended sources", "kept", how, "extended")
    camera = instrument.band(band).camera if band else "VIS"
    return (
        *rows.values(),
        *sky_ledger(instrument, band=band, sky=sky, stray=stray),
        _dust(instrument, scene),
        *camera_ledger(instrument, camera, start_utc=start_utc),
    )
