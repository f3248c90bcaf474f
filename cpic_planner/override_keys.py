"""Dotted keys of an instrument: which values a key with ``*`` means, and which of them its optics are made of."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from fnmatch import fnmatchcase
from typing import Any

from simulator.config import FrozenModel, Instrument
from simulator.config.keys import nearest

__all__ = ["advice", "children", "is_optical", "matching", "sections"]

# What `simulator.imaging.store.metrics_key` is made of.
_OPTICS = (
    "telescope",
    "coronagraph",
    "near_infrared.pixel_scale_arcsec",
    "near_infrared.mask_half_width_arcsec",
    "near_infrared.outer_half_side_arcsec",
    "wavefront",
    "mirror",
    "dark_hole",
    "drift.psd_slope",
    "bands.*.camera",
    "bands.*.center_nm",
    "bands.*.width_nm",
    "bands.*.transmission_file",
    "detector.pixel_scale_arcsec",
)


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


def is_optical(key: str) -> bool:
    """Whether a key, which may hold ``*``, can mean something that point-spread functions depend on."""
    return any(_meets(key, pattern) for pattern in _OPTICS)


def _meets(key: str, pattern: str) -> bool:
    """Whether a key, which may hold ``*``, can mean what a pattern names or something below it."""
    ours, theirs = key.split("."), pattern.split(".")
    if len(ours) < len(theirs):
        return False
    return all(fnmatchcase(a, b) or fnmatchcase(b, a) for a, b in zip(ours, theirs, strict=False))
