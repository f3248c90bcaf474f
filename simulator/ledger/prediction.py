"""Sizes of the effects of a camera: what each of them says of itself.

Predicted sizes of everything that an observation may leave out, from closed forms and known tables alone.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpic_core import Outcome
from simulator.config import Instrument, Scene, Timing
from simulator.detectors import Sizes, rows_of, sizes as sizes_of
from simulator.imaging import PsfMetrics, aperture_sums, centred_axis, overlap_weights
from simulator.knobs import Knobs
from simulator.ledger.case import CameraCase, sums_possible
from simulator.ledger.inventory import LEFT_OUT, EffectRow, effect_ledger
from simulator.ledger.light import SceneLight, Spill
from simulator.ledger.visit import MAX_EPOCHS, OpticsCase, visit_of
from simulator.signal import INTERLEAVED, overflow, sky_pixel_e_s
from simulator.target import extended_rates


def camera_sizes(case: CameraCase) -> dict[str, Sizes]:
    """Return the size of every effect of the camera on every quantity, by the name of its switch.

    Of a change of the mean ``d`` of a pixel the size is ``|d| / sigma``, or that of the variance that goes with it; of
    a part of the variance half its share; of a change of the aperture sum of a planet its relative size; for the SNR
    the sum of this and half the share of the variance of the aperture sum.
    """
    found = {effect.switch: effect.size(case) for effect in rows_of(case.detector.chain)}
    return {key: size for key, size in found.items() if size is not None}


WAVELENGTHS, PIXEL_NODES = (1, 2, 3, 4, 5, 6, 7), (1, 2, 3, 4, 5)
EPOCHS = (1, 2, 3, 4, 6, 8, 12)
_ANNULUS_LAMBDA_D = 1.5


@dataclass(frozen=True)
class Forecast:
    """Sizes of effects; made by `forecast`.

    Attributes
    ----------
    rows : tuple of EffectRow
        What scene and configuration contain, before anything is left out.
    sizes : dict of str to dict
        By key of the effect, its size on ``planet_flux``, ``snr`` and ``pixel_map``. Those of settings are the sizes at
        the standard tier.
    knob_sizes : dict of str to dict
        Sizes of every value of ``wavelength_nodes``, ``pixel_nodes``, ``precision`` and ``drift_epochs``, against the
        reference.
    sources : dict of str to str
        Kind of every source besides the central star, by name.
    sums : Outcome
        Whether sums of frames can stand for the frames; see `simulator.observing.hole_stack`.
    n_frames, max_epochs : int
    full : bool
        Whole frames, or the window around the hole.
    measured : tuple of str
        Planets that are measured.
    """

    rows: tuple[EffectRow, ...]
    sizes: dict[str, Sizes]
    knob_sizes: dict[str, dict[Any, Sizes]]
    sources: dict[str, str]
    sums: Outcome[float]
    n_frames: int
    max_epochs: int
    full: bool
    measured: tuple[str, ...]


def forecast(
    scene: Scene,
    instrument: Instrument,
    *,
    band: str,
    exposure_s: float,
    n_frames: int,
    em_gain: float,
    roll_deg: float = 0.0,
    star_offset_arcsec: tuple[float, float] = (0.0, 0.0),
    scene_model: str = "exact",
    start_utc: str | None = None,
    switches: Mapping[str, bool] | None = None,
    planets: Sequence[str] | None = None,
    reduced: bool = False,
    full: bool = False,
    max_epochs: int = MAX_EPOCHS,
    visits: int = 1,
    timing: Timing = INTERLEAVED,
) -> Forecast:
    """Predict how much each effect changes what is asked of an observation.

    Parameters
    ----------
    scene : Scene
    instrument : Instrument
    band : str
    exposure_s, n_frames, em_gain
        Of the sequence.
    roll_deg, star_offset_arcsec, scene_model, start_utc, switches
        As `simulator.observing.observation.observe`.
    planets : sequence of str, optional
        Names of the planets that are measured; all of the scene by default.
    reduced : bool
        Sizes after a full reduction: flat, bias structure and flaws calibrated out, non-linearity and smear undone,
        particles rejected.
    full : bool
        Whole frames, or the window around the hole.
    max_epochs : int
        Epochs of the visit without a ledger.
    visits : int
        Of the programme, with as many references: the SNR is that of all of them.
    timing : Timing
        Where in the orbit references are taken.

    Returns
    -------
    Forecast

    Raises
    ------
    InputError
        If a planet that is named is not in the scene, or as `simulator.target.sources.scene_sources`.

    Notes
    -----
    ``planet_flux`` is the relative change of the planet's light in its aperture, ``snr`` that of this light over the
    noise of the aperture sum over the visit, ``pixel_map`` the largest change of the mean or standard deviation of a
    pixel over its standard deviation in one frame. Nothing is propagated or drawn (but 1500 tracks of particles, once).
    """
    visit = visit_of(
        scene,
        instrument,
        band=band,
        exposure_s=exposure_s,
        n_frames=n_frames,
        em_gain=em_gain,
        roll_deg=roll_deg,
        star_offset_arcsec=star_offset_arcsec,
        start_utc=start_utc,
        switches=switches,
        planets=planets,
        reduced=reduced,
        full=full,
        max_epochs=max_epochs,
        visits=visits,
        timing=timing,
    )
    case, optics, figures = visit.camera, visit.optics, visit.metrics
    sizes = camera_sizes(case)
    sizes |= _light_sizes(optics, case.light, visit.sky.rate_e_s_arcsec2, visit.stray_e_s, figures)
    for item in extended_rates(scene, instrument, band):
        pixel_e_s, aperture_e_s = item.rate_e_s * figures.peak_off_axis, item.rate_e_s * figures.core_open
        sizes[f"extended:{item.source.name}"] = optics.spread_light(pixel_e_s, aperture_e_s)
    knobs = _knob_sizes(optics, optics.n_epochs)
    if instrument.coronagraph.table is not None:  # there is no field to sample
        knobs = {name: dict.fromkeys(values, sizes_of(0.0)) for name, values in knobs.items()}
    sizes |= {
        "off_mask_psf": _off_mask(case.light),
        "drift": optics.no_drift(),
        "drift_common": optics.no_common(),
        "orbital_drift": optics.no_orbit(),
        "pupil_samples": sizes_of(0.0),
    }
    sizes |= _left_out(optics)
    sizes |= {name: knobs[name][getattr(Knobs(), name)] for name in ("wavelength_nodes", "pixel_nodes")}
    sizes |= {"precision": knobs["precision"]["single"], "drift_epochs": knobs["drift_epochs"][1]}
    sizes["hole_region"] = _hole_region(case)
    rows = effect_ledger(
        scene,
        visit.switched,
        band=band,
        scene_model=scene_model,
        hole_state=figures.hole_state,
        sky=visit.sky,
        stray=visit.stray,
        start_utc=visit.start_utc,
    )
    for row in rows:  # what does not exist has no size
        if row.decision == "skipped" and row.key in sizes and row.key not in ("source_positions", *LEFT_OUT):
            sizes[row.key] = sizes_of(0.0)
    if max(sizes.get(key, sizes_of(0.0))["planet_flux"] for key in ("blooming", "register_full_well")) >= 1.0:
        _forbid(sizes, knobs)
    kinds: dict[str, str] = {source.name: source.kind for source in visit.sources[1:]}
    kinds |= {source.name: "extended" for source in scene.extended}
    sums = sums_possible(case, figures, optics.star_e_s, moved=optics.moved)
    return Forecast(
        rows=rows,
        sizes=sizes,
        knob_sizes=knobs,
        sources=kinds,
        sums=sums,
        n_frames=n_frames,
        max_epochs=optics.n_epochs,
        full=full,
        measured=visit.measured,
    )


def _forbid(sizes: dict[str, Sizes], knobs: dict[str, dict[Any, Sizes]]) -> None:
    """Forbid limits that cut off the planet or spill charge onto it: there every bit of light can decide the rest."""
    for size in [*sizes.values(), *(size for values in knobs.values() for size in values.values())]:
        if any(size.values()):
            size["planet_flux"] = size["snr"] = 1.0


def _light_sizes(
    optics: OpticsCase, light: SceneLight, sky_e_s_arcsec2: float, stray_e_s: float, metrics: PsfMetrics
) -> dict[str, Sizes]:
    front = float(sky_pixel_e_s(metrics, sky_e_s_arcsec2))
    spread = {"sky": front, "stray_light": stray_e_s}
    sizes = {key: optics.spread_light(rate, rate * light.aperture_pixels) for key, rate in spread.items()}
    measured = {planet.name for planet in light.planets}
    for source in light.sources:
        sizes[f"{source.kind}:{source.name}"] = optics.source(source, measured=source.name in measured)
    return sizes


def _knob_sizes(optics: OpticsCase, epochs: int) -> dict[str, dict[Any, Sizes]]:
    none = sizes_of(0.0)
    steps = sorted({*(fewer for fewer in EPOCHS if fewer < epochs), epochs})
    return {
        "wavelength_nodes": {n: optics.wavelength_nodes(n) for n in WAVELENGTHS[:-1]} | {WAVELENGTHS[-1]: none},
        "pixel_nodes": {n: optics.pixel_nodes(n) for n in PIXEL_NODES[:-1]} | {PIXEL_NODES[-1]: none},
        "precision": {"single": optics.precision(), "double": none},
        "drift_epochs": {n: optics.epochs(n) for n in steps},
    }


def _off_mask(light: SceneLight) -> Sizes:
    """Return the size of one unmasked image for every source, without mask and cross, to the nearest of 4 x 4 cells.

    The cells cost 0.55 % of an aperture sum at most, 4.5 % of a peak pixel (measured at 520 nm).
    """
    flux = max((1.0 / max(planet.core, 1e-3) - 1.0 + 0.0055 for planet in light.planets), default=0.0)
    return sizes_of(0.0, flux)


def _left_out(optics: OpticsCase) -> dict[str, Sizes]:
    """Return the sizes of what no image has: an error of the pointing of each visit, and the disc of the star.

    The light in the hole goes with the star, so that an error of the pointing changes aperture sums by their gradient,
    in science and in reference visits by other amounts, which visits average as they do speckles. A disc of radius r
    blurs the light by a variance of ``r^2 / 4`` an axis, which changes aperture sums by ``r^2 / 8`` of their Laplacian,
    at most ``2 pi / (lambda/D)`` times their gradient, as no wave of the image is shorter than lambda/D; by the same in
    all visits, as if no reference showed it. Both are upper bounds, within a factor of 1.5 and 3 of the rms that moved
    and wide stars leave: differences of pixels see the light beyond the hole.
    """
    case, metrics = optics.camera, optics.metrics
    sums = aperture_sums(case.light.star_e_s, overlap_weights(case.radius_pixels))
    square = np.sum(np.square(np.gradient(sums)), axis=0) * (case.n_frames * case.exposure_s) ** 2
    axis = centred_axis(len(sums), case.pixel_arcsec)
    inside = metrics.zone.covers(axis, axis, -metrics.aperture_radius_arcsec)
    separation = np.hypot(axis[:, None], axis)
    near = []
    for planet in case.light.planets:
        away = np.abs(separation - math.hypot(planet.x_arcsec, planet.y_arcsec))
        around = inside & (away <= _ANNULUS_LAMBDA_D * metrics.lambda_d_arcsec) & (not optics.moved)
        near.append(float(square[around].mean()) if around.any() else 0.0)
    step, radius = (1e-3 * part / case.pixel_arcsec for part in (optics.drift.pointing_mas, optics.star_radius_mas))
    factors = {
        "pointing": 2.0 * step**2,
        "stellar_disc": case.visits * (2.0 * math.pi / case.lambda_d_pixels * radius**2 / 8.0) ** 2,
    }
    return {key: sizes_of(0.0, snr=case.snr_added(factor * part for part in near)) for key, factor in factors.items()}


def _hole_region(case: CameraCase) -> Sizes:
    """Return the size of reading a window alone: overflow that would have come in; what smears into it is known."""
    detector, light, noise = case.detector, case.light, case.noise
    in_columns, in_rows = (peak * case.exposure_s for peak in light.beyond_peaks_e_s)
    enters = float(overflow(in_columns, detector.blooming_e, 1.0))
    enters += float(overflow(in_rows, detector.trailing_e / case.em_gain, noise.factor2))
    if enters <= 1e-6:
        return sizes_of(0.0)
    spill = Spill(dataclasses.replace(case, full=True))
    hit = any(
        not planet.weights.size or spill.blooms_into(*planet.place) or spill.trails_into(*planet.place)
        for planet in light.planets
    )
    return sizes_of(1.0, float(hit))
