"""Predicted sizes of everything that an observation may leave out, from closed forms and known tables alone."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from catalogs.errors import InputError
from simulator.camera.dark_current import dark_rate_e_s
from simulator.camera.switched import switched_for
from simulator.camera.track_loss import aperture_loss_per_s
from simulator.config import Instrument, Scene
from simulator.config.detector import Detector
from simulator.config.optics import Drift
from simulator.effects.cosmic_ray_rate import cosmic_ray_rate
from simulator.effects.sky import sky_rate_e_s_arcsec2
from simulator.effects.stray_light import stray_light_parts
from simulator.imaging.metrics import PsfMetrics
from simulator.imaging.store import psf_metrics
from simulator.knobs import QUANTITIES, Knobs, Quantity
from simulator.ledger.camera_sizes import camera_sizes
from simulator.ledger.case import CameraCase, overflow, stamp_flaws
from simulator.ledger.inventory import effect_ledger
from simulator.ledger.light import PlanetPlace, Sketch, sketch_of
from simulator.ledger.noise import FrameNoise, visit_variance_e2
from simulator.ledger.numerics import Optics
from simulator.ledger.optics_sizes import OpticsCase
from simulator.ledger.particles import pixel_hits
from simulator.ledger.rows import EffectRow
from simulator.ledger.spill import Spill
from simulator.ledger.sums import sums_possible
from simulator.outcome import Outcome
from simulator.passbands import Passbands
from simulator.target.sources import Source, extended_rates, scene_sources

__all__ = ["MAX_EPOCHS", "Forecast", "forecast"]

Sizes = dict[Quantity, float]
MAX_EPOCHS = 12
"""Epochs of a visit without a ledger."""
WAVELENGTHS, PIXEL_NODES = (1, 2, 3, 4, 5, 6, 7), (1, 2, 3, 4, 5)
EPOCHS = (1, 2, 3, 4, 6, 8, 12)
_CM_PER_UM = 1e-4
# A single place in the hole against the rms of its separation.
_FLOOR_LEAST, _FLOOR_MOST = 0.5, 2.0
_BEAT = 1.4


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
        Whether sums of frames can stand for the frames; see `simulator.hole_stack`.
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
        As `simulator.observation.observe`.
    planets : sequence of str, optional
        Names of the planets that are measured; all of the scene by default.
    reduced : bool
        Sizes after a full reduction: flat, bias structure and flaws calibrated out, non-linearity and smear undone,
        particles rejected.
    full : bool
        Whole frames, or the window around the hole.
    max_epochs : int
        Epochs of the visit without a ledger.

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
    camera = instrument.band(band).camera
    switched = switched_for(instrument, camera, switches)
    start = instrument.mission.start_utc if start_utc is None else start_utc
    sources = scene_sources(scene, instrument, band, roll_deg=roll_deg)
    measured = _measured(sources, planets)
    figures = psf_metrics(instrument, band)
    detector = switched.detector_of(band)
    sky = sky_rate_e_s_arcsec2(instrument, band, ra_deg=scene.cstar.ra_deg, dec_deg=scene.cstar.dec_deg,
                               start_utc=start)  # fmt: skip
    side = len(figures.raw_contrast)
    corner = (detector.star_row - side // 2, detector.star_column - side // 2)
    stray = stray_light_parts(instrument, band, (detector.n_rows, detector.n_columns), first_pixel=corner,
                              window=(side, side))  # fmt: skip
    stray_e_s = sum(float(part.mean()) for part in stray.values())
    visit_s = n_frames * (exposure_s + detector.readout_s)
    drift = instrument.drift
    rms_nm = math.hypot(drift.visit_nm, drift.walk_nm_per_sqrt_hour * math.sqrt(visit_s / 3600.0))
    sketch = sketch_of(
        instrument, band, figures, sources, measured=measured, full=full, star_offset_arcsec=star_offset_arcsec,
        sky_e_s_arcsec2=sky.rate_e_s_arcsec2, stray_e_s=stray_e_s, drift_nm=rms_nm,
    )  # fmt: skip
    dark_e_s = dark_rate_e_s(detector) if isinstance(detector, Detector) else detector.dark_e_s
    noise = FrameNoise.of(detector, em_gain, dark_e_s * exposure_s)
    star_e_s, moved = sources[0].rate_e_s, any(star_offset_arcsec)
    speckles = [_speckles(figures, drift, planet, star_e_s, visit_s, still=moved) for planet in sketch.planets]
    variances = tuple(
        visit_variance_e2(planet, sketch, noise, source_noise_fraction=figures.source_noise_fraction,
                          exposure_s=exposure_s, n_frames=n_frames, speckle_e_s=speckle[0],
                          flaws_e=0.0 if reduced else _flaws_e(detector, corner, side, planet) * exposure_s)
        for planet, speckle in zip(sketch.planets, speckles, strict=True)
    )  # fmt: skip
    shares = []
    for v, (least, *most) in zip(variances, speckles, strict=True):
        white = sum(v.values()) - v["speckle"]
        every, walk = ((n_frames * exposure_s * part) ** 2 for part in most)
        shares.append((every / max(white + max(every, (n_frames * exposure_s * least) ** 2), 1e-300),
                       walk / max(white + every, 1e-300)))  # fmt: skip
    counts = n_frames * noise.factor2 * noise.photons * exposure_s * sketch.noise_pixels / sketch.aperture_pixels
    rays = instrument.cosmic_rays
    rate = cosmic_ray_rate(rays, start) if detector.switches.cosmic_rays else 0.0
    case = CameraCase(
        detector=detector if isinstance(detector, Detector) else instrument.detector,
        sketch=sketch,
        noise=noise,
        exposure_s=exposure_s,
        n_frames=n_frames,
        em_gain=em_gain,
        reduced=reduced,
        first_pixel=corner,
        full=full,
        hits_per_s=rate * (detector.pixel_um * _CM_PER_UM) ** 2,
        hits=pixel_hits(rays, detector.pixel_um),
        lost_per_s=aperture_loss_per_s(switched, band, start_utc=start),
        variances=variances,
        other_most=tuple(
            counts * sum(float(source.aperture_e_s[index]) for source in sketch.sources if source.name != planet.name)
            for index, planet in enumerate(sketch.planets)
        ),
        column_peak_e_s=_column_peak(figures, sketch, star_e_s, moved=moved),
        radius_pixels=figures.aperture_radius_arcsec / figures.pixel_scale_arcsec,
        lambda_d_pixels=figures.lambda_d_arcsec / figures.pixel_scale_arcsec,
        pixel_arcsec=figures.pixel_scale_arcsec,
        edge_arcsec=figures.mask_half_width_arcsec + figures.aperture_radius_arcsec + figures.pixel_scale_arcsec,
    )
    epochs = min(n_frames, max_epochs)
    passbands = Passbands.from_instrument(instrument)
    low, high = passbands.bands[passbands.index(band)].support_nm
    optics = OpticsCase(
        camera=case,
        metrics=figures,
        optics=Optics((high - low) / (0.5 * (high + low)), figures.lambda_d_arcsec, figures.pixel_scale_arcsec,
                      instrument.wavefront.jitter_mas * 1e-3),
        drift=drift,
        star_e_s=star_e_s,
        wavelength_nm=instrument.band(band).center_nm,
        visit_s=visit_s,
        n_epochs=epochs,
        speckle_share=tuple(part[0] for part in shares),
        walk_share=tuple(part[1] for part in shares),
        moved=moved,
    )  # fmt: skip
    sizes: dict[str, Sizes] = camera_sizes(case) if camera == "VIS" else {}
    sizes |= _light_sizes(optics, sketch, sky.rate_e_s_arcsec2, stray_e_s, figures)
    for item in extended_rates(scene, instrument, band):
        sizes[f"extended:{item.source.name}"] = optics.spread_light(
            item.rate_e_s * figures.peak_off_axis, item.rate_e_s * figures.core_open
        )
    knobs = _knob_sizes(optics, epochs)
    sizes |= {"off_mask_psf": _off_mask(sketch), "drift": optics.no_drift(),
              "pupil_samples": _nothing()}  # fmt: skip
    sizes |= {name: knobs[name][getattr(Knobs(), name)] for name in ("wavelength_nodes", "pixel_nodes")}
    sizes |= {"precision": knobs["precision"]["single"], "drift_epochs": knobs["drift_epochs"][1]}
    sizes["hole_region"] = _hole_region(case)
    rows = effect_ledger(scene, switched, band=band, scene_model=scene_model,
                         hole_state=figures.hole_state, sky=sky, stray=stray,
                         start_utc=start)  # fmt: skip
    for row in rows:  # what does not exist has no size
        if row.decision == "skipped" and row.key in sizes and row.key != "source_positions":
            sizes[row.key] = _nothing()
    if max(sizes.get(key, _nothing())["planet_flux"] for key in ("blooming", "register_full_well")) >= 1.0:
        _forbid(sizes, knobs)
    kinds: dict[str, str] = {source.name: source.kind for source in sources[1:]}
    kinds |= {source.name: "extended" for source in scene.extended}
    return Forecast(
        rows=rows,
        sizes=sizes,
        knob_sizes=knobs,
        sources=kinds,
        sums=sums_possible(case, figures, star_e_s, camera=camera, moved=moved, band=band),
        n_frames=n_frames,
        max_epochs=epochs,
        full=full,
        measured=measured,
    )


def _speckles(
    metrics: PsfMetrics, drift: Drift, planet: PlanetPlace, star_e_s: float, visit_s: float, *, still: bool
) -> tuple[float, float, float]:
    """Rms of aperture sums that a reference visit leaves: at least, at most, and the part of the walk in that.

    Inside the hole that is the measured floor, within a factor; an aperture that reaches beyond it sees the beat of the
    drift with light that no one measured.
    """
    if still:
        return 0.0, 0.0, 0.0
    where = math.hypot(planet.x_arcsec, planet.y_arcsec)
    floor, frozen = (
        star_e_s * float(metrics.rdi_floor(drift.visit_nm, walk_nm_per_sqrt_hour=walk, visit_hours=visit_s / 3600.0,
                                           separation_arcsec=where))
        for walk in (drift.walk_nm_per_sqrt_hour, 0.0)
    )  # fmt: skip
    walk = math.sqrt(max(floor**2 - frozen**2, 0.0))
    if planet.inside:
        return _FLOOR_LEAST * floor, _FLOOR_MOST * floor, _FLOOR_MOST * walk
    beat = math.sqrt(2.0 * planet.halo_e_s * planet.scattered_e_s + planet.scattered_e_s**2)
    return 0.0, max(_FLOOR_MOST * floor, _BEAT * beat), max(_FLOOR_MOST * walk, _BEAT * beat if walk else 0.0)


def _flaws_e(detector: Any, corner: tuple[int, int], side: int, planet: PlanetPlace) -> float:
    """Dark current of hot pixels and bad columns in an aperture, by squared weights, e-/s."""
    if not isinstance(detector, Detector) or not detector.switches.dark:
        return 0.0
    flaws, _ = stamp_flaws(detector, corner, side)
    return sum(
        float((planet.weights**2 * flaws[key].dark_e_s[planet.place]).sum())
        for key in ("bad_pixels", "bad_columns") if getattr(detector.switches, key)
    )  # fmt: skip


def _nothing() -> Sizes:
    return dict.fromkeys(QUANTITIES, 0.0)


def _forbid(sizes: dict[str, Sizes], knobs: dict[str, dict[Any, Sizes]]) -> None:
    """Where a limit cuts off the planet, or charge may spill onto it, every bit of light can decide what is left."""
    for size in [*sizes.values(), *(size for values in knobs.values() for size in values.values())]:
        if any(size.values()):
            size["planet_flux"] = size["snr"] = 1.0


def _measured(sources: Sequence[Source], planets: Sequence[str] | None) -> tuple[str, ...]:
    known = tuple(source.name for source in sources if source.kind == "planet")
    if planets is None:
        return known
    for name in planets:
        if name not in known:
            raise InputError("planets", name, allowed=", ".join(known) or "none: the scene has no planet")
    return tuple(planets)


def _column_peak(metrics: PsfMetrics, sketch: Sketch, star_e_s: float, *, moved: bool) -> float:
    """Brightest pixel whose overflow may reach the hole along its column or row."""
    star = metrics.peak_off_axis if moved else metrics.peak_on_axis_columns
    return max([star_e_s * star, *(source.peak_e_s for source in sketch.sources if source.kind == "star")])


def _light_sizes(
    optics: OpticsCase, sketch: Sketch, sky_e_s_arcsec2: float, stray_e_s: float, metrics: PsfMetrics
) -> dict[str, Sizes]:
    front = sky_e_s_arcsec2 * metrics.pixel_scale_arcsec**2 * metrics.apodizer_energy
    sizes = {
        "sky": optics.spread_light(front, front * sketch.aperture_pixels),
        "stray_light": optics.spread_light(stray_e_s, stray_e_s * sketch.aperture_pixels),
    }
    measured = {planet.name for planet in sketch.planets}
    for source in sketch.sources:
        sizes[f"{source.kind}:{source.name}"] = optics.source(source, measured=source.name in measured)
    return sizes


def _knob_sizes(optics: OpticsCase, epochs: int) -> dict[str, dict[Any, Sizes]]:
    return {
        "wavelength_nodes": {n: optics.wavelength_nodes(n) for n in WAVELENGTHS[:-1]} | {WAVELENGTHS[-1]: _nothing()},
        "pixel_nodes": {n: optics.pixel_nodes(n) for n in PIXEL_NODES[:-1]} | {PIXEL_NODES[-1]: _nothing()},
        "precision": {"single": optics.precision(), "double": _nothing()},
        "drift_epochs": {n: optics.epochs(n) for n in sorted({*(e for e in EPOCHS if e < epochs), epochs})},
    }


def _off_mask(sketch: Sketch) -> Sizes:
    """Of one unmasked image for every source: what mask and cross take away, and the nearest of 4 x 4 cells.

    The cells cost 0.55 % of an aperture sum at most, 4.5 % of a peak pixel (measured at 520 nm).
    """
    flux = max((1.0 / max(planet.core, 1e-3) - 1.0 + 0.0055 for planet in sketch.planets), default=0.0)
    return {"planet_flux": flux, "snr": flux, "pixel_map": 0.0}


def _hole_region(case: CameraCase) -> Sizes:
    """Of reading a window alone: smear by the rest of the columns, and overflow that would have come in."""
    detector, sketch, noise = case.detector, case.sketch, case.noise
    smear = detector.transfer.line_shift_s * sketch.beyond_column_e_s * detector.switches.smear
    added = [case.n_frames * noise.factor2 * sketch.noise_pixels * smear] * len(case.variances)
    in_columns, in_rows = (peak * case.exposure_s for peak in sketch.beyond_peaks_e_s)
    enters = float(overflow(in_columns, detector.full_well_e, 1.0)) * detector.switches.blooming
    register = detector.register_full_well_e / case.em_gain
    enters += float(overflow(in_rows, register, noise.factor2)) * detector.switches.register_full_well
    limit, reached = (1.0 if enters > 1e-6 else 0.0), 0.0
    if limit:
        spill = Spill(dataclasses.replace(case, full=True))
        reached = case.over_planets(
            lambda planet: float(not planet.weights.size or spill.blooms_into(*planet.place)
                                 or spill.trails_into(*planet.place))
        )  # fmt: skip
    return {"planet_flux": reached, "snr": reached + case.snr_added(added),
            "pixel_map": limit + case.mean_change(smear)}  # fmt: skip
