"""The reference of the Python functions: what to document, from the stubs of the public packages."""

import importlib
import inspect
import typing
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from tools.site.columns import models
from tools.site.markdown import anchored, summary

PACKAGES = ("cpic_planner", "cpic_planner.validation", "simulator", "simulator.camera", "catalogs")
"""Packages whose names are public, those first under whose name something is documented."""
FLOORS = ("cpic_core", "catalogs", "simulator", "cpic_planner")


def names(package: str) -> list[str]:
    """Return the public names of a package, those of its stub."""
    return [name for name in importlib.import_module(package).__all__ if not name.startswith("__")]


def public() -> dict[str, Any]:
    """Return every public object by the name under which it is documented: each once."""
    found: dict[str, Any] = {}
    held: dict[int, str] = {}
    for package in PACKAGES:
        for name in names(package):
            item = getattr(importlib.import_module(package), name)
            plain = isinstance(item, str | int | float | tuple | frozenset)
            if plain or held.setdefault(id(item), f"{package}.{name}") == f"{package}.{name}":
                found[f"{package}.{name}"] = item
    return found


def returned(named: dict[str, Any]) -> dict[str, Any]:
    """Return the types that public functions and methods give back and that are not public names themselves.

    Parameters
    ----------
    named : dict
        Public objects by name.
    """
    held = {id(item) for item in named.values()} | {id(model) for model in models()}
    found: dict[str, Any] = {}
    waiting = list(named.values())
    while waiting:
        item = waiting.pop()
        for kind in _types(item):
            if id(kind) not in held:
                held.add(id(kind))
                found[f"{kind.__module__}.{kind.__qualname__}"] = kind
                waiting.append(kind)
    return dict(sorted(found.items(), key=lambda pair: pair[0].rpartition(".")[2].lower()))


def _types(item: Any) -> Iterator[Any]:
    """Yield the types of the house that a function returns, or that methods and properties of a class do."""
    if inspect.isclass(item):
        if item.__module__.split(".")[0] not in FLOORS:
            return
        if issubclass(item, BaseModel):
            hints = {name: field.annotation for name, field in item.model_fields.items()}
        else:
            hints = _hints(item)
        parts = list(hints.values())
        for name, member in dict(vars(item)).items():
            call = getattr(member, "fget", None) or getattr(member, "func", None) or getattr(member, "__func__", member)
            if not name.startswith("_") and inspect.isfunction(call):
                parts.append(_hints(call).get("return"))
    elif callable(item):
        wrapped = inspect.signature(item).return_annotation
        parts = [_hints(item).get("return"), wrapped]
    else:
        return
    for part in parts:
        yield from _inside(part)


def _hints(item: Any) -> dict[str, Any]:
    try:
        return typing.get_type_hints(item)
    except (NameError, TypeError):  # what only type checkers import
        return {}


def _inside(annotation: Any) -> Iterator[Any]:
    origin = typing.get_origin(annotation)
    if inspect.isclass(origin) and origin.__module__.split(".")[0] in FLOORS:
        yield origin
    for part in typing.get_args(annotation):
        yield from _inside(part)
    named = inspect.isclass(annotation) and origin is None
    if named and annotation.__module__.split(".")[0] in FLOORS and not annotation.__name__.startswith("_"):
        yield annotation


def directive(name: str, item: Any) -> str:
    """Return what documents one object.

    Parameters
    ----------
    name : str
        Under which it is documented.
    item : object
    """
    if isinstance(item, type) and issubclass(item, BaseModel):
        return _model(name, item)
    if inspect.isclass(item):
        return f".. autoclass:: {name}\n   :members:\n"
    if callable(item):
        return f".. autofunction:: {name}\n"
    return f".. autodata:: {name}\n   :no-value:\n"


def _model(name: str, item: Any) -> str:
    """Return the entry of a configuration: its keys stand in the reference of keys."""
    return f".. autoclass:: {name}\n   :members:\n   :exclude-members: model_config, {', '.join(item.model_fields)}\n"


def page() -> str:
    """Return the reference of every public name and of the types that they give back."""
    named = public()
    parts = []
    for package in PACKAGES:
        own = {name: item for name, item in named.items() if name.rpartition(".")[0] == package}
        if not own:
            continue
        more = [name for name in names(package) if f"{package}.{name}" not in own]
        about = summary(importlib.import_module(package))
        parts.append(f"({anchored('api', package)})=\n## `{package}`\n\n{about}\n")
        if more:
            parts.append(f"Also here, described above: {', '.join(f'`{name}`' for name in more)}.\n")
        parts += [_block(name, item) for name, item in sorted(own.items(), key=lambda pair: pair[0].lower())]
    parts.append("(api-types)=\n## Types that functions return\n")
    parts.append("Results that are tables or documents are described in the [reference of columns](columns.md).\n")
    parts += [_block(name, item) for name, item in returned(named).items()]
    return "\n".join(parts)


def _block(name: str, item: Any) -> str:
    return f"```{{eval-rst}}\n{directive(name, item)}```\n"
