"""Configuration: strict models, presets and their loaders."""

from simulator.config.base import FrozenModel, canonical_json, content_hash
from simulator.config.instrument import Instrument, load_instrument
from simulator.config.scene import Planet, Scene, SceneStar, load_scene
from simulator.config.scene_table import scenes_from_table

__all__ = [
    "FrozenModel",
    "Instrument",
    "Planet",
    "Scene",
    "SceneStar",
    "canonical_json",
    "content_hash",
    "load_instrument",
    "load_scene",
    "scenes_from_table",
]
