"""Thresholds of a blind search, against fields of noise; and what a residual tells of its own noise."""

import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, maximum_filter, uniform_filter1d
from scipy.stats import norm

from cpic_core import Reason, Status
from cpic_planner.validation.search import (
    NoiseTerms,
    SearchedRegion,
    false_alarms,
    fit_noise,
    search_threshold,
    searched_region,
)
from cpic_planner.validation.search_field import smooth_white

SQUARE = searched_region(np.ones((40, 40), bool), 3.3)
WIDTH = 1.5  # of the Gaussian filter: the gradient of the filtered field has the variance 1 / (2 width^2)
ROUGH = 1.0 / (2.0 * WIDTH**2)


def test_region_counts_area_edges_and_holes():
    pixels = np.zeros((20, 30), bool)
    pixels[2:7, 3:10] = True
    one = searched_region(pixels, 2.0)
    assert (one.area_pixels, one.half_perimeter_pixels, one.euler) == (24.0, 10.0, 1.0)
    assert one.n_elements == 35 / 4
    pixels[4, 6] = False
    pixels[10:12, 20:22] = True
    ring_and_square = searched_region(pixels, 2.0)
    assert ring_and_square.euler == 1.0  # two pieces, one hole
    assert ring_and_square.area_pixels == 24.0 - 4.0 + 1.0


def test_a_single_position_has_the_law_of_a_normal_variate():
    point = SearchedRegion(0.0, 0.0, 1.0, 1, 20.0)
    assert false_alarms(3.0, point, 0.2) == pytest.approx(norm.sf(3.0))


def test_peaks_of_white_noise_are_as_many_as_foretold():
    level = 3.2
    rng = np.random.default_rng(11)
    n, found = 900, 0
    for _ in range(n):
        field = gaussian_filter(rng.standard_normal((64, 64)), WIDTH)[12:52, 12:52] * (2 * math.sqrt(math.pi) * WIDTH)
        peak = (maximum_filter(field, 3, mode="constant", cval=-np.inf) == field) & (field > 1.0)
        y, x = np.nonzero(peak)
        height = field[y, x].copy()
        for dy, dx in ((0, 1), (1, 0)):  # between pixels, as the detector does
            inner = (y >= dy) & (y < 40 - dy) & (x >= dx) & (x < 40 - dx)
            low, high = field[y[inner] - dy, x[inner] - dx], field[y[inner] + dy, x[inner] + dx]
            height[inner] += (high - low) ** 2 / (8 * (2 * field[y[inner], x[inner]] - low - high))
        found += int(np.count_nonzero(height >= level))
    expected = n * float(false_alarms(level, SQUARE, ROUGH))
    assert expected > 100
    assert abs(found - expected) < 4.0 * math.sqrt(expected)


@pytest.mark.parametrize("sigma", [2.0, 3.0, 5.0, 8.0])
def test_threshold_gives_the_alarms_that_were_asked_for(sigma):
    each = search_threshold(SQUARE, ROUGH, sigma=sigma).unwrap()
    assert false_alarms(each, SQUARE, ROUGH) == pytest.approx(SQUARE.n_elements * norm.sf(sigma), rel=1e-6)
    whole = search_threshold(SQUARE, ROUGH, sigma=sigma, per_search=True).unwrap()
    assert false_alarms(whole, SQUARE, ROUGH) == pytest.approx(norm.sf(sigma), rel=1e-6)
    assert whole > each > sigma


def test_too_small_a_search_is_undefined():
    few = searched_region(np.ones((4, 4), bool), 3.3)
    answer = search_threshold(few, ROUGH)
    assert answer.status is Status.UNREACHABLE
    assert answer.reason is Reason.TOO_FEW_ELEMENTS


@pytest.mark.parametrize(
    ("call", "key"),
    [
        (lambda: search_threshold(SQUARE, ROUGH, sigma=1.0), "sigma"),
        (lambda: search_threshold(SQUARE, ROUGH, sigma=math.nan), "sigma"),
        (lambda: search_threshold(SQUARE, 0.0), "roughness"),
        (lambda: false_alarms(0.5, SQUARE, ROUGH), "threshold"),
        (lambda: false_alarms(math.inf, SQUARE, ROUGH), "threshold"),
        (lambda: false_alarms(3.0, SQUARE, -1.0), "roughness"),
        (lambda: searched_region(np.ones((4, 4)), 3.3), "region"),
        (lambda: searched_region(np.ones((4, 4), bool), 0.0), "lambda_d_pixels"),
    ],
)
def test_bad_input_is_named(refused, call, key):
    refused(key, call)


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
    smooth = smooth_white(truth * (1 + 0.2 * RNG.standard_normal(N)), patterns)
    np.testing.assert_allclose(smooth, truth, rtol=0.03)
    assert smooth_white(np.where(FALL < 0.9, 1.0, -9.0), patterns[:2]).min() == pytest.approx(0.25)


def test_a_star_in_the_field_leaves_the_white_noise_elsewhere():
    """The core of a background star is far brighter than the rest, and no pattern has its shape."""
    core = 300.0 * np.exp(-0.5 * ((np.arange(N) - 30.0) / 10.0) ** 2)
    truth = 3.0 + 4.0 * FALL + core
    patterns = np.stack([np.ones(N), FALL, uniform_filter1d(truth, 81)])
    smooth = smooth_white(truth * (1 + 0.2 * RNG.standard_normal(N)), patterns)
    np.testing.assert_allclose(smooth[400:], truth[400:], rtol=0.05)
