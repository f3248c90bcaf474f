"""The scene as configuration: a central star, its planets, other stars, discs and images."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from catalogs.errors import InputError
from catalogs.strict_yaml import load_mapping
from simulator.config.albedo import ALBEDO_MODELS
from simulator.config.base import FrozenModel, validate
from simulator.config.bodies import Planet, SceneStar
from simulator.config.extended import DiscSource, ExtendedValue, ImageSource, RingSource
from simulator.config.geometry import place, true_distance_au
from simulator.config.keys import at, canonical_keys
from simulator.config.light import PLANET_MODELS, STAR_MODELS
from simulator.config.presets import preset_or_file

__all__ = ["SCENE_KEYS", "Planet", "Scene", "SceneStar", "load_scene", "paths_beside"]

_ALIASES = {
    "planet": "planets",
    "star": "stars",
    "disc": "extended",
    "disk": "extended",
    "discs": "extended",
    "disks": "extended",
    "exozodi": "extended",
    "extended_sources": "extended",
}
_HINTS = {"host": "did you mean cstar?"}
_FILE_KEYS = ("file", "spectrum", "model", "albedo")
_MODELS = (*STAR_MODELS, *PLANET_MODELS, *ALBEDO_MODELS)


class Scene(FrozenModel):
    """What the telescope points at.

    Objects without a name get one: the scene's for the central star, ``planet 1``, ``star 1``, ``extended 1`` and so on
    for the others. ``companions`` says whether the ``stars`` are put on the image (``on``) or left out (``off``); those
    with ``companion: false`` always are. ``extended`` is scattered light that is no point: discs, rings, images.
    """

    name: Annotated[str, Field(min_length=1)]
    cstar: SceneStar
    planets: tuple[Planet, ...] = ()
    stars: tuple[SceneStar, ...] = ()
    companions: Literal["on", "off"] = "on"
    extended: tuple[ExtendedValue, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _spelled(cls, tree: Any) -> Any:
        if not isinstance(tree, Mapping):
            return tree
        result = canonical_keys(tree, cls.model_fields, _ALIASES, hints=_HINTS)
        result["cstar"] = _named(result["cstar"], result.get("name")) if "cstar" in result else None
        if result["cstar"] is None:
            raise InputError("cstar", "missing", allowed="a mapping: the central star")
        for key, word in (("planets", "planet"), ("stars", "star"), ("extended", "extended")):
            given = result.get(key)
            nothing = given is None or (isinstance(given, Mapping) and not given)
            listed = () if nothing else given if isinstance(given, list | tuple) else (given,)
            result[key] = tuple(_named(body, f"{word} {n}") for n, body in enumerate(listed, start=1))
        for number, source in enumerate(result["extended"]):
            if not isinstance(source, Mapping | DiscSource | RingSource | ImageSource):
                raise InputError(f"extended.{number}", source, allowed="a mapping: a disc, ring or image")
        return result

    @model_validator(mode="after")
    def _consistent(self) -> Scene:
        for key in ("separation_arcsec", "pa_deg"):
            if getattr(self.cstar, key):
                raise InputError(f"cstar.{key}", getattr(self.cstar, key), allowed="no such key: it is the origin")
        if not self.cstar.companion:
            raise InputError("cstar.companion", False, allowed="no such key: the others are its companions")
        seen = {self.cstar.name: "cstar"}
        bodies = [(f"planets.{n}", body) for n, body in enumerate(self.planets)]
        for path, body in [*bodies, *((f"stars.{n}", body) for n, body in enumerate(self.stars))]:
            if body.name in seen:
                raise InputError(f"{path}.name", body.name, allowed=f"a name of its own, not that of {seen[body.name]}")
            seen[body.name] = path
            try:
                where = place(self.cstar, body)
                if isinstance(body, Planet):
                    true_distance_au(body, where.separation_arcsec, self.cstar.distance_pc)
            except InputError as error:
                raise at(path, error) from None
        for number, source in enumerate(self.extended):
            if source.name in seen:
                raise InputError(
                    f"extended.{number}.name",
                    source.name,
                    allowed=f"a name of its own, not that of {seen[source.name]}",
                )
            seen[source.name] = f"extended.{number}"
            if source.contrast_to(self.cstar.v_mag) > 1:
                raise InputError(
                    f"extended.{number}.v_mag",
                    source.v_mag,
                    unit="mag",
                    allowed=f"at least that of cstar, {self.cstar.v_mag:g}",
                )
        return self

    def is_lit(self, star: SceneStar) -> bool:
        """Whether one of its stars is put on the image."""
        return self.companions == "on" or not star.companion

    def without_planets(self) -> Scene:
        """The same scene, star only: what the reference library sees."""
        return self.model_copy(update={"planets": ()})


SCENE_KEYS = (*Scene.model_fields, *_ALIASES, *_HINTS)
"""Keys of a file of a scene, as people write them."""


def load_scene(source: Scene | str | Path | Mapping[str, Any]) -> Scene:
    """Load a scene from a YAML path, a preset name or a mapping.

    Parameters
    ----------
    source : Scene, str, Path or mapping
        Keys ``name``, ``cstar``, ``stars`` and ``planet`` or ``planets`` (one or a list), as in Zhu et al. 2025, and
        ``extended`` (or ``disc``, ``exozodi``); see `Scene`, `SceneStar`, `Planet` and `simulator.config.extended` for
        those of each object. Files named in a YAML file are looked for beside it first.

    Returns
    -------
    Scene

    Raises
    ------
    InputError
        Naming key, value, unit and allowed range of the first fault.

    Examples
    --------
    >>> from simulator import load_scene
    >>> scene = load_scene({
    ...     "name": "alpha Cen B",
    ...     "cstar": {"magnitude": 1.35, "spectral_type": "K1V", "distance": 1.35},
    ...     "planet": {"radius": 1, "phase_angle": 90, "separation": 0.65, "position_angle": 315, "albedo": "jupiter"},
    ... })
    >>> scene.planets[0].separation_arcsec
    0.65
    """
    if isinstance(source, Scene):
        return source
    if isinstance(source, Mapping):
        tree: Any = dict(source)
    elif isinstance(source, str | Path):
        path = preset_or_file("scene", source)
        tree = paths_beside(load_mapping(path, "scene", SCENE_KEYS), path.parent)
    else:
        raise InputError("scene", source, allowed="a mapping, a YAML file or a preset")
    kind = tree.pop("kind", "scene") if isinstance(tree, dict) else "scene"
    if not isinstance(kind, str) or kind != "scene":
        raise InputError("scene.kind", kind, allowed="scene")
    return validate(Scene, tree, where="scene")


def _named(body: Any, name: Any) -> Any:
    """Give a body without a name the given one."""
    if isinstance(body, Mapping):
        return {**body, "name": name} if body.get("name") in (None, "") else body
    if isinstance(body, SceneStar | Planet | DiscSource | RingSource | ImageSource) and not body.name:
        return body.model_copy(update={"name": name})
    return body


def paths_beside(tree: Any, folder: Path) -> Any:
    """Paths of spectra and albedos that exist beside the scene's file, made whole.

    Parameters
    ----------
    tree : object
        Plain data of a configuration.
    folder : Path
    """
    if isinstance(tree, list):
        return [paths_beside(item, folder) for item in tree]
    if not isinstance(tree, dict):
        return tree
    return {
        key: str(folder / item)
        if key in _FILE_KEYS and isinstance(item, str) and item not in _MODELS and (folder / item).is_file()
        else paths_beside(item, folder)
        for key, item in tree.items()
    }
