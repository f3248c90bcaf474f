""""""

import math
import socket
from datetime import datetime, timedelta

import numpy as np
import pytest

from simulator import load_instrument
from simulator.products import CircularOrbit, body_km, earth_radius_deg, mjd_of, offline_time, sequence_times
from simulator.products.ephemeris import EARTH_RADIUS_KM, elapsed_s, ephemeris, stamp


def test_frames_follow_each_other_with_their_dead_time():
    times = sequence_times("2028-03-04T05:06:07.25", 10.0, 1.1, 5)
    start = datetime(2028, 3, 4, 5, 6, 7, 250000)
    begins = [start + timedelta(seconds=index * 11.1) for index in range(5)]
    assert [datetime.fromisoformat(text) for text in times.begin_utc] == begins
    assert [datetime.fromisoformat(text) for text in times.end_utc] == [b + timedelta(seconds=10) for b in begins]
    mjd = [(begin - datetime(1858, 11, 17)) / timedelta(days=1) for begin in begins]
    assert np.abs(times.begin_mjd - mjd).max() * 86400 < 1e-5
    assert times.day == 61834
    # the readout behind the last frame is not part of the sequence
    assert times.stop_utc == "2028-03-04T05:07:01.650000"
    assert (stamp(times.start_utc), stamp(times.stop_utc)) == ("20280304050607", "20280304050701")


def test_a_leap_second_is_a_second():
    times = sequence_times("2016-12-31T23:59:58", 1.0, 0.0, 4)
    assert [stamp(text) for text in times.begin_utc] == [
        "20161231235958",
        "20161231235959",
        "20161231235960",
        "20170101000000",
    ]
    assert times.day == 57753
    assert elapsed_s(57753.0, 57754.0) == pytest.approx(86401.0, abs=1e-4)
    assert elapsed_s(57754.0, 57755.0) == pytest.approx(86400.0, abs=1e-4)


@pytest.mark.parametrize("year", [1973, 2029, 2060, 2100])
def test_any_year_goes_without_network_and_without_a_warning(year, monkeypatch):
    def refuse(*args, **kwargs):
        raise AssertionError("the network was asked")

    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    monkeypatch.setattr(socket.socket, "connect", refuse)
    times = sequence_times(f"{year}-07-01", 86400.0, 0.0, 2)
    assert times.begin_utc[1].startswith(f"{year}-07-02T00:00:00")
    assert mjd_of(times.begin_utc[1]) - times.day == pytest.approx(1.0, abs=1e-9)


def test_stamps_and_header_times_cut_the_same_digits():
    # 29.9999999 s rounds to 30 s at the microsecond: stamp and text must not disagree.
    times = sequence_times("2028-01-01T00:00:00", 29.9999999, 0.0, 1)
    assert times.stop_utc == "2028-01-01T00:00:30.000000"
    assert stamp(times.stop_utc) == "20280101000030"


CONFIG = load_instrument().mission.orbit


def orbit(**values):
    return CircularOrbit(CONFIG.model_copy(update=values))


def test_default_orbit_has_the_published_period_speed_and_drift():
    default = orbit()
    assert default.period_s / 60 == pytest.approx(92.56, abs=0.01)
    assert load_instrument().drift.orbital_period_s == pytest.approx(default.period_s, abs=0.05)
    _, velocity = default.state(np.linspace(0, 6000, 50))
    assert np.linalg.norm(velocity, axis=-1) == pytest.approx(7.67, abs=0.01)
    assert default.node_rate_deg_day == pytest.approx(-6.03, abs=0.01)
    assert 360 / abs(default.node_rate_deg_day) == pytest.approx(59.7, abs=0.1)
    relative = abs(default.node_rate_deg_day) + 360 / 365.2422
    assert 360 / relative == pytest.approx(51.3, abs=0.1)
    assert earth_radius_deg(default.radius_km) == pytest.approx(70.2, abs=0.05)


def test_position_keeps_its_radius_and_its_plane():
    tilted = orbit(inclination_deg=41.5, node_deg=33.0, phase_deg=0.0)
    position, velocity = tilted.state(np.array([0.0]))
    node = np.deg2rad(33.0)
    assert position[0] == pytest.approx(tilted.radius_km * np.array([np.cos(node), np.sin(node), 0.0]), abs=1e-6)
    normal = np.cross(position[0], velocity[0])
    assert np.degrees(np.arccos(normal[2] / np.linalg.norm(normal))) == pytest.approx(41.5, abs=0.1)
    many, _ = tilted.state(np.linspace(0, 1e7, 1000))
    assert np.linalg.norm(many, axis=-1) == pytest.approx(EARTH_RADIUS_KM + 400.0, rel=1e-12)
    assert np.abs(many[:, 2]).max() == pytest.approx(tilted.radius_km * np.sin(np.deg2rad(41.5)), rel=1e-3)


def test_velocity_is_the_derivative_of_position():
    tilted = orbit(node_deg=200.0, phase_deg=77.0)
    moments, step = np.linspace(0, 2e6, 40), 0.01
    before, _ = tilted.state(moments - step)
    after, _ = tilted.state(moments + step)
    _, velocity = tilted.state(moments)
    assert np.abs((after - before) / (2 * step) - velocity).max() < 1e-6


def test_the_node_goes_round_at_its_rate():
    tilted = orbit()
    # whole revolutions later the telescope is at the node again, which has moved
    turns = 155
    position, _ = tilted.state(np.array([turns * tilted.period_s]))
    moved = np.degrees(np.arctan2(position[0, 1], position[0, 0]))
    assert moved == pytest.approx(tilted.node_rate_deg_day * turns * tilted.period_s / 86400, abs=1e-6)
    assert position[0, 2] == pytest.approx(0.0, abs=1e-3)


def test_axes_of_the_plane_hold_the_orbit():
    tilted = orbit(inclination_deg=50.0, node_deg=33.0)
    moments = np.linspace(0, 1e7, 200)
    towards_node, ahead = tilted.plane(moments)
    position, _ = tilted.state(moments)
    normal = np.cross(towards_node, ahead)
    assert np.linalg.norm(normal, axis=-1) == pytest.approx(1.0, abs=1e-12)
    assert np.abs(np.einsum("ij,ij->i", normal, position)).max() < 1e-8 * tilted.radius_km
    assert normal[:, 2] == pytest.approx(np.cos(np.deg2rad(50.0)), abs=1e-12)
    # The pole of the orbit goes round as its node does.
    turned = np.unwrap(np.arctan2(normal[:, 1], normal[:, 0]))
    rate = np.rad2deg(np.polyfit(moments / 86400, turned, 1)[0])
    assert rate == pytest.approx(tilted.node_rate_deg_day, rel=1e-9)


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
