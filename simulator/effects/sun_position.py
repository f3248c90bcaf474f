"""Where the Sun and a target lie on the ecliptic."""

from __future__ import annotations

import math
from datetime import datetime

from simulator.effects.dates import days_since_j2000

_OBLIQUITY_DEG = 23.4392911  # J2000
_PRECESSION_DEG_PER_DAY = 1.396971 / 36525.0


def sun_longitude_deg(when: datetime) -> float:
    """Geocentric ecliptic longitude of the Sun, mean equinox J2000, 0 to 360 degrees.

    The low-precision formulae of the Astronomical Almanac (section C), brought from the equinox of date to that of
    J2000: good to an arcminute from 1950 to 2100.
    """
    days = days_since_j2000(when)
    mean = 280.460 + 0.9856474 * days
    anomaly = math.radians(357.528 + 0.9856003 * days)
    of_date = mean + 1.915 * math.sin(anomaly) + 0.020 * math.sin(2.0 * anomaly)
    return (of_date - _PRECESSION_DEG_PER_DAY * days) % 360.0


def ecliptic_deg(ra_deg: float, dec_deg: float) -> tuple[float, float]:
    """Ecliptic longitude (0 to 360) and latitude, equinox J2000, of an ICRS position, degrees.

    Parameters
    ----------
    ra_deg : float
        ICRS right ascension, degrees.
    dec_deg : float
        ICRS declination, degrees.
    """
    ra, dec, tilt = math.radians(ra_deg), math.radians(dec_deg), math.radians(_OBLIQUITY_DEG)
    x = math.cos(dec) * math.cos(ra)
    y = math.cos(tilt) * math.cos(dec) * math.sin(ra) + math.sin(tilt) * math.sin(dec)
    z = -math.sin(tilt) * math.cos(dec) * math.sin(ra) + math.cos(tilt) * math.sin(dec)
    return math.degrees(math.atan2(y, x)) % 360.0, math.degrees(math.atan2(z, math.hypot(x, y)))


def elongation_deg(longitude_from_sun_deg: float, latitude_deg: float) -> float:
    """Angle from the Sun of a place on the sky, degrees.

    The arc tangent keeps its digits next to the Sun and opposite it, where the arc cosine has none.
    """
    longitude, latitude = math.radians(longitude_from_sun_deg), math.radians(latitude_deg)
    beside = math.hypot(math.cos(latitude) * math.sin(longitude), math.sin(latitude))
    return math.degrees(math.atan2(beside, math.cos(latitude) * math.cos(longitude)))
