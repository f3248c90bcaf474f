"""Tails of Gaussian noise with speckles, against numerical convolution and the laws they contain."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm
from scipy.stats import t as student

from cpic_planner.validation.noise_law import equivalent_sigma, log_tail, snr_at


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
