"""The sheet of Stark et al. 2025, worked out by us from the name of the star to the time."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from reports.external.comparison import Reference, Row
from reports.external.star_in_band import Star

TITLE = "An Earth twin from the name of its star to the time"
MAIN = "^(t_science|F_star|F_exozodi|CR_p)"
REFERENCE = Reference(
    "AYO, EBS and EXOSIMS in the comparison of Stark et al. 2025",
    "sheet of 2025-09-23",
    "arXiv 2502.18556, repository eleonoraalei/pyEDITH, tests/validation_tests_battery/ETC_cal_detect.xlsx",
)
TEXT = """
An Earth twin (radius of the Earth, albedo 0.2, quadrature, at the distance at which it gets the Earth's light) around
five stars, seen by a telescope of 7.87 m to SNR 7 in a band of 20 % at 500 and at 1000 nm, with three zodis of dust.

The first rows go the whole way through `exposure_time`, with nothing of the sheet but telescope, detector and
coronagraph (the preset `hwo_like`, whose table is EBS's curves at the ten separations of the sheet): place, magnitude,
temperature, gravity, metallicity and luminosity of the star are those of our catalogue, its spectrum is that of our
grid, planet, dust and zodiacal light (135 degrees from the Sun, as AYO has it) are ours. Where a row compares with a
range, "theirs" is its middle, "tolerance" its half width, for fluxes and rates widened by 3 %; the values of the three
codes stand beside the quantity.

Four things follow, and the rows below the first show each of them.

- The arithmetic is the same. From the star's light of a code and with its assumptions our rates and times are those of
  the code, mostly within 1 %.
- **The Earth twin of our catalogue is nearer to its star and brighter.** At the same distances (both are Gaia's)
  luminosities of the catalogue are 1 to 9 % lower than those of AYO. They follow from V and a bolometric correction,
  which gives the measured bolometric magnitudes of 104 dwarfs (Casagrande et al. 2006) to 0.1 % in the median with a
  scatter of 1 %, or, for two of the five, from a measured diameter and its temperature; V and temperature of single
  stars differ between catalogues by as much (HIP 26779: 5351 K here, 5226 and 5263 K in EBS and EXOSIMS). At 500 nm
  our times lie within the range of the three for two stars, for three they are 3 to 9 % shorter than the shortest; with
  luminosity and distance of AYO, which the sheet counts as inputs, they lie within it for all five.
- **At 1000 nm the codes differ by what colour the dust has.** AYO's dust and ours scatter the light of the star and
  have its colour: ours is AYO's to 2 %, once its star is as bright. EBS's dust has 22 mag/arcsec2 for one zodi at every
  wavelength and around every star, on the scale of Vega: it is as blue as Vega. EXOSIMS's is as blue, scaled with the
  star's V light and luminosity. Both are 2 to 5 times fainter at 1000 nm than starlight that dust has scattered, and
  their times are so much shorter. The other difference is the star itself: see the section on the light of stars.
- **The zodiacal light of 18 Sco differs by ten because the codes look at different times of the year.** EXOSIMS looks
  24 degrees from the Sun, AYO 135 degrees from it, and EBS takes 23 mag/arcsec2 of the colour of Vega for every
  direction. The table of Leinert et al. 1998, of AYO, EXOSIMS and ours, gives both: ours is AYO's within 1 % at 500 and
  4 % at 1000 nm, and EXOSIMS's within 7 % in its direction.
"""
SNR, ZODIS = 7.0, 3.0
EARTH_RJUP, ALBEDO, QUADRATURE_DEG = 6378.1 / 71492.0, 0.2, 90.0
AREA_CM2, T_OPTICAL, QE = 427518.2135, 0.532, 0.675
DARK_E_S, CIC_E, FLOOR = 3e-5, 1.3e-3, 0.029
SKY_PIXELS = 16.0  # the sheet's transmission of the sky is per pixel of a quarter of lambda/D
AYO_SUN_DEG = 135.0
BANDS = {500: "V500", 1000: "I1000"}
TELESCOPE = str(Path(__file__).resolve().parents[1] / "instruments/stark_2025.yaml")
OVERHEAD = {"ayo": (8249.895, 1.1), "ebs": (8280.0, 1.1), "exosims": (8280.0, 1.0)}  # seconds, factor
CODES = tuple(OVERHEAD)
RATES = ("CR_p", "CR_bs", "CR_bz", "CR_bez", "CR_bd", "CR_NF")
UNITS = {
    "L_star": "solar luminosities",
    "dist": "pc",
    "m_lambda": "mag",
    "sp": "lambda/D",
    "T_core": "1",
    "F_0": "ph/s/cm2/nm",
    "F_star": "ph/s/cm2/nm",
    "F_p": "ph/s/cm2/nm",
    "F_zodi": "ph/s/cm2/nm/arcsec2",
    "F_exozodi": "ph/s/cm2/nm/arcsec2",
} | dict.fromkeys((*RATES, "CR_bstray"), "1/s")
SLACK = 0.03
FIRST_NM = 500
OWN_TIME = {500: 0.12, 1000: 0.20}  # largest differences of times by band: what 6 and 10 % of the star's light make
NEARER = "the luminosity of our catalogue is lower, so that the planet is nearer to the star"
LEAK = "the leak grows with the diameter of the star; the table has one curve for all of them"
STARLIGHT = "see the light of stars: J magnitudes of two stars and zero points of Vega"
WHY = {
    "L_star": "V and temperature of single stars; the bolometric correction agrees with measured ones to 0.1 %",
    "sp": NEARER,
    "T_core": f"{NEARER}; AYO looks the coronagraph up in coarse steps",
    "F_star": STARLIGHT,
    "F_p": NEARER,
    "F_exozodi": "dust of EBS and EXOSIMS is as blue as Vega, ours as its star; AYO's star is brighter than ours at "
    "500 nm, and fainter at 1000 nm where this row disagrees",
    "CR_bez": "as F_exozodi",
    "CR_p": "as F_star and T_core",
    "CR_bs": LEAK,
    "CR_NF": LEAK,
    "t_science": "at 500 nm our planet is nearer to its star and brighter; at 1000 nm our star is fainter than AYO's, "
    "and our dust has the colour of the star, not Vega's as that of EBS and EXOSIMS",
    "t_science as AYO": "AYO's star is brighter, and the dust of EBS and EXOSIMS is as blue as Vega",
}
LEAKING = {("HIP 32439", 500), ("HIP 77052", 1000), ("HIP 113283", 500)}
KNOWN: dict[str, set[tuple[str, float]]] = {
    "L_star": {("HIP 32439", 500), ("HIP 26779", 500), ("HIP 113283", 500)},
    "sp": {("HIP 26779", 500), ("HIP 26779", 1000)},
    "T_core": {("HIP 113283", 1000)},
    "F_star": {("HIP 32439", 1000), ("HIP 77052", 1000), ("HIP 26779", 1000)},
    "F_p": {("HIP 26779", 500)},
    "F_exozodi": {
        ("HIP 32439", 500),
        ("HIP 77052", 500),
        ("HIP 79672", 500),
        ("HIP 79672", 1000),
        ("HIP 113283", 1000),
    },
    "CR_bez": {("HIP 32439", 500), ("HIP 77052", 500), ("HIP 79672", 1000)},
    "CR_p": {("HIP 32439", 1000), ("HIP 77052", 1000), ("HIP 26779", 1000)},
    "CR_bs": LEAKING,
    "CR_NF": LEAKING,
    "t_science": {
        *((star, 500) for star in ("HIP 77052", "HIP 26779", "HIP 113283")),
        *((star, 1000) for star in ("HIP 32439", "HIP 77052", "HIP 26779", "HIP 113283")),
    },
    "t_science as AYO": {("HIP 32439", 1000), ("HIP 77052", 1000), ("HIP 26779", 1000)},
}
BAD_LIGHT = {
    ("ayo", "HIP 32439", 1000),
    ("ayo", "HIP 77052", 1000),
    ("ayo", "HIP 26779", 1000),
    ("exosims", "HIP 77052", 1000),
    ("exosims", "HIP 26779", 1000),
    ("exosims", "HIP 79672", 1000),
}
"""Cases in which a code's light of the star is more than 10 % off ours, and the time more than 20 %: see the section on
the light of stars."""
PLACE = "AYO prints luminosities and distances with one to three digits"
SKY = "the same table, interpolated otherwise where it is steep near the Sun; its spectrum by table 19 or equation 22"
ARITHMETIC = {
    "F_p": (0.025, PLACE),
    "F_zodi": (0.07, SKY),
    "F_exozodi": (0.025, PLACE),
    "CR_p": (0.025, PLACE),
    "CR_bs": (0.005, "printed digits"),
    "CR_bz": (0.07, SKY),
    "CR_bez": (0.025, PLACE),
    "CR_bd": (0.005, "printed digits"),
    "CR_NF": (0.005, "printed digits"),
    "t_science": (0.05, "as the planet's place and the zodiacal light"),
    "t_exp": (0.05, "as the planet's place and the zodiacal light"),
}
_FRAMES = "AYO works out its own rate of frames for this star, which is not the printed one"
ARITHMETIC_KNOWN = {
    ("CR_bd", "ayo", 500): _FRAMES,
    ("CR_bd", "ayo", 1000): _FRAMES,
    ("F_exozodi", "exosims", 1000): "the printed brightness is 0.836 of what gives the printed rate, in all five stars",
}

Case = dict[str, Any]


def vega_magnitudes(star: Star, mag_arcsec2: float) -> float:
    """Light of a surface brightness on the scale of Vega at this wavelength, ph/s/cm2/nm/arcsec2."""
    return star.vega() * float(10.0 ** (-0.4 * mag_arcsec2))


def fluxes(star: Star, luminosity: float, distance_pc: float, *, light: float | None = None) -> dict[str, float]:
    """What arrives at the telescope, zodiacal light and dust as we have them.

    Parameters
    ----------
    star : Star
    luminosity, distance_pc : float
        Place the planet.
    light : float, optional
        Of the star, instead of ours.
    """
    from cpic_planner import planet_contrast
    from simulator.signal.light import exozodi_fraction_arcsec2

    semi_major_axis_au = float(np.sqrt(luminosity))
    separation = semi_major_axis_au / distance_pc
    own = star.light() if light is None else light
    contrast = planet_contrast(EARTH_RJUP, semi_major_axis_au, 0.0, QUADRATURE_DEG, ALBEDO)
    return {
        "F_0": star.vega(),
        "m_lambda": -2.5 * float(np.log10(own / star.vega())),
        "sp": separation / star.lambda_d_arcsec,
        "F_star": own,
        "F_p": own * float(contrast),
        "F_zodi": star.zodiacal(AYO_SUN_DEG),
        "F_exozodi": own * float(exozodi_fraction_arcsec2(separation, ZODIS)),
    }


def as_code(star: Star, case: Case, *, light: float | None = None) -> dict[str, float]:
    """`fluxes` with the luminosity and distance, the sky and the dust of a code."""
    found = fluxes(star, case["L_star"], case["dist"], light=light)
    vega_dust = ZODIS * vega_magnitudes(star, 22.0)
    if case["code"] == "ebs":
        return found | {"F_zodi": vega_magnitudes(star, 23.0), "F_exozodi": vega_dust}
    if case["code"] == "exosims":
        absolute = case["v_mag"] - 5.0 * np.log10(case["dist"] / 10.0)
        dust = vega_dust * float(10.0 ** (-0.4 * (absolute - 4.83))) / case["L_star"]
        return found | {"F_zodi": star.zodiacal(case["sun_longitude_deg"]), "F_exozodi": dust}
    return found


def rates(star: Star, flux: dict[str, float], optics: Case) -> dict[str, float]:
    """Counts per second in the aperture, by the coronagraph and detector of a case of the sheet."""
    counted = AREA_CM2 * T_OPTICAL * QE * star.width_nm
    sky = optics["skytrans"] / SKY_PIXELS * optics["omega_core"] * star.lambda_d_arcsec**2
    halo = flux["F_star"] * optics["I_star"] * optics["omega_core"] * counted
    return {
        "CR_p": flux["F_p"] * optics["T_core"] * counted,
        "CR_bs": halo,
        "CR_bz": flux["F_zodi"] * sky * counted,
        "CR_bez": flux["F_exozodi"] * sky * counted,
        "CR_bd": optics["det_npix"] * (DARK_E_S + CIC_E / optics["t_photon_count"]),
        "CR_NF": FLOOR * halo,
    }


def science_time(found: dict[str, Any], convention: str) -> float:
    """Time to SNR 7 from rates, s."""
    from cpic_planner import time_for_rates

    background = sum(found[name] for name in ("CR_bs", "CR_bz", "CR_bez", "CR_bstray", "CR_bd"))
    answer = time_for_rates(found["CR_p"], background, snr=SNR, floor_rate=found["CR_NF"], convention=convention)
    return float(answer.unwrap())


def wall_time(science_s: float, code: str) -> float:
    """Time with the overheads of a code, s."""
    fixed, factor = OVERHEAD[code]
    return fixed + factor * science_s


def whole_way(star: Star, frame_s: float) -> dict[str, float]:
    """Everything of a star and band from `exposure_time`, with telescope, detector and coronagraph by YAML and table.

    Parameters
    ----------
    star : Star
    frame_s : float
        Exposure of a frame, each of which has its clock charge.
    """
    from cpic_planner import exposure_time

    luminosity, distance = float(star.row.luminosity_lsun), float(star.row.distance_pc)
    (answer,) = exposure_time(
        star.name,
        snr=SNR,
        semi_major_axis_au=float(np.sqrt(luminosity)),
        planet={"radius_rjup": EARTH_RJUP, "phase_deg": QUADRATURE_DEG, "albedo": ALBEDO},
        instrument=TELESCOPE,
        bands=[BANDS[star.wavelength_nm]],
        exposure_s=frame_s,
        em_gain=1,
        visits=1,
        date_utc=star.date(AYO_SUN_DEG),
        strategy={"annulus_lambda_d": 20.0},
    )
    charge = {name: electrons / answer.integration_s for name, electrons in answer.budget.items()}
    return {
        "L_star": luminosity,
        "dist": distance,
        **fluxes(star, luminosity, distance),
        "T_core": answer.core_throughput,
        "CR_p": charge["signal_e"],
        "CR_bs": charge["halo_e2"],
        "CR_bz": charge["sky_e2"],
        "CR_bez": charge["exozodi_e2"],
        "CR_bstray": charge["companion_e2"],
        "CR_bd": charge["dark_e2"] + charge["cic_e2"],
        "CR_NF": FLOOR * charge["halo_e2"],
        "t_science": answer.integration_s,
    }


def in_range(what: str, theirs: Iterable[float], ours: float, slack: float, known: str | None) -> Row:
    """A row that compares with the range of the three codes."""
    values = list(theirs)
    low, high = min(values), max(values)
    shown = ", ".join(f"{code.upper()} {value:.4g}" for code, value in zip(CODES, values, strict=True))
    middle = 0.5 * (low + high)
    tolerance = math.ceil(1e4 * (0.5 * (high - low) / middle + slack)) / 1e4
    return Row(f"{what}: {shown}", middle, ours, tolerance, known or "", expected=known is None)


def worst(pairs: Iterable[tuple[str, float, float]]) -> tuple[str, float, float]:
    """The star, theirs and ours that differ most."""
    return max(pairs, key=lambda pair: abs(pair[2] / pair[1] - 1.0))


def rows(recorded: dict[str, Any]) -> list[Row]:
    """Return both, the whole way and code by code."""
    cases = recorded["cases"]
    groups: dict[tuple[str, int], dict[str, Case]] = {}
    for case in cases:
        groups.setdefault((case["star"], case["wavelength_nm"]), {})[case["code"]] = case
    found = [row for place, codes in groups.items() for row in _whole_way_rows(codes, Star(*place))]
    found += [row for place, codes in groups.items() for row in _own_time_rows(codes, Star(*place))]
    return [*found, *_assumption_rows(cases)]


def _whole_way_rows(codes: dict[str, Case], star: Star) -> Iterable[Row]:
    ours = whole_way(star, codes["ebs"]["t_photon_count"])
    where = f"{star.name}, {star.wavelength_nm} nm"

    def known(name: str) -> str | None:
        return WHY[name] if (star.name, star.wavelength_nm) in KNOWN.get(name, ()) else None

    for name, unit in UNITS.items():
        if name in ("L_star", "dist") and star.wavelength_nm != FIRST_NM:
            continue
        theirs = [codes[code][name] for code in CODES]
        if name == "m_lambda":
            theirs = [-2.5 * float(np.log10(codes[code]["F_star"] / codes[code]["F_0"])) for code in CODES]
        if name == "CR_bstray" and not any(theirs):
            continue
        yield in_range(f"{name} ({unit}), {where}", theirs, ours[name], SLACK, known(name))
    for convention in ("ayo", "ebs"):
        theirs = [science_time(codes[code], convention) for code in CODES]
        mine = ours["t_science"] if convention == "ayo" else science_time(ours, convention)
        name = f"t_science, convention of {convention.upper()}"
        yield in_range(f"{name} (s), {where}", theirs, mine, 0.0, known("t_science"))
        if convention == "ayo":
            theirs, mine = [wall_time(one, "ayo") for one in theirs], wall_time(mine, "ayo")
            yield in_range(f"t_exp with it (s), {where}", theirs, mine, 0.0, known("t_science"))
            with_place = rates(star, fluxes(star, codes["ayo"]["L_star"], codes["ayo"]["dist"]), codes["ayo"])
            mine = science_time(with_place | {"CR_bstray": codes["ayo"]["CR_bstray"]}, "ayo")
            what = "t_science, planet and coronagraph where AYO has them, convention of AYO"
            theirs = [science_time(codes[code], "ayo") for code in CODES]
            yield in_range(f"{what} (s), {where}", theirs, mine, 0.0, known("t_science as AYO"))


def _own_time_rows(codes: dict[str, Case], star: Star) -> Iterable[Row]:
    """Each published time by the code's own convention and assumptions, with our light of the star."""
    for code, case in codes.items():
        ours = rates(star, as_code(star, case), case) | {"CR_bstray": case["CR_bstray"]}
        light = star.light() / case["F_star"]
        why = f"our light of the star is {light:.3f} of {code.upper()}'s, and time goes with its power -1 to -2"
        what = f"t_science as {code.upper()} assumes, our star (s), {star.name}, {star.wavelength_nm} nm"
        tolerance = OWN_TIME[star.wavelength_nm]
        expected = (code, star.name, star.wavelength_nm) not in BAD_LIGHT
        yield Row(what, case["t_science"], science_time(ours, code), tolerance, why, expected=expected)


def _assumption_rows(cases: list[Case]) -> Iterable[Row]:
    """The same with the star's light of the code: what is left is the arithmetic."""
    for code in CODES:
        for wavelength in OWN_TIME:
            pairs: dict[str, list[tuple[str, float, float]]] = {}
            for case in cases:
                if (case["code"], case["wavelength_nm"]) != (code, wavelength):
                    continue
                star = Star(case["star"], wavelength)
                flux = as_code(star, case, light=case["F_star"])
                ours = flux | rates(star, flux, case) | {"CR_bstray": case["CR_bstray"]}
                ours["t_science"] = science_time(ours, code)
                ours["t_exp"] = wall_time(ours["t_science"], code)
                for name in ("F_p", "F_zodi", "F_exozodi", *RATES, "t_science", "t_exp"):
                    pairs.setdefault(name, []).append((star.name, case[name], ours[name]))
            for name, values in pairs.items():
                known = ARITHMETIC_KNOWN.get((name, code, wavelength))
                tolerance, why = ARITHMETIC[name]
                star_name, theirs, mine = worst(values)
                what = f"{name}, {code.upper()}, its star, {wavelength} nm, largest difference ({star_name})"
                yield Row(what, theirs, mine, tolerance, known or why, expected=known is None)
