"""Thresholds of a blind search, against fields of noise."""

import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, maximum_filter
from scipy.stats import norm

from cpic_core import Reason, Status
from cpic_planner.etc import SearchedRegion, false_alarms, search_threshold, searched_region

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
