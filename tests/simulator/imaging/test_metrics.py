import dataclasses

import numpy as np
import pytest
from photutils.aperture import CircularAperture, aperture_photometry

from simulator.config import load_instrument
from simulator.imaging import (
    HoleZone,
    PsfMetrics,
    aperture_sums,
    build_imager,
    overlap_weights,
    psf_metrics,
    single_band_psf,
)
from simulator.imaging.build import bare_imager, dark_hole_of
from simulator.imaging.measure import _wings, stamp_figures
from simulator.imaging.pupil import draw_aberrations
from simulator.knobs import Knobs

INSTRUMENT = load_instrument()
PERFECT = {"wavefront": {"opd_rms_nm": 0, "amplitude_rms": 0, "jitter_mas": 0}, "dark_hole": {"control": "off"}}
BANDS = INSTRUMENT.visible_bands()
ROOT2 = np.sqrt(2)


@pytest.fixture(scope="module")
def metrics():
    return {band: psf_metrics(INSTRUMENT, band) for band in BANDS}


def perfect(band, half_width=0.155):
    """PSF and metrics of perfect optics behind another mask, without a new speckle floor."""
    psf = single_band_psf(
        band, instrument=load_instrument(PERFECT | {"coronagraph": {"mask_half_width_arcsec": half_width}})
    )
    figures = stamp_figures(psf.imager, psf.on_axis, psf.off_axis)
    arrays = psf_metrics(INSTRUMENT, band).to_arrays() | {"mask_half_width_arcsec": np.asarray(half_width)}
    return psf, PsfMetrics.from_arrays(arrays | {name: np.asarray(value) for name, value in figures.items()})


def test_azimuth_fractions_are_those_of_the_conventions(metrics):
    found = metrics["F520"].azimuth_fraction([0.4, 0.65, 0.8, 0.95])
    np.testing.assert_allclose(found, [0.46, 0.68, 0.38, 0.07], atol=0.006)
    # Against a fine circle.
    angle = (np.arange(200000) + 0.5) / 200000 * 2 * np.pi
    for band in metrics.values():
        for r in (0.1, 0.33, 0.5, 0.75, 0.99, 1.2):
            x, y = np.abs(r * np.cos(angle)), np.abs(r * np.sin(angle))
            inside = (np.minimum(x, y) >= band.hole_inner_arcsec) & (np.maximum(x, y) <= band.hole_outer_arcsec)
            assert band.azimuth_fraction(r) == pytest.approx(inside.mean(), abs=2e-5)
            assert band.resolution_elements(r) == pytest.approx(
                2 * np.pi * r * inside.mean() / band.lambda_d_arcsec, abs=0.01
            )


def test_geometry(metrics):
    for band, m in metrics.items():
        assert m.band == band
        assert m.owa_arcsec == pytest.approx(1.0, abs=1e-3)
        assert m.hole_inner_corner_arcsec == pytest.approx(4.3 * m.lambda_d_arcsec)
        side = 2 * ((0.707 - m.hole_inner_arcsec) / m.pixel_scale_arcsec)
        assert m.hole.sum() == pytest.approx(side**2, rel=0.05)
        assert m.aperture_pixels == pytest.approx(INSTRUMENT.aperture_pixels(band))
        assert m.peak_on_axis_hole < m.peak_on_axis_frame < m.peak_off_axis
        half = m.iwa_arcsec / ROOT2
        assert m.core_throughput(half, half) == pytest.approx(0.5 * m.core_open, rel=1e-3)


def test_figures_of_the_apodizer_alone():
    for band in BANDS:
        _, m = perfect(band)
        assert m.core_open == pytest.approx(0.1385, abs=0.0015)
        assert m.core_continuous == pytest.approx(0.141, abs=0.0005)
        # Half of the core is open where each bar of the mask takes 1 - sqrt(1/2) of it.
        assert 0.155 * ROOT2 < m.iwa_arcsec < 0.26


def test_mirror_and_jitter_cost_a_few_percent_of_the_core(metrics):
    for band, m in metrics.items():
        own = dark_hole_of(INSTRUMENT, band).own
        assert 0.9 <= m.strehl <= own.strehl
        assert 0.12 <= m.core_continuous < own.core_throughput < 0.142
        assert 0.96 * m.core_continuous < m.core_open < m.core_continuous


@pytest.mark.parametrize("band", ["F520", "F850"])
def test_core_throughput_is_what_aperture_photometry_measures(metrics, band):
    m = metrics[band]
    psf = single_band_psf(band, instrument=INSTRUMENT)
    pixel, radius = m.pixel_scale_arcsec, m.aperture_radius_arcsec / m.pixel_scale_arcsec
    rng = np.random.default_rng(7)
    for base, tolerance in (((0.4, 0.45), 5e-4), ((0.21, -0.3), 5e-3), ((-0.16, 0.45), 0.01)):
        found, expected = [], []
        for dx, dy in rng.uniform(-0.5, 0.5, (12, 2)) * pixel:
            x, y = base[0] + dx, base[1] + dy
            circle = CircularAperture((68 + x / pixel, 68 + y / pixel), radius)
            found.append(aperture_photometry(psf.at(x, y), circle)["aperture_sum"][0])
            expected.append(m.core_throughput(x, y))
        assert np.mean(found) == pytest.approx(np.mean(expected), rel=tolerance)


@pytest.mark.parametrize(("band", "share"), [("F520", 0.27), ("F662", 0.27), ("F850", 0.26)])
def test_core_on_the_diagonal_behind_a_0134_mask(band, share):
    _, m = perfect(band, 0.134)

    def along(separation):
        return m.core_throughput(separation / ROOT2, separation / ROOT2) / m.core_open

    assert along(0.19) == pytest.approx(share, abs=0.02)
    assert along(0.15) < 0.05
    np.testing.assert_allclose(along(np.array([0.3, 0.5, 0.65, 0.95])), 1.0, atol=0.02)


def test_core_off_the_diagonals_follows_the_mask():
    psf, m = perfect("F662", 0.134)
    separation = np.array([0.3, 0.5, 0.65, 0.95])
    expected = {0: [0, 0, 0, 0], 15: [0, 0.44, 0.94, 1.0], 30: [0.74, 1, 1, 1]}
    for angle, shares in expected.items():
        t = np.radians(angle)
        np.testing.assert_allclose(
            m.core_throughput(separation * np.sin(t), separation * np.cos(t)) / m.core_open, shares, atol=0.03
        )
    # The whole light path in numbers: shifted image times mask, summed in a circle.
    pixel, radius = psf.pixel_scale_arcsec, psf.imager.aperture_radius_arcsec / psf.pixel_scale_arcsec
    unmasked = dataclasses.replace(psf.imager, mask_half_width_arcsec=0.0)
    axis, fine = unmasked.stamp_axis(masked=True), (np.arange(137 * 8) + 0.5) / 8 - 68.5
    is_open = (np.abs(fine * pixel) >= 0.134).reshape(137, 8).mean(axis=1)
    for angle, shares in expected.items():
        for separation, share in zip((0.3, 0.5, 0.65, 0.95), shares, strict=True):
            x, y = separation * np.sin(np.radians(angle)), separation * np.cos(np.radians(angle))
            image = unmasked.image(axis, axis, source_arcsec=(x, y)) * np.outer(is_open, is_open)
            circle = CircularAperture((68 + x / pixel, 68 + y / pixel), radius)
            found = aperture_photometry(image, circle)["aperture_sum"][0]
            assert found / m.core_open == pytest.approx(share, abs=0.03)


@pytest.mark.parametrize("side", ["right", "left", "top", "bottom"])
def test_two_quadrants_halve_what_four_have(metrics, side):
    four = metrics["F662"]
    two = PsfMetrics.from_arrays(four.to_arrays() | {"hole_mode": np.asarray("2q"), "hole_side": np.asarray(side)})
    offset = (np.arange(137) - 68) * four.pixel_scale_arcsec
    y, x = np.meshgrid(offset, offset, indexing="ij")
    beyond = {"right": x > 0, "left": x < 0, "top": y > 0, "bottom": y < 0}[side]
    np.testing.assert_array_equal(two.hole, four.hole & beyond)
    separation = np.array([0.35, 0.5, 0.8, 1.2])
    np.testing.assert_allclose(two.azimuth_fraction(separation), 0.5 * four.azimuth_fraction(separation))
    np.testing.assert_allclose(two.resolution_elements(separation), 0.5 * four.resolution_elements(separation))
    sign_x, sign_y = two.zone.diagonal
    index = 68 + round(0.5 / four.pixel_scale_arcsec) * np.array([sign_y, sign_x])
    assert two.hole[tuple(index)]
    assert two.annulus(0.5, 0.5).sum() == four.annulus(0.5, 0.5).sum() / 2


def test_shipped_two_quadrant_instrument():
    instrument = load_instrument("cpic_2q")
    inner = [HoleZone(instrument.hole_inner_arcsec(band), 0.707).inner_corner_arcsec for band in BANDS]
    np.testing.assert_allclose(inner, [0.19, 0.21, 0.23, 0.27])
    for band in BANDS:
        own = dark_hole_of(instrument, band).own
        assert 0.9 < own.strehl < 0.97
        assert own.mean < 8e-9


def test_wings_keep_their_orientation(metrics):
    """Speckles of random phase are not symmetric: light of a source at (X, Y) in a box around (x, y) on the stamp."""
    maps = draw_aberrations(11, samples=64, opd_rms_nm=60.0, psd_slope=1.0)
    imager = bare_imager(load_instrument(PERFECT), "F662", Knobs(wavelength_nodes=1))
    imager = dataclasses.replace(imager, static=maps)
    wings = {name: np.asarray(value) for name, value in _wings(imager).items()}
    m = PsfMetrics.from_arrays(metrics["F662"].to_arrays() | wings)
    step, pixel = m.wing_map_step_arcsec, m.pixel_scale_arcsec
    source = (1.2, -0.9)
    places = [(i, j) for i in (-7, -4, 3, 8) for j in (-8, -5, 2, 6)]
    exact = []
    for i, j in places:
        column, row = (round(k * step / pixel) for k in (i, j))  # the map's own centres, in pixels
        centres = [(part + np.arange(-5, 6)) * pixel for part in (row, column)]
        y, x = (imager.axis(part + origin, masked=False) for part, origin in zip(centres, source[::-1], strict=True))
        exact.append(imager.image(y, x, source_arcsec=source).mean())
    i, j = np.array(places).T * step
    np.testing.assert_allclose(m.wing_at(i, j), exact, rtol=0.02)
    for x, y in ((-i, j), (i, -j), (-i, -j), (j, i)):
        assert np.sqrt(((m.wing_at(x, y) / exact - 1) ** 2).mean()) > 0.15


@pytest.mark.parametrize("band", ["F520", "F850"])
def test_apertures_around_a_source_are_those_of_images(metrics, band):
    """On the nodes of the map to its rounding, between them in sum; beyond it smooth wings."""
    m = metrics[band]
    imager = build_imager(INSTRUMENT, band, Knobs(wavelength_nodes=12))
    pixel, source = m.pixel_scale_arcsec, (6.0, 5.0)
    weights = overlap_weights(m.aperture_radius_arcsec / pixel)
    step, off = round(m.aperture_map_step_arcsec / pixel), np.arange(len(weights)) - len(weights) // 2

    def seen(column, row):
        y, x = (
            imager.axis((part + off) * pixel + origin, masked=False, pixel_nodes=1)
            for part, origin in zip((row, column), source[::-1], strict=True)
        )
        return float((imager.image(y, x, source_arcsec=source) * weights).sum())

    rng = np.random.default_rng(8)
    nodes = rng.integers(-60, 60, (40, 2)) * step
    exact = np.array([seen(*node) for node in nodes])
    np.testing.assert_allclose(m.source_aperture(*(nodes * pixel).T), exact, rtol=0.02)
    between = rng.uniform(-120.0, 120.0, (150, 2)) * step / 2
    exact = np.array([seen(*place) for place in between])
    found = m.source_aperture(*(between * pixel).T)
    assert found.sum() == pytest.approx(exact.sum(), rel=0.05)
    assert np.sqrt(np.mean(np.log(found / exact) ** 2)) < 0.5
    edge = m.aperture_map_half_arcsec
    assert 7.9 < edge <= 8.0
    far = np.array([edge + 0.01, 0.3]), np.array([-2.0, edge + 2.0])
    np.testing.assert_array_equal(m.source_aperture(*far), m.wing_at(*far) * m.aperture_pixels)


def test_wings_go_on_beyond_the_map_as_they_leave_it(metrics):
    """Boxes 18 to 24 arcsec from a source, on an arm and far from any: the map's edge tells them apart.

    Of a pupil of which nobody knows the steps.
    """
    m = dataclasses.replace(metrics["F520"], pupil_steps=0)
    imager = build_imager(INSTRUMENT, "F520", Knobs(wavelength_nodes=24))
    centres = 0.5 + np.arange(-4, 5) * m.pixel_scale_arcsec
    axis = imager.axis(centres, masked=False)
    off, ring_off = [], []
    for x, y in ((19.0, 0.0), (0.0, -23.0), (-19.0, 9.0), (8.0, 22.0), (14.0, 19.0)):
        exact = imager.image(axis, axis, source_arcsec=(0.5 - x, 0.5 - y)).mean()
        off.append(abs(np.log(m.wing_at(x, y) / exact)))
        ring_off.append(abs(np.log(m.wing(np.hypot(x, y)) / exact)))
    assert max(off) < np.log(4)
    assert np.mean(ring_off) > np.log(20)
    edge = (len(m.wing_map) // 2 - 0.5) * m.wing_map_step_arcsec
    np.testing.assert_allclose(m.wing_at(edge * (1 + 1e-9), 3.0), m.wing_at(edge, 3.0), rtol=1e-6)


@pytest.mark.parametrize("band", BANDS)
def test_light_of_a_stepped_pupil_repeats_beyond_the_map(metrics, band):
    """Mean light in the apertures of the hole of sources 20 arcsec away, beside the arms and between them, of images.

    The pattern of the map's edge had 0.1 to 9 times as much.
    """
    m, psf = metrics[band], single_band_psf(band, instrument=INSTRUMENT)
    pixel, middle = m.pixel_scale_arcsec, len(psf.on_axis) // 2
    weights = overlap_weights(m.aperture_radius_arcsec / pixel)
    x, y, _ = m.zone.cells(2 * pixel, m.aperture_radius_arcsec, pixel)
    row, column = (np.rint(part / pixel).astype(int) + middle for part in (y, x))
    for pa_deg in (10.0, 55.0, 100.0):
        from_x, from_y = -20.0 * np.sin(np.radians(pa_deg)), 20.0 * np.cos(np.radians(pa_deg))
        seen = aperture_sums(psf.at(from_x, from_y), weights)[row, column].mean()
        found = m.source_aperture(
            column * pixel - middle * pixel - from_x, row * pixel - middle * pixel - from_y
        ).mean()
        assert found == pytest.approx(seen, rel=0.15)


def test_core_is_zero_beyond_the_field_and_vectorised(metrics):
    m = metrics["F662"]
    assert m.core_throughput(30.0, 30.0) == 0
    assert m.core_throughput(5.0, 5.0) == pytest.approx(m.core_open)
    assert m.core_throughput(np.zeros((3, 1)), np.ones(4)).shape == (3, 4)


def test_halo_is_the_starlight_in_the_aperture(metrics):
    m = metrics["F662"]
    psf = single_band_psf("F662", instrument=INSTRUMENT)
    radius = m.aperture_radius_arcsec / m.pixel_scale_arcsec
    for column, row in ((90, 98), (100, 44), (47, 40)):
        x, y = (column - 68) * m.pixel_scale_arcsec, (row - 68) * m.pixel_scale_arcsec
        exact = aperture_photometry(psf.on_axis, CircularAperture((column, row), radius))["aperture_sum"][0]
        assert m.halo_aperture(x, y) == pytest.approx(exact, rel=2e-3)
        middle = m.halo_aperture(x + m.pixel_scale_arcsec / 2, y)
        assert min(m.halo_map[row, column : column + 2]) <= middle <= max(m.halo_map[row, column : column + 2])
    assert m.halo_aperture(4.0, 4.0) == pytest.approx(m.wing(np.hypot(4, 4)) * m.aperture_pixels)


def test_wings_hold_the_energy_outside_the_core(metrics):
    for m in metrics.values():
        last = len(m.wing_profile) - 1
        grid = np.arange(-last, last + 1)
        counts = np.bincount(np.rint(np.hypot(grid[:, None], grid)).astype(int).ravel())[: last + 1]
        assert m.wing_profile @ counts == pytest.approx(m.apodizer_energy, rel=0.005)  # 0.3 % falls beyond
        assert m.field_radius_arcsec > 17
        assert m.wing(40.0) == pytest.approx(m.wing(20.0) / 8)
        assert 0.1 < m.wing(m.field_radius_arcsec + 0.01) / m.wing_profile[-60:].mean() < 10


def test_floor_rises_with_drift(refused, metrics):
    for m in metrics.values():
        grid = np.geomspace(1e-4, 50, 200)
        floor = m.rdi_floor(grid)
        assert (np.diff(floor) > 0).all()
        assert m.rdi_floor(0.0) == 0
        assert m.rdi_floor(1e-6) == pytest.approx(m.rdi_floor(2e-6) / 2, rel=1e-6)
        assert m.rdi_floor(1e4) == pytest.approx(m.rdi_floor(2e4) / 4, rel=1e-6)
        assert 2e-10 < m.rdi_floor(0.05) / m.core_open < 8e-10
        # Drift is steep: worse near the inner corner than on average.
        assert m.rdi_floor(0.05, separation_arcsec=0.3) > m.rdi_floor(0.05) > m.rdi_floor(0.05, separation_arcsec=0.9)
        assert m.rdi_floor(0.03, walk_nm_per_sqrt_hour=0.04, visit_hours=3.0) == pytest.approx(m.rdi_floor(0.05))
    refused("visit_nm", m.rdi_floor, -1.0)


def test_arrays_there_and_back(refused, metrics):
    m = metrics["F720"]
    again = PsfMetrics.from_arrays(m.to_arrays())
    for name, array in m.to_arrays().items():
        np.testing.assert_array_equal(array, again.to_arrays()[name])
    refused("raw_contrast", PsfMetrics.from_arrays, {k: v for k, v in m.to_arrays().items() if k != "raw_contrast"})
