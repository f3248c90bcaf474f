"""Presets that ship with the package, by kind and name."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from catalogs.errors import InputError
from simulator.config.keys import nearest

__all__ = ["preset_names", "preset_or_file", "preset_path"]


def _folder(kind: str, package: str) -> Path:
    return Path(str(resources.files(package) / "presets" / kind))


def preset_names(kind: str, *, package: str = "simulator") -> tuple[str, ...]:
    """Names of the presets of one kind (``instrument``, ``scene``, ``plan``) that ship with a package."""
    return tuple(sorted(path.stem for path in _folder(kind, package).glob("*.yaml")))


def preset_path(kind: str, name: str, *, package: str = "simulator") -> Path | None:
    """Path of a preset, ``None`` if there is none of that name."""
    return _folder(kind, package) / f"{name}.yaml" if name in preset_names(kind, package=package) else None


def preset_or_file(kind: str, source: str | Path, *, package: str = "simulator") -> Path:
    """Path of a preset, or of a file that exists.

    Raises
    ------
    InputError
        If ``source`` is neither; with the nearest presets.
    """
    path = preset_path(kind, str(source), package=package) or Path(source)
    if not path.is_file():
        names = preset_names(kind, package=package)
        raise InputError(kind, str(source), allowed="a YAML file or a preset",
                         hint=nearest(source, names) or f"presets: {', '.join(names) or 'none'}")  # fmt: skip
    return path
