"""Planets to be measured: where they stand, their images there, and whether images can show them at all."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from cpic_core import BoolArray, FloatArray, Reason
from cpic_planner.queries import FluxFilter
from cpic_planner.validation.apertures import aperture_weights, edge_crossed, outside_discs
from cpic_planner.validation.photometry import EXCLUSION_RADII, kernel_at, sum_weights
from cpic_planner.validation.realise import VisitPair
from simulator.imaging import BandGeometry
from simulator.target import scene_sources

LEAST_COVERED = 0.9
"""Share of an aperture that must be left by limits and rejection."""


Place: TypeAlias = tuple[float, float]
"""Offsets x and y from the star on the detector, arcsec."""


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
    neighbours : tuple of ndarray, shape (n, n)
        Images of unit sources there.
    """

    name: str
    places_arcsec: tuple[tuple[float, float], ...]
    templates: tuple[FloatArray, ...]
    apertures: tuple[FloatArray, ...]
    cores: tuple[float, ...]
    background: BoolArray
    others: tuple[tuple[float, float], ...]
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
            pixel, scale = pixels_of(geometry, place), geometry.pixel_scale_arcsec
            if filter_name == "matched":
                kernel = kernel_at(template, *pixel, geometry.lambda_d_arcsec / scale)
                weights = sum_weights(template.shape, *pixel, 1.0, kernel)
                kernel *= np.sum(template * aperture) / np.sum(template * weights)
            else:
                kernel = kernel_at(aperture, *pixel, geometry.aperture_radius_arcsec / scale + 1.0)
            found.append(kernel)
        return tuple(found)


def planet_templates(visits: VisitPair) -> tuple[PlanetTemplate, ...]:
    """Return the planets that the task measures, in its order, with what the measurement of each needs."""
    geometry, task = visits.geometry, visits.task
    edge_arcsec = geometry.stamp_pixels // 2 * geometry.pixel_scale_arcsec
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
        beside = [
            (other.x_arcsec, other.y_arcsec)
            for sources in every
            for number, other in enumerate(sources)
            if number != index and max(abs(other.x_arcsec), abs(other.y_arcsec)) < edge_arcsec
        ]
        found.append(template_at(visits, source.name, places, beside))
    return tuple(found)


def template_at(
    visits: VisitPair, name: str, places_arcsec: tuple[Place, ...], beside: Sequence[Place] = ()
) -> PlanetTemplate:
    """Return what the measurement of a planet needs.

    Parameters
    ----------
    visits : VisitPair
    name : str
    places_arcsec : tuple of (x, y)
        Offsets on the detector, one a roll.
    beside : sequence of (x, y)
        Offsets of other sources on the stamp.
    """
    geometry = visits.geometry
    radius = geometry.aperture_radius_arcsec / geometry.pixel_scale_arcsec
    side = geometry.stamp_pixels
    others = tuple(pixels_of(geometry, place) for place in beside)
    templates = tuple(visits.optics.at(*place) for place in places_arcsec)
    apertures = tuple(aperture_weights((side, side), *pixels_of(geometry, place), radius) for place in places_arcsec)
    annulus = geometry.annulus(float(np.hypot(*places_arcsec[0])), visits.strategy.annulus_lambda_d)
    return PlanetTemplate(
        name=name,
        places_arcsec=places_arcsec,
        templates=templates,
        apertures=apertures,
        cores=tuple(float(np.sum(image * weights)) for image, weights in zip(templates, apertures, strict=True)),
        background=outside_discs(annulus, others, EXCLUSION_RADII * radius),
        others=others,
        neighbours=tuple(visits.optics.at(*place) for place in beside),
    )


def pixels_of(geometry: BandGeometry, place_arcsec: tuple[float, float]) -> tuple[float, float]:
    """Return the column and row of a place on the stamp."""
    middle, pixel = geometry.stamp_pixels // 2, geometry.pixel_scale_arcsec
    return middle + place_arcsec[0] / pixel, middle + place_arcsec[1] / pixel


def obstacle(planet: PlanetTemplate, geometry: BandGeometry) -> tuple[Reason, str] | None:
    """Return why a planet cannot be measured whatever the frames hold, in a word and a sentence; None where it can.

    Parameters
    ----------
    planet : PlanetTemplate
    geometry : BandGeometry
    """
    for (x, y), weights in zip(planet.places_arcsec, planet.apertures, strict=True):
        if not is_covered(geometry.hole, weights):
            rolls = " at one of the two rolls" if len(planet.apertures) > 1 else ""
            reason = edge_crossed(geometry.zone, x, y, geometry.aperture_radius_arcsec)
            return reason, f"the mask or the edge of the dark hole hides the planet{rolls}"
    if not tells_noise(geometry.hole, planet):
        return Reason.TOO_FEW_ELEMENTS, "other sources leave no room around the planet to measure the noise in"
    return None


def is_covered(region: BoolArray, weights: FloatArray) -> bool:
    """Return whether enough of an aperture lies in a region."""
    return float(np.sum(weights * region) / np.sum(weights)) >= LEAST_COVERED


def tells_noise(region: BoolArray, planet: PlanetTemplate) -> bool:
    """Return whether enough of the annulus that tells the noise lies in a region."""
    whole = np.count_nonzero(planet.background)
    return bool(np.count_nonzero(planet.background & region) >= 0.5 * whole > 0)
