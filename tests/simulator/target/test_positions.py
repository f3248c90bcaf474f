"""Sky and detector: absolute pictures, because a round trip cannot see a mirror."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from simulator.target import detector_to_sky, sky_to_detector, wcs_keywords


@pytest.mark.parametrize(
    ("pa_deg", "parity", "x", "y"),
    [
        (0.0, -1, 0.0, 1.0),  # north is up
        (90.0, -1, -1.0, 0.0),  # east is left
        (180.0, -1, 0.0, -1.0),
        (270.0, -1, 1.0, 0.0),
        (0.0, 1, 0.0, 1.0),
        (90.0, 1, 1.0, 0.0),  # the mirrored figures: east is right
        (270.0, 1, -1.0, 0.0),
    ],
)
def test_pictures_at_roll_zero(pa_deg: float, parity: int, x: float, y: float) -> None:
    np.testing.assert_allclose(sky_to_detector(1.0, pa_deg, parity=parity), (x, y), atol=1e-15)


def test_planet_of_the_paper_sits_in_the_upper_right() -> None:
    # PA 315 (north-west): x > 0, y > 0 with east to the left; upper left in the mirrored figures.
    x, y = sky_to_detector(0.65, 315.0)
    assert x == pytest.approx(0.65 * np.sqrt(0.5))
    assert y == pytest.approx(0.65 * np.sqrt(0.5))
    assert sky_to_detector(0.65, 315.0, parity=1)[0] == pytest.approx(-0.65 * np.sqrt(0.5))


def test_roll_turns_the_sky() -> None:
    # Rolled by 90, a source at PA 90 appears where north was.
    np.testing.assert_allclose(sky_to_detector(1.0, 90.0, roll_deg=90.0), (0.0, 1.0), atol=1e-15)
    np.testing.assert_allclose(sky_to_detector(1.0, 0.0, roll_deg=90.0), (1.0, 0.0), atol=1e-15)


def test_default_orientation_is_that_of_the_sky() -> None:
    # Oracle: tangent-plane offsets of astropy; east is +lon, drawn to the left (-x).
    import astropy.units as u
    from astropy.coordinates import SkyCoord

    star = SkyCoord(ra=10.0 * u.deg, dec=20.0 * u.deg)
    for pa in (10.0, 100.0, 200.0, 300.0):
        source = star.directional_offset_by(pa * u.deg, 1.0 * u.arcsec)
        east, north = (offset.to_value(u.arcsec) for offset in star.spherical_offsets_to(source))
        x, y = sky_to_detector(1.0, pa)
        assert x == pytest.approx(-east, abs=1e-5)
        assert y == pytest.approx(north, abs=1e-5)


@given(st.floats(1e-3, 60.0), st.floats(0.0, 359.999), st.floats(-360.0, 360.0), st.sampled_from([-1, 1]))
def test_round_trip(separation: float, pa: float, roll: float, parity: int) -> None:
    found, angle = detector_to_sky(
        *sky_to_detector(separation, pa, roll_deg=roll, parity=parity), roll_deg=roll, parity=parity
    )
    assert found == pytest.approx(separation, rel=1e-13)
    assert 0.0 <= angle < 360.0
    assert abs((angle - pa + 180.0) % 360.0 - 180.0) < 1e-10


def test_arrays_and_the_star_itself() -> None:
    x, y = sky_to_detector([0.4, 0.65], [[45.0], [135.0], [225.0]])
    assert x.shape == y.shape == (3, 2)
    separation, pa = detector_to_sky(0.0, 0.0)
    assert separation == 0.0
    assert pa == 0.0
    assert detector_to_sky(1e-300, 1.0)[1] < 360.0


@pytest.mark.parametrize(
    "call",
    [
        lambda: sky_to_detector(-1.0, 0.0),
        lambda: sky_to_detector(np.nan, 0.0),
        lambda: sky_to_detector(1.0, np.inf),
        lambda: sky_to_detector(1.0, 0.0, roll_deg=np.nan),
        lambda: sky_to_detector(1.0, 0.0, parity=0),
        lambda: detector_to_sky(np.nan, 0.0),
        lambda: detector_to_sky(1.0, 0.0, parity=2),
    ],
)
def test_bad_input_is_refused(refused, call) -> None:
    refused("", call)


@pytest.mark.parametrize("parity", [-1, 1])
@pytest.mark.parametrize("roll_deg", [0.0, 30.0, -125.0])
def test_written_world_coordinates_say_the_same(parity, roll_deg):
    from astropy.coordinates import SkyCoord
    from astropy.io import fits
    from astropy.wcs import WCS

    star = SkyCoord(219.9, -60.8, unit="deg")
    keywords = wcs_keywords(0.016153, (536.0, 514.0), (219.9, -60.8), roll_deg=roll_deg, parity=parity)
    wcs = WCS(fits.Header(keywords))
    for separation, pa in ((0.7, 90.0), (0.5, 215.0), (3.0, 0.0)):
        x, y = sky_to_detector(separation, pa, roll_deg=roll_deg, parity=parity)
        place = wcs.pixel_to_world(536.0 + x / 0.016153, 514.0 + y / 0.016153)
        assert star.separation(place).arcsec == pytest.approx(separation, rel=1e-6)
        assert star.position_angle(place).deg % 360 == pytest.approx(pa, abs=1e-3)


def test_a_source_in_the_east_has_the_larger_right_ascension_and_stands_left():
    from astropy.io import fits
    from astropy.wcs import WCS

    wcs = WCS(fits.Header(wcs_keywords(0.016153, (100.0, 100.0), (10.0, 20.0))))
    x, y = sky_to_detector(0.65, 90.0)
    assert x < 0
    assert float(wcs.pixel_to_world(100.0 + x / 0.016153, 100.0 + y / 0.016153).ra.deg) > 10.0


def test_world_coordinates_of_a_star_without_a_place_are_offsets():
    keywords = wcs_keywords(0.016153, (68.0, 68.0), (None, None))
    assert (keywords["CTYPE1"], keywords["CRVAL1"]) == ("EAST", 0.0)
    east = keywords["CD1_1"] * (sky_to_detector(0.65, 90.0)[0] / 0.016153)
    assert east * 3600 == pytest.approx(0.65)
