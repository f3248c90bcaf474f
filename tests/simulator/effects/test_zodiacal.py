"""Zodiacal light against the published numbers of Leinert et al. 1998."""

import numpy as np
import pytest

from catalogs.spectra import HC_ERG_ANGSTROM, load_zodi_table
from simulator.band_integrals import v_photon_rate, vega_v_photon_rate
from simulator.effects.zodiacal import colour_factor, zodiacal_photlam_arcsec2, zodiacal_radiance

S10_W_M2_SR_UM = 1.28e-8  # table 2: a tenth-magnitude solar star per square degree, at 500 nm
ARCSEC2_PER_SR = (180 * 3600 / np.pi) ** 2


@pytest.mark.parametrize(
    ("longitude", "latitude", "s10"),
    # Table 16, in tenth-magnitude stars per square degree: pole, quadrature, gegenschein, 60 and 45 degrees.
    [
        (0, 90, 60),
        (123, -90, 60),
        (90, 0, 202),
        (-90, 0, 202),
        (180, 0, 180),
        (540, 0, 180),
        (60, 0, 395),
        (45, 0, 710),
    ],
)
def test_anchors(longitude, latitude, s10):
    found = zodiacal_radiance(longitude, latitude)
    assert found.radiance_500nm_w_m2_sr_um == pytest.approx(s10 * S10_W_M2_SR_UM, rel=0.01)
    assert not found.solar_avoidance


def test_table_is_returned_at_its_own_places():
    table = load_zodi_table()
    for i, longitude in enumerate(table.helioecliptic_longitude_deg):
        for j, latitude in enumerate(table.ecliptic_latitude_deg):
            expected = table.radiance_500nm_w_m2_sr_um[i, j]
            for sign in (1, -1):
                found = zodiacal_radiance(sign * longitude + 360.0, -sign * latitude)
                assert found.solar_avoidance == np.isnan(expected)
                if np.isfinite(expected):
                    assert found.radiance_500nm_w_m2_sr_um == pytest.approx(expected, rel=1e-12)


def test_between_cells_the_logarithm_is_linear():
    low, high = (zodiacal_radiance(x, 0.0).radiance_500nm_w_m2_sr_um for x in (15.0, 20.0))
    assert zodiacal_radiance(17.5, 0.0).radiance_500nm_w_m2_sr_um == pytest.approx(np.sqrt(low * high), rel=1e-12)


def test_all_over_the_sky_it_is_finite_and_falls_away_from_the_sun(rng):
    for longitude, latitude in zip(720 * rng.random(500) - 360, 180 * rng.random(500) - 90, strict=True):
        assert 60e-8 < zodiacal_radiance(longitude, latitude).radiance_500nm_w_m2_sr_um <= 11500e-8
    along = [zodiacal_radiance(x, 0.0).radiance_500nm_w_m2_sr_um for x in np.linspace(0, 135, 200)]
    assert np.all(np.diff(along) <= 1e-20)


def test_around_the_sun_a_lower_limit_is_flagged():
    for longitude, latitude in ((0, 0), (14.9, 0), (-5, 9), (0, 14.9), (10, 9.9)):
        found = zodiacal_radiance(longitude, latitude)
        assert found.solar_avoidance
        assert found.radiance_500nm_w_m2_sr_um >= 3140e-8
    assert not zodiacal_radiance(15.0, 0.0).solar_avoidance
    assert not zodiacal_radiance(0.0, 15.0).solar_avoidance


def test_colour_factor():
    # Leinert et al. 1998, eq. 22.
    for elongation, below, above in ((30, 1.2, 0.8), (10, 1.2, 0.8), (90, 0.9, 0.6), (150, 0.9, 0.6), (60, 1.05, 0.7)):
        assert colour_factor(500.0, elongation) == 1.0
        assert colour_factor(400.0, elongation) == pytest.approx(1 + below * np.log10(0.8))
        assert colour_factor(1000.0, elongation) == pytest.approx(1 + above * np.log10(2.0))


@pytest.mark.parametrize("wavelength_um", [0.5, 0.7, 0.9, 1.0, 1.2])
def test_spectrum_agrees_with_the_published_one(wavelength_um):
    # Table 19, at 90 degrees from the Sun in the ecliptic, is another source than the colour factor; two digits.
    table = load_zodi_table()
    spectrum = zodiacal_photlam_arcsec2(259e-8, 90.0)
    chosen = np.abs(spectrum.wavelength_nm / (1000 * wavelength_um) - 1) < 0.03
    erg = (spectrum.photlam * HC_ERG_ANGSTROM / (10 * spectrum.wavelength_nm))[chosen].mean()
    radiance = erg * 10.0 * ARCSEC2_PER_SR  # erg/s/cm2/A/arcsec2 to W/m2/um/sr
    expected = table.spectrum_radiance_w_m2_sr_um[np.isclose(table.spectrum_wavelength_um, wavelength_um)][0]
    assert radiance == pytest.approx(expected, rel=0.08)


def test_brightness_of_the_pole_in_v():
    # 60 tenth-magnitude stars a square degree: 10 - 2.5 log(60 / 3600^2) = 23.34 mag/arcsec2 of solar colour.
    spectrum = zodiacal_photlam_arcsec2(77e-8, 90.0)
    v = -2.5 * np.log10(v_photon_rate(spectrum.wavelength_nm, spectrum.photlam) / vega_v_photon_rate())
    assert v == pytest.approx(10 - 2.5 * np.log10(60 / 3600**2), abs=0.08)
