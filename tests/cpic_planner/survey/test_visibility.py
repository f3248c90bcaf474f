"""Targets x dates against an astropy-only computation, analytic shares of the sky, and what is refused."""

import itertools
import socket
import tracemalloc
import warnings
from datetime import datetime, timedelta

import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import GCRS, BarycentricMeanEcliptic, SkyCoord, get_body
from astropy.time import Time
from astropy.utils import iers

from cpic_core import InputError
from cpic_planner.survey.visibility import BLOCKS, Visibility, _geometry, load_visibility, slew_s, visibility
from cpic_planner.targets import rank_sample
from simulator import load_instrument

ORBIT = load_instrument().mission.orbit
CONFIG = load_visibility()
NO_MOON = load_visibility({"moon_deg": 0})
EARTH_ALONE = load_visibility({"sun_deg": 0, "moon_deg": 0, "panel_deg": 90, "panel_turn_deg": 90, "saa_fraction": 0})
GM, EARTH, J2 = 398600.4418, 6378.137, 1.08262668e-3
# Past the table of leap seconds, before it, and the mission's own.
STARTS = ("2045-03-10", pytest.param("1999-06-01", marks=pytest.mark.long))


def sky(n, seed):
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 360, n), np.degrees(np.arcsin(rng.uniform(-1, 1, n)))


def even_sky(n):
    """Places that share the sky evenly."""
    k = np.arange(n) + 0.5
    return np.degrees(np.pi * (1 + 5**0.5) * k) % 360, np.degrees(np.arcsin(1 - 2 * k / n))


class Astropy:
    """Sun, Moon and telescope by astropy's own means and a few lines; nothing of the package."""

    def __enter__(self):
        self._caught = warnings.catch_warnings()
        self._caught.__enter__()
        warnings.simplefilter("ignore")
        self._auto = iers.conf.set_temp("auto_download", False)
        self._auto.__enter__()
        return self

    def __exit__(self, *problem):
        self._auto.__exit__(*problem)
        self._caught.__exit__(*problem)

    @staticmethod
    def angles_deg(body, ra_deg, dec_deg, mjd):
        """Angle of targets from a body, both as seen from the centre of the Earth, shape (n, d)."""
        times = Time(mjd, format="mjd", scale="utc")
        there = get_body(body, times, ephemeris="builtin")
        places = SkyCoord(ra_deg * u.deg, dec_deg * u.deg, frame="icrs")
        seen = SkyCoord(places[:, None]).transform_to(GCRS(obstime=times[None, :]))
        return there.separation(seen).deg

    @staticmethod
    def telescope_km(mjd, node_at=None):
        """Place of the telescope, shape (n, 3); with the node held at a moment, or drifting."""

        def since(when):
            return (Time(when, format="mjd", scale="utc") - Time(ORBIT.epoch_utc, scale="utc")).to_value("s")

        a = EARTH + ORBIT.altitude_km
        motion = np.sqrt(GM / a**3)
        tilt = np.radians(ORBIT.inclination_deg)
        drift = -1.5 * motion * J2 * (EARTH / a) ** 2 * np.cos(tilt)
        node = np.radians(ORBIT.node_deg) + drift * since(mjd if node_at is None else node_at)
        along = np.radians(ORBIT.phase_deg) + motion * since(mjd)
        x, y = a * np.cos(along), a * np.sin(along)
        return np.stack(
            [
                x * np.cos(node) - y * np.cos(tilt) * np.sin(node),
                x * np.sin(node) + y * np.cos(tilt) * np.cos(node),
                y * np.sin(tilt),
            ],
            axis=-1,
        )

    @staticmethod
    def vector(body, mjd):
        return get_body(body, Time(mjd, format="mjd", scale="utc"), ephemeris="builtin").cartesian.xyz.to_value("km")


def direction(ra_deg, dec_deg):
    ra, dec = np.radians(ra_deg), np.radians(dec_deg)
    return np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=-1)


def period_days():
    return 2 * np.pi / np.sqrt(GM / (EARTH + ORBIT.altitude_km) ** 3) / 86400


def clear_by_force(target, sun, places, dark, bright, around=360):
    """Whether the target stands clear: the whole circle of the limb is looked at for its nearest point."""
    turns = 2 * np.pi * np.arange(around) / around
    clear = np.zeros(len(places), bool)
    for i, place in enumerate(places):
        distance = np.linalg.norm(place)
        up = place / distance
        east = np.cross([0.0, 0.0, 1.0], up)
        east /= np.linalg.norm(east)
        north = np.cross(up, east)
        dip = EARTH / distance
        ring = EARTH * (
            dip * up + np.sqrt(1 - dip**2) * (np.cos(turns)[:, None] * east + np.sin(turns)[:, None] * north)
        )
        sight = ring - place
        angles = np.degrees(np.arccos(sight @ target / np.linalg.norm(sight, axis=-1)))
        nearest = int(np.argmin(angles))
        behind = np.degrees(np.arccos(-up @ target)) < np.degrees(np.arcsin(dip))
        height = -angles[nearest] if behind else angles[nearest]
        clear[i] = height >= (bright if ring[nearest] @ sun > 0 else dark)
    return clear


@pytest.mark.parametrize("start", STARTS)
def test_angles_agree_with_astropy(start):
    ra, dec = sky(12, 1)
    seen = visibility(ra, dec, CONFIG, ORBIT, start_utc=start, n_days=365)
    with Astropy() as oracle:
        for body, ours in (("sun", seen.sun_deg), ("moon", seen.moon_deg)):
            assert np.abs(oracle.angles_deg(body, ra, dec, seen.mjd) - ours).max() < 0.1


@pytest.mark.parametrize("start", STARTS)
def test_seasons_agree_with_astropy_to_a_day(start):
    ra, dec = sky(12, 2)
    seen = visibility(ra, dec, NO_MOON, ORBIT, start_utc=start, n_days=365)
    hours = seen.mjd[0] - 0.5 + np.arange(0, 365, 1 / 6)
    with Astropy() as oracle:
        sun = oracle.angles_deg("sun", ra, dec, hours)
    # Panels that turn by 25 deg and may be 25 deg off the Sun reach as far as 50 deg from across the boresight.
    good = (sun >= 50) & (np.abs(sun - 90) <= 50)
    found = 0
    for row in range(12):
        edges = hours[np.flatnonzero(np.diff(good[row].astype(int))) + 1]
        with Astropy():
            ours = [Time(text, scale="utc").mjd for window in seen.windows(row) for text in window]
        # Begin and end of the year are no edges.
        inner = [edge for edge in ours if hours[0] + 0.01 < edge < hours[0] + 364.99]
        assert len(inner) == len(edges)
        assert inner == pytest.approx(edges.tolist(), abs=1.0)
        found += len(edges)
    assert found > 15


@pytest.mark.parametrize("start", STARTS)
def test_fractions_of_orbits_agree_with_astropy(start):
    ra, dec = sky(12, 4)
    seen = visibility(ra, dec, EARTH_ALONE, ORBIT, start_utc=start, n_days=365)
    assert seen.allowed.all()
    assert seen.period_s == pytest.approx(86400 * period_days())
    targets = direction(ra, dec)
    turn = period_days() * ((np.arange(480) + 0.5) / 480 - 0.5)
    with Astropy() as oracle:
        for row, day in zip(range(12), (3, 31, 80, 111, 140, 171, 200, 222, 260, 301, 333, 364), strict=True):
            places = oracle.telescope_km(seen.mjd[day] + turn, node_at=seen.mjd[day])
            clear = clear_by_force(targets[row], oracle.vector("sun", seen.mjd[day]), places, 10, 30)
            assert clear.mean() == pytest.approx(seen.visible_fraction[row, day], abs=0.005)
            lasts = max((sum(1 for _ in run) for up, run in itertools.groupby([*clear, *clear]) if up), default=0)
            longest_s = min(lasts / 480, 1) * 86400 * period_days()
            assert longest_s == pytest.approx(seen.window_s[row, day], abs=24)


def test_one_orbit_stands_for_the_day():
    # The node drifts by 6 deg in the 15.6 orbits of a day, which tells where a target only grazes the limb.
    ra, dec = sky(150, 6)
    seen = visibility(ra, dec, EARTH_ALONE, ORBIT, start_utc="2028-01-01", n_days=366, step_days=30.5)
    targets = direction(ra, dec)
    rho, differences = np.arcsin(EARTH / (EARTH + ORBIT.altitude_km)), []
    with Astropy() as oracle:
        for day, mjd in enumerate(seen.mjd):
            sun = oracle.vector("sun", mjd) / np.linalg.norm(oracle.vector("sun", mjd))
            zenith = oracle.telescope_km(mjd + 16 * period_days() * ((np.arange(4800) + 0.5) / 4800 - 0.5))
            zenith /= np.linalg.norm(zenith, axis=-1, keepdims=True)
            up = targets @ zenith.T
            level = (targets @ sun)[:, None] - up * (zenith @ sun)
            sunlit = np.sin(rho) * (zenith @ sun) + np.cos(rho) * level / np.sqrt(1 - up**2) > 0
            limb = 180 - np.degrees(rho) - np.degrees(np.arccos(up))
            clear = (limb >= 10) & (~sunlit | (limb >= 30))
            differences.append(clear.mean(axis=1) - seen.visible_fraction[:, day])
    differences = np.array(differences)
    assert abs(differences.mean()) < 2e-4
    assert differences.std() < 0.003
    assert np.mean(np.abs(differences) < 0.005) > 0.98
    assert np.abs(differences).max() < 0.08


def test_the_moon_is_kept_at_its_distance_from_all_of_the_orbit():
    ra, dec = sky(60, 5)
    config = load_visibility({"sun_deg": 0, "panel_deg": 90, "panel_turn_deg": 90})
    seen = visibility(ra, dec, config, ORBIT, start_utc="2028-01-01", n_days=60)
    targets = direction(ra, dec)
    least = np.empty(seen.moon_deg.shape)
    largest = 0.0
    with Astropy() as oracle:
        moon = oracle.vector("moon", seen.mjd).T
        for day, mjd in enumerate(seen.mjd):
            places = oracle.telescope_km(mjd + period_days() * np.linspace(0, 1, 90))
            sight = moon[day] - places
            sight /= np.linalg.norm(sight, axis=-1, keepdims=True)
            angles = np.degrees(np.arccos(targets @ sight.T))
            least[:, day] = angles.min(axis=1)
            largest = max(largest, np.abs(angles - seen.moon_deg[:, day, None]).max())
    # The parallax from this orbit, which an angle from the centre of the Earth leaves out.
    assert 0.9 < largest < 1.1
    free = seen.allowed
    assert least[free].min() >= 20.0
    kept = ~free & (least > 20.0)
    assert 0 < kept.sum() < 0.03 * (~free).sum() + 30
    assert least[kept].max() < 22.0


def test_shares_of_the_sky_and_of_the_year():
    ra, dec = even_sky(4000)
    seen = visibility(ra, dec, NO_MOON, ORBIT, start_utc="2028-01-01", n_days=366, step_days=61)
    near = (seen.blocked_by == BLOCKS.index("sun")).mean(axis=0)
    assert near == pytest.approx((1 - np.cos(np.radians(50))) / 2, abs=0.002)
    assert near == pytest.approx(0.18, abs=0.005)
    out = (seen.blocked_by == BLOCKS.index("panel")).mean(axis=0)
    assert out == pytest.approx((1 - np.cos(np.radians(40))) / 2, abs=0.002)
    latitude = np.array([-89.0, -52.0, -50.3, 0.0, 50.3, 70.0])
    places = SkyCoord(np.full(6, 77.0) * u.deg, latitude * u.deg, frame=BarycentricMeanEcliptic()).icrs
    year = visibility(places.ra.deg, places.dec.deg, NO_MOON, ORBIT, start_utc="2028-01-01", n_days=366)
    days = [year.days(row)["sun"] for row in range(6)]
    assert [days[row] for row in (0, 1, 2, 4, 5)] == [0.0] * 5
    # 100 deg of the ecliptic, at the Sun's own speed there.
    assert days[3] == pytest.approx(100 / 360 * 365.25, abs=3)


def test_fraction_holds_the_anomaly_and_windows_do_not():
    ra, dec = sky(5, 9)
    plain = load_visibility({"saa_fraction": 0})
    with_it, without = (
        visibility(ra, dec, config, ORBIT, start_utc="2028-01-01", n_days=50) for config in (CONFIG, plain)
    )
    np.testing.assert_allclose(with_it.visible_fraction, 0.92 * without.visible_fraction, rtol=1e-12)
    np.testing.assert_array_equal(with_it.window_s, without.window_s)
    np.testing.assert_allclose(with_it.visible_s, with_it.visible_fraction * with_it.period_s)
    assert np.all(without.window_s <= without.visible_s + 1e-9)


def test_what_blocks_is_named_once():
    ra, dec = even_sky(300)
    hard = load_visibility({"dark_limb_deg": 85, "bright_limb_deg": 85})
    seen = visibility(ra, dec, hard, ORBIT, start_utc="2028-02-01", n_days=120, step_days=2.5)
    assert seen.mjd.shape == (48,)
    assert np.diff(seen.mjd) == pytest.approx(2.5)
    assert set(np.unique(seen.blocked_by)) == set(range(5))
    np.testing.assert_array_equal(seen.allowed, np.isin(seen.blocked_by, [0, BLOCKS.index("limb")]))
    np.testing.assert_array_equal(seen.observable, seen.visible_fraction > 0)
    np.testing.assert_array_equal(seen.observable, seen.window_s > 0)
    np.testing.assert_array_equal(seen.blocked_by == BLOCKS.index("sun"), seen.sun_deg < 50)
    np.testing.assert_array_equal(
        seen.blocked_by == BLOCKS.index("panel"), (seen.sun_deg >= 50) & (seen.roll_half_range_deg == 0)
    )
    for row in (0, 150, 299):
        days = seen.days(row)
        assert sum(days.values()) == 120
        assert days[""] == 2.5 * seen.observable[row].sum()


def test_windows_and_seasons():
    # An ecliptic target: the Moon passes it each month.
    place = SkyCoord(60 * u.deg, 0 * u.deg, frame=BarycentricMeanEcliptic()).icrs
    seen = visibility([place.ra.deg], [place.dec.deg], CONFIG, ORBIT, start_utc="2028-01-01", n_days=366)
    windows, seasons = seen.windows(0), seen.windows(0, through=("moon",))
    assert len(seasons) < len(windows)
    for pairs in (windows, seasons):
        times = [time for pair in pairs for time in pair]
        assert times == sorted(times)
        assert all(len(time) == 19 for time in times)
    steps = [seen.observable[0, begin:end] for begin, end in seen.runs(0)]
    assert all(step.all() for step in steps)
    assert sum(len(step) for step in steps) == seen.observable[0].sum()
    longest = max(Time(end).mjd - Time(begin).mjd for begin, end in windows)
    assert longest < 27.3
    never = visibility(
        [place.ra.deg], [place.dec.deg], load_visibility({"sun_deg": 180}), ORBIT, start_utc="2028-01-01", n_days=30
    )
    assert never.windows(0) == []


def test_windows_follow_from_a_walk_over_the_steps():
    rng = np.random.default_rng(8)
    blank, moon, begin = np.zeros((1, 0)), BLOCKS.index("moon"), datetime(2021, 5, 4, 6)
    for length, step_days in zip([1, 2, 3, *rng.integers(4, 30, 150)], [1.0, 0.125, 4.0] * 51, strict=True):
        row = np.where(rng.random(length) < rng.random(), 0, rng.choice([moon, 1, 2, 4], length)).astype(np.int8)
        mjd = Time(begin).mjd + step_days * (np.arange(length) + 0.5)
        seen = Visibility(mjd, step_days, 5600.0, blank, blank, blank, blank, blank, blank, row[None])
        for through, passed in (((), {0}), (("moon",), {0, moon})):
            # Steps that do not end a window; only those seen begin and end one.
            pieces = [[]]
            for k, block in enumerate(row.tolist()):
                pieces += [] if block in passed else [[]]
                pieces[-1] += [] if block else [k]
            expected = [(piece[0], piece[-1] + 1) for piece in pieces if piece]
            assert seen.runs(0, through=through) == expected
            edges = [tuple((begin + timedelta(days=step_days * k)).isoformat() for k in run) for run in expected]
            assert seen.windows(0, through=through) == edges


def test_a_slew_turns_and_settles(refused):
    rng = np.random.default_rng(9)
    for rate, settle in 10 ** rng.uniform((-3, -2), (2, 5), (40, 2)):
        config = load_visibility({"slew_deg_s": rate, "settle_s": settle})
        angle = np.concatenate([[1e-9, 0.5, 180.0], rng.uniform(0, 180, 5)])
        assert slew_s(angle, config) == pytest.approx([settle + a / rate for a in angle], rel=1e-12)
        assert slew_s(0.0, config) == 0.0
    for angle in (-1e-9, 180.0 + 1e-9, [1.0, 181.0], [np.nan, 1.0]):
        refused("allowed: 0 to 180", slew_s, angle, CONFIG)


def test_steps_at_the_ends_of_their_range():
    for step_days, n_days, steps in ((1e-3, 1, 1000), (366.0, 1, 1), (366.0, 367, 2), (0.1, 3, 30)):
        seen = visibility([1.0], [2.0], CONFIG, ORBIT, start_utc="2028-01-01", n_days=n_days, step_days=step_days)
        assert seen.mjd.tolist() == pytest.approx([61771 + step_days * (k + 0.5) for k in range(steps)], abs=1e-9)
    for step_days in (0.000999, 366.01, 732.0):
        with pytest.raises(InputError, match="allowed: 0.001 to 366"):
            visibility([1.0], [2.0], CONFIG, ORBIT, start_utc="2028-01-01", n_days=1, step_days=step_days)


def test_limit_of_targets_times_steps(refused):
    # As late as this a request that is small enough ends beyond the last year: which refusal comes tells the two apart.
    late = {"start_utc": "2100-12-01", "config": CONFIG, "orbit": ORBIT}
    refused("an end before 2101", visibility, np.zeros(20_000), np.zeros(20_000), n_days=1000, **late)
    with pytest.raises(InputError, match="targets x steps up to 2e\\+07, not 21 x 952381"):
        visibility(np.zeros(21), np.zeros(21), n_days=953, step_days=953 / 952381, **late)


def test_a_target_at_a_limit_is_seen():
    asked = {"orbit": ORBIT, "start_utc": "2028-06-01", "n_days": 1}
    for ra, dec in zip(*sky(5, 10), strict=True):
        sun_deg = float(visibility([ra], [dec], EARTH_ALONE, **asked).sun_deg[0, 0])
        for limit, allowed in ((sun_deg, True), (np.nextafter(sun_deg, 0), True), (np.nextafter(sun_deg, 180), False)):
            config = load_visibility(EARTH_ALONE.content() | {"sun_deg": float(limit)})
            assert visibility([ra], [dec], config, **asked).allowed[0, 0] == allowed


def test_directions_at_the_ends_of_their_range():
    asked = {"orbit": ORBIT, "start_utc": "2028-06-01", "n_days": 1}
    places = {(0.0, 7.0): (-360.0, 360.0), (11.0, 90.0): (100.0, -360.0), (12.0, -90.0): (0.0, 360.0)}
    for (here, declination), others in places.items():
        seen = visibility([here, *others], [declination] * 3, CONFIG, **asked)
        assert np.ptp(seen.sun_deg) < 1e-10


def test_targets_at_the_sun_and_opposite_have_an_angle():
    start = 61771.5
    with Astropy() as oracle:
        sun = oracle.vector("sun", start + np.arange(200)).T
    ra, dec = np.degrees(np.arctan2(sun[:, 1], sun[:, 0])), np.degrees(np.arctan2(sun[:, 2], np.hypot(*sun.T[:2])))
    seen = visibility([*ra, *(ra + 180) % 360], [*dec, *-dec], CONFIG, ORBIT, start_utc="2028-01-01", n_days=200)
    there, opposite = np.split(seen.sun_deg, 2)
    assert np.diag(there).max() < 1e-5
    assert np.diag(opposite).min() > 180 - 1e-5


def test_targets_and_suns_in_the_plane_of_the_orbit():
    # The last target is the pole of the orbit, where any direction in the plane is the nearest. A tilt brings rounding.
    rng = np.random.default_rng(41)
    n = 2000
    longitude, latitude = rng.uniform(0, 2 * np.pi, n), np.where(np.arange(n) < n / 2, 0.0, rng.uniform(-1.5, 1.5, n))
    sun_longitude, sun_latitude = rng.uniform(0, 2 * np.pi), rng.uniform(-1.5, 1.5)
    targets = np.concatenate([direction(np.degrees(longitude), np.degrees(latitude)), [[0.0, 0.0, 1.0]]])
    sun = direction(np.degrees(sun_longitude), np.degrees(sun_latitude))[None]
    for axes in (np.eye(3), np.linalg.qr(rng.normal(size=(3, 3)))[0]):
        plane = axes[:1], axes[1:2]
        found = _geometry(targets @ axes, sun @ axes, targets @ sun.T, plane, np.ones((n + 1, 1), bool))
        assert found.in_plane == pytest.approx([*np.cos(latitude), 0.0], abs=1e-12)
        assert found.in_plane.max() <= 1.0
        ahead, aside = found.sun_ahead / np.cos(sun_latitude), found.sun_aside / np.cos(sun_latitude)
        assert ahead[:-1] == pytest.approx(np.cos(sun_longitude - longitude), abs=1e-12)
        assert aside[:-1] == pytest.approx(np.sin(sun_longitude - longitude), abs=1e-12)
        assert np.hypot(ahead, aside) == pytest.approx(1.0, abs=1e-12)


def test_the_moon_itself_is_blocked_by_any_limit_but_none():
    with Astropy() as oracle:
        moon = oracle.vector("moon", 61771.5)
    distance = np.linalg.norm(moon)
    ra, dec = np.degrees(np.arctan2(moon[1], moon[0])), np.degrees(np.arcsin(moon[2] / distance))
    parallax = np.degrees(np.arcsin((EARTH + ORBIT.altitude_km) / distance))
    away = np.array([0.0, 0.5 * parallax, parallax + 0.01, parallax + 0.7, parallax + 0.9])
    for limit, blocked in ((0.0, 0), (1e-3, 2), (0.8, 4), (0.95, 5), (1.1, 5)):
        config = load_visibility(EARTH_ALONE.content() | {"moon_deg": limit})
        seen = visibility(np.full(5, ra), dec + away, config, ORBIT, start_utc="2028-01-01", n_days=1)
        assert seen.moon_deg[:, 0] == pytest.approx(away, abs=2e-3)
        assert (seen.blocked_by[:, 0] == BLOCKS.index("moon")).sum() == blocked


def test_no_network_and_no_warning(monkeypatch):
    def refuse(*args, **kwargs):
        raise AssertionError("the network was asked")

    monkeypatch.setattr(socket, "getaddrinfo", refuse)
    monkeypatch.setattr(socket.socket, "connect", refuse)
    for start in ("1972-01-01", "2016-12-31T12:00:00", "2100-12-01"):
        seen = visibility([10.0], [20.0], CONFIG, ORBIT, start_utc=start, n_days=30)
        assert np.isfinite(seen.sun_deg).all()
        assert seen.windows(0)[0][0].startswith(start[:4])


def test_same_numbers_for_a_part_of_the_targets_and_dates():
    ra, dec = sky(40, 12)
    whole = visibility(ra, dec, CONFIG, ORBIT, start_utc="2028-01-01", n_days=60)
    part = visibility(ra[5:9], dec[5:9], CONFIG, ORBIT, start_utc="2028-01-01", n_days=30)
    np.testing.assert_array_equal(part.blocked_by, whole.blocked_by[5:9, :30])
    np.testing.assert_allclose(part.visible_fraction, whole.visible_fraction[5:9, :30], atol=1e-12)
    np.testing.assert_allclose(part.window_s, whole.window_s[5:9, :30], atol=1e-8)


def test_the_whole_catalogue_fits_in_little_memory():
    stars = rank_sample()
    tracemalloc.start()
    try:
        seen = visibility(stars.ra_deg, stars.dec_deg, CONFIG, ORBIT, start_utc="2028-01-01", n_days=366, step_days=6)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert seen.visible_fraction.shape == (1077, 61)
    # Ten numbers and more a pair are at work at once; the samples along the orbits are not kept.
    assert peak < 40 * 8 * seen.visible_fraction.size + 40e6


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        (
            {"ra_deg": [1.0, float("nan")], "dec_deg": [0.0, 0.0]},
            "ra_deg = nan deg: not accepted; allowed: -360 to 360 (row 1)",
        ),
        ({"dec_deg": [91.0]}, "dec_deg = 91.0 deg: not accepted; allowed: -90 to 90 (row 0)"),
        ({"ra_deg": [1.0, 2.0]}, "ra_deg = (2,) beside dec_deg (1,): not accepted"),
        ({"ra_deg": [], "dec_deg": []}, "ra_deg = (0,) beside dec_deg (0,): not accepted"),
        ({"start_utc": "soon"}, "start_utc = soon UTC: not accepted"),
        ({"n_days": 0}, "n_days = 0: not accepted; allowed: an integer from 1 to 36525"),
        ({"n_days": 3652, "start_utc": "2099-01-01"}, "n_days = 3652 d: not accepted; allowed: an end before 2101"),
        ({"step_days": 0.0}, "step_days = 0.0 d: not accepted; allowed: 0.001 to 366"),
        ({"ra_deg": np.zeros(1000), "dec_deg": np.zeros(1000), "n_days": 36525}, "n_days = 36525 d: not accepted"),
    ],
)
def test_refusals(refused, changes, text):
    asked = {"ra_deg": [1.0], "dec_deg": [2.0], "start_utc": "2028-01-01", "n_days": 10} | changes
    message = refused("", visibility, asked.pop("ra_deg"), asked.pop("dec_deg"), CONFIG, ORBIT, **asked)
    assert message.startswith(text)
