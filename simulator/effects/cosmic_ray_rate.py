"""How many cosmic rays: the rate over the solar cycle."""

from __future__ import annotations

import math

from simulator.config.effects import CosmicRayConfig
from simulator.effects.dates import decimal_year


def cosmic_ray_rate(config: CosmicRayConfig, when: str | float) -> float:
    """Rate of cosmic rays through the detector outside the South Atlantic Anomaly, where nothing is observed.

    Parameters
    ----------
    config : CosmicRayConfig
        Rate at solar minimum, depth and time of the cycle, factor of the orbit.
    when : str or float
        ISO date or decimal year, 1972 to 2100.

    Returns
    -------
    float
        Particles per second and cm2: ``peak x orbit x [1 - m (1 - cos(2 pi (t - t_min) / T)) / 2]``, highest at solar
        minimum, when the Sun's field keeps fewest out.

    Raises
    ------
    InputError
        If the date cannot be read or is out of range.

    Examples
    --------
    >>> from simulator import load_instrument
    >>> from simulator.effects import cosmic_ray_rate
    >>> round(cosmic_ray_rate(load_instrument().cosmic_rays, "2028-01-01"), 3)
    0.832
    """
    phase = 2.0 * math.pi * (decimal_year("when", when) - config.cycle_minimum_year) / config.cycle_years
    return config.peak_rate_per_s_cm2 * config.orbit_factor * (1.0 - 0.5 * config.cycle_depth * (1.0 - math.cos(phase)))
