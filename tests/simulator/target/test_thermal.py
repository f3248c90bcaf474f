"""Thermal light against astropy's Planck law and a star seen from afar."""

import astropy.units as u
import numpy as np
import pytest
from astropy.modeling.models import BlackBody

from simulator.target.thermal import thermal_photlam


@pytest.mark.parametrize("teff", [100.0, 800.0, 5772.0, 50000.0])
def test_planck_law_of_astropy(teff):
    wavelength = np.array([300.0, 550.0, 1000.0, 1750.0])
    surface = np.pi * u.sr * BlackBody(teff * u.K, scale=1.0 * u.erg / (u.cm**2 * u.s * u.AA * u.sr))(wavelength * u.nm)
    size = ((71492.0 * u.km) / (10.0 * u.pc)).to_value(u.dimensionless_unscaled)
    photlam = (size**2 * surface).to_value(u.photon / u.cm**2 / u.s / u.AA, u.spectral_density(wavelength * u.nm))
    np.testing.assert_allclose(thermal_photlam(wavelength, teff, 1.0, 10.0), photlam, rtol=1e-9)


def test_a_sphere_like_the_sun_at_10_pc_has_the_suns_absolute_magnitude():
    from simulator.band_integrals import v_photon_rate, vega_v_photon_rate

    wavelength = np.arange(300.0, 1750.0, 0.5)
    photlam = thermal_photlam(wavelength, 5772.0, 695700.0 / 71492.0, 10.0)
    magnitude = -2.5 * np.log10(v_photon_rate(wavelength, photlam) / vega_v_photon_rate())
    # M_V of the Sun is 4.81 to 4.83; a black body of its temperature is a few per cent off in V.
    assert magnitude == pytest.approx(4.82, abs=0.1)
