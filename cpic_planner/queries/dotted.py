"""Dotted keys of models and nested mappings: which values a key with ``*`` means, and trees with other values."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping
from fnmatch import fnmatchcase
from typing import Any

from simulator.config import FrozenModel, Instrument
from simulator.config.keys import nearest


def children(node: Any) -> Mapping[str, Any] | None:
    """Return what is below a section by name; None for a value."""
    if isinstance(node, FrozenModel):
        return {name: getattr(node, name) for name in type(node).model_fields}
    return node if isinstance(node, Mapping) else None


def sections(instrument: Instrument) -> dict[str, Any]:
    """Return the sections of an instrument by name; its own name is none."""
    return {name: item for name, item in (children(instrument) or {}).items() if name != "name"}


def _every(node: Mapping[str, Any], above: str = "") -> Iterator[str]:
    """Dotted keys of all values."""
    for name, item in node.items():
        below = children(item)
        if below is None:
            yield f"{above}{name}"
        else:
            yield from _every(below, f"{above}{name}.")


def matching(root: Mapping[str, Any], key: str) -> Iterator[tuple[str, Any]]:
    """Yield the keys that a key means, and what is there.

    A mapping of values by the names of bands may be given more of them; None is there before.
    """
    yield from _below(root, key.split("."), "")


def _below(node: Mapping[str, Any], parts: list[str], above: str) -> Iterator[tuple[str, Any]]:
    head, rest = parts[0], parts[1:]
    wild = "*" in head
    for name, item in node.items():
        if not (fnmatchcase(name, head) if wild else name == head):
            continue
        below = children(item)
        if not rest:
            yield f"{above}{name}", item
        elif below is not None:
            yield from _below(below, rest, f"{above}{name}.")
            if len(rest) == 1 and rest[0] not in below and "*" not in rest[0] and _takes_new(item):
                yield f"{above}{name}.{rest[0]}", None


def _takes_new(node: Any) -> bool:
    """Whether a mapping holds values by the names of bands, so that there may be more."""
    return isinstance(node, Mapping) and not any(children(item) is not None for item in node.values())


def advice(root: Mapping[str, Any], key: str, short: tuple[str, ...]) -> str:
    """Return the nearest keys, or those of the section that was meant."""
    near = nearest(key, (*short, *_every(root)))
    if near:
        return near
    node, path = root, ""
    for part in key.split("."):
        below = children(node.get(part))
        if below is None:
            break
        node, path = below, f"{path}{part}."
    words = f"known keys: {', '.join(f'{path}{name}' for name in node)}"
    return words if path else f"{words}; short ones: {', '.join(short)}"


def get(tree: Mapping[str, Any], key: str) -> Any:
    """Return the value of a dotted key of nested mappings.

    Raises
    ------
    KeyError
        If there is none.
    """
    return functools.reduce(lambda part, name: part[name], key.split("."), tree)


def put(tree: Mapping[str, Any], key: str, value: Any) -> dict[str, Any]:
    """Return a copy of nested mappings with the value of a dotted key; what is above it is made.

    Parameters
    ----------
    tree : mapping
    key : str
    value : object
    """
    head, _, rest = key.partition(".")
    return dict(tree) | {head: put(tree.get(head, {}), rest, value) if rest else value}


def keys_of(model: type[FrozenModel], above: str = "") -> tuple[str, ...]:
    """Return the dotted keys of a model whose values are plain.

    Parameters
    ----------
    model : type of FrozenModel
    above : str
        What every key begins with.
    """
    found: list[str] = []
    for name, field in model.model_fields.items():
        below = field.annotation
        if isinstance(below, type) and issubclass(below, FrozenModel):
            found += keys_of(below, f"{above}{name}.")
        else:
            found.append(f"{above}{name}")
    return tuple(found)


def scaled(present: Any, factor: float) -> Any:
    """Return a number, or each of several, times a factor; None for what is no number.

    Whole numbers stay whole where the product is.
    """
    if isinstance(present, tuple) and present:
        found = tuple(scaled(item, factor) for item in present)
        return None if None in found else found
    if not isinstance(present, int | float) or isinstance(present, bool):
        return None
    value = present * factor
    return int(value) if isinstance(present, int) and value == int(value) else value
