"""Reflection of a gas layer over a deck: limits in closed form, a numerical two-stream, and exact transfer."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, solve_bvp
from scipy.special import expn

from simulator.target.reflection import layer_albedo, rayleigh_slope

POINTS, WEIGHTS = np.polynomial.legendre.leggauss(8)
MU, WEIGHTS = 0.5 * (POINTS + 1.0), 0.5 * WEIGHTS


def test_without_gas_the_deck_is_a_lambert_surface():
    assert layer_albedo(0.0, 0.0, 0.6) == pytest.approx(2.0 / 3.0 * 0.6, rel=1e-9)
    assert layer_albedo(0.0, 0.0, 0.6, backscatter=1.15) == pytest.approx(1.15 * 0.4, rel=1e-9)


@pytest.mark.parametrize("depth", [0.01, 0.2, 1.0, 3.0])
def test_pure_absorption_is_an_exponential_integral(depth):
    # 2 pi x integral of d m exp(-2 t / m) / pi x m dm = 2 d E_4(2 t)
    assert layer_albedo(0.0, depth, 0.9) == pytest.approx(2.0 * 0.9 * expn(4, 2.0 * depth), rel=6e-6)


@pytest.mark.parametrize("depth", [0.1, 1.0, 10.0])
def test_weak_scattering_is_single_scattering(depth):
    single = 1e-6
    exact = 3.0 / 8.0 * single * (0.5 - expn(3, 2.0 * depth))
    assert layer_albedo(single * depth, (1.0 - single) * depth, 0.0) == pytest.approx(exact, rel=2e-3)


@settings(max_examples=25, deadline=None)
@given(depth=st.floats(0.05, 6.0), single=st.floats(0.01, 0.999), deck=st.floats(0.0, 1.0))
def test_closed_form_solves_the_two_stream_equations(depth, single, deck):
    """The boundary-value problem solved numerically, then the path integral by quadrature."""
    total = 0.0
    for mu, weight in zip(MU, WEIGHTS, strict=True):

        def slopes(x, y, mu=mu):
            return np.stack([2.0 * y[1], 2.0 * (1.0 - single) * y[0] - single * np.exp(-x / mu)])

        def ends(top, bottom, mu=mu):
            down = 0.5 * (bottom[0] - bottom[1]) + mu * np.exp(-depth / mu)
            return np.array([top[0] - top[1], 0.5 * (bottom[0] + bottom[1]) - deck * down])

        x = np.linspace(0.0, depth, 60)
        field = solve_bvp(slopes, ends, x, np.ones((2, x.size)), tol=1e-9, max_nodes=20000)
        assert field.success

        def source(x, mu=mu, field=field):
            beam = np.exp(-x / mu)
            return (single * field.sol(x)[0] / (2 * np.pi) + single * 1.5 * beam / (4 * np.pi)) * beam / mu

        s, d = field.sol(depth)
        surface = deck * (0.5 * (s - d) + mu * np.exp(-depth / mu)) / np.pi * np.exp(-depth / mu)
        total += weight * mu * (quad(source, 0.0, depth, limit=200)[0] + surface)
    closed = layer_albedo(single * depth, (1.0 - single) * depth, deck)
    assert closed == pytest.approx(2.0 * np.pi * total, rel=1e-6, abs=1e-9)


def exact_albedo(depth, single, deck, cells=300):
    """Isotropic scattering (Rayleigh at first) over a Lambert surface by the integral equation of transfer."""
    edges = depth * 0.5 * (1.0 - np.cos(np.pi * np.arange(cells + 1) / cells))
    middle = 0.5 * (edges[1:] + edges[:-1])
    below, above = np.abs(middle[:, None] - edges[None, :-1]), np.abs(edges[None, 1:] - middle[:, None])
    e2_below, e2_above = expn(2, below), expn(2, above)
    # Integral of E_1 over each cell, also over the cell that holds the point.
    kernel = np.where(np.eye(cells, dtype=bool), 2.0 - e2_below - e2_above, np.abs(e2_below - e2_above))
    down_weights = expn(3, depth - edges[1:]) - expn(3, depth - edges[:-1])
    total = 0.0
    for mu, weight in zip(MU, WEIGHTS, strict=True):
        beam = np.exp(-middle / mu)
        from_surface = single / 2.0 * expn(2, depth - middle)
        matrix = np.eye(cells) - single / 2.0 * kernel
        matrix -= np.outer(from_surface, deck / np.pi * 2.0 * np.pi * down_weights)
        direct = deck / np.pi * mu * np.exp(-depth / mu)
        source = np.linalg.solve(matrix, single / (4.0 * np.pi) * beam + from_surface * direct)
        surface = direct + deck / np.pi * 2.0 * np.pi * down_weights @ source
        path = np.exp(-edges[:-1] / mu) - np.exp(-edges[1:] / mu)
        first = single * 0.5 / (4.0 * np.pi) * 0.5 * (1.0 - np.exp(-2.0 * depth / mu))
        total += weight * mu * (path @ source + first + surface * np.exp(-depth / mu))
    return 2.0 * np.pi * total


def test_two_streams_stay_near_exact_transfer():
    cases = list(itertools.product([0.05, 0.3, 0.6, 1.0, 4.0, 20.0], [0.1, 0.6, 0.95, 0.9999], [0.0, 0.5, 0.95]))
    exact = np.array([exact_albedo(*case) for case in cases])
    depth, single, deck = np.array(cases).T
    ratio = layer_albedo(single * depth, (1.0 - single) * depth, deck) / exact
    # What the docstring promises.
    assert np.max(np.abs(ratio - 1.0) * exact) < 0.03
    assert np.max(np.abs(ratio - 1.0)) < 0.095
    assert np.sqrt(np.mean((ratio - 1.0) ** 2)) < 0.031


def test_exact_transfer_of_the_test_is_the_known_half_space():
    # Conservative isotropic half-space: A_g = 0.6896 (Chandrasekhar's H function), without the Rayleigh extra.
    extra = 2.0 * np.pi * np.sum(WEIGHTS * MU) * 0.5 / (4.0 * np.pi) * 0.5
    assert exact_albedo(2000.0, 1.0 - 1e-9, 0.0) - extra == pytest.approx(0.6896, abs=2e-3)


@settings(max_examples=200, deadline=None)
@given(
    scattering=st.floats(1e-9, 1e4),
    absorption=st.floats(0.0, 1e4),
    deck=st.floats(0.0, 1.0),
    more=st.floats(1e-3, 10.0),
)
def test_more_absorption_is_darker_and_nothing_shines(scattering, absorption, deck, more):
    here = float(layer_albedo(scattering, absorption, deck))
    there = float(layer_albedo(scattering, absorption + more, deck))
    assert 0.0 <= there <= here + 1e-6
    assert here <= 0.78


@pytest.mark.parametrize("mu_decay", [1.0, 1.0 + 1e-9, 1.0 - 1e-5])
def test_nothing_happens_at_the_resonance(mu_decay):
    single = 1.0 - (mu_decay / MU[-2] / 2.0) ** 2
    around = [float(layer_albedo(s, 1.0 - s, 0.5)) for s in (single - 1e-3, single, single + 1e-3)]
    assert around[0] < around[1] < around[2]
    assert around[1] == pytest.approx(0.5 * (around[0] + around[2]), rel=2e-5)


def test_rayleigh_slope_is_near_the_inverse_fourth_power():
    assert rayleigh_slope(550.0) == 1.0
    # The leading term alone at long wavelengths.
    assert rayleigh_slope(5000.0) / rayleigh_slope(10000.0) == pytest.approx(16.0, rel=2e-3)
    assert rayleigh_slope(400.0) == pytest.approx((550.0 / 400.0) ** 4.09, rel=0.03)
