"""The fixed scenes on which speed and accuracy are measured: one for each place where shortcuts can fail."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from catalogs.errors import InputError
from catalogs.strict_yaml import load_yaml
from simulator.config import Instrument, Scene, load_instrument, load_scene
from simulator.config.base import validate
from simulator.config.scene import Planet
from simulator.imaging.frame import SceneModel

PLANET = "planet"
_LIST = Path(__file__).resolve().parents[1] / "presets" / "tradeoff" / "scenes.yaml"
_ALBEDO, _RADIUS_AU = 0.5, 71492.0 / 149597870.7


@dataclass(frozen=True)
class FixedScene:
    """A scene with the frames that it is observed in.

    Attributes
    ----------
    name, title, why : str
        Short name, heading, and why it is in the list.
    band : str
    exposure_s, n_frames, em_gain
        Of the science visit; the reference visit has as many frames.
    tree : dict
        The scene, as `simulator.load_scene` reads it, or ``preset`` with what differs.
    scene_model : {"exact", "paper"}
        How the scene is asked to be made.
    detector : dict
        What differs from the default instrument's detector of the band.
    """

    name: str
    title: str
    why: str
    band: str
    exposure_s: float
    n_frames: int
    em_gain: float
    tree: Mapping[str, Any]
    scene_model: SceneModel = "exact"
    detector: Mapping[str, Any] = field(default_factory=dict)

    @functools.cached_property
    def scene(self) -> Scene:
        """Star, planet and whatever else there is."""
        tree = dict(self.tree)
        if "preset" not in tree:
            return load_scene(tree)
        shown = load_scene(tree["preset"])
        planets = tuple(validate(Planet, body, where="planet") for body in tree["planets"])
        star = shown.cstar.model_copy(update={"v_mag": tree["v_mag"]})
        return shown.model_copy(update={"planets": planets, "cstar": star})

    @functools.cached_property
    def instrument(self) -> Instrument:
        """The default instrument, its detector as configured here."""
        instrument = load_instrument()
        if not self.detector:
            return instrument
        own = dict(self.detector)
        visible = instrument.band(self.band).camera == "VIS"
        return instrument.changed({"detector": own} if visible else {"near_infrared": {"detector": own}})


def _read(name: str, entry: dict[str, Any]) -> FixedScene:
    """Return a scene of the list, its planet as a body that has the contrast it is given."""
    body = entry.pop("planet")
    planet = {
        "name": PLANET,
        "radius_rjup": 1.0,
        "phase_deg": 90.0,
        "albedo": _ALBEDO,
        "distance_au": _RADIUS_AU * math.sqrt(_ALBEDO / (math.pi * body.pop("contrast"))),
    }
    return FixedScene(name=name, **entry | {"tree": entry["tree"] | {"planets": [planet | body]}})


SCENES = {name: _read(name, entry) for name, entry in load_yaml(_LIST).items()}


def fixed_scene(name: str) -> FixedScene:
    """One of the scenes by name.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if name not in SCENES:
        raise InputError("--scene", name, allowed=", ".join(SCENES))
    return SCENES[name]
