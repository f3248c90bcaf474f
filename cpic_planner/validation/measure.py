"""Measurement of one realisation: the blind search decides, forced photometry gives the flux."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpic_core import BoolArray, FloatArray, Reason
from cpic_planner.validation.apertures import aperture_weights, outside_discs
from cpic_planner.validation.astrometry import Astrometry, fit_position
from cpic_planner.validation.detection import BlindSearch, Candidate, search
from cpic_planner.validation.photometry import EXCLUSION_RADII, Photometry, aperture_photometry
from cpic_planner.validation.realise import Realisation, VisitPair
from cpic_planner.validation.roll import roll_photometry
from cpic_planner.validation.speckle_maps import speckle_maps
from cpic_planner.validation.star_flux import StarFlux
from simulator.imaging import BandGeometry, HoleZone
from simulator.target import scene_sources

LEAST_COVERED = 0.9
"""Share of an aperture that must be left by limits and rejection."""
MATCH_LAMBDA_D = 0.5
"""A detection this close to the planet's place is the planet."""


@dataclass(frozen=True, eq=False)
class PlanetTemplate:
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


def planet_templates(visits: VisitPair) -> tuple[PlanetTemplate, ...]:
    """The planets that the task measures, in its order, with what the measurement of each needs."""
    geometry, task = visits.geometry, visits.task
    radius = geometry.aperture_radius_arcsec / geometry.pixel_scale_arcsec
    side = geometry.stamp_pixels
    edge_arcsec = side // 2 * geometry.pixel_scale_arcsec
    shown = (visits.plan.science, visits.plan.reference)[: 2 if visits.plan.shows_planet else 1]
    every = [
        scene_sources(visits.plan.science_scene, visits.instrument, task.band, roll_deg=visit["roll_deg"])[1:]
        for visit in shown
    ]
    found = []
    for index, source in enumerate(every[0]):
        if source.kind != "planet" or source.name not in task.planets:
            continue
        places = tuple((sources[index].x_arcsec, sources[index].y_arcsec) for sources in every)
        others = tuple(
            _pixels(geometry, (other.x_arcsec, other.y_arcsec))
            for sources in every
            for number, other in enumerate(sources)
            if number != index and max(abs(other.x_arcsec), abs(other.y_arcsec)) < edge_arcsec
        )
        templates = tuple(visits.optics.at(*place) for place in places)
        apertures = tuple(aperture_weights((side, side), *_pixels(geometry, place), radius) for place in places)
        annulus = geometry.annulus(float(np.hypot(*places[0])), visits.strategy.annulus_lambda_d)
        background = outside_discs(annulus, others, EXCLUSION_RADII * radius)
        planet = PlanetTemplate(
            name=source.name,
            places_arcsec=places,
            templates=templates,
            apertures=apertures,
            cores=tuple(float(np.sum(image * weights)) for image, weights in zip(templates, apertures, strict=True)),
            background=background,
            others=others,
        )
        found.append(planet)
    return tuple(found)


def _pixels(geometry: BandGeometry, place_arcsec: tuple[float, float]) -> tuple[float, float]:
    """Column and row of a place on the stamp."""
    middle, pixel = geometry.stamp_pixels // 2, geometry.pixel_scale_arcsec
    return middle + place_arcsec[0] / pixel, middle + place_arcsec[1] / pixel


def edge_crossed(zone: HoleZone, x_arcsec: float, y_arcsec: float, radius_arcsec: float) -> Reason:
    """Which edge of the dark hole the aperture of a source crosses that does not lie in it.

    Parameters
    ----------
    zone : HoleZone
    x_arcsec, y_arcsec : float
        Offsets of the source from the star on the detector.
    radius_arcsec : float
        Radius of the aperture.
    """
    near, far = sorted((abs(x_arcsec), abs(y_arcsec)))
    inner = near - radius_arcsec < zone.inner_arcsec and far + radius_arcsec <= zone.outer_arcsec
    return Reason.INSIDE_INNER_EDGE if inner else Reason.OUTSIDE_OUTER_EDGE


def obstacle(planet: PlanetTemplate, geometry: BandGeometry) -> tuple[Reason, str] | None:
    """Why a planet cannot be measured whatever the frames hold, in a word and a sentence; None where it can.

    Parameters
    ----------
    planet : PlanetTemplate
    geometry : BandGeometry
    """
    for (x, y), weights in zip(planet.places_arcsec, planet.apertures, strict=True):
        if not _is_covered(geometry.hole, weights):
            rolls = " at one of the two rolls" if len(planet.apertures) > 1 else ""
            reason = edge_crossed(geometry.zone, x, y, geometry.aperture_radius_arcsec)
            return reason, f"the mask or the edge of the dark hole hides the planet{rolls}"
    if not _tells_noise(geometry.hole, planet):
        return Reason.TOO_FEW_ELEMENTS, "other sources leave no room around the planet to measure the noise in"
    return None


def _is_covered(region: BoolArray, weights: FloatArray) -> bool:
    """Whether enough of an aperture lies in a region."""
    return float(np.sum(weights * region) / np.sum(weights)) >= LEAST_COVERED


def _tells_noise(region: BoolArray, planet: PlanetTemplate) -> bool:
    """Whether enough of the annulus that tells the noise lies in a region."""
    whole = np.count_nonzero(planet.background)
    return bool(np.count_nonzero(planet.background & region) >= 0.5 * whole > 0)


def measure_planets(
    visits: VisitPair, realisation: Realisation, planets: Sequence[PlanetTemplate], star: StarFlux
) -> tuple[list[Measurement | None], BlindSearch | None]:
    """Search one realisation blind, then measure every planet at its place.

    Parameters
    ----------
    visits : Visits
    realisation : Realisation
    planets : sequence of PlanetTemplate
        `planet_templates` the visits.
    star : StarFlux
        Rate of the star that contrasts refer to.

    Returns
    -------
    measurements : list of Measurement or None
        In the order of the planets; None where a limit took the aperture or the background around it away.
    blind : BlindSearch or None
        None for two rolls, where each half shows every planet twice: the threshold for a known place decides there.
    """
    stack, geometry = realisation.reduced, visits.geometry
    blind = None
    if realisation.roll is None:
        maps = speckle_maps(visits.optics, visits.instrument.drift)
        blind = search(stack, visits.optics, maps, star_rate_e_s=star.rate_e_s, sigma=visits.strategy.sigma)
    found: list[Measurement | None] = []
    for planet, expected in zip(planets, visits.task.predictions, strict=True):
        covered = all(_is_covered(stack.region, weights) for weights in planet.apertures)
        if not covered or not _tells_noise(stack.region, planet):
            found.append(None)
            continue
        measured = forced_photometry(realisation, planet, geometry)
        star_e = measured.throughput * planet.core * star.rate_e_s * stack.integration_s
        match = None if blind is None else _match(blind, planet, geometry)
        seen = measured.significance >= expected["threshold"] if blind is None else bool(match and match.detected)
        one = Measurement(
            contrast=measured.raw_flux / star_e,
            contrast_error=measured.error * measured.throughput / star_e,
            contrast_sigma=measured.sigma_background / star_e,
            snr=measured.snr,
            significance=measured.significance,
            throughput=measured.throughput,
            n_apertures=measured.n_background_apertures,
            modes=stack.rdi.modes_used,
            found=seen,
            search_snr=match.snr_mf if match else None,
            search_threshold=match.threshold if match else None,
        )
        found.append(one)
    return found, blind


def forced_photometry(realisation: Realisation, planet: PlanetTemplate, geometry: BandGeometry) -> Photometry:
    """Flux of a planet at its place, over the fraction that the subtraction leaves; of two rolls the mean.

    Parameters
    ----------
    realisation : Realisation
    planet : PlanetTemplate
    geometry : BandGeometry
    """
    radius = geometry.aperture_radius_arcsec / geometry.pixel_scale_arcsec
    stack, roll = realisation.reduced, realisation.roll
    first, *second = (_pixels(geometry, place) for place in planet.places_arcsec)
    around = planet.background & stack.region
    if roll is not None:
        one, two = planet.templates
        return roll_photometry(
            roll,
            one,
            two,
            first,
            second[0],
            radius,
            background_region=around,
            em_gain=stack.em_gain,
            stages=stack.stages,
        )
    ring = outside_discs(around, [first], EXCLUSION_RADII * radius)
    left = stack.rdi.throughput(planet.templates[0], planet.apertures[0], background=ring)
    return aperture_photometry(
        stack.image_e,
        *first,
        radius,
        background_region=around,
        throughput=left,
        em_gain=stack.em_gain,
        stages=stack.stages,
    )


def _match(blind: BlindSearch, planet: PlanetTemplate, geometry: BandGeometry) -> Candidate | None:
    """The strongest candidate at the planet's place."""
    near = blind.near(*planet.places_arcsec[0], MATCH_LAMBDA_D * geometry.lambda_d_arcsec)
    return max(near, key=lambda item: item.snr_mf, default=None)


def positions_of(
    visits: VisitPair, realisation: Realisation, blind: BlindSearch, planet: PlanetTemplate
) -> Astrometry | None:
    """Fitted position of a planet that the search found; None where it did not.

    Parameters
    ----------
    visits : Visits
    realisation : Realisation
    blind : BlindSearch
    planet : PlanetTemplate
    """
    match = _match(blind, planet, visits.geometry)
    if match is None or not match.detected:
        return None
    pixel, middle = visits.geometry.pixel_scale_arcsec, visits.geometry.stamp_pixels // 2
    others = [((x - middle) * pixel, (y - middle) * pixel) for x, y in planet.others]
    return fit_position(
        realisation.reduced,
        visits.optics,
        match.x_arcsec,
        match.y_arcsec,
        roll_deg=visits.plan.science["roll_deg"],
        exclude=others,
    )
