"""Where planets are looked for: quadrants and a ring behind one protocol."""

import numpy as np
import pytest

from cpic_core import InputError
from simulator.imaging import HoleZone, RingZone, zone_from

RING = RingZone(0.15, 0.45)
SQUARES = HoleZone(0.2, 0.7)
ZONES = [RING, RingZone(-0.01, 0.3), SQUARES, HoleZone(0.2, 0.7, "2q", "left")]


def drawn(zone, n=200_000):
    rng = np.random.default_rng(5)
    return rng.uniform(-1.1, 1.1, (2, n)) * zone.outer_corner_arcsec


@pytest.mark.parametrize("zone", ZONES)
@pytest.mark.parametrize("margin", [0.0, 0.05])
def test_the_azimuth_of_a_circle_is_that_of_points_drawn_on_it(zone, margin):
    """Monte Carlo: the share of points of a circle that the zone contains, to four standard errors."""
    rng = np.random.default_rng(7)
    for radius in np.linspace(0.05, 1.05, 9) * zone.outer_corner_arcsec:
        angle = rng.uniform(0.0, 2.0 * np.pi, 20_000)
        inside = zone.contains(radius * np.cos(angle), radius * np.sin(angle), margin).mean()
        said = float(zone.azimuth_fraction(radius, margin))
        assert abs(inside - said) <= 4.0 * np.sqrt(max(said * (1.0 - said), 1e-9) / angle.size)


def test_the_area_of_a_ring_is_that_of_points_drawn_in_it():
    x, y = drawn(RING)
    side = 2.2 * RING.outer_arcsec
    area = RING.contains(x, y, 0.0).mean() * side**2
    expected = np.pi * (0.45**2 - 0.15**2)
    share = expected / side**2
    assert abs(area - expected) < 4.0 * side**2 * np.sqrt(share * (1.0 - share) / x.size)


@pytest.mark.parametrize("zone", ZONES)
def test_a_grid_is_covered_where_its_points_are_contained(zone):
    axis = np.linspace(-1.0, 1.0, 83)
    for margin in (0.0, 0.04):
        inside = zone.contains(axis[None, :] + 0.0 * axis[:, None], axis[:, None] + 0.0 * axis[None, :], margin)
        np.testing.assert_array_equal(zone.covers(axis, axis, -margin), inside)


@pytest.mark.parametrize("zone", ZONES)
def test_an_aperture_at_the_ends_of_the_usable_range_just_fits(zone):
    radius, sign = 0.03, np.array(zone.diagonal)
    for separation, outward in zip(zone.usable_range_arcsec(radius), (1.0, -1.0), strict=True):
        for off, fits in ((1e-6, True), (-1e-6, False)):
            x, y = sign * (separation + outward * off) / np.sqrt(2.0)
            assert bool(zone.contains(np.array(x), np.array(y), radius)) is fits
            if not fits:
                assert bool(zone.crosses_inner(x, y, radius)) is (outward > 0)


@pytest.mark.parametrize("turn_deg", [7.0, 20.0])
def test_beside_the_diagonal_a_ring_is_the_same_and_squares_are_narrower(turn_deg):
    assert RING.usable_range_arcsec(0.02, turn_deg) == RING.usable_range_arcsec(0.02)
    for separation, outward in zip(SQUARES.usable_range_arcsec(0.02, turn_deg), (1.0, -1.0), strict=True):
        for off, fits in ((1e-6, True), (-1e-6, False)):
            angle = np.radians(45.0 + np.array([-turn_deg, turn_deg]))
            where = separation + outward * off
            assert SQUARES.contains(where * np.cos(angle), where * np.sin(angle), 0.02).all() == fits
    assert SQUARES.usable_range_arcsec(0.02, 50.0)[0] == np.inf


@pytest.mark.parametrize("zone", ZONES)
def test_cells_fill_the_zone_and_the_middle_lies_in_it(zone):
    radius, pixel = 0.03, 0.005
    x, y, step = zone.cells(2 * pixel, radius, pixel)
    assert zone.contains(x, y, radius - pixel).all()
    px, py = drawn(zone)
    area = zone.contains(px, py, radius).mean() * (2.2 * zone.outer_corner_arcsec) ** 2
    assert x.size * step**2 == pytest.approx(area, rel=0.04)
    assert zone.contains(*(np.array(part) for part in zone.middle), radius)


def test_a_ring_too_narrow_for_a_cell_has_cells():
    x, y, _ = RingZone(0.2, 0.26).cells(0.01, 0.03, 0.005)
    assert x.size > 8
    assert np.abs(np.hypot(x, y) - 0.23).max() < 0.02


def test_zones_are_made_from_what_metrics_hold():
    for zone in ZONES:
        assert zone_from(zone.inner_arcsec, zone.outer_arcsec, zone.mode, zone.side) == zone


@pytest.mark.parametrize("edges", [(0.3, 0.3), (-0.4, 0.3), (0.4, 0.3), (0.1, np.inf), (0.1, np.nan)])
def test_impossible_rings_are_refused(edges):
    with pytest.raises(InputError, match="inner < outer"):
        RingZone(*edges)
