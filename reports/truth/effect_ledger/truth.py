"""True error of a shortcut against the same observation without one, from noiseless images and closed-form variances.

Nothing here reads the ledger's formulas. Means are those of the image chain (`Observation.expected`); variances follow
from its electrons at the register and the textbook excess noise factor; particles are drawn; the speckle residual is
that of pairs of visits propagated through either optics.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scenes import RandomCase

from cpic_core import stream
from simulator import observe
from simulator.config import CosmicRayConfig
from simulator.detectors import Exposure
from simulator.effects import cosmic_ray_rate, draw_cosmic_rays
from simulator.imaging import centred_axis, off_axis_light
from simulator.imaging.drift import screen_model, wavefronts
from simulator.knobs import Knobs
from simulator.ledger.choice import DRIFT_TERMS
from simulator.observing import Observation
from simulator.observing.sequence import Light

FloatArray = NDArray[np.float64]
EPOCHS, PAIRS, PATCH = 6, 8, 11
CIRCLE = 15  # points a pixel and axis for the overlap of a circle


@dataclass(frozen=True)
class Difference:
    """True change of every quantity."""

    planet_flux: float
    snr: float
    pixel_map: float


def pair_of(case: RandomCase) -> tuple[Observation, Observation, float, float]:
    """The observation without a tolerance, the shortcut, and the processor time of setting up each."""
    settings, found, seconds = _settings(case), [], []
    for more in ({}, {"tolerance": case.tolerance, "quantity": case.quantity}):
        began = time.process_time()
        found.append(observe(case.scene, **settings, **more))
        seconds.append(time.process_time() - began)
    return found[0], found[1], seconds[0], seconds[1]


def _settings(case: RandomCase) -> dict[str, Any]:
    return case.settings | {"instrument": case.instrument, "window": "hole", "seed": 5, "max_epochs": EPOCHS}


def measure(case: RandomCase) -> tuple[Observation, Observation, Difference]:
    """Both, and how far they are apart."""
    whole, short, *_ = pair_of(case)
    return whole, short, true_difference(whole, short)


def alone(case: RandomCase, short: Observation, key: str) -> Observation:
    """The observation without a tolerance, but for one thing that the shortcut left out or lowered."""
    settings = _settings(case)
    scene = case.scene
    if key in ("wavelength_nodes", "pixel_nodes", "precision"):
        settings["fidelity"] = Knobs().model_copy(update={key: getattr(short.psf.knobs, key)})
    elif key == "drift_epochs":
        settings["max_epochs"] = short.light.epochs
    elif ":" in key:
        name = key.split(":", 1)[1]
        stars, planets = (tuple(body for body in part if body.name != name) for part in (scene.stars, scene.planets))
        scene = scene.model_copy(update={"stars": stars, "planets": planets})
    elif key in DRIFT_TERMS:
        still = case.instrument.drift.model_copy(update={DRIFT_TERMS[key]: 0.0})
        settings["instrument"] = case.instrument.model_copy(update={"drift": still})
    else:
        settings["switches"] = {key: False}
    return observe(scene, **settings)


def true_difference(whole: Observation, short: Observation, *, kept_planets: bool = True) -> Difference:
    """True change of flux and SNR of every planet (the largest), and of the worst pixel."""
    flux, snr = [0.0], [0.0]
    planets = [source for source in whole.truth.sources if source.kind == "planet"] if kept_planets else []
    for source in planets:
        ours, theirs = (_planet(one, source.name) for one in (whole, short))
        if ours[0] <= 0:
            continue
        flux.append(abs(theirs[0] / ours[0] - 1.0))
        snr.append(abs(theirs[0] / ours[0] * math.sqrt(ours[1] / theirs[1]) - 1.0) if theirs[1] > 0 else math.inf)
    return Difference(max(flux), max(snr), _pixel(whole, short))


def _planet(seen: Observation, name: str) -> tuple[float, float]:
    """Aperture sum of a planet over the visit, and the variance of that sum, electrons."""
    index = [source.name for source in seen.truth.sources].index(name)
    detector, t, frames, gain = seen.instrument.detector, seen.exposure_s, seen.n_frames, seen.em_gain
    y, x = seen.truth.y_pixel[index], seen.truth.x_pixel[index]
    radius = seen.psf.metrics.aperture_radius_arcsec / seen.pixel_scale_arcsec
    weights = circle(seen.shape, y, x, radius)
    with_it, without = seen.expected, _adu(seen, seen.mean_rate_map - _light_of(seen, index))
    per_adu = detector.gain_e_adu / gain
    clean = math.exp(-_lost_per_s(seen, radius) * t)
    signal = frames * per_adu * float((weights * (with_it - without)).sum())
    white = frames * float((weights**2 * _variance(seen, particles=False)).sum())
    speckle = (frames * t * seen.truth.sources[0].rate_e_s) ** 2 * _speckle(seen, y, x, radius)
    return signal, white / clean + speckle


def _light_of(seen: Observation, index: int) -> FloatArray:
    """Electrons per second of one source alone, if it is modelled."""
    source = seen.truth.sources[index]
    if seen.choice is not None and source.name in seen.choice.left_out:
        return np.zeros(seen.shape)
    return off_axis_light(seen.psf, seen.area, [source], (), roll_deg=seen.roll_deg)


def _adu(seen: Observation, rates: FloatArray) -> FloatArray:
    alone = dataclasses.replace(seen, light=Light(np.maximum(rates, 0.0), beyond_e_s=seen.light.beyond_e_s))
    return alone.expected


def _register_input(seen: Observation, rates: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean electrons at the input of the register, and the slope of ADU against them."""
    camera = seen.camera_chain
    exposure = camera.prepare(
        rates, seen.exposure_s, seen.em_gain, first_pixel=seen.first_pixel, beyond_e_s=seen.light.beyond_e_s
    )
    image = exposure.mean_e.copy()
    for effect in camera.charge:
        if effect.switch == "em_register":
            break
        effect.expect(image, exposure)
    return image, _slope(seen, image, exposure)


def _slope(seen: Observation, image: FloatArray, exposure: Exposure) -> FloatArray:
    del exposure
    detector, curve = seen.instrument.detector, seen.instrument.detector.nonlinearity
    if not detector.switches.nonlinearity:
        return np.ones(image.shape)
    loss = curve.pixel_loss_at_full_well
    pixel = loss / ((1 - loss) * detector.full_well_e)
    output = curve.register_loss / ((1 - curve.register_loss) * curve.register_loss_at_e)
    return 1.0 / (1 + pixel * image) ** 2 / (1 + output * seen.em_gain * image) ** 2


def _variance(seen: Observation, *, particles: bool, rates: FloatArray | None = None) -> FloatArray:
    """Variance of a pixel of one frame, referred to the register input."""
    detector, gain = seen.instrument.detector, seen.em_gain
    switches, stages = detector.switches, detector.register_stages
    image, slope = _register_input(seen, seen.mean_rate_map if rates is None else rates)
    made = detector.cic_e if switches.clock_charge else 0.0
    counts = image if switches.photon_noise else np.full(image.shape, made)
    # Robbins & Hadwen 2003: 2 (g - 1) g^(-(N + 1)/N) + 1/g.
    factor2 = 2.0 * (gain - 1.0) * gain ** (-(stages + 1.0) / stages) + 1.0 / gain if switches.em_register else 1.0
    structure, per_adu = detector.bias_structure, detector.gain_e_adu / gain
    variance = factor2 * counts * slope**2
    if switches.read_noise:
        variance = variance + detector.read_noise_e**2 / gain**2
    variance = variance + per_adu**2 / 12.0
    if particles:
        if switches.interference:
            variance = variance + 0.5 * (structure.interference_adu * per_adu) ** 2
        if switches.bias_drift:
            variance = variance + (structure.drift_adu * per_adu) ** 2
        if switches.cosmic_rays:
            rays = seen.instrument.cosmic_rays
            rate = cosmic_ray_rate(rays, seen.start_utc) * (detector.pixel_um * 1e-4) ** 2 * seen.exposure_s
            variance = variance + factor2 * rate * _squares(rays, detector.pixel_um)
    return variance


@functools.lru_cache(maxsize=2)
def _squares(rays: CosmicRayConfig, pixel_um: float) -> float:
    """Mean sum of squared charges of a track."""
    area = (1000 * pixel_um * 1e-4) ** 2
    found = draw_cosmic_rays(rays, (1000, 1000), pixel_um, 1.0, 6000.0 / area, np.random.default_rng(77))
    return float((found.electrons.astype(float) ** 2).sum() / found.n_events)


def _lost_per_s(seen: Observation, radius: float) -> float:
    """Rate of tracks through a disc and the reach of their charge around it (Crofton)."""
    if not seen.instrument.detector.switches.cosmic_rays:
        return 0.0
    rays, pixel = seen.instrument.cosmic_rays, seen.instrument.detector.pixel_um
    reach = (radius + 0.25) * pixel + 3.1 * rays.physical.diffusion_um
    length = math.pi / 2 * rays.physical.depth_um
    return cosmic_ray_rate(rays, seen.start_utc) * 1e-8 * (math.pi * reach**2 + 2 * reach * length)


def _speckle(seen: Observation, y: float, x: float, radius: float) -> float:
    """Variance of the aperture sums around a planet that the mean of another visit leaves, per unit star squared."""
    drift, imager = seen.instrument.drift, seen.psf.imager
    hours = (seen.exposure_s + seen.readout_s) * seen.n_frames / 3600.0
    # A walk of covariance min(s, s'), sampled in the middle of its intervals.
    middle = (np.arange(seen.light.epochs) + 0.5) / seen.light.epochs
    sampled = 3.0 * float(np.minimum(middle[:, None], middle).mean())
    rms = math.sqrt(drift.visit_nm**2 + drift.walk_nm_per_sqrt_hour**2 * hours / 3.0 * sampled)
    if rms == 0.0:
        return 0.0
    centres = centred_axis(seen.shape[0], seen.pixel_scale_arcsec)
    spans = [np.clip(np.arange(round(at) - PATCH, round(at) + PATCH + 1), 0, seen.shape[0] - 1) for at in (y, x)]
    rows, columns = (imager.axis(np.unique(centres[span]), masked=True) for span in spans)
    grid, screens = imager.focal_grid(rows, columns), screen_model(len(imager.transmission), drift.psd_slope)
    images = [grid.image(screens.draw(stream(11, "pair", k), rms)) for k in range(PAIRS)]
    place = [at - np.unique(span)[0] for at, span in zip((y, x), spans, strict=True)]
    weights = [circle(images[0].shape, place[0] + dy, place[1] + dx, radius) for dy in (-3, 0, 3) for dx in (-3, 0, 3)]
    sums = np.array([[float((one * image).sum()) for one in weights] for image in images])
    return float(((sums - np.roll(sums, 1, axis=0)) ** 2).mean())


def circle(shape: tuple[int, ...], y: float, x: float, radius: float) -> FloatArray:
    """Part of each pixel inside a circle."""
    fine = (np.arange(CIRCLE) + 0.5) / CIRCLE - 0.5
    rows = (np.arange(shape[0])[:, None] + fine).ravel() - y
    columns = (np.arange(shape[1])[:, None] + fine).ravel() - x
    near = [np.flatnonzero(np.abs(axis) <= radius + 1.0) for axis in (rows, columns)]
    inside = np.zeros((rows.size, columns.size))
    inside[np.ix_(*near)] = np.hypot(rows[near[0]][:, None], columns[near[1]]) <= radius
    return inside.reshape(shape[0], CIRCLE, shape[1], CIRCLE).mean(axis=(1, 3))


def _pixel(whole: Observation, short: Observation) -> float:
    """Largest change of mean or standard deviation of a pixel of any frame, over its standard deviation."""
    per_adu = whole.instrument.detector.gain_e_adu / whole.em_gain
    epochs = short.light.epochs
    same = dataclasses.replace(short, light=_paired_light(whole, short))
    spread = np.sqrt(_variance(whole, particles=True))
    worst = float((np.abs(np.sqrt(_variance(same, particles=True)) - spread) / spread).max())
    frames = range(whole.n_frames)
    for ours, theirs in {tuple(k * n // whole.n_frames for n in (whole.light.epochs, epochs)) for k in frames}:
        change = _adu(whole, whole.light.map(ours)) - _adu(same, same.light.map(theirs))
        worst = max(worst, float((np.abs(change) * per_adu / spread).max()))
    return worst


def _paired_light(whole: Observation, short: Observation) -> Light:
    """Light of the shortcut, its walk that of the other in the middle of its own epochs.

    Fewer epochs draw other steps of the walk; the offset of the visit, and what swings with the orbit, are the same.
    """
    epochs, drift = short.light.epochs, short.instrument.drift
    if epochs == whole.light.epochs or drift.walk_nm_per_sqrt_hour == 0 or short.light.star is None:
        return short.light
    visit_s = (short.exposure_s + short.readout_s) * short.n_frames
    axis = short.psf.imager.stamp_axis(masked=True)
    grid = short.psf.imager.focal_grid(axis, axis)
    screens = screen_model(len(short.psf.imager.transmission), drift.psd_slope)

    def waves(count: int, **still: float) -> list[FloatArray]:
        part = drift.model_copy(update=still)
        streams = short.visit.streams(part, visit_s, short.seed)
        return list(wavefronts(screens, part, count, visit_s / count, *streams))

    walked = waves(whole.light.epochs, orbital_nm=0.0)
    swung, frozen = (waves(epochs, walk_nm_per_sqrt_hour=0.0, **still) for still in ({}, {"orbital_nm": 0.0}))
    middle = [int((k + 0.5) / epochs * len(walked)) for k in range(epochs)]
    stamps = [grid.image(walked[m] + swung[k] - frozen[k]) for k, m in enumerate(middle)]
    rate_e_s = short.truth.sources[0].rate_e_s * np.array(stamps)
    return dataclasses.replace(short.light, star=dataclasses.replace(short.light.star, rate_e_s=rate_e_s))
