"""Stellar spectra: V magnitudes by synphot, Planck's law, flags and bad input."""

from __future__ import annotations

import numpy as np
import pytest

from catalogs.errors import InputError
from catalogs.spectra import load_johnson_v, load_reference_spectrum, load_stellar_grid
from simulator.target import star_photlam, stellar_spectrum


@pytest.fixture(scope="module")
def v_magnitude():
    """V on the Vega scale, computed by synphot alone."""
    from synphot import Observation, SourceSpectrum, SpectralElement
    from synphot.models import Empirical1D

    curve, vega = load_johnson_v(), load_reference_spectrum("vega")
    element = SpectralElement(Empirical1D, points=10.0 * curve.wavelength_nm, lookup_table=curve.transmission)
    zero = SourceSpectrum(Empirical1D, points=10.0 * vega.wavelength_nm, lookup_table=vega.photlam)
    return lambda source: float(Observation(source, element).effstim("vegamag", vegaspec=zero).value)


@pytest.mark.parametrize("model", ["grid", "blackbody"])
@pytest.mark.parametrize("spectral_type", ["F0V", "F5V", "G5V", "G8IV", "K1V", "K5V", "K0III", "M0V"])
@pytest.mark.parametrize("magnitude", [-26.76, 0.0, 1.35, 7.0])
def test_v_magnitude_is_the_one_asked_for(v_magnitude, model: str, spectral_type: str, magnitude: float) -> None:
    assert v_magnitude(star_photlam(magnitude, spectral_type, model=model)) == pytest.approx(magnitude, abs=1e-6)


@pytest.mark.parametrize("teff_k", [3500.0, 3555.5, 5000.0, 7100.0, 8000.0])
@pytest.mark.parametrize("metallicity", [-2.5, -0.7, 0.0, 0.35])
def test_v_magnitude_over_the_grid(v_magnitude, teff_k: float, metallicity: float) -> None:
    source = star_photlam(5.0, teff_k=teff_k, log_g=4.3, metallicity=metallicity)
    assert v_magnitude(source) == pytest.approx(5.0, abs=1e-6)


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


def test_node_spectrum_is_the_node_up_to_scale() -> None:
    grid = load_stellar_grid()
    star = stellar_spectrum(4.0, teff_k=5500.0, log_g=4.5, metallicity=0.0)
    flam = 10.0 ** grid.log10_flam[20, 2].astype(float) * grid.wavelength_nm
    np.testing.assert_allclose(star.photlam / flam, star.photlam[0] / flam[0], rtol=1e-12)


def test_interpolation_is_linear_in_flux() -> None:
    # Half-way between two nodes the surface flux is their mean.
    grid = load_stellar_grid()
    star = stellar_spectrum(4.0, teff_k=5550.0, log_g=4.5, metallicity=0.0)
    mean = 0.5 * sum(10.0 ** grid.log10_flam[i, 2].astype(float) for i in (20, 21)) * grid.wavelength_nm
    np.testing.assert_allclose(star.photlam / mean, star.photlam[0] / mean[0], rtol=1e-12)


def test_clamps_and_guesses_are_flagged() -> None:
    giant = stellar_spectrum(1.0, "K0III")
    assert giant.flags == ("log_g_clamped",)
    assert giant.log_g == 3.5
    assert stellar_spectrum(1.0, "G2V", metallicity=-4.0).flags == ("metallicity_clamped",)
    assert stellar_spectrum(1.0, "G").flags == ("subclass_assumed", "luminosity_class_assumed")
    assert stellar_spectrum(1.0, teff_k=5800.0).flags == ("log_g_assumed",)
    assert stellar_spectrum(1.0, teff_k=5800.0, log_g=4.4).flags == ()


def test_explicit_parameters_override_the_type() -> None:
    star = stellar_spectrum(1.35, "K1V", teff_k=5260.0, log_g=4.55, metallicity=0.2)
    assert (star.teff_k, star.log_g, star.metallicity, star.flags) == (5260.0, 4.55, 0.2, ())
    assert stellar_spectrum(1.35, "K1V", teff_k=5260.0).log_g == pytest.approx(4.5)
    with pytest.raises(ValueError, match="read-only"):
        star.photlam[0] = 0.0


@pytest.mark.parametrize(
    ("arguments", "options", "key"),
    [
        ((np.nan, "G2V"), {}, "magnitude_v"),
        ((99.0, "G2V"), {}, "magnitude_v"),
        ((1.0,), {}, "spectral_type"),
        ((1.0, "banana"), {}, "spectral_type"),
        ((1.0, "A0V"), {}, "teff_k"),
        ((1.0, "M4V"), {}, "teff_k"),
        ((1.0,), {"teff_k": np.nan}, "teff_k"),
        ((1.0,), {"teff_k": 5800.0, "log_g": np.nan}, "log_g"),
        ((1.0, "G2V"), {"metallicity": np.inf}, "metallicity"),
        ((1.0, "G2V"), {"model": "ck04"}, "model"),
        ((1.0,), {"teff_k": 0.0, "model": "blackbody"}, "teff_k"),
    ],
)
def test_bad_input_names_the_key(arguments, options, key: str) -> None:
    for function in (stellar_spectrum, star_photlam):
        with pytest.raises(InputError) as caught:
            function(*arguments, **options)
        assert caught.value.key == key
