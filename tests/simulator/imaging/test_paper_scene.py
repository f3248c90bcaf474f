import dataclasses
import tracemalloc

import numpy as np
import pytest

from simulator.config import load_instrument
from simulator.imaging import centred_axis, pixel_axis
from simulator.imaging.build import bare_imager
from simulator.imaging.scene_image import BandTransfer, PointSources, paper_scene_image, scene_image
from simulator.knobs import Knobs

IMAGER = dataclasses.replace(
    bare_imager(load_instrument(), "F520", Knobs(pupil_samples=64, wavelength_nodes=2)), jitter_arcsec=0.0
)
PIXEL = IMAGER.pixel_scale_arcsec
AXIS = centred_axis(41, PIXEL)
CELL = PIXEL / 4


def both(x, y, **options):
    sources = PointSources(x, y, np.ones(np.size(x)))
    paper = paper_scene_image(IMAGER, AXIS, AXIS, sources, kernel_half_pixels=48, **options)
    return paper, scene_image(BandTransfer(IMAGER), AXIS, AXIS, PIXEL, sources)


def test_a_source_on_the_centre_of_a_cell_is_right():
    paper, exact = both([0.5 * CELL], [1.5 * CELL])
    assert np.abs(paper - exact).max() < 2e-6 * exact.max()


def test_a_source_between_cells_is_misplaced_by_up_to_five_per_cent_of_its_peak():
    # A pixel's centre is the corner of four cells: the worst place of all.
    corner, exact = both([0.0], [0.0])
    worst = np.abs(corner - exact).max() / exact.max()
    assert 0.03 < worst < 0.06
    shift = [float((image * AXIS).sum() / image.sum()) for image in (corner, exact)]
    assert shift[0] - shift[1] == pytest.approx(CELL / 2, rel=0.15)  # 2 mas along each axis
    rng = np.random.default_rng(3)
    errors = []
    for place in rng.uniform(-0.5, 0.5, (12, 2)) * PIXEL:
        paper, exact = both([place[0]], [place[1]])
        errors.append(np.abs(paper - exact).max() / exact.max())
    assert max(errors) <= worst * 1.05
    assert np.mean(errors) > 0.01


def test_error_is_linear_in_the_distance_from_the_cell():
    errors = []
    for part in (0.1, 0.2, 0.4):
        paper, exact = both([(0.5 + part) * CELL], [0.5 * CELL])
        errors.append(np.abs(paper - exact).max() / exact.max())
    assert errors[1] / errors[0] == pytest.approx(2.0, rel=0.05)
    assert errors[2] / errors[0] == pytest.approx(4.0, rel=0.05)


def test_it_is_the_convolution_of_the_cells():
    rng = np.random.default_rng(7)
    n, reach, s = 9, 3, 12
    axis = centred_axis(n, PIXEL)
    sources = PointSources(rng.uniform(-8.0, 8.0, s) * PIXEL, rng.uniform(-8.0, 8.0, s) * PIXEL, rng.uniform(0, 1, s))
    half = 4 * reach
    cells = pixel_axis(np.arange(-half, half + 1) * CELL, CELL, 2, 0.0, 0.0)
    kernel = IMAGER.image(cells, cells) / 16
    expected = np.zeros((4 * n, 4 * n))
    for x, y, flux in zip(*sources.arrays, strict=True):
        column, row = (int(np.floor((place - axis[0] + PIXEL / 2) / CELL)) for place in (x, y))
        for i in range(4 * n):
            for j in range(4 * n):
                if abs(i - row) <= half and abs(j - column) <= half:
                    expected[i, j] += flux * kernel[i - row + half, j - column + half]
    expected = expected.reshape(n, 4, n, 4).sum(axis=(1, 3))
    found = paper_scene_image(IMAGER, axis, axis, sources, kernel_half_pixels=reach)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-15 * expected.max())


def test_a_whole_frame_takes_little_memory():
    rows, columns = centred_axis(1050, PIXEL), centred_axis(1080, PIXEL)
    tracemalloc.start()
    image = paper_scene_image(IMAGER, rows, columns, PointSources([0.4, 8.0], [0.5, -7.0], [1.0, 2.0]))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert image.shape == (1050, 1080)
    assert peak < 1e8


def test_a_source_behind_the_mask_keeps_all_its_light():
    place = PointSources([0.5 * CELL], [16.5 * CELL], [1.0])
    paper = paper_scene_image(IMAGER, AXIS, AXIS, place, kernel_half_pixels=48)
    masked = scene_image(BandTransfer(IMAGER), AXIS, AXIS, PIXEL, place, mask_half_width_arcsec=0.155)
    assert masked[14:28, 14:28].sum() == 0.0
    assert paper.sum() > 20 * masked.sum()


def test_light_is_conserved_and_places_beyond_the_kernel_are_left_out():
    inside = paper_scene_image(IMAGER, AXIS, AXIS, PointSources([0.1], [0.0], [1.0]), kernel_half_pixels=48)
    assert 0.9 * IMAGER.apodizer_energy < inside.sum() < IMAGER.apodizer_energy
    beside = paper_scene_image(IMAGER, AXIS, AXIS, PointSources([0.6], [0.0], [1.0]), kernel_half_pixels=48)
    assert 0 < beside.sum() < inside.sum()
    beyond = PointSources([-2.0, 50.0], [0.0, 0.0], [1.0, 1.0])
    assert not paper_scene_image(IMAGER, AXIS, AXIS, beyond, kernel_half_pixels=48).any()
    rectangle = paper_scene_image(IMAGER, AXIS[:10], AXIS, PointSources([], [], []), kernel_half_pixels=4)
    assert rectangle.shape == (10, 41)
    assert not rectangle.any()


def test_what_it_cannot_do_is_refused_by_name(refused):
    one = PointSources([0.0], [0.0], [1.0])
    refused("y_centres_arcsec", paper_scene_image, IMAGER, AXIS * 2, AXIS, one)
    refused("kernel_half_pixels", paper_scene_image, IMAGER, AXIS, AXIS, one, kernel_half_pixels=0)
