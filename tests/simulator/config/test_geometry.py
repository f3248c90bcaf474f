"""Places and distances: astropy on the sphere, absolute pictures, and what does not follow is refused."""

import astropy.units as u
import numpy as np
import pytest
from astropy.coordinates import SkyCoord
from hypothesis import given
from hypothesis import strategies as st

from catalogs.errors import InputError
from simulator.config.bodies import Planet, SceneStar
from simulator.config.geometry import place, true_distance_au


def host(ra=None, dec=None, distance=None):
    return SceneStar(v_mag=1.0, teff_k=5000, ra_deg=ra, dec_deg=dec, distance_pc=distance)


def star(**where):
    return SceneStar(v_mag=5.0, teff_k=5000, **where)


def planet(**more):
    return Planet(**{"radius_rjup": 1.0, "phase_deg": 90.0, "separation_arcsec": 0.65, "pa_deg": 315.0} | more)


@given(st.floats(0.0, 359.9), st.floats(-89.5, 89.5), st.floats(0.0, 359.9), st.floats(1e-3, 119.0))
def test_coordinates_give_the_great_circle_of_astropy(ra, dec, pa, separation):
    centre = SkyCoord(ra * u.deg, dec * u.deg)
    there = centre.directional_offset_by(pa * u.deg, separation * u.arcsec)
    found = place(host(ra, dec), star(ra_deg=float(there.ra.deg), dec_deg=float(there.dec.deg)))
    assert found.separation_arcsec == pytest.approx(centre.separation(there).arcsec, rel=1e-9, abs=1e-9)
    assert found.separation_arcsec == pytest.approx(separation, abs=1e-6)
    # A degree has 13 decimals: 4e-10 arcsec across.
    turn = (found.pa_deg - centre.position_angle(there).deg + 180.0) % 360.0 - 180.0
    assert abs(turn) < 1e-7 + np.rad2deg(1e-8 / separation)


def test_east_is_at_position_angle_90():
    # At declination 60 one second of right ascension is 7.5 arcsec on the sky.
    found = place(host("12:00:00", 60.0), star(ra_deg="12:00:01", dec_deg=60.0))
    assert found.separation_arcsec == pytest.approx(7.5, rel=1e-6)
    assert found.pa_deg == pytest.approx(90.0, abs=0.01)
    assert place(host(10.0, 20.0), star(ra_deg=10.0, dec_deg=20.001)).pa_deg == pytest.approx(0.0, abs=1e-9)


def test_across_the_meridian_and_at_the_pole():
    found = place(host(359.9999, 0.0), star(ra_deg=0.0001, dec_deg=0.0))
    assert (found.separation_arcsec, found.pa_deg) == (pytest.approx(0.72, rel=1e-9), pytest.approx(90.0))
    found = place(host(0.0, 89.999), star(ra_deg=180.0, dec_deg=89.999))
    assert found.separation_arcsec == pytest.approx(7.2, rel=1e-9)


def test_an_offset_is_taken_as_it_is():
    assert place(host(), star(separation_arcsec=2.0, pa_deg=-45.0)) == (2.0, -45.0)


@pytest.mark.parametrize(
    ("centre", "where", "word"),
    [
        (host(), {}, "separation_arcsec = missing"),
        (host(), {"ra_deg": 1.0, "dec_deg": 1.0}, "cstar has them too"),
        (host(1.0, 1.0), {"ra_deg": 1.0, "dec_deg": 1.04}, "144 arcsec"),
        (host(1.0, 1.0), {"ra_deg": 181.0, "dec_deg": -1.0}, "at most 120 arcsec"),
    ],
)
def test_no_place_is_refused(centre, where, word):
    with pytest.raises(InputError, match=word):
        place(centre, star(**where))


def test_the_distance_of_the_paper():
    assert true_distance_au(planet(), 0.65, 1.35) == pytest.approx(0.8775, rel=1e-15)
    assert true_distance_au(planet(), 0.65, 1.2548) == pytest.approx(0.81562, rel=1e-15)


@given(st.floats(0.1, 179.9), st.floats(0.01, 100.0), st.floats(1.0, 50.0))
def test_projected_distance_is_recovered(phase, separation, distance):
    found = true_distance_au(planet(phase_deg=phase), separation, distance)
    assert found * np.sin(np.deg2rad(phase)) == pytest.approx(separation * distance, rel=1e-12)
    # and a planet given by what was found is accepted
    assert true_distance_au(planet(phase_deg=phase, distance_au=found), separation, distance) == found


@given(st.floats(30.0, 150.0), st.floats(0.01, 100.0), st.floats(1.0, 50.0))
def test_a_distance_that_contradicts_the_separation_is_refused(phase, separation, distance):
    found = true_distance_au(planet(phase_deg=phase), separation, distance)
    with pytest.raises(InputError, match="distance_au"):
        true_distance_au(planet(phase_deg=phase, distance_au=1.03 * found), separation, distance)


def test_rounded_numbers_agree():
    assert true_distance_au(planet(distance_au=5.2, phase_deg=60.0), 0.45, 10.0) == 5.2


def test_without_the_distance_of_the_star_nothing_is_compared():
    assert true_distance_au(planet(distance_au=5.0), 100.0, None) == 5.0


@pytest.mark.parametrize(
    ("change", "separation", "distance", "words"),
    [
        ({}, 0.65, None, ("distance_au = missing", "cstar.distance_pc")),
        ({"phase_deg": 0.0}, 0.65, 1.0, ("distance_au = missing", "phase_deg is 0")),
        ({"phase_deg": 180.0}, 0.65, 1.0, ("distance_au = missing", "phase_deg is 180")),
        ({}, 0.0, 1.0, ("distance_au = missing", "separation is 0")),
        ({"distance_au": 0.5}, 0.65, 1.35, ("distance_au = 0.5 au", "0.8775 au")),
        ({"distance_au": 2.0}, 0.65, 1.35, ("distance_au = 2.0 au", "2 au", "0.8775 au")),
        ({"distance_au": 2.0, "phase_deg": 0.0}, 0.65, 1.35, ("distance_au = 2.0 au", "0 au", "0.8775 au")),
    ],
)
def test_what_does_not_follow_or_contradicts_is_refused(change, separation, distance, words):
    with pytest.raises(InputError) as caught:
        true_distance_au(planet(**change), separation, distance)
    for word in words:
        assert word in str(caught.value)


def test_full_phase_with_a_true_distance():
    assert true_distance_au(planet(phase_deg=0.0, distance_au=5.0), 0.0, 10.0) == 5.0


def test_light_of_its_own_needs_no_distance():
    body = Planet(spectrum="blackbody", teff_k=1000, radius_rjup=1, separation_arcsec=1.0, pa_deg=0.0)
    assert true_distance_au(body, 1.0, None) is None
    assert true_distance_au(body, 1.0, 10.0) is None
