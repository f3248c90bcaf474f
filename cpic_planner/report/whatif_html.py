"""The report of a comparison of survey strategies: one HTML file that needs nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from catalogs.catalogue import data_credits
from catalogs.info import PLANET_CREDITS
from catalogs.known_planets import split_source
from cpic_planner.models.surveyed import DifferenceRecord, RankChange, StrategyOutcome, WhatIfResult
from cpic_planner.report.drawing import Picture
from cpic_planner.report.html import page_environment
from cpic_planner.report.whatif_looks import shown_rows
from cpic_planner.report.whatif_words import (
    READING,
    WHATIF_GLOSSARY,
    changed_settings,
    extent_text,
    hanging_text,
    interval_text,
    lead_sentences,
    planets_text,
    setting_text,
    shared_facts,
    universe_facts,
)
from cpic_planner.report.words import GLOSSARY, METHOD_CREDITS

__all__ = ["WHATIF_FIGURES", "render_whatif"]

WHATIF_FIGURES = {
    "sweep": "What the varied setting does",
    "yields": "What each strategy yields",
    "differences": "Is the difference real?",
    "curves": "Yield against telescope time",
    "time": "Where the time goes",
    "calendar": "Who is visited when",
    "sky": "Where the stars are",
    "detections": "What is detected",
    "convergence": "Are there enough universes?",
}
"""Titles of the figures, in their order."""
_OPEN_CHANGES = 5
"""Strategies whose changes of rank are shown without a click."""
_WORDS = frozenset(
    {
        "contrast",
        "SNR",
        "significance",
        "threshold",
        "blind search",
        "separation",
        "dark hole",
        "RDI",
    }
)


@dataclass(frozen=True)
class Pair:
    """Differences of two strategies by quantity."""

    first: str
    second: str
    by: dict[str, DifferenceRecord]


def render_whatif(result: WhatIfResult, figures: Mapping[str, Picture]) -> str:
    """Render the report from finished pictures.

    Parameters
    ----------
    result : WhatIfResult
    figures : mapping of str to Picture
        By the keys of `WHATIF_FIGURES`.

    Returns
    -------
    str
        HTML with inline style and data-URI images: no script, nothing fetched.
    """
    reference = result.strategies[0]
    best = max(result.strategies, key=lambda item: item.planets.mean)
    shipped = bool(result.known_planets) and split_source(str(result.universe["known_planets"]))[0] != "none"
    planets = PLANET_CREDITS if shipped else ()
    pairs = _pairs(result)
    environment = page_environment()
    environment.filters["planets"] = planets_text
    environment.filters["setting"] = setting_text
    environment.globals.update(interval=interval_text)
    return environment.get_template("whatif.html.j2").render(
        result=result,
        reference=reference,
        best=best.name if best.planets.mean > 0 else "",
        lead=lead_sentences(result),
        extent=extent_text(result),
        hanging={item.name: hanging_text(item) for item in result.strategies},
        reading=READING,
        with_first=[pair for pair in pairs if pair.second == reference.name],
        other_pairs=[pair for pair in pairs if pair.second != reference.name],
        figures=[(key, title, figures[key]) for key, title in WHATIF_FIGURES.items() if key in figures],
        has_stars=any(item.targets for item in result.strategies),
        changes=_changes(result),
        open_changes=_OPEN_CHANGES,
        shown=[result.strategies[i] for i in shown_rows(result.strategies)],
        settings={item.name: changed_settings(item.settings, reference.settings) for item in result.strategies},
        confirmed=[item for item in result.strategies if item.images is not None],
        universe=universe_facts(result),
        assumed=shared_facts(reference.settings, reference.instrument),
        visits_made={item.name: sum(target.visits for target in item.targets) for item in result.strategies},
        stars_visited={item.name: _stars(item) for item in result.strategies},
        glossary=[*WHATIF_GLOSSARY, *((word, text) for word, text in GLOSSARY if word in _WORDS)],
        credits=(*data_credits(result.catalogue), *planets, *METHOD_CREDITS),
    )


def _pairs(result: WhatIfResult) -> list[Pair]:
    found: dict[tuple[str, str], Pair] = {}
    for item in result.differences:
        found.setdefault((item.first, item.second), Pair(item.first, item.second, {})).by[item.quantity] = item
    return list(found.values())


def _changes(result: WhatIfResult) -> dict[str, list[RankChange]]:
    """Changes of rank by strategy, in their order."""
    found: dict[str, list[RankChange]] = {}
    for change in result.rank_changes:
        found.setdefault(change.strategy, []).append(change)
    return found


def _stars(item: StrategyOutcome) -> int:
    """Stars with a visit inside the budget."""
    return sum(target.planned_visits > 0 for target in item.targets)
