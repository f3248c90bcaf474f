"""Motion of planets within a programme: how far they go, what a stack at rest loses of them, which orbits it searches.

A stack of visits that looks for unknown planets shifts its images along orbits and pays for the trials. While a planet
has not gone far round its star, its path is a straight line, and the orbits are velocities.
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from catalogs import KnownPlanetTable
from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, check_finite
from cpic_planner.planets.allowed import catalogue_masses_msun
from cpic_planner.planets.known_draws import draw_known, known_uniforms, places_at

MOST_SHIFT_LAMBDA_D = 0.3
"""A planet that goes farther within a programme moves; and a searched orbit stays as near to the planet's own."""
ORBIT_DUTY = 0.46
"""Part of the calendar time in which a target is seen from a low orbit, where no calendar says it: 42 of 92 minutes."""
_APERTURE_LAMBDA_D = 0.7
# The image behind the shipped apodizer of four quadrants is that of a clear pupil of this diameter, relative to the
# telescope's: light beside the middle to 0.3 %, roughness to 3 % in F520, F662 and F850.
_PUPIL = 0.65
_SPEED_AU_DAY = 2.0 * math.pi / 365.25  # of a circular orbit of 1 au around 1 solar mass
_FARTHEST_LAMBDA_D, _N_PLACES, _N_FREQUENCIES = 40.0, 2001, 400


def star_masses_msun(
    names: Sequence[str], log_g: ArrayLike, luminosity_lsun: ArrayLike, teff_k: ArrayLike
) -> FloatArray:
    """Masses of stars: of the embedded catalogue, else from gravity, luminosity and temperature.

    Parameters
    ----------
    names : sequence of str
        ``n`` stars.
    log_g, luminosity_lsun, teff_k : array_like, shape (n,)

    Returns
    -------
    ndarray, shape (n,)
        Solar masses; those that are not of the catalogue between 0.2 and 5, and 1 where a number is missing.

    """
    listed = catalogue_masses_msun(names)
    return np.where(np.isfinite(listed), listed, masses_of_gravity_msun(log_g, luminosity_lsun, teff_k))


def masses_of_gravity_msun(log_g: ArrayLike, luminosity_lsun: ArrayLike, teff_k: ArrayLike) -> FloatArray:
    """Return masses from surface gravity, luminosity and temperature, solar masses, shape ``(n,)``.

    ``log M = log g - 4.438 + 2 log R`` with ``R^2 = L (5772 K / Teff)^4``: the inverse of how
    `catalogs.stellar_physics` fills the gravity. Held between 0.2 and 5, where a measured gravity and an assumed
    luminosity disagree; 1 where a number is missing.
    """
    gravity, luminosity, teff = (np.asarray(part, float) for part in (log_g, luminosity_lsun, teff_k))
    mass = 10.0 ** (gravity - 4.438) * luminosity * (5772.0 / teff) ** 4
    return np.clip(np.where(np.isfinite(mass), mass, 1.0), 0.2, 5.0)


def span_days(time_s: ArrayLike, visits: ArrayLike, gap_h: ArrayLike = 0.0, duty: ArrayLike = ORBIT_DUTY) -> FloatArray:
    """Return the days from the begin of the first visit to the end of the last.

    Parameters
    ----------
    time_s : array_like
        Of all visits together, references and overheads included; at least 0.
    visits : array_like
        Number of visits, at least 1.
    gap_h : array_like
        Between the end of a visit and the begin of the next, at least 0.
    duty : array_like
        Part of the calendar time that is observed within a visit, above 0 and at most 1.

    Raises
    ------
    InputError
        If an argument is out of range.
    """
    return _calendar_days(time_s, visits, gap_h, duty)[0]


def _calendar_days(
    time_s: ArrayLike, visits: ArrayLike, gap_h: ArrayLike, duty: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return the span, and the rms distance of the light from its middle date, in days."""
    time, many, gap, part = _checked(time_s=time_s, visits=visits, gap_h=gap_h, duty=duty)
    visit = time / many / part / 86400.0
    start_to_start = visit + gap / 24.0
    span = (many - 1.0) * start_to_start + visit
    return span, np.sqrt((start_to_start**2 * (many**2 - 1.0) + visit**2) / 12.0)


_RANGES = {
    "time_s": ("s", 0.0, math.inf, "at least 0"),
    "visits": ("", 1.0, math.inf, "at least 1"),
    "gap_h": ("h", 0.0, math.inf, "at least 0"),
    "duty": ("", 1e-6, 1.0, "above 0 and at most 1"),
    "sigma": ("sigma", 1.0, 20.0, "from 1 to 20"),
    "shift_lambda_d": ("lambda/D", 0.0, math.inf, "at least 0"),
    "separation_arcsec": ("arcsec", 1e-6, math.inf, "above 0"),
    "distance_pc": ("pc", 1e-6, math.inf, "above 0"),
    "star_mass_msun": ("M_Sun", 1e-6, math.inf, "above 0"),
    "lambda_d_arcsec": ("arcsec", 1e-6, math.inf, "above 0"),
}


def _checked(**values: ArrayLike) -> list[FloatArray]:
    """Return arguments as arrays, or refuse the first that is out of range."""
    arrays = []
    for key, value in values.items():
        unit, low, high, allowed = _RANGES[key]
        array = check_finite(key, value, unit)
        wrong = (array < low) | (array > high)
        if wrong.any():
            raise InputError(key, float(array[wrong][0]), unit=unit, allowed=allowed)
        arrays.append(array)
    return arrays


@functools.cache
def _aperture_track() -> tuple[FloatArray, FloatArray, float]:
    """Offsets from 0 in lambda/D, the integral of the aperture's light up to each, and the roughness of matched noise.

    Of the image of a clear round pupil that is as wide as that of the apodizer. The light in an aperture whose centre
    is beside the image's is the integral of the transfer function with that of the aperture; white noise that is
    filtered with the image has the square of the transfer function as its power spectrum, and minus the curvature of
    its correlation is the roughness.
    """
    from scipy.special import j0, j1

    relative = (np.arange(_N_FREQUENCIES) + 0.5) / _N_FREQUENCIES
    transfer, frequency = np.arccos(relative) - relative * np.sqrt(1.0 - relative**2), _PUPIL * relative
    offset = _FARTHEST_LAMBDA_D * np.linspace(0.0, 1.0, _N_PLACES) ** 2  # closer where the light falls first
    aperture = transfer * j1(2.0 * np.pi * _APERTURE_LAMBDA_D * frequency)
    light = j0(2.0 * np.pi * offset[:, None] * frequency) @ aperture
    along = np.concatenate([[0.0], np.cumsum((light[1:] + light[:-1]) * np.diff(offset) / 2.0)]) / light[0]
    power = transfer**2 * frequency
    roughness = 2.0 * np.pi**2 * float((power * frequency**2).sum() / power.sum())
    return offset, along, roughness


def smeared(shift_lambda_d: ArrayLike) -> FloatArray:
    """Part of a planet's light that its aperture gets in a stack in which it goes along a straight line.

    Parameters
    ----------
    shift_lambda_d : array_like
        Way from the first frame to the last, with the aperture on its middle; at least 0.

    Returns
    -------
    ndarray
        Relative to a planet at rest; the aperture has a radius of 0.7 lambda/D.

    Raises
    ------
    InputError
        If the way is not at least 0.
    """
    (shift,) = _checked(shift_lambda_d=shift_lambda_d)
    offset, along, _ = _aperture_track()
    half = np.maximum(shift / 2.0, 1e-6)
    return np.asarray(np.minimum(np.interp(half, offset, along) / half, 1.0))


@dataclass(frozen=True, eq=False)
class ProgrammeMotion:
    """Motion of a planet that nobody knows within a programme; arrays of one shape.

    Attributes
    ----------
    span_days : ndarray
        From the begin of the first visit to the end of the last.
    shift_lambda_d : ndarray
        Most that a planet on a circular orbit of that radius goes in this time: on an orbit seen from its pole.
    planet_moves : ndarray of bool
        Whether that is more than 0.3 lambda/D.
    kept_at_rest : ndarray
        Part of the signal that a stack keeps that does not follow the planet (`smeared`).
    n_orbits : ndarray
        Velocities that the search goes through, one where all are near enough to rest.
    trials : ndarray
        Number by which false alarms are more than in a search at rest, at the threshold ``sigma``.
    kept : ndarray
        Least part of the signal that the searched orbit next to the planet's own keeps.
    sigma : ndarray
        Gaussian significance with the false alarms of the one asked for, once every trial has its own.
    longest_span_days : ndarray
        Time in which a circular orbit bends from its best straight line by 0.3 lambda/D.
    straight : ndarray of bool
        Whether the span is not longer: a search over velocities finds no planet beyond.
    """

    span_days: FloatArray
    shift_lambda_d: FloatArray
    planet_moves: BoolArray
    kept_at_rest: FloatArray
    n_orbits: FloatArray
    trials: FloatArray
    kept: FloatArray
    sigma: FloatArray
    longest_span_days: FloatArray
    straight: BoolArray


def programme_motion(
    separation_arcsec: ArrayLike,
    distance_pc: ArrayLike,
    star_mass_msun: ArrayLike,
    lambda_d_arcsec: ArrayLike,
    time_s: ArrayLike,
    visits: ArrayLike = 1.0,
    *,
    gap_h: ArrayLike = 0.0,
    duty: ArrayLike = ORBIT_DUTY,
    sigma: ArrayLike = 5.0,
) -> ProgrammeMotion:
    """Return what a blind search in the stack of a programme does about the motion of planets.

    Parameters
    ----------
    separation_arcsec : array_like
        Projected; the planet is at least that far from its star. All arguments broadcast.
    distance_pc, star_mass_msun, lambda_d_arcsec : array_like
        Of the star, and the resolution of the band; above 0.
    time_s, visits, gap_h, duty
        As of `span_days`.
    sigma : array_like
        Gaussian significance whose false alarms a search at rest may have, 1 to 20.

    Returns
    -------
    ProgrammeMotion

    Raises
    ------
    InputError
        If an argument is out of range.

    Notes
    -----
    A planet that is bound moves by at most ``sqrt(2 G M / r)`` with r the projected distance: the search covers this
    disc of velocities with squares whose corners are off by 0.3 lambda/D at both ends of the programme, some
    ``1 + 2 sqrt(2) q + pi q^2 / 2`` of them with q the way of the fastest from the middle date over 0.3 lambda/D.
    Neighbouring velocities share most of their noise. The mean number of peaks of a Gaussian field over position and
    velocity is that over position alone times ``1 + sqrt(c) pi w (u^2 - 1) / (u sqrt(2 pi)) + c w^2 (u^2 - 3) / 2`` at
    a threshold u, with c the roughness of the noise and w the way of the fastest in the rms distance of the light from
    its middle date (Adler & Taylor 2007, Random Fields and Geometry, section 11.8); there are never more trials than
    orbits. Simulated searches of noise have 0.7 to 1 times as many, a difference of a twentieth of a sigma. The
    threshold solves ``n(s') Phi(-s') = Phi(-s)``. A parabola bends by ``a T^2 / 16`` from the best line.

    Examples
    --------
    >>> from cpic_planner.planets.motion import programme_motion
    >>> tau_cet = programme_motion(0.5, 3.65, 0.78, 0.0536, 36000.0, 16, gap_h=24.0)
    >>> round(float(tau_cet.span_days), 1), round(float(tau_cet.shift_lambda_d), 2), round(float(tau_cet.sigma), 2)
    (15.9, 0.91, 5.35)
    """
    from scipy.special import ndtr, ndtri

    place, distance, mass, width, level = _checked(
        separation_arcsec=separation_arcsec,
        distance_pc=distance_pc,
        star_mass_msun=star_mass_msun,
        lambda_d_arcsec=lambda_d_arcsec,
        sigma=sigma,
    )
    span, spread = _calendar_days(time_s, visits, gap_h, duty)
    radius = place * distance
    # lambda/D per day, and per day squared, of a circular orbit seen from its pole.
    speed = _SPEED_AU_DAY * np.sqrt(mass / radius) / (distance * width)
    pull = _SPEED_AU_DAY**2 * mass / radius**2 / (distance * width)
    shift, fastest = speed * span, math.sqrt(2.0) * speed
    cells = fastest * span / (2.0 * MOST_SHIFT_LAMBDA_D)
    orbits = np.where(cells > 1.0, np.ceil(1.0 + 2.0 * math.sqrt(2.0) * cells + math.pi / 2.0 * cells**2), 1.0)
    way = math.sqrt(_aperture_track()[2]) * fastest * spread
    alone, higher = ndtr(-level), level
    for _ in range(4):  # the number of trials depends on the threshold as its square, which it moves by some per cent
        edge = math.sqrt(math.pi / 2.0) * way * (higher**2 - 1.0) / higher
        trials = np.minimum(1.0 + edge + way**2 * np.maximum(higher**2 - 3.0, 0.0) / 2.0, orbits)
        higher = -ndtri(alone / trials)
    longest = np.sqrt(16.0 * MOST_SHIFT_LAMBDA_D / pull)
    values = np.broadcast_arrays(
        span,
        shift,
        shift > MOST_SHIFT_LAMBDA_D,
        smeared(shift),
        orbits,
        trials,
        smeared(np.minimum(shift, 2.0 * MOST_SHIFT_LAMBDA_D)),
        higher,
        longest,
        span <= longest,
    )
    return ProgrammeMotion(*values)


def known_shift_arcsec(
    table: KnownPlanetTable,
    row: int,
    mjd: float,
    days: ArrayLike,
    *,
    distance_pc: float,
    star_mass_msun: float | None = None,
    n_draws: int = 400,
    seed: int = 1,
) -> FloatArray:
    """Return how far a known planet goes in some days: the median of draws of its orbit.

    Parameters
    ----------
    table : KnownPlanetTable
    row : int
    mjd : float
        When it begins.
    days : array_like, shape (n,)
    distance_pc : float
        Of the star.
    star_mass_msun : float, optional
        Where the table has none.
    n_draws, seed : int

    Returns
    -------
    ndarray, shape (n,)
        Arcseconds.
    """
    uniforms = known_uniforms(table, [row], n_draws, seed)
    drawn = draw_known(table, [row], uniforms, epoch_mjd=mjd, star_mass_msun=star_mass_msun)
    places = places_at(drawn, 0, mjd + np.concatenate([[0.0], np.atleast_1d(np.asarray(days, float))]))
    east, north = (np.asarray(part)[:, 1:] - np.asarray(part)[:, :1] for part in (places.east_au, places.north_au))
    return np.asarray(np.median(np.hypot(east, north), axis=0) / distance_pc)
