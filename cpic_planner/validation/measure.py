"""Measurement of one realisation: the blind search decides, forced photometry gives the flux."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from cpic_core import BoolArray, FloatArray, Reason
from cpic_planner.queries import FluxFilter
from cpic_planner.validation.apertures import aperture_weights, edge_crossed, outside_discs
from cpic_planner.validation.detection import BlindSearch, search
from cpic_planner.validation.photometry import (
    EXCLUSION_RADII,
    Photometry,
    aperture_photometry,
    kernel_at,
    sum_weights,
    without_source,
)
from cpic_planner.validation.rdi import paying_modes, surviving_fraction
from cpic_planner.validation.realise import Realisation, VisitPair
from cpic_planner.validation.reduced import ReducedStack
from cpic_planner.validation.roll import roll_photometry
from cpic_planner.validation.speckle_maps import SpeckleMaps, mirror_share, speckle_maps, whole_kernels
from cpic_planner.validation.star_flux import StarFlux
from cpic_planner.validation.whitened import SpeckleModel, WhitenedFilter
from simulator.imaging import BandGeometry
from simulator.signal import REGION_LAMBDA_D
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
        """Weights of the sum that measures it around its pixel in every roll.

        Those of the matched filter are scaled so that they find as much of its light as the aperture.

        Parameters
        ----------
        geometry : BandGeometry
        filter_name : {"aperture", "matched", "mirror", "whitened"}
            Of the last two the sums of apertures.
        """
        found = []
        for place, template, aperture in zip(self.places_arcsec, self.templates, self.apertures, strict=True):
            pixel, scale = _pixels(geometry, place), geometry.pixel_scale_arcsec
            if filter_name == "matched":
                kernel = kernel_at(template, *pixel, geometry.lambda_d_arcsec / scale)
                weights = sum_weights(template.shape, *pixel, 1.0, kernel)
                kernel *= np.sum(template * aperture) / np.sum(template * weights)
            else:
                kernel = kernel_at(aperture, *pixel, geometry.aperture_radius_arcsec / scale + 1.0)
            found.append(kernel)
        return tuple(found)


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
    others = tuple(_pixels(geometry, place) for place in beside)
    templates = tuple(visits.optics.at(*place) for place in places_arcsec)
    apertures = tuple(aperture_weights((side, side), *_pixels(geometry, place), radius) for place in places_arcsec)
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


def _pixels(geometry: BandGeometry, place_arcsec: tuple[float, float]) -> tuple[float, float]:
    """Column and row of a place on the stamp."""
    middle, pixel = geometry.stamp_pixels // 2, geometry.pixel_scale_arcsec
    return middle + place_arcsec[0] / pixel, middle + place_arcsec[1] / pixel


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


def maps_of(visits: VisitPair) -> SpeckleMaps:
    """Return what a blind search of the visits knows of their speckles."""
    return speckle_maps(visits.optics, visits.instrument.drift)


def search_stack(
    visits: VisitPair, stack: ReducedStack, star_rate_e_s: float, maps: SpeckleMaps | None = None
) -> BlindSearch:
    """Search a residual of a programme blind, at the level of its strategy.

    Parameters
    ----------
    visits : VisitPair
    stack : ReducedStack
    star_rate_e_s : float
        Detected rate of the star on the clear pupil, above 0.
    maps : SpeckleMaps, optional
        `maps_of` the visits, where they are at hand.
    """
    return search(
        stack,
        visits.optics,
        maps or maps_of(visits),
        star_rate_e_s=star_rate_e_s,
        sigma=visits.strategy.sigma,
        visits=visits.plan.visits,
        reference_visits=visits.plan.reference_visits,
        common_fraction=visits.instrument.drift.common_fraction,
    )


def measure_planets(
    visits: VisitPair,
    realisation: Realisation,
    planets: Sequence[PlanetTemplate],
    star: StarFlux,
    *,
    searched: bool = True,
) -> tuple[list[Measurement | None], BlindSearch | None]:
    """Search one realisation blind, then measure every planet at its place.

    Parameters
    ----------
    visits : VisitPair
    realisation : Realisation
    planets : sequence of PlanetTemplate
        `planet_templates` the visits.
    star : StarFlux
        Rate of the star that contrasts refer to.
    searched : bool
        Whether it is searched blind first.

    Returns
    -------
    measurements : list of Measurement or None
        In the order of the planets; None where a limit took the aperture or the background around it away.
    blind : BlindSearch or None
        None without a search, and for two rolls, where each half shows every planet twice: the threshold for a known
        place decides there.
    """
    stack, geometry = realisation.reduced, visits.geometry
    blind: BlindSearch | None = None
    if searched and realisation.roll is None:
        blind = search_stack(visits, stack, star.rate_e_s)
    model = SpeckleModel.of(visits, star.rate_e_s) if visits.strategy.filter == "whitened" else None
    found: list[Measurement | None] = []
    for planet, expected in zip(planets, visits.task.predictions, strict=True):
        covered = all(_is_covered(stack.region, weights) for weights in planet.apertures)
        if not covered or not _tells_noise(stack.region, planet):
            found.append(None)
            continue
        near = reduced_around(realisation, planet, visits)
        measured = forced_photometry(near, planet, geometry, visits.strategy.filter, model)
        star_e = measured.throughput * planet.core * star.rate_e_s * stack.integration_s
        match = None if blind is None else blind.strongest_near(*planet.places_arcsec[0], geometry)
        seen = measured.significance >= expected["threshold"] if blind is None else bool(match and match.detected)
        one = Measurement(
            contrast=measured.raw_flux / star_e,
            contrast_error=measured.error * measured.throughput / star_e,
            contrast_sigma=measured.sigma_background / star_e,
            snr=measured.snr,
            significance=measured.significance,
            throughput=measured.throughput,
            n_apertures=measured.n_background_apertures,
            modes=near.reduced.rdi.modes_used,
            found=seen,
            search_snr=match.snr_mf if match else None,
            search_threshold=match.threshold if match else None,
        )
        found.append(one)
    return found, blind


def reduced_around(realisation: Realisation, planet: PlanetTemplate, visits: VisitPair) -> Realisation:
    """Reduce a realisation anew for one planet, with modes of the annulus around its place.

    Modes of the whole hole are those of its inner corner; they do little, or harm, farther out. Without modes, the
    realisation as it is.

    Parameters
    ----------
    realisation : Realisation
    planet : PlanetTemplate
    visits : VisitPair
        Its strategy says how many modes, or that as many of them are to be taken as pay.
    """
    stack, roll, geometry, strategy = realisation.reduced, realisation.roll, visits.geometry, visits.strategy
    n_modes = strategy.n_modes
    if n_modes == 0:
        return realisation
    annulus = stack.region & geometry.annulus(float(np.hypot(*planet.places_arcsec[0])), REGION_LAMBDA_D)
    if strategy.choose_modes and stack.inputs is not None:
        kernel = planet.kernels(geometry, strategy.filter)[0]
        n_modes = paying_modes(
            stack.inputs.library_e,
            n_modes,
            region=annulus,
            template=planet.templates[0],
            weights=planet.apertures[0],
            kernel=kernel,
            samples=whole_kernels(planet.background & stack.region, kernel),
        )
    return replace(
        realisation,
        reduced=stack.within(annulus, n_modes),
        roll=None if roll is None else roll.within(annulus, n_modes),
    )


def forced_photometry(
    realisation: Realisation,
    planet: PlanetTemplate,
    geometry: BandGeometry,
    filter_name: FluxFilter = "aperture",
    model: SpeckleModel | None = None,
) -> Photometry:
    """Flux of a planet at its place, over the fraction that the subtraction leaves; of two rolls the mean.

    Parameters
    ----------
    realisation : Realisation
    planet : PlanetTemplate
    geometry : BandGeometry
    filter_name : {"aperture", "matched", "mirror", "whitened"}
        How the sum weighs pixels, and what is taken off before: see `cpic_planner.queries.shared.Reduction`.
    model : SpeckleModel, optional
        Residual speckles that the filter ``whitened`` takes for granted.
    """
    radius = geometry.aperture_radius_arcsec / geometry.pixel_scale_arcsec
    stack, roll = realisation.reduced, realisation.roll
    first, *second = (_pixels(geometry, place) for place in planet.places_arcsec)
    around = planet.background & stack.region
    kernels = planet.kernels(geometry, filter_name)
    matched = kernels if filter_name == "matched" else None
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
            kernels=None if matched is None else (matched[0], matched[1]),
        )
    image, template = stack.image_e, planet.templates[0]
    if filter_name == "whitened":
        assert model is not None  # as `measure_planets` makes it
        fitted = WhitenedFilter(
            stack,
            template,
            first,
            geometry=geometry,
            model=model,
            background_region=around,
            neighbours=planet.neighbours,
        )
        return fitted.photometry(stack)
    left = stack.rdi.project(template)
    if filter_name == "mirror":
        # Nothing of the planet, nor of the others, at either place, nor at what they leave at the opposite ones.
        middle = len(image) - 1
        places = [first, *planet.others]
        around = outside_discs(around & around[::-1, ::-1], places, EXCLUSION_RADII * radius)
        opposite = [(middle - x, middle - y) for x, y in places]
        around = outside_discs(around, opposite, EXCLUSION_RADII * radius)
        empty = image
        if stack.rdi.modes_used:
            # What modes spread of the planet is not alike at opposite places, and no speckle.
            ring = outside_discs(around, [first], EXCLUSION_RADII * radius)
            empty = without_source(image, left, sum_weights(image.shape, *first, radius), ring)
        share = mirror_share(empty, kernels[0], around)
        image, left = (part - share * part[::-1, ::-1] for part in (image, left))
    ring = outside_discs(around, [first], EXCLUSION_RADII * radius)
    weights = sum_weights(image.shape, *first, radius, None if matched is None else matched[0])
    return aperture_photometry(
        image,
        *first,
        radius,
        background_region=around,
        throughput=surviving_fraction("template", template, left, weights, ring),
        em_gain=stack.em_gain,
        stages=stack.stages,
        kernel=None if matched is None else matched[0],
        left=left if stack.rdi.modes_used else None,
    )
