"""Law of noise with a few speckles and an estimated scale, against its closed forms, inversion and draws."""

import math

import mpmath
import numpy as np
import pytest
from scipy.stats import norm, t as student

from cpic_planner.etc import equivalent_sigma, log_tail, snr_at


@pytest.mark.parametrize("dof", [0.7, 6.0, 12.0, 80.0, 3e4])
@pytest.mark.parametrize("visits", [1.0, 16.0])
def test_without_speckles_it_is_students_law(dof, visits):
    level = np.array([0.0, 0.5, 2.0, 5.0, 9.0])
    np.testing.assert_allclose(log_tail(level, 0.0, dof, visits), student.logsf(level, dof), rtol=1e-9)
    np.testing.assert_allclose(log_tail(level, 0.0, visits=visits), norm.logsf(level), rtol=1e-12)


def test_students_tail_where_it_is_no_number():
    """Its density integrated with 30 digits, far below the least number of double precision."""
    for level, dof in ((100.0, 5e4), (60.0, 9e3), (300.0, 400.0)):
        with mpmath.workdps(30):
            half, edges = mpmath.mpf(dof + 1) / 2, [level * part for part in (1, 1.002, 1.01, 1.05, 1.2, 2, 8)]
            whole = mpmath.quad(lambda u, d=dof, h=half: mpmath.exp(-h * mpmath.log1p(u**2 / d)), edges)
            factor = mpmath.loggamma(half) - mpmath.loggamma(half - 0.5) - mpmath.log(dof * mpmath.pi) / 2
            exact = mpmath.log(whole) + factor
        assert log_tail(level, 0.0, dof)[0] == pytest.approx(float(exact), rel=1e-9)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.9])
def test_one_laplace_variate_has_the_closed_form(share):
    """Normal-Laplace law, Reed & Jorgensen 2004 (Commun. Stat. Theory Methods 33, 1733), with 60 digits."""
    for level in (0.0, 0.5, 3.0, 8.0, 20.0, 60.0):
        with mpmath.workdps(60):
            width, fall = mpmath.sqrt(1 - mpmath.mpf(share)), mpmath.sqrt(mpmath.mpf(share) / 2)
            x, y = level / width, width / fall
            right = mpmath.exp(-level / fall) * mpmath.ncdf(x - y)
            left = mpmath.exp(level / fall) * mpmath.ncdf(-x - y)
            exact = mpmath.log(mpmath.ncdf(-x) + mpmath.exp(y**2 / 2) * (right - left) / 2)
        assert log_tail(level, share)[0] == pytest.approx(float(exact), rel=1e-8)


@pytest.mark.parametrize(("visits", "share"), [(2.0, 0.8), (4.0, 0.2), (7.5, 0.5), (16.0, 0.9)])
def test_tail_is_that_of_the_characteristic_function(visits, share):
    """``1/2 - 1/pi integral of sin(t x) phi(t) / t`` (Gil-Pelaez 1951), down to 1e-12."""
    s, v = mpmath.mpf(share), mpmath.mpf(visits)

    def phi(t):
        return mpmath.exp(-(1 - s) * t**2 / 2) * (1 + s * t**2 / (2 * v)) ** -v

    for level in (1.0, 7.5):
        with mpmath.workdps(25):
            edges = mpmath.linspace(0, 14 / mpmath.sqrt(1 - s), 30)
            whole = mpmath.quad(lambda t, x=level: mpmath.sin(t * x) * phi(t) / t, edges)
            exact = mpmath.log(0.5 - whole / mpmath.pi)
        assert log_tail(level, share, visits=visits)[0] == pytest.approx(float(exact), rel=1e-8)


@pytest.mark.parametrize(("visits", "dof"), [(1, 12.0), (4, 30.0), (16, np.inf)])
def test_draws_of_laplace_variates(visits, dof):
    rng, share, n = np.random.default_rng(visits), 0.7, 500_000
    noise = rng.normal(0.0, math.sqrt(1 - share), n)
    for _ in range(visits):
        noise += rng.laplace(0.0, math.sqrt(share / (2 * visits)), n)
    scale = np.sqrt(rng.chisquare(dof, n) / dof) if np.isfinite(dof) else 1.0
    for level in (0.5, 2.0, 3.5):
        chance = math.exp(log_tail(level, share, dof, visits)[0])
        assert abs(np.mean(noise / scale > level) - chance) < 4 * math.sqrt(chance / n)


def test_many_visits_are_gaussian_and_fewer_are_heavier():
    level, visits = np.array([0.5, 3.0, 6.0]), np.array([0.5, 1.0, 1.5, 4.0, 16.0, 300.0])
    np.testing.assert_allclose(log_tail(level, 0.6, visits=1e5), norm.logsf(level), rtol=1e-3)
    np.testing.assert_array_equal(log_tail(level, 0.6, 40.0, 1e9), log_tail(level, 0.0, 40.0))
    assert (np.diff(log_tail(5.0, 0.6, visits=visits)) < 0).all()
    assert (np.diff(snr_at(5.0, 0.6, 100.0, visits)) < 0).all()


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
