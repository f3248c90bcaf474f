"""Planets put into residuals, what a search finds of them, and how well a fraction of trials is known."""

import dataclasses
import math

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError
from cpic_planner.ranking import inside_zone
from cpic_planner.validation.detection import BlindSearch, Candidate
from cpic_planner.validation.reduced import ReducedStack
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
    return angle[inside_zone(geometry.zone, x, y, geometry.aperture_radius_arcsec)]


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
