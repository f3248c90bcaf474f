"""Solar panels: which roll of the telescope keeps them in the Sun.

The normal of the panels, when they are not turned, stands across the boresight; the panels turn about the axis across
both. With the Sun at the angle ``theta`` from the boresight and the telescope rolled by ``psi`` from where that normal
lies in the plane of boresight and Sun, the Sun stands ``sin(theta) sin(psi)`` along the axis, which no turning mends,
and ``90 deg - theta`` away from the normal at ``psi = 0``, which turning does mend as far as it goes. So

- panels that turn freely allow ``sin(theta) |sin(psi)| <= sin(panel_deg)``, at any angle from the Sun;
- fixed panels allow ``sin(theta) cos(psi) >= cos(panel_deg)``, which is possible within ``panel_deg`` of 90 deg;
- panels that turn by at most ``turn`` follow the first rule until they stand at their limit, and then
  ``cos(turn) sin(theta) cos(psi) + sin(turn) |cos(theta)| >= cos(panel_deg)``.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cpic_planner.survey.visibility.config import VisibilityConfig

__all__ = ["roll_half_range_deg"]

FloatArray = NDArray[np.float64]

_TINY = 1e-300


def roll_half_range_deg(sun_deg: FloatArray, config: VisibilityConfig) -> FloatArray:
    """How far the telescope may roll either way from the best roll.

    Parameters
    ----------
    sun_deg : ndarray
        Angle between boresight and Sun.
    config : VisibilityConfig

    Returns
    -------
    ndarray
        At most ``roll_deg``; nan where no roll keeps the panels in the Sun.

    Examples
    --------
    >>> import numpy as np
    >>> from cpic_planner.survey.visibility import load_visibility
    >>> free = load_visibility({"panel_turn_deg": 90, "roll_deg": 90})
    >>> roll_half_range_deg(np.array([90.0, 30.0, 150.0, 180.0]), free).round(1)
    array([25. , 57.7, 57.7, 90. ])
    """
    limit, turn = math.radians(config.panel_deg), math.radians(config.turn_deg)
    tilt = np.abs(np.deg2rad(sun_deg) - math.pi / 2)
    cosine, sine = np.cos(tilt), np.sin(tilt)
    along_axis = np.arcsin(np.minimum(1.0, math.sin(limit) / np.maximum(cosine, _TINY)))
    # The roll at which the panels come to the limit of their turn, and what is allowed beyond.
    reached = np.arccos(np.minimum(1.0, sine * math.cos(turn) / np.maximum(cosine * math.sin(turn), _TINY)))
    at_limit = (math.cos(limit) - math.sin(turn) * sine) / np.maximum(math.cos(turn) * cosine, _TINY)
    beyond = np.arccos(np.clip(at_limit, 0.0, 1.0))
    half = np.where(along_axis <= reached, along_axis, np.maximum(reached, beyond))
    # A target exactly at the end of the range counts as seen.
    possible = tilt <= turn + limit + 1e-12
    return np.where(possible, np.minimum(np.rad2deg(half), config.roll_deg), np.nan)
