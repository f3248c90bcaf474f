"""What several tests of stellar spectra need."""

import pytest

from catalogs import load_johnson_v, load_reference_spectrum


@pytest.fixture(scope="session")
def v_magnitude():
    """V on the Vega scale, computed by synphot alone."""
    from synphot import Observation, SourceSpectrum, SpectralElement
    from synphot.models import Empirical1D

    curve, vega = load_johnson_v(), load_reference_spectrum("vega")
    element = SpectralElement(Empirical1D, points=10.0 * curve.wavelength_nm, lookup_table=curve.transmission)
    zero = SourceSpectrum(Empirical1D, points=10.0 * vega.wavelength_nm, lookup_table=vega.photlam)
    return lambda source: float(Observation(source, element).effstim("vegamag", vegaspec=zero).value)
