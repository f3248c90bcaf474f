"""Keys of YAML files: of the instrument with value, source and confidence, and of every other kind of file."""

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from cpic_core import Provenance
from simulator.config import FrozenModel
from tools.site.columns import models_in, said_type
from tools.site.markdown import Entry, anchored, attributes, cell, code, marked, prose, summary, table

HEADINGS = ("key", "unit", "default", "range", "confidence", "source or meaning")
PRESETS = ("cpic_default", "cpic_2q", "as_published", "cpic_single_jacobian", "paper_table1")


def files() -> Iterator[tuple[str, str, type[BaseModel], Mapping[str, Provenance], Any]]:
    """Yield each kind of file: title, anchor, model, sources of the defaults by key, and the defaults themselves."""
    from cpic_planner.planets import load_population
    from cpic_planner.planets.population import PopulationConfig
    from cpic_planner.queries import Ensemble
    from cpic_planner.survey.strategy import StrategiesConfig, SurveyStrategy, load_strategies
    from cpic_planner.survey.visibility import VisibilityConfig, load_visibility
    from simulator import Instrument, Scene, load_instrument
    from simulator.config.simulation import SimulationConfig

    instrument = load_instrument()
    yield "Instrument (`kind: instrument`)", "instrument", Instrument, instrument.provenance, instrument
    yield "Scene (`kind: scene`)", "scene", Scene, {}, None
    yield "Simulation (`kind: simulation`)", "simulation", SimulationConfig, {}, None
    population = load_population()
    yield "Population (`kind: population`)", "population", PopulationConfig, population.provenance, population
    strategy = load_strategies({"strategies": [{"name": "default"}]}).strategies[0]
    yield "Strategy of a survey (preset `default`)", "strategy", SurveyStrategy, strategy.provenance, strategy
    yield "Strategies (`kind: strategies`)", "strategies", StrategiesConfig, {}, None
    limits = load_visibility()
    yield "Visibility (`kind: visibility`)", "visibility", VisibilityConfig, limits.provenance, limits
    yield "Ensemble (`kind: ensemble`)", "ensemble", Ensemble, {}, None


def sections(
    model: type[BaseModel], path: str, value: Any, seen: dict[type[BaseModel], str]
) -> Iterator[tuple[str, type[BaseModel], Any]]:
    """Yield a model and those below it with the key under which each stands and its default.

    What has no default of its own is yielded once.

    Parameters
    ----------
    model : type of BaseModel
    path : str
        Dotted key of the model.
    value : BaseModel or None
        Its default.
    seen : dict
        Heading of each model that was yielded before; what is new is added.
    """
    yield path, model, value
    for name, field in model.model_fields.items():
        present = getattr(value, name, None)
        below = next(iter(present.values()), None) if isinstance(present, dict) else present
        for inner in dict.fromkeys(models_in(field.annotation)):
            if inner not in seen or (type(below) is inner and isinstance(value, FrozenModel) and not _choice(field)):
                key = f"{path}.{name}{_many(field.annotation)}".strip(".")
                seen.setdefault(inner, key)
                yield from sections(inner, key, below if isinstance(below, inner) else None, seen)


def _choice(field: Any) -> bool:
    """Return whether a key holds one of several kinds of models."""
    return len(set(models_in(field.annotation))) > 1


def _many(annotation: Any) -> str:
    """Return the mark of a key that holds several: by name, or one after the other."""
    whole = said_type(annotation)
    return ".*" if "dict of" in whole else "[]" if whole.startswith(("tuple", "list")) else ""


def entries(
    anchor: str,
    path: str,
    model: type[BaseModel],
    value: Any,
    sources: Mapping[str, Provenance],
    seen: Mapping[type[BaseModel], str],
    paths: Collection[str],
) -> list[Entry]:
    """Return the keys of one section.

    Parameters
    ----------
    anchor : str
        Of the kind of file.
    path : str
        Key of the section.
    model : type of BaseModel
    value : BaseModel or None
        Its default, where a preset has one.
    sources : mapping of str to Provenance
        Where the defaults come from, by dotted key.
    seen : mapping
        Key under which each model is described.
    paths : collection of str
        Keys of this kind of file that have a section.
    """
    from simulator.config import limits_of, unit_of

    said, found = attributes(model) | _effects(model), []
    for name, field in model.model_fields.items():
        key = f"{path}.{name}".strip(".")
        inner = list(dict.fromkeys(models_in(field.annotation)))
        if inner and f"{key}{_many(field.annotation)}" in paths and not _choice(field):
            continue
        source = sources.get(key) or _like(key, sources)
        default = getattr(value, name, field.default)
        text = [_said(name, field.description or "", said, summary(model))]
        text += [f"{'Source: ' if text[0] else ''}{prose(source.source)}"] if source else []
        text += [f"Its keys: {', '.join(f'`{seen[one]}` ({one.__name__})' for one in inner)}"] if inner else []
        unit = "" if isinstance(default, bool) else (source.unit if source else "") or unit_of(name)
        cells = (code(unit), _shown(default), cell(limits_of(field)), source.confidence if source else "")
        found.append(
            Entry(
                anchored("key", anchor, key),
                name,
                (*cells, ". ".join(part.rstrip(".") for part in text if part) or said_type(field.annotation)),
            )
        )
    return found


def _effects(model: type[BaseModel]) -> dict[str, str]:
    """Return what the switches of a camera leave out, where a model holds these."""
    from simulator.config.detector import CameraSwitches, InfraredSwitches
    from simulator.detectors import INFRARED, VISIBLE

    chains: dict[type[BaseModel], Iterable[Any]] = {CameraSwitches: VISIBLE, InfraredSwitches: INFRARED}
    return {effect.switch: marked(f"{effect.label}: {effect.law}") for effect in chains.get(model, ()) if effect.switch}


def _like(key: str, sources: Mapping[str, Provenance]) -> Provenance | None:
    """Return the source of a key that stands for several, such as ``bands.*.qe``: that of the first of them."""
    from fnmatch import fnmatchcase

    return next((item for name, item in sources.items() if "*" in key and fnmatchcase(name, key)), None)


_ANYWHERE = {
    "name": "name in tables and reports",
    "description": "what it is, for people",
    "seed": "seed of what is drawn",
}


def _said(name: str, description: str, said: Mapping[str, str], about: str) -> str:
    """Return what is said of a key: in the docstring's attributes, in its field, or in a sentence that quotes it."""
    sentences = re.split(r"(?<=[.;])\s+", re.sub(r"\s+", " ", about))
    quoted = " ".join(sentence for sentence in sentences if f"`{name}`" in sentence).rstrip(";.")
    return said.get(name) or marked(description) or quoted or _ANYWHERE.get(name, "")


def _shown(default: Any) -> str:
    if default is PydanticUndefined or isinstance(default, BaseModel):
        return ""
    if isinstance(default, dict | tuple | list) and (not default or any(isinstance(i, BaseModel) for i in default)):
        return ""
    if isinstance(default, dict | tuple | list):
        return code(", ".join(map(str, default)))
    if default is None or isinstance(default, bool):
        return code({None: "null", True: "true", False: "false"}[default])
    return code(f"{default:g}" if isinstance(default, float) else default)


def page() -> str:
    """Return the reference of all keys."""
    parts: list[str] = []
    seen: dict[type[BaseModel], str] = {}
    for title, anchor, model, sources, value in files():
        parts.append(f"({anchored('keys', anchor)})=\n## {title}\n")
        seen[model] = anchor
        found = list(sections(model, "", value, seen))
        paths = [path for path, _, _ in found]
        for path, inner, present in found:
            if path:
                one_of_several = f": {inner.__name__}" if paths.count(path) > 1 else ""
                parts.append(f"### `{path}`{one_of_several} ({anchor})\n")
            parts.append(f"{summary(inner)}\n")
            if own := entries(anchor, path, inner, present, sources, seen, paths):
                parts.append(table(HEADINGS, own))
    return "\n".join(parts)
