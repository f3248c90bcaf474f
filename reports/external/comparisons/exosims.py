"""Completeness of one visit: EXOSIMS."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np

from reports.external.comparison import Reference, Row

TITLE = "Completeness: EXOSIMS"
REFERENCE = Reference(
    "EXOSIMS",
    "3.6.6",
    "package index, `Completeness`",
    ("EXOSIMS==3.6.6", "numpy<2.4"),
)
TEXT = """
Planets of albedo 0.3, radii of 0.5 to 1.2 R_J and orbits of 0.5 to 5 au (both uniform in the logarithm) of any
orientation, with eccentricities uniform to 0.35 or on circles: the part of them between two separations and above a
contrast. The separations are the corners of our dark hole of F520, for a star at 3 or 6 pc. None of this needs a list
of targets, and so EXOSIMS runs without its downloads; its analytic completeness does not start with numpy 2.4 or
later. Three answers of EXOSIMS are compared: its own planets counted, which is Brown's (2005) completeness by
definition; `BrownCompleteness`, which reads it off a histogram; and `GarrettCompleteness`, which integrates
densities.

The count agrees with ours. The histogram's sum up to the upper edge of a bin of 0.036 mag is taken for that up to its
centre, so that its limit is half a bin too faint: 0.1 to 5 % too many planets. The integral meets the singular ends
of the density of distance of elliptic orbits with a fixed rule, which leaves 96 % of the planets; on circles it has
99.9 %. Last comes what an annulus says nothing of: the dark hole of CPI-C is four squares. Of the planets above 1e-9
in the annulus between their corners they hold 37 to 40 %, and 24 to 28 % are measured, since a whole aperture must
lie in the squares; of the few above 1e-8, which stand close to the star, less.
"""
DRAWS, OUR_DRAWS, SEED = 4_000_000, 500_000, 1
ALBEDO, RADIUS_RJUP, AXIS_AU, BAND = 0.3, (0.5, 1.2), (0.5, 5.0), "F520"
ORBITS = {"elliptic": (0.0, 0.35), "circular": (0.0, 0.0)}  # eccentricities
DISTANCES_PC, CONTRASTS = (3.0, 6.0), (1e-8, 1e-9)
CORNERS_ARCSEC = (0.23060, 0.99985)  # inner and outer, of the dark hole
JUPITER_EARTH = 71492.0 / 6378.1
PHASES_DEG, STANDARD_ERRORS = (30.0, 90.0, 150.0), 4.0
WHY_BROWN = "its sum up to the edge of a bin of brightness is taken for that up to its centre"
WHY_GARRETT = "its density of distance sums to 0.962"


def peer() -> dict[str, Any]:
    """Ask EXOSIMS."""
    from astropy import units
    from EXOSIMS.Completeness.BrownCompleteness import BrownCompleteness
    from EXOSIMS.Completeness.GarrettCompleteness import GarrettCompleteness

    found: dict[str, Any] = {"corners": list(CORNERS_ARCSEC), "phase": []}
    for name, eccentricity in ORBITS.items():
        modules = dict.fromkeys(
            ("PlanetPopulation", "PlanetPhysicalModel", "OpticalSystem", "StarCatalog", "TargetList"), " "
        )  # its prototypes
        asked = {
            "modules": modules,
            "cachedir": ".",
            "verbose": False,
            "arange": list(AXIS_AU),
            "erange": list(eccentricity),
            "prange": [ALBEDO, ALBEDO],
            "Rprange": [radius * JUPITER_EARTH for radius in RADIUS_RJUP],
            "Nplanets": DRAWS,
        }
        np.random.seed(SEED)  # noqa: NPY002 (the package draws from the global generator)
        brown, garrett = (kind(**copy.deepcopy(asked)) for kind in (BrownCompleteness, GarrettCompleteness))
        if not found["phase"]:
            phase = brown.PlanetPhysicalModel.calc_Phi(np.deg2rad(PHASES_DEG) * units.rad)
            found["phase"] = np.asarray(phase).tolist()
        separation, magnitude = brown.genplans(DRAWS)
        separation = separation.to_value("AU")
        axis = np.linspace(garrett.rmin, garrett.rmax, 100_001)
        found[name] = {
            "bin_mag": float(brown.yedges[1] - brown.yedges[0]),
            "density": float(np.trapezoid(garrett.dist_r(axis), axis)),
            "cases": [],
        }
        for distance in DISTANCES_PC:
            low, high = (min(corner * distance, garrett.rmax) for corner in CORNERS_ARCSEC)
            between = (separation >= low) & (separation <= high)
            for contrast in CONTRASTS:
                limit = -2.5 * math.log10(contrast)
                where = (np.array([low]), np.array([high]), np.array([limit]))
                found[name]["cases"].append(
                    {
                        "distance_pc": distance,
                        "contrast": contrast,
                        "counted": float(np.mean(between & (magnitude <= limit))),
                        "brown": float(brown.comp_calc(*where)[0]),
                        "garrett": float(garrett.comp_s(*where)[0]),
                    }
                )
    return found


def rows(recorded: dict[str, Any]) -> list[Row]:
    """Return completeness of both."""
    from cpic_planner.planets import draw_population, load_population
    from simulator import lambert_phase, load_instrument, planet_contrast
    from simulator.imaging.zones import zone_of
    from simulator.target import sky_to_detector

    instrument = load_instrument()
    zone = zone_of(instrument, BAND)
    found = [
        Row(f"corner of the dark hole (arcsec), {name}", theirs, ours, 1e-4, "given to EXOSIMS with five digits")
        for name, theirs, ours in zip(
            ("inner", "outer"),
            recorded["corners"],
            (zone.inner_corner_arcsec, zone.outer_corner_arcsec),
            strict=True,
        )
    ]
    for phase, theirs in zip(PHASES_DEG, recorded["phase"], strict=True):
        found.append(
            Row(f"phase function at {phase:g} degrees", theirs, float(lambert_phase(phase)), 1e-9, "Lambert's")
        )
    angles = {"law": "uniform", "low": 0.0, "high": 360.0}
    for name, (_, most) in ORBITS.items():
        eccentricity = {"law": "uniform", "low": 0.0, "high": most} if most else 0.0
        config = load_population(
            {
                "kind": "population",
                "name": name,
                "radius_rjup": {"law": "log_uniform", "low": RADIUS_RJUP[0], "high": RADIUS_RJUP[1]},
                "semi_major_axis_au": {"law": "log_uniform", "low": AXIS_AU[0], "high": AXIS_AU[1]},
                "eccentricity": eccentricity,
                "inclination_deg": {"law": "isotropic"},
                **dict.fromkeys(("argument_of_pericentre_deg", "node_deg", "mean_anomaly_deg"), angles),
                "mass_mjup": 1.0,
                "albedo": "jupiter",
            }
        )
        planets = draw_population(config, OUR_DRAWS, SEED)
        east, north = planets.east_au, planets.north_au
        separation = np.hypot(east, north)
        seen = planet_contrast(planets.radius_rjup, east, north, planets.phase_deg, ALBEDO)
        x, y = sky_to_detector(separation, np.rad2deg(np.arctan2(east, north)), parity=instrument.detector.parity)
        for case in recorded[name]["cases"]:
            distance, contrast = case["distance_pc"], case["contrast"]
            low, high = (corner * distance for corner in recorded["corners"])
            bright = (separation >= low) & (separation <= high) & (seen >= contrast)
            ours = float(bright.mean())
            error = math.sqrt(ours * (1.0 - ours) * (1.0 / OUR_DRAWS + 1.0 / DRAWS))
            tolerance = STANDARD_ERRORS * error / ours
            where = f"{name} orbits, {distance:g} pc, above {contrast:g}"
            why = f"{STANDARD_ERRORS:g} standard errors of the draws of both"
            found.append(Row(f"its planets counted, {where}", case["counted"], ours, tolerance, why))
            found.append(
                Row(f"`BrownCompleteness`, {where}", case["brown"], ours, tolerance, WHY_BROWN, expected=False)
            )
            about = {"why": WHY_GARRETT, "expected": False} if most else {"why": why}
            found.append(Row(f"`GarrettCompleteness`, {where}", case["garrett"], ours, tolerance, **about))
            if most:
                for words, margin in (("in the squares", 0.0), ("aperture in the squares", None)):
                    part = instrument.aperture_radius_arcsec(BAND) if margin is None else margin
                    inside = bright & zone.contains(x / distance, y / distance, part)
                    why = "an annulus is no dark hole of four squares"
                    what = f"{words}, {where}"
                    found.append(Row(what, case["counted"], float(inside.mean()), tolerance, why, expected=False))
    return found
