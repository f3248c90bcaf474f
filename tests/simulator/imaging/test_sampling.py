"""Kernels between the pixels, against Gaussians whose pixel integrals are known."""

import itertools
import math

import mpmath
import numpy as np
import pytest
from scipy.special import erf

from simulator.imaging import centred_axis, pixel_axis
from simulator.imaging.sampling import box_gauss_rule, displaced, integrate_pixels, open_pixels, shifted, unpixelled


def moment(order, width, sigma):
    """Central moment of a box convolved with a normal density, from the moments of both."""
    total = 0.0
    for j in range(0, order + 1, 2):
        rest = order - j
        if rest % 2 == 0:
            normal = sigma**rest * math.prod(range(rest - 1, 0, -2))
            total += math.comb(order, j) * (width / 2) ** j / (j + 1) * normal
    return total


@pytest.mark.parametrize("n_nodes", range(1, 9))
@pytest.mark.parametrize(("width", "sigma"), [(1.0, 0.0), (1.0, 0.02), (1.0, 0.31), (0.3, 2.0), (1e-6, 0.31)])
def test_rule_has_the_moments_of_box_and_normal(n_nodes, width, sigma):
    nodes, weights = box_gauss_rule(n_nodes, width, sigma)
    assert nodes.shape == weights.shape == (n_nodes,)
    assert (weights > 0).all()
    assert weights.sum() == pytest.approx(1.0, rel=1e-13)
    assert np.all(np.diff(nodes) > 0)
    scale = math.hypot(width, sigma)
    np.testing.assert_allclose(nodes, -nodes[::-1], atol=1e-13 * scale)
    for order in range(2, 2 * n_nodes, 2):
        assert weights @ nodes**order == pytest.approx(moment(order, width, sigma), rel=1e-11)


@pytest.mark.parametrize("n_nodes", range(1, 9))
def test_without_jitter_it_is_gauss_legendre_and_with_little_width_gauss_hermite(n_nodes):
    nodes, weights = box_gauss_rule(n_nodes, 0.8, 0.0)
    expected = np.polynomial.legendre.leggauss(n_nodes)
    np.testing.assert_allclose(nodes, 0.4 * expected[0], atol=1e-14)
    np.testing.assert_allclose(weights, 0.5 * expected[1], rtol=1e-12)
    nodes, weights = box_gauss_rule(n_nodes, 1e-9, 0.8)
    normal, masses = np.polynomial.hermite_e.hermegauss(n_nodes)
    np.testing.assert_allclose(nodes, 0.8 * normal, atol=1e-12)
    np.testing.assert_allclose(weights, masses / masses.sum(), rtol=1e-10)


def test_moments_are_those_of_the_density():
    # The density itself: (Phi((x + w/2)/sigma) - Phi((x - w/2)/sigma)) / w.
    width, sigma = mpmath.mpf("0.7"), mpmath.mpf("0.2")

    def density(x):
        return (mpmath.ncdf((x + width / 2) / sigma) - mpmath.ncdf((x - width / 2) / sigma)) / width

    for order in (0, 2, 6):
        exact = mpmath.quad(lambda x, order=order: x**order * density(x), mpmath.linspace(-4, 4, 9))
        assert moment(order, 0.7, 0.2) == pytest.approx(float(exact), rel=1e-12)


def test_waves_converge_geometrically():
    # A band-limited image is a sum of waves; box and normal multiply each by sinc and exponential.
    width, sigma = 0.0162, 0.005
    for wavenumber in (50.0, 120.0):
        exact = np.sinc(wavenumber * width / 2 / np.pi) * np.exp(-((wavenumber * sigma) ** 2) / 2)
        errors = []
        for n in range(1, 9):
            nodes, weights = box_gauss_rule(n, width, sigma)
            errors.append(abs(weights @ np.cos(wavenumber * nodes) - exact))
        assert all(after < 0.1 * before for before, after in itertools.pairwise(errors[:6]))
        assert errors[-1] < 1e-10


def test_axis_covers_the_open_part_of_every_pixel():
    centres = centred_axis(41, 1.0)
    for jitter in (0.0, 0.3):
        for half_width in (0.0, 0.2, 0.5, 3.3, 9.6, 30.0):
            axis = pixel_axis(centres, 1.0, 3, half_width, jitter)
            low, high = np.abs(centres) - 0.5, np.abs(centres) + 0.5
            expected = np.where(
                low < 0, np.clip(1 - 2 * half_width, 0, 1), np.clip(high - np.maximum(low, half_width), 0, 1)
            )
            np.testing.assert_allclose(axis.open_fraction, expected, atol=1e-12)
            assert axis.n_pixels == 41
            if half_width and not jitter:
                assert (np.abs(axis.nodes_arcsec) > half_width).all()


def test_jitter_takes_nodes_beyond_the_pixel_and_behind_the_bar():
    centres = centred_axis(21, 1.0)
    nodes = pixel_axis(centres, 1.0, 5, 3.2, 0.4).nodes_arcsec
    assert np.abs(nodes).min() < 3.2
    assert nodes.max() > 10.5
    # A pixel's mean of x^2 is x0^2 + 1/12, and the pointing adds its variance.
    axis = pixel_axis(centres, 1.0, 3, 0.0, 0.4)
    values = np.add.outer(axis.nodes_arcsec**2, np.zeros(axis.nodes_arcsec.size))
    image = integrate_pixels(values, axis, axis)
    np.testing.assert_allclose(image, np.add.outer(centres**2 + 1 / 12 + 0.16, np.zeros(21)), rtol=1e-12)


def test_cut_pixels_are_integrated_over_their_open_part():
    centres = centred_axis(9, 1.0)
    axis = pixel_axis(centres, 1.0, 3, 2.3)
    values = np.outer(axis.nodes_arcsec**4, np.ones(axis.nodes_arcsec.size))
    image = integrate_pixels(values, axis, axis)
    column = axis.open_fraction
    assert image[6, 8] == pytest.approx((2.5**5 - 2.3**5) / 5 * column[8], rel=1e-13)
    assert image[2, 0] == pytest.approx((2.5**5 - 2.3**5) / 5 * column[0], rel=1e-13)
    assert image[7, 8] == pytest.approx((3.5**5 - 2.5**5) / 5, rel=1e-13)
    assert not image[3:6].any()
    # A bar thinner than its pixel leaves two open parts of one pixel.
    thin = pixel_axis(centres, 1.0, 3, 0.1)
    square = integrate_pixels(np.outer(thin.nodes_arcsec**2, np.ones(thin.nodes_arcsec.size)), thin, thin)
    assert square[4, 8] == pytest.approx(2 * (0.5**3 - 0.1**3) / 3, rel=1e-13)


def test_integration_is_exact_for_polynomials_and_shapes():
    centres = centred_axis(5, 0.5, 1.0)
    axis = pixel_axis(centres, 0.5, 2)
    values = np.stack([np.add.outer(axis.nodes_arcsec**3, axis.nodes_arcsec**2)] * 2)
    image = integrate_pixels(values, axis, axis)
    low, high = centres - 0.25, centres + 0.25
    cubic, square = (high**4 - low**4) / 4 / 0.5, (high**3 - low**3) / 3 / 0.5
    np.testing.assert_allclose(image, np.stack([np.add.outer(cubic, square)] * 2), rtol=1e-13)
    closed = pixel_axis(centres, 0.5, 2, 10.0)
    assert not closed.open_fraction.any()
    assert not integrate_pixels(np.zeros((0, axis.nodes_arcsec.size)), closed, axis).any()


SIGMA = 1.6


def gaussian(n, y=0.0, x=0.0, sigma=SIGMA):
    """Energy of a unit Gaussian in every pixel."""
    edges = np.arange(n + 1) - n // 2 - 0.5
    rows, columns = (np.diff(erf((edges - at) / (sigma * np.sqrt(2)))) / 2 for at in (y, x))
    return np.outer(rows, columns)


@pytest.mark.parametrize("place", [(0.3, -0.45), (0.5, 0.5), (-0.01, 0.0)])
def test_shift_is_exact_for_what_the_pixels_sample(place):
    np.testing.assert_allclose(shifted(gaussian(41), *place), gaussian(41, *place), atol=1e-6)


@pytest.mark.parametrize("place", [(3.3, -7.45), (0.0, 11.5), (-18.2, 19.9)])
def test_placing_adds_whole_pixels(place):
    image = displaced(gaussian(41), *place)
    known = np.abs(np.add.outer(np.zeros(41), centred_axis(41)) - place[1]) < 20
    known &= (np.abs(centred_axis(41) - place[0]) < 20)[:, None]
    np.testing.assert_allclose(image[known], gaussian(41, *place)[known], atol=1e-6)
    assert image.min() >= 0
    assert not image[~(np.abs(centred_axis(41) - place[0]) <= 21)].any()


def test_whole_pixels_move_bit_for_bit():
    kernel = np.random.default_rng(1).uniform(size=(21, 21))
    image = displaced(kernel, 4.0, -3.0)
    np.testing.assert_array_equal(image[4:, :-3], kernel[:-4, 3:])
    assert not image[:4].any()
    assert not image[:, -3:].any()
    np.testing.assert_array_equal(displaced(kernel, 0.0, 0.0), kernel)
    for far in (21.0, -21.0, 1e9, -1e300):
        assert not displaced(kernel, far, 0.0).any()
        assert not displaced(kernel, 0.3, far).any()


def test_an_edge_that_is_cut_off_does_not_ring():
    # Wings of 1e-3 of the peak at the edge, as a bright stamp has.
    kernel = gaussian(41) + 1e-3 * gaussian(41, sigma=40.0) / gaussian(41, sigma=40.0).max() * gaussian(41).max()
    exact = (
        gaussian(41, 0.4, 0.3)
        + 1e-3 * gaussian(41, 0.4, 0.3, 40.0) / gaussian(41, sigma=40.0).max() * gaussian(41).max()
    )
    error = np.abs(shifted(kernel, 0.4, 0.3) - exact) / kernel.max()
    assert error[3:-3, 3:-3].max() < 1e-5
    assert error.max() < 1e-4  # on the cut edge itself


def test_light_within_pixels_without_the_pixels():
    offset = np.linspace(-6, 6, 61)
    found = unpixelled(gaussian(41), offset)
    r2 = np.add.outer(offset**2, offset**2)
    np.testing.assert_allclose(found, np.exp(-r2 / 2 / SIGMA**2) / (2 * np.pi * SIGMA**2), atol=2e-6)
    beyond = unpixelled(gaussian(9), np.array([-5.0, 0.0, 4.4, 4.6]))
    assert not beyond[[0, 3]].any()
    assert not beyond[:, [0, 3]].any()


def test_open_pixels_are_areas():
    # The bar covers the centre pixel, one on either side, and 0.8 of the next.
    part = np.concatenate([np.ones(8), [0.2, 0, 0, 0, 0.2], np.ones(8)])
    np.testing.assert_allclose(open_pixels(21, 0.1, 0.23), np.outer(part, part), atol=1e-12)
    np.testing.assert_array_equal(open_pixels(5, 0.1, 0.0), np.ones((5, 5)))
