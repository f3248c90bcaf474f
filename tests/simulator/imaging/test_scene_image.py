""""""

import dataclasses
import tracemalloc

import numpy as np
import pytest

from simulator.config import ARCSEC_PER_RAD, load_instrument
from simulator.imaging import build_imager, centred_axis, pixel_axis
from simulator.imaging.build import bare_imager
from simulator.imaging.pupil import draw_aberrations
from simulator.imaging.scene_image import (
    BELL,
    BandTransfer,
    KernelTransfer,
    PointSources,
    SourceGrid,
    _bell_integral,
    _intensity,
    _odd_fast_length,
    paper_scene_image,
    scene_image,
)
from simulator.knobs import Knobs

NONE = PointSources([], [], [])


def lopsided(band="F520", jitter_arcsec=0.0, **knobs):
    """An imager whose PSF has no symmetry: coma, random screens, and a pupil dark on one side."""
    bare = bare_imager(load_instrument(), band, Knobs(**({"wavelength_nodes": 2} | knobs)))
    n = len(bare.transmission)
    u = (np.arange(n) + 0.5) / n * 2 - 1
    screens = draw_aberrations(5, samples=n).plus_opd(60 * (3 * u**2 - 2) * u + 25 * (u**2)[:, None] * u[:, None])
    amplitude = screens.amplitude * (1 - 0.4 * (u[:, None] > 0.2))
    static = dataclasses.replace(screens, amplitude=amplitude)
    return dataclasses.replace(bare, static=static, jitter_arcsec=jitter_arcsec)


def propagated(imager, y, x, sources, half_width=0.0):
    """Each source by its own propagation, eight nodes a pixel."""
    rows, columns = (
        pixel_axis(centres, imager.pixel_scale_arcsec, 8, half_width, imager.jitter_arcsec) for centres in (y, x)
    )
    return sum(
        flux * imager.image(rows, columns, source_arcsec=(x_source, y_source))
        for x_source, y_source, flux in zip(*sources.arrays, strict=True)
    )


def peak_of(imager):
    return float(imager.intensity(np.zeros(1), np.zeros(1))[0, 0])


IMAGER = lopsided()
TRANSFER = BandTransfer(IMAGER)
PIXEL = IMAGER.pixel_scale_arcsec
PEAK = peak_of(IMAGER)


@pytest.mark.parametrize("jitter", [0.0, 0.005])
@pytest.mark.parametrize(
    ("rows", "columns", "half_width"),
    [(31, 31, 0.0), (30, 44, 0.155), (17, 52, 0.1534), (21, 21, 0.005), (12, 9, 0.0167)],
)
def test_every_pixel_is_that_of_the_propagated_sources(rows, columns, half_width, jitter):
    imager = lopsided(jitter_arcsec=jitter)
    rng = np.random.default_rng(rows + columns)
    y = centred_axis(rows, PIXEL) + rng.uniform(-0.2, 0.2)
    x = centred_axis(columns, PIXEL) + rng.uniform(-0.2, 0.2)
    sources = PointSources(
        np.r_[0.0, half_width, rng.uniform(x[0], x[-1], 3), x[-1] + 0.5],
        np.r_[0.0, -half_width, rng.uniform(y[0], y[-1], 3), 0.1],
        rng.uniform(0.5, 2.0, 6),
    )
    ours = scene_image(BandTransfer(imager), y, x, PIXEL, sources, mask_half_width_arcsec=half_width)
    exact = propagated(imager, y, x, sources, half_width)
    assert np.abs(ours - exact).max() < 1e-10 * PEAK
    np.testing.assert_array_equal(ours == 0, exact == 0)  # closed pixels, and no others


def test_sources_all_over_a_frame_to_1e_6_of_their_own_peak_and_0_01_mas():
    imager = lopsided(wavelength_nodes=1)
    rng = np.random.default_rng(8)
    x, y = centred_axis(1080, PIXEL), centred_axis(1050, PIXEL)
    columns, rows = rng.uniform(10, 1069, 12), rng.uniform(10, 1039, 12)
    flux = 10 ** rng.uniform(-3, 3, 12)
    sources = PointSources(np.interp(columns, np.arange(1080), x), np.interp(rows, np.arange(1050), y), flux)
    image = scene_image(BandTransfer(imager), y, x, PIXEL, sources)
    for row, column, light in zip(rows.round().astype(int), columns.round().astype(int), flux, strict=True):
        box = slice(row - 4, row + 5), slice(column - 4, column + 5)
        exact = propagated(imager, y[box[0]], x[box[1]], sources)
        assert np.abs(image[box] - exact).max() < 1e-6 * light * peak_of(imager)
        weight_y, weight_x = (y[box[0]][:, None], x[box[1]])
        for axis in (weight_y, weight_x):
            ours, theirs = (float((part * axis).sum() / part.sum()) for part in (image[box], exact))
            assert abs(ours - theirs) < 1e-5  # arcsec: 0.01 mas


def test_the_star_with_its_dark_hole_passes_the_same_engine():
    imager = build_imager(load_instrument(), "F662")
    axis = imager.stamp_axis(masked=True)
    centres = centred_axis(axis.n_pixels, imager.pixel_scale_arcsec)
    star = scene_image(
        BandTransfer(imager),
        centres,
        centres,
        imager.pixel_scale_arcsec,
        PointSources([0.0], [0.0], [1.0]),
        mask_half_width_arcsec=imager.mask_half_width_arcsec,
    )
    exact = propagated(imager, centres, centres, PointSources([0.0], [0.0], [1.0]), imager.mask_half_width_arcsec)
    assert np.abs(star - exact).max() < 1e-12 * peak_of(imager)


def test_image_is_linear_in_flux_over_24_decades():
    rng = np.random.default_rng(1)
    axis = centred_axis(41, PIXEL)
    x, y = rng.uniform(-0.3, 0.3, (2, 6))
    flux = rng.uniform(1, 2, 6)
    image = scene_image(TRANSFER, axis, axis, PIXEL, PointSources(x, y, flux))
    for factor in (1e-12, 3.0, 1e12):
        scaled = scene_image(TRANSFER, axis, axis, PIXEL, PointSources(x, y, factor * flux))
        assert np.abs(scaled / factor - image).max() < 1e-13 * image.max()
    apart = [scene_image(TRANSFER, axis, axis, PIXEL, PointSources(x[i], y[i], flux[i])) for i in range(6)]
    assert np.abs(sum(apart) - image).max() < 1e-11 * image.max()


def test_a_neighbour_1e8_brighter_leaves_a_faint_source_alone():
    axis = centred_axis(61, PIXEL)
    bright, both = (
        scene_image(TRANSFER, axis, axis, PIXEL, PointSources([-0.3, 0.25], [0.0, 0.2], [1e8, faint]))
        for faint in (0.0, 1.0)
    )
    alone = scene_image(TRANSFER, axis, axis, PIXEL, PointSources([0.25], [0.2], [1.0]))
    assert np.abs(both - bright - alone).max() < 1e-4 * alone.max()


def test_light_is_neither_made_nor_lost():
    # The wings beyond a frame of +-8.8 arcsec hold less than a per cent of the light (and no pixel is negative).
    imager = lopsided(wavelength_nodes=1)
    axis = centred_axis(1081, PIXEL)
    image = scene_image(BandTransfer(imager), axis, axis, PIXEL, PointSources([0.01], [-0.02], [5.0]))
    step = imager.diameter_m / len(imager.transmission)
    passed = 5.0 * (np.abs(imager.pupil(0)) ** 2).sum() * step**2 / (np.pi / 4 * imager.diameter_m**2)
    assert 0.99 * passed < image.sum() < passed
    assert image.min() >= 0.0


def test_sources_far_outside_leave_their_true_wings():
    axis = centred_axis(33, PIXEL)
    for place in ((8.0, 1.0), (0.3, -30.0), (-250.0, 90.0)):
        sources = PointSources([place[0]], [place[1]], [1.0])
        ours = scene_image(TRANSFER, axis, axis, PIXEL, sources, mask_half_width_arcsec=0.155)
        exact = propagated(IMAGER, axis, axis, sources, 0.155)
        assert np.abs(ours - exact).max() < 1e-6 * exact.max()  # of the wing itself
    # Many places at once, tile by tile; and a place where no light arrives.
    sources = PointSources([8.0, -9.0, 0.1, 30.0], [1.0, 7.0, 0.2, 0.0], [1e4, 1e4, 1.0, 1e5])
    ours = scene_image(TRANSFER, axis, axis, PIXEL, sources)
    assert np.abs(ours - propagated(IMAGER, axis, axis, sources)).max() < 1e-12 * 1e5 * PEAK
    lost = scene_image(TRANSFER, axis, axis, PIXEL, PointSources([1e7], [0.0], [1.0]))
    assert 0 <= lost.max() < 1e-14 * PEAK


def test_empty_scenes_and_closed_windows_are_dark():
    axis = centred_axis(9, PIXEL)
    assert not scene_image(TRANSFER, axis, axis, PIXEL, NONE).any()
    assert not scene_image(TRANSFER, axis, axis, PIXEL, PointSources([0.0], [0.0], [0.0])).any()
    empty = SourceGrid([0.0, 0.1], [0.0], np.zeros((1, 2)))
    assert scene_image(TRANSFER, axis, axis, PIXEL, NONE, extended=[empty]).shape == (9, 9)
    one = PointSources([0.0], [0.0], [1.0])
    assert not scene_image(TRANSFER, axis, axis, PIXEL, one, mask_half_width_arcsec=0.155).any()
    assert scene_image(TRANSFER, axis[:1], axis[:1] + 0.5, PIXEL, one).shape == (1, 1)


def test_extended_source_is_the_sum_of_its_points():
    rng = np.random.default_rng(6)
    y, x = centred_axis(20, PIXEL), centred_axis(27, PIXEL) + 0.1
    grid_x, grid_y = np.sort(rng.uniform(-0.3, 0.4, 9)), rng.uniform(-0.3, 0.2, 5)
    flux = rng.random((5, 9))
    flux[:, 2] = 0.0
    grid = SourceGrid(grid_x, grid_y, flux)
    star = PointSources([0.05], [0.1], [3.0])
    points = PointSources(np.r_[0.05, np.tile(grid_x, 5)], np.r_[0.1, np.repeat(grid_y, 9)], np.r_[3.0, flux.ravel()])
    ours = scene_image(TRANSFER, y, x, PIXEL, star, mask_half_width_arcsec=0.1, extended=[grid])
    exact = scene_image(TRANSFER, y, x, PIXEL, points, mask_half_width_arcsec=0.1)
    assert np.abs(ours - exact).max() < 1e-13 * exact.max()
    beside = SourceGrid(grid_x + 12.0, grid_y, flux)  # its own tile
    both = scene_image(TRANSFER, y, x, PIXEL, NONE, extended=[grid, beside])
    apart = [scene_image(TRANSFER, y, x, PIXEL, NONE, extended=[one]) for one in (grid, beside)]
    assert np.abs(both - sum(apart)).max() < 1e-13 * both.max()


def test_a_dense_field_takes_few_passes_and_is_the_sum_of_its_stars(monkeypatch):
    transfer, passes = BandTransfer(lopsided(pupil_samples=64)), []
    made = BandTransfer.values
    monkeypatch.setattr(BandTransfer, "values", lambda *given: (passes.append(1), made(*given))[1])
    rng = np.random.default_rng(5)
    axis, n = centred_axis(61, PIXEL), 60
    x, y, flux = rng.uniform(-8.0, 8.0, n), rng.uniform(-8.0, 8.0, n), 10.0 ** rng.uniform(-3.0, 0.0, n)
    whole = scene_image(transfer, axis, axis, PIXEL, PointSources(x, y, flux), mask_half_width_arcsec=0.155)
    assert len(passes) <= 4  # of 25 tiles of 4 arcsec
    alone = [
        scene_image(transfer, axis, axis, PIXEL, PointSources(*star), mask_half_width_arcsec=0.155)
        for star in zip(x, y, flux, strict=True)
    ]
    assert len(passes) > n  # one for each star, and those of the field
    peak = scene_image(transfer, axis, axis, PIXEL, PointSources([0.0], [0.0], [flux.max()])).max()
    assert np.abs(whole - sum(alone)).max() < 3e-12 * peak
    passes.clear()
    scene_image(transfer, axis, axis, PIXEL, PointSources([0.4, 30.0], [0.3, 30.0], [1.0, 1.0]))
    assert len(passes) == 2  # two sources far apart are cheaper alone


def test_more_sources_than_a_chunk():
    rng = np.random.default_rng(7)
    axis = centred_axis(15, PIXEL)
    x, y = rng.uniform(-0.2, 0.2, (2, 1300))
    flux = rng.random(1300)
    whole = scene_image(TRANSFER, axis, axis, PIXEL, PointSources(x, y, flux))
    parts = [scene_image(TRANSFER, axis, axis, PIXEL, PointSources(x[i::3], y[i::3], flux[i::3])) for i in range(3)]
    assert np.abs(whole - sum(parts)).max() < 1e-12 * whole.max()


def kernel_of(imager, side):
    axis = imager.axis(centred_axis(side, imager.pixel_scale_arcsec), masked=False, pixel_nodes=8)
    return imager.image(axis, axis)


def test_a_kernel_at_pixel_centres_comes_back_and_between_them_is_the_optics():
    imager = lopsided("F850")
    kernel = kernel_of(imager, 201)
    transfer = KernelTransfer(kernel, PIXEL)
    axis = centred_axis(61, PIXEL)
    ours = scene_image(transfer, axis, axis, PIXEL, PointSources([3 * PIXEL], [-7 * PIXEL], [2.0]))
    np.testing.assert_allclose(ours, 2.0 * kernel[77:138, 67:128], atol=1e-14 * kernel.max())
    between = PointSources([0.0313, -0.2], [-0.1, 0.151], [1.0, 0.5])
    for half_width in (0.0, 0.155):
        ours = scene_image(transfer, axis, axis, PIXEL, between, mask_half_width_arcsec=half_width)
        exact = propagated(imager, axis, axis, between, half_width)
        assert np.abs(ours - exact).max() < 3e-6 * kernel.max()  # what the edge of the kernel rings
    far = scene_image(transfer, axis, axis, PIXEL, PointSources([9.0], [0.0], [1.0]))
    assert not far.any()
    inside = scene_image(transfer, axis, axis, PIXEL, PointSources([2.0], [0.0], [1.0]))
    assert inside.any()
    assert inside.min() >= 0


def resynthesised(transfer, y_arcsec, x_arcsec, y_axis, x_axis):
    """Intensity per steradian from all harmonics, by a plain sum."""
    values = transfer.values(y_axis, x_axis)
    ky = np.fft.fftfreq(y_axis.count) * y_axis.count / y_axis.period_arcsec
    rows = np.exp(2j * np.pi * np.outer(y_arcsec - y_axis.centre_arcsec, ky))
    columns = np.exp(2j * np.pi * np.outer(x_arcsec - x_axis.centre_arcsec, x_axis.frequencies))
    columns[:, 1:] *= 2
    area = y_axis.period_arcsec * x_axis.period_arcsec / ARCSEC_PER_RAD**2
    return (rows @ values @ columns.T).real / area


def test_harmonics_give_back_the_intensity_wherever_the_axes_promise_it():
    imager = lopsided()
    transfer = BandTransfer(imager)
    rng = np.random.default_rng(0)
    peak = imager.intensity(np.zeros(1), np.zeros(1)).max() / imager.pixel_solid_angle_sr
    for low, high in ((-1.0, 1.0), (-0.1, 3.0), (-0.01, 0.01), (7.0, 9.0), (-60.0, -59.0)):
        y_axis, x_axis = transfer.axis(low, high), transfer.axis(-0.4, 0.7)
        y = np.r_[low, rng.uniform(low, high, 30), high]
        x = np.r_[-0.4, rng.uniform(-0.4, 0.7, 30), 0.7]
        ours = resynthesised(transfer, y, x, y_axis, x_axis)
        exact = imager.intensity(y, x) / imager.pixel_solid_angle_sr
        assert np.abs(ours - exact).max() < 1e-11 * peak
        assert np.abs(ours - exact).max() < 1e-6 * exact.max()  # the window follows the level of the wings


def test_values_are_the_autocorrelation_of_the_pupil_not_its_mirror_image():
    imager = lopsided(wavelength_nodes=1)
    transfer = BandTransfer(imager)
    axis = transfer.axis(-9.0, 9.0)
    values = transfer.values(axis, axis)
    pupil = imager.pupil(0)
    n = len(pupil)
    padded = np.zeros((2 * n, 2 * n), dtype=complex)
    padded[:n, :n] = pupil
    spectrum = np.fft.fft2(padded)
    lags = np.fft.ifft2(np.abs(spectrum) ** 2) * (2.0 / n) ** 2 / np.pi  # sum of P(r + m) conj P(r)
    # The transform of |E|^2 at frequency k is the overlap of the pupil with itself shifted by -lambda k.
    sample = imager.wavelengths_m[0] * ARCSEC_PER_RAD / (2.0 / n)
    for row, column in ((0, 0), (3, 40), (60, 10), (-50, 90), (120, 200), (-200, 30)):
        shift = -np.array([row, column]) / axis.period_arcsec * sample
        corner = np.floor(shift).astype(int)
        part = shift - corner
        bilinear = sum(
            lags[(corner[0] + i) % (2 * n), (corner[1] + j) % (2 * n)]
            * (part[0] if i else 1 - part[0])
            * (part[1] if j else 1 - part[1])
            for i in (0, 1)
            for j in (0, 1)
        )
        assert values[row, column] == pytest.approx(bilinear, abs=5e-3 * lags[0, 0].real)
    assert np.abs(values[3, 40].imag) > 2e-2 * lags[0, 0].real  # where the mirror image would have the other sign


def test_fast_intensity_is_the_imagers():
    for knobs, tolerance in (({}, 1e-14), ({"precision": "single"}, 1e-6)):
        imager = lopsided(**knobs)
        transfer = BandTransfer(imager)
        for y, x in (((-0.5, 0.7), (2.0, 3.1)), ((-0.5, 0.7), (-0.3, 0.8)), ((-0.4, 0.4), (-0.4, 0.4))):
            rows, columns = transfer.axis(*y), transfer.axis(*x)
            places = [axis.centre_arcsec + axis.samples_arcsec for axis in (rows, columns)]
            exact = imager.intensity(*places) / imager.pixel_solid_angle_sr
            # Far out the phases themselves are known to their rounding.
            phase = np.pi * max(np.abs(place).max() for place in places) / imager.lambda_d_arcsec
            allowed = tolerance + 2 * np.finfo(float).eps * phase
            assert np.abs(_intensity(imager, rows, columns) - exact).max() < allowed * exact.max()


def test_jitter_is_a_gaussian_factor():
    still = lopsided()
    moving = dataclasses.replace(still, jitter_arcsec=0.012)
    axis = BandTransfer(moving).axis(-0.5, 0.5)
    ky = np.abs(np.fft.fftfreq(axis.count) * axis.count / axis.period_arcsec)
    factor = np.exp(-2 * np.pi**2 * 0.012**2 * (ky[:, None] ** 2 + axis.frequencies**2))
    np.testing.assert_allclose(
        BandTransfer(moving).values(axis, axis), BandTransfer(still).values(axis, axis) * factor, rtol=1e-12
    )
    assert axis.low_arcsec < -0.5 - 6 * 0.012  # room for what the jitter brings in


def test_window_is_one_where_it_must_be_and_gone_at_the_end_of_the_period():
    axis = BandTransfer(lopsided()).axis(-1.0, 2.0)
    samples, window = axis.samples_arcsec, axis.window
    assert axis.count % 2 == 1
    assert samples[0] == 0.0
    assert np.ptp(samples) < axis.period_arcsec
    assert (window[np.abs(samples) <= 1.5] == 1.0).all()
    assert window[np.abs(samples) > axis.period_arcsec / 2 * 0.98].max() < 1e-6
    order = np.argsort(np.abs(samples))
    assert (np.diff(window[order]) <= 1e-15).all()


def test_bell_integral_against_quadrature():
    from scipy.integrate import quad
    from scipy.special import i0

    def bell(t):
        return i0(BELL * np.sqrt(1 - t * t))

    whole = quad(bell, -1, 1, epsabs=0, epsrel=1e-12)[0]
    points = np.array([-1.3, -1.0, -0.99, -0.5, -0.1, 0.0, 0.3, 0.8, 1.0, 2.0])
    exact = [quad(bell, -1, min(max(u, -1), 1), epsabs=0, epsrel=1e-12)[0] / whole for u in points]
    np.testing.assert_allclose(_bell_integral(points), exact, rtol=1e-9, atol=1e-15)


def test_cutoff_and_lengths(refused):
    imager = lopsided()
    assert BandTransfer(imager).cutoff_per_arcsec == pytest.approx(
        2.0 / imager.wavelengths_m.min() * np.pi / 180 / 3600, rel=1e-12
    )
    assert [_odd_fast_length(value) for value in (1, 2, 12.2, 13, 101)] == [1, 3, 15, 15, 105]
    refused(r"scene = .* arcsec .*one by one", BandTransfer(imager).axis, -100.0, 100.0)


def test_kernel_transfer_is_the_fourier_sum_of_the_kernel_without_its_pixel():
    kernel = np.random.default_rng(2).random((7, 7))
    transfer = KernelTransfer(kernel, 0.02)
    y_axis, x_axis = transfer.axis(-0.3, 0.1), transfer.axis(-0.05, 0.05)
    values = transfer.values(y_axis, x_axis)
    offsets = (np.arange(7) - 3) * 0.02
    ky = np.fft.fftfreq(y_axis.count, 0.02)
    kx = x_axis.frequencies
    exact = np.exp(-2j * np.pi * np.outer(ky, offsets)) @ kernel @ np.exp(-2j * np.pi * np.outer(kx, offsets)).T
    exact /= np.sinc(ky * 0.02)[:, None] * np.sinc(kx * 0.02)
    np.testing.assert_allclose(values, exact, atol=1e-13 * kernel.sum())
    assert y_axis.count * 0.02 >= 0.3 + 3 * 0.02  # nothing folds
    assert kx.max() < transfer.cutoff_per_arcsec


def test_a_kernel_far_larger_than_memory_is_refused(refused):
    refused("scene", KernelTransfer(np.ones((3, 3)), 0.001).axis, -9.0, 9.0)


IMAGER_OF_PAPER_SCENE = dataclasses.replace(
    bare_imager(load_instrument(), "F520", Knobs(pupil_samples=64, wavelength_nodes=2)), jitter_arcsec=0.0
)
PIXEL_OF_PAPER_SCENE = IMAGER_OF_PAPER_SCENE.pixel_scale_arcsec
AXIS = centred_axis(41, PIXEL_OF_PAPER_SCENE)
CELL = PIXEL_OF_PAPER_SCENE / 4


def both(x, y, **options):
    sources = PointSources(x, y, np.ones(np.size(x)))
    paper = paper_scene_image(IMAGER_OF_PAPER_SCENE, AXIS, AXIS, sources, kernel_half_pixels=48, **options)
    return paper, scene_image(BandTransfer(IMAGER_OF_PAPER_SCENE), AXIS, AXIS, PIXEL_OF_PAPER_SCENE, sources)


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
    for place in rng.uniform(-0.5, 0.5, (12, 2)) * PIXEL_OF_PAPER_SCENE:
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
    axis = centred_axis(n, PIXEL_OF_PAPER_SCENE)
    sources = PointSources(
        rng.uniform(-8.0, 8.0, s) * PIXEL_OF_PAPER_SCENE,
        rng.uniform(-8.0, 8.0, s) * PIXEL_OF_PAPER_SCENE,
        rng.uniform(0, 1, s),
    )
    half = 4 * reach
    cells = pixel_axis(np.arange(-half, half + 1) * CELL, CELL, 2, 0.0, 0.0)
    kernel = IMAGER_OF_PAPER_SCENE.image(cells, cells) / 16
    expected = np.zeros((4 * n, 4 * n))
    for x, y, flux in zip(*sources.arrays, strict=True):
        column, row = (int(np.floor((place - axis[0] + PIXEL_OF_PAPER_SCENE / 2) / CELL)) for place in (x, y))
        for i in range(4 * n):
            for j in range(4 * n):
                if abs(i - row) <= half and abs(j - column) <= half:
                    expected[i, j] += flux * kernel[i - row + half, j - column + half]
    expected = expected.reshape(n, 4, n, 4).sum(axis=(1, 3))
    found = paper_scene_image(IMAGER_OF_PAPER_SCENE, axis, axis, sources, kernel_half_pixels=reach)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-15 * expected.max())


def test_a_whole_frame_takes_little_memory():
    rows, columns = centred_axis(1050, PIXEL_OF_PAPER_SCENE), centred_axis(1080, PIXEL_OF_PAPER_SCENE)
    tracemalloc.start()
    image = paper_scene_image(IMAGER_OF_PAPER_SCENE, rows, columns, PointSources([0.4, 8.0], [0.5, -7.0], [1.0, 2.0]))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert image.shape == (1050, 1080)
    assert peak < 1e8


def test_a_source_behind_the_mask_keeps_all_its_light():
    place = PointSources([0.5 * CELL], [16.5 * CELL], [1.0])
    paper = paper_scene_image(IMAGER_OF_PAPER_SCENE, AXIS, AXIS, place, kernel_half_pixels=48)
    masked = scene_image(
        BandTransfer(IMAGER_OF_PAPER_SCENE), AXIS, AXIS, PIXEL_OF_PAPER_SCENE, place, mask_half_width_arcsec=0.155
    )
    assert masked[14:28, 14:28].sum() == 0.0
    assert paper.sum() > 20 * masked.sum()


def test_light_is_conserved_and_places_beyond_the_kernel_are_left_out():
    inside = paper_scene_image(
        IMAGER_OF_PAPER_SCENE, AXIS, AXIS, PointSources([0.1], [0.0], [1.0]), kernel_half_pixels=48
    )
    assert 0.9 * IMAGER_OF_PAPER_SCENE.apodizer_energy < inside.sum() < IMAGER_OF_PAPER_SCENE.apodizer_energy
    beside = paper_scene_image(
        IMAGER_OF_PAPER_SCENE, AXIS, AXIS, PointSources([0.6], [0.0], [1.0]), kernel_half_pixels=48
    )
    assert 0 < beside.sum() < inside.sum()
    beyond = PointSources([-2.0, 50.0], [0.0, 0.0], [1.0, 1.0])
    assert not paper_scene_image(IMAGER_OF_PAPER_SCENE, AXIS, AXIS, beyond, kernel_half_pixels=48).any()
    rectangle = paper_scene_image(
        IMAGER_OF_PAPER_SCENE, AXIS[:10], AXIS, PointSources([], [], []), kernel_half_pixels=4
    )
    assert rectangle.shape == (10, 41)
    assert not rectangle.any()
