"""The closed forms against astropy."""

import numpy as np
import pytest
from astropy.coordinates import BarycentricMeanEcliptic, GeocentricMeanEcliptic, SkyCoord, get_sun
from astropy.time import Time

from simulator.effects.dates import parse_utc
from simulator.effects.sun_position import ecliptic_deg, elongation_deg, sun_longitude_deg


@pytest.mark.parametrize("year", [1972, 1976, 2000, 2028, 2061, 2099])
def test_sun_is_within_an_arcminute(year):
    for month in range(1, 13):
        text = f"{year}-{month:02d}-{2 * month:02d}T0{month % 8}:30:00"
        when = Time(text, scale="tdb")  # a minute from UTC: 0.05 arcmin
        there = get_sun(when).transform_to(GeocentricMeanEcliptic(equinox="J2000", obstime=when))
        off = (sun_longitude_deg(parse_utc("when", text)) - there.lon.deg + 180.0) % 360.0 - 180.0
        assert abs(off) < 1.0 / 60.0
        assert abs(there.lat.deg) < 0.02  # the plane of J2000 stands in for that of date


def test_ecliptic_coordinates(rng):
    ra, dec = 360.0 * rng.random(200), np.rad2deg(np.arcsin(2 * rng.random(200) - 1))
    there = SkyCoord(ra, dec, unit="deg").transform_to(BarycentricMeanEcliptic(equinox="J2000"))
    ours = np.array([ecliptic_deg(*place) for place in zip(ra, dec, strict=True)])
    assert np.abs((ours[:, 0] - there.lon.deg + 180) % 360 - 180).max() < 1e-3 / np.cos(np.deg2rad(there.lat.deg)).min()
    assert np.abs(ours[:, 1] - there.lat.deg).max() < 1e-4


def test_ecliptic_landmarks():
    assert ecliptic_deg(0.0, 0.0) == (0.0, 0.0)
    assert ecliptic_deg(90.0, 23.4392911)[1] == pytest.approx(0.0, abs=1e-9)
    assert ecliptic_deg(270.0, 66.5607089)[1] == pytest.approx(90.0, abs=1e-6)
    assert ecliptic_deg(0.0, -90.0)[1] == pytest.approx(-66.5607089)


def test_elongation():
    assert elongation_deg(0.0, 0.0) == 0.0
    assert elongation_deg(180.0, 0.0) == pytest.approx(180.0)
    assert elongation_deg(77.0, 90.0) == pytest.approx(90.0)
    assert elongation_deg(-60.0, 0.0) == pytest.approx(60.0)
