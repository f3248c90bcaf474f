"""Presets that ship with the package, by kind and name."""

from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from cpic_core import InputError, is_file, load_mapping
from simulator.config.base import nearest


def _folder(kind: str, package: str) -> Path:
    return Path(str(resources.files(package) / "presets" / kind))


def preset_names(kind: str, *, package: str = "simulator") -> tuple[str, ...]:
    """Return the names of the presets of one kind (``instrument``, ``scene``, ``plan``) that ship with a package.

    Parameters
    ----------
    kind : str
        Kind of the preset or of the record.
    package : str, optional
        Package that ships the presets.
    """
    return tuple(sorted(path.stem for path in _folder(kind, package).glob("*.yaml")))


def preset_path(kind: str, name: str, *, package: str = "simulator") -> Path | None:
    """Return the path of a preset, ``None`` if there is none of that name.

    Parameters
    ----------
    kind : str
        Kind of the preset or of the record.
    name : str
        Name of the preset.
    package : str, optional
        Package that ships the presets.
    """
    return _folder(kind, package) / f"{name}.yaml" if name in preset_names(kind, package=package) else None


def preset_or_file(kind: str, source: str | Path, *, package: str = "simulator") -> Path:
    """Return the path of a preset, or of a file that exists.

    Parameters
    ----------
    kind : str
        Kind of the preset or of the record.
    source : str or Path
        Name of a preset, or a file.
    package : str, optional
        Package that ships the presets.

    Raises
    ------
    InputError
        If ``source`` is neither; with the nearest presets.
    """
    path = preset_path(kind, str(source), package=package) or Path(source)
    if not is_file(path):
        names = preset_names(kind, package=package)
        hint = nearest(source, names) or f"presets: {', '.join(names) or 'none'}"
        raise InputError(kind, str(source), allowed="a YAML file or a preset", hint=hint)
    return path


def preset_tree(
    kind: str, source: Any, *, keys: Iterable[str], package: str = "simulator", kinds: tuple[str, ...] = ()
) -> tuple[dict[str, Any], Path | None]:
    """Return what a source holds: a preset, a YAML file, or the mapping itself, without its ``kind``.

    Parameters
    ----------
    kind : str
        What the presets are, and what the source is expected to say that it is, if it says so.
    source : str, Path or mapping
    keys : iterable of str
        Keys that such a file has, see `cpic_core.yaml_files.load_mapping`.
    package : str
        Whose presets.
    kinds : tuple of str
        Other kinds that are accepted, and stay in the tree.

    Returns
    -------
    tree : dict
        With the name of the file as ``name`` where it has none.
    folder : Path or None
        Folder of the file, beside which files that it names are looked for.

    Raises
    ------
    InputError
        If the source is nothing of this, or of another kind.
    """
    folder = None
    if isinstance(source, Mapping):
        tree: Any = dict(source)
    elif isinstance(source, str | Path):
        path = preset_or_file(kind, source, package=package)
        tree, folder = load_mapping(path, kind, keys), path.parent
        tree.setdefault("name", path.stem)
    else:
        raise InputError(kind, source, allowed="a mapping, a YAML file or a preset")
    said = tree.get("kind", kind)
    if said not in (kind, *kinds):
        raise InputError(f"{kind}.kind", said, allowed=", ".join((kind, *kinds)))
    if said == kind:
        tree.pop("kind", None)
    return tree, folder


def tree_over_preset(
    kind: str, source: Any, *, default: str, keys: Iterable[str], package: str = "simulator"
) -> tuple[dict[str, Any], Path | None, str | None]:
    """Return what a source holds, and the preset that it is laid over.

    Parameters
    ----------
    kind, source, keys, package
        As of `preset_tree`; ``None`` is the preset ``default``.
    default : str
        Preset that a file or mapping is laid over where it names no ``base``.

    Returns
    -------
    tree : dict
        Without its ``base``.
    folder : Path or None
        As of `preset_tree`.
    base : str or None
        None for a preset that is whole.

    Raises
    ------
    InputError
        As `preset_tree`, or if the base is no preset.
    """
    source = default if source is None else source
    tree, folder = preset_tree(kind, source, keys=keys, package=package)
    names = preset_names(kind, package=package)
    if "base" not in tree and not isinstance(source, Mapping) and str(source) in names:
        return tree, folder, None
    base = tree.pop("base", default)
    if base not in names:
        raise InputError(f"{kind}.base", base, allowed=", ".join(names))
    return tree, folder, str(base)
