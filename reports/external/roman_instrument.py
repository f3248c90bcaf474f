"""Roman's coronagraph as an instrument of this package: a table of the coronagraph, and what differs from the default.

The same `Mode` as `reports.external.roman_chain`, through the exposure-time calculator. Example::

    from reports.external.roman_chain import Planet
    from reports.external.roman_instrument import from_tables
    from_tables("cgi_noise/data", "OPT_IMG_NFB1_HLC", v_mag=5.0, planet=Planet(radius_rjup=1.0))
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from cpic_planner import exposure_time, load_instrument
from cpic_planner.api.functions import stars_named
from cpic_planner.etc import ApertureRates, aperture_rates, build_model
from cpic_planner.queries import EtcQuestion
from cpic_planner.results import EtcAnswer
from reports.external.roman_chain import (
    LONGEST_S,
    OUTSIDE,
    REFERENCE_RATIO,
    REFERENCE_V_MAG,
    SHORTEST_S,
    Answer,
    Light,
    Planet,
    answer,
    area_cm2,
    dust_arcsec2,
    light_of,
    passband,
)
from reports.external.roman_tables import Mode, read_mode
from simulator.signal.light import exozodi_fraction_arcsec2
from simulator.target.star_spectrum import stellar_spectrum

BAND = "ROMAN"
REFERENCE_LOOKS = {"teff_k": 9700.0, "log_g": 4.1, "metallicity": 0.0}
"""Of an A0 star; our spectra end at 8000 K, and a hotter star has the colours of that."""
LEFT_OUT = ("cosmic_rays", "smear", "stripes", "interference", "bias_drift", "dark_structure", "flat", "bad_pixels")
"""Effects of our detector that cgi_noise leaves out."""


def table(mode: Mode, separation_arcsec: float) -> str:
    """Return a table of the coronagraph whose two rows hold the values of the one separation: those of cgi_noise steps.

    Light of the star in a core is over the light of a source in its core there.
    """
    over_core = mode.core_starlight / mode.core_throughput
    values = {
        "core_throughput": mode.core_throughput,
        "raw_contrast": mode.raw_contrast * over_core,
        "contrast_stability": mode.contrast_change / mode.post_processing * over_core,
        "occulter_transmission": mode.occulter_transmission,
        "core_area_arcsec2": mode.core_arcsec2,
    }
    rows = [(part * separation_arcsec, *values.values()) for part in (0.8, 1.2)]
    return "\n".join([",".join(("separation_arcsec", *values)), *(",".join(map(repr, row)) for row in rows)]) + "\n"


def instrument(mode: Mode, table_file: str) -> dict[str, Any]:
    """Return what differs from the default instrument, as its file has it.

    The band gets the light of a resolution element; charge that does not arrive counts as quantum efficiency.
    """
    width_nm, qe = mode.bandwidth * mode.wavelength_nm, mode.qe * mode.transfer_efficiency
    band = {"camera": "VIS", "center_nm": mode.wavelength_nm, "width_nm": width_nm}
    return {
        "kind": "instrument",
        "name": "roman",
        "telescope": {"diameter_m": mode.diameter_m},
        "coronagraph": {"table": table_file, "zone": "ring"},
        "bands": {BAND: band | {"t_opt": mode.transmission * mode.spectral_share, "qe": qe}},
        "detector": {
            "pixel_scale_arcsec": math.sqrt(mode.core_arcsec2 / mode.aperture_pixels),
            "read_noise_e": mode.read_noise_e,
            "em_gain_max": mode.em_gain,
            "full_well_e": 90_000.0,
            "register_full_well_e": 1e9,
            "dark_e_s": mode.dark_e_s,
            "dark_293k_e_s": 0.0,
            "cic_e": mode.cic_e,
            "readout_s": 0.0,
            "exposure_min_s": SHORTEST_S,
            "exposure_max_s": LONGEST_S,
            "switches": dict.fromkeys(LEFT_OUT, False),
        },
        "sky": {
            "model": "uniform",
            "brightness_v_mag_arcsec2": mode.sky_v_mag,
            "exozodi_zodis": 1.0,
            "earthshine": {"brightness_v_mag_arcsec2": None},
            "stray_light": {"rate_e_s": mode.stray_ph_s * qe * mode.spectral_share},
        },
        "overhead_s": 0.0,
    }


@contextmanager
def asked(mode: Mode, planet: Planet, v_mag: float, *, same_light: bool, spectral_type: str = "g0v") -> Iterator[Any]:
    """Give the keywords of a question about a planet to the calculator, with its instrument.

    Parameters
    ----------
    mode : Mode
    planet : Planet
    v_mag : float
    same_light : bool
        Whether star, reference star and sky are as bright in the band as cgi_noise has them: their magnitudes are then
        those with which our spectra have that light, and the dust is as bright as theirs.
    spectral_type : str
        Of the star.
    """
    with tempfile.TemporaryDirectory() as folder:
        files = Path(folder) / "roman.csv", Path(folder) / "roman.yaml"
        files[0].write_text(table(mode, planet.separation_arcsec), encoding="utf-8")
        tree = instrument(mode, files[0].name)
        tree["sky"]["exozodi_zodis"] = planet.zodis
        mags = {"star": v_mag, "reference": REFERENCE_V_MAG, "sky": mode.sky_v_mag}
        if same_light:
            bands, area, theirs = passband(mode), area_cm2(mode), light_of(mode, v_mag, planet, spectral_type)
            star = stellar_spectrum(0.0, spectral_type.upper())
            unit = {
                "star": bands.spectrum_rate_e_s(star.wavelength_nm, star.photlam, area)[0],
                "reference": bands.star_rate_e_s(0.0, *REFERENCE_LOOKS.values(), area)[0],
                "sky": bands.sky_rate_e_s_arcsec2(0.0, area)[0],
            }
            wanted = {"star": theirs.star, "reference": theirs.reference}
            wanted["sky"] = theirs.core["sky"] / mode.core_arcsec2 / mode.occulter_transmission
            mags = {name: -2.5 * math.log10(wanted[name] / unit[name]) for name in mags}
            one = float(exozodi_fraction_arcsec2(planet.separation_arcsec, 1.0))
            tree["sky"]["exozodi_zodis"] = dust_arcsec2(mode, planet) / one
        tree["sky"]["brightness_v_mag_arcsec2"] = mags["sky"]
        files[1].write_text(yaml.safe_dump(tree), encoding="utf-8")
        yield {
            "target": "a star",
            "v_mag": mags["star"],
            "sp_type": spectral_type.upper(),
            "distance_pc": planet.distance_pc,
            "separation_arcsec": planet.separation_arcsec,
            "contrast": planet.contrast,
            "instrument": load_instrument(files[1]),
            "bands": [BAND],
            "strategy": {
                "library": "reference_star",
                "reference_star": REFERENCE_LOOKS | {"v_mag": mags["reference"]},
                "reference_ratio": REFERENCE_RATIO,
                "mode": "photon_counting",
                "visits": 1,
            },
        }


def calculator_light(mode: Mode, v_mag: float, planet: Planet, spectral_type: str = "g0v") -> Light:
    """Return the light that the calculator finds in the core, the stars being as bright as in cgi_noise."""
    with asked(mode, planet, v_mag, same_light=True, spectral_type=spectral_type) as keywords:
        question = EtcQuestion(**keywords)
        model = build_model(question.instrument, question.bands, question.strategy)
        place, star = np.array([planet.separation_arcsec]), stars_named(question)[0]
        rates = aperture_rates(model, star, BAND, place, np.zeros(1), planet.contrast)
    return _photons(mode, planet, rates)


def _photons(mode: Mode, planet: Planet, rates: ApertureRates) -> Light:
    counted = mode.qe * mode.transfer_efficiency * mode.spectral_share
    electrons = {"planet": rates.planet_e_s, "speckle": rates.halo_e_s, "exozodi": rates.exozodi_e_s}
    core = {name: float(rate.item()) / counted for name, rate in electrons.items()}
    core["stray"] = mode.stray_ph_s * float(np.asarray(rates.aperture_pixels).item())
    core["sky"] = float(rates.sky_e_s.item()) / counted - core["stray"]
    star = core["planet"] / planet.contrast / float(rates.core.item())
    left = math.sqrt(float(rates.speckle.common.k0.item())) / counted
    return Light(star, star / math.sqrt(float(rates.reference_scale.item())), core, left)


def from_tables(
    folder: str | Path, scenario: str, *, v_mag: float, planet: Planet, spectral_type: str = "g0v", **about: Any
) -> Answer:
    """Return the answer from the tables themselves, through the calculator; see `read_mode` and `answer`.

    Parameters
    ----------
    folder, scenario
        As of `read_mode`.
    v_mag, planet, spectral_type
        As of `light_of`.
    about
        Other arguments of `answer`.
    """
    mode = read_mode(folder, scenario, planet.separation_arcsec)
    if mode is None:
        return Answer(OUTSIDE, {})
    return answer(mode, calculator_light(mode, v_mag, planet, spectral_type), **about)


def own_time(
    mode: Mode, v_mag: float, planet: Planet, *, same_light: bool, snr: float = 5.0, **about: Any
) -> EtcAnswer:
    """Return the calculator's own answer, with its own noise."""
    with asked(mode, planet, v_mag, same_light=same_light) as keywords:
        return exposure_time(snr=snr, **keywords, **about)[0]
