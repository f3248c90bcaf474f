"""Columns of every table and fields of every result, from the models of the results."""

import inspect
import typing
from collections.abc import Iterator
from typing import Any, get_args

from pydantic import BaseModel

from tools.site.markdown import Entry, anchored, code, marked, summary, table

_WORDS: dict[Any, str] = {str: "text", int: "integer", float: "number", bool: "true or false", Any: "anything"}
HEADINGS = ("column", "type", "unit", "meaning")


def models() -> Iterator[type[BaseModel]]:
    """Yield the models of all results in the order of their names, each once, with those that stand inside others."""
    from cpic_planner import results

    public = (getattr(results, name) for name in dir(results))
    waiting = [item for item in public if inspect.isclass(item) and issubclass(item, BaseModel)]
    seen: dict[str, type[BaseModel]] = {}
    while waiting:
        model = waiting.pop()
        if model.__name__ not in seen and model.model_fields:
            seen[model.__name__] = model
            waiting += [one for field in model.model_fields.values() for one in models_in(field.annotation)]
    yield from (seen[name] for name in sorted(seen))


def models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models that stand in an annotation."""
    if inspect.isclass(annotation) and issubclass(annotation, BaseModel):
        yield annotation
    for item in get_args(annotation):
        yield from models_in(item)


def said_type(annotation: Any) -> str:
    """Return an annotation in words: names of models without their modules, null for None."""
    if annotation is type(None):
        return "null"
    if hasattr(annotation, "__metadata__"):
        return said_type(annotation.__origin__)
    origin, inside = typing.get_origin(annotation), get_args(annotation)
    if origin is typing.Literal:
        return " \\| ".join(repr(item) for item in inside)
    if origin is not None and type(None) in inside:
        return " or ".join(map(said_type, inside))
    if origin in (list, tuple, dict, set, frozenset):
        return f"{origin.__name__} of {' to '.join(said_type(item) for item in inside if item is not ...)}"
    if inside:
        return " or ".join(map(said_type, inside))
    return _WORDS.get(annotation, str(getattr(annotation, "__name__", annotation)))


def entries(model: type[BaseModel]) -> list[Entry]:
    """Return the columns of a model.

    Parameters
    ----------
    model : type of BaseModel
    """
    from cpic_planner.results.base import described

    found = []
    for name, field in model.model_fields.items():
        said = described(name, field)
        meaning = said.description or said.title or name.replace("_", " ")
        inner = list(models_in(field.annotation))
        links = "".join(f" See [{one.__name__}](#{anchored('result', one.__name__)})." for one in inner)
        kind = said_type(field.annotation)
        numeric = not inner and ("number" in kind or "integer" in kind)
        found.append(
            Entry(
                anchored("column", model.__name__, name),
                name,
                (kind.replace("_", r"\_"), code(said.unit) if numeric else "", marked(meaning) + links),
            )
        )
    return found


def page() -> str:
    """Return the reference of every column."""
    parts = []
    for model in models():
        anchor = anchored("result", model.__name__)
        text = "" if model.__doc__ == BaseModel.__doc__ else summary(model)
        parts.append(f"({anchor})=\n## {model.__name__}\n\n{text}\n\n{table(HEADINGS, entries(model))}")
    return "\n".join(parts)
