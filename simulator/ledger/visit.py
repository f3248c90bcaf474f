"""Noise of a planet's aperture sum over a visit, for the sizes of effects.

An observation as the ledger sees it: its light, its noise and its optics, from known tables alone.
"""

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from catalogs import luminosity_from_v, radius_from_luminosity, stellar_parameters
from cpic_core import InputError, NDArray
from simulator.camera import FrameNoise, aperture_loss_per_s
from simulator.config import Detector, Drift, Instrument, Scene, SceneStar, Timing
from simulator.detectors import FrameTerm
from simulator.effects import SkyLevel, cosmic_ray_rate, sky_rate_e_s_arcsec2, stray_light_parts
from simulator.imaging import PsfMetrics, psf_metrics
from simulator.ledger.case import CameraCase, pixel_hits, stamp_flaws
from simulator.ledger.light import PlanetPlace, SceneLight, scene_light
from simulator.ledger.optics_sizes import Lasting, Optics, OpticsCase
from simulator.passbands import Passbands
from simulator.signal import INTERLEAVED, programme_law
from simulator.target import Source, scene_sources


def visit_variance_e2(
    planet: PlanetPlace,
    light: SceneLight,
    noise: FrameNoise,
    *,
    source_noise_fraction: float,
    exposure_s: float,
    n_frames: int,
    speckle_e_s: float,
    line_shift_s: float,
    flaws_e: float = 0.0,
) -> dict[str, float]:
    """Return the variance of the aperture sum of a planet over a visit, by origin, electrons^2.

    Parameters
    ----------
    planet : PlanetPlace
    light : SceneLight
        Light around it.
    noise : FrameNoise
    source_noise_fraction : float
        Mean weight of the planet's light in its aperture.
    exposure_s : float
        Of one frame.
    n_frames : int
    speckle_e_s : float
        Rms of aperture sums that a reference visit leaves.
    line_shift_s : float
        Time that a row of the frame transfer takes, 0 without smear.
    flaws_e : float
        What hot pixels and bad columns add to a frame, times the squared weights.

    Notes
    -----
    ``N (F^2 w (light t + charge) + n (read^2 + rounding)) + (N t speckle)^2``: w the mean squared weight of the pixels
    of the aperture, n the sum of squared weights (`simulator.detectors.variance.aperture_noise_pixels`).
    """
    pixels = light.noise_pixels
    fraction = pixels / light.aperture_pixels
    bright = float((planet.weights**2).sum()) / max(float(planet.weights.sum()), 1e-300) if planet.weights.size else 1.0
    counted = {
        "planet": FrameTerm(rate_e_s=source_noise_fraction * planet.signal_e_s),
        "halo": FrameTerm(rate_e_s=max(fraction, bright) * planet.halo_e_s),
        "other": FrameTerm(rate_e_s=fraction * planet.other_e_s),
        "sky": FrameTerm(rate_e_s=fraction * planet.sky_e_s),
        "smear": FrameTerm(charge_e=fraction * line_shift_s * planet.column_e_s),
        "dark": FrameTerm(charge_e=pixels * noise.dark_e),
        "flaws": FrameTerm(charge_e=flaws_e),
    }
    electronic = {
        "clock": FrameTerm(charge_e=pixels * noise.clock_e),
        "read": FrameTerm(output_e2=pixels * noise.read_e2),
        "rounding": FrameTerm(output_e2=pixels * noise.rounding_e2),
    } | {name: FrameTerm(output_e2=pixels * part) for name, part in noise.added_e2.items()}
    counts = n_frames * noise.photons
    # The variances of the frame's noise are those at the register input already.
    found = {name: counts * term.variance_e2(exposure_s, noise.factor2, 1.0) for name, term in counted.items()}
    found |= {name: n_frames * term.variance_e2(exposure_s, noise.factor2, 1.0) for name, term in electronic.items()}
    speckle = (n_frames * exposure_s * speckle_e_s) ** 2
    return {name: float(value) for name, value in found.items()} | {"speckle": speckle}


MAX_EPOCHS = 12
"""Epochs of a visit without a ledger."""
_CM_PER_UM = 1e-4
_SUN_AT_10_PC_MAS = 0.46505  # angular radius: 695 700 km (IAU 2015) at 10 pc
# A single place in the hole against the rms of its separation.
_FLOOR_LEAST, _FLOOR_MOST = 0.5, 2.0
_BEAT = 1.4
_ANNULUS_LAMBDA_D = 1.5  # half width of the annulus around a planet whose scatter counts


@dataclass(frozen=True, eq=False)
class Visit:
    """The inputs of sizes; made by `visit_of`.

    Attributes
    ----------
    sources : tuple of Source
        The central star first.
    measured : tuple of str
        Planets that are measured.
    metrics : PsfMetrics
    switched : Instrument
        With what is switched off.
    start_utc : str
    sky : SkyLevel
    stray : mapping of str to ndarray
        By origin, on the stamp; electrons per second and pixel.
    camera : CameraCase
    optics : OpticsCase
    """

    sources: tuple[Source, ...]
    measured: tuple[str, ...]
    metrics: PsfMetrics
    switched: Instrument
    start_utc: str
    sky: SkyLevel
    stray: Mapping[str, NDArray[Any]]
    camera: CameraCase
    optics: OpticsCase

    @property
    def stray_e_s(self) -> float:
        """Mean stray light on a pixel."""
        return _mean_stray(self.stray)


def visit_of(
    scene: Scene,
    instrument: Instrument,
    *,
    band: str,
    exposure_s: float,
    n_frames: int,
    em_gain: float,
    roll_deg: float = 0.0,
    star_offset_arcsec: tuple[float, float] = (0.0, 0.0),
    start_utc: str | None = None,
    switches: Mapping[str, bool] | None = None,
    planets: Sequence[str] | None = None,
    reduced: bool = False,
    full: bool = False,
    max_epochs: int = MAX_EPOCHS,
    visits: int = 1,
    timing: Timing = INTERLEAVED,
) -> Visit:
    """Return the light, noise and optics of an observation; parameters and errors as `simulator.ledger.forecast`."""
    switched = instrument.switched(switches, camera=instrument.band(band).camera)
    start = instrument.mission.start_utc if start_utc is None else start_utc
    sources = scene_sources(scene, instrument, band, roll_deg=roll_deg)
    measured = _measured(sources, planets)
    figures = psf_metrics(instrument, band)
    detector = switched.detector_of(band)
    star = scene.cstar
    sky = sky_rate_e_s_arcsec2(instrument, band, ra_deg=star.ra_deg, dec_deg=star.dec_deg, start_utc=start)
    side = len(figures.raw_contrast)
    corner = (detector.star_row - side // 2, detector.star_column - side // 2)
    stray = stray_light_parts(instrument, band, detector.shape, first_pixel=corner, window=(side, side))
    visit_s = n_frames * (exposure_s + detector.readout_s)
    drift = instrument.drift
    light = scene_light(
        instrument,
        band,
        figures,
        sources,
        measured=measured,
        full=full,
        star_offset_arcsec=star_offset_arcsec,
        sky_e_s_arcsec2=sky.rate_e_s_arcsec2,
        stray_e_s=_mean_stray(stray),
        drift_nm=math.hypot(
            drift.visit_nm,
            drift.common_nm,
            drift.walk_nm_per_sqrt_hour * math.sqrt(visit_s / 3600.0),
            drift.orbital_nm * (drift.orbital_orders == "all"),
        ),
    )
    noise = FrameNoise.of(detector, em_gain, exposure_s)
    star_e_s = sources[0].rate_e_s
    moved = any(star_offset_arcsec)
    speckles = [_speckles(figures, drift, planet, star_e_s, visit_s, still=moved) for planet in light.planets]
    lasting = [_lasting(figures, drift, planet, visit_s, visits, timing) for planet in light.planets]
    variances, speckle_shares, walk_shares = [], [], []
    for planet, speckle, more in zip(light.planets, speckles, lasting, strict=True):
        variance = visit_variance_e2(
            planet,
            light,
            noise,
            source_noise_fraction=figures.source_noise_fraction,
            exposure_s=exposure_s,
            n_frames=n_frames,
            speckle_e_s=speckle[0],
            line_shift_s=detector.line_shift_s if exposure_s > 0 else 0.0,
            flaws_e=0.0 if reduced else _flaws_e(detector, corner, side, planet) * exposure_s,
        )
        speckle_share, walk_share = _shares(variance, speckle, n_frames * exposure_s)
        variance["common"] = variance["speckle"] * (more.common + more.orbital)
        variances.append(variance)
        speckle_shares.append(speckle_share)
        walk_shares.append(walk_share)
    rays = instrument.cosmic_rays
    rate = cosmic_ray_rate(rays, start) if detector.switches.cosmic_rays else 0.0
    pixel, radius = figures.pixel_scale_arcsec, figures.aperture_radius_arcsec
    case = CameraCase(
        detector=detector if isinstance(detector, Detector) else instrument.detector,
        light=light,
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
        variances=tuple(variances),
        column_peak_e_s=_column_peak(figures, light, star_e_s, moved=moved),
        radius_pixels=radius / pixel,
        lambda_d_pixels=figures.lambda_d_arcsec / pixel,
        pixel_arcsec=pixel,
        edge_arcsec=figures.mask_half_width_arcsec + radius + pixel,
        visits=visits,
    )
    passbands = Passbands.from_instrument(instrument)
    low, high = passbands.bands[passbands.index(band)].support_nm
    width, jitter_arcsec = (high - low) / (0.5 * (high + low)), instrument.wavefront.jitter_mas * 1e-3
    optics = OpticsCase(
        camera=case,
        metrics=figures,
        optics=Optics(width, figures.lambda_d_arcsec, pixel, jitter_arcsec),
        drift=drift,
        star_e_s=star_e_s,
        wavelength_nm=instrument.band(band).center_nm,
        visit_s=visit_s,
        n_epochs=min(n_frames, max_epochs),
        speckle_share=tuple(speckle_shares),
        walk_share=tuple(walk_shares),
        lasting=tuple(lasting),
        moved=moved,
        star_radius_mas=_radius_mas(star),
    )
    return Visit(
        sources=tuple(sources),
        measured=measured,
        metrics=figures,
        switched=switched,
        start_utc=start,
        sky=sky,
        stray=stray,
        camera=case,
        optics=optics,
    )


def _radius_mas(star: SceneStar) -> float:
    """Return the angular radius of a star by its V magnitude and temperature; 0 if the temperature is unknown."""
    teff_k = star.teff_k
    if teff_k is None and star.spectral_type is not None:
        teff_k = stellar_parameters(star.spectral_type).teff_k
    if teff_k is None:
        return 0.0
    return radius_from_luminosity(luminosity_from_v(star.v_mag, 10.0, teff_k), teff_k) * _SUN_AT_10_PC_MAS


def _mean_stray(stray: Mapping[str, NDArray[Any]]) -> float:
    return sum(float(part.mean()) for part in stray.values())


Speckles = tuple[float, float, float]


def _shares(variances: Mapping[str, float], speckle_e_s: Speckles, integration_s: float) -> tuple[float, float]:
    """Return the largest part of the variance of an aperture sum that speckles make, and the walk alone."""
    least, every, walk = ((integration_s * part) ** 2 for part in speckle_e_s)
    white = sum(variances.values()) - variances["speckle"]
    return every / max(white + max(every, least), 1e-300), walk / max(white + every, 1e-300)


def _speckles(
    metrics: PsfMetrics, drift: Drift, planet: PlanetPlace, star_e_s: float, visit_s: float, *, still: bool
) -> Speckles:
    """Return the rms of aperture sums that a reference visit leaves: least, most, and the walk's part in that.

    Inside the hole that is the measured floor, within a factor; an aperture that reaches beyond it sees the beat of the
    drift with light that no one measured.
    """
    if still:
        return 0.0, 0.0, 0.0
    hours, where = visit_s / 3600.0, math.hypot(planet.x_arcsec, planet.y_arcsec)
    rdi_floor = functools.partial(metrics.rdi_floor, drift.visit_nm, visit_hours=hours, separation_arcsec=where)
    walks = (drift.walk_nm_per_sqrt_hour, 0.0)
    floor, frozen = (star_e_s * float(rdi_floor(walk_nm_per_sqrt_hour=walk)) for walk in walks)
    walk = math.sqrt(max(floor**2 - frozen**2, 0.0))
    if planet.inside:
        return _FLOOR_LEAST * floor, _FLOOR_MOST * floor, _FLOOR_MOST * walk
    beat = math.sqrt(2.0 * planet.halo_e_s * planet.scattered_e_s + planet.scattered_e_s**2)
    return 0.0, max(_FLOOR_MOST * floor, _BEAT * beat), max(_FLOOR_MOST * walk, _BEAT * beat if walk else 0.0)


def _lasting(
    metrics: PsfMetrics, drift: Drift, planet: PlanetPlace, visit_s: float, visits: int, timing: Timing
) -> Lasting:
    """Return what a programme's speckles have besides those of its visits alone, at the place of a planet."""

    def summed(**changes: float) -> float:
        """Return the variance of the mean rate of the programme, times its visits."""
        law = programme_law(metrics, drift.model_copy(update=changes), where, _ANNULUS_LAMBDA_D, timing=timing)
        return visits * float(law.law(visits).variance(visit_s))

    where = math.hypot(planet.x_arcsec, planet.y_arcsec)
    alone = summed(common_fraction=0.0, orbital_nm=0.0)
    both = (summed(orbital_nm=0.0) - alone, summed(common_fraction=0.0) - alone)
    return Lasting(*(max(part, 0.0) / max(alone, 1e-300) for part in both))


def _flaws_e(detector: Any, corner: tuple[int, int], side: int, planet: PlanetPlace) -> float:
    """Return the dark current of hot pixels and bad columns in an aperture, by squared weights, e-/s."""
    if not isinstance(detector, Detector) or not detector.switches.dark:
        return 0.0
    flaws, _ = stamp_flaws(detector, corner, side)
    return sum(
        float((planet.weights**2 * flaws[key].dark_e_s[planet.place]).sum())
        for key in ("bad_pixels", "bad_columns")
        if getattr(detector.switches, key)
    )


def _measured(sources: Sequence[Source], planets: Sequence[str] | None) -> tuple[str, ...]:
    known = tuple(source.name for source in sources if source.kind == "planet")
    if planets is None:
        return known
    for name in planets:
        if name not in known:
            raise InputError("planets", name, allowed=", ".join(known) or "none: the scene has no planet")
    return tuple(planets)


def _column_peak(metrics: PsfMetrics, light: SceneLight, star_e_s: float, *, moved: bool) -> float:
    """Return the brightest pixel whose overflow may reach the hole along its column or row."""
    star = metrics.peak_off_axis if moved else metrics.peak_on_axis_columns
    return max([star_e_s * star, *(source.peak_e_s for source in light.sources if source.kind == "star")])
