"""Stellar spectra: V magnitudes by synphot, Planck's law, flags and bad input.

Thermal light against astropy's Planck law and a star seen from afar.
"""

import astropy.units as u
import numpy as np
import pytest
from astropy.modeling.models import BlackBody
from hypothesis import given, strategies as st

from catalogs import Band, Spectrum, load_reference_spectrum, load_stellar_grid
from simulator.passbands import band_integral, v_photon_rate, vega_v_photon_rate
from simulator.target import STAR_FLAGS, star_photlam, stellar_spectrum
from simulator.target.star_spectrum import thermal_photlam


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


def test_photlam_over_angstrom() -> None:
    source = star_photlam(3.0, "G2V")
    star = stellar_spectrum(3.0, "G2V")
    assert source(10.0 * star.wavelength_nm[500]).value == pytest.approx(star.photlam[500], rel=1e-12)
    assert source(2500.0).value == 0.0 == source(18000.0).value
    assert source.meta["teff_k"] == 5770.0
    assert source.meta["flags"] == ()
    assert source.meta["model"] == "grid"


def test_blackbody_is_plancks_law() -> None:
    from astropy import units as u
    from astropy.modeling.models import BlackBody

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
    from simulator.passbands import v_photon_rate, vega_v_photon_rate

    wavelength = np.arange(300.0, 1750.0, 0.5)
    photlam = thermal_photlam(wavelength, 5772.0, 695700.0 / 71492.0, 10.0)
    magnitude = -2.5 * np.log10(v_photon_rate(wavelength, photlam) / vega_v_photon_rate())
    # M_V of the Sun is 4.81 to 4.83; a black body of its temperature is a few per cent off in V.
    assert magnitude == pytest.approx(4.82, abs=0.1)
