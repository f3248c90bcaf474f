"""Roman's cgi_noise beside ours, from the same tables to the same time, rate by rate."""

from __future__ import annotations

from typing import Any

from reports.external.comparison import Reference, Row

COMMIT = "597dbfbcdbd9bc694a6ff4ed183f2dd6bcd38fec"
TITLE = "Roman's coronagraph from its tables"
MAIN = "^(time|SNR after|own)"
REFERENCE = Reference(
    "cgi_noise",
    f"1.4.0, commit {COMMIT[:7]}",
    "repository roman-corgi/cgi_noise",
    (f"cgi_noise @ git+https://github.com/roman-corgi/cgi_noise@{COMMIT}",),
)
TEXT = """
Scenario, star (a V magnitude, G0V) and planet (radius, orbit, phase, albedo, dust around the star) go in; every rate
on the way, the time to SNR 5, the SNR after endless time or the refusal come out. A scenario's tables become a table
of the coronagraph and an instrument of ours (`reports/external/roman_instrument.py`); the light in the core of the
planet's image is what the exposure-time calculator finds there, and `reports/external/roman_chain.py` takes it on
with the law of counted photons behind a register, the noise of a reference star and times from rates. What cgi_noise
chose is given as input: the light of its stars in the band, its radius of Jupiter, a sky in the colour of the star,
an exponential law of the register (as many stages as it takes), frames, and photons lost to others in their pixel.
`from_tables(folder, scenario, v_mag=..., planet=Planet(radius_rjup=...))` answers any other case; the planets here
have 1 R_J, 4.1536 au, a phase of 65 deg, 10 pc, albedo 0.44765 and 1 zodi where nothing else is said.

Rows of "own choice" say what this package takes where it chooses for itself, and rows of "own noise" the time on the
star by `exposure_time`, on the same tables, with our noise.
"""
SNR, STAR = 5.0, "g0v"
MODES = ("IMG_NFB1_HLC", "SPEC_NFB3_SPC", "IMG_WFB1_SPC", "IMG_WFB4_SPC")
SCENARIOS = tuple(f"{case}_{mode}" for mode in MODES for case in ("OPT", "CON"))
# V magnitude of the star, and what differs from the planet of cgi_noise's own example.
CASES: list[tuple[str, float, dict[str, float]]] = [
    (scenario, v_mag, {"radius_rjup": radius})
    for scenario in SCENARIOS
    for v_mag, radius in ((5.0, 5.6211), (5.0, 1.0), (3.0, 1.0))
]
CASES += [(f"{case}_IMG_WFB4_SPC", 4.0, {"radius_rjup": 2.0, "sma_au": 6.5}) for case in ("OPT", "CON")]
CASES += [
    ("OPT_IMG_NFB1_HLC", 6.2, {"sma_au": 3.0, "phase_deg": 80.0, "albedo": 0.3, "zodis": 5.0, "distance_pc": 12.5}),
    ("OPT_IMG_NFB1_HLC", 5.0, {"sma_au": 1.70}),  # just inside the first row, whose numbers count
    ("OPT_IMG_NFB1_HLC", 5.0, {"sma_au": 1.65}),
    ("OPT_IMG_NFB1_HLC", 5.0, {"sma_au": 4.5}),
    ("OPT_SPEC_NFB3_SPC", 0.0, {"radius_rjup": 10.0}),  # many photons in each pixel of a frame
]
UNITS = {
    "radius_rjup": "{:g} R_J",
    "sma_au": "{:g} au",
    "phase_deg": "phase {:g} deg",
    "albedo": "albedo {:g}",
    "zodis": "{:g} zodis",
    "distance_pc": "{:g} pc",
}
BY_LAW = "the register multiplies in steps and its read noise blurs the threshold: 0.03 % more electrons count"
RATES = {
    "star": "star behind the optics (photons/s)",
    "light_planet": "planet in its core (photons/s)",
    "light_speckle": "speckles in the core (photons/s)",
    "light_sky": "zodiacal light in the core (photons/s)",
    "light_exozodi": "exozodiacal light in the core (photons/s)",
    "light_stray": "stray light in the core (photons/s)",
    "efficiency": "electrons counted per photon",
    "frame_s": "frame (s)",
    "planet": "planet (e-/s)",
    "residual": "speckles left (e-/s)",
    "var_planet": "variance of the planet (e-^2/s)",
    "var_speckle": "variance of speckles (e-^2/s)",
    "var_sky": "variance of zodiacal light (e-^2/s)",
    "var_exozodi": "variance of exozodiacal light (e-^2/s)",
    "var_stray": "variance of stray light (e-^2/s)",
    "var_dark": "variance of dark current (e-^2/s)",
    "var_cic": "variance of clock-induced charge (e-^2/s)",
}
CHOICES = {
    "star": (
        "own choice: star behind the optics (photons/s)",
        *(0.05, True),
        "another library of spectra; cgi_noise adds samples of 1 nm, which are up to 0.9 % fewer or more than the band "
        "is wide, and gives all photons the energy of the middle of the band",
    ),
    "sky": (
        "own choice: zodiacal light (photons/s/arcsec2)",
        *(0.05, True),
        "ours has the colour of the Sun, theirs that of the star that is observed",
    ),
    "contrast": (
        "own choice: contrast of the planet",
        *(0.01, False),
        "our R_J is the radius of Jupiter's equator, 71 492 km; theirs that of a sphere of its volume, 69 911 km",
    ),
    "passing": (
        "own choice: electrons that pass the threshold",
        *(0.005, True),
        "a register of 604 stages instead of an exponential law; this alone shortens times by up to 0.9 %",
    ),
}
OWN_NOISE = (
    "own noise: time (s)",
    "electrons that the threshold or another one in their pixel hides are taken off the signal in both; in cgi_noise "
    "those of the planet still make noise, and so does all dark and clock-induced charge, while ours counts what the "
    "chance of a count tells of the light; it lets the light of the whole band of a spectrograph hide the photons of "
    "one resolution element",
)
OWN_ALL = (
    "own noise, frames and spectra: time (s)",
    "as with the same frames; our stars are brighter by what is said above, the dust is as bright as at the projected "
    "place, frames are those of the least time, and cgi_noise takes the frames of a spectrograph for the light of the "
    "whole band on the pixels of one resolution element",
)
LIGHTS = ("planet", "speckle", "sky", "exozodi", "stray")
VARIANCES = (*LIGHTS, "dark", "cic")
THEIRS = ("planet", "speckle", "locZodi", "exoZodi", "straylt", "detDark", "detCIC")


def rows(recorded: dict[str, Any]) -> list[Row]:
    """Return the answers of both, and for one star and planet of each scenario every rate on the way to them."""
    from reports.external.roman_chain import OK

    found, shown = [], set()
    for case in recorded["cases"]:
        place, ours = words(case), ours_of(case, recorded["modes"])
        if case["answer"] == OK == ours.answer:
            found.append(Row(f"time (s), {place}", case["time_s"], ours.time_s, 1e-2, BY_LAW))
            found.append(Row(f"SNR after endless time, {place}", case["critical_snr"], ours.critical_snr, 1e-6))
        else:
            found.append(Row(f"time (s), {place}", case["answer"], ours.answer, 1e-2))
        if "rates" in case and case["scenario"] not in shown:
            shown.add(case["scenario"])
            found += rate_rows(case, ours)
            found += choice_rows(case, recorded) if case["scenario"].startswith("OPT") else []
        if "mode" in case:
            found += own_rows(case, recorded["modes"])
    return found


def own_rows(case: dict[str, Any], modes: list[dict[str, float]]) -> list[Row]:
    """Return times of cgi_noise and those of `exposure_time`, whose noise is our own."""
    from reports.external.roman_chain import OK, UNREACHABLE, Planet
    from reports.external.roman_instrument import own_time
    from reports.external.roman_tables import Mode

    mode, planet = Mode(**modes[case["mode"]]), Planet(**case["planet"])
    fixed = {"exposure_s": case["rates"]["frame_s"], "em_gain": mode.em_gain}
    asked = ((OWN_NOISE, {"same_light": True} | fixed), (OWN_ALL, {"same_light": False}))
    found = []
    for (what, why), about in asked:
        ours = own_time(mode, case["v_mag"], planet, snr=SNR, **about)
        reached = UNREACHABLE if ours.reason == "common_speckle_floor" else ours.integration_s
        theirs = case["time_s"] if case["answer"] == OK else case["answer"]
        found.append(Row(f"{what}, {words(case)}", theirs, reached, 1e-2, why, expected=case["answer"] != OK))
    return found


def rate_rows(case: dict[str, Any], ours: Any) -> list[Row]:
    """Every rate of both."""
    found = []
    for name, rate in case["rates"].items():
        plain = name.startswith("light_") or name in ("star", "frame_s", "var_planet", "var_dark", "var_cic")
        tolerance, why = (1e-6, "") if plain else (2e-3, BY_LAW)
        found.append(Row(f"{RATES[name]}, {words(case)}", rate, ours.rates[name], tolerance, why))
    return found


def choice_rows(case: dict[str, Any], recorded: dict[str, Any]) -> list[Row]:
    """What cgi_noise takes, and what this package takes where it chooses for itself."""
    import math

    from reports.external.roman_chain import Planet, flux_key, own_choices
    from reports.external.roman_tables import Mode

    mode = Mode(**recorded["modes"][case["mode"]])
    ours = own_choices(mode, Planet(**case["planet"]), case["v_mag"], STAR)
    theirs = dict(case["rates"])
    theirs["contrast"] = theirs["light_planet"] / theirs["star"] / mode.core_throughput
    theirs["sky"] = theirs["star"] * 10.0 ** (0.4 * (case["v_mag"] - mode.sky_v_mag))
    theirs["passing"] = math.exp(-mode.threshold_sigma * mode.read_noise_e / mode.em_gain)
    place = f"{case['scenario']}, {flux_key(mode.wavelength_nm, mode.bandwidth)} band"
    return [
        Row(f"{what}, {place}", theirs[name], ours[name], tolerance, why, expected=expected)
        for name, (what, tolerance, expected, why) in CHOICES.items()
    ]


def ours_of(case: dict[str, Any], modes: list[dict[str, float]]) -> Any:
    """Our `Answer` to a recorded case."""
    from reports.external.roman_chain import OUTSIDE, Answer, Planet, answer
    from reports.external.roman_instrument import calculator_light
    from reports.external.roman_tables import Mode, lambda_d, within

    planet = Planet(**case["planet"])
    place = lambda_d(planet.separation_arcsec, case["wavelength_nm"], case["diameter_m"])
    if not within(place, *case["edges_lambda_d"]):
        return Answer(OUTSIDE, {})
    mode = Mode(**modes[case["mode"]])
    return answer(mode, calculator_light(mode, case["v_mag"], planet))


def words(case: dict[str, Any]) -> str:
    """Return a case in words."""
    planet = {"radius_rjup": 1.0} | case["planet"]
    changes = (UNITS[name].format(value) for name, value in planet.items())
    return ", ".join((case["scenario"], f"V = {case['v_mag']:g}", *changes))


def peer() -> dict[str, Any]:
    """Run cgi_noise, and note what its functions return on the way to a time."""
    import os
    from pathlib import Path

    import yaml
    from cgi_noise import cginoiselib as library
    from cgi_noise.tsnr_core import tsnr_pipeline

    seen: dict[str, tuple[Any, Any]] = {}

    def noted(name: str) -> Any:
        function = getattr(library, name)

        def call(*given: Any) -> Any:
            seen[name] = (given, function(*given))
            return seen[name][1]

        return call

    steps = "workingAnglePars contrastStabilityPars getSpectra getStrayLightfromfile compute_frame_time_and_dqe"
    for name in (*steps.split(), "detector_noise_rates", "noiseRates"):
        setattr(library, name, noted(name))
    tables = Path(os.environ["CGI_NOISE_DATA_DIR"])
    found: dict[str, Any] = {"zero_magnitude_ph_s_m2": {}, "modes": [], "cases": []}
    for scenario, v_mag, changes in CASES:
        config = yaml.safe_load((tables / "Scenarios" / f"{scenario}.yml").read_text(encoding="utf-8"))
        planet = {"radius_rjup": 1.0, "sma_au": 4.1536, "phase_deg": 65.0, "distance_pc": 10.0} | changes
        target = {
            "v_mag": v_mag,
            "dist_pc": planet["distance_pc"],
            "specType": STAR,
            "phaseAng_deg": planet["phase_deg"],
            "sma_AU": planet["sma_au"],
            "radius_Rjup": planet["radius_rjup"],
            "geomAlb_ag": planet.get("albedo", 0.44765),
            "exoZodi": planet.get("zodis", 1.0),
        }
        optics = config["instrument"]
        case: dict[str, Any] = {"scenario": scenario, "v_mag": v_mag, "planet": changes}
        case |= {"wavelength_nm": 1e9 * optics["wavelength"], "diameter_m": optics["Diam"]}
        found["cases"].append(case)
        try:
            signal, rates, residual = tsnr_pipeline(config, tables, target, verbose=False)
        except ValueError:
            case["answer"] = "outside working angles"
            continue
        finally:
            case["edges_lambda_d"] = [float(edge) for edge in seen["workingAnglePars"][1]]
        mode, star = _mode(optics, seen)
        found["modes"] += [] if mode in found["modes"] else [mode]
        case["mode"] = found["modes"].index(mode)
        frame_s, efficiency = seen["compute_frame_time_and_dqe"][1][2:4]
        case["rates"] = {"star": star, "efficiency": float(efficiency), "frame_s": float(frame_s)}
        light = seen["noiseRates"][0][0]
        case["rates"] |= {
            f"light_{ours}": float(getattr(light, name)) for ours, name in zip(LIGHTS, THEIRS, strict=False)
        }
        case["rates"] |= {"planet": float(signal), "residual": float(residual)}
        case["rates"] |= {
            f"var_{ours}": float(getattr(rates, name)) for ours, name in zip(VARIANCES, THEIRS, strict=True)
        }
        fluxes = {name: float(flux) for name, flux in seen["getSpectra"][1][0].items()}
        band = f"{mode['wavelength_nm']:.0f} nm, {100 * mode['bandwidth']:.0f} %"
        found["zero_magnitude_ph_s_m2"][band] = fluxes
        try:
            time_s, best = library.compute_tsnr(SNR, signal, rates, residual)
            case |= {"answer": "ok", "time_s": float(time_s), "critical_snr": float(best)}
        except ValueError:
            case["answer"] = "not achievable"
    return found


def _mode(optics: dict[str, Any], seen: dict[str, tuple[Any, Any]]) -> tuple[dict[str, float], float]:
    """What cgi_noise read from its tables, by the names of our `Mode`; and photons/s of the star behind the optics."""
    (_, qe, _, _, dark, *_, share, _, change, factor, core, transmission, area_m2), _ = seen["noiseRates"]
    (*_, device, wavelength_m, pixels, _), frame = seen["compute_frame_time_and_dqe"]
    detector = device.df.iloc[0]
    mode = {
        "wavelength_nm": wavelength_m * 1e9,
        "bandwidth": optics["bandwidth"],
        "diameter_m": optics["Diam"],
        "transmission": transmission,
        "core_throughput": core.CGcoreThruput,
        "occulter_transmission": core.CG_occulter_transmission,
        "core_arcsec2": core.omegaPSF,
        "aperture_pixels": pixels,
        "core_starlight": core.PSFpeakI * core.CGintmpix,
        "raw_contrast": seen["contrastStabilityPars"][1][1],
        "contrast_change": change,
        "post_processing": factor,
        "spectral_share": share,
        "qe": qe,
        "em_gain": detector["EMGain"],
        "read_noise_e": detector["ReadNoise_e"],
        "threshold_sigma": detector["PCThresh_nsigma"],
        "transfer_efficiency": (1 - detector["CTI_clk"]) ** detector["CTI_xfers"],
        "dark_e_s": dark.dark / pixels,
        "cic_e": dark.CIC * frame[2] / pixels,
        "stray_ph_s": seen["getStrayLightfromfile"][1] * (1e3 * detector["PixelSize_m"]) ** 2,
        "sky_v_mag": optics["LocZodi_magas2"],
        "dust_v_mag": optics["ExoZodi_magas2"],
    }
    star = float(seen["getSpectra"][1][2] * area_m2 * transmission)
    return {name: float(value) for name, value in mode.items()}, star
