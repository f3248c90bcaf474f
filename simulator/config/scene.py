"""The scene as configuration: a central star, its planets, other stars."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from catalogs.errors import InputError
from catalogs.strict_yaml import load_yaml
from simulator.config.base import FrozenModel, validate
from simulator.config.presets import preset_names, preset_path

__all__ = ["Planet", "Scene", "SceneStar", "load_scene"]


class SceneStar(FrozenModel):
    """A star: brightness and atmosphere; a position only when it is not the central one."""

    name: str
    v_mag: Annotated[float, Field(ge=-30, le=40)]
    teff_k: Annotated[float, Field(ge=1000, le=60000)]
    log_g: Annotated[float, Field(ge=-1, le=6)] = 4.5
    metallicity: Annotated[float, Field(ge=-5, le=2)] = 0.0
    separation_arcsec: Annotated[float, Field(ge=0, le=120)] = 0.0
    pa_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0


class Planet(FrozenModel):
    """A planet in reflected light; ``distance_au`` is the true distance from the star."""

    name: str
    radius_rjup: Annotated[float, Field(gt=0, le=10)]
    distance_au: Annotated[float, Field(gt=0, le=1e12)]
    phase_deg: Annotated[float, Field(ge=0, le=180)]
    separation_arcsec: Annotated[float, Field(ge=0, le=120)]
    pa_deg: Annotated[float, Field(ge=-360, le=360)]
    albedo: str = "jupiter"


class Scene(FrozenModel):
    """What the telescope points at.

    ``companions`` says whether ``stars`` that are bound companions are put on the image (``on``) or left out.
    """

    name: str
    cstar: SceneStar
    planets: tuple[Planet, ...] = ()
    stars: tuple[SceneStar, ...] = ()
    companions: Literal["on", "off"] = "on"

    def without_planets(self) -> Scene:
        """The same scene, star only: what the reference library sees."""
        return self.model_copy(update={"planets": ()})


def load_scene(source: str | Path | Mapping[str, Any]) -> Scene:
    """Load a scene from a YAML path, a preset name or a mapping.

    Raises
    ------
    InputError
        Naming key, value, unit and allowed range of the first fault.
    """
    if isinstance(source, Mapping):
        tree: Any = dict(source)
    else:
        known = preset_path("scene", str(source))
        if known is None and not Path(source).exists():
            raise InputError("scene", str(source), allowed="a YAML file or a preset",
                             hint=f"presets: {', '.join(preset_names('scene')) or 'none'}")  # fmt: skip
        tree = load_yaml(known or source)
    if isinstance(tree, dict) and "planet" in tree:
        if "planets" in tree:
            raise InputError("planet", "given with planets", allowed="one of the two")
        planet = tree.pop("planet")
        tree["planets"] = planet if isinstance(planet, list | tuple) else [planet]
    return validate(Scene, tree, where="scene")
