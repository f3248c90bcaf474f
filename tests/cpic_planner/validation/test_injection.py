"""Planets put into residuals, what blind searches find of them in white noise, and fractions of trials."""

import math

import numpy as np
import pytest
from scipy.stats import beta, norm

from cpic_planner.validation import INTERVAL, RdiResult, ReducedStack, azimuth_share, fraction_interval
from cpic_planner.validation.injection import draw_place, inject, recovered
from cpic_planner.validation.search import filter_kernel, search, speckle_maps
from simulator import single_band_psf
from simulator.config import Drift
from simulator.detectors import excess_noise_factor2

SIGMA_E, STAR_E_S, TIME_S = 10.0, 1.0e9, 100.0
STILL = Drift(visit_nm=0.0, walk_nm_per_sqrt_hour=0.0, psd_slope=2.5)


@pytest.fixture(scope="module")
def psf():
    return single_band_psf("F850", fidelity="quick")


@pytest.fixture(scope="module")
def maps(psf):
    return speckle_maps(psf, STILL)


@pytest.fixture(scope="module")
def unit_e(psf):
    """Light of SNR 1 in the matched filter."""
    return SIGMA_E / math.sqrt(float(np.sum(filter_kernel(psf) ** 2)))


def white(psf, seed):
    hole = psf.metrics.hole
    image = np.where(hole, SIGMA_E * np.random.default_rng(seed).standard_normal(hole.shape), 0.0)
    modes = np.linalg.qr(np.random.default_rng(99).standard_normal((int(hole.sum()), 1)))[0].T
    rdi = RdiResult(image[None], 1, False, "temporal", hole, modes, np.ones(1))
    variance = np.where(hole, SIGMA_E**2, 0.0)
    return ReducedStack(
        image, hole, variance, np.zeros(hole.shape), rdi, TIME_S, float(excess_noise_factor2(300.0, 604))
    )


def test_injected_light_has_the_mean_and_the_noise_of_its_photons(psf, refused):
    stack, image = white(psf, 0), psf.at(0.4, 0.42)
    light = np.where(stack.region, 5000.0 * image, 0.0)
    np.testing.assert_allclose(inject(stack, image, 5000.0).image_e - stack.image_e, stack.rdi.project(light))
    rng = np.random.default_rng(1)
    draws = [(inject(stack, image, 5000.0, rng).image_e - stack.image_e).sum() for _ in range(200)]
    factor2 = float(excess_noise_factor2(300.0, 604))
    assert np.mean(draws) == pytest.approx(stack.rdi.project(light).sum(), rel=0.02)
    assert np.var(draws) == pytest.approx(factor2 * light.sum(), rel=0.45)
    refused("total_e", inject, stack, image, -1.0)


def test_in_white_noise_a_search_has_the_alarms_and_the_detections_of_the_normal_law(psf, maps, unit_e):
    """Peaks of noise as many as the tail says, planets as often as a normal variate around their SNR passes the level.

    The search takes the highest pixel near a planet: its level lies within 0.35 of the SNR at the place alone.
    """
    n, snr, place = 20, 5.5, (0.4, 0.42)
    image, alarms, seen, elements = psf.at(*place), [], [], 0.0
    for seed in range(n):
        stack = white(psf, seed)
        empty = search(stack, psf, maps, star_rate_e_s=STAR_E_S)
        elements += empty.region.n_elements
        alarms += [one.false_alarms for one in empty.candidates]
        found = search(inject(stack, image, snr * unit_e), psf, maps, star_rate_e_s=STAR_E_S)
        best = recovered(found, *place, psf.geometry.lambda_d_arcsec)
        seen.append(math.inf if best is None else best.false_alarms)
    expected = elements * norm.sf(3.0)
    counted = int((np.array(alarms) <= elements / n * norm.sf(3.0)).sum())
    assert abs(counted - expected) < 4.0 * math.sqrt(expected)
    level = found.threshold.unwrap()
    hits = int((np.array(seen) <= elements / n * norm.sf(5.0)).sum())
    low, high = (norm.sf(level - snr - off) for off in (-0.35, 0.35))
    spread = 4.0 * math.sqrt(0.25 / n)
    assert low - spread < hits / n < high + spread


@pytest.mark.parametrize(("hits", "trials"), [(0, 5), (1, 5), (3, 12), (12, 12), (50, 100)])
def test_intervals_of_fractions_are_those_of_jeffreys(hits, trials):
    low, high = (float(end) for end in fraction_interval(hits, trials))
    tail = 0.5 * (1.0 - INTERVAL)
    law = beta(hits + 0.5, trials - hits + 0.5)
    assert low == (0.0 if hits == 0 else pytest.approx(law.ppf(tail), rel=1e-9))
    assert high == (1.0 if hits == trials else pytest.approx(law.isf(tail), rel=1e-9))
    assert low <= hits / trials <= high


def test_intervals_hold_the_truth_as_often_as_they_say():
    """Over many trials of many probabilities, near the stated share (Brown, Cai & DasGupta 2001)."""
    rng = np.random.default_rng(3)
    truth = rng.uniform(0.02, 0.98, 20_000)
    low, high = fraction_interval(rng.binomial(40, truth), 40)
    assert ((low <= truth) & (truth <= high)).mean() == pytest.approx(INTERVAL, abs=0.015)


def test_drawn_places_lie_in_the_hole_with_their_aperture_and_everywhere_there(psf):
    geometry, rng = psf.geometry, np.random.default_rng(2)
    zone, radius = geometry.zone, geometry.aperture_radius_arcsec
    places = np.array([draw_place(geometry, 0.6, rng) for _ in range(2000)])
    np.testing.assert_allclose(np.hypot(*places.T), 0.6)
    assert np.abs(places).min() >= zone.inner_arcsec + radius - 1e-6
    assert np.abs(places).max() <= zone.outer_arcsec - radius + 1e-6
    quadrants = [np.mean((places * signs > 0).all(axis=1)) for signs in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    np.testing.assert_allclose(quadrants, 0.25, atol=0.05)
    assert 0.0 < azimuth_share(geometry, 0.6) < zone.azimuth_fraction(0.6)
    assert draw_place(geometry, 0.05, rng) is None
    assert azimuth_share(geometry, 0.05) == 0.0
