"""Where the telescope is and what it sees: state vectors, angles from Sun, Moon and the limb of the Earth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulator.config.mission import OrbitConfig
from simulator.products.orbit import CircularOrbit, earth_radius_deg
from simulator.products.times import offline_time

__all__ = ["Ephemeris", "body_km", "ephemeris"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Ephemeris:
    """State of the telescope and angles of the target at several times, all from a modelled orbit.

    Attributes
    ----------
    position_km, velocity_km_s : ndarray, shape (n, 3)
        Geocentric, axes of the GCRS.
    sun_deg, moon_deg : ndarray, shape (n,), or None
        Angle of the target from Sun and Moon as seen from the telescope; None without a target.
    limb_deg : ndarray, shape (n,), or None
        Height of the target over the limb of the solid Earth; negative: behind it.
    """

    position_km: FloatArray
    velocity_km_s: FloatArray
    sun_deg: FloatArray | None = None
    moon_deg: FloatArray | None = None
    limb_deg: FloatArray | None = None


def ephemeris(orbit: OrbitConfig, utc: tuple[str, ...], target_deg: tuple[float, float] | None) -> Ephemeris:
    """Telescope and target at some times.

    Parameters
    ----------
    orbit : OrbitConfig
    utc : tuple of str
        Times, ISO 8601.
    target_deg : tuple of float or None
        Right ascension and declination.

    Notes
    -----
    Sun and Moon are those of astropy's built-in ephemeris (ERFA); nothing is fetched. The aberration of the target's
    light (0.01 deg) is neglected.
    """
    from astropy.time import Time

    with offline_time():
        times = Time(list(utc), format="isot", scale="utc")
        elapsed = (times - Time(orbit.epoch_utc, format="isot", scale="utc")).to_value("s")
        position, velocity = CircularOrbit(orbit).state(elapsed)
        if target_deg is None:
            return Ephemeris(position, velocity)
        ra, dec = np.deg2rad(target_deg)
        target = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])

        def angle_from(body: str) -> FloatArray:
            return _angle_deg(body_km(body, times) - position, target)

        distance = np.linalg.norm(position, axis=-1)
        limb = _angle_deg(-position, target) - earth_radius_deg(distance)
        return Ephemeris(position, velocity, angle_from("sun"), angle_from("moon"), limb)


def body_km(body: str, times: Any) -> FloatArray:
    """Geocentric place of a body of the solar system, axes of the GCRS, by astropy's built-in ephemeris.

    Parameters
    ----------
    body : str
        ``"sun"`` or ``"moon"``.
    times : astropy.time.Time, shape (n,)
        Made, like this call, inside of `simulator.products.times.offline_time`.

    Returns
    -------
    ndarray, shape (n, 3)
    """
    from astropy.coordinates import get_body

    place: Any = get_body(body, times, ephemeris="builtin").cartesian.xyz.to_value("km")
    return np.asarray(place.T, dtype=np.float64)


def _angle_deg(vectors: FloatArray, direction: FloatArray) -> FloatArray:
    """Angle between vectors and a unit vector, exact near 0 and 180 degrees too."""
    across = np.linalg.norm(np.cross(vectors, direction), axis=-1)
    result: FloatArray = np.rad2deg(np.arctan2(across, vectors @ direction))
    return result
