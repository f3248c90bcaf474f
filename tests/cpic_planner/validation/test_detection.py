"""The blind detector: false alarms, planets, and what it refuses."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.stats import norm

from catalogs.errors import InputError
from cpic_planner.validation.detection import search
from cpic_planner.validation.injection import inject, recovered
from cpic_planner.validation.rdi import RdiResult
from cpic_planner.validation.reduced import ReducedStack
from cpic_planner.validation.speckle_maps import filter_kernel, speckle_maps
from simulator import single_band_psf
from simulator.config.optics import Drift
from simulator.imaging.drift import visit_frames
from simulator.outcome import Status
from simulator.rng import stream

STILL = Drift(visit_nm=0.0, walk_nm_per_sqrt_hour=0.0, psd_slope=2.5)
MOVING = Drift(visit_nm=0.05, walk_nm_per_sqrt_hour=0.0, psd_slope=2.5)
STAR_E_S = 1.0e9


@pytest.fixture(scope="module")
def psf():
    return single_band_psf("F850", fidelity="quick")


@pytest.fixture(scope="module")
def still(psf):
    return speckle_maps(psf, STILL)


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


def test_speckles_tell_the_drift_and_pass_for_no_planet(psf):
    maps = speckle_maps(psf, MOVING, n_visits=256)
    drift = []
    for seed in range(12):
        stamps = [visit_frames(psf, MOVING, 1, 1.0, stream(seed, role), stream(seed, role, "walk"))[0] for role in "sr"]
        noise = np.random.default_rng(seed).standard_normal(stamps[0].shape)
        stack = residual(psf, 1e12 * (stamps[0] - stamps[1]) + 3.0 * noise, 3.0, integration_s=1000.0)
        answer = search(stack, psf, maps, star_rate_e_s=STAR_E_S)
        drift.append(answer.drift_nm)
        assert not answer.detections
    assert np.mean(drift) == pytest.approx(0.05, rel=0.15)


def test_half_a_hole_is_searched_as_half(psf, still):
    half = psf.metrics.hole.copy()
    half[:, : len(half) // 2] = False
    answer = search(white(psf, 4, region=half), psf, still, star_rate_e_s=STAR_E_S)
    whole = search(white(psf, 4), psf, still, star_rate_e_s=STAR_E_S)
    assert answer.region.n_elements == pytest.approx(whole.region.n_elements / 2)
    assert all(one.x_arcsec > 0 for one in answer.candidates)
    assert answer.threshold.status is Status.OK


@pytest.mark.parametrize("size", [0, 6])
def test_a_few_pixels_are_no_search(psf, still, size):
    patch = np.zeros_like(psf.metrics.hole)
    y, x = np.argwhere(psf.metrics.hole)[len(np.argwhere(psf.metrics.hole)) // 3]
    patch[y : y + size, x : x + size] = psf.metrics.hole[y : y + size, x : x + size]
    answer = search(white(psf, 5, region=patch), psf, still, star_rate_e_s=STAR_E_S)
    assert answer.threshold.status is Status.UNREACHABLE
    assert answer.candidates == ()


def test_no_noise_and_no_light_find_nothing_and_a_planet_is_found_without_noise(psf, still):
    quiet = residual(psf, np.zeros(psf.metrics.hole.shape), 0.0)
    assert not search(quiet, psf, still, star_rate_e_s=STAR_E_S).candidates
    answer = search(inject(quiet, psf, 0.42, 0.40, 1e4), psf, still, star_rate_e_s=STAR_E_S)
    assert (answer.detections[0].x_arcsec, answer.detections[0].y_arcsec) == pytest.approx((0.42, 0.40), abs=0.004)


def test_a_whole_search_asks_for_more(psf, still):
    each = search(white(psf, 6), psf, still, star_rate_e_s=STAR_E_S)
    whole = search(white(psf, 6), psf, still, star_rate_e_s=STAR_E_S, per_search=True)
    assert whole.threshold.unwrap() > each.threshold.unwrap() > 5.0


def test_bad_input_is_named(psf, still):
    stack = white(psf, 7)
    image = stack.image_e.copy()
    image[tuple(np.argwhere(stack.region)[0])] = math.nan
    with pytest.raises(InputError, match="finite"):
        search(dataclasses.replace(stack, image_e=image), psf, still, star_rate_e_s=STAR_E_S)
    with pytest.raises(InputError, match="star_rate_e_s"):
        search(stack, psf, still, star_rate_e_s=0.0)
    with pytest.raises(InputError, match="sigma"):
        search(stack, psf, still, star_rate_e_s=STAR_E_S, sigma=1.0)
    small = dataclasses.replace(still, linear=np.zeros((3, 3)))
    with pytest.raises(InputError, match="maps"):
        search(stack, psf, small, star_rate_e_s=STAR_E_S)
