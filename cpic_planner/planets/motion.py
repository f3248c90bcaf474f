"""Motion of planets within a programme: the days that it spans, how far planets go, and what a stack loses of them.

What a search for unknown planets does about it is `cpic_planner.planets.orbit_search`.
"""

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, check_finite, special
from cpic_planner.planets.allowed import catalogue_masses_msun

MOST_SHIFT_LAMBDA_D = 0.3
"""A planet that goes farther within a programme moves; and a searched orbit stays as near to the planet's own."""
ORBIT_DUTY = 0.46
"""Part of the calendar time in which a target is seen from a low orbit, where no calendar says it: 42 of 92 minutes."""
_APERTURE_LAMBDA_D = 0.7
# The image behind the shipped apodizer of four quadrants is that of a clear pupil of this diameter, relative to the
# telescope's: light beside the middle to 0.3 %, roughness to 3 % in F520, F662 and F850.
_PUPIL = 0.65
_FARTHEST_LAMBDA_D, _N_PLACES, _N_FREQUENCIES = 40.0, 2001, 400


def star_masses_msun(
    names: Sequence[str], log_g: ArrayLike, luminosity_lsun: ArrayLike, teff_k: ArrayLike
) -> FloatArray:
    """Return the masses of stars: of the embedded catalogue, else from gravity, luminosity and temperature.

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
    time, many, gap, part = in_range(time_s=time_s, visits=visits, gap_h=gap_h, duty=duty)
    return time / part / 86400.0 + (many - 1.0) * gap / 24.0


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


def in_range(**values: ArrayLike) -> list[FloatArray]:
    """Return arguments as arrays, or refuse the first that is out of range.

    Parameters
    ----------
    **values
        Numbers by the names that the functions of motion have for them.
    """
    arrays = []
    for key, value in values.items():
        unit, low, high, allowed = _RANGES[key]
        array = check_finite(key, value, unit)
        wrong = (array < low) | (array > high)
        if wrong.any():
            raise InputError(key, float(array[wrong][0]), unit=unit, allowed=allowed)
        arrays.append(array)
    return arrays


class ApertureTrack(NamedTuple):
    """Offsets from 0 in lambda/D, light there relative to offset 0, its integral, and roughness of matched noise."""

    offset: FloatArray
    light: FloatArray
    along: FloatArray
    roughness: float


@functools.cache
def aperture_track() -> ApertureTrack:
    """Return how the light in an aperture falls beside the middle of an image, and the roughness of matched noise.

    Of the image of a clear round pupil that is as wide as that of the apodizer. The light in an aperture whose centre
    is beside the image's is the integral of the transfer function with that of the aperture; white noise that is
    filtered with the image has the square of the transfer function as its power spectrum, and minus the curvature of
    its correlation is the roughness.
    """
    relative = (np.arange(_N_FREQUENCIES) + 0.5) / _N_FREQUENCIES
    transfer, frequency = np.arccos(relative) - relative * np.sqrt(1.0 - relative**2), _PUPIL * relative
    offset = _FARTHEST_LAMBDA_D * np.linspace(0.0, 1.0, _N_PLACES) ** 2  # closer where the light falls first
    aperture = transfer * special().j1(2.0 * np.pi * _APERTURE_LAMBDA_D * frequency)
    light = special().j0(2.0 * np.pi * offset[:, None] * frequency) @ aperture
    along = np.concatenate([[0.0], np.cumsum((light[1:] + light[:-1]) * np.diff(offset) / 2.0)]) / light[0]
    power = transfer**2 * frequency
    roughness = 2.0 * np.pi**2 * float((power * frequency**2).sum() / power.sum())
    return ApertureTrack(offset, light / light[0], along, roughness)


def smeared(shift_lambda_d: ArrayLike) -> FloatArray:
    """Return the part of a planet's light that its aperture gets in a stack in which it goes along a straight line.

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
    (shift,) = in_range(shift_lambda_d=shift_lambda_d)
    track, half = aperture_track(), np.maximum(shift / 2.0, 1e-6)
    return np.asarray(np.minimum(np.interp(half, track.offset, track.along) / half, 1.0))
