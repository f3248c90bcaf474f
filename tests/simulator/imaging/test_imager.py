import dataclasses

import numpy as np
import pytest
from scipy.special import j1

from simulator.config import ARCSEC_PER_RAD, load_instrument
from simulator.imaging import build_imager, centred_axis
from simulator.imaging.drift import screen_model
from simulator.imaging.pupil import draw_aberrations
from simulator.knobs import Knobs

INSTRUMENT = load_instrument()
FLAT = load_instrument(
    {"wavefront": {"opd_rms_nm": 0, "amplitude_rms": 0, "jitter_mas": 0}, "dark_hole": {"control": "off"}}
)
ZERO = np.zeros(1)


def mono(samples=64, instrument=FLAT, band="F662", **changes):
    imager = build_imager(instrument, band, Knobs(pupil_samples=samples, wavelength_nodes=1))
    return dataclasses.replace(imager, **changes)


@pytest.fixture(scope="module")
def aberrated():
    """One wavelength of the default instrument, mirror and all, without jitter: 8 nodes a pixel."""
    imager = build_imager(INSTRUMENT, "F662", Knobs(wavelength_nodes=1, pixel_nodes=8, stamp_pixels=65))
    return dataclasses.replace(imager, jitter_arcsec=0.0)


@pytest.mark.parametrize("engine", ["hcipy", "matrix"])
@pytest.mark.parametrize("samples", [64, 128, 256])
def test_field_of_a_step_mask_is_the_analytic_sum_of_sincs(engine, samples):
    imager = mono(samples)
    assert len(imager.transmission) == samples
    steps = mono(64).transmission
    angles = np.array([0.0, 0.0234, 0.31, 0.7, 2.9, 9.7])  # to 140 lambda/D: beyond every sampling replica
    wavelength = imager.wavelengths_m[0]
    u = angles / ARCSEC_PER_RAD / wavelength * 2.0
    centre = (np.arange(64) - 31.5) / 64
    exact = np.empty((angles.size,) * 2)
    for i in range(angles.size):
        for j in range(angles.size):
            cosines = np.cos(2 * np.pi * u[i] * centre)[:, None] * np.cos(2 * np.pi * u[j] * centre)
            exact[i, j] = (steps * cosines).sum() * np.sinc(u[i] / 64) * np.sinc(u[j] / 64)
    exact *= (2.0 / 64) ** 2 / wavelength / np.sqrt(np.pi)  # area of a step; the clear disc has unit energy
    field = np.abs(imager.field(0, angles, angles, engine=engine))
    assert np.abs(field - np.abs(exact)).max() < 1e-13 * exact[0, 0]


@pytest.mark.parametrize("band", ["F520", "F850"])
def test_hcipy_and_matrix_products_agree_on_aberrations_mirror_and_screen(band):
    imager = build_imager(INSTRUMENT, band)
    assert imager.static.opd_nm.std() > 15
    rng = np.random.default_rng(3)
    screen = screen_model(128, 2.5).draw(rng, 20.0)
    y, x = np.sort(rng.uniform(-1, 1, 40)), np.sort(rng.uniform(-9, 9, 50))
    for opd in (None, screen):
        ours = imager.intensity(y, x, opd_nm=opd, engine="matrix")
        theirs = imager.intensity(y, x, opd_nm=opd, engine="hcipy")
        peak = imager.intensity(ZERO, ZERO, opd_nm=opd)[0, 0]
        assert np.abs(ours - theirs).max() < 1e-12 * peak
    assert ours.shape == (40, 50)


def gray_disc(n):
    """Exact share of every sample that the disc covers: chords, integrated by 40 Gauss-Legendre nodes a sample."""
    nodes, weights = np.polynomial.legendre.leggauss(40)
    edge = np.arange(n) / n - 0.5
    chord = np.sqrt(np.clip(0.25 - (edge[:, None] + (nodes + 1) / 2 / n) ** 2, 0, None))
    low = edge[:, None, None]
    return np.clip(np.minimum(low + 1 / n, chord) - np.maximum(low, -chord), 0, None) @ (weights / 2) * n


def test_clear_disc_gives_the_airy_pattern():
    imager = mono(64, transmission=gray_disc(512))
    wavelength = imager.wavelengths_m[0]

    def angles(u):
        return u * wavelength / 2.0 * ARCSEC_PER_RAD

    peak = imager.field(0, ZERO, ZERO)[0, 0].real
    u = np.linspace(0, 14.14, 203)
    radius = np.hypot(u[:, None], u) + 1e-12
    field = imager.field(0, angles(u), angles(u)) / peak
    assert np.abs(field - 2 * j1(np.pi * radius) / (np.pi * radius)).max() < 2e-5
    u = np.linspace(14.14, 20, 101)
    assert np.abs(imager.field(0, ZERO, angles(u))[0] / peak - 2 * j1(np.pi * u) / (np.pi * u)).max() < 2e-5
    u = np.linspace(1.20, 1.24, 401)
    assert u[imager.intensity(ZERO, angles(u))[0].argmin()] == pytest.approx(1.2197, abs=1e-3)
    # (area / wavelength)^2 over the unit energy of the disc.
    assert peak**2 == pytest.approx(np.pi / wavelength**2, rel=1e-6)


def test_parseval_over_the_whole_plane(aberrated):
    """Half-lambda/D samples integrate the band-limited intensity exactly; sinc^2 over all replicas sums to one."""
    n, wavelength = 128, aberrated.wavelengths_m[0]
    u = np.arange(-n, n) / 2
    angles = u * wavelength / 2.0 * ARCSEC_PER_RAD
    light = aberrated.intensity(angles, angles) / aberrated.pixel_solid_angle_sr
    envelope = np.sinc(u / n) ** 2
    whole = (light / envelope[:, None] / envelope).sum() * (wavelength / 4.0) ** 2
    pupil = aberrated.pupil(0)
    energy = (np.abs(pupil) ** 2).sum() * (2 / n) ** 2 / np.pi
    assert whole == pytest.approx(energy, rel=1e-12)
    # The same samples by FFT.
    spectrum = np.fft.fftshift(np.fft.fft2(pupil, s=(2 * n, 2 * n)))
    by_fft = np.abs(spectrum * np.sinc(u / n)[:, None] * np.sinc(u / n)) ** 2 * (2 / n) ** 4 / wavelength**2 / np.pi
    assert np.abs(by_fft - light).max() < 1e-12 * light.max()
    # The next replica carries the envelope's share: the analytic sum above holds over the plane.
    far = aberrated.intensity(angles[90:95], angles[90:95] + n * wavelength / 2.0 * ARCSEC_PER_RAD)
    share = np.sinc(u[90:95] / n + 1) ** 2 / np.sinc(u[90:95] / n) ** 2
    np.testing.assert_allclose(far, light[90:95, 90:95] * share * aberrated.pixel_solid_angle_sr, rtol=1e-8)
    # Phase, mirror included, moves light and loses none; amplitude errors of 0.3 % change E by less than twice that.
    transmitted = (aberrated.transmission * aberrated.static.amplitude) ** 2
    assert energy == pytest.approx(transmitted.sum() * (2 / n) ** 2 / np.pi, rel=1e-12)
    assert energy == pytest.approx(aberrated.apodizer_energy, rel=2 * 0.003)


def kernel(imager, parts):
    """Energy of the pupil samples' waves on intervals of one axis, arcsec: integrated before the pupil is known."""
    n, wavelength = len(imager.transmission), imager.wavelengths_m[0]
    nodes, weights = np.polynomial.legendre.leggauss(300)
    step = 2.0 / n
    position = (np.arange(n) - (n - 1) / 2) * step
    total = np.zeros((n, n), dtype=complex)
    for low, high in parts:
        u = (0.5 * (low + high) + 0.5 * (high - low) * nodes) / ARCSEC_PER_RAD / wavelength
        scale = 0.5 * (high - low) / ARCSEC_PER_RAD * weights * (step * np.sinc(u * step)) ** 2 / wavelength
        waves = np.exp(-2j * np.pi * np.outer(u, position))
        total += waves.conj().T @ (scale[:, None] * waves)
    return total / np.sqrt(np.pi)


def test_energy_through_the_mask_and_blocked_is_the_total(aberrated):
    imager = aberrated
    clear, masked = (imager.stamp_axis(masked=flag) for flag in (False, True))
    half, bar = 32.5 * imager.pixel_scale_arcsec, imager.mask_half_width_arcsec
    everything = kernel(imager, [(-half, half)])
    behind, open_part = kernel(imager, [(-bar, bar)]), kernel(imager, [(-half, -bar), (bar, half)])
    pupil = imager.pupil(0)

    def energy(rows, columns):
        return float((pupil.conj() * (rows @ pupil @ columns.T)).sum().real)

    total, through = imager.image(clear, clear).sum(), imager.image(masked, masked).sum()
    blocked = energy(behind, everything) + energy(open_part, behind)
    assert total == pytest.approx(energy(everything, everything), rel=1e-10)
    assert through == pytest.approx(energy(open_part, open_part), rel=1e-10)
    assert abs(through + blocked - total) < 1e-10 * total


def test_wider_fields_hold_more_of_the_energy():
    imager = mono(64)
    axes = [
        imager.axis(centred_axis(2 * half + 1, imager.pixel_scale_arcsec), masked=False, pixel_nodes=1)
        for half in (60, 250, 600)
    ]
    missing = [1 - imager.image(axis, axis).sum() / imager.apodizer_energy for axis in axes]
    assert missing[0] > missing[1] > missing[2] > 0
    assert missing[2] < 6e-3  # +-9.7 arcsec


def test_screens_conserve_energy_and_shift_with_tilt():
    imager = mono(128)
    position = (np.arange(128) - 63.5) / 128 * 2.0
    tilt_nm = 0.05 / ARCSEC_PER_RAD * position[None, :] * np.ones((128, 1)) * 1e9
    axis = imager.stamp_axis(masked=False)
    moved = imager.image(axis, axis, opd_nm=tilt_nm)
    exact = imager.image(axis, axis, source_arcsec=(0.05, 0.0))
    # A positive wavefront slope moves the image to +x; piecewise-constant tilt is a staircase, hence not exact.
    assert np.abs(moved - exact).max() < 1e-3 * exact.max()
    assert moved.sum() == pytest.approx(exact.sum(), rel=1e-3)


def test_a_screen_adds_to_the_static_wavefront():
    imager = mono(128, INSTRUMENT)
    screen = draw_aberrations(5, samples=128).opd_nm
    both = dataclasses.replace(imager, static=imager.static.plus_opd(screen))
    np.testing.assert_allclose(imager.pupil(0, screen), both.pupil(0), rtol=1e-12)
    wavelength_nm = imager.wavelengths_m[0] * 1e9
    by_hand = imager.transmission * imager.static.amplitude
    by_hand = by_hand * np.exp(2j * np.pi * (imager.static.opd_nm + screen) / wavelength_nm)
    np.testing.assert_allclose(imager.pupil(0, screen), by_hand, rtol=1e-12)
    assert mono(64).pupil(0).dtype == np.float64  # flat optics stay real, and fast


@pytest.mark.parametrize(
    ("position", "tolerances"),
    # nodes: error relative to the peak of the unmasked image; pixels cut by the cross included
    [((0.0, 0.0), {3: 5e-9, 4: 2e-11, 5: 5e-13}), ((0.17, 0.16), {3: 1e-5, 4: 1e-7, 5: 1e-9})],
)
def test_jitter_is_the_incoherent_sum_over_pointings(position, tolerances):
    knobs = Knobs(wavelength_nodes=1, stamp_pixels=33, pixel_nodes=8)
    jittered = build_imager(INSTRUMENT, "F520", knobs)
    assert jittered.jitter_arcsec == 0.005
    still = dataclasses.replace(jittered, jitter_arcsec=0.0)
    axis = still.stamp_axis(masked=True)
    offsets, weights = np.polynomial.hermite_e.hermegauss(15)
    weights = weights / weights.sum()
    total = np.zeros((33, 33))
    for dy, share_y in zip(0.005 * offsets, weights, strict=True):
        for dx, share_x in zip(0.005 * offsets, weights, strict=True):
            if share_x * share_y > 1e-14:
                total += share_x * share_y * still.image(axis, axis, source_arcsec=(position[0] + dx, position[1] + dy))
    cut = (axis.open_fraction > 0) & (axis.open_fraction < 1 - 1e-9)
    assert cut.sum() == 2
    assert total[cut].max() > 0.05 * total.max()
    clear = jittered.stamp_axis(masked=False)
    peak = jittered.image(clear, clear).max()
    for nodes, tolerance in tolerances.items():
        imager = build_imager(INSTRUMENT, "F520", knobs.model_copy(update={"pixel_nodes": nodes}))
        axis = imager.stamp_axis(masked=True)
        assert np.abs(imager.image(axis, axis, source_arcsec=position) - total).max() < tolerance * peak


def test_focal_grid_gives_the_images_of_the_imager():
    imager = build_imager(INSTRUMENT, "F720", Knobs(wavelength_nodes=2, stamp_pixels=33))
    y, x = imager.axis(centred_axis(20, 0.0161), masked=True), imager.axis(centred_axis(31, 0.0161), masked=True)
    screen = draw_aberrations(7, samples=128).opd_nm
    grid = imager.focal_grid(y, x, source_arcsec=(0.1, -0.2))
    image = imager.image(y, x, source_arcsec=(0.1, -0.2), opd_nm=screen)
    np.testing.assert_array_equal(grid.image(screen), image)
    assert image.shape == (20, 31)
    assert not np.array_equal(grid.image(), image)
    points = imager._grid(np.zeros(1), np.zeros(1))
    with pytest.raises(ValueError, match="no pixels"):
        points.image()
