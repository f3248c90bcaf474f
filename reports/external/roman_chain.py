"""Roman's coronagraph from the tables of cgi_noise to a time, by our functions and the choices of cgi_noise.

Source of the choices: github.com/roman-corgi/cgi_noise, commit 597dbfb, ``cgi_noise/tsnr_core.py`` and
``cgi_noise/cginoiselib.py``.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from catalogs import Band
from cpic_planner import Reason, planet_contrast, snr_for_rates, time_for_rates
from cpic_planner.etc.photon_counting import CountingLaw, counting_law
from cpic_planner.queries import LIBRARIES, Strategy
from reports.external.roman_tables import Mode
from simulator import Passbands
from simulator.signal.light import ZODI_V_MAG_ARCSEC2, exozodi_fraction_arcsec2
from simulator.target.star_spectrum import stellar_spectrum

RECORDED = Path(__file__).with_name("recorded") / "cgi_noise.json"
JUPITER_KM, OUR_JUPITER_KM = 69911.0, 71492.0
EXPONENTIAL_STAGES = 1_000_000
"""Stages of a register whose law is exponential to 2e-5, as cgi_noise takes it; a CCD201 has 604."""
REFERENCE_V_MAG, REFERENCE_TYPE, REFERENCE_RATIO = 2.26, "a0v", 0.25
FRAME_E, SHORTEST_S, LONGEST_S = 0.1, 3.0, 100.0
"""Electrons per pixel and frame that are aimed at, and the limits of a frame, rounded to 0.1 s."""
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


def passband(mode: Mode) -> Passbands:
    """Band behind the optics, before coronagraph and detector, so that its rates are photons per second."""
    width_nm = mode.bandwidth * mode.wavelength_nm
    return Passbands.from_bands([Band("B", "VIS", mode.wavelength_nm, width_nm, mode.transmission, 1.0)])


def area_cm2(mode: Mode) -> float:
    """Area of the telescope's disc; what obstructs it is part of the transmission."""
    return math.pi / 4.0 * (100.0 * mode.diameter_m) ** 2


def in_band(mode: Mode, flux_ph_s_m2: float) -> float:
    """Photons per second behind the optics of a star whose flux in the band is given."""
    bands = passband(mode)
    low, high = bands.bands[0].support_nm
    photlam = np.full(2, flux_ph_s_m2 * 1e-5 / (high - low))  # per cm2 and Angstrom
    return float(bands.spectrum_rate_e_s([low, high], photlam, area_cm2(mode))[0])


def own_choices(mode: Mode, planet: Planet, v_mag: float, spectral_type: str) -> dict[str, float]:
    """Return what this package takes where it chooses for itself.

    Returns
    -------
    dict of str to float
        ``star`` (photons/s behind the optics) from our spectra, ``sky`` (photons/s/arcsec2) in the colour of the Sun,
        ``contrast`` with our R_J, ``passing``: part of the electrons that pass the threshold behind 604 stages.
    """
    star = stellar_spectrum(v_mag, spectral_type)
    bands, area = passband(mode), area_cm2(mode)
    law = counting_law(mode.em_gain, 604, mode.read_noise_e, mode.threshold_sigma * mode.read_noise_e)
    return {
        "star": float(bands.spectrum_rate_e_s(star.wavelength_nm, star.photlam, area)[0]),
        "sky": float(bands.sky_rate_e_s_arcsec2(mode.sky_v_mag, area)[0]),
        "contrast": float(planet_contrast(planet.radius_rjup, planet.offset_au, 0.0, planet.phase_deg, planet.albedo)),
        "passing": float(law.e[1]),
    }


@dataclass(frozen=True)
class Light:
    """Photons per second behind the optics, before the detector.

    Attributes
    ----------
    star, reference : float
        Science and reference star, without the coronagraph.
    core : dict
        In the core of the planet's image: ``planet``, ``speckle``, ``sky``, ``exozodi``, ``stray``.
    left : float
        Speckles there that the reference star does not take away, rms.
    """

    star: float
    reference: float
    core: dict[str, float]
    left: float


def light_of(mode: Mode, v_mag: float, planet: Planet, spectral_type: str = "g0v") -> Light:
    """Return the light by the products that cgi_noise has."""
    flux = star_flux(mode, spectral_type)
    star, sky = (in_band(mode, flux * 10.0 ** (-0.4 * mag)) for mag in (v_mag, mode.sky_v_mag))
    reference = in_band(mode, star_flux(mode, REFERENCE_TYPE) * 10.0 ** (-0.4 * REFERENCE_V_MAG))
    behind = mode.core_arcsec2 * mode.occulter_transmission
    core = {
        "planet": star * planet.contrast * mode.core_throughput,
        "speckle": star * mode.raw_contrast * mode.core_starlight,
        "sky": sky * behind,
        "exozodi": star * dust_arcsec2(mode, planet) * behind,
        "stray": mode.stray_ph_s * mode.aperture_pixels,
    }
    return Light(star, reference, core, star * mode.contrast_change / mode.post_processing * mode.core_starlight)


def dust_arcsec2(mode: Mode, planet: Planet) -> float:
    """Light of the dust over that of the star: as bright as at the planet's true distance, not at the projected one."""
    scale = 10.0 ** (-0.4 * (mode.dust_v_mag - ZODI_V_MAG_ARCSEC2))
    return scale * float(exozodi_fraction_arcsec2(planet.sma_au / planet.distance_pc, planet.zodis))


@dataclass(frozen=True)
class Answer:
    """What comes out, a number for each that cgi_noise has.

    Attributes
    ----------
    answer : str
        ``ok`` or why there is no time.
    rates : dict
        ``star`` and, in the core, ``light_...`` (photons/s behind the optics), ``efficiency`` (electrons counted per
        photon), ``frame_s``, ``planet`` (e-/s), variances ``var_...`` (e-^2/s) and ``residual`` (e-/s).
    time_s, critical_snr : float or None
        Time to the SNR, and the SNR after endless time.
    """

    answer: str
    rates: dict[str, float]
    time_s: float | None = None
    critical_snr: float | None = None


def answer(mode: Mode, light: Light, *, snr: float = 5.0, stages: int = EXPONENTIAL_STAGES) -> Answer:
    """Return what the detector makes of the light, and the time, as cgi_noise has it.

    Parameters
    ----------
    mode : Mode
    light : Light
    snr : float
        Ratio to reach.
    stages : int
        Stages of the register.
    """
    per_pixel = sum(light.core.values()) * mode.qe / mode.aperture_pixels
    frame_s = round(min(LONGEST_S, max(SHORTEST_S, FRAME_E / per_pixel)), 1)
    law = counting_law(mode.em_gain, stages, mode.read_noise_e, mode.threshold_sigma * mode.read_noise_e)
    efficiency = mode.qe * mode.transfer_efficiency * _counted(law, per_pixel * frame_s)
    # A reference star, shorter and brighter: what it adds to the variances of star light and of all the rest.
    star_of = {"v_mag": REFERENCE_V_MAG}
    strategy = Strategy(library="reference_star", reference_ratio=REFERENCE_RATIO, reference_star=star_of)
    noise = LIBRARIES["reference_star"].noise(strategy, np.array([light.star]), lambda _: np.array([light.reference]))
    of_star, of_rest = (1.0 + float(part[0]) / REFERENCE_RATIO for part in (noise.halo, noise.even))
    penalties = {"planet": 1.0, "speckle": of_star, "sky": of_rest, "exozodi": of_star, "stray": of_rest}
    share = mode.spectral_share
    # The planet's own noise is that of all its electrons, counted or not.
    seen = {name: share * (mode.qe if name == "planet" else efficiency) for name in light.core}
    variances = {f"var_{name}": penalties[name] * seen[name] * rate for name, rate in light.core.items()}
    variances["var_dark"] = of_rest * mode.dark_e_s * mode.aperture_pixels
    variances["var_cic"] = of_rest * mode.cic_e / frame_s * mode.aperture_pixels
    signal, floor = (share * efficiency * rate for rate in (light.core["planet"], light.left))
    rates = {"star": light.star} | {f"light_{name}": rate for name, rate in light.core.items()}
    rates |= {"efficiency": efficiency, "frame_s": frame_s, "planet": signal} | variances | {"residual": floor}
    about: dict[str, Any] = {"floor_rate": floor, "convention": "cgi_noise"}
    time = time_for_rates(signal, sum(variances.values()), snr=snr, **about)
    if time.reason == Reason.SPECKLE_FLOOR:
        return Answer(UNREACHABLE, rates)
    endless = snr_for_rates(signal, sum(variances.values()), time_s=1e20, **about)
    return Answer(OK, rates, float(time.unwrap()), float(endless.unwrap()))


def _counted(law: CountingLaw, mean_e: float) -> float:
    """Part of the electrons that count: one passes the threshold with a chance, and others in its pixel are lost."""
    return float(law.e[1]) * -math.expm1(-mean_e) / mean_e
