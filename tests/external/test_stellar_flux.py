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
    assert ours["1000 nm"] / PHOTONS["1000 nm"] == pytest.approx(1.0, abs=0.02)
    for name in ("F520", "F662", "F720", "F850", "F1265"):
        assert ours[name] / PHOTONS[name] == pytest.approx(1.0, abs=0.03)


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
