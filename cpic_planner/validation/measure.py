"""Measurement of one realisation: the blind search decides, forced photometry gives the flux."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from cpic_planner.queries import FluxFilter
from cpic_planner.validation.detection import BlindSearch, Searcher, searcher
from cpic_planner.validation.photometry import Photometry, aperture_photometry, sum_weights, without_source
from cpic_planner.validation.rdi import paying_modes, surviving_fraction
from cpic_planner.validation.realise import Realisation, VisitPair
from cpic_planner.validation.reduced import ReducedStack
from cpic_planner.validation.roll import roll_photometry
from cpic_planner.validation.speckle_maps import SpeckleMaps, mirror_share, speckle_maps, whole_kernels
from cpic_planner.validation.star_flux import StarFlux
from cpic_planner.validation.templates import PlanetTemplate, is_covered, pixels_of, radius_pixel
from cpic_planner.validation.whitened import SpeckleModel, WhitenedFilter
from simulator.imaging import BandGeometry, TablePsf
from simulator.signal import REGION_LAMBDA_D


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
    found: bool
    found_at_place: bool
    search_snr: float | None
    search_threshold: float | None


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
    return searcher(
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
    model = SpeckleModel.of(visits, star.rate_e_s) if visits.strategy.filter == "whitened" else None
    found: list[Measurement | None] = []
    known = iter(() if blind is None else blind.at_places)
    for planet, covered, expected in zip(planets, whole, visits.task.predictions, strict=True):
        place = next(known, None) if covered else None
        if not covered or not planet.tells_noise(stack.region, geometry, visits.strategy):
            found.append(None)
            continue
        near = reduced_around(realisation, planet, visits)
        measured = forced_photometry(near, planet, geometry, visits.strategy.filter, model)
        star_e = measured.throughput * planet.core * star.rate_e_s * stack.integration_s
        match = None if blind is None else blind.strongest_near(*planet.places_arcsec[0], geometry)
        at_place = measured.significance >= expected["threshold"] if place is None else place.detected
        one = Measurement(
            contrast=measured.raw_flux / star_e,
            contrast_error=measured.error * measured.throughput / star_e,
            contrast_sigma=measured.sigma_background / star_e,
            snr=measured.snr,
            significance=measured.significance,
            throughput=measured.throughput,
            n_apertures=measured.n_background_apertures,
            modes=near.reduced.rdi.modes_used,
            found=at_place if blind is None else bool(match and match.detected),
            found_at_place=at_place,
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
    filter_name: FluxFilter = "aperture",
    model: SpeckleModel | None = None,
) -> Photometry:
    """Return the flux of a planet at its place, over the fraction that the subtraction leaves; of two rolls the mean.

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
    radius = radius_pixel(geometry)
    stack, roll = realisation.reduced, realisation.roll
    first, *second = (pixels_of(geometry, place) for place in planet.places_arcsec)
    around = planet.around(stack.region, geometry, filter_name)
    matched = planet.kernels(geometry, filter_name) if filter_name == "matched" else None
    kernel = matched[0] if matched else None
    shared: dict[str, Any] = {"background_region": around, "factor2": stack.factor2}
    if roll is not None:
        one, two = planet.templates
        return roll_photometry(roll, one, two, first, second[0], radius, kernels=matched, **shared)
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
    left, weights = stack.rdi.project(template), sum_weights(image.shape, *first, radius, kernel)
    if filter_name == "mirror":
        # The wings of the planet and what modes spread of it are not alike at opposite places, and no speckles.
        empty = without_source(image, left, weights, around)
        share = mirror_share(empty, planet.kernels(geometry, filter_name)[0], around)
        image, left = (part - share * part[::-1, ::-1] for part in (image, left))
    through = surviving_fraction("template", template, left, weights, around)
    return aperture_photometry(image, *first, radius, throughput=through, kernel=kernel, left=left, **shared)
