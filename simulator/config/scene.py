"""A scene as configuration: the central star, its planets, other stars, discs and images, and where they stand."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field

from catalogs import position_angle, separation_arcsec, tangent_offset
from cpic_core import InputError, by_line, is_file, load_mapping
from simulator.config.base import SpelledModel, inside, other_names, required, validate
from simulator.config.bodies import MAX_SEPARATION_ARCSEC, Body, Planet, SceneStar
from simulator.config.light import ALBEDO_MODELS, PLANET_MODELS, STAR_MODELS
from simulator.config.presets import preset_or_file
from simulator.config.sky import DiscSource, ExtendedValue, ImageSource, RingSource

DISTANCE_TOLERANCE = 0.01
"""Largest difference between a given projected and a given true distance, relative to the true one: people round."""


class Place(NamedTuple):
    """Offset from the central star on the sky."""

    separation_arcsec: float
    pa_deg: float


def place(host: SceneStar, body: Body) -> Place:
    """Return the offset of a body from the central star, exact on the sphere.

    Parameters
    ----------
    host : SceneStar
        The central star; its coordinates are needed where the body is given by coordinates, at the same epoch.
    body : Body
        A star or planet.

    Raises
    ------
    InputError
        If no place is given, the coordinates of the host are missing, or the body is farther than 120 arcsec.
    """
    if body.separation_arcsec is not None and body.pa_deg is not None:
        return Place(body.separation_arcsec, body.pa_deg)
    if body.ra_deg is None or body.dec_deg is None:
        raise required("separation_arcsec", "separation_arcsec and pa_deg, or ra_deg and dec_deg")
    if host.ra_deg is None or host.dec_deg is None:
        raise InputError("ra_deg", body.ra_deg, unit="deg", allowed="coordinates where cstar has them too")
    sky = (body.ra_deg, body.dec_deg, host.ra_deg, host.dec_deg)
    separation = float(separation_arcsec(*sky))
    if separation > MAX_SEPARATION_ARCSEC:
        allowed = f"at most {MAX_SEPARATION_ARCSEC:g} arcsec, at the same epoch"
        raise InputError("ra_deg, dec_deg", f"{separation:.6g} arcsec from cstar", allowed=allowed)
    return Place(separation, float(position_angle(*tangent_offset(*sky))))


def true_distance_au(planet: Planet, separation: float, distance_pc: float | None) -> float | None:
    """Return the true distance of a planet from its star, au.

    The given one, or ``r = rho / sin(phase)`` with the projected distance ``rho = separation x distance_pc``
    (1 arcsec at 1 pc is 1 au). A given distance must agree with the projected one where both are known.

    Parameters
    ----------
    planet : Planet
    separation : float
        Projected separation, arcsec.
    distance_pc : float or None
        Distance of the star.

    Returns
    -------
    float or None
        None for a planet with light of its own whose distance is not known: nothing depends on it.

    Raises
    ------
    InputError
        If the distance does not follow from what is given, or contradicts it.
    """
    rho = None if distance_pc is None else separation * distance_pc
    phase, given = planet.phase_deg, planet.distance_au
    # Exactly 0 at 180 degrees too.
    sine = None if phase is None else math.sin(math.radians(min(phase, 180.0 - phase)))
    if given is not None:
        if rho is not None:
            _agree(given, rho, phase, sine)
        return given
    if rho and sine:
        return rho / sine
    if not planet.reflects:
        return None
    if rho is None:
        raise required("distance_au", "the true distance from the star, or cstar.distance_pc")
    if rho == 0.0:
        raise required("distance_au", "the true distance where the separation is 0")
    raise required("distance_au", f"the true distance where phase_deg is {phase:g}")


def _agree(given: float, rho: float, phase: float | None, sine: float | None) -> None:
    slack = DISTANCE_TOLERANCE * given
    if rho > given + slack:
        allowed = f"at least the projected distance {rho:.6g} au = separation x cstar.distance_pc"
        raise InputError("distance_au", given, unit="au", allowed=allowed)
    if sine is not None and abs(given * sine - rho) > slack:
        allowed = f"{rho / sine:.6g} au, or none" if sine else "none"
        hint = f"distance_au x sin(phase_deg = {phase:g}) is {given * sine:.6g} au"
        hint += f", separation x cstar.distance_pc is {rho:.6g} au"
        raise InputError("distance_au", given, unit="au", allowed=allowed, hint=hint)


_HINTS = {"host": "did you mean cstar?"}
_FILE_KEYS = ("file", "spectrum", "model", "albedo")
_MODELS = (*STAR_MODELS, *PLANET_MODELS, *ALBEDO_MODELS)


class Scene(SpelledModel):
    """A scene: the bodies and the sky that the telescope points at.

    Objects without a name get one: the scene's for the central star, ``planet 1``, ``star 1``, ``extended 1`` and so on
    for the others. ``companions`` says whether the ``stars`` are put on the image (``on``) or left out (``off``); those
    with ``companion: false`` always are. ``extended`` is scattered light that is no point: discs, rings, images.
    """

    ALIASES = other_names(planets="planet", stars="star", extended="disc disk discs disks exozodi extended_sources")
    HINTS = _HINTS
    name: Annotated[str, Field(min_length=1)]
    cstar: SceneStar
    planets: tuple[Planet, ...] = ()
    stars: tuple[SceneStar, ...] = ()
    companions: Literal["on", "off"] = "on"
    extended: tuple[ExtendedValue, ...] = ()

    @classmethod
    def _read(cls, tree: dict[str, Any]) -> dict[str, Any]:
        result = dict(tree)
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

    def _check_values(self) -> None:
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
            with inside(path):
                where = place(self.cstar, body)
                if isinstance(body, Planet):
                    true_distance_au(body, where.separation_arcsec, self.cstar.distance_pc)
        for number, source in enumerate(self.extended):
            if source.name in seen:
                allowed = f"a name of its own, not that of {seen[source.name]}"
                raise InputError(f"extended.{number}.name", source.name, allowed=allowed)
            seen[source.name] = f"extended.{number}"
            if source.contrast_to(self.cstar.v_mag) > 1:
                allowed = f"at least that of cstar, {self.cstar.v_mag:g}"
                raise InputError(f"extended.{number}.v_mag", source.v_mag, unit="mag", allowed=allowed)

    def is_lit(self, star: SceneStar) -> bool:
        """Return whether one of its stars is put on the image."""
        return self.companions == "on" or not star.companion

    def without_planets(self) -> "Scene":
        """Return the same scene, star only: what the reference library sees."""
        return self.model_copy(update={"planets": ()})


SCENE_KEYS = (*Scene.model_fields, *Scene.ALIASES, *Scene.HINTS)
"""Keys of a file of a scene, as people write them."""


@by_line
def load_scene(source: Scene | str | Path | Mapping[str, Any]) -> Scene:
    """Load a scene from a YAML path, a preset name or a mapping.

    Parameters
    ----------
    source : Scene, str, Path or mapping
        Keys ``name``, ``cstar``, ``stars`` and ``planet`` or ``planets`` (one or a list), as in Zhu et al. 2025, and
        ``extended`` (or ``disc``, ``exozodi``); see `Scene`, `SceneStar`, `Planet` and `simulator.config.sky` for
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
    """Return the paths of spectra and albedos that exist beside the scene's file, made whole.

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
        if key in _FILE_KEYS and isinstance(item, str) and item not in _MODELS and is_file(folder / item)
        else paths_beside(item, folder)
        for key, item in tree.items()
    }
