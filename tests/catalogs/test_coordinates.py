"""Space motion, tangent plane and ecliptic coordinates against astropy and hand-made pictures."""

import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import BarycentricMeanEcliptic, Distance, SkyCoord
from astropy.time import Time

from catalogs import position_angle, separation_arcsec, tangent_offset
from catalogs.coordinates import ecliptic, neighbours, offset_place, propagate

# alf Cen A, 61 Cyg A, tau Cet, eps Ind, Barnard, a star near the pole, and one crossing RA 0.
STARS = np.array(
    [
        [219.902058, -60.833993, -3679.25, 473.67, 754.81, -22.3],
        [316.724802, 38.749440, 4168.31, 3269.20, 286.82, -65.9],
        [26.017013, -15.937479, -1721.05, 854.16, 273.96, -16.68],
        [330.840223, -56.785980, 3960.93, -2539.23, 276.06, -40.0],
        [269.452075, 4.693391, -798.58, 10328.12, 548.31, -110.5],
        [37.954500, 89.264100, 44.48, -11.85, 7.54, -16.4],
        [0.000010, 20.0, -500.0, 300.0, 60.0, 30.0],
    ]
)


@pytest.mark.parametrize("to_epoch", [1950.0, 1991.25, 2027.5, 2050.0])
def test_propagation_agrees_with_astropy(to_epoch: float) -> None:
    ra, dec, pm_ra, pm_dec, parallax, rv = STARS.T
    new = propagate(ra, dec, pm_ra, pm_dec, parallax, rv, 2000.0, to_epoch)
    sky = SkyCoord(
        ra=ra * u.deg,
        dec=dec * u.deg,
        distance=Distance(parallax=parallax * u.mas),
        pm_ra_cosdec=pm_ra * u.mas / u.yr,
        pm_dec=pm_dec * u.mas / u.yr,
        radial_velocity=rv * u.km / u.s,
        obstime=Time(2000.0, format="jyear", scale="tcb"),
    ).apply_space_motion(new_obstime=Time(to_epoch, format="jyear", scale="tcb"))
    error_mas = 1000.0 * separation_arcsec(new.ra_deg, new.dec_deg, sky.ra.deg, sky.dec.deg)
    assert np.max(error_mas) < 1.0
    np.testing.assert_allclose(new.pm_ra_mas_yr, sky.pm_ra_cosdec.to_value(u.mas / u.yr), atol=0.02)
    np.testing.assert_allclose(new.pm_dec_mas_yr, sky.pm_dec.to_value(u.mas / u.yr), atol=0.02)
    np.testing.assert_allclose(new.parallax_mas, 1000.0 / sky.distance.to_value(u.pc), rtol=1e-6)
    np.testing.assert_allclose(new.rv_km_s, sky.radial_velocity.to_value(u.km / u.s), atol=0.01)


def test_propagation_signs() -> None:
    """Positive proper motion moves a star to larger RA and Dec; an approaching star gains parallax."""
    new = propagate(10.0, 60.0, 1000.0, 1000.0, 100.0, -50.0, 2000.0, 2010.0)
    assert new.ra_deg == pytest.approx(10.0 + 10.0 / 3600.0 / np.cos(np.deg2rad(60.0)), abs=2e-6)
    assert new.dec_deg == pytest.approx(60.0 + 10.0 / 3600.0, abs=1e-6)
    assert new.parallax_mas > 100.0


def test_propagation_there_and_back() -> None:
    start = STARS.T
    there = propagate(*start, 2000.0, 2100.0)
    back = propagate(*there, 2100.0, 2000.0)
    for before, after in zip(start, back, strict=True):
        np.testing.assert_allclose(after, before, rtol=1e-9, atol=1e-9)


def test_tangent_offset_picture() -> None:
    """A source with larger RA is east, one with larger Dec north."""
    east, north = tangent_offset([10.001, 10.0], [30.0, 30.001], 10.0, 30.0)
    np.testing.assert_allclose(east, [3.6 * np.cos(np.deg2rad(30.0)), 0.0], atol=1e-5)
    np.testing.assert_allclose(north, [0.0, 3.6], atol=1e-4)
    np.testing.assert_allclose(position_angle(east, north), [90.0, 0.0], atol=1e-3)


def test_tangent_offset_agrees_with_tangent_projection() -> None:
    rng = np.random.default_rng(5)
    ra0, dec0 = 219.9, -60.8
    ra, dec = ra0 + rng.uniform(-3.0, 3.0, 50), dec0 + rng.uniform(-2.0, 2.0, 50)
    east, north = tangent_offset(ra, dec, ra0, dec0)
    frame = SkyCoord(ra0 * u.deg, dec0 * u.deg).skyoffset_frame()
    local = SkyCoord(ra * u.deg, dec * u.deg).transform_to(frame)
    lon, lat = local.lon.rad, local.lat.rad
    np.testing.assert_allclose(east, np.rad2deg(np.tan(lon)) * 3600.0, rtol=1e-9, atol=1e-7)
    np.testing.assert_allclose(north, np.rad2deg(np.tan(lat) / np.cos(lon)) * 3600.0, rtol=1e-9, atol=1e-7)


def test_tangent_offset_refuses_the_other_hemisphere(refused) -> None:
    refused("", tangent_offset, 180.0, 0.0, 0.0, 0.0)


def test_ecliptic_agrees_with_astropy() -> None:
    rng = np.random.default_rng(7)
    ra, dec = rng.uniform(0.0, 360.0, 200), np.rad2deg(np.arcsin(rng.uniform(-1.0, 1.0, 200)))
    lon, lat = ecliptic(ra, dec)
    there = SkyCoord(ra * u.deg, dec * u.deg).transform_to(BarycentricMeanEcliptic(equinox=Time("J2000")))
    assert np.max(separation_arcsec(lon, lat, there.lon.deg, there.lat.deg)) < 0.1


def test_neighbours_are_those_of_all_pairs():
    rng = np.random.default_rng(5)
    ra = np.concatenate([rng.uniform(0.0, 360.0, 200), [0.0001, 359.9999, 10.0, 190.0, 33.0, 33.0]])
    dec = np.concatenate([rng.uniform(-90.0, 90.0, 200), [5.0, 5.0, 89.9999, 89.9999, -20.0, -20.0]])
    ra[:100], dec[:100] = ra[100:200] + rng.uniform(-0.1, 0.1, 100), np.clip(dec[100:200] + 0.05, -90.0, 90.0)
    found = neighbours(ra, dec, 300.0)
    for i in range(ra.size):
        sep = separation_arcsec(ra[i], dec[i], ra, dec)
        assert found[i] == {j: sep[j] for j in np.flatnonzero(sep < 300.0).tolist() if j != i}
        assert list(found[i]) == sorted(found[i])
    assert found[200] == {201: pytest.approx(0.72 * np.cos(np.deg2rad(5.0)))}
    assert 203 in found[202], "across the pole"
    assert found[204] == {205: 0.0}
    assert neighbours([], [], 1.0) == []


def test_a_heap_of_positions_is_no_sky(refused):
    refused("pairs of neighbouring stars = 1124250.*at most 1000000", neighbours, [5.0] * 1500, [5.0] * 1500, 10.0)


@pytest.mark.parametrize("dec", [-89.9, -60.8, 0.0, 45.0, 89.99])
def test_a_place_at_offsets_has_these_offsets(dec):
    east, north = np.array([0.0, 10.0, -3600.0, 7.5]), np.array([5.0, 0.0, 1800.0, -2e4])
    places = offset_place(359.999, dec, east, north)
    assert ((places[0] >= 0.0) & (places[0] < 360.0)).all()
    np.testing.assert_allclose(tangent_offset(*places, 359.999, dec), [east, north], rtol=1e-9, atol=1e-8)
