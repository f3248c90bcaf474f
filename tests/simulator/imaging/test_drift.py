import itertools

import numpy as np
import pytest

from simulator.config import Drift, Timing, load_instrument
from simulator.imaging import FocalGrid, SharedTerms, build_imager, single_band_psf, visit_frames
from simulator.imaging.drift import low_order_map, screen_model
from simulator.knobs import Knobs

INSTRUMENT = load_instrument()


def drift(visit=0.05, walk=0.0, **more):
    return Drift(visit_nm=visit, walk_nm_per_sqrt_hour=walk, psd_slope=2.5, **more)


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


@pytest.mark.parametrize("samples", [64, 65])
def test_a_reading_of_a_screen_is_the_sum_of_what_it_sees_of_each_wave(samples):
    screens, rng = screen_model(samples, 2.5), np.random.default_rng(6)
    readings, waves = rng.standard_normal((3, samples, samples)), rng.standard_normal((4, 128, 128))
    drawn = np.einsum("ryx,syx->rs", readings, screens.screens(waves))
    np.testing.assert_allclose(np.einsum("ryx,syx->rs", screens.coefficients(readings), waves), drawn, rtol=1e-9)
    content = np.einsum("kyx,syx->sk", screens.removed, screens.screens(waves))
    np.testing.assert_allclose(content, 0.0, atol=1e-12)


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
    for frame in frames:
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


def test_frames_without_a_walk_are_still_and_visits_differ(monkeypatch):
    imager = build_imager(INSTRUMENT, "F662", "quick")
    still = visit_frames(imager, drift(0.05, 0.0), 4, 900.0, *rngs(3))
    np.testing.assert_array_equal(still[0], still[3])
    visit, walk = rngs(3)
    made, image = [], FocalGrid.image
    with monkeypatch.context() as watched:
        watched.setattr(FocalGrid, "image", lambda grid, opd_nm: made.append(1) or image(grid, opd_nm))
        visit_frames(imager, drift(0.05, 0.0), 2, 900.0, visit, walk)
    assert len(made) == 1
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

    def drawn(settings, n_frames, cadence_s, n_visits, shared=lambda k: SharedTerms()):
        opd = np.stack(
            [
                visit_frames(imager, settings, n_frames, cadence_s, *rngs(5, k), shared=shared(k))
                for k in range(n_visits)
            ]
        )
        return opd[:, :, disc(opd.shape[-1])[0]]

    return drawn


@pytest.mark.parametrize(
    ("cadence_s", "n_visits"),
    [(30.0, 75), *(pytest.param(each, 300, marks=pytest.mark.long) for each in (30.0, 7200.0))],
)
def test_the_wavefront_walks_with_the_square_root_of_time(wavefronts, cadence_s, n_visits):
    """Brownian motion: <W(s) W(t)> = visit^2 + walk^2 min(s, t), in absolute nm^2, with t in hours."""
    visit, walk = 0.3, 0.8
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


def test_low_orders_are_the_six_aberrations_in_equal_parts():
    """Projections on unit Zernike polynomials (Noll 1976), whose radial parts are written out here once more."""
    n = 400
    inside, position = disc(n)
    r, theta = 2 * np.hypot(position[:, None], position), np.arctan2(position[:, None], position)
    noll = {
        "piston": np.ones_like(r),
        "tip": 2 * r * np.cos(theta),
        "tilt": 2 * r * np.sin(theta),
        "defocus": np.sqrt(3) * (2 * r**2 - 1),
        "astigmatism": np.sqrt(6) * r**2 * np.cos(2 * theta),
        "other astigmatism": np.sqrt(6) * r**2 * np.sin(2 * theta),
        "coma": np.sqrt(8) * (3 * r**3 - 2 * r) * np.cos(theta),
        "other coma": np.sqrt(8) * (3 * r**3 - 2 * r) * np.sin(theta),
        "spherical": np.sqrt(5) * (6 * r**4 - 6 * r**2 + 1),
    }
    low = low_order_map(n)
    for name, term in noll.items():
        expected = 0.0 if name in ("piston", "tip", "tilt") else 1 / np.sqrt(6)
        assert (low * term)[inside].mean() == pytest.approx(expected, abs=3e-3), name
    assert (low[inside] ** 2).mean() == pytest.approx(1.0, rel=1e-12)
    assert not low.flags.writeable


@pytest.mark.parametrize("tau_h", [0.5, 3.0])
def test_offsets_of_visits_are_a_stationary_chain(tau_h):
    """The correlation of visits j and k is exp(-|j - k| gap / tau), and every visit has the same rms."""
    settings, gap_s, count, inside = drift(0.4, correlation_time_h=tau_h), 1800.0, 80, disc(64)[0]
    model, chains = screen_model(64, 2.5), []
    for number in range(count):

        def rng(visit, number=number):
            return np.random.default_rng([number, visit])

        terms = [SharedTerms(settings.correlation(gap_s), tuple(map(rng, range(k - 1, -1, -1)))) for k in range(4)]
        chains.append([term.frozen(model, settings, model.draw(rng(k), 0.4))[inside] for k, term in enumerate(terms)])
    chains = np.array(chains)
    for j in range(4):
        for k in range(j, 4):
            products = (chains[:, j] * chains[:, k]).mean(axis=-1)
            expected = 0.4**2 * np.exp(-0.5 * (k - j) / tau_h)
            assert abs(products.mean() - expected) < 4 * products.std() / np.sqrt(count), (j, k)


def test_science_visits_have_one_screen_in_common(wavefronts):
    """The mean of many visits tends to it; its rms is its fraction of the offset's."""
    settings = drift(0.3, common_fraction=0.5)
    found = wavefronts(settings, 1, 60.0, 40, lambda k: SharedTerms(common=np.random.default_rng(8)))
    alone = wavefronts(settings, 1, 60.0, 40)
    screen = screen_model(128, 2.5).draw(np.random.default_rng(8), 0.15)[disc(128)[0]]
    np.testing.assert_allclose(found - alone, np.broadcast_to(screen, found.shape), atol=1e-12)
    assert settings.common_nm == 0.15


ORBIT_S = 5553.6


@pytest.mark.parametrize("orders", ["low", "all"])
def test_the_orbit_swings_one_map_in_all_visits(wavefronts, orders):
    """Frames against the sine at their middle; the rms over disc and orbit is that of the configuration."""
    settings = drift(0.0, orbital_nm=0.2, orbital_orders=orders, orbital_period_s=ORBIT_S)
    timing, n_frames, cadence_s = Timing(start_turns=0.1, window_turns=1.0), 20, ORBIT_S / 20
    orbits = 60 if orders == "all" else 1

    def shared(seed):
        return lambda k: SharedTerms(orbit=np.random.default_rng(seed), timing=timing)

    found = np.concatenate([wavefronts(settings, n_frames, cadence_s, 1, shared(seed)) for seed in range(orbits)])
    middle = (np.arange(n_frames) + 0.5) * cadence_s / ORBIT_S + 0.1
    width = np.sinc(cadence_s / ORBIT_S)  # of a sine that is averaged over a frame
    expected = 0.2 * np.sqrt(2) * width * np.sin(2 * np.pi * middle)
    shape = found[0, 0] / expected[0]
    np.testing.assert_allclose(found[0], expected[:, None] * shape, atol=1e-12)
    squares = (found**2).mean(axis=(1, 2)) / width**2
    assert abs(squares.mean() - 0.04) <= max(4 * squares.std() / np.sqrt(orbits), 1e-12)


def test_a_phase_that_nobody_knows_is_that_of_the_realisation(wavefronts):
    settings = drift(0.0, orbital_nm=0.2, orbital_period_s=ORBIT_S)

    def swung(seed, **more):
        terms = SharedTerms(orbit=np.random.default_rng(seed), **more)
        return wavefronts(settings, 1, 60.0, 1, lambda k: terms)[0, 0]

    np.testing.assert_array_equal(swung(1, visit=5), swung(1, reference=True))  # interleaved: the same part of orbits
    assert np.abs(swung(1) - swung(2)).max() > 1e-3


@pytest.mark.parametrize("harmonic", [1, 2])
@pytest.mark.parametrize(
    ("scheme", "visit", "science", "reference"),
    [
        ("interleaved", 0, (0.0, 0.4), (0.0, 0.4)),
        ("half", 1, (0.0, 0.2), (0.2, 0.4)),
        ("swapped", 2, (0.0, 0.2), (0.2, 0.4)),
        ("swapped", 3, (0.2, 0.4), (0.0, 0.2)),
        ("other_star", 0, (0.0, 0.4), (0.25, 0.65)),
    ],
)
def test_light_is_taken_in_windows(scheme, visit, science, reference, harmonic):
    """Means over the times of a fine clock that is folded into the windows."""
    timing, edges = Timing(scheme, window_turns=0.4), np.array([0.0, 0.13, 0.5, 2.31])
    for first, last, role in ((*science, False), (*reference, True)):
        found = timing.phasors(edges, reference=role, visit=visit, harmonic=harmonic)
        clock = (np.arange(231_000) + 0.5) * 1e-5
        waves = np.exp(2j * np.pi * harmonic * (first + clock % (last - first)))
        expected = [waves[(clock > low) & (clock < high)].mean() for low, high in itertools.pairwise(edges)]
        np.testing.assert_allclose(found, expected, atol=2e-4)


def test_timing_is_checked(refused):
    for name, values in {
        "scheme": ("alternate",),
        "gap_s": (-1.0, np.nan),
        "start_turns": (np.inf,),
        "window_turns": (0.0, 1.1),
    }.items():
        for value in values:
            refused(name, Timing, **{name: value})
