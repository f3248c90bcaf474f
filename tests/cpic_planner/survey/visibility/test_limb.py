"""Arcs of an orbit: analytic fractions, brute force, and bounds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cpic_planner.survey.visibility.limb import Geometry, clear_arcs
from simulator import load_instrument
from simulator.products.orbit import CircularOrbit, earth_radius_deg

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
