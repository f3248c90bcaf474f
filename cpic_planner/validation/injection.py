"""Injection and recovery: how often the blind detector finds planets of known place and contrast."""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, IntArray, stream
from cpic_planner.validation.apertures import require
from cpic_planner.validation.detection import BlindSearch, Candidate, search
from cpic_planner.validation.reduced import ReducedStack
from cpic_planner.validation.speckle_maps import SpeckleMaps
from simulator.detectors import excess_noise_factor2
from simulator.imaging import AnyPsf

_MATCH_LAMBDA_D = 1.0
_RING_PIXELS = 0.7


@dataclass(frozen=True, eq=False)
class CompletenessMap:
    """Planets recovered by a blind search.

    Attributes
    ----------
    separation_arcsec : ndarray, shape (s,)
    contrast : ndarray, shape (c,)
        Ascending.
    n_recovered : ndarray of int, shape (s, c)
        Injected planets that were detected within lambda/D of their place.
    n_injected : int
        Planets in each cell.
    sigma : float
        Level of the search.
    """

    separation_arcsec: FloatArray
    contrast: FloatArray
    n_recovered: IntArray
    n_injected: int
    sigma: float

    @property
    def fraction(self) -> FloatArray:
        """Recovered over injected, shape (s, c)."""
        return self.n_recovered / self.n_injected

    @property
    def error(self) -> FloatArray:
        """Standard deviation of the fraction, from its posterior under a uniform prior; never 0. Shape (s, c)."""
        return fraction_error(self.n_recovered, self.n_injected)

    def contrast_at(self, fraction: float = 0.5) -> FloatArray:
        """Contrast that is recovered that often, one per separation: a logistic curve in the logarithm of the contrast.

        ``inf`` where the curve does not rise or the level lies beyond the contrasts that were tried.
        """
        if not 0.0 < fraction < 1.0:
            raise InputError("fraction", fraction, allowed="between 0 and 1")
        level, wanted = np.log(self.contrast), math.log(fraction / (1.0 - fraction))
        found = np.full(self.separation_arcsec.shape, np.inf)
        for row, hits in enumerate(self.n_recovered):
            middle, slope = _logistic(level, hits.astype(float), float(self.n_injected))
            place = middle + wanted / slope if slope > 0 else math.inf
            if level[0] <= place <= level[-1]:
                found[row] = math.exp(place)
        return found


def fraction_error(hits: IntArray, trials: int) -> FloatArray:
    """Standard deviation of a fraction of trials, from its posterior under a uniform prior; never 0.

    Parameters
    ----------
    hits : ndarray of int
        Trials that succeeded.
    trials : int
        All of them.
    """
    more, total = hits + 1.0, trials + 2.0
    return np.sqrt(more * (total - more) / (total**2 * (total + 1.0)))


def inject(
    stack: ReducedStack,
    psf: AnyPsf,
    x_arcsec: float,
    y_arcsec: float,
    total_e: float,
    rng: np.random.Generator | None = None,
) -> ReducedStack:
    """Add a planet to a residual.

    Parameters
    ----------
    stack : ReducedStack
        Without that planet.
    psf : Psf
    x_arcsec, y_arcsec : float
        Place on the detector, inside the stamp.
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
    mean = np.where(stack.region, total_e * np.asarray(psf.at(x_arcsec, y_arcsec), float), 0.0)
    light = mean
    if rng is not None:
        light = rng.poisson(np.maximum(mean, 0.0)).astype(float)
        spread = max(float(excess_noise_factor2(stack.em_gain, stack.stages)) - 1.0, 0.0)
        light += np.sqrt(spread * light) * rng.standard_normal(light.shape)
    return dataclasses.replace(stack, image_e=stack.image_e + stack.rdi.project(np.where(stack.region, light, 0.0)))


def recovered(found: BlindSearch, x_arcsec: float, y_arcsec: float, lambda_d_arcsec: float) -> Candidate | None:
    """Most significant candidate within lambda/D of a place, detected or not.

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


def completeness_map(
    stacks: Sequence[ReducedStack],
    psf: AnyPsf,
    maps: SpeckleMaps,
    *,
    star_rate_e_s: float,
    separations_arcsec: ArrayLike,
    contrasts: ArrayLike,
    sigma: float = 5.0,
    seed: int = 0,
) -> CompletenessMap:
    """Inject one planet at a time into planet-free residuals and search for it.

    Parameters
    ----------
    stacks : sequence of ReducedStack
        Residuals of independent visits without planets. Each serves one planet in every cell: cells share their
        speckles, planets of one cell do not.
    psf, maps, star_rate_e_s, sigma
        As in `cpic_planner.validation.detection.search`.
    separations_arcsec : array_like, shape (s,)
        Circles of which some pixels lie in the hole; the azimuth of every planet is drawn among these.
    contrasts : array_like, shape (c,)
        Above 0, ascending.
    seed : int
        Of azimuths and photons.

    Raises
    ------
    InputError
        If an argument is out of range.
    """
    places = np.atleast_1d(np.asarray(separations_arcsec, float))
    ratios = np.atleast_1d(np.asarray(contrasts, float))
    if not len(stacks):
        raise InputError("stacks", 0, allowed="at least one residual")
    if not (np.isfinite(ratios).all() and (ratios > 0).all() and (np.diff(ratios) > 0).all()):
        raise InputError("contrasts", contrasts, allowed="above 0 and ascending")
    geometry = psf.geometry
    hits = np.zeros((places.size, ratios.size), np.int64)
    for visit, stack in enumerate(stacks):
        for row, place in enumerate(places):
            rng = stream(seed, "injection", visit, row)
            x, y = draw_place(stack, float(place), geometry.pixel_scale_arcsec, rng)
            for column, ratio in enumerate(ratios):
                planet = inject(stack, psf, x, y, ratio * star_rate_e_s * stack.integration_s, rng)
                found = search(planet, psf, maps, star_rate_e_s=star_rate_e_s, sigma=sigma)
                best = recovered(found, x, y, geometry.lambda_d_arcsec)
                hits[row, column] += best is not None and best.detected
    return CompletenessMap(places, ratios, hits, len(stacks), sigma)


def draw_place(
    stack: ReducedStack, separation_arcsec: float, pixel_scale_arcsec: float, rng: np.random.Generator
) -> tuple[float, float]:
    """Random place in the hole at a separation, x and y in arcsec on the detector.

    Parameters
    ----------
    stack : ReducedStack
    separation_arcsec : float
        Projected separation from the star, arcsec, above 0.
    pixel_scale_arcsec : float
        Side of a pixel, arcsec.
    rng : numpy.random.Generator
        Source of random numbers; a seed gives the same draws.
    """
    y, x = (np.asarray(part, float) - len(stack.region) // 2 for part in np.nonzero(stack.region))
    radius = separation_arcsec / pixel_scale_arcsec
    ring = np.flatnonzero(np.abs(np.hypot(x, y) - radius) <= _RING_PIXELS)
    require("separations_arcsec", separation_arcsec, ring.size > 0, "arcsec", "circles that cross the hole")
    chosen = int(rng.choice(ring))
    angle = math.atan2(y[chosen], x[chosen])
    return separation_arcsec * math.cos(angle), separation_arcsec * math.sin(angle)


def _logistic(level: FloatArray, hits: FloatArray, trials: float) -> tuple[float, float]:
    """Middle and slope of the most probable logistic curve; a half success and failure at either end keep it finite."""
    from scipy.optimize import minimize

    width = max(float(level[-1] - level[0]), 1e-6)
    beyond = np.concatenate([[level[0] - 3.0 * width], level, [level[-1] + 3.0 * width]])
    won = np.concatenate([[0.0], hits, [0.5]])
    lost = np.concatenate([[0.5], trials - hits, [0.0]])

    def cost(shape: FloatArray) -> float:
        score = np.exp(shape[1]) * (beyond - shape[0])
        return float(np.sum(won * np.logaddexp(0.0, -score) + lost * np.logaddexp(0.0, score)))

    starts = [minimize(cost, np.array([middle, math.log(8.0 / width)]), method="Nelder-Mead") for middle in level]
    best = min(starts, key=lambda one: float(one.fun))
    return float(best.x[0]), float(np.exp(best.x[1]))
