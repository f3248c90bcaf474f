"""Law of noise with a few speckles and an estimated scale, and what a residual tells of its own noise.

Limits of clean pixels, against the exact law of compound counts by Fourier inversion, and against draws.
"""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import ndtr
from scipy.stats import norm, t as student

from cpic_planner.validation.noise_law import (
    NoiseTerms,
    PixelLaw,
    equivalent_sigma,
    fit_noise,
    log_tail,
    smooth_white,
    snr_at,
)
from simulator.detectors.gain import multiply


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


STAGES, READ_NOISE_E = 604, 110.0


def exact_tail(mean: float, gain: float, sigma: float, limit: float) -> tuple[float, float]:
    """Chance that Poisson electrons through the register plus Gaussian noise exceed a limit; and their mean there."""
    size = 1 << int(np.ceil(np.log2(gain * (3.0 * limit + 60.0))))
    p = np.expm1(np.log(gain) / STAGES)
    z = np.exp(-2j * np.pi * np.arange(size // 2 + 1) / size)
    for _ in range(STAGES):
        z = z * (1.0 - p + p * z)
    pmf = np.maximum(np.fft.irfft(np.exp(mean * (z - 1.0)), size), 0.0)
    value = np.arange(size) / gain
    reach = (value - limit) / sigma
    beyond = ndtr(reach)
    density = np.exp(-0.5 * np.minimum(reach**2, 700.0)) / np.sqrt(2.0 * np.pi)
    return float(pmf @ beyond), float(pmf @ (value * beyond + sigma * density))


@pytest.mark.parametrize(
    ("gain", "mean"),
    [(g, m) for g in (1.0, 20.0, 300.0, 1000.0) for m in (0.01, 0.3, 10.0)] + [(1.0, 1e4), (300.0, 100.0)],
)
def test_known_mean(gain: float, mean: float) -> None:
    """The chance is below what is asked for, not by much; the mean loses less than 1e-3, or 1e-6 of the read noise."""
    sigma, asked = READ_NOISE_E / gain, 1e-6
    limit = float(PixelLaw(gain, STAGES, sigma, asked).limit_of_mean(mean))
    chance, cut_off = exact_tail(mean, gain, sigma, limit)
    # Where hardly a frame holds an electron the bound gives away most.
    assert (0.02 if mean > 0.1 or sigma > 1.0 else 0.002) * asked < chance < 0.5 * asked
    assert cut_off - mean * chance < 1e-3 * mean + 1e-6 * sigma


@pytest.mark.parametrize("n_frames", [2, 3, 30])
@pytest.mark.parametrize("gain", [1.0, 20.0, 300.0, 1000.0])
def test_unknown_mean(gain: float, n_frames: int) -> None:
    """The same limit holds whatever the level, with few frames and with many."""
    rng, asked, size = np.random.default_rng(int(gain) + n_frames), 1e-3, 300_000
    chances = []
    for mean in (0.01, 0.1, 1.0, 30.0, 1e4):
        shape = (n_frames, size // n_frames)
        seen = multiply(rng.poisson(mean, shape), gain, rng=rng) / gain
        seen += rng.normal(0.0, READ_NOISE_E / gain, shape)
        law = PixelLaw(gain, STAGES, READ_NOISE_E / gain, asked)
        limit = law.limit_beside_others(seen.sum(axis=0), n_frames)
        chances.append(float(np.mean(seen > limit)) / asked)
    assert max(chances) < 0.35
    assert max(chances) > 0.03


def test_drift_is_allowed_for() -> None:
    """A frame whose light is 10 % above the others' is no hit."""
    rng = np.random.default_rng(3)
    seen = rng.poisson(1e4, (10, 20_000)).astype(float)
    seen[4] = rng.poisson(1.1e4, 20_000)
    law = PixelLaw(1.0, STAGES, sigma_e=1.0, false_alarm=1e-6)
    total = seen.sum(axis=0)
    assert np.mean(seen[4] > law.limit_beside_others(total, 10)) > 0.5
    assert not np.any(seen[4] > law.limit_beside_others(total * 9 / 9.09, 10, drift=0.12))


def test_each_pixel_has_its_own_limit() -> None:
    """Many pixels at once take nearly the limits that they get alone; none is below."""
    mean = np.geomspace(1e-3, 1e5, 5000)
    law = PixelLaw(300.0, STAGES, sigma_e=0.4, false_alarm=1e-6)
    together = law.limit_of_mean(mean)
    alone = np.array([float(law.limit_of_mean(one)) for one in mean[::500]])
    assert (together[::500] >= alone * (1 - 1e-12)).all()
    assert together[::500] == pytest.approx(alone, rel=2e-3)
    assert law.limit_of_mean(np.zeros(0)).shape == (0,)
