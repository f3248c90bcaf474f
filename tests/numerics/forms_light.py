"""Closed forms of light: magnitudes, integrals over bands, albedos, stellar physics."""

from __future__ import annotations

import functools
import itertools

import numpy as np
from mpmath import mp, mpf
from oracle import ClosedForm

import simulator
from catalogs import load_albedo, load_bands, load_zodi_table, luminosity_from_v
from catalogs.stellar_physics import (
    bolometric_correction,
    colour_temperature,
    gravity,
    mass_from_luminosity,
    radius_from_luminosity,
)
from simulator.config import load_scene
from simulator.effects.sky import colour_factor, zodiacal_radiance
from simulator.passbands import Passbands, v_photon_rate, vega_v_photon_rate
from simulator.target import scene_sources, stellar_spectrum
from simulator.target.contrast import AU_KM, JUPITER_RADIUS_KM

MAGNITUDES = (-27.0, -1.46, 0.0, 1e-9, 5.0, 17.3, 30.0)
EDGES = (3500.0, 3500.0 + 1e-9, 5772.0, 8000.0)
AREA_CM2 = 31415.926535897932
BANDS = Passbands.from_bands()
F520 = load_bands()["F520"]


@functools.cache
def star_at_0(teff: float) -> float:
    return float(BANDS.star_rate_e_s(0.0, teff, 4.44, 0.0, AREA_CM2)[BANDS.index("F520")])


@functools.cache
def spectrum(v_mag: float, teff: float) -> tuple[np.ndarray, np.ndarray]:
    star = stellar_spectrum(v_mag, teff_k=teff)
    return star.wavelength_nm, star.photlam


def linear_rate(first: float, last: float) -> float:
    """Detected rate of a photon spectrum that is linear from 500 to 540 nm, sampled at its ends."""
    low, high = F520.support_nm
    passbands = Passbands.from_bands([F520])
    return float(passbands.spectrum_rate_e_s([low - 1.0, high + 1.0], [first, last], AREA_CM2)[0])


def linear_exact(first: mpf, last: mpf) -> mpf:
    low, high = (mpf(x) for x in F520.support_nm)
    middle = (first + last) / 2
    return mpf(AREA_CM2) * middle * (high - low) * 10 * mpf(F520.t_opt) * mpf(F520.qe)


JUPITER = load_albedo("jupiter")


def table_value(x: mpf) -> mpf:
    """Linear interpolation of a table at the doubles that it holds."""
    nodes, values = JUPITER.wavelength_nm, JUPITER.albedo
    k = min(max(int(np.searchsorted(nodes, float(x), side="right")) - 1, 0), nodes.size - 2)
    share = (x - mpf(float(nodes[k]))) / (mpf(float(nodes[k + 1])) - mpf(float(nodes[k])))
    return (1 - share) * mpf(float(values[k])) + share * mpf(float(values[k + 1]))


def scene(v_mag: float, distance_pc: float, separation: float, radius: float) -> float:
    """Band contrast of a grey planet at phase 90 deg, as the sources of a scene have it."""
    tree = {
        "name": "one",
        "cstar": {"v_mag": v_mag, "teff_k": 5772.0, "distance_pc": distance_pc},
        "planets": [
            {
                "name": "b",
                "radius_rjup": radius,
                "phase_deg": 90.0,
                "separation_arcsec": separation,
                "pa_deg": 30.0,
                "albedo": {"model": "constant", "value": 0.5},
            }
        ],
    }
    instrument = simulator.load_instrument()
    return float(scene_sources(load_scene(tree), instrument, "F520")[1].contrast or 0.0)


def scene_exact(v_mag: mpf, distance_pc: mpf, separation: mpf, radius: mpf) -> mpf:
    size = radius * mpf(JUPITER_RADIUS_KM) / mpf(AU_KM) / (separation * distance_pc)
    return size**2 / 2 / mp.pi


ZODI = load_zodi_table()


def zodi_exact(longitude: mpf, latitude: mpf) -> mpf:
    axes = (ZODI.helioecliptic_longitude_deg, ZODI.ecliptic_latitude_deg)
    parts = []
    for axis, place in zip(axes, (abs(longitude), abs(latitude)), strict=True):
        k = min(max(int(np.searchsorted(axis, float(place))), 1), axis.size - 1)
        share = (place - mpf(float(axis[k - 1]))) / (mpf(float(axis[k])) - mpf(float(axis[k - 1])))
        parts.append(((k - 1, 1 - share), (k, share)))
    table = ZODI.radiance_500nm_w_m2_sr_um
    return mp.exp(mp.fsum(a * b * mp.log(mpf(float(table[i, j]))) for i, a in parts[0] for j, b in parts[1]))


def colour(wavelength: mpf) -> mpf:
    logarithm = mp.log10(wavelength / 500)
    return 1 + (mpf(0.9) if logarithm < 0 else mpf(0.6)) * logarithm


FLOWER = {
    3.70: ("-0.190537291496456e05", "0.155144866764412e05", "-0.421278819301717e04", "0.381476328422343e03"),
    3.90: (
        "-0.370510203809015e05",
        "0.385672629965804e05",
        "-0.150651486316025e05",
        "0.261724637119416e04",
        "-0.170623810323864e03",
    ),
    99.0: (
        "-0.118115450538963e06",
        "0.137145973583929e06",
        "-0.636233812100225e05",
        "0.147412923562646e05",
        "-0.170587278406872e04",
        "0.788731721804990e02",
    ),
}


BESIDES_K = (4800.0, 5200.0, 5600.0, 6000.0, 6400.0, 6800.0, 7200.0, 7600.0, 8000.0)
BESIDES_MAG = (0.0, 0.020, 0.005, -0.011, -0.021, -0.028, -0.030, -0.024, -0.023)
"""Magnitudes that spectra of dwarfs of solar metallicity add at these temperatures, with straight lines between."""


def correction(teff: mpf) -> mpf:
    """Torres 2010, table 1; his coefficients are the doubles of the code. Beside it, what our spectra add."""
    x = mp.log10(teff)
    series = next(row for limit, row in FLOWER.items() if x < limit)
    inside = min(max(teff, mpf(BESIDES_K[0])), mpf(BESIDES_K[-1]))
    left = max(n for n, node in enumerate(BESIDES_K[:-1]) if node <= inside)
    (low, high), (first, last) = ((mpf(v) for v in row[left : left + 2]) for row in (BESIDES_K, BESIDES_MAG))
    besides = first + (inside - low) / (high - low) * (last - first)
    return besides + mp.fsum(mpf(float(c)) * x**n for n, c in enumerate(series))


def luminosity(v_mag: mpf, distance: mpf, teff: mpf) -> mpf:
    m_bol = v_mag - 5 * mp.log10(distance / 10) + correction(teff)
    return mpf(10) ** (mpf("-0.4") * (m_bol - mpf(4.73)))


def temperature(colour_index: mpf, metals: mpf) -> mpf:
    x, z = colour_index, metals
    if mpf(0.18) < x < mpf(1.29):
        theta = (
            mpf(0.5665)
            + mpf(0.4809) * x
            - mpf(0.0060) * x**2
            - mpf(0.0613) * x * z
            - mpf(0.0042) * z
            - mpf(0.0055) * z**2
        )
        return 5040 / theta
    return 4600 * (1 / (mpf(0.92) * x + mpf(1.7)) + 1 / (mpf(0.92) * x + mpf(0.62)))


def mass(lum: mpf) -> mpf:
    x = mp.log10(lum)
    if x < mpf(4.572) * mp.log10(mpf(0.72)) - mpf(0.102):
        return mpf(10) ** ((x + mpf(0.102)) / mpf(4.572))
    if x < mpf(5.743) * mp.log10(mpf(1.05)) - mpf(0.007):
        return mpf(10) ** ((x + mpf(0.007)) / mpf(5.743))
    return mpf(10) ** ((x - mpf(0.010)) / mpf(4.329))


TEFFS = [(t,) for t in (3500.0, 4000.0, 5011.0, 5012.0, 5772.0, 7943.0, 7944.0, 10000.0, 50000.0)]
FORMS = [
    ClosedForm(
        "simulator.Passbands.star_rate_e_s, over that of V = 0",
        "V -27 to 30, Teff at the edges of the grid",
        list(itertools.product(MAGNITUDES, EDGES)),
        lambda v, t: BANDS.star_rate_e_s(v, t, 4.44, 0.0, AREA_CM2)[BANDS.index("F520")] / star_at_0(t),
        lambda v, t: mpf(10) ** (mpf("-0.4") * v),
        fixed=(1,),
    ),
    ClosedForm(
        "simulator.Passbands.sky_rate_e_s_arcsec2, over that of 0",
        "0 to 40 mag/arcsec2",
        [(m,) for m in (0.0, 1e-9, 22.0, 40.0)],
        lambda m: BANDS.sky_rate_e_s_arcsec2(m, 1.0)[0] / BANDS.sun_rates[0],
        lambda m: mpf(10) ** (mpf("-0.4") * m),
    ),
    ClosedForm(
        "simulator.Passbands.spectrum_rate_e_s, linear spectrum",
        "1e-300 to 1e290 ph/s/cm2/A at either end",
        [(1.0, 1.0), (0.0, 1.0), (1.0, 1e-12), (1e-300, 2e-300), (1e290, 1.0)],
        linear_rate,
        linear_exact,
    ),
    ClosedForm(
        "simulator.star_photlam, V rate over Vega's",
        "V -27 to 30, Teff at the edges of the grid",
        list(itertools.product(MAGNITUDES, EDGES)),
        lambda v, t: v_photon_rate(*spectrum(v, t)) / vega_v_photon_rate(),
        lambda v, t: mpf(10) ** (mpf("-0.4") * v),
        fixed=(1,),
    ),
    ClosedForm(
        "simulator.planet_albedo, Jupiter",
        "every kind of place between the samples, both ends",
        [(float(x),) for x in (JUPITER.wavelength_nm[0], 300.05, 520.0, 889.9999, 1049.7, JUPITER.wavelength_nm[-1])],
        lambda x: simulator.planet_albedo(x, model="jupiter"),
        table_value,
    ),
    ClosedForm(
        "simulator.spectrum_generator, band contrast of a grey planet",
        "V -27 to 30, 0.1 pc to 1 kpc, 1e-6 to 120 arcsec",
        [
            (v, d, s, r)
            for v in (-27.0, 30.0)
            for d, s, r in ((0.1, 120.0, 1.0), (10.0, 0.55, 1e-3), (1000.0, 1e-6, 0.1))
        ],
        scene,
        scene_exact,
    ),
    ClosedForm(
        "simulator.effects.sky.zodiacal_radiance",
        "tabulated directions and between them",
        [(60.0, 0.0), (90.0, 30.0), (-100.0, -33.3), (180.0, 0.0), (135.0, 90.0), (77.7, 1e-9)],
        lambda x, y: zodiacal_radiance(x, y).radiance_500nm_w_m2_sr_um,
        zodi_exact,
    ),
    ClosedForm(
        "simulator.effects.sky.colour_factor",
        "300 to 1750 nm, 90 deg from the Sun",
        [(x,) for x in (300.0, 499.999999, 500.0, 500.000001, 1750.0)],
        lambda x: colour_factor(x, 90.0),
        colour,
    ),
    ClosedForm(
        "catalogs.stellar_physics.bolometric_correction", "3500 to 50000 K", TEFFS, bolometric_correction, correction
    ),
    ClosedForm(
        "catalogs.stellar_physics.luminosity_from_v",
        "V -27 to 30, 0.1 pc to 1 kpc",
        [(v, d, t) for v in (-27.0, 5.0, 30.0) for d in (0.1, 10.0, 1000.0) for t in (3500.0, 5772.0, 8000.0)],
        luminosity_from_v,
        luminosity,
    ),
    ClosedForm(
        "catalogs.stellar_physics.radius_from_luminosity",
        "1e-6 to 1e6 L_sun",
        list(itertools.product((1e-6, 1.0, 1e6), (2000.0, 5772.0, 50000.0))),
        radius_from_luminosity,
        lambda lum, t: mp.sqrt(lum) * (5772 / t) ** 2,
    ),
    ClosedForm(
        "catalogs.stellar_physics.mass_from_luminosity",
        "1e-6 to 1e6 L_sun",
        [(x,) for x in (1e-6, 0.17, 0.18, 1.0, 1.3, 1.4, 1e6)],
        mass_from_luminosity,
        mass,
    ),
    ClosedForm(
        "catalogs.stellar_physics.gravity",
        "0.1 to 100 M_sun, 1e-2 to 1e3 R_sun",
        list(itertools.product((0.1, 1.0, 100.0), (1e-2, 1.0, 1e3))),
        gravity,
        lambda m, r: mpf(4.438) + mp.log10(m) - 2 * mp.log10(r),
    ),
    ClosedForm(
        "catalogs.stellar_physics.colour_temperature",
        "B-V -0.4 to 2.0, [Fe/H] -2.5 to 0.5",
        list(itertools.product((-0.4, 0.18, 0.1800001, 0.65, 1.2899, 1.29, 2.0), (-2.5, 0.0, 0.5))),
        lambda x, z: colour_temperature(x, z)[0],
        temperature,
    ),
]
