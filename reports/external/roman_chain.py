"""Roman's coronagraph from the tables of cgi_noise to a time, by our functions and the choices of cgi_noise.

Source of the choices, function by function: github.com/roman-corgi/cgi_noise, commit 597dbfb, ``cgi_noise/tsnr_core.py``
and ``cgi_noise/cginoiselib.py``; the tables are those of ``cgi_noise/data``. Example::

    from reports.external.roman_chain import Planet, from_tables
    from_tables("cgi_noise/data", "OPT_IMG_NFB1_HLC", v_mag=5.0, planet=Planet(radius_rjup=1.0))
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from catalogs import Band
from cpic_core import load_yaml
from cpic_planner import Reason, planet_contrast, snr_for_rates, time_for_rates
from cpic_planner.etc.photon_counting import CountingLaw, counting_law
from cpic_planner.queries import Strategy
from cpic_planner.registry import LIBRARIES
from simulator import Passbands
from simulator.config.instrument import ARCSEC_PER_RAD
from simulator.signal.light import exozodi_fraction_arcsec2

RECORDED = Path(__file__).with_name("recorded") / "cgi_noise.json"
JUPITER_KM, OUR_JUPITER_KM = 69911.0, 71492.0
EXPONENTIAL_STAGES = 1_000_000
"""Stages of a register whose output for one electron is exponential to 2e-5, as cgi_noise takes it; a CCD201 has 604."""
REFERENCE_V_MAG, REFERENCE_TYPE, REFERENCE_RATIO = 2.26, "a0v", 0.25
MONTHS_AT_L2 = 21.0
FRAME_E, SHORTEST_S, LONGEST_S = 0.1, 3.0, 100.0
"""Electrons per pixel and frame that are aimed at, and the limits of a frame, rounded to 0.1 s."""
EDGE_LAMBDA_D = 0.05
"""As far beyond the edges of its tables a planet counts as on them."""
OK, UNREACHABLE, OUTSIDE = "ok", "not achievable", "outside working angles"


@dataclass(frozen=True)
class Planet:
    """A planet and what is around its star; the defaults are those of the recorded cases.

    Attributes
    ----------
    radius_rjup : float
        Radius in R_J = 69 911 km.
    sma_au, phase_deg, distance_pc : float
        Distance from the star, phase angle, distance of the star from us.
    albedo, zodis : float
        Geometric albedo; dust in units of the solar system's.
    """

    radius_rjup: float = 1.0
    sma_au: float = 4.1536
    phase_deg: float = 65.0
    distance_pc: float = 10.0
    albedo: float = 0.44765
    zodis: float = 1.0

    @property
    def offset_au(self) -> float:
        """Projected distance from the star."""
        return self.sma_au * math.sin(math.radians(self.phase_deg))

    @property
    def separation_arcsec(self) -> float:
        """Separation on the sky."""
        return self.offset_au / self.distance_pc

    @property
    def contrast(self) -> float:
        """Flux over that of the star."""
        radius = self.radius_rjup * JUPITER_KM / OUR_JUPITER_KM
        return float(planet_contrast(radius, self.offset_au, 0.0, self.phase_deg, self.albedo))


@dataclass(frozen=True)
class Mode:
    """What the tables say of a scenario at one separation.

    Attributes
    ----------
    wavelength_nm, bandwidth, diameter_m : float
        Centre and relative width of the band; telescope.
    transmission : float
        Of telescope and instrument without coronagraph and detector.
    core_throughput, occulter_transmission : float
        Parts of a planet's light in the core of its image, and of an even sky's light that passes the mask.
    core_arcsec2, aperture_pixels : float
        Area of the core on the sky and, dispersed where there is a spectrograph, in pixels.
    core_starlight : float
        Star light in the core over contrast: peak of the star's image times the pixels of the core.
    raw_contrast, contrast_change, post_processing : float
        Speckles; their difference between star and reference star; what post-processing divides that by.
    spectral_share : float
        Part of the band's light in a resolution element; 1 for images.
    qe, em_gain, read_noise_e, threshold_sigma, transfer_efficiency : float
        Quantum efficiency; register; threshold of counting over the read noise; charge that arrives.
    dark_e_s, cic_e, stray_ph_s : float
        A pixel's dark current, clock-induced charge per frame, and stray light.
    sky_v_mag, dust_v_mag : float
        Zodiacal light, and that of one zodi at 1 au from the Sun, mag/arcsec2.
    """

    wavelength_nm: float
    bandwidth: float
    diameter_m: float
    transmission: float
    core_throughput: float
    occulter_transmission: float
    core_arcsec2: float
    aperture_pixels: float
    core_starlight: float
    raw_contrast: float
    contrast_change: float
    post_processing: float
    spectral_share: float
    qe: float
    em_gain: float
    read_noise_e: float
    threshold_sigma: float
    transfer_efficiency: float
    dark_e_s: float
    cic_e: float
    stray_ph_s: float
    sky_v_mag: float
    dust_v_mag: float


def _table(path: Path) -> list[dict[str, Any]]:
    """Rows of a table, numbers as such; comments follow the rows."""
    rows = list(csv.reader(path.read_text(encoding="utf-8-sig", errors="replace").splitlines()))
    kept = []
    for row in rows[1:]:
        if any(cell.startswith("#") for cell in row):
            break
        kept.append({key.strip(): _number(cell) for key, cell in zip(rows[0], row, strict=False)})
    return kept


def _number(cell: str) -> float | str:
    try:
        return float(cell)
    except ValueError:
        return cell


def _step(rows: list[dict[str, Any]], key: str, place: float) -> dict[str, Any]:
    """Return the last row at or before a place: cgi_noise does not interpolate."""
    return [row for row in rows if row[key] <= place][-1]


def read_mode(folder: str | Path, scenario: str, separation_arcsec: float) -> Mode | None:
    """Read the tables of a scenario.

    Parameters
    ----------
    folder : str or Path
        The folder ``data`` of cgi_noise, or a copy of its tables; spectra are not needed.
    scenario : str
        Name of a file in ``Scenarios``, without ending.
    separation_arcsec : float

    Returns
    -------
    Mode or None
        None outside the working angles, which are those that the tables of core and of contrast have in common.
    """
    root, config = Path(folder), load_yaml(Path(folder) / "Scenarios" / f"{scenario}.yml")
    files, optics = config["DataSpecification"], config["instrument"]
    core_rows = _table(root / "Photometry" / f"{files['Coronagraph_Data']}.csv")
    contrast_rows = _table(root / "Cstability" / f"{files['ContrastStability_Data']}.csv")
    wavelength_m, diameter_m = float(optics["wavelength"]), float(optics["Diam"])
    place = lambda_d(separation_arcsec, 1e9 * wavelength_m, diameter_m)
    inner, outer = (
        choose(ends(rows) for rows in (core_rows, contrast_rows))
        for choose, ends in ((max, lambda rows: rows[0]["r_lam_D"]), (min, lambda rows: rows[-1]["r_lam_D"]))
    )
    if not within(place, inner, outer):
        return None
    place = min(max(place, inner), outer)
    at = _step(core_rows, "r_lam_D", place)
    # A row counts from just before its place.
    speckles = [row for row in contrast_rows if row["r_lam_D"] < place + EDGE_LAMBDA_D][-1]
    kind = files["CS_Type"]
    changes = (speckles[f"{kind}_{name}"] for name in ("ExtContStab", "IntContStab", "SystematicC"))
    first, area = core_rows[0], at["area_sq_arcsec"]
    design_m = diameter_m * first["r_as"] / ARCSEC_PER_RAD / first["r_lam_D"]
    sampling = (core_rows[2]["r_lam_D"] - core_rows[1]["r_lam_D"]) * design_m / diameter_m * ARCSEC_PER_RAD
    if "IMG_NFB1_HLC" in files["ObservationCase"]:  # measured in vacuum instead of modelled
        core = config["TVACmeasured"]["CoreThput_HLCB1"]
        core_starlight = core * config["TVACmeasured"]["Kappa_c_HLCB1"]
    else:
        core, core_starlight = at["coreThruput"], at["PSFpeak"] * area / sampling**2
    detector = _table(root / "Photometry" / f"{files['Detector_Data']}.csv")[0]
    spectral_share, pixels = 1.0, area * (wavelength_m / design_m) ** 2
    if optics["OpMode"] == "SPEC":
        spectral_share = 1.0 / (optics["R_required"] * optics["bandwidth"])
        pixels = _spectrum_pixels(root, wavelength_m, optics["R_required"], detector["PixelSize_m"])
    else:
        nyquist_m = _table(root / "instrument" / "CONST_SNR_FPattributes.csv")[0]["Critical_Lambda_m"]
        pixels *= (2.0 * diameter_m / nyquist_m / ARCSEC_PER_RAD) ** 2
    glass = _table(root / "Photometry" / f"{files['Throughput_Data']}.csv")[0]
    stray = _table(root / "Photometry" / f"{files['StrayLight_Data']}.csv")[0][files["ObservationCase"]]
    qe = _step(_table(root / "Photometry" / f"{files['QE_Curve_Data']}.csv"), "lambda_nm", wavelength_m * 1e9 + 1e-6)
    return Mode(
        wavelength_nm=wavelength_m * 1e9,
        bandwidth=optics["bandwidth"],
        diameter_m=diameter_m,
        transmission=math.prod(glass[key] for key in ("Pupil_Transmission", "CBE_OTAplusTCA", "CBE_CGI")),
        core_throughput=core,
        occulter_transmission=at["occTrans"],
        core_arcsec2=area,
        aperture_pixels=pixels,
        core_starlight=core_starlight,
        raw_contrast=speckles[f"{kind}_AvgRawContrast"] * 1e-9,
        contrast_change=math.hypot(*changes) * 1e-9,
        post_processing=optics["pp_Factor_CBE"],
        spectral_share=spectral_share,
        qe=qe["QE_at_neg100degC"],
        em_gain=detector["EMGain"],
        read_noise_e=detector["ReadNoise_e"],
        threshold_sigma=detector["PCThresh_nsigma"],
        transfer_efficiency=(1.0 - detector["CTI_clk"]) ** detector["CTI_xfers"],
        dark_e_s=_aged(detector["DarkBOM_e_per_pix_per_hr"], detector["DarkEOM_e_per_pix_per_hr"], detector) / 3600.0,
        cic_e=_charge(detector),
        stray_ph_s=stray * (1e3 * detector["PixelSize_m"]) ** 2,
        sky_v_mag=optics["LocZodi_magas2"],
        dust_v_mag=optics["ExoZodi_magas2"],
    )


def within(place: float, inner: float, outer: float) -> bool:
    """Whether a separation is inside the working angles or so near that it counts as on their edge, all in lambda/D."""
    return inner - EDGE_LAMBDA_D <= place <= outer + EDGE_LAMBDA_D


def lambda_d(separation_arcsec: float, wavelength_nm: float, diameter_m: float) -> float:
    """Separation in units of wavelength over diameter."""
    return separation_arcsec / (1e-9 * wavelength_nm / diameter_m * ARCSEC_PER_RAD)


def _spectrum_pixels(root: Path, wavelength_m: float, resolution: float, pixel_m: float) -> float:
    """Pixels of a resolution element of the prism: its length along the spectrum times the height of the core."""
    prism = _table(root / "instrument" / "CONST_Amici_parameters.csv")[0]
    per_lambda_d = wavelength_m * prism["final_focal_length_m"] / prism["compressd_beam_diamtr_m"] / pixel_m
    length, height = (2.0 * prism[f"PSF_core_{axis}_extent_lamD"] * per_lambda_d for axis in "xy")
    nm = wavelength_m * 1e9
    power = prism["constant"] + prism["lam"] * nm + prism["lam_squared"] * nm**2
    return float(power * length / resolution * height)


def _aged(new: float, old: float, detector: Mapping[str, float]) -> float:
    """Return a number of the detector that grows evenly over its life."""
    return new + MONTHS_AT_L2 / detector["DetEOL_mos"] * (old - new)


def _charge(detector: Mapping[str, float]) -> float:
    """Clock-induced charge per pixel and frame: linear in the gain, and its part at gain 0 grows with age."""
    low, high = (detector[f"CICatGain{place}BOM_e_per_pix_per_fr"] for place in (1, 2))
    slope = (high - low) / (detector["Gain2BOM"] - detector["Gain1BOM"])
    grown = _aged(1.0, detector["CICdegradationEOM"], detector)
    return slope * detector["EMGain"] + (low - slope * detector["Gain1BOM"]) * grown


def star_flux(mode: Mode, spectral_type: str) -> float:
    """Photons per second and m2 in the band from a star of magnitude 0, as cgi_noise has it from its spectra.

    Parameters
    ----------
    mode : Mode
    spectral_type : str
        One of its ten types, in small letters.
    """
    recorded = json.loads(RECORDED.read_text(encoding="utf-8"))
    return float(recorded["zero_magnitude_ph_s_m2"][flux_key(mode.wavelength_nm, mode.bandwidth)][spectral_type])


def flux_key(wavelength_nm: float, bandwidth: float) -> str:
    """Name of a band among the recorded fluxes."""
    return f"{wavelength_nm:.0f} nm, {100.0 * bandwidth:.0f} %"


def in_band(mode: Mode, flux_ph_s_m2: float) -> float:
    """Photons per second behind the optics, before the coronagraph, of a star with a flux given in the band."""
    width_nm = mode.bandwidth * mode.wavelength_nm
    bands = Passbands.from_bands([Band("B", "VIS", mode.wavelength_nm, width_nm, mode.transmission, 1.0)])
    low, high = bands.bands[0].support_nm
    photlam = np.full(2, flux_ph_s_m2 * 1e-4 / (10.0 * width_nm))
    area_cm2 = math.pi / 4.0 * (100.0 * mode.diameter_m) ** 2
    return float(bands.spectrum_rate_e_s([low, high], photlam, area_cm2)[0])


@dataclass(frozen=True)
class Answer:
    """What comes out, a number for each that cgi_noise has.

    Attributes
    ----------
    answer : str
        ``ok`` or why there is no time.
    rates : dict
        ``star`` (photons/s behind the optics), ``contrast``, ``efficiency`` (electrons counted per photon),
        ``frame_s``, ``planet`` (e-/s), variances ``var_...`` (e-^2/s) and ``residual`` (e-/s).
    time_s, critical_snr : float or None
        Time to the SNR, and the SNR after endless time.
    """

    answer: str
    rates: dict[str, float]
    time_s: float | None = None
    critical_snr: float | None = None


def forward(
    mode: Mode, *, v_mag: float, planet: Planet, spectral_type: str = "g0v", snr: float = 5.0, stages: int = 0
) -> Answer:
    """Return rates and time of a planet at the separation of the mode.

    Parameters
    ----------
    mode : Mode
    v_mag : float
    planet : Planet
    spectral_type : str
        Of the star.
    snr : float
        Ratio to reach.
    stages : int
        Stages of the register; by default so many that its law is exponential.
    """
    flux = star_flux(mode, spectral_type)
    star, sky = (in_band(mode, flux * 10.0 ** (-0.4 * mag)) for mag in (v_mag, mode.sky_v_mag))
    reference = in_band(mode, star_flux(mode, REFERENCE_TYPE) * 10.0 ** (-0.4 * REFERENCE_V_MAG))
    # The dust's brightness is that at the planet's distance from the star, not at the projected one.
    dust = float(exozodi_fraction_arcsec2(planet.sma_au / planet.distance_pc, planet.zodis))
    behind = mode.core_arcsec2 * mode.occulter_transmission
    photons = {
        "planet": star * planet.contrast * mode.core_throughput,
        "speckle": star * mode.raw_contrast * mode.core_starlight,
        "sky": sky * behind,
        "exozodi": star * dust * 10.0 ** (-0.4 * (mode.dust_v_mag - 22.0)) * behind,
        "stray": mode.stray_ph_s * mode.aperture_pixels,
    }
    per_pixel = sum(photons.values()) * mode.qe / mode.aperture_pixels
    frame_s = round(min(LONGEST_S, max(SHORTEST_S, FRAME_E / per_pixel)), 1)
    threshold = mode.threshold_sigma * mode.read_noise_e
    law = counting_law(mode.em_gain, stages or EXPONENTIAL_STAGES, mode.read_noise_e, threshold)
    efficiency = mode.qe * mode.transfer_efficiency * _counted(law, per_pixel * frame_s)
    # A reference star, shorter and brighter: what it adds to the variances of star light and of all the rest.
    star_of = {"v_mag": REFERENCE_V_MAG}
    strategy = Strategy(library="reference_star", reference_ratio=REFERENCE_RATIO, reference_star=star_of)
    noise = LIBRARIES["reference_star"].noise(strategy, np.array([star]), lambda _: np.array([reference]))
    of_star, of_rest = (1.0 + float(part[0]) / REFERENCE_RATIO for part in (noise.halo, noise.even))
    penalties = {"planet": 1.0, "speckle": of_star, "sky": of_rest, "exozodi": of_star, "stray": of_rest}
    share = mode.spectral_share
    # The planet's own noise is that of all its electrons, counted or not.
    seen = {name: share * (mode.qe if name == "planet" else efficiency) for name in photons}
    variances = {f"var_{name}": penalties[name] * seen[name] * rate for name, rate in photons.items()}
    variances["var_dark"] = of_rest * mode.dark_e_s * mode.aperture_pixels
    variances["var_cic"] = of_rest * mode.cic_e / frame_s * mode.aperture_pixels
    signal = share * efficiency * photons["planet"]
    left = mode.contrast_change / mode.post_processing * mode.core_starlight
    floor = share * efficiency * star * left
    rates = {"star": star, "contrast": planet.contrast, "efficiency": efficiency, "frame_s": frame_s, "planet": signal}
    rates |= variances | {"residual": floor}
    about: dict[str, Any] = {"floor_rate": floor, "convention": "cgi_noise"}
    time = time_for_rates(signal, sum(variances.values()), snr=snr, **about)
    if time.reason == Reason.SPECKLE_FLOOR:
        return Answer(UNREACHABLE, rates)
    endless = snr_for_rates(signal, sum(variances.values()), time_s=1e20, **about)
    return Answer(OK, rates, float(time.unwrap()), float(endless.unwrap()))


def _counted(law: CountingLaw, mean_e: float) -> float:
    """Part of the electrons that count: one passes the threshold with a chance, and others in its pixel are lost."""
    return float(law.e[1]) * -math.expm1(-mean_e) / mean_e


def from_tables(folder: str | Path, scenario: str, *, v_mag: float, planet: Planet, **about: Any) -> Answer:
    """Return the answer from the tables themselves; see `read_mode` and `forward`.

    Parameters
    ----------
    folder, scenario
        As of `read_mode`.
    v_mag, planet
        As of `forward`, and ``about`` its other arguments.
    """
    mode = read_mode(folder, scenario, planet.separation_arcsec)
    return Answer(OUTSIDE, {}) if mode is None else forward(mode, v_mag=v_mag, planet=planet, **about)
