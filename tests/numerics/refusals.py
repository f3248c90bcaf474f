"""Arguments that public functions refuse, and the one line that they refuse them with."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import refusals_camera
from refusal import Refusal

import simulator
from catalogs import eccentric_anomaly, orbit_places, position_angle, separation_arcsec, tangent_offset
from catalogs.coordinates import propagate
from catalogs.stellar_physics import bolometric_correction, gravity, mass_from_luminosity, radius_from_luminosity
from cpic_planner.etc.detection import detection_threshold
from cpic_planner.planets.population import read_law
from cpic_planner.validation import aperture_weights, combine, filled
from simulator.camera.noise import mean_projection_um
from simulator.detectors import clean_fraction
from simulator.effects import cosmic_ray_rate
from simulator.knobs import dial_of
from simulator.passbands import Passbands
from simulator.signal.light import exozodi_fraction_arcsec2
from simulator.target import contrast_at, detector_to_sky, sky_to_detector

NAN, INF = math.nan, math.inf
RAYS = simulator.load_instrument().cosmic_rays
BANDS = Passbands.from_bands()
IMAGE, FRAMES = np.ones((4, 4)), np.ones((2, 4, 4))
GOOD = np.ones((2, 4, 4), dtype=bool)


def star(v_mag: Any, area_cm2: float) -> Any:
    return BANDS.star_rate_e_s(v_mag, 5772.0, 4.44, 0.0, area_cm2)


def observed(**changed: Any) -> Any:
    given = {"scene": "paper_example", "band": "F520", "exposure_s": 1.0, "window": "hole"} | changed
    return simulator.observe(given.pop("scene"), **given)


REFUSALS = [
    *refusals_camera.REFUSALS,
    *(
        Refusal(
            "simulator.lambert_phase",
            simulator.lambert_phase,
            (x,),
            f"phase_deg = {shown} deg: not accepted; allowed: {allowed}",
        )
        for x, shown, allowed in (
            (NAN, "nan", "0 to 180"),
            (INF, "inf", "0 to 180"),
            (-1e-9, "-1e-09", "0 to 180"),
            (math.nextafter(180.0, 181.0), "180.00000000000003", "0 to 180"),
            ("90", "90", "real numbers"),
            (True, "True", "real numbers"),
            (1j, "1j", "real numbers"),
        )
    ),
    *(
        Refusal("simulator.planet_contrast", simulator.planet_contrast, given, says)
        for given, says in (
            ((NAN, 1.0, 0.0, 90.0, 0.5), "radius_rjup = nan R_Jup: not accepted; allowed: finite numbers"),
            ((-1.0, 1.0, 0.0, 90.0, 0.5), "radius_rjup = -1.0 R_Jup: not accepted; allowed: at least 0"),
            ((1.0, 1.0, 0.0, 90.0, INF), "geometric_albedo = inf: not accepted; allowed: finite numbers"),
            (
                (1.0, 0.0, 0.0, 90.0, 0.5),
                "separation = 0.0 AU: not accepted; allowed: above 0 (give the true distance to contrast_at)",
            ),
            ((1.0, 1e-320, 0.0, 90.0, 0.5), "contrast = inf: not accepted; allowed: a finite ratio"),
            ((1e200, 1.0, 0.0, 90.0, 0.5), "contrast = inf: not accepted; allowed: a finite ratio"),
            ((1.0, "1", 0.0, 90.0, 0.5), "separation_ra_au = 1 AU: not accepted; allowed: real numbers"),
        )
    ),
    *(
        Refusal("simulator.target.contrast_at", contrast_at, (1.0, d, 90.0, 0.5), says)
        for d, says in (
            (0.0, "distance_au = 0.0 AU: not accepted; allowed: above 0"),
            (NAN, "distance_au = nan AU: not accepted; allowed: finite numbers"),
            (1e-320, "contrast = inf: not accepted; allowed: a finite ratio"),
        )
    ),
    *(
        Refusal("simulator.target.sky_to_detector", sky_to_detector, given, says)
        for given, says in (
            ((-1.0, 0.0), "separation_arcsec = -1.0 arcsec: not accepted; allowed: at least 0"),
            ((1.0, INF), "pa_deg = inf deg: not accepted; allowed: finite numbers"),
            ((1.0, "north"), "pa_deg = north deg: not accepted; allowed: real numbers"),
        )
    ),
    Refusal(
        "simulator.target.detector_to_sky",
        detector_to_sky,
        (1.5e308, 1.5e308),
        "separation_arcsec = inf arcsec: not accepted; allowed: finite numbers",
    ),
    *(
        Refusal("cpic_planner.validation.detection_threshold", detection_threshold, given, says)
        for given, says in (
            ((NAN, 5.0), "n_resolution_elements = nan: not accepted; allowed: finite and at least 0"),
            ((-1.0, 5.0), "n_resolution_elements = -1.0: not accepted; allowed: finite and at least 0"),
            ((19.0, 0.0), "sigma = 0.0 sigma: not accepted; allowed: above 0 and at most 20"),
            ((19.0, 20.5), "sigma = 20.5 sigma: not accepted; allowed: above 0 and at most 20"),
            (("a", 5.0), "n_resolution_elements = a: not accepted; allowed: numbers, finite and at least 0"),
        )
    ),
    *(
        Refusal(name, call, (FRAMES * x, GOOD), f"frames[0, y=0, x=0] = {x} e-: not accepted; allowed: {allowed}")
        for name, call in (("cpic_planner.validation.combine", combine), ("cpic_planner.validation.filled", filled))
        for x, allowed in (
            (NAN, "finite numbers"),
            (-INF, "finite numbers"),
            (1e308, "-1e+100 to 1e+100, so that sums stay finite"),
        )
    ),
    *(
        Refusal("cpic_planner.validation.aperture_weights", aperture_weights, ((5, 5), *given), says)
        for given, says in (
            ((2.0, 2.0, NAN), "radius_pixel = nan px: not accepted; allowed: a finite number"),
            ((2.0, 2.0, 0.0), "radius_pixel = 0.0 px: not accepted; allowed: finite and above 0"),
            ((2.0, 2.0, "a"), "radius_pixel = a px: not accepted; allowed: real numbers"),
            ((NAN, 2.0, 1.0), "x_pixel = nan px: not accepted; allowed: a circle of radius 1 px inside 5 px"),
        )
    ),
    *(
        Refusal("simulator.Passbands.star_rate_e_s", star, given, says)
        for given, says in (
            ((NAN, 1.0), "v_mag = nan mag: not accepted; allowed: finite numbers"),
            ((-1000.0, 1.0), "v_mag = -1000.0 mag: not accepted; allowed: -30 to 60"),
            ((5.0, 0.0), "area_cm2 = 0.0 cm2: not accepted; allowed: above 0, at most 1e+12"),
            ((5.0, 1e308), "area_cm2 = 1e+308 cm2: not accepted; allowed: above 0, at most 1e+12"),
        )
    ),
    *(
        Refusal("simulator.star_photlam", lambda v, t: simulator.star_photlam(v, teff_k=t), given, says)
        for given, says in (
            ((-31.0, 5000.0), "magnitude_v = -31.0 mag: not accepted; allowed: -30 to 40"),
            ((5.0, math.nextafter(3500.0, 0.0)), "teff_k = 3499.9999999999995 K: not accepted; allowed: 3500 to 8000"),
            ((5.0, math.nextafter(8000.0, 1e4)), "teff_k = 8000.000000000001 K: not accepted; allowed: 3500 to 8000"),
        )
    ),
    *(
        Refusal("simulator.planet_albedo", simulator.planet_albedo, (x,), says)
        for x, says in (
            (NAN, "wavelength_nm = nan nm: not accepted; allowed: 300 to 1754"),
            (10.0, "wavelength_nm = 10.0 nm: not accepted; allowed: 300 to 1754"),
        )
    ),
    *(
        Refusal("simulator.signal.light.exozodi_fraction_arcsec2", exozodi_fraction_arcsec2, given, says)
        for given, says in (
            ((0.0, 1.0), "separation_arcsec = 0.0 arcsec: not accepted; allowed: above 0"),
            ((1e-200, 1.0), "separation_arcsec = 1e-200 arcsec: not accepted; allowed: separations"),
        )
    ),
    Refusal(
        "simulator.detectors.variance.clean_fraction",
        clean_fraction,
        (-1.0, 1.0),
        "loss_per_s = -1.0 1/s: not accepted; allowed: finite and at least 0",
    ),
    Refusal(
        "simulator.camera.noise.mean_projection_um",
        mean_projection_um,
        (NAN, 1.0),
        "depth_um = nan um: not accepted; allowed: 1e-06 to 1e+09",
    ),
    *(
        Refusal("simulator.effects.cosmic_rays", lambda when: cosmic_ray_rate(RAYS, when), (when,), says)
        for when, says in (
            (NAN, "when = nan yr: not accepted; allowed: a finite number"),
            (1900.0, "when = 1900.0 yr: not accepted; allowed: a year, 1972 to 2100"),
            ("soon", "when = soon: not accepted; allowed: a date, 1972 to 2100"),
        )
    ),
    *(
        Refusal("catalogs.orbits.eccentric_anomaly", eccentric_anomaly, given, says)
        for given, says in (
            ((NAN, 0.1), "mean_anomaly_rad = nan rad: not accepted; allowed: finite numbers"),
            ((0.1, 1.0), "eccentricity = 1.0: not accepted; allowed: 0 to 0.999"),
        )
    ),
    Refusal(
        "catalogs.orbits.orbit_places",
        orbit_places,
        (0.0, 0, 0, 0, 0, 0),
        "semi_major_axis_au = 0.0 au: not accepted; allowed: above 0",
    ),
    Refusal(
        "cpic_planner.planets.population",
        read_law,
        ({"law": "uniform", "low": 1.0, "high": 1.0},),
        "low = 1.0: not accepted; allowed: below high = 1",
    ),
    Refusal(
        "catalogs.coordinates.separation_arcsec",
        separation_arcsec,
        (NAN, 0.0, 0.0, 0.0),
        "ra_deg = nan: not accepted; allowed: finite numbers",
    ),
    Refusal(
        "catalogs.coordinates.separation_arcsec",
        separation_arcsec,
        ("east", 0.0, 0.0, 0.0),
        "ra_deg = east: not accepted; allowed: real numbers",
    ),
    Refusal(
        "catalogs.coordinates.tangent_offset",
        tangent_offset,
        (0.0, 0.0, 180.0, 0.0),
        "ra_deg, dec_deg = position: not accepted; allowed: less than 90 deg from the tangent point",
    ),
    Refusal(
        "catalogs.coordinates.position_angle",
        position_angle,
        (NAN, 1.0),
        "east = nan: not accepted; allowed: finite numbers",
    ),
    Refusal(
        "catalogs.coordinates.propagate",
        propagate,
        (0, 0, 1e300, 0, 1, 0, 2000, 1e300),
        "to_epoch_yr = 1e+300 yr: not accepted; allowed: epochs at which the star is at a finite place",
    ),
    Refusal(
        "catalogs.stellar_physics.bolometric_correction",
        bolometric_correction,
        (0.0,),
        "teff_k = 0.0 K: not accepted; allowed: above 0",
    ),
    Refusal(
        "catalogs.stellar_physics.radius_from_luminosity",
        radius_from_luminosity,
        (-1.0, 5772.0),
        "luminosity_lsun = -1.0 L_sun: not accepted; allowed: above 0",
    ),
    Refusal(
        "catalogs.stellar_physics.mass_from_luminosity",
        mass_from_luminosity,
        (0.0,),
        "luminosity_lsun = 0.0 L_sun: not accepted; allowed: above 0",
    ),
    Refusal(
        "catalogs.stellar_physics.gravity", gravity, (0.0, 1.0), "mass_msun = 0.0 M_sun: not accepted; allowed: above 0"
    ),
    *(
        Refusal("simulator.knobs.dial_of", dial_of, given, says)
        for given, says in (
            ((None, -1e-12), "tolerance = -1e-12: not accepted; allowed: 0 to 0.5"),
            ((None, NAN), "tolerance = nan: not accepted; allowed: a finite number"),
            (("quick", 0.1), "tolerance = 0.1: not accepted; allowed: without fidelity"),
        )
    ),
    *(
        Refusal(
            "simulator.stream",
            simulator.stream,
            (seed, "a"),
            f"seed = {seed}: not accepted; allowed: an integer from 0 to 9223372036854775807",
        )
        for seed in (-1, NAN)
    ),
    *(
        Refusal("simulator.observe", lambda changed: observed(**changed), (changed,), says)
        for changed, says in (
            ({"exposure_s": 0.0}, "exposure_s = 0.0 s: not accepted; allowed:"),
            ({"exposure_s": NAN}, "exposure_s = nan s: not accepted; allowed:"),
            ({"exposure_s": 1e7}, "exposure_s = 10000000.0 s: not accepted; allowed:"),
            ({"n_frames": 0}, "n_frames = 0: not accepted; allowed: an integer from 1 to 1000000"),
            ({"n_frames": 10**6 + 1}, "n_frames = 1000001: not accepted; allowed: an integer from 1 to 1000000"),
            ({"em_gain": 0.5}, "em_gain = 0.5: not accepted; allowed:"),
            ({"em_gain": 1e4}, "em_gain = 10000.0: not accepted; allowed:"),
        )
    ),
]
