"""Configuration: strict models, presets and their loaders. Names load on first use."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from simulator.config.base import FrozenModel, canonical_json, content_hash
    from simulator.config.instrument import Instrument, load_instrument
    from simulator.config.scene import Planet, Scene, SceneStar, load_scene
    from simulator.config.scene_table import scenes_from_table

_HOME = {
    "FrozenModel": "base",
    "canonical_json": "base",
    "content_hash": "base",
    "Instrument": "instrument",
    "load_instrument": "instrument",
    "Planet": "scene",
    "Scene": "scene",
    "SceneStar": "scene",
    "load_scene": "scene",
    "scenes_from_table": "scene_table",
}

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


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
