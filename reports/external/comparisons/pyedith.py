"""Times, exozodiacal and zodiacal light: pyEDITH."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from reports.external.comparison import Reference, Row

TITLE = "Times, dust and sky: pyEDITH"
REFERENCE = Reference("pyEDITH", "1.7.2", "package index, its toy model", ("pyEDITH==1.7.2",))
TEXT = """
Count rates of its toy model go into `time_for_rates` by the convention of AYO, which is pyEDITH's since 1.7.1, and
the time times its overheads comes out, or the same refusal. Dust around the star has one law in both. The zodiacal
light is that of Leinert et al. (1998) in both, 135 degrees of longitude from the Sun: pyEDITH takes the spectrum of
their table 19, of two digits at 500, 700 and 900 nm, ours the light of the Sun reddened by their equation 22; the two
differ by 5 % at 700 nm and 8 % at 900 nm, and near the pole pyEDITH extends a cubic beyond its last column at 75
degrees of latitude. Count rates from the telescope on are not compared: pyEDITH's toy coronagraph is one number each
for throughput and contrast.

The example of pyEDITH gives the flux of its star, psi Ser, "at 10 pc" and divides it by the square of its distance of
14.8 pc; the number is that of the star as it stands, so that the star of the example is a magnitude too faint.
"""
WAVELENGTHS_UM, CONTRASTS, FLOORS = (0.5, 0.8), (1e-10, 2e-11), (0.03, 48.0)
SEPARATIONS_ARCSEC, SNR = (0.0628, 0.15), 7.0
# Right ascension and declination, degrees: psi Ser (the star of the example), in the ecliptic, near its pole.
PLACES_DEG = ((236.0076, 2.5152), (90.0, 23.4), (270.0, 60.0))
SKY_UM, SUN_LONGITUDE_DEG = (0.5, 0.7, 0.9), 135.0
AVERAGED_NM, LAST_LATITUDE_DEG = 20.0, 75.0
STAR = "psi Ser"
REDDER = "table 19 of two digits against equation 22 of the same article"
REFUSED = "not achievable"
TOY = Path(__file__).resolve().parents[1] / "instruments/pyedith_toy.json"


def peer() -> dict[str, Any]:
    """Ask pyEDITH."""
    import astropy.units as u
    import pyEDITH as edith  # noqa: N813 (as short as it is called here)
    from astropy.coordinates import SkyCoord
    from pyEDITH import parse_input
    from pyEDITH.astrophysical_scene import calc_flux_zero_point, calc_zodi_flux

    toy = json.loads(TOY.read_text(encoding="utf-8"))
    edith.set_verbosity("error")
    found: dict[str, Any] = {"times": [], "sky": [], "given_flux": toy["FstarV_10pc"]}
    for wavelength in WAVELENGTHS_UM:
        for contrast in CONTRASTS:
            for floor, separation in zip(FLOORS, SEPARATIONS_ARCSEC, strict=True):
                changed = {"wavelength": wavelength, "Fp/Fs": contrast, "noisefloor_factor": floor}
                asked = parse_input.parse_parameters(toy | changed | {"separation": separation, "snr": SNR})
                observation, scene, observatory = edith.Observation(), edith.AstrophysicalScene(), edith.Observatory()
                observation.load_configuration(asked)
                observation.set_output_arrays()
                scene.load_configuration(asked)
                scene.calculate_zodi_exozodi(asked)
                observatory.create_observatory(parse_input.get_observatory_config(asked))
                observatory.load_configuration(asked, observation, scene)
                edith.calculate_exposure_time_or_snr(observation, scene, observatory, mode="exposure_time")
                rates = {name: float(value[0]) for name, value in observation.photon_counts.items() if len(value)}
                found["v_mag"] = float(scene.vmag.value)
                time_s = float(observation.exptime[0].to_value("s"))
                found["times"].append(
                    {
                        "wavelength_um": wavelength,
                        "contrast": contrast,
                        "separation_arcsec": separation,
                        "planet": rates["CRp"],
                        "background": rates["CRb+det"],
                        "floor": rates["CRnf"],
                        "time_s": time_s if math.isfinite(time_s) else None,
                        "factor": float(observatory.telescope.toverhead_multi),
                        "extra_s": float(observatory.telescope.toverhead_fixed.to_value("s")),
                        "zodis": float(scene.nzodis.value),
                        "exozodi_of_star": float(
                            (scene.Fexozodi_list[0].value / scene.Fs_over_F0[0].value)
                            / (scene.dist.to_value("pc") * separation) ** 2
                        ),
                    }
                )
    for right_ascension, declination in PLACES_DEG:
        place = SkyCoord(ra=right_ascension * u.deg, dec=declination * u.deg).barycentrictrueecliptic
        for wavelength in SKY_UM:
            where = [wavelength] * u.um
            zero = calc_flux_zero_point(where, output_unit="pcgs", perlambd=True)
            light = calc_zodi_flux(declination * u.deg, right_ascension * u.deg, where, zero) * zero
            found["sky"].append(
                {
                    "latitude_deg": float(place.lat.deg),
                    "wavelength_um": wavelength,
                    "photons": float(light.to_value(u.ph / u.s / u.cm**2 / u.nm / u.arcsec**2).ravel()[0]),
                }
            )
    return found


def rows(recorded: dict[str, Any]) -> list[Row]:
    """Return times, dust and sky of both."""
    from cpic_planner import Reason, time_for_rates
    from cpic_planner.targets import find_target
    from simulator import star_photlam
    from simulator.effects.sky import elongation_deg, zodiacal_photlam_arcsec2, zodiacal_radiance
    from simulator.signal.light import exozodi_fraction_arcsec2

    found = []
    for case in recorded["times"]:
        where = f"{case['wavelength_um']:g} um, contrast {case['contrast']:g}, floor {case['floor']:.2g} e-/s"
        asked = {"floor_rate": case["floor"], "snr": SNR, "convention": "ayo"}
        answer = time_for_rates(case["planet"], case["background"], **asked)
        what = f"time with its overheads (s), {where}"
        if case["time_s"] is None:
            ours = REFUSED if answer.reason == Reason.SPECKLE_FLOOR else answer.status.value
            found.append(Row(what, REFUSED, ours, 1e-9))
        else:
            time_s = case["factor"] * float(answer.unwrap()) + case["extra_s"]
            found.append(Row(what, case["time_s"], time_s, 1e-9, "the same equation"))
    for case in recorded["times"][:2]:
        ours = float(exozodi_fraction_arcsec2(case["separation_arcsec"], case["zodis"]))
        what = (
            f"dust of {case['zodis']:g} zodis at {case['separation_arcsec']:g} arcsec, of the star's light per arcsec2"
        )
        found.append(Row(what, case["exozodi_of_star"], ours, 1e-3, "22 mag/arcsec2 at 1 au from a Sun in both"))
    for case in recorded["sky"]:
        latitude, wavelength_nm = case["latitude_deg"], 1e3 * case["wavelength_um"]
        radiance = float(zodiacal_radiance(SUN_LONGITUDE_DEG, latitude).radiance_500nm_w_m2_sr_um)
        light = zodiacal_photlam_arcsec2(radiance, float(elongation_deg(SUN_LONGITUDE_DEG, latitude)))
        near = np.abs(light.wavelength_nm - wavelength_nm) <= AVERAGED_NM
        ours = 10.0 * float(np.mean(light.photlam[near]))  # per angstrom
        what = f"zodiacal light (photons/s/cm2/nm/arcsec2), ecliptic latitude {latitude:.0f}, {wavelength_nm:g} nm"
        redder = wavelength_nm > 800.0 or (latitude > LAST_LATITUDE_DEG and wavelength_nm > 600.0)
        about = {"why": REDDER, "expected": False} if redder else {"why": "one table of places, two of colours"}
        found.append(Row(what, case["photons"], ours, 0.05, **about))
    star = find_target(STAR)[0]
    light = star_photlam(float(star.v_mag[0]), teff_k=float(star.teff_k[0]))
    ours = 10.0 * float(np.mean(light(np.linspace(4950.0, 5050.0, 101)).value))
    what = f"flux of {STAR} at 500 nm, as it stands (photons/s/cm2/nm), in theirs said to be at 10 pc"
    found.append(Row(what, recorded["given_flux"], ours, 0.05, "spectra of stars, and lines in them"))
    why = "the number of the row above is divided by the square of the distance"
    found.append(Row(f"V of {STAR}", recorded["v_mag"], float(star.v_mag[0]), 0.03, why, absolute=True, expected=False))
    return found
