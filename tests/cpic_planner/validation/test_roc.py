"""Contrast limits of a residual, against closed forms."""

import numpy as np
import pytest
from cpic_planner.validation.roc import contrast_curve

from cpic_planner.etc.detection import detection_threshold
from cpic_planner.validation import RdiResult, ReducedStack, aperture_weights
from simulator import single_band_psf

SIGMA_E, STAR_E_S, TIME_S = 10.0, 1.0e9, 100.0


@pytest.fixture(scope="module")
def psf():
    return single_band_psf("F520", fidelity="quick")


def white(psf, seed):
    hole = psf.metrics.hole
    image = np.where(hole, SIGMA_E * np.random.default_rng(seed).standard_normal(hole.shape), 0.0)
    rdi = RdiResult(image[None], 0, 0, False, "temporal", hole, np.zeros((0, int(hole.sum()))), np.zeros(0))
    variance = np.where(hole, SIGMA_E**2, 0.0)
    return ReducedStack(image, hole, variance, np.zeros(hole.shape), rdi, TIME_S, 300.0, 604)


def test_limit_is_threshold_times_noise_over_throughput(psf):
    place = [0.45, 0.6, 0.75]
    curves = [contrast_curve(white(psf, k), psf, star_rate_e_s=STAR_E_S, separations_arcsec=place) for k in range(40)]
    radius = psf.metrics.aperture_radius_arcsec / psf.metrics.pixel_scale_arcsec
    sigma = SIGMA_E * np.sqrt(np.sum(aperture_weights((21, 21), 10, 10, radius) ** 2))
    measured = np.sqrt(np.mean([curve.sigma_e**2 for curve in curves], axis=0))
    np.testing.assert_allclose(measured, sigma, rtol=0.05)
    for column, separation in enumerate(place):
        elements = float(psf.metrics.resolution_elements(separation))
        core = float(psf.metrics.core_throughput(separation / np.sqrt(2), separation / np.sqrt(2)))
        expected = detection_threshold(elements).unwrap() * sigma / (core * STAR_E_S * TIME_S)
        assert np.mean([curve.contrast[column] for curve in curves]) == pytest.approx(expected, rel=0.06)


def test_default_separations_span_the_hole_and_limits_are_typed(psf):
    curve = contrast_curve(white(psf, 1), psf, star_rate_e_s=STAR_E_S)
    assert curve.separation_arcsec[0] > psf.metrics.hole_inner_corner_arcsec
    assert curve.separation_arcsec[-1] < psf.metrics.owa_arcsec
    assert not np.isnan(curve.contrast).any()
    assert np.isfinite(curve.contrast).sum() > 15
    outside = contrast_curve(white(psf, 1), psf, star_rate_e_s=STAR_E_S, separations_arcsec=[0.02, 3.0])
    assert np.isinf(outside.contrast).all()


def test_a_lower_level_goes_deeper(psf):
    three, five = (contrast_curve(white(psf, 2), psf, star_rate_e_s=STAR_E_S, sigma=level) for level in (3.0, 5.0))
    there = np.isfinite(five.contrast)
    assert (three.contrast[there] < five.contrast[there]).all()


@pytest.mark.parametrize(
    ("settings", "key"),
    [({"star_rate_e_s": 0.0}, "star_rate_e_s"), ({"star_rate_e_s": 1e9, "separations_arcsec": [-1.0]}, "separations")],
)
def test_bad_input_is_named(refused, psf, settings, key):
    refused(key, contrast_curve, white(psf, 3), psf, **settings)
