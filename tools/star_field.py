"""Fields full of stars: what the scene ``star_field`` that is shipped was made with."""

import math
from typing import Any

import numpy as np

from cpic_core import stream
from simulator.config import Scene, validate


def star_field(
    n_stars: int = 300,
    *,
    seed: int = 1,
    half_width_arcsec: float = 8.2,
    counts_per_mag: float = 0.3,
    centre: dict[str, Any] | None = None,
) -> Scene:
    """Scatter stars of V 13 to 20 and 4000 to 6500 K evenly over a square around a central star.

    Parameters
    ----------
    n_stars : int
        Stars besides the central one.
    seed : int
        Equal seeds give equal fields.
    half_width_arcsec : float
        Half the side of the square; the active pixels of the visible camera reach 8.27 arcsec.
    counts_per_mag : float
        Slope of log10 N(< V): 0.6 for stars spread evenly through space, about 0.3 for faint stars of the Milky Way.
    centre : dict, optional
        Keys of the central star; by default a star of 12 mag and 5800 K.

    Returns
    -------
    Scene
        Magnitudes to 0.001 mag, places to 0.1 mas, temperatures to 1 K.
    """
    name = "dense star field"
    rng = stream(seed, name, "star field")
    x, y = rng.uniform(-half_width_arcsec, half_width_arcsec, (2, n_stars))
    # N(< V) grows as 10^(slope V): the inverse of its cumulative distribution between the limits.
    low, high = (10.0 ** (counts_per_mag * limit) for limit in (13.0, 20.0))
    v_mag = np.log10(low + (high - low) * rng.random(n_stars)) / counts_per_mag
    warmth = rng.uniform(4000.0, 6500.0, n_stars)
    stars = [
        {
            "name": f"star {number}",
            "v_mag": round(float(v_mag[i]), 3),
            "teff_k": float(round(warmth[i])),
            "separation_arcsec": round(math.hypot(x[i], y[i]), 4),
            "pa_deg": round(math.degrees(math.atan2(x[i], y[i])) % 360.0, 4),
        }
        for number, i in enumerate(np.argsort(v_mag, kind="stable").tolist(), start=1)
    ]
    middle = centre or {"v_mag": 12.0, "teff_k": 5800.0}
    return validate(Scene, {"name": name, "cstar": middle, "stars": stars}, where="scene")
