"""The question of ``cpic rank``: which stars promise most."""

from typing import Any, ClassVar, Self

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
EXCLUSIONS = ("rv", "stability", "known_giants")
"""What can exclude planets: velocities of the star, its companion star, and its giant planets."""


def read_exclusions(given: Any) -> tuple[str, ...]:
    """Return names of `EXCLUSIONS` from what people write: some of them, or ``none`` alone.

    Raises
    ------
    InputError
        For another name, or ``none`` beside one.
    """
    names = shared.several(given)
    for name in names:
        if name not in (*EXCLUSIONS, "none") or (name == "none" and len(names) > 1):
            allowed = f"{', '.join(EXCLUSIONS)}, one or several, or none alone"
            raise InputError("exclusions", name, allowed=allowed)
    return tuple(name for name in EXCLUSIONS if name in names)


def asked_exclusions(default: tuple[str, ...] | None = EXCLUSIONS, **settings: Any) -> Any:
    """Declare the field of what excludes planets; ``settings`` as of `asked`."""
    return asked(
        default,
        "What excludes planets of the population: rv (radial velocities would have shown them), stability (a companion "
        "star leaves them no orbit), known_giants (a known giant stands there), or none. Repeat for several.",
        read=read_exclusions,
        accepts="str or sequence of str",
        **settings,
    )


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
    exclusions: shared.Texts = asked_exclusions()

    def check_planets(self) -> None:
        """Refuse a population, and what excludes its planets, beside known planets; and candidates without them."""
        for name in ("population", "exclusions"):
            if self.known_planets is not None and name in self.model_fields_set:
                taken = f"given with {called('known_planets')}"
                hint = "known planets stand instead of a hypothetical population"
                raise InputError(name, taken, allowed="one of the two", hint=hint)
        if self.known_planets is None and self.candidates:
            raise InputError("candidates", "given", allowed=f"only with {called('known_planets')}")


class RankedQuestion(shared.InstrumentQuestion, shared.CutsQuestion, CountedPlanetsQuestion):
    """What a ranking of stars is asked."""

    time_s: float = asked(
        shared.DEFAULT_TIME_S,
        "Wall time of all visits per target and band, readouts, reference frames and overheads included.",
        ge=1e-3,
        le=1e9,
    )
    visit_time_s: float | None = asked(
        None, "Wall time of one visit with its references and overhead; with {visits} it sets {time_s}."
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
