"""Injection and recovery in white noise."""

import math

import numpy as np
import pytest
from cpic_planner.validation.roc import roc_curve

from cpic_planner.validation import CompletenessMap, RdiResult, ReducedStack
from cpic_planner.validation.injection import completeness_map, inject
from cpic_planner.validation.speckle_maps import filter_kernel, speckle_maps
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
def unit(psf):
    """Contrast of SNR 1 in the matched filter."""
    return SIGMA_E / math.sqrt(float(np.sum(filter_kernel(psf) ** 2))) / (STAR_E_S * TIME_S)


def white(psf, seed):
    hole = psf.metrics.hole
    image = np.where(hole, SIGMA_E * np.random.default_rng(seed).standard_normal(hole.shape), 0.0)
    modes = np.linalg.qr(np.random.default_rng(99).standard_normal((int(hole.sum()), 1)))[0].T
    rdi = RdiResult(image[None], 1, 1, False, "temporal", hole, modes, np.ones(1))
    variance = np.where(hole, SIGMA_E**2, 0.0)
    return ReducedStack(image, hole, variance, np.zeros(hole.shape), rdi, TIME_S, 300.0, 604)


def test_injected_light_has_the_mean_and_the_noise_of_its_photons(psf):
    stack = white(psf, 0)
    light = np.where(stack.region, 5000.0 * psf.at(0.4, 0.42), 0.0)
    np.testing.assert_allclose(inject(stack, psf, 0.4, 0.42, 5000.0).image_e - stack.image_e, stack.rdi.project(light))
    rng = np.random.default_rng(1)
    draws = [(inject(stack, psf, 0.4, 0.42, 5000.0, rng).image_e - stack.image_e).sum() for _ in range(200)]
    factor2 = float(excess_noise_factor2(300.0, 604))
    assert np.mean(draws) == pytest.approx(stack.rdi.project(light).sum(), rel=0.02)
    assert np.var(draws) == pytest.approx(factor2 * light.sum(), rel=0.45)


def test_bright_planets_are_recovered_and_faint_ones_are_not(psf, maps, unit):
    stacks = [white(psf, seed) for seed in range(6)]
    settings = {"star_rate_e_s": STAR_E_S, "separations_arcsec": [0.55, 0.7], "contrasts": unit * np.array([0.5, 20.0])}
    found = completeness_map(stacks, psf, maps, seed=3, **settings)
    np.testing.assert_array_equal(found.fraction, [[0.0, 1.0], [0.0, 1.0]])
    again = completeness_map(stacks, psf, maps, seed=3, **settings)
    np.testing.assert_array_equal(found.n_recovered, again.n_recovered)
    assert ((found.contrast_at(0.5) > 0.5 * unit) & (found.contrast_at(0.5) < 20 * unit)).all()


def test_contour_of_a_known_curve(refused):
    contrast = np.geomspace(1e-9, 1e-7, 9)
    chance = 1 / (1 + (1e-8 / contrast) ** 4)
    hits = np.random.default_rng(2).binomial(400, chance, (3, 9))
    found = CompletenessMap(np.array([0.4, 0.5, 0.6]), contrast, hits, 400, 5.0)
    np.testing.assert_allclose(found.contrast_at(0.5), 1e-8, rtol=0.06)
    np.testing.assert_allclose(found.contrast_at(0.9), 1e-8 * 9**0.25, rtol=0.08)
    none = CompletenessMap(np.array([0.4]), contrast, np.zeros((1, 9), int), 400, 5.0)
    assert np.isinf(none.contrast_at()).all()
    assert none.error == pytest.approx(np.full((1, 9), 1 / 401), rel=0.02)
    refused("fraction", none.contrast_at, 1.0)


def test_roc_of_a_middling_planet(psf, maps, unit):
    stacks = [white(psf, seed) for seed in range(16)]
    settings = {"star_rate_e_s": STAR_E_S, "separation_arcsec": 0.65, "seed": 4}
    matched = roc_curve(stacks, psf, maps, contrast=5 * unit, **settings)
    aperture = roc_curve(stacks, psf, speckle_maps(psf, STILL, kernel="aperture"), contrast=5 * unit, **settings)
    for curve in (matched, aperture):
        assert (np.diff(curve.detection_probability) <= 0).all()
        assert (np.diff(curve.false_alarm_rate) <= 0).all()
        assert (curve.detection_error > 0).all()
        assert (curve.false_alarm_error > 0).all()
        assert curve.n_elements == pytest.approx(
            16 * psf.metrics.hole.sum() * (psf.metrics.pixel_scale_arcsec / psf.metrics.lambda_d_arcsec) ** 2
        )
    level = int(np.searchsorted(matched.level, 4.0))
    assert 0.4 < matched.detection_probability[level] <= 1.0
    # In white noise the filters differ by a few per cent in SNR.
    apart = abs(matched.detection_probability[level] - aperture.detection_probability[level])
    assert apart < 3.0 * matched.detection_error[level]
    bright = roc_curve(stacks[:3], psf, maps, contrast=30 * unit, **settings)
    assert (bright.detection_probability == 1.0).all()


@pytest.mark.parametrize(
    ("change", "key"),
    [({"contrasts": [1e-8, 1e-9]}, "contrasts"), ({"separations_arcsec": [0.01]}, "separations_arcsec")],
)
def test_bad_grids_are_named(refused, psf, maps, change, key):
    settings = {"star_rate_e_s": STAR_E_S, "separations_arcsec": [0.6], "contrasts": [1e-8]} | change
    refused(key, completeness_map, [white(psf, 0)], psf, maps, **settings)


def test_nothing_to_search_is_refused(refused, psf, maps):
    settings = {"star_rate_e_s": STAR_E_S, "separation_arcsec": 0.6, "contrast": 1e-8}
    refused("stacks", roc_curve, [], psf, maps, **settings)
    refused("levels", roc_curve, [white(psf, 0)], psf, maps, levels=[1.0, 2.0], **settings)
    refused("total_e", inject, white(psf, 0), psf, 0.4, 0.4, -1.0)
    refused("stacks", completeness_map, [], psf, maps, star_rate_e_s=1.0, separations_arcsec=[0.6], contrasts=[1e-8])
