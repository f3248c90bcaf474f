"""Shipped spectra: known absolute values, read-only arrays, deterministic files.

The stellar grid: nodes, trilinear weights, metallicity trend, surface fluxes.
"""

import hashlib
import itertools
import json
from pathlib import Path

import numpy as np
import pytest

import catalogs.spectra as spectra
from catalogs import HC_ERG_ANGSTROM, bracket, load_stellar_grid

DATA = Path(spectra.__file__).parent / "data"
FILES = ("stellar_grid.npz", "pickles.npz", "reference_spectra.npz", "albedo.npz", "zodiacal_light.npz")


def test_files_are_small_and_match_their_provenance() -> None:
    assert sum((DATA / name).stat().st_size for name in FILES) < 2_000_000
    entries = {item["data_file"]: item for item in json.loads((DATA / "PROVENANCE.json").read_text())["files"]}
    for name in FILES:
        assert entries[name]["sha256"] == hashlib.sha256((DATA / name).read_bytes()).hexdigest()
        assert entries[name]["licence"]
        assert entries[name]["sources"]


def test_vega_flux_at_v() -> None:
    # CALSPEC: 3.44e-9 erg/s/cm2/A at 5556 A (Megessier 1995, Bohlin 2014), within 1 per cent.
    vega = spectra.load_reference_spectrum("vega")
    photlam = np.interp(555.6, vega.wavelength_nm, vega.photlam)
    assert photlam * spectra.HC_ERG_ANGSTROM / 5556.0 == pytest.approx(3.44e-9, rel=0.01)


def test_sun_carries_most_of_the_solar_constant() -> None:
    # 300-1750 nm holds 91 per cent of 1361 W/m2 (ASTM E-490).
    sun = spectra.load_reference_spectrum("sun")
    flam = sun.photlam * spectra.HC_ERG_ANGSTROM / (10.0 * sun.wavelength_nm)
    total_w_m2 = np.trapezoid(flam, 10.0 * sun.wavelength_nm) * 1e-3
    assert total_w_m2 == pytest.approx(0.91 * 1361.0, rel=0.02)


def test_constant_is_the_exact_si_value() -> None:
    from astropy import constants, units

    assert (
        pytest.approx((constants.h * constants.c).to_value(units.erg * units.AA), rel=1e-15) == spectra.HC_ERG_ANGSTROM
    )


def test_johnson_v_pivot() -> None:
    curve = spectra.load_johnson_v()
    wavelength, transmission = curve.wavelength_nm, curve.transmission
    assert wavelength[0] == 470.0
    assert wavelength[-1] == 700.0
    assert transmission.max() == 1.0
    x = np.linspace(470.0, 700.0, 20001)
    t = np.interp(x, wavelength, transmission)
    pivot = np.sqrt(np.trapezoid(t * x, x) / np.trapezoid(t / x, x))
    assert pivot == pytest.approx(549.0, abs=2.0)


def test_zodiacal_table_landmarks() -> None:
    table = spectra.load_zodi_table()
    radiance = table.radiance_500nm_w_m2_sr_um
    assert radiance.shape == (table.helioecliptic_longitude_deg.size, table.ecliptic_latitude_deg.size) == (19, 11)
    at = {lon: i for i, lon in enumerate(table.helioecliptic_longitude_deg)}
    assert radiance[at[90.0], 0] == pytest.approx(259e-8)
    np.testing.assert_allclose(radiance[:, -1], 77e-8)  # the ecliptic pole, whatever the longitude
    missing = np.isnan(radiance)
    assert missing.sum() == 8
    assert not missing[3:].any()
    assert not missing[:, 3:].any()
    assert np.nanmax(radiance) < 2e-4  # no sentinel values left
    assert table.spectrum_wavelength_um.shape == table.spectrum_radiance_w_m2_sr_um.shape == (16,)


@pytest.mark.parametrize("planet", spectra.PLANETS)
def test_albedos_are_physical(planet: str) -> None:
    table = spectra.load_albedo(planet)
    assert table.documented_to_nm == 1050.0
    assert table.wavelength_nm[0] == 300.0
    assert table.wavelength_nm[-1] >= 1750.0
    assert np.all(np.diff(table.wavelength_nm) > 0.0)
    assert table.albedo.min() >= 0.0
    assert table.albedo.max() < 0.8


def test_pickles_library() -> None:
    library = spectra.load_pickles()
    assert library.photlam.shape == (library.position.size, library.wavelength_nm.size)
    assert np.all(library.photlam >= 0.0)
    assert {tuple(pair) for pair in zip(library.position, library.luminosity_rank, strict=True)} >= {
        (20.0, 5.0),
        (42.0, 5.0),
        (62.5, 5.0),
        (25.5, 4.0),
        (50.0, 3.0),
        (53.5, 2.0),
        (48.0, 1.0),
    }
    # All are scaled to V = 0: about 1000 ph/s/cm2/A at 550 nm.
    np.testing.assert_allclose(library.photlam[:, 240:260].mean(axis=1), 1000.0, rtol=0.1)


def test_arrays_are_read_only_and_loaded_once() -> None:
    grid = spectra.load_stellar_grid()
    assert spectra.load_stellar_grid() is grid
    for array in (
        grid.log10_flam,
        grid.ratio,
        spectra.load_reference_spectrum("sun").photlam,
        spectra.load_johnson_v().transmission,
        spectra.load_pickles().photlam,
        spectra.load_albedo("jupiter").albedo,
        spectra.load_zodi_table().radiance_500nm_w_m2_sr_um,
    ):
        with pytest.raises(ValueError, match="read-only"):
            array.flat[0] = 0.0


def test_unknown_names_are_refused(refused) -> None:
    refused("", spectra.load_reference_spectrum, "sirius")
    refused("", spectra.load_albedo, "earth")


def _node(grid, teff: float, log_g: float, metal: float) -> int:
    it, ig, im = (
        int(np.flatnonzero(a == v)[0]) for a, v in ((grid.teff_k, teff), (grid.log_g, log_g), (grid.metallicity, metal))
    )
    return (it * grid.log_g.size + ig) * grid.metallicity.size + im


def test_axes() -> None:
    grid = load_stellar_grid()
    assert (grid.teff_k[0], grid.teff_k[-1], grid.teff_k.size) == (3500.0, 8000.0, 41)
    np.testing.assert_array_equal(grid.log_g, np.arange(0.0, 5.1, 0.5))
    np.testing.assert_array_equal(grid.line_log_g, [3.5, 4.0, 4.5, 5.0])
    np.testing.assert_array_equal(grid.metallicity, [-2.5, -2.0, -1.5, -1.0, -0.5, 0.0, 0.2, 0.5])
    assert grid.wavelength_nm[0] < 300.2
    assert grid.wavelength_nm[-1] > 1750.0
    assert grid.n_nodes == 41 * 11 * 8
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


def _floor(teff: np.ndarray) -> np.ndarray:
    """Lowest gravity of CK04 between the temperature nodes 6000 | 6100 and 7400 | 7600 K."""
    return np.where(teff > 7400.0, 1.0, np.where(teff > 6000.0, 0.5, 0.0))


def test_weights_reproduce_the_coordinates_and_clamp_outside() -> None:
    grid = load_stellar_grid()
    rng = np.random.default_rng(1)
    teff, log_g, metal = rng.uniform(3000, 9000, 2000), rng.uniform(-1, 6, 2000), rng.uniform(-4, 1, 2000)
    nodes, weights = grid.corners(teff, log_g, metal)
    assert nodes.shape == weights.shape == (2000, 8)
    assert weights.min() >= 0.0
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, rtol=1e-14)
    im = nodes % 8
    ig = nodes // 8 % 11
    it = nodes // 88
    inside = np.clip(teff, 3500, 8000)
    np.testing.assert_allclose((weights * grid.teff_k[it]).sum(1), inside, rtol=1e-14)
    np.testing.assert_allclose((weights * grid.log_g[ig]).sum(1), np.clip(log_g, _floor(inside), 5.0), atol=1e-14)
    np.testing.assert_allclose((weights * grid.metallicity[im]).sum(1), np.clip(metal, -2.5, 0.5), atol=1e-14)
    flags = grid.flags(teff, log_g, metal)
    np.testing.assert_array_equal(flags.teff_k, (teff < 3500) | (teff > 8000))
    np.testing.assert_array_equal(flags.log_g, (log_g < _floor(inside)) | (log_g > 5))
    np.testing.assert_array_equal(flags.metallicity, (metal < -2.5) | (metal > 0.5))
    np.testing.assert_array_equal(flags.any, flags.teff_k | flags.log_g | flags.metallicity)
    # Nodes that CK04 lacks never count.
    assert np.all(grid.ratio.reshape(grid.n_nodes, -1)[nodes].any(axis=-1) | (weights == 0.0))


def test_nodes_without_a_model() -> None:
    grid = load_stellar_grid()
    missing = ~grid.ratio.any(axis=-1)
    np.testing.assert_array_equal(missing, np.broadcast_to(missing[:, :, :1], missing.shape))
    np.testing.assert_array_equal(missing[:, :, 0], grid.log_g < _floor(grid.teff_k)[:, None])
    np.testing.assert_array_equal((grid.ratio > 0.0).all(axis=-1), ~missing)
    np.testing.assert_array_equal(grid.log_g_floor([6000.0, 6000.5, 7400.0, 7400.5, 9000.0]), [0.0, 0.5, 0.5, 1.0, 1.0])


def test_edges_are_inside_and_scalars_broadcast() -> None:
    grid = load_stellar_grid()
    assert not grid.flags(3500.0, 0.0, -2.5).any
    assert not grid.flags(8000.0, 5.0, 0.5).any
    nodes, weights = grid.corners(np.full((2, 3), 5000.0), 4.5, 0.0)
    assert nodes.shape == weights.shape == (2, 3, 8)


@pytest.mark.parametrize("bad", [(np.nan, 4.5, 0.0), (5000.0, np.inf, 0.0), (5000.0, 4.5, [0.0, np.nan])])
def test_non_finite_parameters_are_refused(refused, bad) -> None:
    refused("", load_stellar_grid().corners, *bad)
    refused("", load_stellar_grid().flags, *bad)


@pytest.mark.parametrize(("log_g", "line"), [(5.0, 3), (4.5, 2), (3.5, 0), (3.0, 0), (1.0, 0)])
def test_node_flux_is_the_line_structure_times_the_ratio(log_g: float, line: int) -> None:
    grid = load_stellar_grid()
    samples = np.arange(grid.wavelength_nm.size)
    it = 23
    node = _node(grid, grid.teff_k[it], log_g, -0.5)
    photlam = grid.node_photlam(np.array([node]), samples)[0]
    ratio = np.interp(
        np.log(grid.wavelength_nm),
        np.log(grid.ratio_wavelength_nm),
        grid.ratio[it, int(2 * log_g), int(np.flatnonzero(grid.metallicity == -0.5)[0])],
    )
    expected = ratio * 10.0 ** grid.log10_flam[it, line].astype(float) * 10.0 * grid.wavelength_nm / HC_ERG_ANGSTROM
    np.testing.assert_allclose(photlam, expected, rtol=1e-12)


def test_node_integrals_are_those_of_the_spectra() -> None:
    grid = load_stellar_grid()
    rng = np.random.default_rng(2)
    projection = np.where(rng.random((grid.wavelength_nm.size, 3)) < 0.3, rng.random((grid.wavelength_nm.size, 3)), 0.0)
    nodes = rng.integers(0, grid.n_nodes, 40)
    spectra = grid.node_photlam(nodes, np.arange(grid.wavelength_nm.size))
    np.testing.assert_allclose(grid.node_integrals(projection)[nodes], spectra @ projection, rtol=1e-12)


def test_bolometric_scale_of_the_surface_flux() -> None:
    # 300-1750 nm holds about 85-90 per cent of sigma T^4 between 5000 and 6500 K.
    grid = load_stellar_grid()
    samples = np.arange(grid.wavelength_nm.size)
    for teff in (5000.0, 5800.0, 6500.0):
        photlam = grid.node_photlam(np.array([_node(grid, teff, 4.5, 0.0)]), samples)[0]
        energy = photlam * HC_ERG_ANGSTROM / (10.0 * grid.wavelength_nm)
        share = np.trapezoid(energy, 10.0 * grid.wavelength_nm) / (5.670374e-5 * teff**4)
        assert 0.83 < share < 0.92


def _trend(value: str) -> np.ndarray:
    """Mean of the node ratios 5700 and 5800 K around a CK04 model of 5750 K, at the knots; V = 1."""
    grid = load_stellar_grid()
    (g0, m0), (g1, m1) = {"metal": ((4.5, 0.0), (4.5, -0.5)), "gravity": ((3.5, 0.0), (2.0, 0.0))}[value]
    samples = [int(np.argmin(np.abs(grid.wavelength_nm - w))) for w in grid.ratio_wavelength_nm]
    pairs = [[_node(grid, teff, g1, m1), _node(grid, teff, g0, m0)] for teff in (5700.0, 5800.0)]
    ratio = np.mean([np.divide(*grid.node_photlam(np.array(pair), np.array(samples))) for pair in pairs], axis=0)
    return ratio / ratio[3]


@pytest.mark.parametrize(
    ("value", "bands"),
    [
        ("metal", [1.165, 1.055, 0.9834, 0.9727, 0.9645, 0.9715, 0.9766, 0.9773, 0.9871]),
        ("gravity", [0.9054, 1.0187, 1.0277, 1.0243, 1.0183, 1.0105, 1.0128, 1.0074, 0.9879]),
    ],
)
def test_trends_follow_ck04(value: str, bands: list[float]) -> None:
    # Band fluxes U v b y R I z J H of CK04 at 5750 K: [M/H] -0.5 over 0 at log g 4.5; log g 2.0 over 3.5 at [M/H] 0.
    expected = np.array(bands) / bands[3]
    # U is 70 nm wide and steep: its mean differs from the value at its centre.
    np.testing.assert_allclose(_trend(value)[0], expected[0], rtol=0.045)
    np.testing.assert_allclose(_trend(value)[1:], expected[1:], rtol=0.011)


def test_metal_poor_stars_are_bluer() -> None:
    grid = load_stellar_grid()
    samples = np.array([int(np.argmin(np.abs(grid.wavelength_nm - w))) for w in (440.0, 550.0)])
    for teff in (4500.0, 5500.0, 6500.0):
        colours = [
            np.divide(*grid.node_photlam(np.array([_node(grid, teff, 4.5, m)]), samples)[0])
            for m in grid.metallicity[4:]
        ]
        assert np.all(np.diff(colours) < 0.0)


NODES = np.array([1.0, 2.0, 4.0])


@pytest.mark.parametrize("value", [0.0, 1.0, 1.25, 2.0, 3.0, 4.0, 9.0])
def test_weights_make_the_straight_line(value):
    index, weight = bracket(NODES, value)
    assert index.shape == weight.shape == (2,)
    assert np.all(weight >= 0.0)
    assert weight.sum() == 1.0
    assert weight @ (NODES**2)[index] == pytest.approx(np.interp(value, NODES, NODES**2), rel=1e-15)


def test_shape_is_kept():
    index, weight = bracket(NODES, np.ones((3, 4)))
    assert index.shape == weight.shape == (3, 4, 2)
