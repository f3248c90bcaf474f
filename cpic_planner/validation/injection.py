"""Programmes without planets, drawn as images and searched; and planets put into them, one at a time."""

import dataclasses
import functools
import math
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, Record, Status, announce, stream
from cpic_planner.etc import diagonal
from cpic_planner.validation import measure
from cpic_planner.validation.rdi import ReducedStack
from cpic_planner.validation.realise import Realisation, VisitPair, visit_pair
from cpic_planner.validation.search import BlindSearch, Candidate, Searcher
from cpic_planner.validation.task import ConfirmTask, modelling_of
from simulator.imaging import BandGeometry

_MATCH_LAMBDA_D = 1.0
_AZIMUTHS = 3600
INTERVAL = 0.68
"""Probability inside the intervals of fractions."""


def inject(
    stack: ReducedStack, image: FloatArray, total_e: float, rng: np.random.Generator | None = None
) -> ReducedStack:
    """Add a planet to a residual.

    Parameters
    ----------
    stack : ReducedStack
        Without that planet.
    image : ndarray, shape (n, n)
        Of a unit source at its place (`simulator.imaging.Psf.at`).
    total_e : float
        Electrons on the clear disc, at least 0.
    rng : Generator, optional
        Draws the planet's own photons and their excess noise; its mean without.

    Notes
    -----
    Where frames add up, the charge of a planet is independent of all other charge: its Poisson number in every pixel,
    multiplied with the variance of the register, is what frames with the planet would have held in addition. The
    projection is linear. The planet is absent from the reference.
    """
    if not (math.isfinite(total_e) and total_e >= 0):
        raise InputError("total_e", total_e, unit="e-", allowed="finite and at least 0")
    mean = np.where(stack.region, total_e * np.asarray(image, float), 0.0)
    light = mean
    if rng is not None:
        light = rng.poisson(np.maximum(mean, 0.0)).astype(float)
        spread = max(stack.factor2 - 1.0, 0.0)
        light += np.sqrt(spread * light) * rng.standard_normal(light.shape)
    return dataclasses.replace(stack, image_e=stack.image_e + stack.rdi.project(np.where(stack.region, light, 0.0)))


def recovered(found: BlindSearch, x_arcsec: float, y_arcsec: float, lambda_d_arcsec: float) -> Candidate | None:
    """Return the most significant candidate within lambda/D of a place, detected or not.

    Parameters
    ----------
    found : BlindSearch
    x_arcsec, y_arcsec : float
        Offsets from the star on the detector.
    lambda_d_arcsec : float
        lambda/D at band centre, arcsec.
    """
    near = found.near(x_arcsec, y_arcsec, _MATCH_LAMBDA_D * lambda_d_arcsec)
    return max(near, key=lambda one: one.significance, default=None)


def fraction_interval(hits: ArrayLike, trials: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return the interval of a probability that so many hits in so many trials leave open.

    Parameters
    ----------
    hits : array_like of int
        0 to ``trials``.
    trials : array_like of int
        At least 1; broadcasts.

    Returns
    -------
    low, high : ndarray
        Ends of the interval of Jeffreys that holds `INTERVAL`; 0 without a hit, and 1 without a miss (Brown, Cai &
        DasGupta 2001, Stat. Sci. 16, 101).
    """
    from scipy.special import betaincinv

    won, all_of = np.asarray(hits, float), np.asarray(trials, float)
    tail = 0.5 * (1.0 - INTERVAL)
    ends = (betaincinv(won + 0.5, all_of - won + 0.5, share) for share in (tail, 1.0 - tail))
    low, high = ends
    return np.where(won == 0.0, 0.0, low), np.where(won == all_of, 1.0, high)


def azimuths_inside(geometry: BandGeometry, separation_arcsec: float) -> FloatArray:
    """Return the angles of a circle at which the whole aperture of a planet lies in the dark hole, radians.

    Parameters
    ----------
    geometry : BandGeometry
    separation_arcsec : float
        Radius of the circle, above 0.

    Returns
    -------
    ndarray
        From the +x axis of the detector towards +y, evenly spread, of `_AZIMUTHS` on the whole circle; the diagonals
        are among them.
    """
    angle = 2.0 * np.pi * np.arange(_AZIMUTHS) / _AZIMUTHS
    x, y = separation_arcsec * np.cos(angle), separation_arcsec * np.sin(angle)
    return angle[geometry.zone.contains(x, y, geometry.aperture_radius_arcsec)]


def azimuth_share(geometry: BandGeometry, separation_arcsec: float) -> float:
    """Return the share of a circle on which the whole aperture of a planet lies in the dark hole.

    Parameters
    ----------
    geometry : BandGeometry
    separation_arcsec : float
        Radius of the circle, above 0.
    """
    return len(azimuths_inside(geometry, separation_arcsec)) / _AZIMUTHS


def draw_place(
    geometry: BandGeometry, separation_arcsec: float, rng: np.random.Generator
) -> tuple[float, float] | None:
    """Return a random place at a separation where the whole aperture lies in the dark hole; None without one.

    Parameters
    ----------
    geometry : BandGeometry
    separation_arcsec : float
        Projected separation from the star, arcsec, above 0.
    rng : numpy.random.Generator
        Source of random numbers; a seed gives the same draws.
    """
    angles = azimuths_inside(geometry, separation_arcsec)
    if not angles.size:
        return None
    angle = float(rng.choice(angles))
    return separation_arcsec * math.cos(angle), separation_arcsec * math.sin(angle)


class SearchTask(Record):
    """Some programmes of one star in one band, and what is done with each; plain data for any process.

    Attributes
    ----------
    images : dict
        `ConfirmTask.to_dict` of the star without planets.
    first, count : int
        Numbers of the realisations.
    places_arcsec : list of float
        Separations on the diagonal at which the noise is measured.
    planets : list of (float, list of float, list of float)
        Planets that are put into every image: separation, contrasts that they have, one after the other, and offsets x
        and y on the detector; without these each stands at an azimuth of its own.
    planets_until : int
        Number of the first realisation that gets no planets.
    """

    images: dict[str, Any]
    first: int
    count: int
    places_arcsec: list[float]
    planets: list[tuple[float, list[float], list[float]]]
    planets_until: int

    @property
    def key(self) -> str:
        """Name of the finished piece of work."""
        return f"{self.images['name']} {self.images['band']} {self.first}"

    def to_dict(self) -> dict[str, Any]:
        """Return the plain dict."""
        return asdict(self)


def search_task(tree: dict[str, Any]) -> dict[str, Any]:
    """Draw programmes, measure their noise, search them, and search them again with planets.

    Parameters
    ----------
    tree : dict
        `SearchTask.to_dict`.

    Returns
    -------
    dict
        ``refused`` (why there are no images; empty where there are), and one entry an image of ``limits`` (contrast of
        1 sigma at each place, and what the subtraction leaves of a planet; null where it is not known), ``alarms`` (of
        every peak that is no source, how many of its height noise is expected to show in such a search), ``elements``
        (resolution elements searched), and ``planets`` (x and y of each, and the number as of ``alarms`` of the peak at
        each contrast; null without a peak).
    """
    own = SearchTask(**tree)
    task = ConfirmTask(**own.images)
    announce(f"images of {task.name} in {task.band}")
    modelling = modelling_of(task)
    visits = visit_pair(task, modelling=modelling)
    if modelling.draw != "sums" or visits.stackable.status is not Status.OK:
        why = visits.stackable.message or "sums of frames are not accurate enough for this scene"
        return {"refused": why}
    rate_e_s = visits.science.truth.sources[0].rate_e_s
    geometry, maps = visits.geometry, measure.maps_of(visits)
    places = []
    for separation in own.places_arcsec:
        x, y = (float(part) for part in diagonal(geometry.zone, separation))
        place = measure.place_at(geometry, visits.strategy, "place", ((x, y),), visits.beside_arcsec)
        measured = measure.obstacle(place, geometry, visits.strategy) is None
        places.append(measure.with_image(visits, place) if measured else None)
    speckles = measure.speckles_of(visits, rate_e_s)
    seen = functools.lru_cache(maxsize=8)(functools.partial(visits.optics.at, margin_pixels=0))
    body: dict[str, Any] = {"refused": "", "limits": [], "alarms": [], "elements": [], "planets": []}
    for number in range(own.first, own.first + own.count):
        drawn = visits.draw(number)
        body["limits"].append([measure.noise_at(visits, drawn, place, rate_e_s, speckles) for place in places])
        blind = measure.searcher_of(visits, drawn.reduced, rate_e_s, maps)
        empty = blind.search(drawn.reduced.image_e)
        noise = empty.apart_from(visits.beside_arcsec, geometry)
        body["alarms"].append([one.false_alarms for one in noise])
        body["elements"].append(empty.region.n_elements)
        planets = own.planets if number < own.planets_until else []
        body["planets"].append(
            [_found(visits, seen, blind, drawn, number, index, *one) for index, one in enumerate(planets)]
        )
    return body


def _found(
    visits: VisitPair,
    seen: Callable[[float, float], FloatArray],
    blind: Searcher,
    drawn: Realisation,
    number: int,
    index: int,
    separation_arcsec: float,
    contrasts: list[float],
    offsets_arcsec: list[float],
) -> dict[str, Any]:
    """Return what a search finds of a planet of several contrasts at one place of an image."""
    task, stack = visits.task, drawn.reduced
    rng = stream(task.seed, "injection", task.name, task.band, number, index)
    place = (offsets_arcsec[0], offsets_arcsec[1]) if offsets_arcsec else None
    place = place or draw_place(visits.geometry, separation_arcsec, rng)
    if place is None:
        return {"place": None, "alarms": []}
    image = seen(*place)
    rate_e_s = visits.science.truth.sources[0].rate_e_s
    alarms: list[float | None] = []
    for contrast in contrasts:
        shown = inject(stack, image, contrast * rate_e_s * stack.integration_s, rng)
        best = recovered(blind.search(shown.image_e), *place, visits.geometry.lambda_d_arcsec)
        alarms.append(None if best is None else best.false_alarms)
    return {"place": list(place), "alarms": alarms}
