"""Masses of stars; radii of planets from their masses, and the least masses of their radii.

Planets follow Chen & Kipping 2017, ApJ 834, 17.
"""

import functools
from collections.abc import Sequence

import numpy as np

from catalogs import load_stars, star_key
from cpic_core import ArrayLike, FloatArray, InputError, check_finite

EARTHS_IN_MJUP = 317.828
EARTHS_IN_RJUP = 71492.0 / 6378.1
STAR_MJUP = 83.8
"""Mass at which the relation's stars begin, 0.080 solar masses, in Jupiter masses."""
MJUP_IN_MSUN = 9.545942e-4

# Their Table 1: constant (R_Earth), indices, transitions (M_Earth), and intrinsic scatter of ln R.
_CONSTANT = 1.008
_INDICES = (0.2790, 0.589, -0.044)
_TURNS = (2.04, 0.414 * EARTHS_IN_MJUP)
_SCATTER = (0.0403, 0.1460, 0.0737)


def radius_from_mass(mass_mjup: ArrayLike, deviate: ArrayLike = 0.0) -> FloatArray:
    """Return the radius in Jupiter's equatorial radii (71 492 km) of planets and brown dwarfs.

    Parameters
    ----------
    mass_mjup : array_like
        Above 0; beyond 0.08 solar masses the relation of the giants goes on.
    deviate : array_like
        Standard normal number of the scatter about the mean relation; broadcasts.

    Returns
    -------
    ndarray

    Raises
    ------
    InputError
        If a mass is not above 0.

    Notes
    -----
    ``R = 1.008 (M / M_Earth)^0.279`` Earth radii up to 2.04 Earth masses, then index 0.589 up to 0.414 Jupiter masses,
    then -0.044, continuous, with a scatter of 4.0, 14.6 and 7.4 %, here of the natural logarithm.

    Examples
    --------
    >>> from cpic_planner.planets.masses import radius_from_mass
    >>> round(float(radius_from_mass(1.0)), 2)
    1.23
    """
    mass = check_finite("mass_mjup", mass_mjup, "M_Jup")
    if np.any(mass <= 0.0):
        raise InputError("mass_mjup", float(mass.min()), unit="M_Jup", allowed="above 0")
    earths = mass * EARTHS_IN_MJUP
    kind = np.searchsorted(_TURNS, earths, side="left")
    # Each law, continued from the one before it.
    small = _CONSTANT * np.minimum(earths, _TURNS[0]) ** _INDICES[0]
    middle = (np.clip(earths, *_TURNS) / _TURNS[0]) ** _INDICES[1]
    large = (np.maximum(earths, _TURNS[1]) / _TURNS[1]) ** _INDICES[2]
    scatter = np.asarray(_SCATTER)[kind] * np.asarray(deviate, float)
    return np.asarray(small * middle * large * np.exp(scatter) / EARTHS_IN_RJUP)


def least_mass(radius_rjup: ArrayLike) -> FloatArray:
    """Return the least mass, in Jupiter masses, of planets of a radius by the mean relation.

    Parameters
    ----------
    radius_rjup : array_like
        In Jupiter's equatorial radii, above 0.

    Returns
    -------
    ndarray

    Raises
    ------
    InputError
        If a radius is not above 0.

    Notes
    -----
    From 1.0 to 1.28 Jupiter radii the relation has two masses for one radius, up to a factor of 200 apart: giants
    hardly change their radius with their mass. The smaller one is taken. Beyond its largest radius the mass is that of
    the largest, 0.414 Jupiter masses.

    Examples
    --------
    >>> from cpic_planner.planets.masses import least_mass
    >>> least_mass([0.5, 1.0, 1.2]).round(3).tolist()
    [0.084, 0.273, 0.373]
    """
    radius = check_finite("radius_rjup", radius_rjup, "R_Jup")
    if np.any(radius <= 0.0):
        raise InputError("radius_rjup", float(radius.min()), unit="R_Jup", allowed="above 0")
    earths = radius * EARTHS_IN_RJUP
    turns = _turns()
    small = (np.minimum(earths, turns[0]) / _CONSTANT) ** (1.0 / _INDICES[0])
    middle = (np.clip(earths, *turns) / turns[0]) ** (1.0 / _INDICES[1])
    return np.asarray(small * middle / EARTHS_IN_MJUP)


@functools.cache
def _turns() -> FloatArray:
    """Return the radii at which the relation turns, R_Earth."""
    return radius_from_mass(np.array(_TURNS) / EARTHS_IN_MJUP) * EARTHS_IN_RJUP


def catalogue_masses_msun(names: Sequence[str]) -> FloatArray:
    """Return the masses of stars in the embedded catalogue, solar masses, shape ``(n,)``; nan where there is none."""
    masses = _masses()
    return np.array([masses.get(catalogue_name(name) or "", np.nan) for name in names], float)


def catalogue_name(name: str) -> str | None:
    """Return the name in the embedded catalogue of the star that has some name; None for a star that is not in it."""
    return name if name in _masses() else _names_by_key().get(star_key(name))


@functools.cache
def _names_by_key() -> dict[str, str]:
    return {star_key(name): name for name in _masses()}


@functools.cache
def _masses() -> dict[str, float]:
    stars = load_stars()
    return dict(zip(stars.column("name").tolist(), stars.column("mass_msun").tolist(), strict=True))


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
