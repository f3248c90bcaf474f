"""What limits where the telescope points, as configuration: model, preset and loader."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import PrivateAttr

from catalogs.errors import InputError
from catalogs.strict_yaml import Provenance, split_sourced
from cpic_planner.models.visible import PointingRecord
from simulator.config.base import validate
from simulator.config.keys import at, canonical_keys
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


class VisibilityConfig(PointingRecord):
    """Limits of pointing, and what a slew costs, as configuration; its fields are those of the result's record."""

    description: str = ""

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
