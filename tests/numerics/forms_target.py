"""Closed forms of targets: phase, contrast, places, light of the sky and of planets."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from mpmath import mp, mpf
from oracle import ClosedForm

import simulator
from catalogs import separation_arcsec, tangent_offset
from cpic_planner.etc import reference_distance_au
from cpic_planner.queries import ReferencePlanet
from cpic_planner.targets import Targets, find_target
from simulator.config import load_instrument
from simulator.effects import cosmic_ray_rate, ecliptic_deg
from simulator.effects.sky import elongation_deg
from simulator.signal.light import exozodi_fraction_arcsec2
from simulator.target import contrast_at, detector_to_sky, sky_to_detector
from simulator.target.contrast import AU_KM, JUPITER_RADIUS_KM
from simulator.target.star_spectrum import photon_surface, thermal_photlam

PHASES = (
    0.0,
    1e-12,
    1e-9,
    1e-6,
    1e-3,
    1.0,
    45.0,
    63.3,
    90.0,
    122.7,
    122.8,
    135.0,
    179.0,
    180.0 - 1e-3,
    180.0 - 1e-6,
    180.0 - 1e-9,
    180.0 - 3e-14,
    180.0,
)
ALBEDOS = (1e-6, 0.5, 1.0)
ANGLES = (
    0.0,
    1e-9,
    0.1,
    45.0,
    90.0 - 1e-9,
    90.0,
    90.0 + 1e-9,
    135.0,
    180.0 - 1e-9,
    180.0,
    225.0,
    270.0,
    359.999,
    360.0,
)


def rad(x: mpf) -> mpf:
    return x * mp.pi / 180


def phi(a: mpf) -> mpf:
    # The difference from 180 deg cancels in 50 digits only below 1e-30 deg.
    d = rad(180 - a)
    with mp.extradps(60):
        return (mp.sin(d) - d * mp.cos(d)) / mp.pi


def eq1(radius: mpf, east: mpf, north: mpf, phase: mpf, albedo: mpf) -> mpf:
    size = radius * mpf(JUPITER_RADIUS_KM) / mpf(AU_KM) * mp.sin(rad(phase)) / mp.hypot(east, north)
    return albedo * size**2 * phi(phase)


def contrasts() -> list[tuple[float, ...]]:
    """From 1e-3 (ten radii of Jupiter at 0.1 au) down to 1e-15 and beyond."""
    fixed = [(1.0, 3.0, -4.0, phase, 0.5) for phase in PHASES]
    offsets = [(0.0, 1e-6), (1e-6, 0.0), (1e-3, 1e-9), (0.1, 0.0), (30.0, 40.0), (1e4, 1e5), (1e-150, 1e-150)]
    return fixed + [
        (r, e, n, 63.0, a)
        for r, (e, n), a in itertools.product((1e-2, 1.0, 10.0), offsets, ALBEDOS)
        if not (e == 1e-150 and r > 0.1)
    ]


def places() -> list[tuple[float, ...]]:
    separations = (0.0, 1e-6, 0.55, 1.0, 120.0, 1e6)
    return [(rho, pa, roll) for rho in separations for pa in ANGLES for roll in (0.0, 30.0, -1e-9)]


OFFSETS = [
    (x, y)
    for x in (-120.0, -0.5, -1e-6, 0.0, 1e-6, 1e-9, 0.5, 1e150)
    for y in (-0.5, -1e-9, 0.0, 1e-6, 0.5, 1e150)
    if (x, y) != (0.0, 0.0)
]
ON_SKY = [
    (ra, dec, ra + dra, dec + ddec)
    for ra, dec in ((0.0, 0.0), (26.017, -15.937), (219.9, -60.8), (10.0, 89.9))
    for dra, ddec in (
        (1e-10, 0.0),
        (0.0, 1e-10),
        (1e-6, -1e-6),
        (0.01, 0.02),
        (40.0, 5.0),
        (180.0, -2 * dec),
        (180.0 - 1e-6, -2 * dec),
        (180.0, 1e-7 - 2 * dec),
    )
    if abs(dec + ddec) <= 90.0
]


def pa_exact(x: mpf, y: mpf) -> mpf:
    angle = mp.degrees(mp.atan2(-x, y))
    turned = angle + 360 if angle < 0 else angle
    # What rounds to a whole turn is 0.
    return mpf(0) if float(turned) == 360.0 else turned


def haversine(ra: mpf, dec: mpf, ra0: mpf, dec0: mpf) -> mpf:
    with mp.extradps(40):
        a, d, a0, d0 = rad(ra), rad(dec), rad(ra0), rad(dec0)
        square = mp.sin((d - d0) / 2) ** 2 + mp.cos(d) * mp.cos(d0) * mp.sin((a - a0) / 2) ** 2
        return 2 * mp.asin(mp.sqrt(square)) * 180 * 3600 / mp.pi


def tangent(part: int) -> Callable[..., mpf]:
    def exact(ra: mpf, dec: mpf, ra0: mpf, dec0: mpf) -> mpf:
        a, d, a0, d0 = rad(ra), rad(dec), rad(ra0), rad(dec0)
        cosine = mp.sin(d0) * mp.sin(d) + mp.cos(d0) * mp.cos(d) * mp.cos(a - a0)
        east = mp.cos(d) * mp.sin(a - a0) / cosine
        north = (mp.cos(d0) * mp.sin(d) - mp.sin(d0) * mp.cos(d) * mp.cos(a - a0)) / cosine
        return (east, north)[part] * 180 * 3600 / mp.pi

    return exact


def sun_distance(longitude: mpf, latitude: mpf) -> mpf:
    with mp.extradps(40):
        return mp.degrees(mp.acos(mp.cos(rad(longitude)) * mp.cos(rad(latitude))))


def latitude(ra: mpf, dec: mpf) -> mpf:
    tilt = rad(mpf(23.4392911))
    return mp.degrees(mp.asin(mp.sin(rad(dec)) * mp.cos(tilt) - mp.cos(rad(dec)) * mp.sin(rad(ra)) * mp.sin(tilt)))


def surface(wavelength: mpf, teff: mpf) -> mpf:
    c, h, k = mpf(29979245800), mpf(6.62607015e-34), mpf(1.380649e-23)
    x = wavelength * mpf("1e-7")
    return 2 * mp.pi * c / x**4 / mp.expm1(h * c / (k * x * teff)) * mpf("1e-8")


def sphere(wavelength: mpf, teff: mpf, radius: mpf, distance: mpf) -> mpf:
    size = radius * mpf(JUPITER_RADIUS_KM) / (distance * 648000 / mp.pi * mpf(AU_KM))
    return surface(wavelength, teff) * size**2


RAYS = load_instrument().cosmic_rays


def rays(year: mpf) -> mpf:
    turn = 2 * mp.pi * (year - mpf(RAYS.cycle_minimum_year)) / mpf(RAYS.cycle_years)
    peak = mpf(RAYS.peak_rate_per_s_cm2) * mpf(RAYS.orbit_factor)
    return peak * (1 - mpf(RAYS.cycle_depth) / 2 * (1 - mp.cos(turn)))


TAU_CET = find_target("tau Cet")[0]
NEAR = [sky for sky in ON_SKY if abs(sky[2] - sky[0]) < 90.0]


def at_distance(distance_pc: float) -> Targets:
    return replace(TAU_CET, distance_pc=np.array([distance_pc]))


TEFFS, WAVELENGTHS = (100.0, 500.0, 3500.0, 5772.0, 8000.0, 1e6), (300.0, 520.0, 1050.0, 1750.0)

FORMS = [
    ClosedForm(
        "simulator.lambert_phase",
        "0 to 180 deg, to 3e-14 deg of either end",
        [(x,) for x in PHASES],
        simulator.lambert_phase,
        phi,
    ),
    ClosedForm(
        "simulator.planet_contrast",
        "offsets 1e-150 to 1e5 au, 0.01 to 10 R_J, 0 to 180 deg",
        contrasts(),
        simulator.planet_contrast,
        eq1,
    ),
    ClosedForm(
        "simulator.target.contrast_at",
        "0.01 to 10 R_J at 1e-3 to 1e5 au, 0 to 180 deg",
        list(itertools.product((0.01, 1.0, 10.0), (1e-3, 1.0, 1e5), PHASES, (0.5,))),
        contrast_at,
        lambda r, d, a, g: g * (r * mpf(JUPITER_RADIUS_KM) / mpf(AU_KM) / d) ** 2 * phi(a),
    ),
    ClosedForm(
        "simulator.target.sky_to_detector, x",
        "0 to 1e6 arcsec, angles next to every quarter turn",
        places(),
        lambda rho, pa, roll: sky_to_detector(rho, pa, roll_deg=roll)[0],
        lambda rho, pa, roll: -rho * mp.sin(rad(pa - roll)),
    ),
    ClosedForm(
        "simulator.target.sky_to_detector, y",
        "0 to 1e6 arcsec, angles next to every quarter turn",
        places(),
        lambda rho, pa, roll: sky_to_detector(rho, pa, roll_deg=roll)[1],
        lambda rho, pa, roll: rho * mp.cos(rad(pa - roll)),
    ),
    ClosedForm(
        "simulator.target.detector_to_sky, separation",
        "offsets 1e-9 to 1e150 arcsec",
        OFFSETS,
        lambda x, y: detector_to_sky(x, y)[0],
        mp.hypot,
    ),
    ClosedForm(
        "simulator.target.detector_to_sky, position angle",
        "offsets 1e-9 to 1e150 arcsec",
        OFFSETS,
        lambda x, y: detector_to_sky(x, y)[1],
        pa_exact,
    ),
    ClosedForm(
        "cpic_planner.etc.rates.reference_distance_au",
        "0.1 pc to 1 kpc, 1e-6 to 120 arcsec, to 1e-9 deg of 0 and 180",
        list(itertools.product((0.1, 10.0, 1000.0), (1e-6, 0.55, 120.0), [p for p in PHASES if 0 < p < 180])),
        lambda d, rho, a: reference_distance_au(at_distance(d), np.array([rho]), ReferencePlanet(phase_deg=a))[0, 0],
        lambda d, rho, a: d * rho / mp.sin(rad(a)),
    ),
    ClosedForm(
        "simulator.signal.light.exozodi_fraction_arcsec2",
        "1e-6 to 120 arcsec, 1e-6 to 1e5 zodis",
        list(itertools.product((1e-6, 0.3, 120.0), (1e-6, 1.0, 1e5))),
        exozodi_fraction_arcsec2,
        lambda s, n: mpf(10) ** (mpf("-0.4") * (mpf(22) - mpf("4.83"))) / 100 * n / s**2,
    ),
    ClosedForm(
        "simulator.effects.cosmic_rays",
        "1972 to 2101",
        [(x,) for x in (1972.0, 2000.0, 2019.96, 2024.9, 2028.0, 2101.0)],
        lambda year: cosmic_ray_rate(RAYS, year),
        rays,
    ),
    ClosedForm(
        "simulator.effects.sky.elongation_deg",
        "1e-9 to 180 deg",
        [
            (0.0, 0.0),
            (1e-9, 0.0),
            (0.0, 1e-9),
            (1e-6, -1e-6),
            (0.01, 0.01),
            (60.0, 30.0),
            (90.0, 0.0),
            (179.999999, 0.0),
            (180.0, 1e-9),
            (180.0, 0.0),
            (-120.0, -45.0),
            (-359.0, 2.0),
        ],
        elongation_deg,
        sun_distance,
    ),
    ClosedForm(
        "simulator.effects.sky.ecliptic_deg, latitude",
        "poles and equator",
        [(0.0, 0.0), (26.017, -15.937), (270.0, 66.5), (270.0, 90.0), (90.0, 23.4), (180.0, 1e-9)],
        lambda ra, dec: ecliptic_deg(ra, dec)[1],
        latitude,
    ),
    ClosedForm(
        "simulator.target.star_spectrum.photon_surface",
        "100 K to 1e6 K, 300 to 1750 nm",
        list(itertools.product(WAVELENGTHS, TEFFS)),
        lambda x, t: photon_surface(np.array([x]), t)[0],
        surface,
    ),
    ClosedForm(
        "simulator.target.star_spectrum.thermal_photlam",
        "0.1 pc to 1 kpc",
        list(itertools.product((520.0, 1750.0), TEFFS, (1.0,), (0.1, 10.0, 1000.0))),
        lambda x, t, r, d: thermal_photlam(np.array([x]), t, r, d)[0],
        sphere,
    ),
    ClosedForm(
        "catalogs.coordinates.separation_arcsec",
        "1e-10 to 180 deg, next to the pole",
        ON_SKY,
        separation_arcsec,
        haversine,
    ),
    ClosedForm(
        "catalogs.coordinates.tangent_offset, east",
        "1e-10 to 40 deg, next to the pole",
        NEAR,
        lambda *sky: tangent_offset(*sky)[0],
        tangent(0),
    ),
    ClosedForm(
        "catalogs.coordinates.tangent_offset, north",
        "1e-10 to 40 deg, next to the pole",
        NEAR,
        lambda *sky: tangent_offset(*sky)[1],
        tangent(1),
    ),
]
