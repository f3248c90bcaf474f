import dataclasses

import numpy as np
import pytest

from catalogs.errors import InputError
from simulator.config import load_instrument
from simulator.config.instrument import ARCSEC_PER_RAD
from simulator.imaging.imager import build_imager, centred_axis
from simulator.imaging.quadrature import integrate_pixels, pixel_axis
from simulator.knobs import Knobs

INSTRUMENT = load_instrument()


def mono(samples=64, **changes):
    imager = build_imager(INSTRUMENT, "F662", Knobs(pupil_samples=samples, wavelength_nodes=1))
    return dataclasses.replace(imager, **changes)


@pytest.mark.parametrize("engine", ["hcipy", "matrix"])
@pytest.mark.parametrize("samples", [64, 128, 256])
def test_field_of_a_step_mask_is_the_analytic_sum_of_sincs(engine, samples):
    imager = mono(samples)
    steps = mono(64).transmission
    angles = np.array([0.0, 0.0234, 0.31, 0.7, 2.9, 9.7])  # to 140 lambda/D: beyond every sampling replica
    u = angles / ARCSEC_PER_RAD / imager.wavelengths_m[0] * 2.0
    centre = (np.arange(64) - 31.5) / 64
    exact = np.empty((angles.size,) * 2)
    for i in range(angles.size):
        for j in range(angles.size):
            cosines = np.cos(2 * np.pi * u[i] * centre)[:, None] * np.cos(2 * np.pi * u[j] * centre)
            exact[i, j] = (steps * cosines).sum() * np.sinc(u[i] / 64) * np.sinc(u[j] / 64)
    field = np.abs(imager.field(0, angles, angles, engine=engine))
    scale = field[0, 0] / exact[0, 0]
    assert np.abs(field - np.abs(exact) * scale).max() / field[0, 0] < 1e-13


def test_hcipy_and_matrix_products_agree_with_phase_screens():
    imager = mono(128)
    rng = np.random.default_rng(3)
    opd = rng.normal(0, 20e-9, (128, 128))
    y, x = rng.uniform(-1, 1, 40), rng.uniform(-9, 9, 50)
    ours = imager.intensity(np.sort(y), np.sort(x), opd_m=opd, engine="matrix")
    theirs = imager.intensity(np.sort(y), np.sort(x), opd_m=opd, engine="hcipy")
    peak = imager.intensity(np.zeros(1), np.zeros(1), engine="matrix")[0, 0]
    assert np.abs(ours - theirs).max() < 1e-12 * peak
    assert ours.shape == (40, 50)


def test_clear_disc_gives_the_airy_pattern():
    from scipy.special import j1

    n = 512
    position = (np.arange(n * 4) - n * 2 + 0.5) / (4 * n)
    gray = (np.hypot(position[:, None], position) <= 0.5).astype(float).reshape(n, 4, n, 4).mean(axis=(1, 3))
    imager = mono(512, transmission=gray)
    wavelength = imager.wavelengths_m[0]
    u = np.concatenate([np.linspace(1.20, 1.24, 401), np.linspace(0.05, 5, 100)])
    image = imager.intensity(np.zeros(1), u * wavelength / 2.0 * ARCSEC_PER_RAD, engine="matrix")[0]
    peak = imager.intensity(np.zeros(1), np.zeros(1), engine="matrix")[0, 0]
    assert u[np.argmin(image[:401])] == pytest.approx(1.2197, abs=1e-3)
    np.testing.assert_allclose(image / peak, (2 * j1(np.pi * u) / (np.pi * u)) ** 2, atol=5e-5)
    # On-axis intensity of the clear disc: area / wavelength^2 per steradian.
    pixel_sr = (imager.pixel_scale_arcsec / ARCSEC_PER_RAD) ** 2
    assert peak == pytest.approx(np.pi / wavelength**2 * pixel_sr, rel=1e-4)  # area of the gray disc


def test_energy_over_the_focal_plane_is_the_energy_behind_the_apodizer():
    imager = mono(64)
    # Ever wider fields: what is missing falls off, and the whole approaches E.
    missing = []
    for half in (60, 250, 1000):
        axis = imager.axis(centred_axis(2 * half + 1, imager.pixel_scale_arcsec), masked=False)
        missing.append(1 - imager.image(axis, axis, engine="matrix").sum() / imager.apodizer_energy)
    assert missing[0] > missing[1] > missing[2] > 0
    assert missing[2] < 3e-3  # +-16 arcsec = 237 lambda/D


def test_screens_conserve_energy_and_shift_with_tilt():
    imager = mono(128)
    position = (np.arange(128) - 63.5) / 128 * 2.0
    tilt = 0.05 / ARCSEC_PER_RAD * position[None, :] * np.ones((128, 1))
    axis = imager.stamp_axis(masked=False)
    moved = imager.image(axis, axis, opd_m=tilt)
    exact = imager.image(axis, axis, source_arcsec=(0.05, 0.0))
    # A positive wavefront slope moves the image to +x; piecewise-constant tilt is a staircase, hence not exact.
    assert np.abs(moved - exact).max() < 1e-3 * exact.max()
    assert moved.sum() == pytest.approx(exact.sum(), rel=1e-3)


def test_pixel_axis_covers_the_open_part_of_every_pixel():
    centres = centred_axis(41, 1.0)
    for half_width in (0.0, 0.2, 0.5, 3.3, 9.6, 30.0):
        axis = pixel_axis(centres, 1.0, 3, half_width)
        open_part = np.zeros(41)
        open_part[axis.pixels] = np.add.reduceat(axis.weights, axis.starts) if axis.pixels.size else 0
        low, high = np.abs(centres) - 0.5, np.abs(centres) + 0.5
        expected = np.where(
            low < 0, np.clip(1 - 2 * half_width, 0, 1), np.clip(high - np.maximum(low, half_width), 0, 1)
        )
        np.testing.assert_allclose(open_part, expected, atol=1e-12)
        assert half_width == 0 or (np.abs(axis.nodes_arcsec) > half_width).all()


def test_pixel_integration_is_exact_for_polynomials_and_shapes():
    centres = centred_axis(5, 0.5, 1.0)
    axis = pixel_axis(centres, 0.5, 2)
    values = np.stack([np.add.outer(axis.nodes_arcsec**3, axis.nodes_arcsec**2)] * 2)
    image = integrate_pixels(values, axis, axis)
    low, high = centres - 0.25, centres + 0.25
    cubic, square = (high**4 - low**4) / 4 / 0.5, (high**3 - low**3) / 3 / 0.5
    np.testing.assert_allclose(image, np.stack([np.add.outer(cubic, square)] * 2), rtol=1e-13)
    closed = pixel_axis(centres, 0.5, 2, 10.0)
    assert not integrate_pixels(np.zeros((0, axis.nodes_arcsec.size)), closed, axis).any()


def test_unknown_band_is_refused():
    with pytest.raises(InputError, match="band"):
        build_imager(INSTRUMENT, "F999")
    with pytest.raises(InputError, match="fidelity"):
        build_imager(INSTRUMENT, "F662", "best")
