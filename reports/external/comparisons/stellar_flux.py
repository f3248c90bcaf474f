"""Light of stars at 500 and 1000 nm: the Sun as it is measured, and three calculators beside us."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from reports.external import comparison
from reports.external.comparison import Reference, Row
from reports.external.star_in_band import Star

TITLE = "Light of stars"
REFERENCE = Reference(
    "TSIS-1 HSRS (the Sun), and AYO, EBS and EXOSIMS in the comparison of Stark et al. 2025",
    "v2 of 2022-11-30, sheet of 2025-09-23",
    "Coddington et al. 2021 and 2023 (as in repository LIME-ESA/lime_tbx); arXiv 2502.18556, repository "
    "eleonoraalei/pyEDITH, tests/validation_tests_battery/ETC_cal_detect.xlsx",
)
TEXT = """
At 1000 nm our stars have up to 9 % less light than EBS's, for the same V. The Sun decides, which a calibrated
instrument in space has measured to 0.3 %: scaled to its V magnitude, our spectrum of 5772 K has 0.4 % less light than
the Sun at 500 nm and the same at 1000 nm; from 600 to 1580 nm it is the Sun's within 0.8 %, because the level of the
grid from 600 nm on is that of this Sun. 18 Sco is a twin of the Sun, and its ratio of the two lies
within 1 % of the Sun's 0.737; it is 0.779 for EBS, 0.633 for AYO and 0.599 for EXOSIMS. (The older compilation ASTM
E-490 has 3.5 % more light at 1000 nm than TSIS-1, for the same V.)

The codes are followed to their numbers, which our functions then give again:

- EBS and EXOSIMS take the spectrum of the library of Pickles 1998 for the spectral type, and scale it to the magnitude
  in the nearest band: V at 500 nm (both, to 0.1 %), I at 1000 nm for EBS (to 0.1 %), J for EXOSIMS (to 0.5 %). Scaled
  in V, the library's G2V has 6 % more light than the Sun from 750 to 900 nm and 9 % more from 900 to 1100 nm. What is
  left of it after scaling in I, 3 %, and an I magnitude that is 2 % too bright for a twin of the Sun, are EBS's excess
  over the Sun for 18 Sco. A blackbody of the Sun's temperature would have 8 % too much.
- EXOSIMS's J magnitudes of 18 Sco and HIP 26779 cannot be: V-J of 18 Sco would be 0.83, and that of solar twins is
  1.198 (Casagrande et al. 2012); V-J of HIP 26779 would be 1.90, that of a star 650 K cooler. Stars so bright saturate
  2MASS. AYO's light at 1000 nm follows them: for 18 Sco it is 14 % below the Sun's colour, for HIP 26779 it is 1.8
  times ours.
- AYO multiplies magnitudes with zero points of Johnson's system, drawn through a table by a cubic: 14 % more than the
  light of Vega at 500 nm (that of CALSPEC, as EBS, EXOSIMS and we have it) and 20 % more at 1000 nm, where that table
  has 2635 Jy at 970 nm and Vega 2164 Jy.
"""
SUN_TEFF_K, SUN_LOG_G = 5772.0, 4.44
SOLAR_TWIN = "HIP 79672"
RED = "EBS's template is red (above); EXOSIMS's J and AYO's zero point"
FAR_FROM_ALL = {("HIP 32439", 1000), ("HIP 77052", 1000), (SOLAR_TWIN, 1000), ("HIP 26779", 1000)}
SATURATED = {SOLAR_TWIN: "V-J of solar twins is 1.198: J = 4.30", "HIP 26779": "V-J of 1.90 is that of 4700 K"}


def rows(recorded: dict[str, Any]) -> list[Row]:
    """Return the Sun, then the codes."""
    cases = comparison.recorded("stark")["cases"]
    found = [*_sun_rows(recorded["sun"]), *_nearest_rows(cases), *_zero_point_rows(cases)]
    return [*found, *_recipe_rows(recorded, cases), *_j_rows(cases)]


def _top_hat(name: str, low_nm: float, high_nm: float) -> Any:
    from catalogs import Band

    return Band(name, "NIR", 0.5 * (low_nm + high_nm), high_nm - low_nm, 1.0, 1.0)


def _sun_rows(sun: dict[str, Any]) -> Iterable[Row]:
    from cpic_planner import Passbands

    widths = [band["high_nm"] - band["low_nm"] for band in sun["bands"]]
    bands = [_top_hat(band["name"], band["low_nm"], band["high_nm"]) for band in sun["bands"]]
    ours = Passbands.from_bands(bands).star_rate_e_s(sun["v_mag"], SUN_TEFF_K, SUN_LOG_G, 0.0, 1.0) / widths
    for band, value in zip(sun["bands"], ours, strict=True):
        what = f"Sun at 1 au (ph/s/cm2/nm), {band['low_nm']:g} to {band['high_nm']:g} nm ({band['name']})"
        red = band["low_nm"] > 600.0
        why = "the level of the grid is that of this Sun" if red else "scaled in V"
        tolerance = 0.01 if red else 0.03
        yield Row(what, band["photons"], float(value), tolerance, f"{why}; lines of model atmospheres")
    photons = {band["name"]: band["photons"] for band in sun["bands"]}
    twin = Star(SOLAR_TWIN, 1000).light() / Star(SOLAR_TWIN, 500).light()
    what = f"light at 1000 over that at 500 nm: the Sun, and {SOLAR_TWIN} (18 Sco)"
    yield Row(what, photons["1000 nm"] / photons["500 nm"], twin, 0.01, "a solar twin, 28 K hotter in our catalogue")


def _nearest_rows(cases: list[dict[str, Any]]) -> Iterable[Row]:
    """Our light beside that of the code that comes closest."""
    places = dict.fromkeys((case["star"], case["wavelength_nm"]) for case in cases)
    for name, wavelength in places:
        ours = Star(name, wavelength).light()
        theirs = {
            case["code"]: case["F_star"]
            for case in cases
            if (case["star"], case["wavelength_nm"]) == (name, wavelength)
        }
        code = min(theirs, key=lambda one: abs(ours / theirs[one] - 1.0))
        values = ", ".join(f"{one.upper()} {value:.4g}" for one, value in theirs.items())
        far = (name, wavelength) in FAR_FROM_ALL
        what = f"F_star (ph/s/cm2/nm), {name}, {wavelength} nm: {values}; nearest {code.upper()}"
        yield Row(what, theirs[code], ours, 0.03, RED if far else "", expected=not far)


def _zero_point_rows(cases: list[dict[str, Any]]) -> Iterable[Row]:
    """Vega."""
    for wavelength in (500, 1000):
        for code in ("ebs", "ayo"):
            theirs = next(c["F_0"] for c in cases[::-1] if (c["code"], c["wavelength_nm"]) == (code, wavelength))
            johnson = code == "ayo"
            why = "Johnson's zero points through a cubic" if johnson else "both are CALSPEC's Vega"
            what = f"F_0 (ph/s/cm2/nm), {code.upper()}, {wavelength} nm"
            ours = Star(SOLAR_TWIN, wavelength).vega()
            yield Row(what, theirs, ours, 0.03 if johnson else 0.001, why, expected=not johnson)


def _recipe_rows(recorded: dict[str, Any], cases: list[dict[str, Any]]) -> Iterable[Row]:
    """The library's spectrum of the type, scaled as each of two codes does."""
    from simulator.target import stellar_spectrum

    for case in cases:
        if case["code"] == "ayo":
            continue
        star, kind = Star(case["star"], case["wavelength_nm"]), recorded["types"][case["star"]][case["code"]]
        template = stellar_spectrum(case["v_mag"], kind, model="pickles")
        light, band = star.of_spectrum(template), "V"
        if star.wavelength_nm == 1000:
            band = "I" if case["code"] == "ebs" else "J"
            light *= 10.0 ** (-0.4 * (case["m_lambda"] - _magnitudes(template, recorded)[band]))
        what = f"F_star (ph/s/cm2/nm), {case['code'].upper()}, {star.name}, {star.wavelength_nm} nm"
        yield Row(f"{what}: {kind} of Pickles 1998 scaled in {band}", case["F_star"], light, 0.01, "filter curves")


def _magnitudes(spectrum: Any, recorded: dict[str, Any]) -> dict[str, float]:
    """Magnitudes in Cousins' I and in J, Vega 0."""
    from catalogs import Band, load_reference_spectrum
    from catalogs.spectra import Curve
    from cpic_planner import Passbands

    wavelength, transmission = (np.array(column) for column in recorded["cousins_i"].values())
    curve = Curve(wavelength, transmission * wavelength[0] / wavelength)  # it weighs energy
    bands = [Band("I", "VIS", 790.0, 180.0, 1.0, 1.0, curve=curve), _top_hat("J", 1154.0, 1316.0)]
    vega = load_reference_spectrum("vega")
    rates = [
        Passbands.from_bands(bands).spectrum_rate_e_s(one.wavelength_nm, one.photlam, 1.0) for one in (spectrum, vega)
    ]
    return dict(zip(("I", "J"), (-2.5 * np.log10(rates[0] / rates[1])).tolist(), strict=True))


def _j_rows(cases: list[dict[str, Any]]) -> Iterable[Row]:
    """J magnitudes that EXOSIMS takes, and those of our spectra."""
    from simulator.target import stellar_spectrum

    recorded = comparison.recorded("stellar_flux")
    for case in cases:
        if (case["code"], case["wavelength_nm"]) != ("exosims", 1000):
            continue
        row = Star(case["star"], 1000).row
        spectrum = stellar_spectrum(row.v_mag, teff_k=row.teff_k, log_g=row.log_g, metallicity=row.metallicity)
        ours, why = _magnitudes(spectrum, recorded)["J"], SATURATED.get(case["star"])
        known = why is not None
        yield Row(
            f"J (mag), {case['star']}", case["m_lambda"], ours, 0.1, why or "2MASS", absolute=True, expected=not known
        )
