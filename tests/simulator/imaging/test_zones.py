"""Where planets are looked for: quadrants and a ring behind one protocol.

Geometry of a band on a stamp: what no numerical setting changes, and what is known without measuring.
"""

import numpy as np
import pytest

from simulator.config import load_instrument
from simulator.imaging import BandGeometry, HoleZone, RingZone, measure, psf_metrics, single_band_psf, zone_from
from simulator.imaging.external import load_psf, save_psf
from simulator.knobs import FIDELITIES, Knobs

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


INSTRUMENT = load_instrument()


@pytest.mark.parametrize("band", ["F520", "F662", "F720", "F850"])
def test_it_is_that_of_the_metrics(band):
    stored, found = psf_metrics(INSTRUMENT, band), BandGeometry.of(INSTRUMENT, band, 137)
    assert found == stored.geometry
    np.testing.assert_array_equal(found.hole, stored.hole)
    assert found.zone.inner_corner_arcsec == stored.hole_inner_corner_arcsec
    assert found.zone.outer_corner_arcsec == stored.owa_arcsec
    right = BandGeometry.of(load_instrument("cpic_2q"), band, 137).hole
    assert right[:, 68:].any()
    assert not right[:, :69].any()


def test_other_settings_measure_nothing_for_it(monkeypatch):
    def refuse(*given):
        raise AssertionError("measured")

    monkeypatch.setattr(measure, "stamp_figures", refuse)
    standard = single_band_psf("F662").geometry
    for knobs in (FIDELITIES["quick"], FIDELITIES["reference"].model_copy(update={"pupil_samples": 64})):
        assert single_band_psf("F662", fidelity=knobs).geometry == standard
    larger = single_band_psf("F662", fidelity=Knobs(wavelength_nodes=1, stamp_pixels=161)).geometry
    assert larger.hole.shape == (161, 161)
    np.testing.assert_array_equal(larger.hole[12:-12, 12:-12], standard.hole)


def test_annuli_and_resolution_elements_are_those_of_a_count():
    geometry = BandGeometry.of(INSTRUMENT, "F520", 137)
    pixel, inner, outer = geometry.pixel_scale_arcsec, geometry.zone.inner_arcsec, geometry.zone.outer_arcsec
    expected = 0
    for y in (np.arange(137) - 68) * pixel:
        for x in (np.arange(137) - 68) * pixel:
            square = inner <= abs(x) <= outer and inner <= abs(y) <= outer
            expected += square and abs(np.hypot(x, y) - 0.55) <= 1.5 * geometry.lambda_d_arcsec
    assert np.count_nonzero(geometry.annulus(0.55, 1.5)) == expected
    places = np.geomspace(0.1, 1.2, 40)
    counted = [np.count_nonzero(geometry.annulus(place, 1.5)) for place in places]
    assert max(counted) > expected > min(counted) == 0
    np.testing.assert_array_equal(geometry.annulus_pixels(places, 1.5), counted)
    angle = (np.arange(200_000) + 0.5) / 200_000 * 2 * np.pi
    x, y = np.abs(0.55 * np.cos(angle)), np.abs(0.55 * np.sin(angle))
    dark = (np.minimum(x, y) >= inner) & (np.maximum(x, y) <= outer)
    arcs = 2 * np.pi * 0.55 * dark.mean() / geometry.lambda_d_arcsec
    assert geometry.resolution_elements(0.55) == pytest.approx(arcs, rel=1e-4)
    assert geometry.aperture_pixels == pytest.approx(np.pi * (0.7 * geometry.lambda_d_arcsec / pixel) ** 2)


def test_a_psf_from_a_file_has_the_mask_of_its_file(refused, tmp_path):
    psf = load_psf(save_psf(single_band_psf("F662"), tmp_path / "a.npz"), instrument=INSTRUMENT)
    assert psf.geometry == single_band_psf("F662").geometry
    wide = BandGeometry.of(INSTRUMENT, "F662", 137, 0.3)
    assert (wide.mask_half_width_arcsec, wide.zone) == (0.3, psf.geometry.zone)
    refused("band", BandGeometry.of, INSTRUMENT, "F1", 137)


@pytest.mark.parametrize(
    ("mode", "side", "inside", "outside"),
    [
        ("4q", "right", [(0.5, 0.5), (-0.5, 0.5), (0.5, -0.5), (-0.5, -0.5)], []),
        ("2q", "right", [(0.5, 0.5), (-0.5, 0.5)], [(0.5, -0.5), (-0.5, -0.5)]),
        ("2q", "left", [(0.5, -0.5), (-0.5, -0.5)], [(0.5, 0.5), (-0.5, 0.5)]),
        ("2q", "top", [(0.5, 0.5), (0.5, -0.5)], [(-0.5, 0.5), (-0.5, -0.5)]),
        ("2q", "bottom", [(-0.5, 0.5), (-0.5, -0.5)], [(0.5, 0.5), (0.5, -0.5)]),
    ],
)
def test_quadrants_as_y_and_x(mode, side, inside, outside):
    y, x = HoleZone(0.2, 0.8, mode, side).score_axes(0.1)
    points = {(round(a, 9), round(b, 9)) for a in y for b in x}
    near = {(np.sign(a) * 0.45, np.sign(b) * 0.45) for a, b in inside}
    assert near <= points
    assert not points & {(np.sign(a) * 0.45, np.sign(b) * 0.45) for a, b in outside}
    assert np.all(np.diff(y) > 0)
    assert np.all(np.diff(x) > 0)


def test_score_grid_fills_the_zone_at_the_exact_step():
    zone = HoleZone(0.21, 0.707)
    y, x = zone.score_axes(0.017)
    positive = y[y > 0]
    np.testing.assert_allclose(np.diff(positive), 0.017)
    assert 0.21 <= positive[0] < 0.21 + 0.017
    assert 0.707 - 0.017 < positive[-1] <= 0.707
    np.testing.assert_array_equal(y, x)
    np.testing.assert_allclose(y, -y[::-1])
    assert zone.inner_corner_arcsec == pytest.approx(0.29698, abs=1e-5)


def test_control_points_hold_the_edges_and_are_other_points():
    zone = HoleZone(0.2, 0.7)
    y, _ = zone.control_axes(0.034, 0.007)
    positive = y[y > 0]
    assert positive[0] == pytest.approx(0.193)
    assert positive[-1] == pytest.approx(0.707)
    assert np.diff(positive).max() <= 0.034
    scored = zone.score_axes(0.017)[0]
    assert np.abs(scored[:, None] - y).min() > 0


@pytest.mark.parametrize(
    ("mode", "side", "diagonals"),
    [
        ("4q", "right", {(1, 1), (-1, 1), (1, -1), (-1, -1)}),
        ("2q", "right", {(1, 1), (1, -1)}),
        ("2q", "left", {(-1, 1), (-1, -1)}),
        ("2q", "top", {(1, 1), (-1, 1)}),
        ("2q", "bottom", {(1, -1), (-1, -1)}),
    ],
)
def test_one_zone_in_every_form(mode, side, diagonals):
    """Signs of x and y of its quadrants: intervals, axes, covered points and the named diagonal agree."""
    zone = HoleZone(0.2, 0.8, mode, side)
    signs = np.array([-0.5, 0.5])
    covered = zone.covers(signs, signs)
    assert {(x, y) for x in (-1, 1) for y in (-1, 1) if covered[(y + 1) // 2, (x + 1) // 2]} == diagonals
    assert zone.diagonal in diagonals
    rows, columns = zone.intervals()
    assert {(1 if x[0] > 0 else -1, 1 if y[0] > 0 else -1) for x in columns for y in rows} == diagonals
    y, x = zone.axes(np.array([0.3, 0.4]))
    assert {(int(np.sign(a)), int(np.sign(b))) for a in x for b in y} == diagonals
    assert zone.covers(y, x).all()


def test_covering_is_inclusive_and_may_be_widened_or_narrowed():
    zone = HoleZone(0.2, 0.8)
    points = np.array([-0.85, -0.8, -0.2, -0.15, 0.0, 0.15, 0.2, 0.5, 0.8, 0.85])
    middle = np.array([0.5])
    assert points[zone.covers(points, middle)[:, 0]].tolist() == [-0.8, -0.2, 0.2, 0.5, 0.8]
    assert points[zone.covers(points, middle, 0.06)[:, 0]].size == 9
    assert points[zone.covers(points, middle, -0.1)[:, 0]].tolist() == [0.5]
    assert not zone.covers(points, np.zeros(1)).any()
