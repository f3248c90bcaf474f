"""Level of white noise and strength of speckles from squared significances."""

import numpy as np
import pytest

from cpic_planner.validation.noise_fit import NoiseTerms, fit_noise, smooth_white

N = 4000
RNG = np.random.default_rng(5)
FALL = np.linspace(0.0, 1.0, N)
TERMS = NoiseTerms(np.full(N, 2.0), 6.0 * (1 - FALL) ** 3, 20.0 * (1 - FALL) ** 6)


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
    smooth = smooth_white(truth * (1 + 0.2 * RNG.standard_normal(N)), patterns)
    np.testing.assert_allclose(smooth, truth, rtol=0.03)
    assert smooth_white(np.where(FALL < 0.9, 1.0, -9.0), patterns[:2]).min() == pytest.approx(0.25)
