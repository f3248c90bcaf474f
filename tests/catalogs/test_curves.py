"""Curves of other people's files: written by the libraries that people use, read with equal values."""

import io

import astropy.units as u
import numpy as np
import pytest
from astropy.io import fits
from astropy.table import MaskedColumn, QTable, Table

from catalogs import HC_ERG_ANGSTROM, band_from_file, read_curve
from cpic_core import InputError
from simulator.target import read_spectrum

NM = np.array([500.0, 510.0, 516.25, 533.5, 540.0, 552.5])
T = np.array([0.0, 0.25, 0.8, 0.75, 0.125, 0.0])
FLUX = np.array([1.0, 3.0, 2.5, 4.0, 3.5, 2.0])
UNITS = ("nm", "um", "Angstrom", "m", "mm", "1 / cm", "GHz", "eV")
# How people write them, beside how astropy does.
SPELLED = {
    "nm": ("nm", "nanometers"),
    "um": ("um", "micron", "microns", "\u00b5m", "\u03bcm", "micrometre"),
    "Angstrom": ("Angstrom", "Angstroms", "ANGSTROMS", "A", "AA", "\u00c5"),
    "m": ("m",),
    "1 / cm": ("cm-1", "1/cm", "cm^-1", "cm**-1", "cm\u207b\u00b9"),
    "GHz": ("GHz",),
    "eV": ("eV",),
}
SPELLINGS = [(unit, spelled) for unit, each in SPELLED.items() for spelled in each]


def in_unit(unit):
    """Wavelengths in a unit by astropy's road."""
    return (NM * u.nm).to_value(u.Unit(unit), u.spectral())


def text(x, y, head="", mark=" ", tail=""):
    return head + "".join(f"{a!r}{mark}{b!r}{tail}\n" for a, b in zip(x.tolist(), y.tolist(), strict=True))


def is_read(data, wanted="transmission", values=T, **options):
    data = data if isinstance(data, bytes) else data.encode()
    wavelength_nm, found, unit = read_curve("curve", data, wanted, **options)
    np.testing.assert_allclose(wavelength_nm, NM, rtol=1e-13)
    np.testing.assert_allclose(found, values, rtol=1e-14)
    assert not wavelength_nm.flags.writeable
    assert not found.flags.writeable
    return unit


def is_refused(data, *words, wanted="transmission", **options):
    data = data if isinstance(data, bytes) else data.encode()
    with pytest.raises(InputError) as caught:
        read_curve("curve", data, wanted, **options)
    message = str(caught.value)
    assert message.startswith("curve")
    assert "\n" not in message
    for word in words:
        assert word in message, message


@pytest.mark.filterwarnings("ignore:The unit 'Angstrom' has been deprecated")
@pytest.mark.parametrize("form", ["ascii.ecsv", "votable", "fits"])
@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("names", [("wave", "throughput"), ("x", "y"), ("WAVELENGTH", "RESPONSE")])
def test_tables_have_the_unit_of_their_column(tmp_path, form, unit, names):
    """Up or down: wavenumbers, frequencies and energies run against wavelengths."""
    for part in (slice(None), slice(None, None, -1)):
        table = Table([in_unit(unit)[part] * u.Unit(unit), T[part]], names=names)
        table.write(tmp_path / "curve", format=form, overwrite=True)
        is_read((tmp_path / "curve").read_bytes())


@pytest.mark.parametrize(
    "form",
    ["csv", "tab", "rdb", "commented_header", "basic", "ipac", "fixed_width", "fixed_width_two_line", "no_header"],
)
@pytest.mark.parametrize(("unit", "name"), [("nm", "wavelength_nm"), ("um", "lambda_um"), ("1 / cm", "wavenumber")])
def test_texts_of_astropy_have_the_unit_in_the_heading(form, unit, name):
    table, out = Table({name: in_unit(unit), "transmission": T}), io.StringIO()
    table.write(out, format=f"ascii.{form}")
    head = f"# {unit}\n".replace("1 / cm", "cm-1") if form == "no_header" else ""
    is_read(head + out.getvalue())


def test_units_of_a_heading_in_rows_of_their_own():
    table, out = Table({"wave": NM / 1e3 * u.um, "err_T": 0.1 * T, "T": 100.0 * T * u.percent}), io.StringIO()
    table.write(out, format="ascii.ipac")
    is_read(out.getvalue())
    rows = text(10.0 * NM, FLUX, "# Units are flux per unit wavelength (i.e. scaled ergs/cm/cm/s/A)\n"
                "# sampled by 2.5A\n#\n# WAVELENGTH FLUX\n# Angstrom   erg/s/cm2/A\n")  # fmt: skip
    assert is_read(rows, "flux", FLUX) == "erg/s/cm2/Angstrom"


@pytest.mark.parametrize(
    "head",
    ["wavelength_{} T", "wave [{}] T", "Wavelength ({}), Transmission", "lambda[{}]\ttrans", "# lambda ({}) t",
     "\u03bb / {}; throughput", "# Wavelength in {}, transmission of the filter\n#", '"wave ({})","T"',
     "! wave [{}]  T"],
)  # fmt: skip
@pytest.mark.parametrize(("unit", "spelled"), SPELLINGS)
def test_units_as_people_write_them_in_headings(head, unit, spelled):
    if "_{}" not in head or spelled.isascii():
        is_read(text(in_unit(unit), T, head.format(spelled) + "\n"))


@pytest.mark.parametrize(
    "remark", ["# {}", "# wavelength in {}", "# made by a 5 mm plate\n# unit: {}", "\n#  {}  \n# T < 1% cut off"]
)
@pytest.mark.parametrize("unit", ["nm", "um", "Angstrom"])
def test_units_of_remarks(remark, unit):
    for spelled in SPELLED[unit]:
        if spelled not in ("A", "AA"):  # words of any sentence
            is_read(text(in_unit(unit), T, remark.format(spelled) + "\n"))


def test_the_unit_that_somebody_gives_overrides_the_file():
    is_read(text(NM, T, "wavelength_um T\n"), unit="nm")
    is_refused(text(NM, T, "wavelength_um T\n"), "furlong", "not understood", unit="furlong")


def test_numpy_savetxt(tmp_path):
    for scale, options in ((10.0, {"header": "wavelength_angstrom transmission"}),
                           (1e-3, {"header": "um", "delimiter": ","}),
                           (1.0, {"header": "lambda (nm)\tT (%)", "delimiter": "\t", "comments": ""})):  # fmt: skip
        percent = 100.0 if "%" in options["header"] else 1.0
        np.savetxt(tmp_path / "curve", np.c_[scale * NM, percent * T], **options)
        is_read((tmp_path / "curve").read_bytes())


def test_pandas_csv_with_an_index():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(
        {"wavenumber": in_unit("1 / cm"), "albedo": T, "fpfs": [1e-8, *[np.nan] * 5], "albedo_ch4": T / 2}
    )
    is_read(frame.to_csv(), "albedo")
    is_read(frame[::-1].to_csv(index=False, sep=";", decimal=","), "albedo")


def test_files_written_by_synphot(tmp_path):
    synphot = pytest.importorskip("synphot")
    from synphot.models import Empirical1D

    band = synphot.SpectralElement(Empirical1D, points=10.0 * NM, lookup_table=T)
    band.to_fits(str(tmp_path / "band.fits"), trim_zero=False, pad_zero_ends=False)
    is_read((tmp_path / "band.fits").read_bytes())
    found, fine = band_from_file(tmp_path / "band.fits", "X", t_opt=1.0, qe=1.0), np.linspace(5000.0, 5525.0, 52501)
    assert found.center_nm == pytest.approx(band.avgwave(fine).to_value(u.nm), rel=1e-7)
    assert found.width_nm == pytest.approx(band.rectwidth(fine).to_value(u.nm), rel=1e-7)
    source = synphot.SourceSpectrum(Empirical1D, points=10.0 * NM, lookup_table=FLUX)
    source.to_fits(str(tmp_path / "star.fits"), trim_zero=False, pad_zero_ends=False)
    assert is_read((tmp_path / "star.fits").read_bytes(), "flux", FLUX).lower() == "photlam"


def test_a_spectrum_like_those_of_jwst():
    columns = [("WAVELENGTH", "um", NM / 1e3), ("FLUX", "Jy", FLUX), ("FLUX_ERROR", "Jy", FLUX * np.nan),
               ("SURF_BRIGHT", "MJy/sr", FLUX), ("BACKGROUND", "MJy/sr", FLUX), ("NPIXELS", "", FLUX)]  # fmt: skip
    table = fits.BinTableHDU.from_columns(
        [fits.Column(n, "D", unit=unit, array=a) for n, unit, a in columns], name="EXTRACT1D"
    )
    out = io.BytesIO()
    fits.HDUList([fits.PrimaryHDU(), table, fits.ImageHDU(name="ASDF")]).writeto(out)
    assert is_read(out.getvalue(), "flux", FLUX) == "Jy"


@pytest.mark.parametrize(
    ("wanted", "name"), [("transmission", "T"), ("transmission", "transmission"), ("albedo", "albedo")]
)
@pytest.mark.parametrize(
    ("head", "mark"),
    [
        ("lambda_nm,%{}\n", ","),
        ("# nm %{}\n", " "),
        ("wavelength_nm;{} [%]\n", ";"),
        ("nm\t{} in percent\n", "\t"),
        ("# wavelength (nm), {} (per cent)\n", " "),
        ("# nm\n# {} in %\n", "  "),
    ],
)
def test_percent_where_the_file_says_so(wanted, name, head, mark):
    is_read(text(NM, 100.0 * T, head.format(name), mark), wanted)


@pytest.mark.parametrize(
    "remark",
    [
        "# nm\n# transmission known to 1 %\n",
        "# nm, cut at T<1%\n",
        "# nm\n# peak transmission 80 percent\n",
        "wavelength_nm T humidity_%\n",
    ],
)
def test_percent_that_is_of_something_else(remark):
    tail = " 40" if "humidity" in remark else ""
    is_read(text(NM, T, remark, tail=tail))


def test_only_the_columns_that_are_needed_are_looked_at():
    head = "name,wavelength_nm,albedo,fpfs,albedo_error\n"
    rows = "".join(f"a{i},{w},{t},{'' if i % 2 else 'x'},nan\n" for i, (w, t) in enumerate(zip(NM, T, strict=True)))
    is_read(head + rows, "albedo")
    table = Table({"note": list("abcdef"), "wave": NM * u.nm, "e_T": MaskedColumn(T, mask=T > 0), "T": T})
    out = io.StringIO()
    table.write(out, format="ascii.ecsv")
    is_read(out.getvalue())


def test_numbers_of_other_languages():
    rows = text(NM, T).replace(" ", ";").replace(".", ",")
    is_read("wavelength_nm;T\n" + rows)
    is_read("# nm\n" + "".join(f" {w / 100:.8f}D+02   {t:.6f}d0\n" for w, t in zip(NM, T, strict=True)))
    is_read(text(NM / 1e3, T, "wave (\u00b5m) T\n").encode("cp1252"))
    is_read("\ufeff" + text(NM, T, "wavelength_nm,T\n", ",").replace("\n", ",\r\n"))


def test_noise_of_a_measured_curve_is_taken_off():
    """A curve of the Carnegie Supernova Project reaches -0.16 % of its peak where its filter is shut."""
    noisy = np.array([-0.0013, 0.25, 1.004, 0.75, 0.125, -0.0079])
    is_read(text(NM, noisy, "# nm\n"), values=noisy.clip(0.0, 1.0), most=1.0)
    for bad, row in (
        ([-0.02, 0.5, 1.0, 0.5, 0.2, 0.0], 2),
        ([0.0, 0.5, 1.0, 0.5, 0.2, -0.02], 7),
        ([0.0, 0.5, 1.02, 0, 0, 0], 4),
    ):
        is_refused(text(NM, np.array(bad), "# nm\n"), f"line {row} transmission", most=1.0)
    is_refused(text(NM, 100.0 * T, "# nm\n"), "line 3 transmission = 25.0", "% in the heading", most=1.0)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (text(10.0 * NM, T), ("not stated, numbers from 5000 to 5525", "# Angstrom")),
        (text(NM, T, "wave (furlong) T\n"), ("unit = furlong", "not understood")),
        (text(NM, T, "# nm or um\n"), ("nm and um",)),
        (text(NM, T, "# range 400 nm to 900 nm\n"), ("not stated",)),
        (text(NM, T, "wavelength flux_density\n"), ("columns = wavelength, flux_density", "one of transmissions")),
        (text(NM, T, "wavelength_nm emissivity\n"), ("one of transmissions",)),
        (text(NM, T, "wavelength_nm T_err\n"), ("one of transmissions",)),
        (text(NM, T, "# nm\n", tail=" 0.1"), ("unnamed, unnamed, unnamed", "wavelength_nm")),
        (text(NM, T, "wavelength_nm T QE\n", tail=" 0.1"), ("wavelength_nm, T, QE",)),
        (text(NM, T, "# nm\n") + "nonsense\n", ("line 8 = 1 cells", "as in line 2")),
        (text(NM, T, "# nm\n") + "560 x\n", ("line 8 transmission = something else",)),
        (text(NM, T, "# nm,,\n", ",") + "560,\n", ("line 8 transmission = something else",)),
        (text(NM[[0, 2, 1]], T[:3], "# nm\n"), ("line 4 wavelength = 510.0", "in order")),
        (text(NM[[0, 1, 1]], T[:3], "# nm\n"), ("line 4 wavelength = 510.0", "once")),
        (text(-NM, T, "# nm\n"), ("line 2 wavelength = -500",)),
        (text(NM, T, "wavelength_m T\n"), ("line 2 wavelength = 5", "0.001 to 1e+08 nm")),
        ("# nm\n500 0.1\n", ("1 rows of numbers",)),
        (b"\x89PNG\r\n\0\1", ("binary",)),
    ],
)  # fmt: skip
def test_refusals_say_what_is_wrong_and_where(data, words):
    is_refused(data, *words)


@pytest.mark.parametrize(
    ("stated", "right"),
    [
        ("photlam", u.photon / (u.s * u.cm**2 * u.AA)),
        ("FLAM", u.erg / (u.s * u.cm**2 * u.AA)),
        ("fnu", u.erg / (u.s * u.cm**2 * u.Hz)),
        ("JY", u.Jy),
        ("mJy", u.mJy),
        ("erg/s/cm2/A", u.erg / (u.s * u.cm**2 * u.AA)),
        ("ergs/cm/cm/s/A", u.erg / (u.s * u.cm**2 * u.AA)),
        ("ERG/S/CM2/A", u.erg / (u.s * u.cm**2 * u.AA)),
        ("erg s^-1 cm^-2 \u00c5^-1", u.erg / (u.s * u.cm**2 * u.AA)),
        ("erg cm-2 s-1 Ang-1", u.erg / (u.s * u.cm**2 * u.AA)),
        ("photons/s/cm^2/nm", u.photon / (u.s * u.cm**2 * u.nm)),
        ("W/m2/um", u.W / (u.m**2 * u.um)),
        ("W m-2 \u00b5m-1", u.W / (u.m**2 * u.um)),
        ("1e-17 erg/s/cm2/A", 1e-17 * u.erg / (u.s * u.cm**2 * u.AA)),
    ],
)
@pytest.mark.parametrize(
    "head",
    ["wavelength_nm;flux [{}]", "# wave (nm), flux ({})", "# wavelength in nm, flux in {}", "# wave;flux\n# nm;{}"],
)
def test_flux_densities_in_units_as_people_write_them(tmp_path, stated, right, head):

    photlam = (FLUX * right).to_value(u.photon / (u.s * u.cm**2 * u.AA), u.spectral_density(NM * u.nm))
    (tmp_path / "star.txt").write_text(text(NM, FLUX, head.format(stated) + "\n"), encoding="utf-8")
    found = read_spectrum(tmp_path / "star.txt")
    np.testing.assert_allclose(found.wavelength_nm, NM, rtol=1e-14)
    np.testing.assert_allclose(found.photlam, photlam, rtol=1e-8)


@pytest.mark.parametrize(
    ("unit", "words"),
    [("", "not stated"), ("[counts/s]", "unit = counts/s"), ("[parsnips]", "not understood"), ("(m)", "unit = m")],
)
def test_flux_units_that_are_none_differ_from_none(tmp_path, refused, unit, words):

    (tmp_path / "star.txt").write_text(text(NM, FLUX, f"wavelength_nm;flux {unit}\n"), encoding="utf-8")
    refused(f"star.txt flux unit.*{words}|star.txt flux {words}", read_spectrum, tmp_path / "star.txt")


def test_quantities_of_specutils_like_tables():
    table, out = QTable({"spectral_axis": NM * u.nm, "flux": FLUX * u.Jy, "uncertainty": FLUX}), io.StringIO()
    table.write(out, format="ascii.ecsv")
    assert is_read(out.getvalue(), "flux", FLUX) == "Jy"


@pytest.mark.parametrize("sign", ["%", "%%", ";", "!", "//", "\\\\"])
def test_remarks_of_other_languages_are_neither_percent_nor_cells(sign):
    is_read(text(NM, T, f"{sign} made in 2024\n{sign} wavelength_nm T\n"))


@pytest.mark.parametrize(
    ("head", "unit"),
    [("wave_nm,flux_Jy", "Jy"), ("wave_nm,fnu_mJy", "mJy"), ("wave_nm,flux_MJy", "MJy"),
     ("wave_nm,flux\n# in uJy", "uJy"),
     ("# Units: nm, mJy (fnu)", "mJy"), ("# nm, flam; erg/s/cm2/A", "erg/s/cm2/Angstrom"), ("# nm FLAM", "flam")],
)  # fmt: skip
def test_the_unit_of_a_flux_is_the_most_particular_word(head, unit):
    assert is_read(text(NM, FLUX, head + "\n", ","), "flux", FLUX) == unit


def test_a_spectrum_that_is_one_row_of_vectors_is_read(tmp_path):
    """As the spectrographs of the Hubble telescope and of ESO write them: SPORDER and NELEM are single numbers."""
    wave, flux = np.linspace(5000.0, 6000.0, 11), np.linspace(1e-14, 2e-14, 11)
    columns = [
        fits.Column("SPORDER", "I", array=np.array([1])),
        fits.Column("NELEM", "I", array=np.array([11])),
        fits.Column("WAVELENGTH", "11D", unit="Angstroms", array=wave[None]),
        fits.Column("FLUX", "11E", unit="erg/s/cm**2/Angstrom", array=flux[None]),
    ]
    path = tmp_path / "x1d.fits"
    fits.BinTableHDU.from_columns(columns).writeto(path)
    read = read_spectrum(path)
    np.testing.assert_allclose(read.wavelength_nm, wave / 10.0, rtol=1e-12)
    np.testing.assert_allclose(read.photlam, flux * wave / HC_ERG_ANGSTROM, rtol=1e-6)
