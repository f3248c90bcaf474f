"""Band rates: against direct integration of spectra, against the reference Sun, and their speed."""

import csv
import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from catalogs import Albedo, Band, Spectrum, load_albedo, load_bands, load_pickles, load_reference_spectrum, load_stars
from catalogs.spectra import PLANETS, Curve
from simulator import load_instrument
from simulator.imaging.store import metrics_key
from simulator.passbands import Passbands, band_flux_density, gauss_rule, v_photon_rate, vega_v_photon_rate
from simulator.target import star_photlam, stellar_spectrum

AREA_CM2 = 31416.0
ROOT = Path(__file__).resolve().parents[2]
STARS = [
    (1.35, 5260.0, 4.55, 0.2),
    (5.0, 3620.0, 4.9, -1.2),
    (4.0, 7930.0, 3.6, 0.45),
    (6.3, 5000.0, 4.5, 0.0),
    (2.1, 4810.0, 2.14, -0.3),
    (3.3, 7400.0, 0.5, 0.0),
]


@pytest.fixture(scope="module")
def passbands() -> Passbands:
    return Passbands.from_bands()


def _brute_force(band: Band, function, n: int = 200_001) -> float:
    """Trapezoid of function(nm) x transmission over the band, in A, on a grid much finer than the samples."""
    low, high = band.support_nm
    x = np.linspace(low, high, n)
    return float(np.trapezoid(function(x) * band.transmission(x), 10.0 * x))


@pytest.mark.parametrize("star", STARS)
def test_star_rates_equal_the_integrated_spectrum(passbands: Passbands, star) -> None:
    magnitude, teff, log_g, metal = star
    rates = passbands.star_rate_e_s(*star, AREA_CM2)
    spectrum = stellar_spectrum(magnitude, teff_k=teff, log_g=log_g, metallicity=metal)
    # Same law, same spectrum: the node table commutes with interpolation to rounding.
    np.testing.assert_allclose(
        rates, passbands.spectrum_rate_e_s(spectrum.wavelength_nm, spectrum.photlam, AREA_CM2), rtol=1e-13
    )
    source = star_photlam(magnitude, teff_k=teff, log_g=log_g, metallicity=metal)
    for band, rate in zip(passbands.bands, rates, strict=True):
        expected = AREA_CM2 * _brute_force(band, lambda x: source(10.0 * x).value)
        assert rate == pytest.approx(expected, rel=1e-6)


def test_synphot_observation_gives_the_same_count_rate(passbands: Passbands) -> None:
    from synphot import Observation, SpectralElement
    from synphot.models import Empirical1D

    source = star_photlam(5.0, "G5V")
    rates = passbands.star_rate_e_s(5.0, 5660.0, 4.49, 0.0, 100.0)
    for band, rate in zip(passbands.bands, rates, strict=True):
        low, high = (10.0 * edge for edge in band.support_nm)
        # Top-hat with edges 1e-6 A wide, sampled finely inside.
        points = np.concatenate([[low - 1e-6], np.linspace(low, high, 40_001), [high + 1e-6]])
        table = np.concatenate([[0.0], np.full(40_001, band.t_opt * band.qe), [0.0]])
        element = SpectralElement(Empirical1D, points=points, lookup_table=table)
        found = Observation(source, element, binset=points).integrate().value * 100.0
        assert rate == pytest.approx(found, rel=1e-6)


def test_alpha_cen_b_against_photometric_zero_points(passbands: Passbands) -> None:
    # V = 1.35, K1V: 272 / 321 / 319 / 283 ph/s/cm2/A from UBVRI zero points and colours, 5 per cent accuracy.
    bands = passbands.bands[:4]
    rates = passbands.star_rate_e_s(1.35, 5260.0, 4.55, 0.2, 1.0)[:4]
    density = rates / [band.t_opt * band.qe * band.width_nm * 10.0 for band in bands]
    np.testing.assert_allclose(density, [272.0, 321.0, 319.0, 283.0], rtol=0.06)


def test_the_sun_against_its_measured_spectrum(passbands: Passbands) -> None:
    sun = load_reference_spectrum("sun")
    magnitude = -2.5 * np.log10(v_photon_rate(sun.wavelength_nm, sun.photlam) / vega_v_photon_rate())
    assert magnitude == pytest.approx(-26.76, abs=0.015)
    model = passbands.star_rate_e_s(magnitude, 5772.0, 4.44, 0.0, 1.0)
    measured = passbands.spectrum_rate_e_s(sun.wavelength_nm, sun.photlam, 1.0)
    in_range = [band.support_nm[1] < 1000.0 for band in passbands.bands]
    assert sum(in_range) == 5
    np.testing.assert_allclose(model[in_range], measured[in_range], rtol=0.02)
    np.testing.assert_allclose(model, measured, rtol=0.03)
    strips = Passbands.from_bands(Band(f"B{c}", "VIS", c, 50.0, 1.0, 1.0) for c in range(425, 1000, 50))
    ratio = strips.star_rate_e_s(magnitude, 5772.0, 4.44, 0.0, 1.0) / strips.spectrum_rate_e_s(
        sun.wavelength_nm, sun.photlam, 1.0
    )
    np.testing.assert_allclose(ratio, 1.0, atol=0.02)


# Bessell 1990 (PASP 102, 1181, table 2): the I band of Cousins' system, 700 to 920 nm in steps of 10 nm.
COUSINS_I = "0 24 232 555 785 910 965 985 990 995 1000 1000 990 980 950 910 860 750 560 330 150 30 0"
COUSINS_I_CURVE = Curve(np.arange(700.0, 921.0, 10.0), np.array(COUSINS_I.split(), float) / 1000.0)
# Colours of the Sun: V-I of Ramirez et al. 2012 (ApJ 752, 5); V-J of G2V stars in the table of Pecaut & Mamajek below.
SUN_V_I, SUN_V_J = 0.702, 1.198
# Casagrande et al. 2010 (A&A 512, A54, table 4), solar metallicity: 5040 K / Teff = a + b X + c X^2.
INFRARED_FLUX_METHOD = {"I": (0.4033, 0.8171, -0.1987), "J": (0.4669, 0.3849, -0.0350)}
# Mean dwarfs of Pecaut & Mamajek 2013 (ApJS 208, 9), version 2022.04.16: Teff, V-I, V-J.
MEAN_DWARFS = [
    (6510.0, 0.506, 0.852),
    (6170.0, 0.599, 1.004),
    (5770.0, 0.713, 1.198),
    (5490.0, 0.786, 1.344),
    (5280.0, 0.853, 1.475),
    (5040.0, 0.920, 1.607),
    (4830.0, 1.013, 1.788),
    (4600.0, 1.190, 2.064),
    (4410.0, 1.272, 2.183),
    (4230.0, 1.420, 2.394),
    (4000.0, 1.632, 2.688),
]


def _v_minus(teff_k: float, log_g: float, metallicity: float = 0.0) -> dict[str, float]:
    """Colours of the grid in Cousins' I and 2MASS J (a top-hat of its mean and width), zero points from the Sun.

    The Sun is the grid's own, which is that of TSIS-1 within 1 per cent (tests/external/test_stellar_flux.py):
    CALSPEC's of 2001 has 2 per cent more light near 830 nm.
    """
    bands = Passbands.from_bands(
        [Band("I", "VIS", 805.0, 160.0, 1.0, 1.0, curve=COUSINS_I_CURVE), Band("J", "NIR", 1235.0, 162.0, 1.0, 1.0)]
    )
    ratio = bands.star_rate_e_s(0.0, teff_k, log_g, metallicity, 1.0) / bands.star_rate_e_s(0.0, 5772.0, 4.44, 0.0, 1.0)
    return {"I": SUN_V_I + 2.5 * float(np.log10(ratio[0])), "J": SUN_V_J + 2.5 * float(np.log10(ratio[1]))}


@pytest.mark.parametrize("teff_k", [4400.0, 4600.0, 4800.0, 5000.0, 5300.0, 5600.0, 6000.0, 6300.0, 6600.0])
def test_colours_of_dwarfs_are_those_of_the_infrared_flux_method(teff_k: float) -> None:
    for band, found in _v_minus(teff_k, 4.6 if teff_k < 5200.0 else 4.4).items():
        constant, slope, curvature = INFRARED_FLUX_METHOD[band]
        root = np.sqrt(slope**2 - 4.0 * curvature * (constant - 5040.0 / teff_k))
        expected = (root - slope) / (2.0 * curvature)
        assert 10.0 ** (0.4 * (found - expected)) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(("teff_k", "v_i", "v_j"), MEAN_DWARFS)
def test_colours_of_dwarfs_are_those_of_the_mean_sequence(teff_k: float, v_i: float, v_j: float) -> None:
    found = _v_minus(teff_k, 4.6 if teff_k < 5200.0 else 4.4)
    assert 10.0 ** (0.4 * (found["I"] - v_i)) == pytest.approx(1.0, abs=0.06)
    assert 10.0 ** (0.4 * (found["J"] - v_j)) == pytest.approx(1.0, abs=0.06)


def test_at_1000_nm_the_grid_is_the_sun_and_the_library_is_redder() -> None:
    """Codes that take a Pickles spectrum of the type have 5 to 8 % more light there; the measured Sun has not."""
    sun, template = load_reference_spectrum("sun"), stellar_spectrum(0.0, "G2V", model="pickles")
    bands = Passbands.from_bands([Band("B1000", "NIR", 1000.0, 100.0, 1.0, 1.0)])
    magnitude = -2.5 * np.log10(v_photon_rate(sun.wavelength_nm, sun.photlam) / vega_v_photon_rate())
    measured = bands.spectrum_rate_e_s(sun.wavelength_nm, sun.photlam, 1.0)[0] * 10.0 ** (0.4 * magnitude)
    grid = bands.star_rate_e_s(0.0, 5772.0, 4.44, 0.0, 1.0)[0]
    library = bands.spectrum_rate_e_s(template.wavelength_nm, template.photlam, 1.0)[0]
    assert grid / measured == pytest.approx(1.0, abs=0.015)
    assert 1.05 < library / measured < 1.10


def test_sky_is_a_faint_sun(passbands: Passbands) -> None:
    sun = load_reference_spectrum("sun")
    magnitude = -2.5 * np.log10(v_photon_rate(sun.wavelength_nm, sun.photlam) / vega_v_photon_rate())
    rate = passbands.sky_rate_e_s_arcsec2(magnitude + 47.768, AREA_CM2)
    sun_rate = passbands.spectrum_rate_e_s(sun.wavelength_nm, sun.photlam, AREA_CM2)
    np.testing.assert_allclose(rate, sun_rate * 10.0 ** (-0.4 * 47.768), rtol=1e-12)
    assert passbands.sky_rate_e_s_arcsec2([21.0, 22.0], AREA_CM2).shape == (2, 8)
    # 3e-5 e-/s/px/A at 21 mag for a 16 mas pixel: the order that the photon budget of the paper gives.
    band = passbands.bands[0]
    per_pixel = passbands.sky_rate_e_s_arcsec2(21.0, AREA_CM2)[0] * 0.016153**2
    assert per_pixel / (band.t_opt * band.qe * band.width_nm * 10.0) == pytest.approx(3.2e-5, rel=0.1)


@pytest.mark.parametrize("planet", PLANETS)
def test_band_albedo_equals_the_direct_ratio(passbands: Passbands, planet: str) -> None:
    table = load_albedo(planet)
    found = passbands.band_albedo(planet, 5260.0, 4.55, 0.2)
    spectrum = stellar_spectrum(1.0, teff_k=5260.0, log_g=4.55, metallicity=0.2)

    def flux(x: np.ndarray) -> np.ndarray:
        return np.interp(x, spectrum.wavelength_nm, spectrum.photlam)

    for band, value in zip(passbands.bands, found, strict=True):
        reflected = _brute_force(band, lambda x: flux(x) * np.interp(x, table.wavelength_nm, table.albedo))
        assert value == pytest.approx(reflected / _brute_force(band, flux), rel=1e-6)


def test_band_albedo_of_a_table(passbands: Passbands) -> None:
    wavelength = np.array([300.0, 1755.0])
    grey = Albedo(wavelength, np.array([0.3, 0.3]))
    np.testing.assert_allclose(passbands.band_albedo(grey, [4000.0, 7000.0], 4.4, 0.0), 0.3, rtol=1e-13)
    np.testing.assert_array_equal(passbands.albedo_flags(grey), False)
    sloped = Albedo(wavelength, wavelength / 2000.0)
    red, blue = passbands.band_albedo(sloped, [3600.0, 7900.0], 4.4, 0.0)
    assert np.all(red[:2] > blue[:2])  # redder light weighs the red side more
    np.testing.assert_allclose(red, [band.center_nm / 2000.0 for band in passbands.bands], rtol=1e-2)


def test_near_infrared_templates_are_flagged(passbands: Passbands) -> None:
    np.testing.assert_array_equal(passbands.albedo_flags("jupiter"), [False] * 5 + [True] * 3)


def test_filter_curve_is_integrated_exactly() -> None:
    curve = Curve(np.array([500.0, 507.3, 531.9, 540.0]), np.array([0.0, 0.9, 0.7, 0.0]))
    band = dataclasses.replace(load_bands()["F520"], curve=curve)
    passbands = Passbands.from_bands([band])
    spectrum = stellar_spectrum(2.0, "K1V")
    expected = _brute_force(band, lambda x: np.interp(x, spectrum.wavelength_nm, spectrum.photlam))
    assert passbands.spectrum_rate_e_s(spectrum.wavelength_nm, spectrum.photlam, 1.0)[0] == pytest.approx(
        expected, rel=1e-8
    )


def test_wavelength_nodes_of_a_top_hat_are_gauss_legendre(passbands: Passbands) -> None:
    for n in (1, 3, 7):
        wavelength, weights = passbands.wavelength_nodes("F662", n)
        t, w = np.polynomial.legendre.leggauss(n)
        np.testing.assert_allclose(wavelength, 662.0 + 27.5 * t, rtol=1e-14)
        np.testing.assert_allclose(weights, w / 2.0, rtol=1e-13)


@pytest.mark.parametrize("name", ["F520", "F850", "F1542"])
def test_weighted_nodes_integrate_polynomials_against_the_spectrum(passbands: Passbands, name: str) -> None:
    spectrum = stellar_spectrum(1.0, "K5V")
    band = passbands.bands[passbands.index(name)]
    n = 5
    wavelength, weights = passbands.wavelength_nodes(name, n, spectrum=spectrum)
    assert weights.min() > 0.0
    assert weights.sum() == pytest.approx(1.0, rel=1e-14)

    def flux(x: np.ndarray) -> np.ndarray:
        return np.interp(x, spectrum.wavelength_nm, spectrum.photlam)

    total = _brute_force(band, flux)
    for degree in range(2 * n):
        shape = lambda x, k=degree: ((x - band.center_nm) / band.width_nm) ** k  # noqa: E731
        expected = _brute_force(band, lambda x, f=shape: flux(x) * f(x)) / total
        assert np.sum(weights * shape(wavelength)) == pytest.approx(expected, abs=1e-7)


def test_nodes_of_a_steep_curve_keep_non_negative_weights() -> None:
    curve = Curve(np.array([500.0, 501.0, 540.0]), np.array([0.0, 1.0, 0.0]))
    band = dataclasses.replace(load_bands()["F520"], curve=curve)
    steep = dataclasses.replace(
        band, name="Spike", curve=Curve(np.array([500.0, 539.0, 539.9, 540.0]), np.array([0.0, 0.0, 1.0, 0.0]))
    )
    passbands = Passbands.from_bands([band, steep])
    for name in passbands.names:
        for n in (2, 5, 9):
            wavelength, weights = passbands.wavelength_nodes(name, n)
            assert weights.min() >= 0.0
            assert weights.sum() == pytest.approx(1.0)
            assert wavelength[0] > 500.0
            assert wavelength[-1] < 540.0


def test_outside_the_grid_is_clamped_and_flagged(passbands: Passbands) -> None:
    for outside, edge in (
        ((4800.0, -0.3), (4800.0, 0.0)),
        ((7900.0, 0.2), (7900.0, 1.0)),
        ((3000.0, 4.9), (3500.0, 4.9)),
    ):
        rates = passbands.star_rate_e_s(2.0, *outside, 0.0, AREA_CM2)
        np.testing.assert_array_equal(rates, passbands.star_rate_e_s(2.0, *edge, 0.0, AREA_CM2))
    flags = passbands.grid_flags([4800.0, 7900.0, 4800.0, 5772.0, 3000.0], [-0.3, 0.2, 2.1, 4.44, 4.9], 0.0)
    np.testing.assert_array_equal(flags.any, [True, True, False, False, True])
    np.testing.assert_array_equal(flags.log_g, [True, True, False, False, False])
    np.testing.assert_array_equal(flags.teff_k, [False, False, False, False, True])


def test_equal_bands_share_one_object() -> None:
    assert Passbands.from_bands() is Passbands.from_bands(list(load_bands().values()))
    assert Passbands.from_bands([load_bands()["F662"]]).names == ("F662",)


def test_from_instrument_uses_its_numbers() -> None:
    entry = {"camera": "VIS", "center_nm": 600.0, "width_nm": 30.0, "t_opt": 0.3, "qe": 0.8, "transmission_file": None}
    instrument = SimpleNamespace(bands={"F600": SimpleNamespace(**entry)})
    passbands = Passbands.from_instrument(instrument)
    assert passbands.bands == (Band("F600", "VIS", 600.0, 30.0, 0.3, 0.8),)


def test_from_instrument_reads_a_transmission_file(tmp_path) -> None:
    path = tmp_path / "f600.txt"
    path.write_text("# nm\n580 0\n590 1\n610 1\n620 0\n")
    entry = {"camera": "VIS", "center_nm": 600.0, "width_nm": 30.0, "t_opt": 0.3, "qe": 0.8}
    instrument = SimpleNamespace(bands={"F600": SimpleNamespace(**entry, transmission_file=str(path))})
    curved = Passbands.from_instrument(instrument)
    hat = Passbands.from_bands([Band("F600", "VIS", 600.0, 30.0, 0.3, 0.8)])
    star = (3.0, 5800.0, 4.4, 0.0, 1.0)
    np.testing.assert_allclose(curved.star_rate_e_s(*star), hat.star_rate_e_s(*star), rtol=5e-3)


@pytest.mark.parametrize(
    ("center_nm", "width_nm", "said"),
    [
        (606.0, 60.0, "606 and 60 nm: not accepted; allowed: 850.0 and 58.0 nm, those of curve.dat"),
        (838.0, 58.0, "838 and 58 nm"),
        (850.0, 80.0, "850 and 80 nm"),
        (850.0, 40.0, "850 and 40 nm"),
    ],
)
def test_a_curve_elsewhere_than_its_band_is_refused(tmp_path, refused, center_nm, width_nm, said) -> None:
    (tmp_path / "curve.dat").write_text("# nm\n820 0\n822 0.9\n878 0.9\n880 0\n")
    band = {"camera": "VIS", "center_nm": center_nm, "width_nm": width_nm, "t_opt": 0.2, "qe": 0.9}
    instrument = load_instrument({"bands": {"X": band | {"transmission_file": str(tmp_path / "curve.dat")}}})
    message = refused("instrument.bands.X.center_nm and width_nm", Passbands.from_instrument, instrument)
    assert said in message
    refused("instrument.bands.X.center_nm and width_nm", metrics_key, instrument, "X")


@pytest.mark.parametrize(("low", "high"), [(299.0, 1100.0), (310.0, 1900.0)])
def test_a_curve_beyond_the_spectra_is_named(tmp_path, refused, low, high) -> None:
    (tmp_path / "curve.dat").write_text(f"# nm\n{low} 1e-4\n589 1e-4\n590 0.9\n610 0.9\n611 1e-4\n{high} 1e-4\n")
    band = {"camera": "VIS", "center_nm": 600, "width_nm": 21, "t_opt": 0.2, "qe": 0.9}
    instrument = load_instrument({"bands": {"X": band | {"transmission_file": str(tmp_path / "curve.dat")}}})
    refused(f"^curve.dat wavelengths = {low:g} to {high:g} nm.*300.15 to", Passbands.from_instrument, instrument)


@pytest.mark.parametrize(
    "call",
    [
        lambda p: p.star_rate_e_s(np.nan, 5800.0, 4.4, 0.0, 1.0),
        lambda p: p.star_rate_e_s(1.0, np.nan, 4.4, 0.0, 1.0),
        lambda p: p.star_rate_e_s(1.0, 5800.0, 4.4, 0.0, 0.0),
        lambda p: p.star_rate_e_s(1.0, 5800.0, 4.4, 0.0, np.nan),
        lambda p: p.sky_rate_e_s_arcsec2(np.inf, 1.0),
        lambda p: p.band_albedo("earth", 5800.0, 4.4, 0.0),
        lambda p: p.band_albedo(Albedo(np.array([300.0, 900.0]), np.array([0.3, 0.3])), 5800.0, 4.4, 0.0),
        lambda p: p.band_albedo(Albedo(np.array([300.0, 1800.0]), np.array([0.3, -0.3])), 5800.0, 4.4, 0.0),
        lambda p: p.spectrum_rate_e_s([300.0, 1800.0], [1.0, np.nan], 1.0),
        lambda p: p.spectrum_rate_e_s([300.0, 300.0], [1.0, 1.0], 1.0),
        lambda p: p.spectrum_rate_e_s([400.0, 800.0], [1.0, 1.0], 1.0),
        lambda p: p.spectrum_rate_e_s([400.0, 800.0, 900.0], [1.0, 1.0], 1.0),
        lambda p: p.wavelength_nodes("F520", 0),
        lambda p: p.wavelength_nodes("F999", 3),
        lambda p: p.wavelength_nodes("F850", 3, spectrum=Spectrum(np.array([400.0, 700.0]), np.array([1.0, 1.0]))),
        lambda p: p.index("V"),
        lambda p: Passbands.from_bands([]),
        lambda p: Passbands.from_bands([p.bands[0], p.bands[0]]),
        lambda p: Passbands.from_bands([Band("K", "NIR", 2200.0, 100.0, 0.2, 0.8)]),
    ],
)
def test_bad_input_is_refused(refused, passbands: Passbands, call) -> None:
    refused("", call, passbands)


def test_a_whole_catalogue_in_one_call(passbands: Passbands) -> None:
    rng = np.random.default_rng(0)
    n = 1100
    stars = (rng.uniform(0, 7, n), rng.uniform(3600, 7500, n), rng.uniform(1, 5, n), rng.uniform(-1, 0.5, n))
    rates = passbands.star_rate_e_s(*stars, AREA_CM2)
    assert rates.shape == (n, 8)
    assert np.all(rates > 0.0)


def test_nodes_of_a_narrow_curve_have_its_width() -> None:
    """A bell 8.5 nm wide in a window of 99 nm: mean and spread of the nodes are those of the detected light."""
    wavelength = np.linspace(560.0, 659.0, 400)
    curve = Curve(wavelength, np.exp(-(((wavelength - 610.0) / 12.0) ** 2)))
    passbands = Passbands.from_bands([dataclasses.replace(load_bands()["F662"], name="Bell", curve=curve)])
    for n in (2, 4, 7):
        nodes, weights = passbands.wavelength_nodes("Bell", n)
        assert weights @ nodes == pytest.approx(610.0, abs=0.01)
        assert np.sqrt(weights @ (nodes - 610.0) ** 2) == pytest.approx(12.0 / np.sqrt(2.0), rel=1e-3)


def test_gauss_rule_of_equal_masses_is_exact() -> None:
    points = np.linspace(-3.0, 8.0, 41)
    nodes, weights = gauss_rule(points, np.ones(41), 6)
    for degree in range(12):
        assert weights @ nodes**degree == pytest.approx(np.mean(points**degree), rel=1e-10)
    assert gauss_rule(np.array([2.0, 2.0]), np.ones(2), 1)[0] == pytest.approx([2.0])


# V-I of stars of the catalogue, mag, measured by Casagrande et al. 2006 (MNRAS 373, 13, table 1).
MEASURED_V_I = {
    "HD 106516": 0.571,
    "HD 179949": 0.595,
    "HD 73524": 0.640,
    "HD 4308": 0.725,
    "HD 144579": 0.788,
    "HD 22879": 0.662,
    "HD 59468": 0.732,
    "HD 144628": 0.925,
    "HD 109200": 0.896,
    "HD 4747": 0.820,
    "HD 67199": 0.896,
    "HD 5133": 1.000,
    "HD 222335": 0.850,
    "HD 98281": 0.788,
    "HD 3765": 0.980,
    "HD 120780": 0.975,
    "HD 154577": 0.980,
    "HD 190007": 1.205,
    "HD 215500": 0.771,
}
# The first 60 stars of the ranking (its tests compare the names) and their V-I in the system of Cousins where it was
# observed: Hipparcos says so of a colour by A in its field H42; the others are cited in E. Mamajek's notes on spectral
# types (github.com/emamajek/SpectralType). Of HD 10780 that field is not at hand. No value is of a pair.
FIRST_TARGETS = list(csv.DictReader((ROOT / "tests/first_targets.csv").read_text(encoding="utf-8").splitlines()))
# K dwarfs beyond the first 60 of which Hipparcos says the same (ESA 1997, SP-1200, field H42 = A); of gam Cep, a giant,
# that field is not at hand.
FURTHER_V_I = {"gam Cep": 0.99, "HD 16160": 1.06, "HD 32147": 1.10, "HD 100623": 0.88, "HD 192310": 0.93}
# Both stars of 70 Oph and of 36 Oph in one aperture: Cousins 1980, SAAO Circ. 1, 234.
V_I_OF_PAIRS = {("70 Oph A", "70 Oph B"): 0.965, ("36 Oph A", "36 Oph B"): 0.925}
# Bessell 1990, table 2: the B band, 360 to 560 nm in steps of 10 nm.
BESSELL_B = [0, 30, 134, 567, 920, 978, 1000, 978, 935, 853, 740, 640, 536, 424, 325, 235, 150, 95, 43, 9, 0]
SUN_B_V = 0.653  # Ramirez et al. 2012


def _catalogue_star(name: str) -> dict[str, Any]:
    stars = load_stars()
    return stars.row(stars.column("name").tolist().index(name))


def test_red_light_of_catalogue_stars_is_what_was_measured() -> None:
    """V-I of the grid at the catalogue's parameters; HD 144579 alone is off, whose V-K too is that of a hotter star."""
    ratios = {}
    for name, measured in MEASURED_V_I.items():
        row = _catalogue_star(name)
        ratios[name] = 10.0 ** (0.4 * (_v_minus(row["teff_k"], row["log_g"], row["metallicity"])["I"] - measured))
    assert np.mean(list(ratios.values())) == pytest.approx(1.0, abs=0.015)
    assert {name for name, ratio in ratios.items() if abs(ratio - 1.0) > 0.05} == {"HD 144579"}


def _grid_v_i(row: dict[str, Any]) -> float:
    return _v_minus(row["teff_k"], row["log_g"], row["metallicity"])["I"]


def test_red_light_of_the_first_targets_is_what_was_measured() -> None:
    """Light in I of 37 of the first 60 and 5 others, relative to V, within 5 per cent; the mean of all, within 1.

    The published V-I of 61 Cyg B runs from 1.56 (transformed from the system of Kron) to 1.63 (Gaia), its temperature
    from 4044 to 4174 K; the grid at the median temperature has 1.52, which is 7 per cent less light in I than 1.60.
    """
    measured = FURTHER_V_I | {row["star"]: float(row["v_i_mag"]) for row in FIRST_TARGETS if row["v_i_mag"]}
    ratios = {name: 10.0 ** (0.4 * (_grid_v_i(_catalogue_star(name)) - v_i)) for name, v_i in measured.items()}
    assert len(ratios) == 42
    assert np.mean(list(ratios.values())) == pytest.approx(1.0, abs=0.01)
    assert {name for name, ratio in ratios.items() if abs(ratio - 1.0) > 0.05} == {"61 Cyg B"}
    assert ratios["61 Cyg B"] == pytest.approx(1.0, abs=0.08)


@pytest.mark.parametrize("pair", V_I_OF_PAIRS)
def test_red_light_of_pairs_is_what_was_measured_of_both_stars(pair: tuple[str, str]) -> None:
    rows = [_catalogue_star(name) for name in pair]
    v = np.array([row["v_mag"] for row in rows])
    i = v - [_grid_v_i(row) for row in rows]
    both = 2.5 * np.log10(np.sum(10.0 ** (-0.4 * i)) / np.sum(10.0 ** (-0.4 * v)))
    assert 10.0 ** (0.4 * (both - V_I_OF_PAIRS[pair])) == pytest.approx(1.0, abs=0.05)


@pytest.fixture(scope="module")
def colour_bands() -> Passbands:
    bessell_b = Curve(np.arange(360.0, 561.0, 10.0), np.array(BESSELL_B) / 1000.0)
    return Passbands.from_bands(
        [
            Band("B", "VIS", 460.0, 200.0, 1.0, 1.0, curve=bessell_b),
            Band("I", "VIS", 805.0, 160.0, 1.0, 1.0, curve=COUSINS_I_CURVE),
            *(load_bands()[name] for name in ("F720", "F850")),
        ]
    )


def _rates_at_v_0(bands: Passbands, spectrum: Any, photlam: np.ndarray) -> np.ndarray:
    """Rates in B, I, F720 and F850 of a spectrum that is normalised to V = 0."""
    rates = bands.spectrum_rate_e_s(spectrum.wavelength_nm, photlam, 1.0)
    return rates * vega_v_photon_rate() / v_photon_rate(spectrum.wavelength_nm, photlam)


@pytest.fixture(scope="module")
def templates(colour_bands: Passbands) -> dict[int, np.ndarray]:
    """B-V and V-I (mag) and the logarithms of the rates in F720 and F850 at V = 0 of the Pickles spectra, by class."""
    library, sun = load_pickles(), load_reference_spectrum("sun")
    rates = np.array([_rates_at_v_0(colour_bands, library, photlam) for photlam in library.photlam])
    solar = _rates_at_v_0(colour_bands, sun, sun.photlam)
    b_v = SUN_B_V - 2.5 * np.log10(rates[:, 0] / solar[0])
    v_i = SUN_V_I + 2.5 * np.log10(rates[:, 1] / solar[1])
    table = np.column_stack([b_v, v_i, np.log(rates[:, 2:])])
    return {rank: table[library.luminosity_rank == rank] for rank in (3, 4, 5)}


UNLIKE_THEIR_TEMPLATE = {
    "61 Cyg B": "7 per cent less light in I than measured, see the test of V-I",
    "HD 88230": "4 per cent less light in I than measured, 6 in F850",
}


def test_first_targets_are_as_red_as_measured_spectra_of_their_colour(
    colour_bands: Passbands, templates: dict[int, np.ndarray]
) -> None:
    """Rates in F720 and F850 against measured spectra of the class and V-I of the star, or its B-V without a V-I.

    Beside the spectrum of the printed type eps Ind, called K5V with the colours of K4V, has 22 per cent less: one step
    of type near K3V is 13 per cent in F850. Within 5 per cent by V-I; within 8 by B-V, which depends on metals too.
    """
    unlike = {}
    for target in FIRST_TARGETS:
        row = _catalogue_star(target["star"])
        index = 1 if target["v_i_mag"] else 0
        own = float(target["v_i_mag"]) if index else row["b_v_mag"]
        table = templates[{"III": 3, "IV": 4}.get(row["luminosity_class"], 5)]
        table = table[np.argsort(table[:, index])]
        expected = np.exp([np.interp(own, table[:, index], table[:, column]) for column in (2, 3)])
        found = colour_bands.star_rate_e_s(0.0, row["teff_k"], row["log_g"], row["metallicity"], 1.0)[2:]
        worst = float(np.max(np.abs(found / expected - 1.0)))
        if worst > (0.05 if index else 0.08):
            unlike[target["star"]] = worst
    assert set(unlike) == set(UNLIKE_THEIR_TEMPLATE)
    assert max(unlike.values()) < 0.10


@pytest.mark.parametrize("name", ["F520", "F850", "F1542"])
def test_flux_density_is_synphots(passbands: Passbands, name: str) -> None:
    from synphot import Observation, SpectralElement
    from synphot.models import Empirical1D

    star = stellar_spectrum(5.0, "K1V")
    band = passbands.bands[passbands.index(name)]
    low, high = (10.0 * edge for edge in band.support_nm)
    curve = Empirical1D(points=[low - 1e-4, low, high, high + 1e-4], lookup_table=[0.0, 0.2, 0.2, 0.0])
    source = star_photlam(5.0, "K1V")
    bins = np.arange(low - 50.0, high + 50.0, 0.25)
    seen = Observation(source, SpectralElement(curve), binset=bins)
    flux, wavelength_nm = band_flux_density(band, star)
    # 1 erg/s/cm2/A is 10 W/m2/um.
    assert flux == pytest.approx(10.0 * seen.effstim("flam").value, rel=1e-3)
    assert 10.0 * wavelength_nm == pytest.approx(seen.effective_wavelength().value, rel=1e-4)
