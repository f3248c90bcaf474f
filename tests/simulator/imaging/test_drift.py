import numpy as np
import pytest

from simulator.config import Drift, load_instrument
from simulator.imaging import FocalGrid, build_imager, single_band_psf, visit_frames
from simulator.imaging.drift import iter_visit_frames, screen_model
from simulator.knobs import Knobs

INSTRUMENT = load_instrument()


def drift(visit=0.05, walk=0.0):
    return Drift(visit_nm=visit, walk_nm_per_sqrt_hour=walk, psd_slope=2.5)


def rngs(*path):
    return np.random.default_rng([*path, 1]), np.random.default_rng([*path, 2])


def disc(n):
    position = (np.arange(n) + 0.5) / n - 0.5
    return np.hypot(position[:, None], position) <= 0.5, position


def test_screens_have_the_rms_and_no_tilt():
    model = screen_model(64, 2.5)
    inside, position = disc(64)
    rng = np.random.default_rng(1)
    squares = []
    for _ in range(400):
        screen = model.draw(rng, 3.0)
        squares.append((screen[inside] ** 2).mean())
        assert abs(screen[inside].mean()) < 1e-12
        assert abs((screen * position)[inside].sum()) < 1e-10
        assert abs((screen * position[:, None])[inside].sum()) < 1e-10
    assert abs(np.mean(squares) - 9.0) < 4 * np.std(squares) / 20


@pytest.mark.parametrize("samples", [64, 65])
def test_screen_is_the_fourier_series_of_its_coefficients(samples):
    model, (_, position) = screen_model(samples, 2.5), disc(samples)
    real, imaginary = np.random.default_rng(9).standard_normal((2, 64, 127))
    coefficients = 3.0 * model.amplitude * (real + 1j * imaginary)
    f_y, f_x = 0.5 * np.arange(64), 0.5 * np.arange(-63, 64)
    waves = [np.exp(2j * np.pi * np.outer(position, frequency)) for frequency in (f_y, f_x)]
    series = (waves[0] @ coefficients @ waves[1].T).real
    for plane, removed in zip(model.planes, model.removed, strict=True):
        series = series - (removed * series).sum() * plane
    screen = model.draw(np.random.default_rng(9), 3.0)
    assert np.abs(screen - series).max() < 1e-13 * np.abs(series).max()
    assert screen_model(samples, 2.5) is model
    assert not model.planes.flags.writeable


def test_power_falls_with_the_slope():
    for slope in (2.0, 3.0):
        model = screen_model(64, slope)
        kept = model.amplitude[20, 63] / model.amplitude[40, 63]  # 10 and 20 cycles per diameter
        assert kept**2 == pytest.approx(2**slope)


@pytest.mark.parametrize("slope", [2.0, 2.5])
def test_amplitudes_are_a_power_law_that_is_flat_below_a_cycle(slope):
    """Of the frequencies 0.5 i: f^-slope in power, as much below one cycle as at one; half a plane, and no piston."""
    row, column = np.arange(64)[:, None], np.arange(-63, 64)
    expected = np.maximum(0.5 * np.hypot(row, column), 1.0) ** (-slope / 2)
    expected[(row == 0) & (column <= 0)] = 0.0
    amplitude = screen_model(64, slope).amplitude
    np.testing.assert_allclose(amplitude / amplitude[2, 63], expected, rtol=1e-12)  # in those of one cycle


def test_screen_is_the_same_at_every_sampling():
    coarse = screen_model(64, 2.5).draw(np.random.default_rng(5), 1.0)
    fine = screen_model(192, 2.5).draw(np.random.default_rng(5), 1.0)
    inside, _ = disc(64)
    # The middle of three fine samples is the centre of a coarse one; the disc's pixelated edge moves tilt a little.
    assert np.abs(fine[1::3, 1::3] - coarse)[inside].max() < 0.02


def test_first_frame_without_drift_is_the_psf():
    psf = single_band_psf("F662", instrument=INSTRUMENT)
    frames = visit_frames(psf, drift(0.0, 0.0), 3, 60.0, *rngs(1))
    assert frames.shape == (3, 137, 137)
    one_by_one = list(iter_visit_frames(psf, drift(0.0, 0.0), 2, 60.0, *rngs(1)))
    for frame in (*frames, *one_by_one):
        assert np.abs(frame - psf.on_axis).max() < 1e-12 * psf.off_axis.max()


def test_frames_equal_hcipy_with_the_same_screen():
    imager = build_imager(INSTRUMENT, "F720")
    frame = visit_frames(imager, drift(20.0), 1, 1.0, *rngs(2))[0]
    opd = screen_model(128, 2.5).draw(rngs(2)[0], 20.0)
    axis = imager.stamp_axis(masked=True)
    hcipy = imager.image(axis, axis, opd_nm=opd, engine="hcipy")
    clear = imager.stamp_axis(masked=False)
    assert np.abs(frame - hcipy).max() < 1e-12 * imager.image(clear, clear).max()


def test_contrast_scales_with_the_square_of_the_drift():
    psf = single_band_psf("F662", instrument=INSTRUMENT)
    hole, peak = psf.metrics.hole, psf.off_axis.max()
    floor = psf.on_axis[hole].mean() / peak
    for rms in (0.1, 0.5, 1.0):
        contrast = [visit_frames(psf, drift(rms), 1, 1.0, *rngs(k))[0][hole].mean() / peak for k in range(12)]
        assert (np.mean(contrast) - floor) / rms**2 == pytest.approx(1.1e-7, rel=0.25)


def test_frames_without_a_walk_are_still_and_visits_differ():
    imager = build_imager(INSTRUMENT, "F662", "quick")
    still = visit_frames(imager, drift(0.05, 0.0), 4, 900.0, *rngs(3))
    np.testing.assert_array_equal(still[0], still[3])
    visit, walk = rngs(3)
    first, second = iter_visit_frames(imager, drift(0.05, 0.0), 2, 900.0, visit, walk)
    assert first is second  # made once
    assert walk.random() == rngs(3)[1].random()  # and nothing drawn for a walk that is none
    walking = visit_frames(imager, drift(0.05, 0.05), 4, 900.0, *rngs(3))
    assert not np.array_equal(walking[0], still[0])  # half a step into the visit already
    other = visit_frames(imager, drift(0.05, 0.0), 1, 900.0, *rngs(4))[0]
    assert not np.array_equal(other, still[0])


@pytest.fixture
def wavefronts(monkeypatch):
    """Return path differences of frames of many visits, nm, on the disc: shape (visits, frames, samples); no images."""
    imager = build_imager(INSTRUMENT, "F662", Knobs(pupil_samples=64, wavelength_nodes=1, pixel_nodes=1))
    monkeypatch.setattr(FocalGrid, "image", lambda grid, opd_nm: opd_nm)

    def drawn(settings, n_frames, cadence_s, n_visits):
        opd = np.stack([visit_frames(imager, settings, n_frames, cadence_s, *rngs(5, k)) for k in range(n_visits)])
        return opd[:, :, disc(opd.shape[-1])[0]]

    return drawn


@pytest.mark.parametrize("cadence_s", [30.0, 7200.0])
def test_the_wavefront_walks_with_the_square_root_of_time(wavefronts, cadence_s):
    """Brownian motion: <W(s) W(t)> = visit^2 + walk^2 min(s, t), in absolute nm^2, with t in hours."""
    visit, walk, n_visits = 0.3, 0.8, 300
    opd = wavefronts(drift(visit, walk), 4, cadence_s, n_visits)
    hours = (np.arange(4) + 0.5) * cadence_s / 3600.0
    for i in range(4):
        for j in range(i, 4):
            products = (opd[:, i] * opd[:, j]).mean(axis=-1)
            expected = visit**2 + walk**2 * hours[i]
            assert abs(products.mean() - expected) < 4 * products.std() / np.sqrt(n_visits), (i, j)


def test_the_walk_has_slope_one_half_over_four_decades_of_time(wavefronts):
    cadence_s = np.array([3.0, 30.0, 300.0, 3000.0, 30000.0])
    rms = [np.sqrt((wavefronts(drift(0.0, 0.05), 1, step, 60) ** 2).mean()) for step in cadence_s]
    slope = np.diff(np.log(rms)) / np.diff(np.log(cadence_s))
    np.testing.assert_allclose(slope, 0.5, atol=1e-9)  # the same draws at every cadence


def test_iteration_is_lazy_and_checked(refused):
    imager = build_imager(INSTRUMENT, "F662", Knobs(pupil_samples=64, wavelength_nodes=1, pixel_nodes=1))
    frames = iter_visit_frames(imager, drift(0.05, 0.05), 10**9, 60.0, *rngs(6))
    assert next(frames).shape == (137, 137)
    refused("n_frames", iter_visit_frames, imager, drift(), 0, 60.0, *rngs(7))
    refused("cadence_s", iter_visit_frames, imager, drift(), 1, 0.0, *rngs(8))
