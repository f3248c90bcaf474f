"""The calendar: what a visit costs, and which way the detector is turned, by hand and against astropy."""

import math
from dataclasses import replace

import numpy as np
import pytest
from astropy import units
from astropy.coordinates import SkyCoord, get_sun
from astropy.time import Time

from cpic_planner.etc import build_model
from cpic_planner.survey.calendar import Calendar, Sight, make_calendar, sun_position_angle_deg
from cpic_planner.survey.detection import Setting
from cpic_planner.survey.strategy import Revisits, UniverseConfig
from cpic_planner.survey.visibility import load_visibility, visibility
from cpic_planner.targets import Targets, find_target
from simulator import load_instrument

INSTRUMENT = load_instrument()


@pytest.fixture(scope="module")
def model():
    return build_model(INSTRUMENT, bands=("F520",))


@pytest.fixture(scope="module")
def stars():
    return Targets.joined([find_target(name)[0] for name in ("alf Cen A", "eps Eri", "tau Cet", "sig Dra")])


def calendar(stars, **universe):
    config = UniverseConfig(**({"duration_days": 365.0, "slot_days": 30.0} | universe))
    return config, make_calendar(config, INSTRUMENT, load_visibility(), stars)


def plain(fraction, window_s, allowed_h=1e9, settle_h=0.0):
    """One star, some slots of thirty days."""
    fraction = np.atleast_1d(np.asarray(fraction, float))[None]
    even = np.ones_like(fraction)
    return Calendar(
        61771.0,
        np.full(fraction.shape[1], 720.0),
        fraction,
        allowed_h * even,
        window_s * even,
        15.0 * even,
        0.0 * even,
        5554.0,
        settle_h,
        0.0 * even,
        30.0 * even,
    )


def test_slots_cover_the_survey(stars):
    for days, slot, lengths in (
        (365.0, 30.0, [720.0] * 12 + [120.0]),
        (91.0, 30.5, [732.0, 732.0, 720.0]),
        (100.0, 33.3333, [799.9992] * 3 + [0.0024]),
        (60.0, 60.0, [1440.0]),
    ):
        config, found = calendar(stars, duration_days=days, slot_days=slot)
        assert found.n_slots == config.n_slots == len(lengths)
        np.testing.assert_allclose(found.slot_h, lengths, rtol=1e-6)
        assert found.slot_h.sum() == pytest.approx(24.0 * days)
        assert np.all(found.day < days)
        # A step of a sixth of a slot counts where its middle lies in the survey.
        assert np.all(found.allowed_h <= found.slot_h + slot * 24.0 / 12.0 + 1e-9)


def test_slots_are_means_over_the_days_that_are_allowed(stars):
    _, found = calendar(stars)
    seen = visibility(
        stars.ra_deg,
        stars.dec_deg,
        load_visibility(),
        INSTRUMENT.mission.orbit,
        start_utc="2028-01-01T00:00:00",
        n_days=390,
        step_days=5.0,
    )
    for i in range(len(stars)):
        for slot in range(13):
            own = [
                k
                for k in range(6 * slot, 6 * slot + 6)
                if seen.allowed[i, k] and seen.visible_fraction[i, k] > 0 and 5.0 * k + 2.5 < 365.0
            ]
            assert found.allowed_h[i, slot] == pytest.approx(120.0 * len(own))
            if own:
                assert found.fraction[i, slot] == pytest.approx(np.mean(seen.visible_fraction[i, own]), rel=1e-12)
                assert found.window_s[i, slot] == pytest.approx(np.mean(seen.window_s[i, own]), rel=1e-12)
                assert found.day[i, slot] == pytest.approx(np.mean([5.0 * k + 2.5 for k in own]), rel=1e-9)
            else:
                assert found.fraction[i, slot] == 0.0
    assert (found.fraction == 0.0).any()
    assert (found.fraction > 0.3).any()


@pytest.mark.parametrize(
    ("exposure", "frames", "window", "fraction"),
    [(30.0, 100, 2000.0, 0.36), (300.0, 7, 1000.0, 0.18), (900.0, 40, 1900.0, 0.4)],
)
def test_a_visit_takes_the_orbits_that_its_frames_need(model, exposure, frames, window, fraction):
    """Frames laid into windows one after the other; the tool counts parts of orbits, this loop whole ones."""
    readout = model.camera("F520").readout_s
    period = window / fraction
    setting = Setting("F520", exposure, frames, 300.0, 2.0 * frames * (exposure + readout))
    found = plain(fraction, window).cost_h(model, 0, setting)[0] * 3600.0
    left, orbits = 2 * frames, 0.0
    while left > 0:
        fits = int(window // (exposure + readout))
        orbits += min(1.0, left / fits)
        left -= fits
    assert found == pytest.approx(orbits * period, rel=1e-9)


def test_visits_that_are_not_possible(model):
    setting = Setting("F520", 100.0, 10.0, 300.0, 2500.0)
    frame = 100.0 + model.camera("F520").readout_s
    assert np.isinf(plain(0.4, frame - 1e-6).cost_h(model, 0, setting)[0])
    assert np.isfinite(plain(0.4, frame).cost_h(model, 0, setting)[0])
    assert np.isinf(plain(0.0, 2000.0).cost_h(model, 0, setting)[0])
    assert np.isinf(plain(0.4, 2000.0).cost_h(model, 0, replace(setting, n_frames=0.0))[0])
    cost = plain(0.4, 2000.0).cost_h(model, 0, setting)[0]
    assert np.isinf(plain(0.4, 2000.0, allowed_h=cost * 0.999).cost_h(model, 0, setting)[0])
    assert np.isfinite(plain(0.4, 2000.0, allowed_h=cost * 1.001).cost_h(model, 0, setting)[0])
    assert plain(0.4, 2000.0, settle_h=1.5).cost_h(model, 0, setting)[0] == pytest.approx(cost + 1.5)


def test_a_sight_is_the_mean_over_the_days_that_are_allowed(stars, model):
    """Telescope time of a plan by hand: orbits of the mean day that is allowed, whole frames, two slews a visit."""
    pointing = load_visibility()
    when = {"start_utc": "2028-01-01T00:00:00", "n_days": 365, "step_days": 5.0}
    seen = visibility(stars.ra_deg, stars.dec_deg, pointing, INSTRUMENT.mission.orbit, **when)
    readout_s, settle_s = model.camera("F520").readout_s, 60.0 / pointing.slew_deg_s + pointing.settle_s
    settle_s += pointing.thermal_settle_orbits * seen.period_s
    for i in range(len(stars)):
        days = [k for k in range(73) if seen.allowed[i, k] and seen.visible_fraction[i, k] > 0]
        window_s = np.mean(seen.window_s[i, days])
        fits = window_s // (60.0 + readout_s)
        orbit_s = window_s / np.mean(seen.visible_fraction[i, days])
        expected_s = 36000.0 / (fits * (60.0 + readout_s)) * orbit_s + 2 * 7 * settle_s
        found = Sight.of(seen, i, pointing)
        assert found.telescope_h(36000.0, 60.0 + readout_s, 14) == pytest.approx(expected_s / 3600.0, rel=1e-9)
        assert found.allowed_h == pytest.approx(24.0 * 5.0 * len(days))
        assert np.isinf(found.telescope_h(36000.0, 1.001 * window_s, 14))
        assert np.isinf(found.telescope_h(1e9, 60.0 + readout_s, 14))


def test_settling_is_a_mean_slew_and_an_orbit(stars):
    _, found = calendar(stars, duration_days=30.0)
    seen = load_visibility()
    # 60 deg at the rate of the telescope, the pointing, and an orbit or so for the optics.
    expected = 60.0 / seen.slew_deg_s + seen.settle_s + seen.thermal_settle_orbits * found.period_s
    assert found.settle_h * 3600.0 == pytest.approx(expected, rel=1e-9)


def test_the_sun_stands_where_astropy_has_it(stars):
    mjd = np.array([[61771.3, 61900.0, 62500.7, 64000.1]] * len(stars))
    found = sun_position_angle_deg(stars, mjd)
    for i in range(len(stars)):
        here = SkyCoord(stars.ra_deg[i] * units.deg, stars.dec_deg[i] * units.deg)
        for k in range(mjd.shape[1]):
            sun = get_sun(Time(mjd[i, k], format="mjd", scale="tdb"))  # a minute from UTC: 0.001 deg
            there = SkyCoord(sun.ra, sun.dec)  # a direction
            miss = (found[i, k] - here.position_angle(there).deg + 180.0) % 360.0 - 180.0
            assert abs(miss) < 0.1, (i, k, miss)


def test_rolls(stars):
    _, found = calendar(stars)
    slots, ordinals = np.array([0, 3, 5]), np.array([0, 1, 2])
    sun, north = Revisits(roll="sun", roll_dither_deg=7.0), Revisits(roll="north")
    base = found.sun_pa_deg[1, slots]
    np.testing.assert_allclose(found.roll_deg(sun, 1, slots, ordinals), base + np.array([-7.0, 7.0, -7.0]))
    assert not found.roll_deg(north, 1, slots, ordinals).any()


def test_closed_slots(stars):
    _, found = calendar(stars)
    closed = found.closed_before(found.start_mjd + 60.0)
    assert not closed.fraction[:, :2].any()
    assert not closed.allowed_h[:, :2].any()
    np.testing.assert_array_equal(closed.fraction[:, 2:], found.fraction[:, 2:])
    assert not found.closed_before(found.start_mjd + 60.001).allowed_h[:, 2].any()


def test_rows_of_some_stars(stars):
    _, found = calendar(stars)
    some = found.select(np.array([2, 0]))
    np.testing.assert_array_equal(some.day, found.day[[2, 0]])
    assert some.n_slots == found.n_slots == math.ceil(365 / 30)
