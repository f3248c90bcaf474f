"""The question of ``cpic rank``: which stars promise most."""

from __future__ import annotations

from typing import ClassVar

from pydantic import model_validator

from cpic_planner.queries.fields import asked
from cpic_planner.queries.shared import (
    DEFAULT_TIME_S,
    CountedPlanetsQuestion,
    CutsQuestion,
    InstrumentQuestion,
    Seed,
)
from cpic_planner.queries.strategy import Strategy
from cpic_planner.registry.scores import DEFAULT_SCORE, ScoreName


class RankedQuestion(InstrumentQuestion, CutsQuestion, CountedPlanetsQuestion):
    """What a ranking of stars is asked."""

    time_s: float = asked(
        DEFAULT_TIME_S,
        "Wall time per target and band, readouts and reference frames included.",
        ge=1e-3,
        le=1e9,
    )
    seed: Seed = asked(1, "Seed of every random number.")
    score: ScoreName = asked(DEFAULT_SCORE, "What the ranking is by.")

    @model_validator(mode="after")
    def _one_kind_of_planets(self) -> RankedQuestion:
        self.check_planets()
        return self


class RankQuestion(RankedQuestion):
    """Rank the whole catalogue."""

    KIND: ClassVar[str] = "rank"

    strategy: Strategy = asked(
        Strategy(), "How the observation is made and reduced.", accepts="Strategy or mapping, optional"
    )
