import numpy as np
import pytest
from astropy.wcs import WCS

from simulator import load_scene
from simulator.products.places import pointing_deg, sky_places, star_deg

SCENE = load_scene("paper_example")


@pytest.mark.parametrize("roll", [0.0, 30.0, 215.0])
def test_places_are_those_of_the_world_coordinates(sequence, roll):
    one = sequence(roll_deg=roll)
    world = WCS({key: value for key, value in one.header.items() if key[:2] in ("CT", "CU", "CR", "CD")})
    x, y = np.array([0.0, 3.0, -5.0, 8.0]), np.array([0.0, -4.0, 1.0, 8.0])
    pixel = one.instrument.detector.pixel_scale_arcsec
    expected = world.pixel_to_world_values(one.star[0] + x / pixel, one.star[1] + y / pixel)
    found = sky_places(one, x, y)
    # a plane and a sphere differ by 1e-8 arcsec at 11 arcsec
    assert np.abs(np.subtract(found, expected)).max() * 3600 < 1e-6


def test_orientation_as_seen_on_the_sky(sequence):
    ra, dec = star_deg(sequence())
    # at roll 0 a source on the left is east: larger right ascension; up is north
    east = sky_places(sequence(roll_deg=0.0), -1.0, 0.0)
    north = sky_places(sequence(roll_deg=0.0), 0.0, 1.0)
    assert (east[0] - ra) * 3600 * np.cos(np.deg2rad(dec)) == pytest.approx(1.0, rel=1e-5)
    assert (north[1] - dec) * 3600 == pytest.approx(1.0, rel=1e-5)


def test_mask_and_star_part_when_the_star_is_offset(sequence):
    shifted = sequence(roll_deg=0.0, extra={"STAROFFX": 2.0, "STAROFFY": -1.0})
    ra, dec = star_deg(shifted)
    pointing = pointing_deg(shifted)
    # star right of the mask: the mask is east of the star
    assert (pointing[0] - ra) * 3600 * np.cos(np.deg2rad(dec)) == pytest.approx(2.0, rel=1e-4)
    assert (pointing[1] - dec) * 3600 == pytest.approx(1.0, rel=1e-4)
    assert pointing_deg(sequence()) == star_deg(sequence())


def test_without_coordinates_there_are_no_places(sequence):
    star = SCENE.cstar.model_copy(update={"ra_deg": None, "dec_deg": None})
    bare = sequence(scene=SCENE.model_copy(update={"cstar": star}), extra={"STAROFFX": 2.0})
    assert star_deg(bare) is pointing_deg(bare) is sky_places(bare, 1.0, 1.0) is None
    assert star_deg(sequence(scene=None)) is None
