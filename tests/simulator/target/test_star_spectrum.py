"""Stellar spectra: V magnitudes by synphot, Planck's law, flags and bad input.

Thermal light against astropy's Planck law and a star seen from afar.

Spectra from files: units, formats, refusals; against synphot's unit conversions.

Measured spectra by type: templates, means of neighbours, refusals.

Trees of stellar models: a small one made here, against scipy's interpolator and stsynphot.
"""

import os
import subprocess
import sys
from pathlib import Path

import astropy.units as u
import numpy as np
import pytest
from astropy.io import fits
from astropy.modeling.models import BlackBody
from hypothesis import given, strategies as st

from catalogs import Band, Spectrum, load_pickles, load_reference_spectrum, load_stellar_grid
from cpic_core import InputError
from simulator.passbands import band_integral, v_photon_rate, vega_v_photon_rate
from simulator.target import STAR_FLAGS, read_spectrum, star_photlam, stellar_spectrum
from simulator.target.star_spectrum import find_tree, library_photlam, thermal_photlam, tree_photlam


@pytest.mark.parametrize("model", ["grid", "blackbody", "pickles"])
@pytest.mark.parametrize("spectral_type", ["F0V", "F5V", "G5V", "G8IV", "K1V", "K5V", "K0III", "M0V"])
@pytest.mark.parametrize("magnitude", [-26.76, 0.0, 1.35, 7.0])
def test_v_magnitude_is_the_one_asked_for(v_magnitude, model: str, spectral_type: str, magnitude: float) -> None:
    assert v_magnitude(star_photlam(magnitude, spectral_type, model=model)) == pytest.approx(magnitude, abs=1e-6)


@given(
    magnitude=st.floats(-27.0, 30.0),
    teff_k=st.floats(3500.0, 8000.0),
    log_g=st.floats(1.0, 5.0),
    metallicity=st.floats(-2.5, 0.5),
)
def test_v_magnitude_over_the_grid(v_magnitude, magnitude, teff_k, log_g, metallicity) -> None:
    source = star_photlam(magnitude, teff_k=teff_k, log_g=log_g, metallicity=metallicity)
    assert v_magnitude(source) == pytest.approx(magnitude, abs=1e-6)


@given(
    magnitude=st.floats(-27.0, 30.0),
    wavelength=st.lists(st.floats(300.0, 1000.0), max_size=30, unique=True),
    seed=st.integers(0, 2**32 - 1),
)
def test_v_magnitude_of_any_table(v_magnitude, magnitude, wavelength, seed) -> None:
    points = np.unique(np.round([*wavelength, 469.0, 550.0, 701.0], 3))
    table = Spectrum(points, 1e3 * np.random.default_rng(seed).random(points.size) + 1e-3)
    source = star_photlam(magnitude, model=table)
    assert v_magnitude(source) == pytest.approx(magnitude, abs=1e-6)


def test_vega_zero_point_near_1000_photons() -> None:
    # A V = 0 star gives about 1000 ph/s/cm2/A at 550 nm.
    source = star_photlam(0.0, "A0V", model="blackbody")
    assert source(5500.0).value == pytest.approx(1000.0, rel=0.02)


def test_blackbody_is_plancks_law() -> None:
    star = stellar_spectrum(2.0, teff_k=5772.0, model="blackbody")
    wavelength = star.wavelength_nm * u.nm
    energy = BlackBody(5772.0 * u.K, scale=1.0 * u.erg / u.s / u.cm**2 / u.AA / u.sr)(wavelength)
    ratio = star.photlam / (energy.value * star.wavelength_nm)
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-6)


def _node_flux(teff_k: float, log_g: float, metallicity: float) -> np.ndarray:
    """Photons of one node, written out: line structure times the ratio, linear in log wavelength."""
    grid = load_stellar_grid()
    at = [
        int(np.flatnonzero(axis == value)[0])
        for axis, value in ((grid.teff_k, teff_k), (grid.log_g, log_g), (grid.metallicity, metallicity))
    ]
    line = int(np.argmin(np.abs(grid.line_log_g - log_g)))
    ratio = np.interp(np.log(grid.wavelength_nm), np.log(grid.ratio_wavelength_nm), grid.ratio[tuple(at)])
    return 10.0 ** grid.log10_flam[at[0], line].astype(float) * ratio * grid.wavelength_nm


@pytest.mark.parametrize(("log_g", "metallicity"), [(4.5, 0.0), (2.0, 0.0), (3.5, -1.5)])
def test_node_spectrum_is_the_node_up_to_scale(log_g: float, metallicity: float) -> None:
    star = stellar_spectrum(4.0, teff_k=5500.0, log_g=log_g, metallicity=metallicity)
    node = _node_flux(5500.0, log_g, metallicity)
    np.testing.assert_allclose(star.photlam / node, star.photlam[0] / node[0], rtol=1e-12)


def test_interpolation_is_linear_in_flux() -> None:
    # Half-way between nodes on each axis the surface flux is the mean of the eight.
    star = stellar_spectrum(4.0, teff_k=5550.0, log_g=4.25, metallicity=0.1)
    mean = sum(_node_flux(t, g, m) for t in (5500.0, 5600.0) for g in (4.0, 4.5) for m in (0.0, 0.2))
    np.testing.assert_allclose(star.photlam / mean, star.photlam[0] / mean[0], rtol=1e-12)


def test_the_sun_in_every_band_of_50_nm_and_more() -> None:
    # V of the reference Sun (CALSPEC) is -26.768 on the Vega scale; nothing in the grid was fitted to it.
    sun = load_reference_spectrum("sun")
    magnitude = -2.5 * np.log10(v_photon_rate(sun.wavelength_nm, sun.photlam) / vega_v_photon_rate())
    assert magnitude == pytest.approx(-26.76, abs=0.01)
    for v_mag in (magnitude, -26.76):
        star = stellar_spectrum(v_mag, teff_k=5772.0, log_g=4.44)
        for width in (50.0, 75.0, 100.0, 200.0):
            centres = np.arange(400.0 + width / 2, 1000.1 - width / 2, 2.0)
            bands = [Band("x", "VIS", centre, width, 1.0, 1.0) for centre in centres]
            model = np.array([band_integral(band, star.wavelength_nm, star.photlam) for band in bands])
            known = np.array([band_integral(band, sun.wavelength_nm, sun.photlam) for band in bands])
            np.testing.assert_allclose(model, known, rtol=0.03)


@pytest.mark.parametrize(("spectral_type", "tolerance"), [("F5V", 0.06), ("G2V", 0.09), ("K0V", 0.11), ("K0III", 0.12)])
def test_measured_stars_in_bands_of_50_nm(spectral_type: str, tolerance: float) -> None:
    # The library's stars are tens of K cooler than the mean of their type, hence the wide tolerance.
    model = stellar_spectrum(5.0, spectral_type)
    measured = stellar_spectrum(5.0, spectral_type, model="pickles")
    bands = [Band("x", "VIS", centre, 50.0, 1.0, 1.0) for centre in range(425, 1000, 50)]
    ratio = [
        band_integral(band, model.wavelength_nm, model.photlam)
        / band_integral(band, measured.wavelength_nm, measured.photlam)
        for band in bands
    ]
    np.testing.assert_allclose(ratio, 1.0, atol=tolerance)


@pytest.mark.parametrize("options", [{"teff_k": 6000.0, "log_g": 0.0}, {"teff_k": 7400.0, "log_g": 0.5}])
def test_a_node_of_the_temperature_axis_needs_no_neighbour(options) -> None:
    assert stellar_spectrum(4.0, **options).flags == ("low_gravity_lines",)


def test_giants_have_spectra_of_their_own() -> None:
    giant = stellar_spectrum(1.0, "K0III")
    assert giant.flags == ("low_gravity_lines",)
    assert giant.log_g == pytest.approx(2.14)
    dwarf = stellar_spectrum(1.0, teff_k=giant.teff_k, log_g=4.5)
    blue = giant.wavelength_nm < 420.0
    assert giant.photlam[blue].sum() < 0.9 * dwarf.photlam[blue].sum()
    for spectral_type in ("G8III", "K5III", "F5II", "G0Ib", "M0III"):
        assert stellar_spectrum(1.0, spectral_type).log_g < 3.5


def test_guesses_are_flagged() -> None:
    assert stellar_spectrum(1.0, "G").flags == ("subclass_assumed", "luminosity_class_assumed")
    assert stellar_spectrum(1.0, teff_k=5800.0).flags == ("log_g_assumed",)
    assert stellar_spectrum(1.0, teff_k=5800.0, log_g=4.4).flags == ()
    assert stellar_spectrum(1.0, "sdF8:").flags == ("subdwarf_as_dwarf", "type_uncertain")
    assert stellar_spectrum(1.0, "K0V+M").flags == ("composite_first_used",)
    assert stellar_spectrum(1.0, "G1V", model="pickles").flags == ("template_interpolated",)


def test_what_a_model_does_not_use_is_flagged() -> None:
    star = stellar_spectrum(1.0, "G2V", log_g=4.3, metallicity=0.2, model="blackbody")
    assert star.flags == ("log_g_unused", "metallicity_unused")
    assert stellar_spectrum(1.0, teff_k=5800.0, metallicity=0.0, model="blackbody").flags == ()


def test_all_flags_have_words() -> None:
    found = set()
    for spectral_type in ("G", "K0:", "K0V+M", "sdF8", "K0III", "F7V"):
        for model in ("grid", "pickles"):
            found |= set(stellar_spectrum(1.0, spectral_type, log_g=None, model=model).flags)
    found |= set(stellar_spectrum(1.0, "G2V", teff_k=5800.0, log_g=4.3, metallicity=0.2, model="pickles").flags)
    found |= set(stellar_spectrum(1.0, teff_k=5800.0).flags)
    assert found == set(STAR_FLAGS)


def test_explicit_parameters_override_the_type() -> None:
    star = stellar_spectrum(1.35, "K1V", teff_k=5260, log_g=4.55, metallicity=0.2)
    assert (star.teff_k, star.log_g, star.metallicity, star.flags) == (5260.0, 4.55, 0.2, ())
    assert stellar_spectrum(1.35, "K1V", teff_k=5260.0).log_g == pytest.approx(4.5)
    with pytest.raises(ValueError, match="read-only"):
        star.photlam[0] = 0.0


@pytest.mark.parametrize("teff", [100.0, 800.0, 5772.0, 50000.0])
def test_planck_law_of_astropy(teff):
    wavelength = np.array([300.0, 550.0, 1000.0, 1750.0])
    surface = np.pi * u.sr * BlackBody(teff * u.K, scale=1.0 * u.erg / (u.cm**2 * u.s * u.AA * u.sr))(wavelength * u.nm)
    size = ((71492.0 * u.km) / (10.0 * u.pc)).to_value(u.dimensionless_unscaled)
    photlam = (size**2 * surface).to_value(u.photon / u.cm**2 / u.s / u.AA, u.spectral_density(wavelength * u.nm))
    np.testing.assert_allclose(thermal_photlam(wavelength, teff, 1.0, 10.0), photlam, rtol=1e-9)


def test_a_sphere_like_the_sun_at_10_pc_has_the_suns_absolute_magnitude():
    wavelength = np.arange(300.0, 1750.0, 0.5)
    photlam = thermal_photlam(wavelength, 5772.0, 695700.0 / 71492.0, 10.0)
    magnitude = -2.5 * np.log10(v_photon_rate(wavelength, photlam) / vega_v_photon_rate())
    # M_V of the Sun is 4.81 to 4.83; a black body of its temperature is a few per cent off in V.
    assert magnitude == pytest.approx(4.82, abs=0.1)


NM = np.linspace(350.0, 1000.0, 66)
PHOTLAM = 1.0 + np.sin(NM / 60.0) ** 2


def in_unit(unit: str) -> np.ndarray:
    """The same spectrum in another unit, converted by synphot."""
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
    from astropy.table import QTable

    x = NM * u.nm
    photlam = PHOTLAM * u.photon / (u.s * u.cm**2 * u.AA)
    y = photlam.to(u.Unit(flux_unit), u.spectral_density(x))
    QTable({"wavelength": x.to(u.Unit(wavelength_unit)), "flux": y}).write(tmp_path / "s", format=kind)
    np.testing.assert_allclose(read_spectrum(tmp_path / "s").photlam, PHOTLAM, rtol=1e-7)


@pytest.mark.parametrize("names", [("WAVELENGTH", "FLUX"), ("wave", "value")])
def test_fits_of_synphot_and_others(tmp_path: Path, names: tuple[str, str]) -> None:
    columns = [
        fits.Column("ERROR", "D", array=NM) if names[0] == "WAVELENGTH" else None,
        fits.Column(names[0], "D", unit="ANGSTROMS", array=10.0 * NM),
        fits.Column(names[1], "D", unit="FLAM", array=in_unit("flam")),
    ]
    table = fits.BinTableHDU.from_columns([item for item in columns if item])
    fits.HDUList([fits.PrimaryHDU(), table]).writeto(tmp_path / "s.fits")
    np.testing.assert_allclose(read_spectrum(tmp_path / "s.fits").photlam, PHOTLAM, rtol=1e-7)


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
def test_v_magnitude_is_the_one_asked_for_of_stellar_libraries(
    v_magnitude, tree, magnitude, teff, metal, log_g
) -> None:
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
