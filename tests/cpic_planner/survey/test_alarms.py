"""False alarms: noise over the area of the hole, and background stars from counts."""

import math
from dataclasses import replace

import numpy as np
import pytest
from astropy import units
from astropy.coordinates import SkyCoord
from scipy.stats import norm

from cpic_planner.etc import build_model
from cpic_planner.queries import Strategy
from cpic_planner.survey import detection
from cpic_planner.survey.detection import Setting, background_alarms, galactic_deg, noise_alarms, star_counts_deg2
from cpic_planner.survey.strategy import DetectionRule
from cpic_planner.targets import find_target
from simulator import load_instrument

SETTING = Setting("F520", 20.0, 150.0, 300.0, 6500.0)


@pytest.fixture(scope="module")
def model():
    return build_model(load_instrument(), bands=("F520",))


def test_galactic_places_are_those_of_astropy():
    rng = np.random.default_rng(0)
    ra, dec = rng.uniform(0.0, 360.0, 300), np.rad2deg(np.arcsin(rng.uniform(-1.0, 1.0, 300)))
    there = SkyCoord(ra * units.deg, dec * units.deg).galactic
    longitude, latitude = galactic_deg(ra, dec)
    found = SkyCoord(longitude * units.deg, latitude * units.deg, frame="galactic")
    assert found.separation(there).deg.max() < 1e-4


def test_counts_grow_with_magnitude_and_towards_the_plane():
    limits = np.linspace(5.0, 30.0, 60)
    assert np.all(np.diff(star_counts_deg2(limits, 90.0, 40.0)) > 0.0)
    assert np.all(np.diff(star_counts_deg2(18.0, 90.0, np.linspace(10.0, 90.0, 30))) < 0.0)
    assert star_counts_deg2(18.0, 10.0, 30.0) > star_counts_deg2(18.0, 180.0, 30.0)
    assert star_counts_deg2(18.0, 90.0, -40.0) == star_counts_deg2(18.0, 90.0, 40.0)
    assert star_counts_deg2(18.0, 90.0, 1.0) == star_counts_deg2(18.0, 90.0, 10.0)
    assert star_counts_deg2(40.0, 90.0, 40.0) == star_counts_deg2(30.0, 90.0, 40.0)


@pytest.mark.parametrize(("v_mag", "l_deg", "b_deg"), [(8.0, 30.0, 25.0), (15.75, 90.0, 40.0), (21.0, 200.0, -70.0)])
def test_counts_are_those_of_bahcall_and_soneira(v_mag, l_deg, b_deg):
    """Equation B1 of 1980 ApJS 44, 73 with the constants of its table for V, term by term."""
    slope = min(max(v_mag, 12.0), 20.0) - 12.0
    mu, gamma = 0.03 + 0.0075 * slope, 0.36 - 0.04 * slope
    b, towards = math.radians(abs(b_deg)), math.cos(math.radians(l_deg))
    disc = 925.0 * math.exp(math.log(10.0) * 0.035 * (v_mag - 15.75))
    disc *= (1.0 + math.pow(10.0, -0.132 * (v_mag - 15.75))) ** -3
    disc *= (math.sin(b) * (1.0 - mu * towards / math.tan(b))) ** (5.0 * gamma - 3.0)
    halo = 1050.0 * math.exp(math.log(10.0) * 0.087 * (v_mag - 17.5))
    halo *= (1.0 + math.pow(10.0, -0.180 * (v_mag - 17.5))) ** -2.5
    centre = math.cos(b) * towards
    halo *= (1.0 - centre) ** (0.20 * centre - 1.45)
    assert star_counts_deg2(v_mag, l_deg, b_deg) == pytest.approx(disc + halo, rel=1e-12)


def test_counts_at_the_pole_are_of_the_right_order():
    # Between one and three thousand stars a square degree to V = 20 at either pole.
    assert 1e3 < star_counts_deg2(20.0, 0.0, 90.0) < 3e3
    assert star_counts_deg2(20.0, 0.0, 90.0) == pytest.approx(star_counts_deg2(20.0, 137.0, 90.0), rel=1e-9)


def test_noise_alarms_are_those_of_the_area_of_the_quadrants(model):
    metrics = model.metrics["F520"]
    area = 4.0 * (metrics.hole_outer_arcsec - metrics.hole_inner_arcsec) ** 2 / metrics.lambda_d_arcsec**2
    # Pixel centres in the squares stand for their area.
    assert noise_alarms(model, "F520") == pytest.approx(area * norm.sf(5.0), rel=0.15)
    weak = replace(model, strategy=Strategy(sigma=3.0))
    assert noise_alarms(weak, "F520") / noise_alarms(model, "F520") == pytest.approx(
        norm.sf(3.0) / norm.sf(5.0), rel=1e-9
    )


def test_background_stars(model):
    rule, star = DetectionRule(), find_target("tau Cet")[0]
    one = background_alarms(model, star, [SETTING], rule)
    assert 0.0 < one < 0.1
    assert background_alarms(model, star, [replace(SETTING, n_frames=0.0)], rule) == 0.0
    # From some length on the walk of the wavefront, not the photons, says how deep a visit is.
    assert background_alarms(model, star, [replace(SETTING, n_frames=30.0)], rule) < one
    # Less is detected where more is asked for, and more stars stand near the plane.
    assert background_alarms(model, star, [SETTING], DetectionRule(half_factor=3.9)) < one
    low = replace(star, ra_deg=np.array([266.4]), dec_deg=np.array([-28.9]))
    assert background_alarms(model, low, [SETTING], rule) > 3.0 * one
    # No more than the brightest stars that any place of the hole shows, over its whole area.
    metrics = model.metrics["F520"]
    area = 4.0 * (metrics.hole_outer_arcsec - metrics.hole_inner_arcsec - 2.0 * metrics.aperture_radius_arcsec) ** 2
    deepest = star_counts_deg2(30.0, *galactic_deg(star.ra_deg, star.dec_deg))[0] / 3600.0**2
    assert one < 1.2 * area * deepest


def test_background_stars_of_an_even_sky(model, monkeypatch):
    """A thousand stars a square degree, however faint: those on the area in which an aperture lies in the hole."""
    monkeypatch.setattr(detection, "star_counts_deg2", lambda limit, *place: np.full(np.shape(limit), 1000.0))
    found = background_alarms(model, find_target("tau Cet")[0], [SETTING], DetectionRule())
    metrics = model.metrics["F520"]
    side = metrics.hole_outer_arcsec - metrics.hole_inner_arcsec - 2.0 * metrics.aperture_radius_arcsec
    # A grid of 32 points across the hole tells a side to one step.
    step, per_arcsec2 = metrics.hole_outer_arcsec / 16.0, 1000.0 / 3600.0**2
    assert per_arcsec2 * 4.0 * (side - step) ** 2 < found < per_arcsec2 * 4.0 * (side + step) ** 2
