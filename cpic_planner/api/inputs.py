"""Names and mappings of the public functions, turned into models and targets."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from cpic_planner.etc.model import EtcModel, Strategy, build_model
from cpic_planner.etc.planet import ReferencePlanet
from cpic_planner.targets import CatalogSource, Targets, as_catalogue, find_target
from simulator.config import Instrument, load_instrument
from simulator.config.base import validate

__all__ = ["InstrumentSource", "OnOff", "StrategySource", "model_of", "planet_of", "stars_named"]

StrategySource = Strategy | Mapping[str, Any] | None
InstrumentSource = Instrument | Mapping[str, Any] | str | Path | None
OnOff = Literal["on", "off"]


def model_of(instrument: InstrumentSource, bands: Sequence[str] | None, strategy: StrategySource = None) -> EtcModel:
    """Model of an instrument; that of the shipped one is kept."""
    plan = validate(Strategy, strategy, where="strategy") if isinstance(strategy, Mapping) else strategy
    if instrument is None:
        named = (bands,) if isinstance(bands, str) else bands
        return _default_model(None if named is None else tuple(named), plan)
    return build_model(instrument if isinstance(instrument, Instrument) else load_instrument(instrument), bands, plan)


@functools.lru_cache(maxsize=16)
def _default_model(bands: tuple[str, ...] | None, strategy: Strategy | None) -> EtcModel:
    """Model of the shipped instrument, which no file of the user's can change."""
    return build_model(load_instrument(), bands, strategy)


def planet_of(given: Any) -> ReferencePlanet:
    """Planet from what people write: an object or a mapping."""
    return given if isinstance(given, ReferencePlanet) else validate(ReferencePlanet, given, where="planet")


def stars_named(names: str | Sequence[str], companions: OnOff, catalog: CatalogSource) -> list[Targets]:
    """Each named star as a target of its own."""
    table = as_catalogue(catalog)
    listed = [names] if isinstance(names, str) else names
    return [find_target(name, companions=companions, catalog=table)[0] for name in listed]
