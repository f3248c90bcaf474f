"""Measured spectra by type: templates, means of neighbours, refusals."""

import numpy as np
import pytest

from catalogs.bands import Band
from catalogs.spectra import load_pickles, load_reference_spectrum
from simulator.band_integrals import band_integral
from simulator.target import stellar_spectrum
from simulator.target.empirical import library_photlam


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
