"""Random scenes for the effect ledger: everything that a user may ask for, drawn from a seed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from simulator.config import Instrument, Scene, load_instrument, load_scene
from simulator.knobs import Quantity

TYPES = ("F0V", "F5V", "G2V", "K1V", "K7V", "M0V")
BANDS = ("F520", "F662", "F720", "F850")
QUANTITIES: tuple[tuple[Quantity, ...], ...] = (
    ("planet_flux",),
    ("snr",),
    ("planet_flux", "snr"),
    ("pixel_map",),
    ("planet_flux", "snr", "pixel_map"),
)


@dataclass(frozen=True)
class RandomCase:
    """One scene, its instrument and sequence, and what is asked of it."""

    number: int
    scene: Scene
    instrument: Instrument
    settings: dict[str, Any]
    tolerance: float
    quantity: tuple[Quantity, ...]


def random_case(number: int, *, seed: int = 1) -> RandomCase:
    """Case of that number: star V -1.5 to 12, up to three planets, companions and field stars, any settings."""
    rng = np.random.default_rng([seed, number])
    star = {"name": "star", "v_mag": float(rng.uniform(-1.5, 12.0)), "spectral_type": str(rng.choice(TYPES))}
    planets = [_planet(rng, index) for index in range(int(rng.integers(0, 4)))]
    stars = [_star(rng, index, star["v_mag"]) for index in range(int(rng.choice([0, 0, 1, 1, 2, 5])))]
    drift = float(rng.choice([0.0, 1.0]) * 10 ** rng.uniform(-2.3, -0.3))
    walk = float(rng.choice([0.0, 1.0]) * 10 ** rng.uniform(-2.3, -0.3))
    sky: dict[str, Any] = {"model": "uniform", "brightness_v_mag_arcsec2": float(rng.uniform(18.0, 24.0))}
    if rng.random() < 0.3:
        sky = {"model": "zodiacal"}
        star |= {"ra_deg": float(rng.uniform(0, 360)), "dec_deg": float(rng.uniform(-80, 80))}
    instrument = load_instrument({"drift": {"visit_nm": drift, "walk_nm_per_sqrt_hour": walk}, "sky": sky})
    scene = load_scene({"name": f"case {number}", "cstar": star, "planets": planets, "stars": stars})
    settings = {
        "band": str(rng.choice(BANDS)),
        "exposure_s": float(10 ** rng.uniform(-2, 3)),
        "em_gain": float(10 ** rng.uniform(0, 3)),
        "n_frames": int(10 ** rng.uniform(0, 3)),
    }
    possible = QUANTITIES if planets else (("pixel_map",),)
    asked = possible[int(rng.integers(len(possible)))]
    return RandomCase(number, scene, instrument, settings, float(10 ** rng.uniform(-2.52, -0.52)), asked)


def _planet(rng: np.random.Generator, index: int) -> dict[str, Any]:
    """Of contrast 1e-10 to 1e-5, anywhere in the dark hole or near it."""
    place = rng.uniform(0.12, 0.78, 2) * rng.choice([-1.0, 1.0], 2)
    x, y = float(place[0]), float(place[1])
    # On the detector x = -separation sin(PA), y = separation cos(PA).
    contrast = 10 ** rng.uniform(-10, -5)
    # Of Jupiter's size and albedo at a phase of 60 deg: about 0.3 (R / r)^2.
    return {
        "name": f"planet {index}",
        "radius_rjup": 1.0,
        "phase_deg": 60.0,
        "distance_au": float(4.78e-4 * np.sqrt(0.3 / contrast)),
        "separation_arcsec": float(np.hypot(x, y)),
        "pa_deg": float(np.degrees(np.arctan2(-x, y)) % 360.0),
    }


def _star(rng: np.random.Generator, index: int, v_mag: float) -> dict[str, Any]:
    return {
        "name": f"star {index}",
        "v_mag": float(v_mag + rng.uniform(-1.0, 12.0)),
        "spectral_type": str(rng.choice(TYPES)),
        "separation_arcsec": float(10 ** rng.uniform(-0.3, 1.5)),
        "pa_deg": float(rng.uniform(0, 360)),
        "companion": bool(rng.random() < 0.5),
    }
