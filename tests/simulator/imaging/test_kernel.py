"""Kernels between the pixels, against Gaussians whose pixel integrals are known."""

import numpy as np
import pytest
from scipy.special import erf

from simulator.imaging.kernel import centred_offsets, open_pixels, placed, shifted, unpixelled

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
    image = placed(gaussian(41), *place)
    known = np.abs(np.add.outer(np.zeros(41), centred_offsets(41)) - place[1]) < 20
    known &= (np.abs(centred_offsets(41) - place[0]) < 20)[:, None]
    np.testing.assert_allclose(image[known], gaussian(41, *place)[known], atol=1e-6)
    assert image.min() >= 0
    assert not image[~(np.abs(centred_offsets(41) - place[0]) <= 21)].any()


def test_whole_pixels_move_bit_for_bit():
    kernel = np.random.default_rng(1).uniform(size=(21, 21))
    image = placed(kernel, 4.0, -3.0)
    np.testing.assert_array_equal(image[4:, :-3], kernel[:-4, 3:])
    assert not image[:4].any()
    assert not image[:, -3:].any()
    np.testing.assert_array_equal(placed(kernel, 0.0, 0.0), kernel)
    for far in (21.0, -21.0, 1e9, -1e300):
        assert not placed(kernel, far, 0.0).any()
        assert not placed(kernel, 0.3, far).any()


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
