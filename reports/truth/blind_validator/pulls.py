"""Injected planets at random places: is the corrected flux right, and is its error?"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from cases import star_alone

from cpic_planner.validation import PlanetTemplate, VisitPair, fit_position
from cpic_planner.validation.measure import forced_photometry, place_at, with_image
from simulator.detectors import excess_noise_factor2

BAND_STARS = {"F520": "tau Cet", "F662": "alf Cen A", "F720": "tau Cet", "F850": "tau Cet"}
SNR = 30.0
PER_PLACE = 10
MIN_APERTURES, MIN_ELEMENTS = 25.0, 3.0  # where the ETC lets a planet stand


def random_subject(visits: VisitPair, rng: np.random.Generator) -> PlanetTemplate:
    """A planet anywhere in the hole where a detection is defined."""
    geometry = visits.geometry
    edge = geometry.zone.outer_arcsec
    while True:
        x, y = (float(part) for part in rng.uniform(-edge, edge, 2))
        if not geometry.zone.covers(np.array([y]), np.array([x]), -geometry.aperture_radius_arcsec)[0, 0]:
            continue
        annulus = geometry.annulus(math.hypot(x, y), visits.strategy.annulus_lambda_d)
        room = np.count_nonzero(annulus) >= MIN_APERTURES * geometry.aperture_pixels
        if room and geometry.resolution_elements(math.hypot(x, y)) >= MIN_ELEMENTS:
            break
    return with_image(visits, place_at(geometry, visits.strategy, "injected", ((x, y),)))


def pull_block(star: str, band: str, seed: int, block: int, snr: float = SNR) -> list[dict[str, Any]]:
    """Realisations of one place: the planet is as bright as the noise there asks for the given SNR."""
    visits = star_alone(star, band, seed)
    rng = np.random.default_rng([seed, block])
    subject, geometry = random_subject(visits, rng), visits.geometry
    first = 1 + block * (PER_PLACE + 1)
    dark = visits.draw(first)
    sigma = forced_photometry(dark, subject, geometry).sigma_background
    factor2 = float(excess_noise_factor2(visits.task.em_gain, visits.science.instrument.detector.register_stages))
    flux = 0.5 * (snr**2 * factor2 + math.sqrt((snr**2 * factor2) ** 2 + 4.0 * (snr * sigma) ** 2))
    rate = flux / dark.reduced.integration_s / subject.core  # of all visits
    lit = visits.with_light(rate * subject.templates[0])
    x, y = subject.places_arcsec[0]
    rows = []
    for number in range(first + 1, first + 1 + PER_PLACE):
        realised = lit.draw(number)
        measured = forced_photometry(realised, subject, geometry)
        row = {
            "band": band,
            "relative_flux": measured.flux / flux,
            "relative_error": measured.error / flux,
            "snr": measured.snr,
        }
        found = fit_position(realised.reduced, visits.optics, x, y)
        unit = np.array([x, y]) / math.hypot(x, y)
        offset = np.array([found.x_arcsec - x, found.y_arcsec - y])
        covariance = found.covariance[:2, :2]
        across = np.array([-unit[1], unit[0]])
        for name, axis in (("radial", unit), ("tangential", across)):
            row[f"{name}_pull"] = float(axis @ offset / math.sqrt(axis @ covariance @ axis))
        rows.append(row)
    return rows
