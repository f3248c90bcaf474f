"""The limits of pointing as configuration, and the roll that keeps the solar panels in the Sun.

The normal of the panels, when they are not turned, stands across the boresight; the panels turn about the axis across
both. With the Sun at the angle ``theta`` from the boresight and the telescope rolled by ``psi`` from where that normal
lies in the plane of boresight and Sun, the Sun stands ``sin(theta) sin(psi)`` along the axis, which no turning mends,
and ``90 deg - theta`` away from the normal at ``psi = 0``, which turning does mend as far as it goes. So

- panels that turn freely allow ``sin(theta) |sin(psi)| <= sin(panel_deg)``, at any angle from the Sun;
- fixed panels allow ``sin(theta) cos(psi) >= cos(panel_deg)``, which is possible within ``panel_deg`` of 90 deg;
- panels that turn by at most ``turn`` follow the first rule until they stand at their limit, and then
  ``cos(turn) sin(theta) cos(psi) + sin(turn) |cos(theta)| >= cos(panel_deg)``.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import FloatArray, InputError, by_line
from cpic_planner.results import PointingRecord
from simulator.config import Sourced, at, canonical_keys, load_instrument, tree_over_preset

_TINY = 1e-300


def roll_half_range_deg(sun_deg: FloatArray, config: "VisibilityConfig") -> FloatArray:
    """Return how far the telescope may roll either way from the best roll.

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


DEFAULT_VISIBILITY = "default"
PACKAGE = "cpic_planner"

_WITH_UNIT = ("sun_deg", "moon_deg", "dark_limb_deg", "bright_limb_deg", "roll_deg", "saa_fraction", "settle_s")
_ALIASES = {key.rpartition("_")[0]: key for key in _WITH_UNIT}


class VisibilityConfig(PointingRecord, Sourced):
    """Limits of pointing, and what a slew costs, as configuration; its fields are those of the result's record."""

    description: str = ""

    @property
    def turn_deg(self) -> float:
        """How far the panels turn, 0 where they are fixed."""
        return self.panel_turn_deg if self.panel == "one_axis" else 0.0

    def content(self) -> dict[str, Any]:
        """Return everything that decides where the telescope points and what a slew costs, for content hashes."""
        return self.model_dump(mode="json", exclude={"name", "description"})


VisibilitySource = VisibilityConfig | Mapping[str, Any] | str | Path | None


@by_line
def load_visibility(source: VisibilitySource = None) -> VisibilityConfig:
    """Load limits of pointing.

    Parameters
    ----------
    source : VisibilityConfig, mapping, str, Path or None
        Preset name, YAML path or mapping; ``None`` is the preset ``default``. A file or mapping needs to hold only what
        differs from its ``base`` (a preset name, ``default`` if absent).

    Returns
    -------
    VisibilityConfig

    Raises
    ------
    InputError
        Naming key, value, unit and allowed range of the first fault.

    Examples
    --------
    >>> from cpic_planner.survey.visibility import load_visibility
    >>> load_visibility({"moon_deg": 40}).moon_deg
    40.0
    """
    if isinstance(source, VisibilityConfig):
        return source
    return VisibilityConfig.read(_tree(source), "visibility")


def _tree(source: Any) -> dict[str, Any]:
    own, _, base = tree_over_preset(
        "visibility", source, default=DEFAULT_VISIBILITY, keys=VisibilityConfig.model_fields, package=PACKAGE
    )
    if base is None:
        return {"sun_deg": _sun_limit()} | own
    try:
        own = canonical_keys(own, VisibilityConfig.model_fields, _ALIASES)
    except InputError as error:
        raise at("visibility", error) from None
    return {**_tree(base), "name": f"{base}+changes" if own else base, "description": ""} | own


def _sun_limit() -> dict[str, Any]:
    """Return the Sun's limit of the default instrument, whose sky needs it too, with its source."""
    instrument = load_instrument()
    origin = instrument.provenance["sky.sun_limit_deg"]
    return {
        "value": instrument.sky.sun_limit_deg,
        **{key: getattr(origin, key) for key in ("unit", "source", "confidence")},
    }
