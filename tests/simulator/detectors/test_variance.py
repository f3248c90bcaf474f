"""The law of the variance against sums written out, reads of a charge and the weights of apertures on pixels."""

import numpy as np
import pytest

from simulator.detectors import (
    FrameTerm,
    aperture_noise_pixels,
    clean_fraction,
    frame_variance_e2,
    frames_per_clean,
    ramp_factors,
)


def test_a_stack_of_terms_is_their_sum():
    """Light, charge of every frame and noise behind a gain, in numbers and in arrays."""
    rate = np.array([[0.5], [2.0]])
    terms = [FrameTerm(rate_e_s=rate), FrameTerm(charge_e=3.0), FrameTerm(output_e2=400.0), FrameTerm(1.0, 2.0, 100.0)]
    exposure, factor2, gain = np.array([1.0, 10.0, 100.0]), 1.5, 10.0
    expected = 1.5 * ((rate + 1.0) * exposure + 5.0) + 500.0 / 100.0
    np.testing.assert_allclose(FrameTerm.total(terms).variance_e2(exposure, factor2, gain), expected, rtol=1e-14)
    each = sum(term.variance_e2(exposure, factor2, gain) for term in terms)
    np.testing.assert_allclose(each, expected, rtol=1e-14)
    assert frame_variance_e2(6.0, 2.0, 9.0, 3.0) == 13.0


@pytest.mark.parametrize("n", [2, 3, 8, 60])
def test_a_line_through_reads_has_the_noise_of_its_weights(n):
    x = np.arange(n) - (n - 1) / 2
    weights = (n - 1) * x / (x @ x)  # charge over the ramp
    shared = np.minimum.outer(np.arange(n), np.arange(n))  # charge of two reads has the light of the earlier in common
    reads, light = ramp_factors("up_the_ramp", n)
    assert reads == pytest.approx(weights @ weights, rel=1e-12)
    assert light == pytest.approx(weights @ shared @ weights / (n - 1), rel=1e-12)
    assert ramp_factors("single", n) == (1.0, 1.0)
    assert ramp_factors("cds", n) == pytest.approx(ramp_factors("up_the_ramp", 2), rel=1e-12) == (2.0, 1.0)


@pytest.mark.parametrize("radius", [1.0, 1.5, 2.32, 3.8, 8.0])
def test_aperture_noise_pixels_against_exact_weights(radius: float):
    from photutils.aperture import CircularAperture

    rng = np.random.default_rng(1)
    sums = [
        np.sum(CircularAperture(centre, radius).to_mask(method="exact").data ** 2) for centre in rng.random((400, 2))
    ]
    error = np.std(sums) / np.sqrt(400)
    assert float(aperture_noise_pixels(radius)) == pytest.approx(np.mean(sums), rel=0.02 / radius**3, abs=4 * error)


def test_aperture_noise_pixels_needs_a_resolved_circle(refused):
    refused("radius_pixel", aperture_noise_pixels, [2.0, 0.9])


def test_a_googol_of_pixels_is_the_most(refused):
    assert float(aperture_noise_pixels(1e100)) == pytest.approx(np.pi * 1e200, rel=1e-14)
    refused("to 1e\\+100", aperture_noise_pixels, float(np.nextafter(1e100, 1e101)))


def test_frames_that_no_track_touches(refused):
    """The chance of no event of a Poisson law; as many more frames are taken, and their number stays finite."""
    loss, exposure = np.array([0.0, 1e-4, 2.0]), np.array([[0.5], [300.0]])
    none = 1.0 / np.exp(np.multiply(loss, exposure))
    np.testing.assert_allclose(clean_fraction(loss, exposure), none, rtol=1e-14)
    few = np.array([0.0, 1e-4, 1.0])
    np.testing.assert_allclose(frames_per_clean(few, 300.0) * clean_fraction(few, 300.0), 1.0, rtol=1e-14)
    np.testing.assert_array_equal(frames_per_clean(np.array([2.0, 1e9]), 300.0), np.exp(600.0))
    assert clean_fraction(1e300, 1e300) == 0.0
    for bad, name in (((-1.0, 1.0), "loss_per_s"), ((1.0, np.nan), "exposure_s")):
        refused(name, clean_fraction, *bad)
