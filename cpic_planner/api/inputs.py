"""Names of stars and settings of the instrument, turned into targets and models."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

from cpic_planner.etc.model import EtcModel, build_model
from cpic_planner.queries.shared import OnOff, default_instrument
from cpic_planner.queries.strategy import Strategy
from cpic_planner.targets import CatalogSource, Targets, as_catalogue, find_target


def model_of(question: Any) -> EtcModel:
    """Return the model of the instrument, the bands and the strategy of a question; that of the shipped one is kept."""
    if question.instrument is default_instrument():
        return _default_model(question.bands, question.strategy)
    return build_model(question.instrument, question.bands, question.strategy)


@functools.lru_cache(maxsize=16)
def _default_model(bands: tuple[str, ...] | None, strategy: Strategy | None) -> EtcModel:
    """Model of the shipped instrument, which no file of the user's can change."""
    return build_model(default_instrument(), bands, strategy)


def stars_named(names: Sequence[str], companions: OnOff, catalog: CatalogSource) -> list[Targets]:
    """Return each named star as a target of its own."""
    table = as_catalogue(catalog)
    return [find_target(name, companions=companions, catalog=table)[0] for name in names]
