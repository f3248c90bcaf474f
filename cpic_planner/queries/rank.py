"""The question of ``cpic rank``: which stars promise most."""

from typing import ClassVar, Self

from pydantic import model_validator

from cpic_core import InputError
from cpic_planner.planets import PopulationConfig, load_population
from cpic_planner.queries import shared
from cpic_planner.queries.base import called
from cpic_planner.queries.fields import asked
from cpic_planner.registry import DEFAULT_SCORE, ScoreName

N_PLANETS = 4000
"""Planets that a ranking draws."""
MAX_PLANETS = 1_000_000


class CountedPlanetsQuestion(shared.KnownPlanetsQuestion):
    """A question about the planets that completeness counts: of a population, or known ones."""

    planet: shared.ReferencePlanet = shared.asked_planet()
    population: PopulationConfig = asked(
        load_population,
        "Planets that completeness refers to: giants, jupiters, solar_system, or a YAML file.",
        read=load_population,
        unset="giants",
        accepts="PopulationConfig, mapping, str or Path",
    )
    n_planets: int = asked(
        N_PLANETS,
        "Planets drawn from the population, or draws of each known planet.",
        ge=1,
        le=MAX_PLANETS,
        option="--planets",
    )

    def check_planets(self) -> None:
        """Refuse a population beside known planets."""
        if self.known_planets is not None and "population" in self.model_fields_set:
            taken, hint = (
                f"given with {called('known_planets')}",
                "known planets stand instead of a hypothetical population",
            )
            raise InputError("population", taken, allowed="one of the two", hint=hint)


class RankedQuestion(shared.InstrumentQuestion, shared.CutsQuestion, CountedPlanetsQuestion):
    """What a ranking of stars is asked."""

    time_s: float = asked(
        shared.DEFAULT_TIME_S, "Wall time per target and band, readouts and reference frames included.", ge=1e-3, le=1e9
    )
    seed: shared.Seed = asked(1, "Seed of every random number.")
    score: ScoreName = asked(DEFAULT_SCORE, "What the ranking is by.")

    @model_validator(mode="after")
    def _one_kind_of_planets(self) -> Self:
        self.check_planets()
        return self


class RankQuestion(RankedQuestion):
    """Rank the whole catalogue."""

    KIND: ClassVar[str] = "rank"

    strategy: shared.Strategy = shared.asked_strategy()
