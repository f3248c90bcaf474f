"""The blind detector: false alarms, planets, and what it refuses."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.signal import fftconvolve
from scipy.stats import norm

from cpic_core import Status, stream
from cpic_planner.validation import RdiResult, ReducedStack
from cpic_planner.validation.detection import _candidate, search
from cpic_planner.validation.injection import inject, recovered
from cpic_planner.validation.search import SearchedRegion
from cpic_planner.validation.search_field import Peak
from cpic_planner.validation.speckle_maps import filter_kernel, speckle_maps
from simulator import single_band_psf
from simulator.config import Drift
from simulator.imaging import visit_frames

STILL = Drift(visit_nm=0.0, walk_nm_per_sqrt_hour=0.0, psd_slope=2.5)
MOVING = Drift(visit_nm=0.05, walk_nm_per_sqrt_hour=0.0, psd_slope=2.5)
STAR_E_S = 1.0e9


@pytest.fixture(scope="module")
def psf():
    return single_band_psf("F850", fidelity="quick")


@pytest.fixture(scope="module")
def still(psf):
    return speckle_maps(psf, STILL)


@pytest.fixture(scope="module")
def moving(psf):
    return speckle_maps(psf, MOVING, n_visits=256)


def residual(psf, image, sigma_e=10.0, region=None, integration_s=100.0):
    """A reduced stack with known white noise and no modes."""
    hole = psf.metrics.hole if region is None else region
    image = np.where(hole, image, 0.0)
    none = np.zeros((0, int(hole.sum())))
    rdi = RdiResult(image[None], 0, 0, False, "temporal", hole, none, np.zeros(0))
    return ReducedStack(
        image, hole, np.where(hole, sigma_e**2, 0.0), np.zeros(hole.shape), rdi, integration_s, 300.0, 604
    )


def white(psf, seed, sigma_e=10.0, **settings):
    rng = np.random.default_rng(seed)
    return residual(psf, sigma_e * rng.standard_normal(psf.metrics.hole.shape), sigma_e, **settings)


def flux_error(psf, sigma_e=10.0):
    return sigma_e / math.sqrt(float(np.sum(filter_kernel(psf) ** 2)))


def test_white_noise_gives_the_false_alarms_that_were_asked_for(psf, still):
    n, found, elements = 120, 0, 0.0
    for seed in range(n):
        answer = search(white(psf, seed), psf, still, star_rate_e_s=STAR_E_S, sigma=3.0)
        found += len(answer.detections)
        elements += answer.region.n_elements
        assert all(one.significance < 5.5 for one in answer.candidates)
    expected = elements * norm.sf(3.0)
    assert abs(found - expected) < 4.0 * math.sqrt(expected)


def test_a_bright_planet_does_not_hide_itself_nor_a_faint_one(psf, still):
    unit = flux_error(psf)
    stack = inject(white(psf, 1), psf, 0.42, 0.40, 100 * unit)
    stack = inject(stack, psf, -0.41, 0.45, 14 * unit)
    answer = search(stack, psf, still, star_rate_e_s=STAR_E_S)
    bright, faint = answer.detections
    assert (bright.x_arcsec, bright.y_arcsec) == pytest.approx((0.42, 0.40), abs=0.004)
    assert bright.flux_e == pytest.approx(100 * unit, rel=0.05)
    assert bright.snr_mf == pytest.approx(100, rel=0.1)
    assert (faint.x_arcsec, faint.y_arcsec) == pytest.approx((-0.41, 0.45), abs=0.01)
    assert faint.snr_mf == pytest.approx(14, abs=3)
    assert bright.separation_arcsec == pytest.approx(math.hypot(0.42, 0.40), abs=0.005)
    assert bright.x_pixel - len(stack.region) // 2 == pytest.approx(bright.x_arcsec / psf.metrics.pixel_scale_arcsec)
    assert faint.false_alarms < 1e-6


def test_a_planet_far_brighter_than_everything_is_one_planet(psf, still):
    stack = inject(white(psf, 2), psf, 0.45, -0.45, 3000 * flux_error(psf))
    first = search(stack, psf, still, star_rate_e_s=STAR_E_S).detections[0]
    assert first.flux_e == pytest.approx(3000 * flux_error(psf), rel=0.05)
    assert (first.x_arcsec, first.y_arcsec) == pytest.approx((0.45, -0.45), abs=0.003)


def test_a_known_planet_is_neither_reported_nor_noise(psf, still):
    stack = inject(white(psf, 3), psf, 0.42, 0.40, 20 * flux_error(psf))
    answer = search(stack, psf, still, star_rate_e_s=STAR_E_S, known=[(0.42, 0.40)])
    assert recovered(answer, 0.42, 0.40, psf.metrics.lambda_d_arcsec) is None
    assert answer.white_level == pytest.approx(1.0, abs=0.3)


def test_noise_that_is_stronger_than_stated_is_found(psf, still):
    levels = []
    for seed in range(20):
        loud = white(psf, seed, 15.0)
        stack = dataclasses.replace(loud, white_variance_e2=loud.white_variance_e2 / 2.25)
        answer = search(stack, psf, still, star_rate_e_s=STAR_E_S, sigma=3.0)
        levels.append(answer.white_level)
    assert 1.4 < np.median(levels) < 2.3  # drawn towards 1 by what is believed of white noise


def test_speckles_tell_the_drift_and_pass_for_no_planet(psf, moving):
    drift = []
    for seed in range(12):
        stamps = [visit_frames(psf, MOVING, 1, 1.0, stream(seed, role), stream(seed, role, "walk"))[0] for role in "sr"]
        noise = np.random.default_rng(seed).standard_normal(stamps[0].shape)
        stack = residual(psf, 1e12 * (stamps[0] - stamps[1]) + 3.0 * noise, 3.0, integration_s=1000.0)
        answer = search(stack, psf, moving, star_rate_e_s=STAR_E_S)
        drift.append(answer.drift_nm)
        assert not answer.detections
    assert np.mean(drift) == pytest.approx(0.05, rel=0.15)


@pytest.mark.parametrize("true_nm", [0.03, 0.1])
def test_the_drift_is_that_of_the_images_not_of_the_maps(psf, moving, true_nm):
    drift, found = Drift(visit_nm=true_nm, walk_nm_per_sqrt_hour=0.0, psd_slope=2.5), []
    for seed in range(4):
        stamps = [visit_frames(psf, drift, 1, 1.0, stream(seed, role), stream(seed, role, "walk"))[0] for role in "sr"]
        noise = np.random.default_rng(seed).standard_normal(stamps[0].shape)
        stack = residual(psf, 1e12 * (stamps[0] - stamps[1]) + 3.0 * noise, 3.0, integration_s=1000.0)
        found.append(search(stack, psf, moving, star_rate_e_s=STAR_E_S).drift_nm)
    assert np.mean(found) == pytest.approx(true_nm, rel=0.25)


def test_ten_planets_are_taken_out_and_the_others_seen_beside_them(psf, still):
    """Twelve bright ones: all are found, and the map of what is left shows the two faintest."""
    scale, middle = psf.metrics.pixel_scale_arcsec, len(psf.metrics.hole) // 2
    pixels = [(x * a, y * b) for x, y in ((21, 21), (39, 21), (30, 39)) for a in (1, -1) for b in (1, -1)]
    stack = white(psf, 8)
    for number, (x, y) in enumerate(pixels):
        stack = inject(stack, psf, x * scale, y * scale, (40 + 12 * number) * flux_error(psf))
    answer = search(stack, psf, still, star_rate_e_s=STAR_E_S)
    assert {(round(one.x_pixel) - middle, round(one.y_pixel) - middle) for one in answer.detections} == set(pixels)
    left = [answer.snr_map[middle + y, middle + x] for x, y in pixels]
    assert min(left[:2]) > 5.0
    assert np.abs(left[2:]).max() < 1.0


def test_half_a_hole_is_searched_as_half(psf, still):
    half = psf.metrics.hole.copy()
    half[:, : len(half) // 2] = False
    answer = search(white(psf, 4, region=half), psf, still, star_rate_e_s=STAR_E_S)
    whole = search(white(psf, 4), psf, still, star_rate_e_s=STAR_E_S)
    assert answer.region.n_elements == pytest.approx(whole.region.n_elements / 2)
    assert all(one.x_arcsec > 0 for one in answer.candidates)
    assert answer.threshold.status is Status.OK


@pytest.mark.parametrize("size", [0, 6])
def test_a_few_pixels_are_no_search(refused, psf, still, size):
    patch = np.zeros_like(psf.metrics.hole)
    y, x = np.argwhere(psf.metrics.hole)[len(np.argwhere(psf.metrics.hole)) // 3]
    patch[y : y + size, x : x + size] = psf.metrics.hole[y : y + size, x : x + size]
    answer = search(white(psf, 5, region=patch), psf, still, star_rate_e_s=STAR_E_S)
    assert answer.threshold.status is Status.UNREACHABLE
    assert answer.threshold.message.startswith(f"{answer.region.n_positions / shared_pixels(psf):.3g} independent")
    assert answer.candidates == ()
    assert answer.region.n_positions == patch.sum()
    # Nothing is known of the noise but what was predicted, white and without drift.
    assert (answer.white_level, answer.drift_nm, answer.roughness, answer.dof) == (1.0, 0.0, 0.0, 0.0)
    assert not answer.sigma_e.any()
    assert not answer.snr_map.any()
    refused("sigma", search, white(psf, 5, region=patch), psf, still, star_rate_e_s=STAR_E_S, sigma=20.1)


def shared_pixels(psf):
    """Pixels that share their noise after the filter: the sum of its squared autocorrelation."""
    kernel = filter_kernel(psf)
    correlation = fftconvolve(kernel, kernel[::-1, ::-1])
    return float(np.sum(correlation**2) / correlation.max() ** 2)


@pytest.mark.parametrize("size", [10, 14, 15, 18, 20])
def test_three_independent_samples_of_noise_are_a_search(psf, still, size):
    """Squares in one quadrant of 27 x 27 pixels, of which about 71 share their noise."""
    patch = np.zeros_like(psf.metrics.hole)
    y, x = np.argwhere(psf.metrics.hole)[0]
    patch[y : y + size, x : x + size] = True
    answer = search(white(psf, 5, region=patch & psf.metrics.hole), psf, still, star_rate_e_s=STAR_E_S)
    enough = size**2 / shared_pixels(psf) >= 3.0
    assert answer.threshold.status is (Status.OK if enough else Status.UNREACHABLE)


def test_no_noise_and_no_light_find_nothing_and_a_planet_is_found_without_noise(psf, still):
    quiet = residual(psf, np.zeros(psf.metrics.hole.shape), 0.0)
    assert not search(quiet, psf, still, star_rate_e_s=STAR_E_S).candidates
    answer = search(inject(quiet, psf, 0.42, 0.40, 1e4), psf, still, star_rate_e_s=STAR_E_S)
    assert (answer.detections[0].x_arcsec, answer.detections[0].y_arcsec) == pytest.approx((0.42, 0.40), abs=0.004)


def test_a_whole_search_asks_for_more(psf, still):
    each = search(white(psf, 6), psf, still, star_rate_e_s=STAR_E_S)
    whole = search(white(psf, 6), psf, still, star_rate_e_s=STAR_E_S, per_search=True)
    assert whole.threshold.unwrap() > each.threshold.unwrap() > 5.0


def test_bad_input_is_named(refused, psf, still):
    stack = white(psf, 7)
    image = stack.image_e.copy()
    image[tuple(np.argwhere(stack.region)[0])] = math.nan
    refused("finite", search, dataclasses.replace(stack, image_e=image), psf, still, star_rate_e_s=STAR_E_S)
    refused("star_rate_e_s", search, stack, psf, still, star_rate_e_s=0.0)
    for sigma in (1.0, math.nextafter(2.5, 0.0), math.nextafter(20.0, 21.0), math.nan):
        refused("sigma", search, stack, psf, still, star_rate_e_s=STAR_E_S, sigma=sigma)
    small = dataclasses.replace(still, linear=np.zeros((3, 3)))
    refused("maps", search, stack, psf, small, star_rate_e_s=STAR_E_S)


@pytest.mark.parametrize("sigma", [2.5, 20.0])
def test_ends_of_the_range_are_allowed(psf, still, sigma):
    assert search(white(psf, 7), psf, still, star_rate_e_s=STAR_E_S, sigma=sigma).sigma == sigma


def test_a_star_that_does_not_drift_may_be_of_any_light(psf, still):
    stack = inject(white(psf, 9), psf, 0.42, 0.40, 20 * flux_error(psf))
    faint, bright = (search(stack, psf, still, star_rate_e_s=rate) for rate in (1e-3, STAR_E_S))
    assert faint.candidates == bright.candidates
    assert faint.drift_nm == bright.drift_nm == 0.0
    assert len(faint.detections) == 1


@pytest.mark.parametrize("significance", [0.3, 1.0, 1.4, 2.1, 5.2, 9.0])
def test_a_candidate_says_how_often_noise_does_as_much(significance):
    """Expected Euler characteristic of a Gaussian field above the level, which is 1 at least; the threshold counts."""
    region, roughness = SearchedRegion(2704.0, 208.0, 4.0, 2916, 99.0), 0.05
    peak = Peak(40.5, 70.0, 6.0, significance, 0.1, 80.0, 1e3)
    level = max(significance, 1.0)
    curve = math.exp(-(level**2) / 2.0) / (2.0 * math.pi)
    expected = (
        4.0 * norm.sf(level)
        + 208.0 * math.sqrt(roughness) * curve
        + 2704.0 * roughness * level * curve / math.sqrt(2.0 * math.pi)
    )
    for threshold, detected in ((significance, True), (math.nextafter(significance, 99.0), False)):
        found = _candidate(peak, (-27.5 * 0.016, 2.0 * 0.016), threshold, 5.9, region, roughness)
        assert found.false_alarms == pytest.approx(expected, rel=1e-12)
        assert found.detected is detected
        assert (found.x_arcsec, found.y_arcsec) == pytest.approx((-27.5 * 0.016, 2.0 * 0.016), rel=1e-12)
        assert found.threshold == 5.9
