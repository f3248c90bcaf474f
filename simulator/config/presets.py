"""Presets that ship with the package, by kind and name."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

__all__ = ["preset_names", "preset_path"]


def _folder(kind: str) -> Path:
    return Path(str(resources.files("simulator") / "presets" / kind))


def preset_names(kind: str) -> tuple[str, ...]:
    """Names of the presets of one kind (``instrument``, ``scene``, ``plan``)."""
    return tuple(sorted(path.stem for path in _folder(kind).glob("*.yaml")))


def preset_path(kind: str, name: str) -> Path | None:
    """Path of a preset, ``None`` if there is none of that name."""
    return _folder(kind) / f"{name}.yaml" if name in preset_names(kind) else None
