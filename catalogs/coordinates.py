"""Star positions: space motion between epochs, tangent-plane offsets, neighbours, ecliptic coordinates.

Pure numpy; angles in degrees, ICRS throughout. Proper motion in right ascension includes the factor cos(dec).
"""

from typing import NamedTuple

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, check_finite

#: km/s of one au per Julian year (IAU 2012 au, 365.25 d).
_KM_S_PER_AU_YR = 149597870.7 / (365.25 * 86400.0)
_ARCSEC_PER_RAD = 180.0 * 3600.0 / np.pi
_MAS_PER_RAD = 1000.0 * _ARCSEC_PER_RAD
#: Mean obliquity of the ecliptic at J2000.0 (IAU 2006 precession, Capitaine et al. 2003): 84381.406 arcsec.
_OBLIQUITY_RAD = 84381.406 / _ARCSEC_PER_RAD
_MOST_PAIRS = 1_000_000


class Propagated(NamedTuple):
    """Astrometry at another epoch; every field has the broadcast shape of the input."""

    ra_deg: FloatArray
    dec_deg: FloatArray
    pm_ra_mas_yr: FloatArray
    pm_dec_mas_yr: FloatArray
    parallax_mas: FloatArray
    rv_km_s: FloatArray


def propagate(
    ra_deg: ArrayLike,
    dec_deg: ArrayLike,
    pm_ra_mas_yr: ArrayLike,
    pm_dec_mas_yr: ArrayLike,
    parallax_mas: ArrayLike,
    rv_km_s: ArrayLike,
    epoch_yr: ArrayLike,
    to_epoch_yr: ArrayLike,
) -> Propagated:
    """Move stars along straight lines in space from one epoch to another.

    The barycentric position vector is r(t) = r0 (u + (mu + u mu_r) t) with unit vector u, proper-motion vector mu
    and mu_r = v_r parallax / (4.74 km/s) (ESA SP-1200, vol. 1, section 1.5.5), so foreshortening and the change of
    proper motion, parallax and radial velocity are included. Light-time terms are neglected: below 1 mas over
    50 years for every star of the catalogue. Orbital motion is not included.

    Parameters
    ----------
    ra_deg, dec_deg : array_like
        ICRS position at `epoch_yr`, degrees; dec in [-90, 90].
    pm_ra_mas_yr, pm_dec_mas_yr : array_like
        Proper motion (RA with cos(dec)), mas per Julian year.
    parallax_mas : array_like
        Parallax, mas, > 0.
    rv_km_s : array_like
        Radial velocity, km/s, positive when receding.
    epoch_yr, to_epoch_yr : array_like
        Julian epochs (2000.0 is J2000.0).

    Returns
    -------
    Propagated
        The same six quantities at `to_epoch_yr`; RA in [0, 360).

    Raises
    ------
    InputError
        If a value is not finite, a parallax is not positive or a declination is outside [-90, 90].
    """
    names = ("ra_deg", "dec_deg", "pm_ra_mas_yr", "pm_dec_mas_yr", "parallax_mas", "rv_km_s", "epoch_yr", "to_epoch_yr")
    given = (ra_deg, dec_deg, pm_ra_mas_yr, pm_dec_mas_yr, parallax_mas, rv_km_s, epoch_yr, to_epoch_yr)
    values = [check_finite(name, value) for name, value in zip(names, given, strict=True)]
    ra, dec, pm_ra, pm_dec, parallax, rv, start, end = np.broadcast_arrays(*values)
    if np.any(parallax <= 0.0):
        raise InputError("parallax_mas", float(np.min(parallax)), unit="mas", allowed="> 0")
    if np.any(np.abs(dec) > 90.0):
        raise InputError("dec_deg", float(dec.flat[np.argmax(np.abs(dec))]), unit="deg", allowed="-90 to 90")

    unit, east, north = _triad(ra, dec)
    with np.errstate(over="ignore", invalid="ignore"):
        motion = (pm_ra[..., None] * east + pm_dec[..., None] * north) / _MAS_PER_RAD
        radial = rv / _KM_S_PER_AU_YR * parallax / _MAS_PER_RAD
        velocity = motion + radial[..., None] * unit
        place = unit + velocity * (end - start)[..., None]
        scale = np.linalg.norm(place, axis=-1)
    if not np.all(np.isfinite(scale)):
        late = float(end[~np.isfinite(scale)].flat[0])
        raise InputError("to_epoch_yr", late, unit="yr", allowed="epochs at which the star is at a finite place")
    new_ra = np.rad2deg(np.arctan2(place[..., 1], place[..., 0])) % 360.0
    new_dec = np.rad2deg(np.arctan2(place[..., 2], np.hypot(place[..., 0], place[..., 1])))
    unit, east, north = _triad(new_ra, new_dec)
    speed = velocity / scale[..., None]
    new_parallax = parallax / scale
    pm_ra, pm_dec, radial = (np.sum(speed * axis, axis=-1) * _MAS_PER_RAD for axis in (east, north, unit))
    return Propagated(new_ra, new_dec, pm_ra, pm_dec, new_parallax, radial / new_parallax * _KM_S_PER_AU_YR)


def tangent_offset(
    ra_deg: ArrayLike, dec_deg: ArrayLike, ra0_deg: ArrayLike, dec0_deg: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return gnomonic offsets of a position from a tangent point.

    Parameters
    ----------
    ra_deg, dec_deg : array_like
        Position, degrees.
    ra0_deg, dec0_deg : array_like
        Tangent point, degrees.

    Returns
    -------
    east_arcsec, north_arcsec : ndarray
        Standard coordinates (xi, eta) of the tangent plane, arcsec, positive to the east and to the north.

    Raises
    ------
    InputError
        If a value is not finite or a position is 90 degrees or more from the tangent point.
    """
    dec, dec0, east, north = _differences(ra_deg, dec_deg, ra0_deg, dec0_deg)
    # Half-angle forms keep full precision for offsets of micro-arcseconds.
    turn = 2.0 * np.sin(east / 2.0) ** 2
    cosine = np.cos(north) - np.cos(dec) * np.cos(dec0) * turn
    if np.any(cosine <= 0.0):
        raise InputError("ra_deg, dec_deg", "position", allowed="less than 90 deg from the tangent point")
    xi = np.cos(dec) * np.sin(east) / cosine
    eta = (np.sin(north) + np.sin(dec0) * np.cos(dec) * turn) / cosine
    return np.asarray(xi * _ARCSEC_PER_RAD), np.asarray(eta * _ARCSEC_PER_RAD)


def offset_place(
    ra0_deg: ArrayLike, dec0_deg: ArrayLike, east_arcsec: ArrayLike, north_arcsec: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return the position at gnomonic offsets from a tangent point, the inverse of `tangent_offset`.

    Parameters
    ----------
    ra0_deg, dec0_deg : array_like
        Tangent point, degrees.
    east_arcsec, north_arcsec : array_like
        Standard coordinates (xi, eta) of the tangent plane, arcsec.

    Returns
    -------
    ra_deg, dec_deg : ndarray
        Position, degrees; RA in [0, 360).
    """
    ra0, dec0 = np.deg2rad(ra0_deg), np.deg2rad(dec0_deg)
    xi, eta = (np.asarray(offset, float) / _ARCSEC_PER_RAD for offset in (east_arcsec, north_arcsec))
    along = np.cos(dec0) - eta * np.sin(dec0)
    dec = np.arctan2(np.sin(dec0) + eta * np.cos(dec0), np.hypot(xi, along))
    return np.rad2deg(ra0 + np.arctan2(xi, along)) % 360.0, np.rad2deg(dec)


def position_angle(east: ArrayLike, north: ArrayLike) -> FloatArray:
    """Return the position angle in degrees, east of north, in [0, 360), of an offset (any common unit).

    Parameters
    ----------
    east, north : array_like
        Offset towards east and north, in one unit.

    Raises
    ------
    InputError
        If a value is not finite.
    """
    pa = np.rad2deg(np.arctan2(check_finite("east", east), check_finite("north", north))) % 360.0
    # A tiny negative angle rounds to 360 itself.
    return np.where(pa == 360.0, 0.0, pa)


def separation_arcsec(ra_deg: ArrayLike, dec_deg: ArrayLike, ra0_deg: ArrayLike, dec0_deg: ArrayLike) -> FloatArray:
    """Return the angle between two positions (degrees), arcsec, 0 to 180 degrees.

    The haversine formula gives the squared sine of half the angle, and one like it the squared cosine: between them the
    arc tangent keeps its digits from micro-arcseconds to the antipode.

    Parameters
    ----------
    ra_deg, dec_deg, ra0_deg, dec0_deg : array_like
        Two positions, degrees; they broadcast.
    """
    dec, dec0, east, north = _differences(ra_deg, dec_deg, ra0_deg, dec0_deg)
    wide = np.cos(dec) * np.cos(dec0)
    sine = np.sin(north / 2.0) ** 2 + wide * np.sin(east / 2.0) ** 2
    cosine = np.sin((dec + dec0) / 2.0) ** 2 + wide * np.cos(east / 2.0) ** 2
    return np.asarray(2.0 * np.arctan2(np.sqrt(sine), np.sqrt(cosine)) * _ARCSEC_PER_RAD)


def neighbours(ra_deg: ArrayLike, dec_deg: ArrayLike, reach_arcsec: float) -> list[dict[int, float]]:
    """Return the neighbours of each of many positions: their rows, in order, with separations in arcsec.

    Parameters
    ----------
    ra_deg, dec_deg : array_like, shape (n,)
        Positions, degrees.
    reach_arcsec : float
        Largest separation, arcsec, below half the sky.

    Raises
    ------
    InputError
        If there are more than a million pairs: that is no sky of stars, and would take hours.
    """
    from scipy.spatial import KDTree

    places = check_finite("ra_deg", ra_deg), check_finite("dec_deg", dec_deg)
    ra, dec = map(np.deg2rad, places)
    near: list[dict[int, float]] = [{} for _ in range(ra.size)]
    if not near:
        return near
    tree = KDTree(np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=1))
    chord = 2.0 * np.sin(reach_arcsec / _ARCSEC_PER_RAD / 2.0) * (1.0 + 1e-6) + 1e-12  # the separation itself decides
    n_pairs = (int(tree.count_neighbors(tree, chord)) - ra.size) // 2
    if n_pairs > _MOST_PAIRS:
        allowed = f"at most {_MOST_PAIRS} within {reach_arcsec:g} arcsec of each other"
        raise InputError("pairs of neighbouring stars", n_pairs, allowed=allowed)
    first, second = tree.query_pairs(chord, output_type="ndarray").T
    sep = separation_arcsec(*(angle[rows] for rows in (first, second) for angle in places))
    for i, j, between in sorted(zip(first.tolist(), second.tolist(), sep.tolist(), strict=True)):
        if between < reach_arcsec:
            near[i][j] = near[j][i] = between
    return near


def ecliptic(ra_deg: ArrayLike, dec_deg: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return ecliptic longitude and latitude (mean ecliptic and equinox J2000.0) of ICRS positions.

    Parameters
    ----------
    ra_deg, dec_deg : array_like
        ICRS position, degrees. The frame bias (0.02 arcsec) is neglected.

    Returns
    -------
    lon_deg, lat_deg : ndarray
        Longitude in [0, 360) and latitude, degrees.

    Raises
    ------
    InputError
        If a value is not finite.
    """
    ra, dec = np.deg2rad(check_finite("ra_deg", ra_deg)), np.deg2rad(check_finite("dec_deg", dec_deg))
    cos_obl, sin_obl = np.cos(_OBLIQUITY_RAD), np.sin(_OBLIQUITY_RAD)
    x = np.cos(dec) * np.cos(ra)
    y = np.cos(dec) * np.sin(ra) * cos_obl + np.sin(dec) * sin_obl
    z = np.sin(dec) * cos_obl - np.cos(dec) * np.sin(ra) * sin_obl
    return np.asarray(np.rad2deg(np.arctan2(y, x)) % 360.0), np.asarray(np.rad2deg(np.arctan2(z, np.hypot(x, y))))


def _differences(
    ra_deg: ArrayLike, dec_deg: ArrayLike, ra0_deg: ArrayLike, dec0_deg: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return both declinations and the differences in right ascension and declination, radians.

    The differences are taken in degrees: those of neighbouring numbers are exact.
    """
    ra, dec = check_finite("ra_deg", ra_deg), check_finite("dec_deg", dec_deg)
    ra0, dec0 = check_finite("ra0_deg", ra0_deg), check_finite("dec0_deg", dec0_deg)
    return np.deg2rad(dec), np.deg2rad(dec0), np.deg2rad(ra - ra0), np.deg2rad(dec - dec0)


def _triad(ra_deg: FloatArray, dec_deg: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the unit vectors towards the star, the local east and the local north, last axis x, y, z."""
    ra, dec = np.deg2rad(ra_deg), np.deg2rad(dec_deg)
    zero = np.zeros_like(ra)
    unit = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=-1)
    east = np.stack([-np.sin(ra), np.cos(ra), zero], axis=-1)
    north = np.stack([-np.sin(dec) * np.cos(ra), -np.sin(dec) * np.sin(ra), np.cos(dec)], axis=-1)
    return unit, east, north
