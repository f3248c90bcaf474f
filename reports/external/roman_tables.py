"""What the tables of cgi_noise say of a scenario of Roman's coronagraph at one separation.

Source of how they are read: github.com/roman-corgi/cgi_noise, commit 597dbfb, ``cgi_noise/cginoiselib.py``; the tables
are those of ``cgi_noise/data``, none of which is here.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cpic_core import load_yaml
from simulator.config.instrument import ARCSEC_PER_RAD

MONTHS_AT_L2 = 21.0
EDGE_LAMBDA_D = 0.05
"""As far beyond the edges of its tables a planet counts as on them."""


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
