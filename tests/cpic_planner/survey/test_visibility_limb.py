"""Arcs of an orbit: analytic fractions, brute force, and bounds."""

import itertools
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cpic_planner.survey.visibility import Geometry, _flank, clear_arcs
from simulator import load_instrument
from simulator.products import CircularOrbit, earth_radius_deg

ORBIT = CircularOrbit(load_instrument().mission.orbit)
RADIUS_DEG = float(earth_radius_deg(ORBIT.radius_km))
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
    assert fraction[0] * ORBIT.period_s / 60 == pytest.approx(IN_PLANE[limit], abs=0.08)
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


def test_limbs_that_are_all_dark_or_all_sunlit():
    # The Sun behind the target lights the limb below it, the Sun in front of it does not, wherever on the orbit.
    rng = np.random.default_rng(3)
    target = unit(rng.normal(size=(200, 3)))
    for sun, limit in ((target, 30.0), (-target, 10.0)):
        fraction, _ = clear_arcs(geometry(target, sun), RADIUS_DEG, 10.0, 30.0)
        plain, _ = clear_arcs(geometry(target, sun), RADIUS_DEG, limit, limit)
        np.testing.assert_allclose(fraction, plain, atol=1e-12)


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
            runs = np.array([getattr(piece, name)[n] for name in ("total", "begin", "end", "longest")])
            assert runs / step[n] * 2000 == pytest.approx([expected[k] for k in order], abs=3.01), samples[:, n]
            assert piece.length[n] == 2 * step[n]


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


def test_a_target_at_the_pole_of_the_orbit():
    some = Geometry(np.zeros(2), np.array([1.0, 0.0]), np.zeros(2), np.array([0.0, 1.0]))
    fraction, longest = clear_arcs(some, RADIUS_DEG, 10.0, 30.0)
    # Sun in the plane: the limb point below the target is lit for half of the orbit; Sun at the pole: always.
    assert fraction.tolist() == pytest.approx([0.5, 0.0], abs=1e-4)
    assert longest.tolist() == pytest.approx([0.5, 0.0], abs=1e-4)
