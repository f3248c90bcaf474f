"""Measurement of one realisation: the blind search decides, forced photometry gives the flux."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpic_core import BoolArray, FloatArray
from cpic_planner.validation.apertures import aperture_weights
from cpic_planner.validation.astrometry import Astrometry, fit_position
from cpic_planner.validation.detection import BlindSearch, Candidate, search
from cpic_planner.validation.photometry import EXCLUSION_RADII, Photometry, aperture_photometry
from cpic_planner.validation.realise import Realised, Visits
from cpic_planner.validation.roll import roll_photometry
from cpic_planner.validation.speckle_maps import speckle_maps
from cpic_planner.validation.star_flux import StarFlux
from simulator.imaging import BandGeometry
from simulator.target import scene_sources

LEAST_COVERED = 0.9
"""Share of an aperture that must be left by limits and rejection."""
MATCH_LAMBDA_D = 0.5
"""A detection this close to the planet's place is the planet."""


@dataclass(frozen=True, eq=False)
class Subject:
    """A planet to be measured: where it stands, and its image there, in one or two rolls.

    Attributes
    ----------
    name : str
    places_arcsec : tuple
        Offsets (x, y) on the detector, one a roll.
    templates : tuple of ndarray, shape (n, n)
        Image of a unit source there.
    apertures : tuple of ndarray, shape (n, n)
        Weights of the aperture there.
    cores : tuple of float
        Core throughput.
    background : ndarray of bool, shape (n, n)
        Annulus that measures background and scatter; other sources are out of it.
    others : tuple
        Places of other sources, pixels (x, y).
    """

    name: str
    places_arcsec: tuple[tuple[float, float], ...]
    templates: tuple[FloatArray, ...]
    apertures: tuple[FloatArray, ...]
    cores: tuple[float, ...]
    background: BoolArray
    others: tuple[tuple[float, float], ...]

    @property
    def core(self) -> float:
        """Mean core throughput over the rolls."""
        return float(np.mean(self.cores))


@dataclass(frozen=True)
class Measurement:
    """One planet in one realisation.

    Attributes
    ----------
    contrast : float
        Planet over star.
    contrast_error : float
        1 sigma of its noise; the star's own error is common to all realisations and not in it.
    contrast_sigma : float
        The same without the planet's noise.
    snr, significance : float
        Of forced photometry.
    throughput : float
        What the subtraction leaves.
    n_apertures : int
        Apertures behind the scatter.
    modes : int
        Modes that were subtracted.
    found : bool
        Whether the blind search detects it there.
    search_snr, search_threshold : float or None
        Of the candidate that it is; None where there is none.
    """

    contrast: float
    contrast_error: float
    contrast_sigma: float
    snr: float
    significance: float
    throughput: float
    n_apertures: int
    modes: int
    found: bool
    search_snr: float | None
    search_threshold: float | None


def subjects_of(visits: Visits) -> tuple[Subject, ...]:
    """The planets that the task measures, in its order, with what the measurement of each needs."""
    geometry, strategy = visits.geometry, visits.strategy
    pixel, middle = geometry.pixel_scale_arcsec, geometry.stamp_pixels // 2
    radius = geometry.aperture_radius_arcsec / pixel
    rolls = [visits.plan.science["roll_deg"]]
    if visits.plan.shows_planet:
        rolls.append(visits.plan.reference["roll_deg"])
    every = [
        scene_sources(visits.plan.science_scene, visits.instrument, visits.task.band, roll_deg=roll)[1:]
        for roll in rolls
    ]
    found = []
    for index, source in enumerate(every[0]):
        if source.kind != "planet" or source.name not in visits.task.planets:
            continue
        places = tuple((sources[index].x_arcsec, sources[index].y_arcsec) for sources in every)
        others = tuple(
            (middle + other.x_arcsec / pixel, middle + other.y_arcsec / pixel)
            for sources in every
            for number, other in enumerate(sources)
            if number != index and max(abs(other.x_arcsec), abs(other.y_arcsec)) < middle * pixel
        )
        templates = tuple(visits.optics.at(*place) for place in places)
        apertures = tuple(
            aperture_weights(templates[0].shape, middle + x / pixel, middle + y / pixel, radius) for x, y in places
        )
        annulus = geometry.annulus(float(np.hypot(*places[0])), strategy.annulus_lambda_d)
        cores = tuple(float(np.sum(t * w)) for t, w in zip(templates, apertures, strict=True))
        found.append(
            Subject(
                source.name,
                places,
                templates,
                apertures,
                cores,
                _without(annulus, others, EXCLUSION_RADII * radius),
                others,
            )
        )
    return tuple(found)


def _without(region: BoolArray, places: Sequence[tuple[float, float]], radius: float) -> BoolArray:
    rows, columns = np.indices(region.shape)
    for x, y in places:
        region = region & (np.hypot(columns - x, rows - y) > radius)
    return region


def measure(
    visits: Visits, realised: Realised, subjects: Sequence[Subject], star: StarFlux
) -> tuple[list[Measurement | None], BlindSearch | None]:
    """Search one realisation blind, then measure every planet at its place.

    Parameters
    ----------
    visits : Visits
    realised : Realised
    subjects : sequence of Subject
        `subjects_of` the visits.
    star : StarFlux
        Rate of the star that contrasts refer to.

    Returns
    -------
    measurements : list of Measurement or None
        In the order of the subjects; None where a limit took the aperture or the background around it away.
    blind : BlindSearch or None
        None for two rolls, where each half shows every planet twice: the threshold for a known place decides there.
    """
    stack, geometry = realised.reduced, visits.geometry
    blind = None
    if realised.roll is None:
        maps = speckle_maps(visits.optics, visits.instrument.drift)
        blind = search(stack, visits.optics, maps, star_rate_e_s=star.rate_e_s, sigma=visits.strategy.sigma)
    found: list[Measurement | None] = []
    for number, subject in enumerate(subjects):
        if not _measurable(stack.region, subject):
            found.append(None)
            continue
        measured = forced_photometry(realised, subject, geometry)
        scale = measured.throughput * subject.core * star.rate_e_s * stack.integration_s
        match = None if blind is None else _match(blind, subject, geometry)
        threshold = visits.task.predictions[number]["threshold"]
        seen = measured.significance >= threshold if blind is None else match is not None and match.detected
        found.append(
            Measurement(
                contrast=measured.raw_flux / scale,
                contrast_error=measured.error * measured.throughput / scale,
                contrast_sigma=measured.sigma_background / scale,
                snr=measured.snr,
                significance=measured.significance,
                throughput=measured.throughput,
                n_apertures=measured.n_background_apertures,
                modes=stack.rdi.modes_used,
                found=bool(seen),
                search_snr=None if match is None else match.snr_mf,
                search_threshold=None if match is None else match.threshold,
            )
        )
    return found, blind


def _measurable(region: BoolArray, subject: Subject) -> bool:
    """Whether enough pixels are left of the aperture, and of the annulus that tells the noise."""
    left = subject.background & region
    enough = np.count_nonzero(left) >= 0.5 * np.count_nonzero(subject.background) > 0
    covered = min(float(np.sum(w * region) / np.sum(w)) for w in subject.apertures)
    return bool(enough and covered >= LEAST_COVERED)


def forced_photometry(realised: Realised, subject: Subject, geometry: BandGeometry) -> Photometry:
    """Flux of a planet at its place, over the fraction that the subtraction leaves; of two rolls the mean.

    Parameters
    ----------
    realised : Realised
    subject : Subject
    geometry : BandGeometry
    """
    pixel, middle = geometry.pixel_scale_arcsec, geometry.stamp_pixels // 2
    radius = geometry.aperture_radius_arcsec / pixel
    stack = realised.reduced
    places = [(middle + x / pixel, middle + y / pixel) for x, y in subject.places_arcsec]
    background = subject.background & stack.region
    if realised.roll is not None:
        return roll_photometry(
            realised.roll,
            subject.templates[0],
            subject.templates[1],
            places[0],
            places[1],
            radius,
            background_region=background,
            em_gain=stack.em_gain,
            stages=stack.stages,
        )
    ring = _without(background, places, EXCLUSION_RADII * radius)
    through = stack.rdi.throughput(subject.templates[0], subject.apertures[0], background=ring)
    return aperture_photometry(
        stack.image_e,
        *places[0],
        radius,
        background_region=background,
        throughput=through,
        em_gain=stack.em_gain,
        stages=stack.stages,
    )


def _match(blind: BlindSearch, subject: Subject, geometry: BandGeometry) -> Candidate | None:
    """The strongest candidate at the planet's place."""
    x, y = subject.places_arcsec[0]
    reach = MATCH_LAMBDA_D * geometry.lambda_d_arcsec
    near = [item for item in blind.candidates if math.hypot(item.x_arcsec - x, item.y_arcsec - y) <= reach]
    return max(near, key=lambda item: item.snr_mf, default=None)


def positions_of(visits: Visits, realised: Realised, blind: BlindSearch, subject: Subject) -> Astrometry | None:
    """Fitted position of a planet that the search found; None where it did not.

    Parameters
    ----------
    visits : Visits
    realised : Realised
    blind : BlindSearch
    subject : Subject
    """
    match = _match(blind, subject, visits.geometry)
    if match is None or not match.detected:
        return None
    pixel, middle = visits.geometry.pixel_scale_arcsec, visits.geometry.stamp_pixels // 2
    others = [((x - middle) * pixel, (y - middle) * pixel) for x, y in subject.others]
    return fit_position(
        realised.reduced,
        visits.optics,
        match.x_arcsec,
        match.y_arcsec,
        roll_deg=visits.plan.science["roll_deg"],
        exclude=others,
    )
