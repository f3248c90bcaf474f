"""When stars can be seen: rolls, limb of the Earth, calendars and results, against geometry worked out otherwise."""

import itertools
import socket
import tracemalloc
import warnings
from dataclasses import replace
from datetime import datetime, timedelta

import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import GCRS, BarycentricMeanEcliptic, SkyCoord, get_body
from astropy.time import Time
from astropy.utils import iers
from hypothesis import given, strategies as st
from matplotlib.path import Path as Outline

from cpic_core import InputError, load_yaml
from cpic_planner.results import VisibilityResult
from cpic_planner.survey.visibility import (
    BLOCKS,
    PACKAGE,
    Geometry,
    Visibility,
    VisibilityConfig,
    _flank,
    _geometry,
    clear_arcs,
    load_visibility,
    roll_half_range_deg,
    slew_s,
    visibility,
    visibility_result,
)
from cpic_planner.targets import Targets, find_target, rank_sample
from simulator import load_instrument
from simulator.config import preset_names, preset_path
from simulator.products import CircularOrbit, earth_radius_deg


@pytest.mark.parametrize("name", preset_names("visibility", package="cpic_planner"))
def test_presets_are_complete_and_sourced(name):
    config = load_visibility(name)
    assert config.name == name
    assert config.description
    tree = load_yaml(preset_path("visibility", name, package=PACKAGE))
    numbers = set(VisibilityConfig.model_fields) - {"name", "description"}
    # The Sun's limit is said in the instrument's preset alone.
    assert set(tree) - {"kind", "name", "description"} | {"sun_deg"} == numbers == set(config.provenance)
    for key, standing in config.provenance.items():
        assert standing.source, key
        assert standing.confidence in ("P", "I", "A"), key
        if standing.confidence == "A":
            low, high = standing.range
            assert low <= getattr(config, key) <= high, key


def test_default_values():
    config = load_visibility()
    assert load_visibility("default") == config
    assert load_visibility(config) is config
    assert (config.sun_deg, config.moon_deg, config.dark_limb_deg, config.bright_limb_deg) == (50, 20, 10, 30)
    assert config.sun_deg == load_instrument().sky.sun_limit_deg
    assert config.provenance["sun_deg"] == load_instrument().provenance["sky.sun_limit_deg"]
    assert (config.panel, config.panel_deg, config.roll_deg, config.saa_fraction) == ("one_axis", 25, 15, 0.08)
    assert (config.settle_s, config.thermal_settle_orbits) == (180, 1)


def test_share_of_the_anomaly_is_that_of_the_quoted_polygon_and_a_margin():
    # Corners (longitude, latitude) of the survey planning's polygon; over days an orbit passes every longitude alike.
    outline = Outline([(-13, -42.5), (-72, -42.5), (-81, -25), (-54, -15), (5, -32)])
    orbit = CircularOrbit(load_instrument().mission.orbit)
    position, _ = orbit.state(np.linspace(0, orbit.period_s, 4000, endpoint=False))
    latitude = np.degrees(np.arcsin(position[:, 2] / orbit.radius_km))
    longitude = np.linspace(-180, 180, 720, endpoint=False)
    points = np.stack(np.meshgrid(longitude, latitude), axis=-1).reshape(-1, 2)
    share = outline.contains_points(points).mean()
    assert share == pytest.approx(0.062, abs=0.0005)
    assert "6.2 %" in load_visibility().provenance["saa_fraction"].source
    assert share < load_visibility().saa_fraction


def test_slews_follow_the_quoted_times(refused):
    survey = load_visibility({"settle_s": 68})
    # Angle (deg) and time (s) of the survey planning.
    for angle, time_s in ((20, 127), (45, 196), (180, 581)):
        assert float(slew_s(angle, survey)) == pytest.approx(time_s, abs=2)
    assert slew_s([0.0, 35.0, 180.0], load_visibility()).tolist() == pytest.approx([0.0, 280.0, 180 / 0.35 + 180])
    for angle in (-1.0, 181.0, float("nan"), "far"):
        refused("angle_deg", slew_s, angle, survey)


def test_changes_are_laid_over_the_base(tmp_path):
    near = load_visibility({"moon": 40})
    assert near.moon_deg == 40
    assert near.name == "default+changes"
    assert near.sun_deg == load_visibility().sun_deg
    assert "moon_deg" not in near.provenance
    assert near.provenance["sun_deg"] == load_visibility().provenance["sun_deg"]
    path = tmp_path / "strict.yaml"
    path.write_text(
        'kind: visibility\nbase: default\nbright_limb_deg: {value: 70, unit: deg, source: "survey", confidence: P}\n'
    )
    strict = load_visibility(str(path))
    assert (strict.name, strict.bright_limb_deg) == ("strict", 70)
    assert strict.provenance["bright_limb_deg"].confidence == "P"
    assert load_visibility(path).content() == strict.content() != load_visibility().content()
    assert load_visibility({"name": "other words"}).content() == load_visibility().content()
    assert load_visibility({}) == load_visibility().model_copy(update={"description": ""})


def test_a_file_that_is_no_mapping_is_refused(refused, tmp_path):
    path = tmp_path / "list.yaml"
    path.write_text("- 1\n")
    refused("a YAML mapping of kind visibility", load_visibility, path)


def limits(**values):
    return load_visibility({"roll_deg": 90} | values)


def smallest_angle_deg(theta, psi, turn, steps=801):
    """Angle from the Sun of the best of many normals, for a boresight along z and panels that turn about y."""
    theta, psi = np.radians(theta), np.radians(psi)
    sun = np.array([np.sin(theta) * np.cos(psi), np.sin(theta) * np.sin(psi), np.cos(theta)])
    turned = np.radians(np.linspace(-turn, turn, steps))
    normals = np.stack([np.cos(turned), np.zeros(steps), np.sin(turned)], axis=-1)
    return np.degrees(np.arccos(np.clip(normals @ sun, -1, 1))).min()


@given(st.floats(0.5, 179.5), st.floats(0, 90), st.floats(1, 80))
def test_at_the_end_of_the_range_the_best_normal_is_at_its_limit(theta, turn, limit):
    (half,) = roll_half_range_deg(np.array([theta]), limits(panel_turn_deg=turn, panel_deg=limit))
    at_rest = smallest_angle_deg(theta, 0.0, turn)
    if np.isnan(half):
        assert at_rest > limit - 1e-6
    else:
        assert 0 <= half <= 90
        assert at_rest <= limit + 0.1
        assert smallest_angle_deg(theta, half, turn) <= limit + 0.1
        if half < 89:
            # A little more roll is too much.
            assert smallest_angle_deg(theta, half + 0.5, turn) >= limit - 0.1
            assert smallest_angle_deg(theta, half * 0.5, turn) <= limit + 0.1


def test_free_panels_follow_their_rule():
    theta = np.linspace(0, 180, 181)
    half = roll_half_range_deg(theta, limits(panel_turn_deg=90))
    rolled = np.sin(np.radians(theta)) * np.sin(np.radians(half))
    assert np.all(rolled <= np.sin(np.radians(25)) + 1e-12)
    # Whatever is less than all around stands at the limit.
    inside = half < 90 - 1e-9
    assert rolled[inside] == pytest.approx(np.sin(np.radians(25)))
    assert np.sin(np.radians(theta[~inside])).max() <= np.sin(np.radians(25)) + 1e-9


def test_fixed_panels_follow_their_rule():
    theta = np.linspace(0, 180, 361)
    half = roll_half_range_deg(theta, limits(panel="fixed"))
    seen = np.isfinite(half)
    assert theta[seen].tolist() == np.linspace(65, 115, 101).tolist()
    assert np.sin(np.radians(theta[seen])) * np.cos(np.radians(half[seen])) == pytest.approx(np.cos(np.radians(25)))
    # What panels of one axis may turn by is nothing to fixed ones.
    other = roll_half_range_deg(theta, limits(panel="fixed", panel_turn_deg=60))
    np.testing.assert_array_equal(half, other)
    np.testing.assert_allclose(roll_half_range_deg(theta, limits(panel_turn_deg=0)), half)


def test_default_reaches_from_40_to_140_degrees_with_the_roll_that_is_free():
    config = load_visibility()
    theta = np.array([39.9, 40.0, 90.0, 140.0, 140.1])
    half = roll_half_range_deg(theta, config)
    assert np.isnan(half).tolist() == [True, False, False, False, True]
    assert half[1:4].tolist() == pytest.approx([0.0, 15.0, 0.0], abs=1e-4)
    assert np.nanmax(roll_half_range_deg(np.linspace(0, 180, 200), config)) == 15.0


def test_no_limit():
    half = roll_half_range_deg(np.linspace(0, 180, 50), limits(panel_deg=90, panel_turn_deg=90))
    assert half == pytest.approx(90.0)


CIRCLE = CircularOrbit(load_instrument().mission.orbit)
RADIUS_DEG = float(earth_radius_deg(CIRCLE.radius_km))


# Minutes per orbit of a target in the plane of the orbit, by the limit at any limb; from a radius of 70.2 deg.
IN_PLANE = {5: 53.9, 10: 51.3, 15: 48.8, 20: 46.2, 30: 41.0, 40: 35.9, 50: 30.8, 70: 20.5}
FRACTIONS = {5: 0.58, 10: 0.55, 15: 0.53, 20: 0.50, 30: 0.44, 40: 0.39, 50: 0.33, 70: 0.22}


def unit(values):
    vector = np.asarray(values, float)
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def geometry(target, sun):
    """Of unit vectors whose third component is along the pole of the orbit."""
    in_plane = np.hypot(target[:, 0], target[:, 1])
    one, other = target[:, 0] / in_plane, target[:, 1] / in_plane
    return Geometry(
        in_plane,
        one * sun[:, 0] + other * sun[:, 1],
        one * sun[:, 1] - other * sun[:, 0],
        np.sum(target * sun, axis=-1),
    )


def by_force(target, sun, radius_deg, dark, bright, places=36000):
    """Fraction and longest piece from many places, each with the point of the limb in three dimensions."""
    along = 2 * np.pi * np.arange(places) / places
    zenith = np.stack([np.cos(along), np.sin(along), np.zeros(places)], axis=-1)
    up = zenith @ target
    level = unit(target - up[:, None] * zenith)
    rho = np.radians(radius_deg)
    point = np.sin(rho) * zenith + np.cos(rho) * level
    limb = 180 - radius_deg - np.degrees(np.arccos(np.clip(up, -1, 1)))
    clear = (limb >= dark) & ((limb >= bright) | (point @ sun <= 0))
    if clear.all() or not clear.any():
        return clear.mean(), float(clear.all())
    turned = np.roll(clear, -np.flatnonzero(~clear)[0]).astype(int)
    edges = np.diff(np.concatenate([[0], turned, [0]]))
    return clear.mean(), (np.flatnonzero(edges < 0) - np.flatnonzero(edges > 0)).max() / places


@pytest.mark.parametrize("limit", IN_PLANE)
def test_targets_in_the_plane_of_the_orbit(limit):
    some = Geometry(*(np.array([value]) for value in (1.0, 0.3, -0.2, 0.3)))
    fraction, longest = clear_arcs(some, RADIUS_DEG, limit, limit)
    assert fraction[0] == pytest.approx(FRACTIONS[limit], abs=0.005)
    assert fraction[0] * CIRCLE.period_s / 60 == pytest.approx(IN_PLANE[limit], abs=0.08)
    assert fraction[0] == pytest.approx((180 - RADIUS_DEG - limit) / 180, abs=1e-12)
    assert longest[0] == fraction[0]


@pytest.mark.parametrize("limit", [5.0, 12.0, 19.7])
def test_continuous_viewing_zone(limit):
    # Around the pole of the orbit, as wide as what the limb is below the horizon (19.8 deg) less the limit.
    width = 90 - RADIUS_DEG - limit
    assert abs(RADIUS_DEG + 19.8 - 90) < 0.05
    from_pole = np.radians([0.0, 0.98 * width, 1.02 * width])
    some = Geometry(np.sin(from_pole), np.zeros(3), np.zeros(3), np.cos(from_pole))
    fraction, longest = clear_arcs(some, RADIUS_DEG, limit, limit)
    assert fraction[:2].tolist() == longest[:2].tolist() == [1.0, 1.0]
    assert fraction[2] < 0.97
    assert clear_arcs(some, RADIUS_DEG, 19.9, 19.9)[0][0] == 0.0


@pytest.mark.parametrize(("dark", "bright", "radius"), [(10, 30, RADIUS_DEG), (0, 90, 62.0), (2, 180, 50.0)])
def test_fractions_and_windows_agree_with_many_places(dark, bright, radius):
    rng = np.random.default_rng(17)
    target, sun = unit(rng.normal(size=(120, 3))), unit(rng.normal(size=(120, 3)))
    # Some near the pole of the orbit, where the flanks are wide.
    target[:40, 2] *= 8
    target = unit(target)
    fraction, longest = clear_arcs(geometry(target, sun), radius, dark, bright)
    forced = np.array([by_force(*pair, radius, dark, bright) for pair in zip(target, sun, strict=True)])
    # Of the orbit: 0.02 deg, two of the places.
    assert np.abs(fraction - forced[:, 0]).max() * 360 < 0.02
    assert np.abs(longest - forced[:, 1]).max() * 360 < 0.02
    assert len(np.unique(forced[:, 0])) > 60
    # Windows that are only a part of what is clear are among them.
    assert np.sum(forced[:, 1] < forced[:, 0] - 0.005) > 3


@pytest.mark.parametrize("near", ["anywhere", "plane", "pole", "sun"])
def test_any_orbit_and_any_limits_agree_with_many_places(near):
    rng = np.random.default_rng(23)
    for _ in range(12):
        target, sun = unit(rng.normal(size=(2, 6, 3)))
        if near == "plane":
            target[:, 2], sun[:, 2] = 10 ** rng.uniform(-9, -1, (2, 6))
        elif near == "pole":
            target[:, :2] = 10 ** rng.uniform(-9, -1, (6, 2))
        elif near == "sun":
            sun = rng.choice([-1, 1], (6, 1)) * target + 10 ** rng.uniform(-9, -1, (6, 1)) * sun
        target, sun = unit(target), unit(sun)
        radius, limits = rng.uniform(1, 89), np.sort(rng.uniform(0, 180, 2) * rng.choice([0, 0.3, 1], 2))
        found = np.stack(clear_arcs(geometry(target, sun), radius, *limits), axis=-1)
        forced = np.array([by_force(*pair, radius, *limits, places=7200) for pair in zip(target, sun, strict=True)])
        assert np.abs(found - forced).max() * 360 < 0.15
        assert found.max() <= 1.0


def test_dark_runs_of_a_flank_are_those_of_its_parabolas():
    """Parabolas through all small whole numbers and some others, looked at in 4000 places and at both ends."""
    rng = np.random.default_rng(29)
    whole = list(itertools.product((-2, -1, 0, 1, 2), repeat=3))
    straight = np.outer(rng.normal(size=50), (-1.0, 0.3, 1.6))
    samples = np.array([*whole, *rng.normal(size=(150, 3)), *(rng.normal(size=(50, 3)) ** 3), *straight]).T
    samples[:, -20:] += 1e-15 * rng.normal(size=(3, 20))
    step = rng.uniform(0.001, 2.0, samples.shape[1])
    x = np.concatenate([[-1.0], (np.arange(4000) + 0.5) / 2000 - 1, [1.0]])
    values = np.einsum("kn,kx->nx", samples, [x * (x - 1) / 2, 1 - x**2, x * (x + 1) / 2])
    # A second piece, on which the flank returns to where it came from, is the mirror image of the first.
    pieces = _flank(samples[[0, 1, 2, 1, 0]], step)
    assert len(pieces) == 2
    for n, dark in enumerate(values <= 0):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], dark, [0]])))
        begin, end = (len(x) if dark.all() else np.argmin(side) for side in (dark, dark[::-1]))
        expected = [dark.sum(), begin, end, max(edges[1::2] - edges[::2], default=0)]
        for piece, order in zip(pieces, ((0, 1, 2, 3), (0, 2, 1, 3)), strict=True):
            assert piece[:4, n] / step[n] * 2000 == pytest.approx([expected[k] for k in order], abs=3.01), samples[:, n]
            assert piece[4, n] == 2 * step[n]


def test_a_limb_on_the_terminator_is_dark():
    # The Sun at the pole of the orbit and a target in its plane: the nearest point of the limb never leaves it.
    some = Geometry(np.ones(1), np.zeros(1), np.zeros(1), np.zeros(1))
    assert clear_arcs(some, 70.0, 10.0, 30.0)[0].tolist() == pytest.approx([100 / 180], abs=1e-12)


def test_orbits_that_count_as_a_whole_are_one_revolution():
    # Targets about the pole of the orbit, over a limb that is dark all around; rounding may not make more of it.
    rng = np.random.default_rng(31)
    tilt = np.radians(rng.uniform(0, 15, 3000))
    for sun_up in (-1.0, 1.0):
        some = Geometry(np.sin(tilt), sun_up * np.sin(tilt), np.zeros(3000), sun_up * np.cos(tilt))
        fraction, longest = clear_arcs(some, 70.0, 5.0, rng.uniform(6, 30))
        if sun_up < 0:
            assert fraction.min() >= 1 - 1e-12
            assert longest.min() >= 1 - 1e-12
        assert fraction.max() <= 1.0
        assert longest.max() <= 1.0


def test_many_targets_need_little_memory():
    rng = np.random.default_rng(37)
    some = Geometry(np.full(6000, 0.1), *rng.uniform(-0.7, 0.7, (3, 6000)))
    tracemalloc.start()
    try:
        clear_arcs(some, 70.0, 0.0, 90.0)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # All samples along the 6000 orbits at once would be 5.8 MB an array, and there are dozens of arrays.
    assert peak < 30e6


def test_limbs_that_the_sun_just_grazes():
    # Suns that are moved until a dark piece of a flank is about to vanish: the worst for anything that goes by samples.
    rng = np.random.default_rng(5)
    worst = 0.0
    for _ in range(12):
        target, sun, pole = unit(rng.normal(size=(3, 3)))
        share = np.linspace(0, 1, 400)
        suns = unit(np.outer(1 - share, sun) + np.outer(share, pole))
        some = geometry(np.broadcast_to(target, (400, 3)), suns)
        fraction, _ = clear_arcs(some, RADIUS_DEG, 5.0, 45.0)
        bends = np.abs(np.diff(fraction, 2))
        at = int(np.argmax(bends)) + 1
        forced, _ = by_force(target, suns[at], RADIUS_DEG, 5.0, 45.0)
        worst = max(worst, abs(fraction[at] - forced) * 360)
    assert worst < 0.1


COSINES = st.floats(-1, 1)


@given(st.floats(0, 1), COSINES, COSINES, COSINES, st.floats(45, 75), st.floats(0, 60), st.floats(0, 60))
def test_bounds_and_order(in_plane, ahead, aside, pole, radius, one, other):
    sun = unit([ahead, aside, pole if abs(pole) > 0.01 else 0.5])
    dark, bright = sorted((one, other))
    target_up = np.sqrt(1 - in_plane**2)

    sun_target = np.array([in_plane * sun[0] + target_up * sun[2]])

    def arcs(dark, bright, side=1.0):
        some = Geometry(np.array([in_plane]), sun[:1], side * sun[1:2], sun_target)
        return [float(part[0]) for part in clear_arcs(some, radius, dark, bright)]

    fraction, longest = arcs(dark, bright)
    assert 0 <= longest <= fraction + 1e-12
    assert fraction <= 1
    assert arcs(dark, bright, -1.0) == pytest.approx([fraction, longest], abs=1e-9)
    (easy, _), (hard, _) = arcs(dark, dark), arcs(bright, bright)
    assert hard - 1e-12 <= fraction <= easy + 1e-12
    # A bright limit below the dark one changes nothing.
    assert arcs(bright, dark) == pytest.approx(arcs(bright, bright), abs=1e-12)


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


YEAR = {"start_utc": "2028-01-01", "n_days": 366}


@pytest.fixture(scope="module")
def stars():
    return Targets.joined([find_target(name)[0] for name in ("tau Cet", "rho1 Cnc", "bet Hyi")])


@pytest.fixture(scope="module")
def result(stars):
    return visibility_result(stars, CONFIG, ORBIT, **YEAR, catalogue="test")


def test_numbers_are_those_of_the_calendar(stars, result):
    seen = visibility(stars.ra_deg, stars.dec_deg, CONFIG, ORBIT, **YEAR)
    assert result.mjd == seen.mjd.tolist()
    assert result.period_s == seen.period_s
    for row, target in enumerate(result.targets):
        assert target.days.visible_s == seen.visible_s[row].tolist()
        assert target.days.window_s == seen.window_s[row].tolist()
        assert [BLOCKS.index(name) for name in target.days.blocked_by] == seen.blocked_by[row].tolist()
        usable = seen.observable[row]
        assert target.observable_days == usable.sum()
        assert sum(target.blocked_days.values()) + target.observable_days == 366
        assert target.visible_s == np.median(seen.visible_s[row, usable])
        assert target.best_visible_s == seen.visible_s[row].max()
        assert target.longest_window_s == seen.window_s[row].max()
        best = int(np.argmax(seen.visible_s[row]))
        assert target.best_utc == seen.windows(row)[0][0] if best == 0 else target.best_utc > result.start_utc
        assert sum(season.days for season in target.seasons) == target.observable_days
        assert 0 < target.roll_half_range_deg <= 15


def test_known_stars(result):
    tau_cet, rho_cnc, beta_hyi = result.targets
    assert (tau_cet.hip, rho_cnc.hip, beta_hyi.hip) == (8102, 43587, 2021)
    # Beyond 50 deg from the ecliptic nothing blocks; beside it the Sun does twice as long as the panels' 40 deg.
    assert beta_hyi.ecliptic_latitude_deg == pytest.approx(-64.8, abs=0.1)
    assert beta_hyi.observable_days == 366
    assert len(beta_hyi.seasons) == 1
    assert rho_cnc.ecliptic_latitude_deg == pytest.approx(10.4, abs=0.1)
    assert 98 <= rho_cnc.blocked_days["sun"] <= 106
    assert rho_cnc.blocked_days["moon"] > 10
    assert tau_cet.blocked_days["moon"] == 0
    # Opposite the Sun in early October: the season before ends, the one behind begins 140 deg from the Sun.
    assert [season.end_utc[:7] for season in tau_cet.seasons] == ["2028-02", "2028-09", "2029-01"]


def test_round_trip_and_hash(stars, result):
    assert VisibilityResult.model_validate_json(result.model_dump_json()) == result
    again = visibility_result(stars, CONFIG, ORBIT, **YEAR, catalogue="other words")
    assert again.config_hash == result.config_hash
    month = {"start_utc": "2028-01-01", "n_days": 31}
    hashes = {
        visibility_result(stars, CONFIG, ORBIT, **month).config_hash,
        visibility_result(stars, load_visibility({"moon_deg": 30}), ORBIT, **month).config_hash,
        visibility_result(stars, CONFIG, ORBIT.model_copy(update={"node_deg": 10.0}), **month).config_hash,
        visibility_result(stars, CONFIG, ORBIT, start_utc="2028-01-02", n_days=31).config_hash,
        visibility_result(stars.select([0]), CONFIG, ORBIT, **month).config_hash,
        result.config_hash,
    }
    assert len(hashes) == 6


def test_a_star_that_is_never_seen(stars):
    never = visibility_result(stars.select([0]), load_visibility({"sun_deg": 179}), ORBIT, **YEAR)
    (target,) = never.targets
    assert (target.observable_days, target.seasons) == (0, [])
    assert target.visible_s is target.best_utc is target.longest_window_s is target.roll_half_range_deg is None
    assert target.blocked_days["sun"] == 366


def test_a_star_without_coordinates_is_refused_by_name(refused, stars):
    bare = replace(stars, ra_deg=np.array([1.0, np.nan, 2.0]))
    refused(r"ra_deg, dec_deg = missing deg: .* has none of rho1 Cnc", visibility_result, bare, CONFIG, ORBIT, **YEAR)
