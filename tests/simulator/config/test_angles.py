"""Angles as people write them; oracle: astropy."""

import astropy.units as u
import pytest
from astropy.coordinates import Angle
from hypothesis import given
from hypothesis import strategies as st

from simulator.config.angles import declination_deg, right_ascension_deg


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
