"""The rows of the effect ledger: what a configuration contains and what it lacks, each with its reason."""

import dataclasses
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

from cpic_core import FloatArray, Record
from simulator.config import Instrument, Scene
from simulator.detectors import Effect, Setting, rows_of
from simulator.effects import SKY_PLACE_UNKNOWN, SOLAR_AVOIDANCE, SkyLevel, cosmic_ray_rate, extra_lights


class EffectRow(Record):
    """One effect: kept or skipped, and why.

    Attributes
    ----------
    effect : str
        Name for people.
    decision : {"kept", "skipped"}
    reason : str
    key : str
        Name for programs: the switch of the camera, or that of the effect; ``star:NAME`` and ``planet:NAME`` for
        sources.
    size : float or None
        Predicted size on the quantity asked for, the largest if several; 0 for what does not exist. None where no size
        was asked for or can be given.
    """

    effect: str
    decision: Literal["kept", "skipped"]
    reason: str
    key: str = ""
    size: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the plain dict for JSON and FITS headers."""
        return asdict(self)


_OPTICS = "apodizer, cross mask, pixel integration"
_STATIC = "static wavefront error and deformable mirror"
_COMMON, _ORBITAL = "wavefront common to all science visits", "wavefront around the orbit"
_KEPT = (
    (_OPTICS, "exact on the step grid", "optics"),
    ("wavefront drift", "visit offset and random walk", "drift"),
    (_COMMON, "one screen in all science visits that references have not", "drift_common"),
    (_ORBITAL, "one map, a sine of the orbital period", "orbital_drift"),
    (_STATIC, "one dark hole per band, its field known perfectly", "static"),
    ("pointing jitter", "incoherent sum over a Gaussian", "jitter"),
)
LEFT_OUT = {
    "pointing": ("pointing of each visit", "visits stand on the centre of the mask"),
    "stellar_disc": ("disc of the star", "the star is a point"),
}
"""What no image has: the name of each effect and what is done instead, by the key of its size."""
_LACKING = tuple(EffectRow(effect, "skipped", reason, key) for key, (effect, reason) in LEFT_OUT.items())
_ZODIACAL = "position-dependent zodiacal light"


def camera_ledger(
    instrument: Instrument,
    camera: str = "VIS",
    *,
    lit: bool = True,
    exposure_s: float | None = None,
    start_utc: str | None = None,
) -> tuple[EffectRow, ...]:
    """Return the ledger of a camera: one row per switch, and the converter.

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
    detector, rays = instrument.channel(camera).detector, instrument.cosmic_rays
    peak = rays.peak_rate_per_s_cm2 * rays.orbit_factor
    rate = peak if start_utc is None else cosmic_ray_rate(rays, start_utc)
    setting = Setting(detector, lit, exposure_s != 0, rate, start_utc is not None)
    return tuple(_row(effect, *effect.row(setting)) for effect in rows_of(detector.chain))


def _row(effect: Effect, law: str, why_not: str) -> EffectRow:
    return EffectRow(effect.label, "skipped" if why_not else "kept", why_not or law, effect.switch)


def not_modelled(instrument: Instrument) -> list[str]:
    """Return the effects that the images of a visible instrument lack, one sentence each."""
    rows = (*_LACKING, *camera_ledger(instrument), *sky_ledger(instrument), _dust(instrument, None))
    return [f"{row.effect}: {row.reason}" for row in rows if row.decision == "skipped"]


def _dust(instrument: Instrument, scene: Scene | None) -> EffectRow:
    """Return the row of the dust around the star: in a scene, or wherever a planner makes the scene."""
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
    stray: Mapping[str, FloatArray] | None = None,
) -> tuple[EffectRow, ...]:
    """Return the ledger of the sky, earthshine and stray light.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Band of the maps.
    sky : SkyLevel, optional
        Rates in the band, for the sizes.
    stray : mapping of str to ndarray, optional
        Rates of `simulator.effects.sky.stray_light_parts`, for the sizes.
    """
    config, parts = instrument.sky, {} if sky is None else sky.parts

    def size(origin: str) -> str:
        return f", {parts[origin]:.3g} e-/s/arcsec2" if origin in parts else ""

    if config.model == "uniform":
        words = f"uniform over the frame, {config.brightness_v_mag_arcsec2:g} mag/arcsec2 in V, solar colour"
        words += size("uniform")
        zodiacal = EffectRow(_ZODIACAL, "skipped", "the sky is taken as uniform", "zodiacal")
    else:
        near = " (a lower limit so close to the Sun)" if sky is not None and SOLAR_AVOIDANCE in sky.flags else ""
        words = f"zodiacal light alone, uniform over the frame{size('zodiacal')}{near}"
        law = "by ecliptic position and date"
        if sky is not None and SKY_PLACE_UNKNOWN in sky.flags:
            law = "the median over the whole sky: the star has no coordinates"
        elif config.season == "median":
            law = f"by ecliptic latitude, median over the days {config.sun_limit_deg:g} deg or more from the Sun"
        zodiacal = EffectRow(_ZODIACAL, "kept", law, "zodiacal")
    rows = [EffectRow("sky", "kept", words, "sky"), zodiacal]
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
    stray: Mapping[str, FloatArray] | None = None,
    start_utc: str | None = None,
) -> tuple[EffectRow, ...]:
    """Return the ledger of one observation.

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
    rows = {effect: EffectRow(effect, "kept", reason, key) for effect, reason, key in _KEPT}

    def say(effect: str, reason: str, decision: Literal["kept", "skipped"] = "skipped") -> None:
        rows[effect] = dataclasses.replace(rows[effect], decision=decision, reason=reason)

    wavefront, hole = instrument.wavefront, instrument.dark_hole
    if instrument.drift.visit_nm == 0 and instrument.drift.walk_nm_per_sqrt_hour == 0:
        say("wavefront drift", "both rms are zero")
    if instrument.drift.common_nm == 0:
        say(_COMMON, "its rms is zero")
    if instrument.drift.orbital_nm == 0:
        say(_ORBITAL, "its rms is zero")
    if hole.control == "single_jacobian":
        say(_STATIC, "one dark hole per band, set with one Jacobian of the design", "kept")
    elif hole.sensing == "probes":
        say(_STATIC, "one dark hole per band, set from estimates of its field with the errors of probes", "kept")
    elif hole.control == "surface":
        say(_STATIC, "the mirror's surface is loaded from a file", "kept")
    elif hole.control == "off" and wavefront.perfect:
        say(_STATIC, "no aberrations, flat mirror")
    elif hole.control == "off":
        say(_STATIC, "aberrations with a flat mirror: no dark hole", "kept")
    if wavefront.jitter_mas == 0:
        say("pointing jitter", "rms is zero")
    if hole_state == "not_reached":
        say(_STATIC, "the dark hole is brighter than asked of the instrument", "kept")
    if hole_state in ("external", "table"):
        reason = "a table says what is left of it" if hole_state == "table" else "images come from a file"
        for effect in (_OPTICS, _STATIC, "wavefront drift", _COMMON, _ORBITAL, "pointing jitter"):
            say(effect, reason)
    if scene_model == "paper":
        reason = "nearest of 4 x 4 cells a pixel, no mask in front of off-axis sources"
        rows["source positions"] = EffectRow("source positions", "skipped", reason, "source_positions")
    if any(star.companion for star in scene.stars):
        on = scene.companions == "on"
        rows["light of companions"] = EffectRow(
            "light of companions", "kept" if on else "skipped", "own PSF wings" if on else "switched off", "companions"
        )
    if scene.extended:
        how = "a grid of half pixels through the PSF"
        rows["extended sources"] = EffectRow("extended sources", "kept", how, "extended")
    camera = instrument.band(band).camera if band else "VIS"
    front = (*_LACKING, *sky_ledger(instrument, band=band, sky=sky, stray=stray), _dust(instrument, scene))
    return (*rows.values(), *front, *camera_ledger(instrument, camera, start_utc=start_utc))
