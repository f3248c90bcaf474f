"""Landau's law against its integral form and published numbers."""

import numpy as np
import pytest

from simulator.effects.landau import cut_landau, cut_landau_mean

CUT = 65.0


def survival(x):
    """P(lambda > x) from the Laplace form of the law, by Gauss-Legendre quadrature in panels."""
    nodes, weights = np.polynomial.legendre.leggauss(20)
    edges = np.linspace(0.0, 70.0, 351)
    t = (edges[:-1, None] + np.diff(edges)[:, None] * 0.5 * (1.0 + nodes)).ravel()
    measure = (np.diff(edges)[:, None] * 0.5 * weights).ravel() * np.sin(np.pi * t) / (np.pi * t)
    return np.exp(-t * np.log(t) - np.multiply.outer(np.asarray(x, dtype=float), t)) @ measure


def test_oracle_is_landaus_law():
    # Published: median 1.3558, most probable value -0.2228.
    assert survival(1.3557804) == pytest.approx(0.5, abs=1e-6)
    x = np.linspace(-0.6, 0.2, 401)
    density = -np.gradient(survival(x), x)
    assert x[density.argmax()] == pytest.approx(-0.2228, abs=0.005)


@pytest.mark.parametrize("x", [-2.0, -1.0, 0.0, 1.3557804, 5.0, 20.0, 50.0])
def test_draws_follow_the_law(x):
    n = 400_000
    draws = cut_landau(n, CUT, np.random.default_rng(3))
    expected = 1.0 - (survival(x) - survival(CUT)) / (1.0 - survival(CUT))
    assert abs((draws <= x).mean() - expected) < 4.5 * np.sqrt(expected * (1.0 - expected) / n)


def test_draws_stay_below_the_cut_and_are_finite():
    draws = cut_landau(1_000_000, 3.0, np.random.default_rng(4))
    assert np.isfinite(draws).all()
    assert draws.max() <= 3.0
    assert draws.min() > -5.0


@pytest.mark.parametrize("cut", [1.0, 10.0, 65.0, 200.0])
def test_mean_of_the_cut_law(cut):
    # Integration by parts: E = cut - integral(F) / F(cut); F is below 1e-9 at -4.
    nodes, weights = np.polynomial.legendre.leggauss(20)
    edges = np.linspace(-4.0, cut, 60)
    x = edges[:-1, None] + np.diff(edges)[:, None] * 0.5 * (1.0 + nodes)
    area = float(np.sum(np.diff(edges)[:, None] * 0.5 * weights * (1.0 - survival(x))))
    assert cut_landau_mean(cut) == pytest.approx(cut - area / (1.0 - survival(cut)), abs=1e-6)


def test_mean_grows_as_the_logarithm_of_the_cut():
    # The tail is 1 / lambda^2: E = ln(cut) - (1 - Euler's constant) + O(ln(cut) / cut).
    assert cut_landau_mean(600.0) == pytest.approx(
        np.log(600.0) - 1.0 + np.euler_gamma, abs=1.5 * np.log(600.0) / 600.0
    )


def test_mean_is_that_of_the_draws():
    draws = cut_landau(1_000_000, CUT, np.random.default_rng(5))
    assert abs(draws.mean() - cut_landau_mean(CUT)) < 4.5 * draws.std() / 1000.0
