"""Places on Kepler orbits against high precision, rotation matrices and pictures."""

import mpmath
import numpy as np
import pytest

from catalogs import ECCENTRICITY_MAX, eccentric_anomaly, orbit_places

ECCENTRICITIES = (0.0, 1e-8, 0.05, 0.3, 0.7, 0.9, 0.99, ECCENTRICITY_MAX)


@pytest.mark.parametrize("e", ECCENTRICITIES)
def test_kepler_equation_against_fifty_digits(e):
    rng = np.random.default_rng(4)
    angles = [0.0, np.pi, -np.pi, *rng.uniform(-np.pi, np.pi, 40), *10.0 ** rng.uniform(-14, 0.4, 40)]
    found = eccentric_anomaly(np.array(angles), e)
    with mpmath.workdps(50):
        for angle, value in zip(angles, found.tolist(), strict=True):
            m, eccentricity = mpmath.mpf(float(angle)), mpmath.mpf(e)
            exact = mpmath.findroot(lambda x, m=m, k=eccentricity: x - k * mpmath.sin(x) - m, mpmath.mpf(value))
            assert abs(float(exact - mpmath.mpf(value))) < 1e-14


def test_kepler_equation_over_the_whole_range_and_many_turns():
    angle = np.linspace(0.0, np.pi, 2001)
    e = np.linspace(0.0, ECCENTRICITY_MAX, 301)[:, None]
    found = eccentric_anomaly(angle, e)
    # The residual, in units of how much it moves the solution.
    assert np.abs((found - e * np.sin(found) - angle) / (1.0 - e * np.cos(found))).max() < 1e-13
    assert np.all(np.diff(found, axis=1) > 0)
    np.testing.assert_array_equal(eccentric_anomaly(-angle, e), -found)
    turned = eccentric_anomaly(angle[1:-1] + 14.0 * np.pi, 0.6)
    np.testing.assert_allclose(turned, eccentric_anomaly(angle[1:-1], 0.6) + 14.0 * np.pi, rtol=0, atol=1e-13)


def by_matrices(a, e, i, w, node, m):
    """North, east and away, by true anomaly and three rotations; phase between vectors."""
    i, w, node, m = np.radians([i, w, node, m])
    big_e = m
    for _ in range(200):
        big_e = m + e * np.sin(big_e)
    f = 2.0 * np.arctan2(np.sqrt(1 + e) * np.sin(big_e / 2), np.sqrt(1 - e) * np.cos(big_e / 2))
    r = a * (1 - e * e) / (1 + e * np.cos(f))

    def about_z(t):
        return np.array([[np.cos(t), -np.sin(t), 0], [np.sin(t), np.cos(t), 0], [0, 0, 1]])

    about_x = np.array([[1, 0, 0], [0, np.cos(i), -np.sin(i)], [0, np.sin(i), np.cos(i)]])
    place = about_z(node) @ about_x @ about_z(w) @ np.array([r * np.cos(f), r * np.sin(f), 0.0])
    observer = np.array([0.0, 0.0, -1e9])
    to_star, to_observer = -place, observer - place
    cosine = to_star @ to_observer / np.linalg.norm(to_star) / np.linalg.norm(to_observer)
    return place[0], place[1], np.linalg.norm(place), np.degrees(np.arccos(cosine))


def test_places_equal_rotation_matrices():
    rng = np.random.default_rng(8)
    elements = np.stack(
        [
            rng.uniform(0.3, 20, 200),
            rng.uniform(0, 0.8, 200),
            rng.uniform(0, 180, 200),
            *rng.uniform(-360, 360, (3, 200)),
        ]
    )
    found = orbit_places(*elements)
    expected = np.array([by_matrices(*column) for column in elements.T]).T
    for value, other in zip((found.north_au, found.east_au, found.distance_au), expected[:3], strict=True):
        np.testing.assert_allclose(value, other, rtol=0, atol=1e-12 * 20)
    np.testing.assert_allclose(found.phase_deg, expected[3], rtol=0, atol=2e-6)  # the arc cosine, and 1e9 au away


@pytest.mark.parametrize(
    ("elements", "north", "east", "phase"),
    [
        ((2, 0, 0, 0, 0, 0), 2, 0, 90),  # face-on, at the node, which points north
        ((2, 0, 0, 0, 0, 90), 0, 2, 90),  # a quarter later: east, position angles grow
        ((2, 0, 180, 0, 0, 90), 0, -2, 90),  # retrograde: west
        ((2, 0, 0, 0, 90, 0), 0, 2, 90),  # the node at position angle 90 is east
        ((2, 0.5, 0, 0, 0, 0), 1, 0, 90),  # pericentre
        ((2, 0.5, 0, 0, 0, 180), -3, 0, 90),  # apocentre
        ((2, 0, 90, 0, 0, 90), 0, 0, 0),  # edge-on, past the node: behind the star, full
        ((2, 0, 90, 0, 0, 270), 0, 0, 180),  # in front, new
        ((2, 0, 60, 90, 0, 0), 0, 1, 30),  # behind and to the side
    ],
)
def test_pictures(elements, north, east, phase):
    found = orbit_places(*elements)
    assert found.north_au == pytest.approx(north, abs=1e-12)
    assert found.east_au == pytest.approx(east, abs=1e-12)
    assert found.phase_deg == pytest.approx(phase, abs=1e-12)


def test_phases_of_face_on_and_edge_on_orbits():
    mean = np.linspace(0, 360, 721)
    np.testing.assert_allclose(orbit_places(1.0, 0.4, 0.0, 30.0, 70.0, mean).phase_deg, 90.0, rtol=0, atol=1e-12)
    edge = orbit_places(1.0, 0.0, 90.0, 0.0, 0.0, mean).phase_deg
    assert edge.min() == pytest.approx(0.0, abs=1e-12)
    assert edge.max() == pytest.approx(180.0, abs=1e-12)
    # Near new phase the angle keeps its relative precision: a millionth of a degree is no zero.
    assert 180.0 - orbit_places(1.0, 0.0, 90.0, 0.0, 0.0, 270.0 + 1e-6).phase_deg == pytest.approx(1e-6, rel=1e-6)


@pytest.mark.parametrize("e", [0.0, 0.2, 0.6, 0.9])
def test_mean_distance_over_time(e):
    mean = (np.arange(20000) + 0.5) * 360.0 / 20000
    distance = orbit_places(3.0, e, 40.0, 50.0, 60.0, mean).distance_au
    assert distance.mean() == pytest.approx(3.0 * (1.0 + e * e / 2.0), rel=1e-10)
    assert distance.min() >= 3.0 * (1.0 - e) * (1 - 1e-12)
    assert distance.max() <= 3.0 * (1.0 + e) * (1 + 1e-12)
