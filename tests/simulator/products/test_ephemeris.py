import math
import socket

import numpy as np
import pytest

from simulator import load_instrument
from simulator.products.ephemeris import body_km, ephemeris
from simulator.products.times import offline_time

ORBIT = load_instrument().mission.orbit


def sun_place(days):
    """Right ascension and declination of the Sun, low-precision formula of the Astronomical Almanac (0.01 deg)."""
    mean, anomaly = (280.460 + 0.9856474 * days), math.radians(357.528 + 0.9856003 * days)
    longitude = math.radians(mean + 1.915 * math.sin(anomaly) + 0.020 * math.sin(2 * anomaly))
    tilt = math.radians(23.439 - 4e-7 * days)
    right = math.atan2(math.cos(tilt) * math.sin(longitude), math.cos(longitude))
    return math.degrees(right) % 360, math.degrees(math.asin(math.sin(tilt) * math.sin(longitude)))


@pytest.mark.parametrize(("utc", "days"), [("2028-03-20T12:00:00", 10306.0), ("2001-11-05T12:00:00", 674.0)])
def test_angle_from_the_sun(utc, days):
    # the formula is of date; precession since 2000 is 0.014 deg a year
    ra, dec = sun_place(days)
    assert ephemeris(ORBIT, (utc,), (ra, dec)).sun_deg[0] == pytest.approx(0.0, abs=0.02 + 0.014 * days / 365)
    opposite = ephemeris(ORBIT, (utc,), ((ra + 180) % 360, -dec)).sun_deg[0]
    assert opposite == pytest.approx(180.0, abs=0.02 + 0.014 * days / 365)
    pole = ephemeris(ORBIT, (utc,), (0.0, 90.0)).sun_deg[0]
    assert pole == pytest.approx(90 - dec, abs=0.02 + 0.006 * days / 365)


def test_angle_from_the_moon_has_the_parallax_of_the_telescope():
    from astropy.coordinates import get_body
    from astropy.time import Time

    utc = "2028-01-05T06:00:00"
    geocentric = get_body("moon", Time(utc), ephemeris="builtin")
    target = (geocentric.ra.deg, geocentric.dec.deg)
    times = tuple(f"2028-01-05T0{6 + minute // 60}:{minute % 60:02d}:00" for minute in range(0, 93, 3))
    seen = ephemeris(ORBIT, (utc,), target).moon_deg[0]
    # the base line is 6778 km, the Moon 363000 to 406000 km away
    assert 0.0 < seen <= math.degrees(6778.2 / 363000)
    swing = ephemeris(ORBIT, times, target)
    moved = 0.55 * 92 / 60  # deg, of the Moon itself
    assert swing.moon_deg.max() < math.degrees(6778.2 / 363000) + moved
    across = np.linalg.norm(np.cross(swing.position_km, geocentric.cartesian.xyz.to_value("km")), axis=-1)
    expected = np.degrees(across[0] / geocentric.distance.km / geocentric.distance.km)
    assert seen == pytest.approx(expected, rel=0.03)


def test_height_over_the_limb():
    start = ephemeris(ORBIT, (ORBIT.epoch_utc,), None)
    assert start.sun_deg is start.moon_deg is start.limb_deg is None
    up = start.position_km[0] / np.linalg.norm(start.position_km[0])
    ra, dec = math.degrees(math.atan2(up[1], up[0])) % 360, math.degrees(math.asin(up[2]))
    radius = math.degrees(math.asin(6378.137 / 6778.137))
    assert ephemeris(ORBIT, (ORBIT.epoch_utc,), (ra, dec)).limb_deg[0] == pytest.approx(180 - radius)
    assert ephemeris(ORBIT, (ORBIT.epoch_utc,), ((ra + 180) % 360, -dec)).limb_deg[0] == pytest.approx(-radius)


def test_no_network_and_no_warning_in_the_far_future(monkeypatch):
    def refuse(*args, **kwargs):
        raise AssertionError("the network was asked")

    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    monkeypatch.setattr(socket.socket, "connect", refuse)
    found = ephemeris(ORBIT, ("2045-06-01T00:00:00", "2099-06-01T00:00:00"), (10.0, 20.0))
    assert np.isfinite(found.sun_deg).all()
    assert np.isfinite(found.moon_deg).all()


def test_places_of_sun_and_moon():
    from astropy.time import Time

    with offline_time():
        times = Time([61771.0, 61772.0, 70000.0], format="mjd", scale="utc")
        sun, moon = body_km("sun", times), body_km("moon", times)
    assert sun.shape == moon.shape == (3, 3)
    assert np.linalg.norm(sun, axis=-1) == pytest.approx(1.496e8, rel=0.018)
    assert np.linalg.norm(moon, axis=-1) == pytest.approx(3.844e5, rel=0.075)
