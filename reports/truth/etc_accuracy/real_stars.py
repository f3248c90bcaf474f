"""Planets of real stars as stacks to be drawn: the ETC's own rates, on the pixels of the images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from monte_carlo import Aperture, Readout, Stack, aperture_on

from cpic_planner.etc import EtcModel, StackNoise, aperture_rates, diagonal, stack_noise
from cpic_planner.targets import find_target
from simulator import single_band_psf

FRAMES = 30
PLACES = ((0.0, 0.0), (0.5, 0.5), (0.25, -0.25), (-0.4, 0.1))  # pixels


@dataclass(frozen=True)
class Planet:
    """A planet of a star and how it is observed."""

    star: str
    band: str
    separation_arcsec: float
    contrast: float
    exposure_s: float
    em_gain: float


PLANETS = (
    Planet("tau Cet", "F520", 0.65, 5e-8, 17.0, 20.0),
    Planet("tau Cet", "F520", 0.65, 5e-8, 17.0, 300.0),
    Planet("tau Cet", "F662", 0.5, 1e-8, 60.0, 1000.0),
    Planet("alf Cen B", "F520", 0.65, 5e-8, 17.0, 20.0),
    Planet("eps Eri", "F720", 0.6, 1e-8, 100.0, 1000.0),
    Planet("eps Eri", "F850", 0.7, 3e-8, 100.0, 300.0),
)


@dataclass(frozen=True, eq=False)
class Said:
    """What to draw, and what the ETC says of it."""

    stack: Stack
    places: list[Aperture]
    readout: Readout
    noise: StackNoise
    core_throughput: float


def prepared(model: EtcModel, planet: Planet) -> Said:
    """Rates of the ETC for a planet on the diagonal, its light on pixels from the images."""
    band, camera = planet.band, model.camera(planet.band)
    target, _ = find_target(planet.star)
    metrics = model.metrics[band]
    x, y = diagonal(metrics.zone, np.array([planet.separation_arcsec]))
    rates = aperture_rates(model, target, band, x, y, np.array([planet.contrast]))
    visit_s = FRAMES * (planet.exposure_s + camera.readout_s)
    stack = Stack(
        float(rates.planet_e_s[0]),
        float(rates.background_e_s[0] + rates.smear_e[0] / planet.exposure_s),  # smear: so much in every frame
        planet.exposure_s,
        FRAMES,
        planet.em_gain,
        speckle_e_s=float(np.sqrt(rates.speckle.law().variance(visit_s)[0])),
        loss_per_s=float(rates.loss_per_s),
        background_apertures=round(float(rates.background_apertures[0])),
    )
    readout = Readout(camera.read_noise_e, model.instrument.detector.gain_e_adu, camera.cic_e, camera.register_stages)
    noise = stack_noise(rates, planet.exposure_s, FRAMES, planet.em_gain, camera)
    places = on_pixels(model, band, float(x[0]), float(y[0]))
    return Said(stack, places, readout, noise, float(metrics.core_throughput(x, y)[0]))


def on_pixels(model: EtcModel, band: str, x_arcsec: float, y_arcsec: float) -> list[Aperture]:
    """Apertures about a planet near a position, at several places within a pixel."""
    psf, places = single_band_psf(band, instrument=model.instrument), []
    pixel, middle = psf.pixel_scale_arcsec, len(psf.on_axis) // 2
    radius, column, row = psf.metrics.aperture_radius_arcsec / pixel, round(x_arcsec / pixel), round(y_arcsec / pixel)
    for dy, dx in PLACES:
        image = psf.at((column + dx) * pixel, (row + dy) * pixel)
        near = image[middle + row - 8 : middle + row + 9, middle + column - 8 : middle + column + 9]
        places.append(aperture_on(radius, near, offset_y=dy, offset_x=dx))
    return places
