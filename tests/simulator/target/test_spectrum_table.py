"""Spectra from files: units, formats, refusals; against synphot's unit conversions."""

from pathlib import Path

import numpy as np
import pytest

from catalogs import Spectrum
from cpic_core import InputError
from simulator.target import read_spectrum, stellar_spectrum

NM = np.linspace(350.0, 1000.0, 66)
PHOTLAM = 1.0 + np.sin(NM / 60.0) ** 2


def in_unit(unit: str) -> np.ndarray:
    """The same spectrum in another unit, converted by synphot."""
    import astropy.units as u
    from synphot import units

    target = {"flam": units.FLAM, "fnu": units.FNU, "jy": u.Jy, "photlam": units.PHOTLAM}[unit]
    return units.convert_flux(10.0 * NM, PHOTLAM * units.PHOTLAM, target).value


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def rows(x: np.ndarray, y: np.ndarray, mark: str = " ") -> str:
    return "\n".join(f"{a!r}{mark}{b!r}" for a, b in zip(x.tolist(), y.tolist(), strict=True)) + "\n"


@pytest.mark.parametrize("flux", ["photlam", "flam", "fnu", "jy"])
@pytest.mark.parametrize(("unit", "per_nm"), [("nm", 1.0), ("angstrom", 10.0), ("um", 1e-3)])
def test_text_names_its_units(tmp_path: Path, flux: str, unit: str, per_nm: float) -> None:
    file = write(tmp_path / "s.csv", f"wavelength_{unit},{flux}\n" + rows(NM * per_nm, in_unit(flux), ","))
    spectrum = read_spectrum(file)
    np.testing.assert_allclose(spectrum.wavelength_nm, NM, rtol=1e-14)
    np.testing.assert_allclose(spectrum.photlam, PHOTLAM, rtol=1e-7)


@pytest.mark.parametrize(
    "text",
    [
        "# wavelength (Angstrom), flux (FLAM)\n{}",
        "# made by hand\n#\n# Angstroms  flam\n\n{}",
        "\ufeffwavelength_angstrom\tflam\r\n{}",
        '"wavelength_angstrom";"flam"\n{}# the end\n',
    ],
)
def test_headers_as_people_write_them(tmp_path: Path, text: str) -> None:
    mark = "\t" if "\t" in text else ";" if ";" in text else "  "
    file = write(tmp_path / "s.txt", text.format(rows(10.0 * NM, in_unit("flam"), mark)))
    np.testing.assert_allclose(read_spectrum(file).photlam, PHOTLAM, rtol=1e-7)


@pytest.mark.parametrize(
    ("kind", "wavelength_unit", "flux_unit"),
    [
        ("ascii.ecsv", "nm", "ph / (Angstrom s cm2)"),
        ("ascii.ecsv", "Angstrom", "erg / (Angstrom s cm2)"),
        ("ascii.ecsv", "um", "W / (m2 um)"),
        ("ascii.ecsv", "nm", "Jy"),
        ("votable", "nm", "ph / (nm s cm2)"),
        ("votable", "um", "W / (m2 um)"),
        ("votable", "nm", "Jy"),
    ],
)
def test_tables_carry_their_units(tmp_path: Path, kind: str, wavelength_unit: str, flux_unit: str) -> None:
    import astropy.units as u
    from astropy.table import QTable

    x = NM * u.nm
    photlam = PHOTLAM * u.photon / (u.s * u.cm**2 * u.AA)
    y = photlam.to(u.Unit(flux_unit), u.spectral_density(x))
    QTable({"wavelength": x.to(u.Unit(wavelength_unit)), "flux": y}).write(tmp_path / "s", format=kind)
    np.testing.assert_allclose(read_spectrum(tmp_path / "s").photlam, PHOTLAM, rtol=1e-7)


@pytest.mark.parametrize("names", [("WAVELENGTH", "FLUX"), ("wave", "value")])
def test_fits_of_synphot_and_others(tmp_path: Path, names: tuple[str, str]) -> None:
    from astropy.io import fits

    columns = [
        fits.Column("ERROR", "D", array=NM) if names[0] == "WAVELENGTH" else None,
        fits.Column(names[0], "D", unit="ANGSTROMS", array=10.0 * NM),
        fits.Column(names[1], "D", unit="FLAM", array=in_unit("flam")),
    ]
    table = fits.BinTableHDU.from_columns([item for item in columns if item])
    fits.HDUList([fits.PrimaryHDU(), table]).writeto(tmp_path / "s.fits")
    np.testing.assert_allclose(read_spectrum(tmp_path / "s.fits").photlam, PHOTLAM, rtol=1e-7)


def test_a_file_written_by_synphot(tmp_path: Path) -> None:
    from synphot import Empirical1D, SourceSpectrum

    source = SourceSpectrum(Empirical1D, points=10.0 * NM, lookup_table=PHOTLAM)
    source.to_fits(str(tmp_path / "s.fits"), trim_zero=False, pad_zero_ends=False)
    read = read_spectrum(tmp_path / "s.fits")
    np.testing.assert_allclose(np.interp(NM, read.wavelength_nm, read.photlam), PHOTLAM, rtol=1e-5)


@pytest.mark.parametrize(("x", "y"), [("m / s", "Jy"), (None, "Jy"), ("nm", "m"), ("nm", None)])
def test_units_of_other_kinds_are_refused(refused, tmp_path: Path, x: str | None, y: str | None) -> None:
    from astropy.table import Table

    table = Table({"wavelength": NM, "flux": PHOTLAM})
    table["wavelength"].unit, table["flux"].unit = x, y
    table.write(tmp_path / "s.ecsv", format="ascii.ecsv")
    refused("unit = ", read_spectrum, tmp_path / "s.ecsv")


def test_missing_and_binary_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "s.dat").write_bytes(b"\xff\xfe\x00\x01")
    for path in (tmp_path / "s.dat", tmp_path / "none.txt", tmp_path):
        with pytest.raises(InputError) as caught:
            read_spectrum(path)
        assert caught.value.key in ("spectrum file", "s.dat")


def test_a_star_from_a_file_and_from_numbers(tmp_path: Path) -> None:
    file = write(tmp_path / "s.txt", "# nm photlam\n" + rows(NM, PHOTLAM))
    one = stellar_spectrum(4.0, model=file)
    two = stellar_spectrum(4.0, "DA2", teff_k=9000.0, metallicity=0.0, model=Spectrum(NM, 1e-9 * PHOTLAM))
    np.testing.assert_allclose(one.photlam, two.photlam, rtol=1e-13)
    np.testing.assert_allclose(one.photlam / PHOTLAM, one.photlam[0] / PHOTLAM[0], rtol=1e-12)
    assert (one.model, one.flags, one.teff_k) == (str(file), (), None)
    assert (two.model, two.flags, two.teff_k) == ("table", ("teff_k_unused",), 9000.0)


def test_a_table_must_cover_v_and_hold_light_there(refused) -> None:
    short = NM > 480.0
    refused("490-1000 nm.*470-700 nm", stellar_spectrum, 4.0, model=Spectrum(NM[short], PHOTLAM[short]))
    refused("no light in V", stellar_spectrum, 4.0, model=Spectrum(NM, np.where(NM > 800.0, PHOTLAM, 0.0)))
    refused("no light in V", stellar_spectrum, 4.0, model=Spectrum(NM, np.zeros_like(NM)))
    refused("not negative", stellar_spectrum, 4.0, model=Spectrum(NM, -PHOTLAM))
