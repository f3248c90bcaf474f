"""Plan and play strategies again as if one fact were not known, to show which fact moves which number."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from catalogs import split_source
from cpic_core import IntArray, NDArray
from cpic_planner.results import FactRow, FactsRecord, StrategyOutcome, TakenBack
from cpic_planner.survey.estimates import difference_interval
from cpic_planner.survey.events import PLANETS
from cpic_planner.survey.outcome import change_record, estimate_record
from cpic_planner.survey.strategy_file import StrategiesConfig, UniverseConfig

ALL = "all"
QUANTITIES = ("planets", *PLANETS)
Counts = Mapping[str, IntArray]
"""Planets found in each universe, by the names of `QUANTITIES`."""


@dataclass(frozen=True)
class Fact:
    """Something that is known today.

    Attributes
    ----------
    name : str
    words : str
        What it is, as a noun.
    heading : str
        What a survey is without it.
    before : callable
        Returns what of a universe was otherwise before; nothing where the survey does not use the fact.
    """

    name: str
    words: str
    heading: str
    before: Callable[[UniverseConfig], dict[str, Any]]


def _planets_of_2019(universe: UniverseConfig) -> dict[str, Any]:
    if universe.known_planets == "off":
        return {}
    base, file = split_source(universe.known_planets)
    return {"known_planets": "+".join(filter(None, ("archive_2019", file)))} if base == "snapshot" else {}


def _companions_as_listed(universe: UniverseConfig) -> dict[str, Any]:
    return {"catalog": "simbad_2012"} if universe.catalog == "snapshot" else {}


def _allowing(excluded: str) -> Callable[[UniverseConfig], dict[str, Any]]:
    def before(universe: UniverseConfig) -> dict[str, Any]:
        left = tuple(word for word in universe.exclusions if word != excluded)
        return {"exclusions": left} if left != universe.exclusions else {}

    return before


FACTS = (
    Fact(
        "known_planets",
        "what was published on known planets since 2019",
        "Known planets as of 2019",
        _planets_of_2019,
    ),
    Fact("rv", "what radial velocities exclude", "Without radial velocities", _allowing("rv")),
    Fact(
        "stability", "the orbits that companion stars make unstable", "Without stability limits", _allowing("stability")
    ),
    Fact("known_giants", "the room that known giants take", "Without known giants", _allowing("known_giants")),
    Fact("companions", "where companion stars stand today", "Companions as first listed", _companions_as_listed),
)
"""Facts that can be taken back, in the order of the table."""


def taken_back(config: StrategiesConfig) -> dict[str, StrategiesConfig]:
    """Return the strategies as if a fact were not known, by its name; last without any of them, as ``all``.

    Parameters
    ----------
    config : StrategiesConfig
        Facts that its universe does not use are left out; nothing where it does not ask for the comparison.
    """
    universe = config.universe
    if not universe.facts:
        return {}
    found, nothing = {}, universe
    for fact in FACTS:
        if before := fact.before(universe):
            found[fact.name] = universe.model_copy(update=before)
            nothing = nothing.model_copy(update=fact.before(nothing))
    if len(found) > 1:
        found[ALL] = nothing
    return {name: config.model_copy(update={"universe": state}) for name, state in found.items()}


def counts_of(parts: Sequence[Mapping[str, NDArray[Any] | list[int]]]) -> Counts:
    """Return the planets found in the universes of some blocks, one after the other.

    Parameters
    ----------
    parts : sequence of mapping
        What `cpic_planner.survey.simulate.count_block` returns, or columns of the table of universes.
    """
    found = {name: np.concatenate([np.asarray(part[name], np.int64) for part in parts]) for name in PLANETS}
    return found | {"planets": found["new_planets"] + found["known_planets"]}


def facts_record(
    states: Mapping[str, StrategiesConfig],
    outcomes: Sequence[StrategyOutcome],
    known: Sequence[Counts],
    without: Mapping[str, Sequence[Counts]],
) -> FactsRecord:
    """Return the table of what each fact moves.

    Parameters
    ----------
    states : mapping
        As of `taken_back`.
    outcomes : sequence of StrategyOutcome
        With all facts.
    known : sequence of Counts
        With all facts, by strategy.
    without : mapping of str to sequence of Counts
        By fact, and by strategy.
    """
    words = {fact.name: (fact.words, fact.heading) for fact in FACTS} | {ALL: ("all of these", "Without all of these")}
    rows = []
    for fact, of_strategies in without.items():
        for outcome, before, now in zip(outcomes, of_strategies, known, strict=True):
            numbers: dict[str, Any] = {name: estimate_record(before[name].astype(float)) for name in QUANTITIES}
            for name in QUANTITIES:
                numbers[f"{name}_change"] = change_record(difference_interval(before[name] - now[name]))
            rows.append(FactRow(strategy=outcome.name, fact=fact, **numbers))
    named = [
        TakenBack.of(state.universe, name=name, words=words[name][0], heading=words[name][1])
        for name, state in states.items()
    ]
    return FactsRecord(facts=named, rows=rows, statement=_statement(named, rows, outcomes))


def _statement(named: Sequence[TakenBack], rows: Sequence[FactRow], outcomes: Sequence[StrategyOutcome]) -> str:
    """Return which fact moves most planets, and which most new ones where that is another."""
    said: dict[str, str] = {}
    for quantity, words in (("planets", "planets"), ("new_planets", "new planets")):
        changes = [(row, getattr(row, f"{quantity}_change")) for row in rows if row.fact != ALL]
        sure = [(row, change) for row, change in changes if change.low > 0.0 or change.high < 0.0]
        if not sure:
            continue
        row, change = max(sure, key=lambda item: abs(item[1].mean))
        fact = next(item.words for item in named if item.name == row.fact)
        now = next(getattr(item, quantity).mean for item in outcomes if item.name == row.strategy)
        text = (
            f"The fact that moves most {words} is {fact}: {row.strategy} finds {now:.2f} with it and "
            f"{getattr(row, quantity).mean:.2f} without (90 % interval of the difference {change.low:+.2f} to "
            f"{change.high:+.2f})."
        )
        said.setdefault(row.fact, text)
    return " ".join(said.values()) or "No single fact changes the planets found by more than chance."
