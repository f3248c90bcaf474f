"""The builder of the measured library: smoothing, and files that are not the library's."""

import io

import numpy as np
import pytest

from catalogs import parse_spectral_type
from tools.build_catalogue.builders import pickles


def _file(wavelength: np.ndarray, flux: np.ndarray, history: str) -> bytes:
    from astropy.io import fits

    columns = [fits.Column("WAVELENGTH", "E", array=wavelength), fits.Column("FLUX", "E", array=flux)]
    primary = fits.PrimaryHDU()
    primary.header["HISTORY"] = history
    stream = io.BytesIO()
    fits.HDUList([primary, fits.BinTableHDU.from_columns(columns)]).writeto(stream)
    return stream.getvalue()


def test_the_smoothing_keeps_lines_and_sums() -> None:
    angstrom = np.arange(1150.0, 25000.1, 5.0)
    straight = pickles._spectrum(_file(angstrom, angstrom, "SEDs from Pickles UVKLIB Library"), "x")
    np.testing.assert_allclose(straight, 10.0 * np.arange(300.0, 1751.0), rtol=1e-6)
    for place in (5000.0, 5005.0):
        spike = pickles._spectrum(_file(angstrom, 1.0 * (angstrom == place), "Pickles UVKLIB"), "x")
        assert spike.sum() == pytest.approx(0.5, rel=1e-6)  # 0.5 nm in steps of 1 nm
    assert pickles._spectrum(_file(angstrom, -angstrom, "Pickles UVKLIB"), "x").max() == 0.0


def test_other_files_are_refused(refused) -> None:
    angstrom = np.arange(1150.0, 25000.1, 5.0)
    refused("UVKLIB", pickles._spectrum, _file(angstrom, angstrom, "MUSCLES"), "x")
    refused("0.5 nm", pickles._spectrum, _file(angstrom + 2.0, angstrom, "Pickles UVKLIB"), "x")


def test_each_type_is_there_once() -> None:
    types = [parse_spectral_type(name) for name, _ in pickles._FILES.values()]
    assert len({(item.position, item.luminosity_rank) for item in types}) == len(types) == 82
    assert all(item.flags == () for item in types)
