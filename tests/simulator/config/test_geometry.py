"""Places and distances: astropy on the sphere, absolute pictures, and what does not follow is refused."""

import astropy.units as u
import numpy as np
import pytest
from astropy.coordinates import Angle, SkyCoord
from hypothesis import given
from hypothesis import strategies as st

from simulator.config.angles import declination_deg, right_ascension_deg
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
def test_no_place_is_refused(refused, centre, where, word):
    refused(word, place, centre, star(**where))


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
def test_a_distance_that_contradicts_the_separation_is_refused(refused, phase, separation, distance):
    found = true_distance_au(planet(phase_deg=phase), separation, distance)
    refused("distance_au", true_distance_au, planet(phase_deg=phase, distance_au=1.03 * found), separation, distance)


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
def test_what_does_not_follow_or_contradicts_is_refused(refused, change, separation, distance, words):
    message = refused("", true_distance_au, planet(**change), separation, distance)
    for word in words:
        assert word in message


def test_full_phase_with_a_true_distance():
    assert true_distance_au(planet(phase_deg=0.0, distance_au=5.0), 0.0, 10.0) == 5.0


def test_light_of_its_own_needs_no_distance():
    body = Planet(spectrum="blackbody", teff_k=1000, radius_rjup=1, separation_arcsec=1.0, pa_deg=0.0)
    assert true_distance_au(body, 1.0, None) is None
    assert true_distance_au(body, 1.0, 10.0) is None


@pytest.mark.parametrize(
    "text",
    ["14:39:36.49", "14h39m36.49s", "14 39 36.49", " 14h 39m 36.49s ", "14:39", "14h39m", "14H39M36S", "0:0:0.001"],
)
def test_right_ascension_is_in_hours_unless_it_says_degrees(text):
    assert right_ascension_deg(text) == pytest.approx(Angle(text.strip().lower(), u.hourangle).deg, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "degrees"),
    [("219.9d", 219.9), ("219d54m7.2s", 219.902), ("219°54′7.2″", 219.902), ("14.66h", 219.9), ("120d", 120.0)],
)
def test_units_are_obeyed(text, degrees):
    assert right_ascension_deg(text) == pytest.approx(degrees, rel=1e-14)


@pytest.mark.parametrize(
    "text", ["-60:50:02.3", "-60d50m02.3s", "+12 30 15", "-60 50", "-0:30:00", "−60:50:02.3", "-60.84d"]
)
def test_declination(text):
    assert declination_deg(text) == pytest.approx(Angle(text.replace("−", "-"), u.deg).deg, rel=1e-15)


def test_a_small_southern_declination_keeps_its_sign():
    assert declination_deg("-00:00:36") == pytest.approx(-0.01)


@given(st.floats(0.0, 359.9999), st.floats(-90.0, 90.0))
def test_what_astropy_writes_is_read_back(ra, dec):
    texts = (
        Angle(ra, u.deg).to_string(u.hourangle, sep=":", precision=9, pad=True),
        Angle(dec, u.deg).to_string(u.deg, sep="dms", precision=8),
    )
    assert right_ascension_deg(texts[0]) == pytest.approx(ra, abs=1e-11)
    assert declination_deg(texts[1]) == pytest.approx(dec, abs=1e-11)
    assert right_ascension_deg(ra) == ra
    assert declination_deg(dec) == dec
