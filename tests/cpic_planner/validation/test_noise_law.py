"""Law of noise with a few speckles and an estimated scale, and what a residual tells of its own noise."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm
from scipy.stats import t as student

from cpic_planner.validation.noise_law import NoiseTerms, equivalent_sigma, fit_noise, log_tail, smooth_white, snr_at


@pytest.mark.parametrize("dof", [6.0, 12.0, 80.0])
def test_without_speckles_it_is_students_law(dof):
    level = np.array([0.5, 2.0, 5.0, 9.0])
    np.testing.assert_allclose(log_tail(level, 0.0, dof), student.logsf(level, dof), atol=2e-3)
    np.testing.assert_allclose(log_tail(level, 0.0), norm.logsf(level), rtol=1e-12)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.9])
@pytest.mark.parametrize("level", [0.5, 3.0, 6.0])
def test_tail_is_that_of_the_convolution(share, level):
    width, fall = math.sqrt(1 - share), math.sqrt(share / 2)

    def density(speckle):
        return math.exp(-abs(speckle) / fall) / (2 * fall) * norm.sf((level - speckle) / width)

    integral = sum(
        quad(density, *edges, limit=200)[0] for edges in ((-40 * fall, 0), (0, level), (level, level + 40 * fall))
    )
    assert log_tail(level, share)[0] == pytest.approx(math.log(integral), abs=1e-5)


def test_an_estimated_scale_makes_tails_heavier():
    scale = np.sqrt(np.random.default_rng(3).chisquare(20.0, 200_000) / 20.0)
    mean = np.mean(np.exp(log_tail(4.0 * scale, 0.5)))
    assert math.exp(log_tail(4.0, 0.5, 20.0)[0]) == pytest.approx(mean, rel=0.03)


def test_equivalent_sigma_orders_and_inverts():
    level = np.linspace(-6.0, 12.0, 60)
    sigma = equivalent_sigma(level, 0.4, 40.0)
    assert (np.diff(sigma) > 0).all()
    assert np.isfinite(equivalent_sigma(np.array([1e3, 1e5]), 0.5, 30.0)).all()
    for share, dof in ((0.0, np.inf), (0.4, 40.0), (0.9, 8.0)):
        assert equivalent_sigma(snr_at(5.0, share, dof), share, dof)[0] == pytest.approx(5.0, abs=1e-6)
    assert snr_at(5.0, 0.0)[0] == pytest.approx(5.0, abs=1e-6)
    assert snr_at(5.0, 0.8)[0] > snr_at(5.0, 0.4)[0] > 5.5


def test_candidates_together_and_one_by_one():
    share, dof = np.array([0.0, 0.3, 0.9, 0.5]), np.array([12.0, np.inf, 40.0, 3.0])
    together = snr_at(4.5, share, dof)
    np.testing.assert_array_equal(together, [snr_at(4.5, *pair)[0] for pair in zip(share, dof, strict=True)])
    np.testing.assert_allclose(equivalent_sigma(together, share, dof), 4.5, rtol=1e-9)


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
