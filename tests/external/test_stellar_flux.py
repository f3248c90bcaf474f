"""Light of stars against the measured Sun: ours, and what other calculators take instead."""

import numpy as np
import pytest

from cpic_planner import Passbands
from reports.external import comparison
from reports.external.comparisons import stellar_flux
from reports.external.star_in_band import Star
from simulator.target import stellar_spectrum

SUN = comparison.recorded("stellar_flux")["sun"]
PHOTONS = {band["name"]: band["photons"] for band in SUN["bands"]}


def _light_of(model: str) -> dict[str, float]:
    """Photon flux of a star of the Sun's V magnitude and temperature in the bands of the Sun's record."""
    spectrum = stellar_spectrum(SUN["v_mag"], "G2V", teff_k=5772.0, log_g=4.44, model=model)
    bands = [stellar_flux._top_hat(band["name"], band["low_nm"], band["high_nm"]) for band in SUN["bands"]]
    rates = Passbands.from_bands(bands).spectrum_rate_e_s(spectrum.wavelength_nm, spectrum.photlam, 1.0)
    return {band.name: rate / band.width_nm for band, rate in zip(bands, rates, strict=True)}


def test_the_sun_as_tsis_measured_it():
    ours = _light_of("grid")
    assert ours["500 nm"] / PHOTONS["500 nm"] == pytest.approx(1.0, abs=0.01)
    assert ours["F520"] / PHOTONS["F520"] == pytest.approx(1.0, abs=0.03)
    for name in ("F662", "F720", "F850", "1000 nm", "F1265", "F1425", "F1542"):
        assert ours[name] / PHOTONS[name] == pytest.approx(1.0, abs=0.01)


#: Temperature (K), [Fe/H], V-I (Cousins) and V-J (2MASS): Casagrande et al. 2006, MNRAS 373, 13, table 1, every second
#: of the dwarfs above 5200 K whose J is not saturated.
DWARFS = (
    (5219.0, -0.57, 0.833, 1.470),  # HD 11130
    (5226.0, -0.54, 0.866, 1.500),  # HD 132142
    (5251.0, -0.69, 0.788, 1.480),  # HD 144579
    (5260.0, 0.27, 0.836, 1.452),  # HD 87007
    (5288.0, -0.28, 0.848, 1.430),  # HD 11020
    (5306.0, -0.16, 0.850, 1.390),  # HD 222335
    (5372.0, -0.17, 0.806, 1.369),  # HD 89813
    (5416.0, -0.20, 0.788, 1.365),  # HD 98281
    (5428.0, 0.23, 0.791, 1.348),  # HD 106156
    (5485.0, -0.34, 0.771, 1.340),  # HD 215500
    (5568.0, -0.50, 0.750, 1.300),  # HD 8638
    (5625.0, 0.02, 0.732, 1.210),  # HD 59468
    (5643.0, -0.24, 0.746, 1.238),  # HD 114094
    (5771.0, -0.96, 0.696, 1.184),  # BD-01 306
    (5839.0, -0.88, 0.650, 1.155),  # HD 59374
    (5905.0, -1.09, 0.678, 1.142),  # HD 193901
    (5978.0, 0.12, 0.640, 1.070),  # HD 73524
    (6025.0, -1.69, 0.647, 1.107),  # HD 34328
    (6091.0, -1.49, 0.636, 1.088),  # HD 94028
    (6200.0, 0.22, 0.595, 0.940),  # HD 179949
    (6273.0, -1.54, 0.602, 1.016),  # HD 166913
    (6324.0, -1.87, 0.580, 0.996),  # HD 218502
    (6556.0, -0.60, 0.517, 0.867),  # HD 37792
)
J_ZERO_MAG = -0.025
"""Vega in J of 2MASS, mag, by the spectra of CALSPEC (Maiz Apellaniz & Pantaleoni Gonzalez 2018, A&A 616, L7)."""


def test_dwarfs_have_the_light_of_their_photometry_in_the_red():
    """No excess at any temperature: what was taken from the Sun holds for F and G stars."""
    recorded = comparison.recorded("stellar_flux")
    apart = []
    for teff_k, metallicity, v_i, v_j in DWARFS:
        spectrum = stellar_spectrum(5.0, teff_k=teff_k, log_g=4.5, metallicity=metallicity)
        ours = stellar_flux._magnitudes(spectrum, recorded)
        apart.append((5.0 - ours["I"] - v_i, 5.0 - ours["J"] - J_ZERO_MAG - v_j))
    teff = np.array([dwarf[0] for dwarf in DWARFS])
    for part in (teff < 5500.0, teff >= 5500.0):
        assert part.sum() > 7
        assert np.median(np.array(apart)[part], axis=0) == pytest.approx([0.0, 0.0], abs=0.015)


@pytest.mark.parametrize(("model", "excess"), [("pickles", 0.089), ("blackbody", 0.083)])
def test_other_models_of_the_sun_have_too_much_light_at_1000_nm(model, excess):
    assert _light_of(model)["1000 nm"] / PHOTONS["1000 nm"] - 1.0 == pytest.approx(excess, abs=0.01)


def test_a_solar_twin_has_the_suns_colour_for_us_alone():
    sun = PHOTONS["1000 nm"] / PHOTONS["500 nm"]
    cases = comparison.recorded("stark")["cases"]
    light = {
        (case["code"], case["wavelength_nm"]): case["F_star"]
        for case in cases
        if case["star"] == stellar_flux.SOLAR_TWIN
    }
    ours = Star(stellar_flux.SOLAR_TWIN, 1000).light() / Star(stellar_flux.SOLAR_TWIN, 500).light()
    assert ours / sun == pytest.approx(1.0, abs=0.01)
    for code in ("ayo", "ebs", "exosims"):
        assert abs(light[code, 1000] / light[code, 500] / sun - 1.0) > 0.05


def test_what_is_known_to_differ_does():
    rows = stellar_flux.rows(comparison.recorded("stellar_flux"))
    assert [row.what for row in rows if row.agrees and not row.expected] == []


def test_stars_of_the_sheet_are_the_right_ones():
    """V of our catalogue is that of the codes within the scatter of catalogues."""
    for case in comparison.recorded("stark")["cases"]:
        if case["v_mag"]:
            assert Star(case["star"], 500).row.v_mag == pytest.approx(case["v_mag"], abs=0.04)
    names = {case["star"] for case in comparison.recorded("stark")["cases"]}
    assert np.size(list(names)) == 5
