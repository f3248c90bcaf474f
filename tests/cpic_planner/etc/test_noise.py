"""The noise model against Monte Carlo of the register, and the choice of settings against brute force."""

from types import SimpleNamespace

import numpy as np
import pytest

from cpic_planner.etc.limits import frame_limit, largest_gain, longest_exposure_s
from cpic_planner.etc.model import Strategy
from cpic_planner.etc.noise import best_gain, frame_terms, stack_noise
from cpic_planner.etc.rates import ApertureRates
from cpic_planner.etc.settings import settings_for_snr, settings_for_time
from simulator.camera import multiply
from simulator.camera.gain import excess_noise_factor2
from simulator.config import load_instrument
from simulator.outcome import Reason

DETECTOR = load_instrument().detector
A0 = 17.0


def rates(planet=0.02, halo=0.03, speckle=0.0, peak_hole=0.01, peak_columns=10.0, tail=0.0, n=1):
    one = np.ones(n)
    return ApertureRates(
        planet_e_s=planet * one,
        halo_e_s=halo * one,
        companion_e_s=0 * one,
        sky_e_s=1e-4 * one,
        dark_e_s=DETECTOR.dark_e_s * A0 * one,
        speckle_e_s=speckle * one,
        peak_hole_e_s=peak_hole * one,
        peak_columns_e_s=peak_columns * one,
        tail_e_s=tail * one,
        aperture_pixels=A0,
        noise_fraction=1.0,
        source_noise_fraction=1.0,
        background_apertures=1e12 * one,
        rdi_throughput=1.0,
    )


def model(**changes):
    instrument = load_instrument(changes) if changes else load_instrument()
    return SimpleNamespace(instrument=instrument, strategy=Strategy())


@pytest.mark.parametrize("gain", [1.0, 2.0, 20.0, 300.0, 1000.0])
@pytest.mark.parametrize(("planet", "halo"), [(0.5, 0.01), (0.02, 2.0), (0.003, 0.001)])
def test_snr_matches_monte_carlo_of_stacks(gain, planet, halo):
    """Aperture sums of 30 + 30 frames: photons through the register, read noise, quantisation."""
    rng, trials, frames, exposure = np.random.default_rng(5), 20000, 30, 100.0
    given = rates(planet, halo)
    predicted = stack_noise(given, exposure, frames, gain, DETECTOR)
    # Multiplication is additive over electrons, so a stack's aperture sum is one draw at its total mean.
    background = float(given.background_e_s[0]) * exposure * frames + frames * A0 * DETECTOR.cic_e

    def aperture_sum(mean):
        electrons = multiply(rng.poisson(mean, trials), gain, rng=rng) / gain
        read = rng.normal(0.0, DETECTOR.read_noise_e * np.sqrt(frames * A0) / gain, trials)
        rounding = rng.normal(0.0, DETECTOR.gain_e_adu / gain * np.sqrt(frames * A0 / 12), trials)
        return electrons + read + rounding

    signal = aperture_sum(planet * exposure * frames + background) - aperture_sum(background)
    assert signal.mean() == pytest.approx(predicted.signal_e[0], abs=4.5 * signal.std() / np.sqrt(trials))
    measured = predicted.signal_e[0] / signal.std()
    assert measured == pytest.approx(predicted.snr[0], rel=0.01 + 4.5 / np.sqrt(2 * trials))
    quiet = aperture_sum(background) - aperture_sum(background)
    assert predicted.signal_e[0] / quiet.std() == pytest.approx(
        predicted.significance[0], rel=0.01 + 4.5 / np.sqrt(2 * trials)
    )


def test_speckles_do_not_average_but_white_noise_does():
    few = stack_noise(rates(speckle=0.004), 100.0, 10, 100.0, DETECTOR)
    many = stack_noise(rates(speckle=0.004), 100.0, 10**9, 100.0, DETECTOR)
    assert many.significance[0] == pytest.approx(0.02 / 0.004, rel=1e-4)
    white = [stack_noise(rates(), 100.0, n, 100.0, DETECTOR).snr[0] for n in (10, 1000)]
    assert white[1] / white[0] == pytest.approx(10.0, rel=1e-12)
    assert few.significance[0] < many.significance[0]


def test_gain_is_within_half_a_percent_of_brute_force():
    light = np.geomspace(1e-2, 1e7, 60)
    read = 2 * A0 * (DETECTOR.read_noise_e**2 + DETECTOR.gain_e_adu**2 / 12)
    grid = np.geomspace(1, 1000, 4000)
    variance = excess_noise_factor2(grid)[:, None] * light + read / grid[:, None] ** 2
    chosen = best_gain(light, read, 1000.0)
    reached = excess_noise_factor2(chosen) * light + read / chosen**2
    assert np.all(reached <= variance.min(axis=0) * 1.005)


def test_longest_exposure_sits_on_the_limit():
    for hole, frame, reason in ((50.0, 1e3, Reason.PIXEL_FULL_WELL), (1e4, 1e3, Reason.PIXEL_FULL_WELL)):
        limit = float(longest_exposure_s(frame, hole, DETECTOR))
        assert frame_limit(frame, hole, 0.0, limit * (1 - 1e-9), 1.0, DETECTOR) is Reason.NONE
        assert frame_limit(frame, hole, 0.0, limit * (1 + 1e-6), 1.0, DETECTOR) is reason
    coarse = load_instrument({"detector": {"adc_bits": 8, "bias_adu": 10}}).detector
    limit = float(longest_exposure_s(0.0, 1e3, coarse))
    assert frame_limit(0.0, 1e3, 0.0, limit * (1 + 1e-6), 1.0, coarse) is Reason.ADC_RANGE
    assert longest_exposure_s(0.0, 0.0, DETECTOR) == np.inf


@pytest.mark.parametrize("snr", [0.1, 3.0, 10.0, 100.0])
@pytest.mark.parametrize("speckle", [0.0, 1e-4])
def test_time_for_snr_is_least_and_enough(snr, speckle):
    given, setup = rates(speckle=speckle), model()
    best = settings_for_snr(setup, given, snr)
    assert best.noise.snr[0] >= snr * (1 - 1e-12)
    # brute force over exposures and frames
    exposures = np.geomspace(DETECTOR.exposure_min_s, DETECTOR.exposure_max_s, 400)
    _, light, read = frame_terms(given, exposures, DETECTOR, reference_ratio=1.0)
    gain = best_gain(light, read, 1000.0)
    one = stack_noise(given, exposures, 1.0, gain, DETECTOR)
    white = one.source_variance_e2 + one.background_variance_e2 + one.detector_variance_e2
    frames = np.maximum(np.ceil(snr**2 * white / (one.signal_e**2 - snr**2 * one.speckle_variance_e2)), 1)
    brute = (2 * frames * (exposures + DETECTOR.readout_s))[one.signal_e**2 > snr**2 * one.speckle_variance_e2].min()
    slack = 2 * (best.exposure_s[0] + DETECTOR.readout_s)  # one frame pair: frames are whole
    assert best.time_s[0] <= brute * 1.1 + slack


def test_speckle_floor_has_no_time():
    assert settings_for_snr(model(), rates(speckle=0.01), 2.001).n_frames[0] == 0
    assert settings_for_snr(model(), rates(speckle=0.01), 1.9).n_frames[0] > 0


def test_settings_fit_the_time_and_use_it():
    for time_s in (50.0, 700.0, 36000.0, 1e6):
        best = settings_for_time(model(), rates(), time_s)
        assert best.time_s[0] <= time_s * (1 + 1e-12)
        assert best.time_s[0] > 0.9 * time_s
        assert best.exposure_s[0] <= DETECTOR.exposure_max_s
    assert settings_for_time(model(), rates(), 1.0).n_frames[0] == 0


def test_more_time_is_never_worse():
    times = np.geomspace(30, 1e6, 40)
    significance = [settings_for_time(model(), rates(), t).noise.significance[0] for t in times]
    # whole frames make small steps; over a factor of time they must not lose
    assert np.all(np.diff(significance[::3]) > 0)


def test_saturating_star_gets_short_frames_or_none():
    bright = settings_for_time(model(), rates(peak_columns=1e5), 3600.0)
    assert bright.exposure_s[0] * 1e5 < DETECTOR.full_well_e
    assert settings_for_time(model(), rates(peak_columns=1e8), 3600.0).n_frames[0] == 0
    assert settings_for_time(model(), rates(peak_columns=1e5), 3600.0, exposure_s=10.0).n_frames[0] == 0


def test_no_register_tail_runs_into_the_hole():
    gain = float(largest_gain(0.001, 20.0, 300.0, DETECTOR))
    assert 1.0 < gain < 130.0
    assert frame_limit(1.0, 0.001, 20.0, 300.0, gain * (1 - 1e-9), DETECTOR) is Reason.NONE
    assert frame_limit(1.0, 0.001, 20.0, 300.0, gain * (1 + 1e-6), DETECTOR) is Reason.REGISTER_FULL_WELL
    chosen = settings_for_time(model(), rates(tail=20.0), 36000.0)
    assert chosen.em_gain[0] * 20.0 * chosen.exposure_s[0] < DETECTOR.register_full_well_e


def test_user_settings_are_honoured_or_refused_not_changed():
    fixed = settings_for_time(model(), rates(), 3600.0, exposure_s=17.0, em_gain=20.0)
    assert (fixed.exposure_s[0], fixed.em_gain[0]) == (17.0, 20.0)
    assert fixed.n_frames[0] == np.floor(3600 / 2 / 18.1)
    assert settings_for_time(model(), rates(peak_hole=2000.0), 3600.0, exposure_s=17.0, em_gain=1000.0).n_frames[0] == 0
