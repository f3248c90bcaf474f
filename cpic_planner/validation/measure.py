"""Planets measured in one realisation: the blind search decides, forced photometry gives the flux.

Whether images can show a planet at all is known before any is made: `obstacle`.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Self, TypeAlias

import numpy as np

from cpic_core import BoolArray, FloatArray, InputError, Reason, Record
from cpic_planner.queries import Strategy
from cpic_planner.registry import DEFAULT_FILTER, FILTERS
from cpic_planner.validation.photometry import (
    EXCLUSION_RADII,
    MIN_BACKGROUND_APERTURES,
    Photometry,
    aperture_photometry,
    aperture_weights,
    edge_crossed,
    kernel_at,
    outside_discs,
    radius_pixel,
    ratio,
    sample_places,
    sum_weights,
    without_source,
)
from cpic_planner.validation.rdi import ReducedStack, paying_modes, roll_photometry, surviving_fraction
from cpic_planner.validation.realise import Realisation, VisitPair
from cpic_planner.validation.search import BlindSearch, Searcher, SpeckleMaps, mirror_share, speckle_maps, whole_kernels
from cpic_planner.validation.star_flux import StarFlux
from cpic_planner.validation.task import ConfirmTask, LibraryPlan
from simulator.config import Instrument
from simulator.imaging import BandGeometry, TablePsf
from simulator.signal import REGION_LAMBDA_D, Whitening, placed, speckle_covariance, unit_parts, with_noise
from simulator.target import scene_sources

LEAST_COVERED = 0.9
"""Share of an aperture that must be left by limits and rejection."""
_WIDER_LAMBDA_D = 0.25  # steps by which a background without room for three apertures is widened

Place: TypeAlias = tuple[float, float]
"""Offsets x and y from the star on the detector, arcsec."""


class PlanetPlace(Record, eq=False, kw_only=True):
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

    def around(self, region: BoolArray, geometry: BandGeometry, filter_name: str) -> BoolArray:
        """Return the part of the background in a region that shows nothing of the planet.

        For a filter that takes the opposite place nothing of the planet or of other sources either there.

        Parameters
        ----------
        region : ndarray of bool, shape (n, n)
        geometry : BandGeometry
        filter_name : str
        """
        free, middle = self.background & region, geometry.stamp_pixels - 1
        places = [pixels_of(geometry, place) for place in self.places_arcsec]
        if FILTERS[filter_name].takes_opposite:
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
        if strategy.n_modes or FILTERS[strategy.filter].takes_covariance:
            region = region & geometry.annulus(self.separation_arcsec, REGION_LAMBDA_D)
        free, radius = self.around(region, geometry, strategy.filter), radius_pixel(geometry)
        lambda_d = geometry.lambda_d_arcsec / geometry.pixel_scale_arcsec
        for place, aperture in zip(self.places_arcsec, self.apertures, strict=True):
            by_image = FILTERS[strategy.filter].weighs_by_image
            seen = (np.ones_like(aperture), lambda_d) if by_image else (aperture, radius + 1.0)
            try:
                sample_places(free, radius, kernel_at(seen[0], *pixels_of(geometry, place), seen[1]))
            except InputError:  # no room
                return False
        return True


class PlanetTemplate(PlanetPlace, eq=False, kw_only=True):
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

    def kernels(self, geometry: BandGeometry, filter_name: str) -> tuple[FloatArray, ...]:
        """Return the weights of the sum that measures it around its pixel in every roll.

        Those of the matched filter are scaled so that they find as much of its light as the aperture.

        Parameters
        ----------
        geometry : BandGeometry
        filter_name : str
            A name of `cpic_planner.registry.FILTERS`; of those that do not weigh by the image the sums of apertures.
        """
        found = []
        for place, template, aperture in zip(self.places_arcsec, self.templates, self.apertures, strict=True):
            pixel = pixels_of(geometry, place)
            if FILTERS[filter_name].weighs_by_image:
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


def with_image(visits: VisitPair, place: PlanetPlace, *, margin_pixels: int | None = None) -> PlanetTemplate:
    """Return what the measurement of a planet at a place needs.

    Parameters
    ----------
    visits : VisitPair
    place : PlanetPlace
    margin_pixels : int, optional
        Of the images, as of `simulator.imaging.psf.Psf.at`: for measurements that look at the dark hole alone.
    """
    pixel, middle = visits.geometry.pixel_scale_arcsec, visits.geometry.stamp_pixels // 2
    templates = tuple(visits.optics.at(*offsets, margin_pixels=margin_pixels) for offsets in place.places_arcsec)
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


_MOST_PROBES = 200  # places that tell the scatter: several an aperture


class SpeckleModel(Record, eq=False):
    """Residual speckles of a programme as the optical model foresees them; made by `of`.

    Attributes
    ----------
    instrument : Instrument
        Whose static field, mirror and drift are taken for granted.
    band : str
    linear_nm2, square_nm4 : float
        What the wavefronts of the programme leave of both parts; see `simulator.signal.unit_parts`.
    star_e : float
        Electrons of the star on the clear disc in the summed stack.
    """

    instrument: Instrument
    band: str
    linear_nm2: float
    square_nm4: float
    star_e: float

    @classmethod
    def of(cls, visits: VisitPair, star_rate_e_s: float, instrument: Instrument | None = None) -> Self:
        """Return the model of a programme.

        Parameters
        ----------
        visits : VisitPair
        star_rate_e_s : float
            Rate of the star on the clear disc.
        instrument : Instrument, optional
            The instrument that is taken for granted; that of the images by default.
        """
        model, plan, one = instrument or visits.instrument, visits.plan, visits.science
        visit_s = (one.exposure_s + one.readout_s) * one.n_frames
        gap_s = visits.task.gap_s if plan.visits > 1 else math.inf
        length = visits.strategy.reference_library.reference_length(
            np.asarray(float(plan.visits)), np.asarray(float(plan.reference_visits))
        )
        parts = unit_parts(model.drift, reference_ratio=visits.strategy.reference_ratio, timing=visits.task.timing)
        left = (
            float(part.law(plan.visits, plan.reference_visits, gap_s, reference_length=length).variance(visit_s))
            for part in parts
        )
        # Noise-free references are expectations of the science visits: they have their wavefronts.
        linear, square = (0.0, 0.0) if plan.noise_free else left
        star_e = star_rate_e_s * one.exposure_s * one.n_frames * plan.visits
        return cls(model, visits.task.band, linear, square, star_e)

    def covariance_e2(self, separation_arcsec: float, region: BoolArray, geometry: BandGeometry) -> FloatArray:
        """Return the covariance of the speckles in the pixels of a region, electrons squared, shape (p, p).

        Parameters
        ----------
        separation_arcsec : float
        region : ndarray of bool, shape (n, n)
            Part of the hole within 2.4 lambda/D of the separation.
        geometry : BandGeometry
        """
        every = speckle_covariance(self.instrument, self.band, separation_arcsec, self.linear_nm2, self.square_nm4)
        part = region[geometry.annulus(separation_arcsec, REGION_LAMBDA_D)]
        return np.asarray(self.star_e**2 * every[np.ix_(part, part)])


def speckles_of(visits: VisitPair, star_rate_e_s: float) -> SpeckleModel | None:
    """Return the model of the residual speckles where the filter of the strategy takes one for granted.

    Parameters
    ----------
    visits : VisitPair
    star_rate_e_s : float
        Rate of the star on the clear disc.
    """
    return SpeckleModel.of(visits, star_rate_e_s) if FILTERS[visits.strategy.filter].takes_covariance else None


class WhitenedFilter:
    """Generalised least squares for a source at one place, over the pixels of the annulus around it.

    Parameters
    ----------
    stack : ReducedStack
        Of one roll; its pixels, white noise and modes count, not its image.
    template : ndarray, shape (n, n)
        Image of a unit source at the place.
    place_pixel : tuple of float
        The place (x, y); pixel centres are at integers.
    geometry : BandGeometry
    model : SpeckleModel
        The residual speckles.
    background_region : ndarray of bool, shape (n, n)
        Where the scatter is measured, without other sources; a disc around the place is taken out here.
    neighbours : tuple of ndarray, shape (n, n)
        Images of other sources.

    Raises
    ------
    InputError
        If the background region holds fewer than 3 apertures side by side.

    Notes
    -----
    A level, the modes that were subtracted and the neighbours are fitted with the source. A filter belongs to its
    place: the scatter is that of the same estimate at the places of apertures in the background region, each with its
    own filter and the source at its place fitted too, over the error that the covariance foresees there. Its rms times
    the error foreseen at the place is the error: the shape of the covariance is believed, not its size.
    """

    def __init__(
        self,
        stack: ReducedStack,
        template: FloatArray,
        place_pixel: tuple[float, float],
        *,
        geometry: BandGeometry,
        model: SpeckleModel,
        background_region: BoolArray,
        neighbours: tuple[FloatArray, ...] = (),
    ) -> None:
        radius, middle = geometry.aperture_radius_arcsec / geometry.pixel_scale_arcsec, geometry.stamp_pixels // 2
        x_pixel, y_pixel = place_pixel
        separation = math.hypot(x_pixel - middle, y_pixel - middle) * geometry.pixel_scale_arcsec
        region = stack.region & geometry.annulus(separation, REGION_LAMBDA_D)
        noise = with_noise(model.covariance_e2(separation, region, geometry), stack.white_variance_e2[region])
        modes = np.zeros((len(stack.rdi.modes), *region.shape))
        modes[:, stack.rdi.region] = stack.rdi.modes
        beside = np.array([image[region] for image in (np.ones(region.shape), *modes, *neighbours)])
        self._whitening = Whitening(noise, beside)
        self._region, self._background, self._place, self._radius = region, background_region, place_pixel, radius
        self._left = stack.rdi.project(template)
        source = template[region]
        self._source = self._whitening.of(source)
        self._power = float(self._source @ self._source)
        probes, self._apertures = _probes(template, place_pixel, region, background_region & region, radius)
        others = self._whitening.of(probes)
        others -= np.outer(others @ self._source / self._power, self._source)
        self._others = others / np.sqrt((others**2).sum(axis=1, keepdims=True))
        self._core = float(np.sum(aperture_weights(template.shape, x_pixel, y_pixel, radius) * template))
        # Variance of the strength by the source's own electrons, one a unit of its strength.
        self._own = float(np.sum(self._whitening.weights(source) ** 2 * np.maximum(source, 0.0)))

    @property
    def sigma_e(self) -> float:
        """Standard deviation of the light in the aperture that the covariance foresees, electrons."""
        return self._core / math.sqrt(self._power)

    def photometry(self, stack: ReducedStack) -> Photometry:
        """Return the flux of the source.

        Parameters
        ----------
        stack : ReducedStack
            Of the same pixels, white noise and modes.

        Returns
        -------
        Photometry
            ``raw_flux`` and errors are those of the light in the photometric aperture, with a ``throughput`` of 1: the
            source is fitted with what the subtraction leaves of it. ``background_per_pixel``, ``flux_paper_error``,
            ``snr_paper`` and the areas are those of an aperture.
        """
        plain = aperture_photometry(
            stack.image_e,
            *self._place,
            self._radius,
            background_region=self._background,
            factor2=stack.factor2,
            left=self._left,
        )
        image = self._whitening.of(stack.image_e[self._region])
        strength = float(self._source @ image) / self._power
        scatter = float(np.sqrt(np.mean((self._others @ image) ** 2)))
        raw, sigma = self._core * strength, scatter * self.sigma_e
        own = stack.factor2 * self._own * max(strength, 0.0)
        error = math.sqrt(sigma**2 + self._core**2 * own)
        return replace(
            plain,
            flux=raw,
            error=error,
            snr=ratio(raw, error),
            significance=ratio(raw, sigma),
            raw_flux=raw,
            sigma_background=sigma,
            n_background_apertures=self._apertures,
            error_rel_uncertainty=1.0 / math.sqrt(2.0 * (self._apertures - 1)),
            throughput=1.0,
        )


def _probes(
    template: FloatArray, place: tuple[float, float], region: BoolArray, background: BoolArray, radius: float
) -> tuple[FloatArray, int]:
    """Return the source moved by whole pixels to where apertures lie in the background, and how many fit."""
    row, column, half = round(place[1]), round(place[0]), math.ceil(radius + 0.5)
    side = 2 * half + 1
    kernel = aperture_weights((side, side), half + place[0] - column, half + place[1] - row, radius)
    away = outside_discs(background, [place], EXCLUSION_RADII * radius)
    rows, columns, _, n_apertures = sample_places(away, radius, kernel)
    some = np.unique(np.linspace(0, len(rows) - 1, _MOST_PROBES).astype(int))
    reach = len(template)  # any move on the stamp
    stamp = np.pad(template, reach)[row : row + 2 * reach + 1, column : column + 2 * reach + 1]
    moved = (placed(template.shape, stamp, *there)[region] for there in zip(rows[some], columns[some], strict=True))
    return np.array(list(moved)), n_apertures


class Measurement(Record):
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
    found_at_place : bool
        Whether the same map detects it at its known place; of two rolls, where there is no search, whether its
        significance reaches the small-sample threshold.
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
    found: bool = False
    found_at_place: bool = False
    search_snr: float | None = None
    search_threshold: float | None = None


def maps_of(visits: VisitPair) -> SpeckleMaps:
    """Return what a blind search of the visits knows of their speckles."""
    return speckle_maps(visits.optics, visits.instrument.drift)


def searcher_of(
    visits: VisitPair, stack: ReducedStack, star_rate_e_s: float, maps: SpeckleMaps | None = None
) -> Searcher:
    """Return a blind search of the residual of a programme, at the level of its strategy.

    Parameters
    ----------
    visits : VisitPair
    stack : ReducedStack
    star_rate_e_s : float
        Detected rate of the star on the clear pupil, above 0.
    maps : SpeckleMaps, optional
        `maps_of` the visits, where they are at hand.
    """
    plan, still = visits.plan, visits.still
    return Searcher(
        stack,
        visits.optics,
        maps or maps_of(visits),
        star_rate_e_s=star_rate_e_s,
        sigma=visits.strategy.sigma,
        visits=1 if still else plan.visits,
        reference_visits=1 if still else plan.reference_visits,
        common_fraction=0.0 if isinstance(visits.science.psf, TablePsf) else visits.instrument.drift.common_fraction,
        known_light_e_s=visits.known_light_e_s,
    )


def measure_planets(
    visits: VisitPair,
    realisation: Realisation,
    planets: Sequence[PlanetTemplate],
    star: StarFlux,
    *,
    searched: bool = True,
    maps: SpeckleMaps | None = None,
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
    maps : SpeckleMaps, optional
        `maps_of` the visits, where they are at hand.

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
    whole = [
        all(is_covered(stack.region, weights * geometry.hole) for weights in planet.apertures) for planet in planets
    ]
    if searched and realisation.roll is None:
        places = [one.places_arcsec[0] for one, good in zip(planets, whole, strict=True) if good]
        blind = searcher_of(visits, stack, star.rate_e_s, maps).search(stack.image_e, places)
    model = speckles_of(visits, star.rate_e_s)
    found: list[Measurement | None] = []
    known = iter(() if blind is None else blind.at_places)
    for planet, covered, expected in zip(planets, whole, visits.task.predictions, strict=True):
        place = next(known, None) if covered else None
        one = measured_at(visits, realisation, planet, star.rate_e_s, model) if covered else None
        if one is not None:
            match = None if blind is None else blind.strongest_near(*planet.places_arcsec[0], geometry)
            at_place = one.significance >= expected["threshold"] if place is None else place.detected
            one = replace(
                one,
                found=at_place if blind is None else bool(match and match.detected),
                found_at_place=at_place,
                search_snr=match.snr_mf if match else None,
                search_threshold=match.threshold if match else None,
            )
        found.append(one)
    return found, blind


def measured_at(
    visits: VisitPair,
    realisation: Realisation,
    planet: PlanetTemplate,
    star_rate_e_s: float,
    model: SpeckleModel | None = None,
) -> Measurement | None:
    """Measure one planet at its place by forced photometry.

    Parameters
    ----------
    visits : VisitPair
    realisation : Realisation
    planet : PlanetTemplate
        Whose apertures the region covers.
    star_rate_e_s : float
        Rate of the star that the contrast refers to; with 1 the contrast is the rate of the planet, e-/s.
    model : SpeckleModel, optional
        `speckles_of` the visits.

    Returns
    -------
    Measurement or None
        Without what a search says of it; None where too little of the background is left to tell the noise.
    """
    stack, geometry = realisation.reduced, visits.geometry
    if not planet.tells_noise(stack.region, geometry, visits.strategy):
        return None
    near = reduced_around(realisation, planet, visits)
    measured = forced_photometry(near, planet, geometry, visits.strategy.filter, model)
    star_e = measured.throughput * planet.core * star_rate_e_s * stack.integration_s
    return Measurement(
        contrast=measured.raw_flux / star_e,
        contrast_error=measured.error * measured.throughput / star_e,
        contrast_sigma=measured.sigma_background / star_e,
        snr=measured.snr,
        significance=measured.significance,
        throughput=measured.throughput,
        n_apertures=measured.n_background_apertures,
        modes=near.reduced.rdi.modes_used,
    )


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
    annulus = stack.region & geometry.annulus(planet.separation_arcsec, REGION_LAMBDA_D)
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
            centering=strategy.centring,
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
    filter_name: str = DEFAULT_FILTER,
    model: SpeckleModel | None = None,
) -> Photometry:
    """Return the flux of a planet at its place, over the fraction that the subtraction leaves; of two rolls the mean.

    Parameters
    ----------
    realisation : Realisation
    planet : PlanetTemplate
    geometry : BandGeometry
    filter_name : str
        How the sum weighs pixels, and what is taken off before: a name of `cpic_planner.registry.FILTERS`.
    model : SpeckleModel, optional
        Residual speckles that a filter by their covariance takes for granted.
    """
    radius = radius_pixel(geometry)
    stack, roll = realisation.reduced, realisation.roll
    first, *second = (pixels_of(geometry, place) for place in planet.places_arcsec)
    around = planet.around(stack.region, geometry, filter_name)
    how, kernels = FILTERS[filter_name], planet.kernels(geometry, filter_name)
    kernel = kernels[0] if how.weighs_by_image else None
    shared: dict[str, Any] = {"background_region": around, "factor2": stack.factor2}
    if roll is not None:
        given = kernels if how.weighs_by_image else None
        template, other = planet.templates
        return roll_photometry(roll, template, other, first, second[0], radius, kernels=given, **shared)
    image, template = stack.image_e, planet.templates[0]
    if how.takes_covariance:
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
    left, weights = stack.rdi.project(template), sum_weights(image.shape, *first, radius, kernel)
    if how.takes_opposite:
        # The wings of the planet and what modes spread of it are not alike at opposite places, and no speckles.
        empty = without_source(image, left, weights, around)
        share = mirror_share(empty, kernels[0], around)
        image, left = (part - share * part[::-1, ::-1] for part in (image, left))
    through = surviving_fraction("template", template, left, weights, around)
    return aperture_photometry(image, *first, radius, throughput=through, kernel=kernel, left=left, **shared)


def noise_at(
    visits: VisitPair,
    realisation: Realisation,
    place: PlanetTemplate | None,
    rate_e_s: float,
    model: SpeckleModel | None,
) -> list[float | None]:
    """Return the contrast of 1 sigma at a place without a planet, and what the subtraction leaves; None where unknown.

    Parameters
    ----------
    visits : VisitPair
    realisation : Realisation
    place : PlanetTemplate, optional
        Without one neither is known.
    rate_e_s : float
        Rate of the star on the clear disc.
    model : SpeckleModel, optional
        As of `forced_photometry`.
    """
    one = None if place is None else measured_at(visits, realisation, place, rate_e_s, model)
    return [None, None] if one is None else [float(one.contrast_sigma), float(one.throughput)]
