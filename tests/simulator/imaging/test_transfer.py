import dataclasses

import numpy as np
import pytest

from simulator.config import ARCSEC_PER_RAD, load_instrument
from simulator.imaging.build import bare_imager
from simulator.imaging.pupil import draw_aberrations
from simulator.imaging.scene_image import (
    BELL,
    BandTransfer,
    KernelTransfer,
    _bell_integral,
    _intensity,
    _odd_fast_length,
)
from simulator.knobs import Knobs


def lopsided(band="F520", **knobs):
    """An imager whose PSF has no symmetry: coma, random screens, and a pupil dark on one side."""
    bare = bare_imager(load_instrument(), band, Knobs(**({"wavelength_nodes": 2} | knobs)))
    n = len(bare.transmission)
    u = (np.arange(n) + 0.5) / n * 2 - 1
    screens = draw_aberrations(5, samples=n).plus_opd(60 * (3 * u**2 - 2) * u + 25 * (u**2)[:, None] * u[:, None])
    amplitude = screens.amplitude * (1 - 0.4 * (u[:, None] > 0.2))
    return dataclasses.replace(bare, static=dataclasses.replace(screens, amplitude=amplitude), jitter_arcsec=0.0)


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


@pytest.mark.parametrize(
    ("kernel", "scale", "named"),
    [
        (np.ones((4, 4)), 0.02, "kernel = shape"),
        (np.ones((3, 5)), 0.02, "kernel = shape"),
        (np.full((3, 3), np.nan), 0.02, "9 bad pixels"),
        (-np.eye(3), 0.02, "3 bad pixels"),
        (np.ones((3, 3)), 0.0, "pixel_scale_arcsec"),
        (np.ones((3, 3)), np.nan, "pixel_scale_arcsec"),
    ],
)
def test_unusable_kernels_are_refused_by_name(refused, kernel, scale, named):
    refused(named, KernelTransfer, kernel, scale)


def test_a_kernel_far_larger_than_memory_is_refused(refused):
    refused("scene", KernelTransfer(np.ones((3, 3)), 0.001).axis, -9.0, 9.0)
