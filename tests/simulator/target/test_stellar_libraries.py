"""Measured spectra by type: templates, means of neighbours, refusals.

Trees of stellar models: a small one made here, against scipy's interpolator and stsynphot.
"""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from catalogs import Band, load_pickles, load_reference_spectrum
from cpic_core import InputError
from simulator.passbands import band_integral
from simulator.target import stellar_spectrum
from simulator.target.star_spectrum import find_tree, library_photlam, tree_photlam


def _row(position: float, rank: float) -> int:
    library = load_pickles()
    (row,) = np.flatnonzero((library.position == position) & (library.luminosity_rank == rank))
    return int(row)


@pytest.mark.parametrize(
    ("spectral_type", "position", "rank"),
    [
        ("G2V", 42, 5),
        ("A0V", 20, 5),
        ("M6V", 66, 5),
        ("K0III", 50, 3),
        ("G8I", 48, 1),
        ("F2II", 32, 2),
        ("K3IV", 53, 4),
    ],
)
def test_a_template_is_taken_as_it_is(spectral_type: str, position: float, rank: float) -> None:
    wavelength_nm, photlam, flags = library_photlam(spectral_type)
    assert flags == ()
    np.testing.assert_array_equal(photlam, load_pickles().photlam[_row(position, rank)])
    np.testing.assert_array_equal(wavelength_nm, np.arange(300.0, 1751.0))


def test_between_templates_it_is_their_mean() -> None:
    photlam = load_pickles().photlam
    _, found, flags = library_photlam("K6V")
    np.testing.assert_allclose(found, 0.5 * (photlam[_row(55, 5)] + photlam[_row(57, 5)]), rtol=1e-14)
    assert flags == ("template_interpolated",)
    _, found, flags = library_photlam("K0IV-V")
    np.testing.assert_allclose(found, 0.5 * (photlam[_row(50, 5)] + photlam[_row(50, 4)]), rtol=1e-14)
    assert flags == ("template_interpolated",)


def test_a_temperature_is_no_type(refused) -> None:
    refused("spectral_type = missing", stellar_spectrum, 3.0, teff_k=5772.0, model="pickles")
    star = stellar_spectrum(3.0, "G2V", teff_k=5772.0, log_g=4.4, metallicity=0.1, model="pickles")
    assert star.flags == ("teff_k_unused", "log_g_unused", "metallicity_unused")
    assert (star.teff_k, star.model) == (5770.0, "pickles")


@pytest.mark.parametrize(("name", "spectral_type", "tolerance"), [("sun", "G2V", 0.09), ("vega", "A0V", 0.06)])
def test_measured_stars_of_the_type_agree(name: str, spectral_type: str, tolerance: float) -> None:
    # Two independent measurements; the library's A0V and G2V are composites of several stars.
    reference = load_reference_spectrum(name)
    star = stellar_spectrum(0.0, spectral_type, model="pickles")
    bands = [Band("x", "VIS", c, 50.0, 1.0, 1.0) for c in range(425, 1000, 50)]
    found = np.array([band_integral(band, star.wavelength_nm, star.photlam) for band in bands])
    known = np.array([band_integral(band, reference.wavelength_nm, reference.photlam) for band in bands])
    ratio = found / known
    np.testing.assert_allclose(ratio / np.median(ratio), 1.0, atol=tolerance)


def test_cooler_types_are_redder() -> None:
    library = load_pickles()
    for rank in (5, 3):
        rows = np.flatnonzero(library.luminosity_rank == rank)
        rows = rows[np.argsort(library.position[rows])]
        red = library.photlam[rows][:, 400:450].mean(axis=1) / library.photlam[rows][:, 200:250].mean(axis=1)
        assert np.corrcoef(library.position[rows], np.log(red))[0, 1] > 0.9
        assert red[-1] > 5.0 * red[0]


TEFF, METAL, LOG_G = (4750.0, 5000.0, 5250.0), (-0.5, 0.0, 0.2), (4.0, 4.5, 5.0)
ANGSTROM = np.concatenate([np.arange(2500.0, 9000.0, 40.0), np.arange(9000.0, 18000.0, 200.0)])
EMPTY = (5250.0, 0.2, 4.0)
HC_ERG_ANGSTROM = 6.62607015e-27 * 2.99792458e18


def flam(teff: float, metal: float, log_g: float) -> np.ndarray:
    """Made-up surface flux, far from linear in every parameter."""
    if (teff, metal, log_g) == EMPTY:
        return np.zeros_like(ANGSTROM)
    planck = 1e20 / ANGSTROM**5 / np.expm1(1.4388e8 / (ANGSTROM * teff))
    lines = 1.0 - 0.3 * 10.0**metal * np.sin(ANGSTROM / 70.0) ** 2 * np.exp(-((ANGSTROM / 6000.0) ** 2)) / log_g
    return (planck * lines * (1.0 + 0.1 * log_g**2)).astype(np.float32).astype(np.float64)


def write_tree(folder: Path, *, scale: float = 1.0) -> Path:
    """Write a tree as STScI lays it out; returns its folder."""
    from astropy.io import fits

    folder.mkdir(parents=True, exist_ok=True)
    index, names = [], []
    for metal in METAL:
        sign = "m" if metal < 0 else "p"
        stem = f"ck{sign}{abs(metal) * 10:02.0f}"
        (folder / stem).mkdir(exist_ok=True)
        for teff in TEFF:
            columns = [fits.Column("WAVELENGTH", "D", unit="ANGSTROM", array=ANGSTROM)]
            for log_g in LOG_G:
                name = f"g{log_g * 10:02.0f}"
                columns.append(fits.Column(name, "E", unit="FLAM", array=scale * flam(teff, metal, log_g)))
                index.append(f"{teff:.0f},{metal:g},{log_g:g}")
                names.append(f"{stem}/{stem}_{teff:.0f}.fits[{name}]")
            table = fits.BinTableHDU.from_columns(columns)
            fits.HDUList([fits.PrimaryHDU(), table]).writeto(folder / stem / f"{stem}_{teff:.0f}.fits", overwrite=True)
    columns = [fits.Column("INDEX", "22A", array=index), fits.Column("FILENAME", "40A", array=names)]
    fits.HDUList([fits.PrimaryHDU(), fits.BinTableHDU.from_columns(columns)]).writeto(
        folder / "catalog.fits", overwrite=True
    )
    return folder


@pytest.fixture(scope="module")
def root(tmp_path_factory) -> Path:
    """A root of reference data with one tree."""
    place = tmp_path_factory.mktemp("cdbs")
    write_tree(place / "grid" / "ck04models")
    return place


@pytest.fixture(scope="module")
def tree(root: Path) -> Path:
    return root / "grid" / "ck04models"


@pytest.fixture(scope="module")
def oracle():
    """Trilinear interpolation of the made-up fluxes by scipy, in photons."""
    from scipy.interpolate import RegularGridInterpolator

    cube = np.array([[[flam(t, m, g) for g in LOG_G] for m in METAL] for t in TEFF])
    photlam = RegularGridInterpolator((TEFF, METAL, LOG_G), cube * ANGSTROM / HC_ERG_ANGSTROM)
    return lambda teff, metal, log_g: photlam((teff, metal, log_g))


def test_a_node_is_the_file(tree: Path) -> None:
    wavelength_nm, photlam = tree_photlam(tree, 5000.0, 4.5, 0.0)
    np.testing.assert_allclose(wavelength_nm, ANGSTROM / 10.0, rtol=1e-15)
    np.testing.assert_allclose(photlam, flam(5000.0, 0.0, 4.5) * ANGSTROM / HC_ERG_ANGSTROM, rtol=1e-12)


@given(teff=st.floats(4750.0, 5250.0), metal=st.floats(-0.5, 0.2), log_g=st.floats(4.5, 5.0))
def test_between_nodes_it_is_trilinear_in_flux(tree: Path, oracle, teff: float, metal: float, log_g: float) -> None:
    # The empty cell has log g 4.0.
    np.testing.assert_allclose(tree_photlam(tree, teff, log_g, metal)[1], oracle(teff, metal, log_g), rtol=1e-11)


@pytest.mark.parametrize(("teff", "metal", "log_g"), [(4900.0, 0.2, 4.2), (5250.0, -0.1, 4.5), (5250.0, 0.0, 4.1)])
def test_nodes_of_an_axis_need_no_neighbour_there(tree: Path, oracle, teff: float, metal: float, log_g: float) -> None:
    np.testing.assert_allclose(tree_photlam(tree, teff, log_g, metal)[1], oracle(teff, metal, log_g), rtol=1e-11)


@pytest.mark.parametrize(("teff", "metal", "log_g"), [EMPTY, (5240.0, 0.19, 4.01), (5001.0, 0.1, 4.49)])
def test_empty_cells_are_refused_with_their_parameters(
    refused, tree: Path, teff: float, metal: float, log_g: float
) -> None:
    refused(r"Teff 5250 K, log g 4, \[M/H\] 0.2.*ckp02/ckp02_5250.fits\[g40\]", tree_photlam, tree, teff, log_g, metal)


@pytest.mark.parametrize(
    ("teff", "metal", "log_g", "key", "allowed"),
    [
        (4700.0, 0.0, 4.5, "teff_k", "4750 to 5250"),
        (5300.0, 0.0, 4.5, "teff_k", "4750 to 5250"),
        (5000.0, -0.6, 4.5, "metallicity", "-0.5 to 0.2"),
        (5000.0, 0.3, 4.5, "metallicity", "-0.5 to 0.2"),
        (5000.0, 0.0, 3.9, "log_g", "4 to 5"),
        (5000.0, 0.0, 5.1, "log_g", "4 to 5"),
    ],
)
def test_outside_is_refused_with_the_range(tree, teff, metal, log_g, key, allowed) -> None:
    with pytest.raises(InputError) as caught:
        stellar_spectrum(4.0, teff_k=teff, log_g=log_g, metallicity=metal, model=tree)
    assert caught.value.key == key
    assert caught.value.allowed.startswith(allowed)


def test_a_ragged_grid_takes_the_nodes_that_each_temperature_has(tmp_path: Path) -> None:
    from astropy.io import fits

    def flux(teff: float, log_g: float) -> np.ndarray:
        return np.full(3, teff * log_g)

    points = {4000.0: (3.0, 5.0), 5000.0: (3.0, 4.0, 5.0)}
    rows = [(t, g) for t, gravities in points.items() for g in gravities]
    for teff, gravities in points.items():
        columns = [fits.Column("WAVELENGTH", "D", array=[4000.0, 6000.0, 8000.0])]
        columns += [fits.Column(f"g{g * 10:.0f}", "D", array=flux(teff, g) ** 2) for g in gravities]
        fits.BinTableHDU.from_columns(columns).writeto(tmp_path / f"{teff:.0f}.fits")
    index = fits.Column("INDEX", "20A", array=[f"{t:g},0.0,{g:g}" for t, g in rows])
    names = fits.Column("FILENAME", "20A", array=[f"{t:.0f}.fits[g{g * 10:.0f}]" for t, g in rows])
    fits.BinTableHDU.from_columns([index, names]).writeto(tmp_path / "catalog.fits")
    found = tree_photlam(tmp_path, 4500.0, 3.5, 0.0)[1] * HC_ERG_ANGSTROM / np.array([4000.0, 6000.0, 8000.0])
    low = 0.75 * flux(4000.0, 3.0) ** 2 + 0.25 * flux(4000.0, 5.0) ** 2
    high = 0.5 * (flux(5000.0, 3.0) ** 2 + flux(5000.0, 4.0) ** 2)
    np.testing.assert_allclose(found, 0.5 * (low + high), rtol=1e-12)


def test_a_tree_is_found_by_folder_file_root_or_name(refused, root: Path, tree: Path, monkeypatch) -> None:
    expected = tree / "catalog.fits"
    for path in (tree, str(tree), expected, root, root / "ck04models", f"{root}/ck04models"):
        assert find_tree(path) == expected
    monkeypatch.setenv("PYSYN_CDBS", str(root))
    assert find_tree("ck04models") == expected
    monkeypatch.delenv("PYSYN_CDBS")
    refused("PYSYN_CDBS", find_tree, "ck04models")


def test_several_trees_must_be_named(refused, tmp_path: Path) -> None:
    for name in ("ck04models", "phoenix"):
        write_tree(tmp_path / "grid" / name)
    refused("ck04models, phoenix", find_tree, tmp_path)
    assert find_tree(tmp_path / "phoenix").parent.name == "phoenix"


def test_the_star_says_what_it_was_made_from(tree: Path) -> None:
    from simulator.target import star_photlam

    source = star_photlam(3.0, "K1V", teff_k=5100.0, metallicity=0.1, model=tree)
    assert source.meta["model"] == str(tree)
    assert source.meta["teff_k"] == 5100.0
    assert source.meta["log_g"] == pytest.approx(4.5, abs=0.01)
    assert source.meta["metallicity"] == 0.1
    assert source.meta["flags"] == ()
    assert stellar_spectrum(3.0, "K1", model=tree).flags == ("luminosity_class_assumed",)


@given(
    magnitude=st.floats(-27.0, 30.0),
    teff=st.floats(4750.0, 5250.0),
    metal=st.floats(-0.5, 0.2),
    log_g=st.floats(4.5, 5.0),
)
def test_v_magnitude_is_the_one_asked_for(v_magnitude, tree, magnitude, teff, metal, log_g) -> None:
    from simulator.target import star_photlam

    source = star_photlam(magnitude, teff_k=teff, log_g=log_g, metallicity=metal, model=tree)
    assert v_magnitude(source) == pytest.approx(magnitude, abs=1e-6)


def test_a_changed_tree_is_read_again(tmp_path: Path) -> None:
    write_tree(tmp_path)
    first = tree_photlam(tmp_path, 5000.0, 4.5, 0.0)[1]
    write_tree(tmp_path, scale=2.0)
    for file in tmp_path.rglob("*.fits"):
        os.utime(file, ns=(1, 1))
    np.testing.assert_allclose(tree_photlam(tmp_path, 5000.0, 4.5, 0.0)[1], 2.0 * first, rtol=1e-6)


def test_only_the_columns_needed_are_read(refused, tmp_path: Path) -> None:
    write_tree(tmp_path)
    for file in tmp_path.rglob("ck*_5250.fits"):
        file.write_bytes(b"not a table")
    assert tree_photlam(tmp_path, 4900.0, 4.5, 0.0)[1].any()
    refused("WAVELENGTH and g45", tree_photlam, tmp_path, 5100.0, 4.5, 0.0)
    next(tmp_path.rglob("ckp00_5250.fits")).unlink()
    refused("No such file", tree_photlam, tmp_path, 5100.0, 4.5, 0.0)


@pytest.mark.parametrize(
    ("index", "name"),
    [
        ("5000,0.0", "a.fits[g45]"),
        ("5000,x,4.5", "a.fits[g45]"),
        ("5000,0.0,4.5", "a.fits"),
        ("5000,0,nan", "a.fits[g45]"),
    ],
)
def test_a_bad_catalogue_is_refused(refused, tmp_path: Path, index: str, name: str) -> None:
    from astropy.io import fits

    columns = [fits.Column("INDEX", "20A", array=[index]), fits.Column("FILENAME", "20A", array=[name])]
    fits.BinTableHDU.from_columns(columns).writeto(tmp_path / "catalog.fits")
    refused(r"file.fits\[column\]", tree_photlam, tmp_path, 5000.0, 4.5, 0.0)


def test_what_is_not_a_tree_is_refused(refused, tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(InputError) as caught:
            tree_photlam(path, 5000.0, 4.5, 0.0)
        assert caught.value.key == "model"
    (tmp_path / "catalog.fits").write_text("not fits")
    refused("INDEX and FILENAME", tree_photlam, tmp_path, 5000.0, 4.5, 0.0)


@pytest.mark.long
def test_it_agrees_with_stsynphot(root: Path, tree: Path) -> None:
    code = (
        "import sys, warnings; warnings.simplefilter('ignore')\n"
        "import numpy as np, stsynphot\n"
        "out = [stsynphot.grid_to_spec('ck04models', t, m, g)(np.loadtxt(sys.argv[1])).value\n"
        "       for t, m, g in ((5050.0, 0.2, 4.6), (5200.0, -0.3, 4.9), (4750.0, 0.1, 4.2))]\n"
        "np.savetxt(sys.argv[2], out)"
    )
    points, answer = root / "points.txt", root / "answer.txt"
    angstrom = np.linspace(2600.0, 17000.0, 777)
    np.savetxt(points, angstrom)
    subprocess.run(
        [sys.executable, "-c", code, str(points), str(answer)], check=True, env=os.environ | {"PYSYN_CDBS": str(root)}
    )
    for (teff, metal, log_g), theirs in zip(
        ((5050.0, 0.2, 4.6), (5200.0, -0.3, 4.9), (4750.0, 0.1, 4.2)), np.loadtxt(answer), strict=True
    ):
        wavelength_nm, photlam = tree_photlam(tree, teff, log_g, metal)
        np.testing.assert_allclose(np.interp(angstrom / 10.0, wavelength_nm, photlam), theirs, rtol=1e-9)
