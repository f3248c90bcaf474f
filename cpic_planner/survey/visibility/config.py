"""What limits where the telescope points, as configuration: model, preset and loader."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PrivateAttr

from catalogs.errors import InputError
from catalogs.strict_yaml import Provenance, split_sourced
from simulator.config.base import FrozenModel, validate
from simulator.config.keys import at, canonical_keys
from simulator.config.light import Real
from simulator.config.presets import preset_names, tree_over_preset

__all__ = ["DEFAULT_VISIBILITY", "VisibilityConfig", "VisibilitySource", "load_visibility", "visibility_names"]

DEFAULT_VISIBILITY = "default"
PACKAGE = "cpic_planner"

_ALIASES = {
    "sun": "sun_deg",
    "moon": "moon_deg",
    "dark_limb": "dark_limb_deg",
    "bright_limb": "bright_limb_deg",
    "roll": "roll_deg",
    "saa": "saa_fraction",
    "settle": "settle_s",
}

Avoidance = Annotated[Real, Field(ge=0, le=180)]


class VisibilityConfig(FrozenModel):
    """Limits of pointing, and what a slew costs.

    Attributes
    ----------
    sun_deg, moon_deg : float
        Least angle between the target and the centre of the body.
    dark_limb_deg, bright_limb_deg : float
        Least angle between the target and the limb of the solid Earth, where the nearest point of the limb is dark or
        sunlit.
    panel : {"one_axis", "fixed"}
        Whether the solar panels turn about the axis across the boresight and their normal, see
        `cpic_planner.survey.visibility.panel`.
    panel_deg : float
        Largest angle between the normal of the panels and the Sun; 90 with panels that turn by 90: no limit.
    panel_turn_deg : float
        Panels of ``one_axis`` turn by at most this either way from across the boresight.
    roll_deg : float
        Freedom of roll either side of the best one, whatever the panels allow.
    saa_fraction : float
        Share of all time lost to the South Atlantic Anomaly: one number, no map.
    slew_deg_s, settle_s : float
        Rate of a slew, and what follows each.
    thermal_settle_orbits : float
        Orbits until the dark hole has settled after a slew.
    """

    name: str = ""
    description: str = ""
    sun_deg: Avoidance
    moon_deg: Avoidance
    dark_limb_deg: Avoidance
    bright_limb_deg: Avoidance
    panel: Literal["one_axis", "fixed"]
    panel_deg: Annotated[Real, Field(ge=0, le=90)]
    panel_turn_deg: Annotated[Real, Field(ge=0, le=90)]
    roll_deg: Annotated[Real, Field(ge=0, le=90)]
    saa_fraction: Annotated[Real, Field(ge=0, lt=1)]
    slew_deg_s: Annotated[Real, Field(gt=0, le=100)]
    settle_s: Annotated[Real, Field(ge=0, le=1e5)]
    thermal_settle_orbits: Annotated[Real, Field(ge=0, le=1000)]

    _provenance: dict[str, Provenance] = PrivateAttr(default_factory=dict)

    @property
    def provenance(self) -> dict[str, Provenance]:
        """Source and confidence of each sourced value, by key."""
        return dict(self._provenance)

    @property
    def turn_deg(self) -> float:
        """How far the panels turn, 0 where they are fixed."""
        return self.panel_turn_deg if self.panel == "one_axis" else 0.0

    def content(self) -> dict[str, Any]:
        """Everything that decides where the telescope points and what a slew costs, for content hashes."""
        return self.model_dump(mode="json", exclude={"name", "description"})


VisibilitySource = VisibilityConfig | Mapping[str, Any] | str | Path | None


def visibility_names() -> tuple[str, ...]:
    """Names of the limits of pointing that ship with the package."""
    return preset_names("visibility", package=PACKAGE)


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
    values, provenance = split_sourced(_tree(source))
    config = validate(VisibilityConfig, values, where="visibility")
    config._provenance.update(provenance)
    return config


def _tree(source: Any) -> dict[str, Any]:
    own, _, base = tree_over_preset(
        "visibility", source, default=DEFAULT_VISIBILITY, keys=VisibilityConfig.model_fields, package=PACKAGE
    )
    if base is None:
        return own
    try:
        own = canonical_keys(own, VisibilityConfig.model_fields, _ALIASES)
    except InputError as error:
        raise at("visibility", error) from None
    return {**_tree(base), "name": f"{base}+changes" if own else base, "description": ""} | own
