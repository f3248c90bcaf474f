"""Planets to be measured: where they stand, their images there, and whether images can show them at all.

Whether they can is known before any image is made: `obstacle`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from cpic_core import BoolArray, FloatArray, InputError, Reason
from cpic_planner.queries import FluxFilter, Strategy
from cpic_planner.validation.apertures import (
    MIN_BACKGROUND_APERTURES,
    aperture_weights,
    edge_crossed,
    outside_discs,
    sample_places,
)
from cpic_planner.validation.libraries import LibraryPlan
from cpic_planner.validation.photometry import EXCLUSION_RADII, kernel_at, sum_weights
from cpic_planner.validation.realise import VisitPair
from cpic_planner.validation.task import ConfirmTask
from simulator.config import Instrument
from simulator.imaging import BandGeometry
from simulator.signal import REGION_LAMBDA_D
from simulator.target import scene_sources

LEAST_COVERED = 0.9
"""Share of an aperture that must be left by limits and rejection."""
_WIDER_LAMBDA_D = 0.25  # steps by which a background without room for three apertures is widened

Place: TypeAlias = tuple[float, float]
"""Offsets x and y from the star on the detector, arcsec."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanetPlace:
    """The place of a planet to be measured, in one or two rolls, and the pixels that tell its noise.

    Attributes
    ----------
    name : str
    places_arcsec : tuple
        Offsets (x, y) on the detector, one a roll.
    apertures : tuple of ndarray, shape (n, n)
        Weights of the aperture there.
    background : ndarray of bool, shape (n, n)
        Annulus that measures background and scatter; other sources are out of it.
    others : tuple
        Places of other sources, pixels (x, y).
    """

    name: str
    places_arcsec: tuple[tuple[float, float], ...]
    apertures: tuple[FloatArray, ...]
    background: BoolArray
    others: tuple[tuple[float, float], ...]

    @property
    def separation_arcsec(self) -> float:
        """Separation from the star."""
        return float(np.hypot(*self.places_arcsec[0]))

    def around(self, region: BoolArray, geometry: BandGeometry, filter_name: FluxFilter) -> BoolArray:
        """Return the part of the background in a region that shows nothing of the planet.

        For the filter ``mirror`` nothing of the planet or of other sources either at the opposite places.

        Parameters
        ----------
        region : ndarray of bool, shape (n, n)
        geometry : BandGeometry
        filter_name : {"aperture", "matched", "mirror", "whitened"}
        """
        free, middle = self.background & region, geometry.stamp_pixels - 1
        places = [pixels_of(geometry, place) for place in self.places_arcsec]
        if filter_name == "mirror":
            free &= free[::-1, ::-1]
            places += [(middle - x, middle - y) for x, y in (*places, *self.others)]
        return outside_discs(free, places, EXCLUSION_RADII * radius_pixel(geometry))

    def tells_noise(self, region: BoolArray, geometry: BandGeometry, strategy: Strategy) -> bool:
        """Return whether a region has half of the background, and three apertures in it side by side.

        Parameters
        ----------
        region : ndarray of bool, shape (n, n)
        geometry : BandGeometry
        strategy : Strategy
        """
        whole = np.count_nonzero(self.background)
        if not np.count_nonzero(self.background & region) >= 0.5 * whole > 0:
            return False
        if strategy.n_modes or strategy.filter == "whitened":
            region = region & geometry.annulus(self.separation_arcsec, REGION_LAMBDA_D)
        free, radius = self.around(region, geometry, strategy.filter), radius_pixel(geometry)
        lambda_d = geometry.lambda_d_arcsec / geometry.pixel_scale_arcsec
        for place, aperture in zip(self.places_arcsec, self.apertures, strict=True):
            seen = (np.ones_like(aperture), lambda_d) if strategy.filter == "matched" else (aperture, radius + 1.0)
            try:
                sample_places(free, radius, kernel_at(seen[0], *pixels_of(geometry, place), seen[1]))
            except InputError:  # no room
                return False
        return True


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanetTemplate(PlanetPlace):
    """A planet to be measured, with its image.

    Attributes
    ----------
    templates : tuple of ndarray, shape (n, n)
        Image of a unit source at its place, one a roll.
    cores : tuple of float
        Core throughput.
    neighbours : tuple of ndarray, shape (n, n)
        Images of other unit sources.
    """

    templates: tuple[FloatArray, ...]
    cores: tuple[float, ...]
    neighbours: tuple[FloatArray, ...] = ()

    @property
    def core(self) -> float:
        """Mean core throughput over the rolls."""
        return float(np.mean(self.cores))

    def kernels(self, geometry: BandGeometry, filter_name: FluxFilter) -> tuple[FloatArray, ...]:
        """Return the weights of the sum that measures it around its pixel in every roll.

        Those of the matched filter are scaled so that they find as much of its light as the aperture.

        Parameters
        ----------
        geometry : BandGeometry
        filter_name : {"aperture", "matched", "mirror", "whitened"}
            Of the last two the sums of apertures.
        """
        found = []
        for place, template, aperture in zip(self.places_arcsec, self.templates, self.apertures, strict=True):
            pixel = pixels_of(geometry, place)
            if filter_name == "matched":
                kernel = kernel_at(template, *pixel, geometry.lambda_d_arcsec / geometry.pixel_scale_arcsec)
                weights = sum_weights(template.shape, *pixel, 1.0, kernel)
                kernel *= np.sum(template * aperture) / np.sum(template * weights)
            else:
                kernel = kernel_at(aperture, *pixel, radius_pixel(geometry) + 1.0)
            found.append(kernel)
        return tuple(found)


def planet_places(
    plan: LibraryPlan, instrument: Instrument, task: ConfirmTask, geometry: BandGeometry, strategy: Strategy
) -> list[PlanetPlace]:
    """Return where the planets that a task measures stand, in its order.

    Parameters
    ----------
    plan : LibraryPlan
    instrument : Instrument
        Of the images.
    task : ConfirmTask
    geometry : BandGeometry
    strategy : Strategy
    """
    shown = (plan.science, plan.reference)[: 2 if plan.shows_planet else 1]
    every = [
        scene_sources(plan.science_scene, instrument, task.band, roll_deg=visit["roll_deg"])[1:] for visit in shown
    ]
    found = []
    for index, source in enumerate(every[0]):
        if source.kind != "planet" or source.name not in task.planets:
            continue
        places = tuple((sources[index].x_arcsec, sources[index].y_arcsec) for sources in every)
        beside = [
            (other.x_arcsec, other.y_arcsec)
            for sources in every
            for number, other in enumerate(sources)
            if number != index
        ]
        found.append(place_at(geometry, strategy, source.name, places, beside))
    return found


def planet_templates(visits: VisitPair) -> tuple[PlanetTemplate, ...]:
    """Return the planets that the task measures, in its order, with what the measurement of each needs."""
    places = planet_places(visits.plan, visits.instrument, visits.task, visits.geometry, visits.strategy)
    return tuple(with_image(visits, place) for place in places)


def with_image(visits: VisitPair, place: PlanetPlace) -> PlanetTemplate:
    """Return what the measurement of a planet at a place needs."""
    pixel, middle = visits.geometry.pixel_scale_arcsec, visits.geometry.stamp_pixels // 2
    templates = tuple(visits.optics.at(*offsets) for offsets in place.places_arcsec)
    cores = (np.sum(image * weights) for image, weights in zip(templates, place.apertures, strict=True))
    return PlanetTemplate(
        **vars(place),
        templates=templates,
        cores=tuple(float(core) for core in cores),
        neighbours=tuple(visits.optics.at((x - middle) * pixel, (y - middle) * pixel) for x, y in place.others),
    )


def place_at(
    geometry: BandGeometry,
    strategy: Strategy,
    name: str,
    places_arcsec: tuple[Place, ...],
    beside: Sequence[Place] = (),
) -> PlanetPlace:
    """Return a place at which a planet is measured, and the pixels around it.

    Parameters
    ----------
    geometry : BandGeometry
    strategy : Strategy
        Whose annulus is widened until it has room for three apertures.
    name : str
    places_arcsec : tuple of (x, y)
        Offsets on the detector, one a roll.
    beside : sequence of (x, y)
        Offsets of other sources; those beyond the stamp do not count.
    """
    side, radius, width = geometry.stamp_pixels, radius_pixel(geometry), strategy.annulus_lambda_d
    edge_arcsec = side // 2 * geometry.pixel_scale_arcsec
    others = tuple(pixels_of(geometry, place) for place in beside if max(map(abs, place)) < edge_arcsec)
    apertures = tuple(aperture_weights((side, side), *pixels_of(geometry, place), radius) for place in places_arcsec)
    while True:
        annulus = geometry.annulus(float(np.hypot(*places_arcsec[0])), width)
        background = outside_discs(annulus, others, EXCLUSION_RADII * radius)
        place = PlanetPlace(
            name=name, places_arcsec=places_arcsec, apertures=apertures, background=background, others=others
        )
        if place.tells_noise(geometry.hole, geometry, strategy) or (annulus == geometry.hole).all():
            return place
        width += _WIDER_LAMBDA_D


def radius_pixel(geometry: BandGeometry) -> float:
    """Return the radius of the photometric aperture in pixels."""
    return geometry.aperture_radius_arcsec / geometry.pixel_scale_arcsec


def pixels_of(geometry: BandGeometry, place_arcsec: tuple[float, float]) -> tuple[float, float]:
    """Return the column and row of a place on the stamp."""
    middle, pixel = geometry.stamp_pixels // 2, geometry.pixel_scale_arcsec
    return middle + place_arcsec[0] / pixel, middle + place_arcsec[1] / pixel


def obstacle(planet: PlanetPlace, geometry: BandGeometry, strategy: Strategy) -> tuple[Reason, str] | None:
    """Return why a planet cannot be measured whatever the frames hold, in a word and a sentence; None where it can."""
    for (x, y), weights in zip(planet.places_arcsec, planet.apertures, strict=True):
        # The pixels of an aperture that touches the edges may reach beyond them.
        inside = geometry.zone.contains(np.array(x), np.array(y), geometry.aperture_radius_arcsec)
        if not (inside or is_covered(geometry.hole, weights)):
            rolls = " at one of the two rolls" if len(planet.apertures) > 1 else ""
            reason = edge_crossed(geometry.zone, x, y, geometry.aperture_radius_arcsec)
            return reason, f"the mask or the edge of the dark hole hides the planet{rolls}"
    within = geometry.lambda_d_arcsec / geometry.pixel_scale_arcsec
    for place in planet.places_arcsec:
        apart = [math.dist(pixels_of(geometry, place), other) for other in planet.others]
        if min(apart, default=math.inf) < within:
            nearest = f"{min(apart) * geometry.pixel_scale_arcsec:.3f} arcsec from the planet, within lambda/D"
            return Reason.SOURCE_ON_PLACE, f"another source stands {nearest}: their light cannot be told apart"
    if not planet.tells_noise(geometry.hole, geometry, strategy):
        few = f"fewer than {MIN_BACKGROUND_APERTURES} apertures fit around the planet to measure the noise in"
        return Reason.TOO_FEW_ELEMENTS, few
    return None


def is_covered(region: BoolArray, weights: FloatArray) -> bool:
    """Return whether enough of an aperture lies in a region."""
    return float(np.sum(weights * region) / np.sum(weights)) >= LEAST_COVERED
