"""What a residual tells of its own noise."""

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from cpic_planner.validation.search import NoiseTerms, fit_noise, smooth_white

N = 4000
RNG = np.random.default_rng(5)
FALL = np.linspace(0.0, 1.0, N)
TERMS = NoiseTerms(np.full(N, 2.0), 6.0 * (1 - FALL) ** 3, 20.0 * (1 - FALL) ** 6)


def test_what_all_visits_share_is_found_beside_what_scatters():
    """Positions that know only level and drift, and as many where a share of the drift's light is added to them."""
    shared = NoiseTerms(TERMS.white, TERMS.linear, TERMS.square, 0.5 * TERMS.linear)
    terms = shared.beside(NoiseTerms(TERMS.white, TERMS.linear, TERMS.square, np.zeros(N)))
    logs = np.log([1.2, 2.0, 1.7])
    expected = 1.2 * TERMS.white + 2.0 * TERMS.linear + 4.0 * TERMS.square
    np.testing.assert_allclose(terms.variance(logs)[N:], expected)
    np.testing.assert_allclose(terms.variance(logs)[:N], expected + 2.0 * 1.7 * 0.5 * TERMS.linear)
    np.testing.assert_array_equal(terms.at(np.arange(2 * N) % 2 == 0).white, terms.white[::2])
    before = np.ones(2 * N)
    fit = fit_noise(terms.variance(logs) * RNG.standard_normal(2 * N) ** 2, before, terms, 20.0 * before, np.zeros(3))
    np.testing.assert_allclose(fit.logs, logs, atol=0.3)
    numeric = [
        (np.log(terms.variance(logs + step)) - np.log(terms.variance(logs - step))) / 2e-6 for step in 1e-6 * np.eye(3)
    ]
    np.testing.assert_allclose(terms.slopes(logs, terms.variance(logs)), numeric, atol=1e-8)


@pytest.mark.parametrize(("level", "drift"), [(1.0, 1.0), (1.6, 1.0), (1.0, 9.0), (2.25, 0.3)])
def test_fit_finds_what_noise_was_made_of(level, drift):
    truth = TERMS.variance(np.log([level, drift]))
    before = TERMS.variance(np.zeros(2))
    ratio = truth * RNG.standard_normal(N) ** 2 / before
    fit = fit_noise(ratio, before, TERMS, np.ones(N), np.zeros(2))
    error = np.sqrt(np.diag(np.linalg.inv(fit.information)))
    assert error.max() < 0.15
    assert (np.abs(fit.logs - np.log([level, drift])) < 4 * error).all()
    np.testing.assert_allclose(fit.variance, TERMS.variance(fit.logs))


def test_errors_are_those_of_repeated_fits():
    before = TERMS.variance(np.zeros(2))
    fits = [fit_noise(RNG.standard_normal(N) ** 2, before, TERMS, np.ones(N), np.zeros(2)) for _ in range(150)]
    spread = np.std([fit.logs for fit in fits], axis=0)
    stated = np.sqrt(np.diag(np.linalg.inv(fits[0].information)))
    np.testing.assert_allclose(spread, stated, rtol=0.25)


def test_without_samples_the_beliefs_stay():
    fit = fit_noise(np.ones(N), np.full(N, 2.0), TERMS, np.zeros(N), np.array([1.0, -1.0]))
    np.testing.assert_allclose(fit.logs, 0.0, atol=0.05)


def test_slopes_are_derivatives():
    logs, step = np.array([0.3, -0.4]), 1e-6
    slopes = TERMS.slopes(logs, TERMS.variance(logs))
    for row in (0, 1):
        move = np.eye(2)[row] * step
        numeric = (np.log(TERMS.variance(logs + move)) - np.log(TERMS.variance(logs - move))) / (2 * step)
        np.testing.assert_allclose(slopes[row], numeric, atol=1e-8)


def test_smooth_white_keeps_patterns_and_drops_noise():
    patterns = np.stack([np.ones(N), FALL, np.zeros(N)])
    truth = 3.0 + 4.0 * FALL
    smooth = smooth_white(truth * (1 + 0.2 * RNG.standard_normal(N)), patterns, patterns)
    np.testing.assert_allclose(smooth, truth, rtol=0.03)
    assert smooth_white(np.where(FALL < 0.9, 1.0, -9.0), patterns[:2], patterns[:2]).min() == pytest.approx(0.25)


def test_a_star_in_the_field_leaves_the_white_noise_elsewhere():
    """The core of a background star is far brighter than the rest, and no pattern has its shape."""
    core = 300.0 * np.exp(-0.5 * ((np.arange(N) - 30.0) / 10.0) ** 2)
    truth = 3.0 + 4.0 * FALL + core
    patterns = np.stack([np.ones(N), FALL, uniform_filter1d(truth, 81)])
    smooth = smooth_white(truth * (1 + 0.2 * RNG.standard_normal(N)), patterns, patterns)
    np.testing.assert_allclose(smooth[400:], truth[400:], rtol=0.05)
