"""The stellar grid: nodes, trilinear weights, metallicity trend, surface fluxes."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from catalogs.errors import InputError
from catalogs.spectra import HC_ERG_ANGSTROM, load_stellar_grid


def _node(grid, teff: float, log_g: float, metal: float) -> int:
    it, ig, im = (int(np.flatnonzero(a == v)[0]) for a, v in
                  ((grid.teff_k, teff), (grid.log_g, log_g), (grid.metallicity, metal)))  # fmt: skip
    return (it * grid.log_g.size + ig) * grid.metallicity.size + im


def test_axes() -> None:
    grid = load_stellar_grid()
    assert (grid.teff_k[0], grid.teff_k[-1], grid.teff_k.size) == (3500.0, 8000.0, 41)
    np.testing.assert_array_equal(grid.log_g, [3.5, 4.0, 4.5, 5.0])
    np.testing.assert_array_equal(grid.metallicity, [-2.5, -2.0, -1.5, -1.0, -0.5, 0.0, 0.2, 0.5])
    assert grid.wavelength_nm[0] < 300.2
    assert grid.wavelength_nm[-1] > 1750.0
    assert grid.n_nodes == 41 * 4 * 8
    resolution = 1.0 / np.diff(np.log(grid.wavelength_nm))
    np.testing.assert_allclose(resolution, 1000.0, rtol=1e-2)


def test_corners_are_the_tensor_product_of_linear_interpolations() -> None:
    grid = load_stellar_grid()
    teff, log_g, metal = 5772.0, 4.44, 0.13
    nodes, weights = grid.corners(teff, log_g, metal)
    expected: dict[int, float] = {}
    sides = []
    for axis, value in ((grid.teff_k, teff), (grid.log_g, log_g), (grid.metallicity, metal)):
        j = int(np.searchsorted(axis, value)) - 1
        t = (value - axis[j]) / (axis[j + 1] - axis[j])
        sides.append(((axis[j], 1 - t), (axis[j + 1], t)))
    for (a, wa), (b, wb), (c, wc) in itertools.product(*sides):
        expected[_node(grid, a, b, c)] = wa * wb * wc
    assert dict(zip(nodes.tolist(), weights.tolist(), strict=True)) == pytest.approx(expected, abs=1e-15)


def test_weights_reproduce_the_coordinates_and_clamp_outside() -> None:
    grid = load_stellar_grid()
    rng = np.random.default_rng(1)
    teff, log_g, metal = rng.uniform(3000, 9000, 500), rng.uniform(1, 6, 500), rng.uniform(-4, 1, 500)
    nodes, weights = grid.corners(teff, log_g, metal)
    assert nodes.shape == weights.shape == (500, 8)
    assert weights.min() >= 0.0
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=1e-14)
    im = nodes % 8
    ig = nodes // 8 % 4
    it = nodes // 32
    np.testing.assert_allclose((weights * grid.teff_k[it]).sum(1), np.clip(teff, 3500, 8000), rtol=1e-14)
    np.testing.assert_allclose((weights * grid.log_g[ig]).sum(1), np.clip(log_g, 3.5, 5.0), rtol=1e-14)
    np.testing.assert_allclose((weights * grid.metallicity[im]).sum(1), np.clip(metal, -2.5, 0.5), atol=1e-14)
    flags = grid.flags(teff, log_g, metal)
    np.testing.assert_array_equal(flags.teff_k, (teff < 3500) | (teff > 8000))
    np.testing.assert_array_equal(flags.log_g, (log_g < 3.5) | (log_g > 5))
    np.testing.assert_array_equal(flags.metallicity, (metal < -2.5) | (metal > 0.5))
    np.testing.assert_array_equal(flags.any, flags.teff_k | flags.log_g | flags.metallicity)


def test_edges_are_inside_and_scalars_broadcast() -> None:
    grid = load_stellar_grid()
    assert not grid.flags(3500.0, 3.5, -2.5).any
    assert not grid.flags(8000.0, 5.0, 0.5).any
    nodes, weights = grid.corners(np.full((2, 3), 5000.0), 4.5, 0.0)
    assert nodes.shape == weights.shape == (2, 3, 8)


@pytest.mark.parametrize("bad", [(np.nan, 4.5, 0.0), (5000.0, np.inf, 0.0), (5000.0, 4.5, [0.0, np.nan])])
def test_non_finite_parameters_are_refused(bad) -> None:
    with pytest.raises(InputError):
        load_stellar_grid().corners(*bad)
    with pytest.raises(InputError):
        load_stellar_grid().flags(*bad)


def test_node_flux_at_solar_metallicity_is_the_stored_phoenix_flux() -> None:
    grid = load_stellar_grid()
    samples = np.arange(grid.wavelength_nm.size)
    it, ig = 23, 2
    photlam = grid.node_photlam(np.array([_node(grid, grid.teff_k[it], grid.log_g[ig], 0.0)]), samples)[0]
    expected = 10.0 ** grid.log10_flam[it, ig].astype(float) * 10.0 * grid.wavelength_nm / HC_ERG_ANGSTROM
    np.testing.assert_allclose(photlam, expected, rtol=1e-12)


def test_bolometric_scale_of_the_surface_flux() -> None:
    # 300-1750 nm holds about 85-90 per cent of sigma T^4 between 5000 and 6500 K.
    grid = load_stellar_grid()
    samples = np.arange(grid.wavelength_nm.size)
    for teff in (5000.0, 5800.0, 6500.0):
        photlam = grid.node_photlam(np.array([_node(grid, teff, 4.5, 0.0)]), samples)[0]
        energy = photlam * HC_ERG_ANGSTROM / (10.0 * grid.wavelength_nm)
        share = np.trapezoid(energy, 10.0 * grid.wavelength_nm) / (5.670374e-5 * teff**4)
        assert 0.83 < share < 0.92


def test_metallicity_trend_matches_ck04_in_the_blue() -> None:
    # CK04 5750 K, log g 4.5: B(-0.5)/B(0) = 1.029, U = 1.165, H = 0.987 (broadband values of the source).
    grid = load_stellar_grid()
    wavelengths = {359.7: 1.165, 437.7: 1.029, 1662.0: 0.987}
    samples = np.array([int(np.argmin(np.abs(grid.wavelength_nm - w))) for w in wavelengths])
    nodes = [[_node(grid, teff, 4.5, m) for m in (-0.5, 0.0)] for teff in (5700.0, 5800.0)]
    ratio = np.mean([np.divide(*grid.node_photlam(np.array(pair), samples)) for pair in nodes], axis=0)
    np.testing.assert_allclose(ratio, list(wavelengths.values()), rtol=5e-3)


def test_metal_poor_stars_are_bluer() -> None:
    grid = load_stellar_grid()
    samples = np.array([int(np.argmin(np.abs(grid.wavelength_nm - w))) for w in (440.0, 550.0)])
    for teff in (4500.0, 5500.0, 6500.0):
        colours = [np.divide(*grid.node_photlam(np.array([_node(grid, teff, 4.5, m)]), samples)[0])
                   for m in grid.metallicity[4:]]  # fmt: skip
        assert np.all(np.diff(colours) < 0.0)
