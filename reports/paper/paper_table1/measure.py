"""One band of the example: what the calculator predicts, and what comes back from simulated frames."""

from __future__ import annotations

import dataclasses
import functools
import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import astropy.units as u
import numpy as np
from astropy.coordinates import SkyCoord
from astropy.wcs import WCS
from numpy.typing import NDArray

from catalogs import stellar_parameters
from cpic_planner.etc import EtcModel, aperture_rates, build_model, stack_noise
from cpic_planner.etc.noise import snr_paper
from cpic_planner.etc.questions import signal_to_noise
from cpic_planner.report.image_figures import Mark, Panels
from cpic_planner.results import EtcAnswer
from cpic_planner.targets import Targets, find_target
from cpic_planner.validation import (
    CalibratedFrames,
    Photometry,
    aperture_photometry,
    aperture_weights,
    calibrated_frames,
    filled,
    rdi_subtract,
    reject_cosmic_rays,
)
from cpic_planner.validation.photometry import EXCLUSION_RADII
from simulator import Observation, load_instrument, load_scene, observe
from simulator.config import Instrument, Scene, SequenceConfig, load_simulation
from simulator.target import scene_sources

SIMULATION = "paper_table1"
Companions = Literal["on", "off"]
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """A band with its frames, the gain, and whether alpha Cen A shines."""

    band: str
    exposure_s: float
    n_frames: int
    em_gain: float
    companions: Companions = "off"


class Contrast(NamedTuple):
    """Planet-to-star ratio and its 1-sigma error."""

    value: float
    error: float


def contrast_of(
    found: Photometry, core: float, star_rate_e_s: float, time_s: float, star_rate_error_e_s: float = 0.0
) -> Contrast:
    """Contrast of a source: its flux over that of the star through the clear pupil, errors in quadrature.

    ``core`` is the energy of a unit source in its aperture.
    """
    full_scale_e = core * star_rate_e_s * time_s
    value = found.flux / full_scale_e
    return Contrast(value, math.hypot(found.error / full_scale_e, value * star_rate_error_e_s / star_rate_e_s))


def rate_by_field_star(
    found: Photometry, core: float, time_s: float, rate_ratio: float, ratio_relative_error: float = 0.0
) -> tuple[float, float]:
    """Rate of the central star and its error, e-/s, from a star of known magnitude in the same images.

    ``rate_ratio`` is the rate of the central star over that of the field star.
    """
    rate_e_s = found.flux * rate_ratio / (core * time_s)
    return rate_e_s, rate_e_s * math.hypot(found.error / found.flux, ratio_relative_error)


def field_star_ratio(scene: Scene | str, band: str, name: str, instrument: Instrument) -> float:
    """Rate of the central star over that of a star in its field, from their known magnitudes and spectra."""
    sources = scene_sources(load_scene(scene), instrument, band)
    (rate_e_s,) = (source.rate_e_s for source in sources[1:] if source.name == name)
    return sources[0].rate_e_s / rate_e_s


@dataclass(frozen=True, eq=False)
class Measured:
    """What the frames of a case give."""

    case: Case
    planet: Photometry
    contrast: Contrast
    by_star: Contrast
    panels: Panels
    places: dict[str, tuple[float, float]]
    lost_in: int
    lost_outside: float
    rejected: float


@functools.cache
def instrument() -> Instrument:
    """The stated instrument."""
    return load_instrument("paper_table1")


@functools.cache
def sequences() -> tuple[SequenceConfig, ...]:
    """The science sequences of the preset."""
    return tuple(entry for entry in load_simulation(SIMULATION).sequences if entry.role == "science")


@functools.cache
def model() -> EtcModel:
    """The calculator's model of the instrument."""
    return build_model(instrument())


def table_case(entry: SequenceConfig, *, em_gain: float | None = None, companions: Companions = "off") -> Case:
    """The frames of a sequence of the preset."""
    return Case(entry.band[0], entry.exposure_s[0], entry.frames, em_gain or entry.em_gain[0], companions)


def science_scene(companions: Companions) -> Scene:
    """The paper's science scene, with alpha Cen A or without."""
    return load_scene("paper_science").model_copy(update={"companions": companions})


def reference_scene(companions: Companions) -> Scene:
    """The star alone, as in the paper; with alpha Cen A where it shines: no telescope points around it."""
    bound = tuple(star for star in load_scene("paper_science").stars if star.companion)
    return load_scene("paper_reference").model_copy(update={"stars": bound, "companions": companions})


def true_contrast(band: str) -> float:
    """Ratio of detected rates of planet and star."""
    sources = scene_sources(science_scene("off"), instrument(), band)
    return sources[1].rate_e_s / sources[0].rate_e_s


@functools.cache
def target(companions: Companions) -> Targets:
    """Row of the star catalogue with the paper's magnitude, distance and type in place of the measured ones."""
    star, scene = find_target("alf Cen B", companions=companions)[0], load_scene("paper_science").cstar
    assert scene.spectral_type is not None
    assert scene.distance_pc is not None
    typical = stellar_parameters(scene.spectral_type)
    values = {
        "v_mag": scene.v_mag,
        "distance_pc": scene.distance_pc,
        "teff_k": typical.teff_k,
        "log_g": typical.log_g,
        "metallicity": 0.0,
    }
    return dataclasses.replace(star, **{name: np.array([value]) for name, value in values.items()})  # type: ignore[arg-type]


@dataclass(frozen=True)
class Predicted:
    """What the calculator expects of the frames of a case."""

    snr: float
    significance: float
    snr_paper: float
    signal_e: float
    variance_e2: float
    terms: dict[str, float]


def predicted(case: Case, *, read_noise_e: float | None = None, contrast: float | None = None) -> Predicted:
    """Expected signal-to-noise ratio of the frames of a case, whether or not a limit cuts pixels off elsewhere."""
    chosen = model()
    if read_noise_e is not None:
        chosen = build_model(instrument().changed({"detector": {"read_noise_e": read_noise_e}}))
    planet = scene_sources(science_scene("off"), instrument(), case.band)[1]
    x, y, ratio = (
        np.array([[value]]) for value in (planet.x_arcsec, planet.y_arcsec, contrast or true_contrast(case.band))
    )
    rates, camera = aperture_rates(chosen, target(case.companions), case.band, x, y, ratio), chosen.camera(case.band)
    noise = stack_noise(rates, case.exposure_s, case.n_frames, case.em_gain, camera)
    paper = snr_paper(rates, case.exposure_s, case.n_frames, case.em_gain, camera)
    terms = {name: float(np.ravel(value)[0]) for name, value in noise.terms.items()}
    return Predicted(
        float(np.ravel(noise.snr)[0]),
        float(np.ravel(noise.significance)[0]),
        float(np.ravel(paper)[0]),
        float(np.ravel(noise.signal_e)[0]),
        sum(terms.values()),
        terms,
    )


def answered(case: Case, exposure_s: float | None = None) -> EtcAnswer:
    """The calculator's answer for the frames of a case with a gain of its choice: the limits that bind are in it."""
    planet = load_scene("paper_science").planets[0]
    assert planet.separation_arcsec is not None
    frame_s = exposure_s or case.exposure_s
    visit_s = case.n_frames * (frame_s + instrument().detector.readout_s)
    (answer,) = signal_to_noise(
        model(),
        target(case.companions),
        bands=[case.band],
        time_s=float(model().time_s(visit_s)) * (1 + 1e-9),
        separation_arcsec=planet.separation_arcsec,
        contrast=true_contrast(case.band),
        exposure_s=frame_s,
        exact=True,
    )
    return answer


def measured(case: Case) -> Measured:
    """Simulate science and reference frames, reduce them, and measure the planet.

    Every default effect of the camera is on. Calibration with noise-free masters, rejection of cosmic rays, RDI with
    one mode behind the mean; the planet's position is known, its contrast relative to the star's true rate and, as in
    the paper, to the calibration star in the same frames.
    """
    science, reference = (
        observe(
            scene,
            role=role,
            band=case.band,
            exposure_s=case.exposure_s,
            n_frames=case.n_frames,
            em_gain=case.em_gain,
            instrument=instrument(),
            window="hole",
        )
        for scene, role in (
            (science_scene(case.companions), "science"),
            (reference_scene(case.companions), "reference"),
        )
    )
    frames = [calibrated_frames(one) for one in (science, reference)]
    (science_e, seen, share), (reference_e, known, other) = (_clean(one) for one in frames)
    metrics = science.psf.metrics
    region = metrics.hole & seen & known
    cut = rdi_subtract(science_e, reference_e, model().strategy.n_modes, region=region, centering="temporal")
    stack = cut.residuals.sum(axis=0)
    spots = {
        source.name: (x, y, source)
        for source, x, y in zip(science.truth.sources, science.truth.x_pixel, science.truth.y_pixel, strict=True)
    }
    x, y, planet = spots["planet"]
    star_x, star_y, star = spots["calibration star"]
    radius = metrics.aperture_radius_arcsec / science.pixel_scale_arcsec
    rho = float(np.hypot(planet.x_arcsec, planet.y_arcsec))
    annulus = metrics.annulus(rho, model().strategy.annulus_lambda_d) & region
    template = science.psf.at(planet.x_arcsec, planet.y_arcsec)
    weights = aperture_weights(stack.shape, x, y, radius)
    background = _around(annulus, [(x, y), (star_x, star_y)], EXCLUSION_RADII * radius)
    throughput = cut.throughput(template, weights, background=background)
    found = aperture_photometry(
        stack,
        x,
        y,
        radius,
        background_region=annulus,
        exclude=[(star_x, star_y)],
        throughput=throughput,
        em_gain=case.em_gain,
    )
    # The calibration star stands at the edge of the hole: plain difference, level and scatter from the hole.
    difference = np.where(seen & known, science_e.sum(axis=0) - reference_e.sum(axis=0), 0.0)
    near = aperture_photometry(
        difference, star_x, star_y, radius, background_region=region, exclude=[(x, y)], em_gain=case.em_gain
    )
    core, time_s = float((template * weights).sum()), case.exposure_s * case.n_frames
    there = aperture_weights(stack.shape, star_x, star_y, radius) * science.psf.at(star.x_arcsec, star.y_arcsec)
    known_ratio = field_star_ratio(science.scene, case.band, star.name, instrument())
    central = rate_by_field_star(near, float(there.sum()), time_s, known_ratio)
    return Measured(
        case=case,
        planet=found,
        contrast=contrast_of(found, core, science.truth.sources[0].rate_e_s, time_s),
        by_star=contrast_of(found, core, central[0], time_s, central[1]),
        panels=_panels(science, science_e.sum(axis=0), reference_e.sum(axis=0), np.where(region, stack, np.nan)),
        places=_places(science),
        lost_in=sum(one.lost_in for one in frames),
        lost_outside=sum(one.lost_outside for one in frames) / (2 * case.n_frames),
        rejected=max(share, other),
    )


def _clean(frames: CalibratedFrames) -> tuple[FloatArray, NDArray[np.bool_], float]:
    """Frames without particles, the pixels that have a value, and the share of pixel-frames rejected."""
    detector = frames.detector
    hits = reject_cosmic_rays(
        frames.electrons,
        frames.usable,
        em_gain=frames.em_gain,
        read_noise_e=detector.read_noise_e,
        pedestal_e=frames.pedestal_e,
        stages=detector.register_stages,
        gain_e_adu=detector.gain_e_adu,
    )
    whole, covered = filled(frames.electrons, frames.usable & ~hits.rejected)
    return whole, covered, hits.fraction


def _around(region: NDArray[np.bool_], places: list[tuple[float, float]], radius: float) -> NDArray[np.bool_]:
    rows, columns = np.indices(region.shape)
    for x, y in places:
        region = region & (np.hypot(columns - x, rows - y) > radius)
    return region


def sky_pixels(wcs: WCS, scene: Scene) -> dict[str, tuple[float, float]]:
    """Column and row of star, planet and calibration star, from their places on the sky."""
    star = SkyCoord(scene.cstar.ra_deg, scene.cstar.dec_deg, unit="deg")
    there = {"star": star} | {
        body.name: star.directional_offset_by(body.pa_deg * u.deg, body.separation_arcsec * u.arcsec)
        for body in (scene.planets[0], scene.stars[0])
    }
    pixels = {name: wcs.world_to_pixel(place) for name, place in there.items()}
    return {name: (float(column), float(row)) for name, (column, row) in pixels.items()}


def _places(seen: Observation) -> dict[str, tuple[float, float]]:
    """Offsets from the star (arcsec, on the detector) of planet and calibration star."""
    pixels = sky_pixels(WCS(seen.header), seen.scene)
    column, row = pixels.pop("star")
    scale = seen.pixel_scale_arcsec
    return {name: ((x - column) * scale, (y - row) * scale) for name, (x, y) in pixels.items()}


def _panels(seen: Observation, science: FloatArray, reference: FloatArray, residual: FloatArray) -> Panels:
    config, (x, y) = seen.instrument, _places(seen)["planet"]
    return Panels(
        band=seen.band,
        science=science,
        reference=reference,
        residual=residual,
        pixel_scale_arcsec=seen.pixel_scale_arcsec,
        aperture_radius_arcsec=config.aperture_radius_arcsec(seen.band),
        zone=seen.psf.geometry.zone,
        parity=config.detector.parity,
        marks=(Mark(x, y),),
    )
