"""Planets with which schedules are made, where they stand, and how likely visits are to show them."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from catalogs import KnownPlanetTable, OrbitPlaces
from cpic_core import BoolArray, FloatArray, IntArray, NDArray
from cpic_planner.etc import EtcModel
from cpic_planner.planets import PopulationConfig
from cpic_planner.survey.detection import Setting, detection_chance, expected_signals
from cpic_planner.survey.strategy import SurveyStrategy
from cpic_planner.survey.universe import NEW, PlanetSample, at_known_place, chance, draw_planet_sample, star_mass_msun
from cpic_planner.targets import Targets
from simulator.config import AlbedoSpec, MeasuredAlbedo, content_hash

if TYPE_CHECKING:
    from cpic_planner.survey.schedule import PlannedVisit, Problem

N_DRAWS, N_KNOWN = 2000, 500
"""Planets of each star, and draws of each known one, with which a schedule is made; its yield is that of others."""
_MOST_KEPT = 100
KNOWN_ALBEDO = MeasuredAlbedo(model="jupiter")


def albedos_of(population: PopulationConfig | None) -> tuple[AlbedoSpec, ...]:
    """Albedos by kind: those of the population, then that of known planets, Jupiter's."""
    own = () if population is None else tuple(kind.albedo for kind in population.mixture)
    return (*(spec for spec in own if spec is not None), KNOWN_ALBEDO)


def dust_of(
    strategy: SurveyStrategy, planets: PlanetSample, seed: int, star: str, block: int | str
) -> FloatArray | None:
    """Dust around a star in the universe of each planet, zodi; None where it is the same everywhere.

    Parameters
    ----------
    strategy : SurveyStrategy
    planets : PlanetSample
        Of that star.
    seed : int
    star : str
        Name, which with ``block`` names the random stream: all strategies see the same luck.
    block : int or str
        Number of the block of universes, or ``planning``.
    """
    law = strategy.assumptions.dust
    if law is None:
        return None
    n = int(planets.universe.max(initial=0)) + 1
    return law.zodis(chance(seed, "dust", star, block, shape=(n,)))[planets.universe]


@dataclass(frozen=True, eq=False)
class Host:
    """A star with what may be found there: new planets of a population, and known ones.

    Attributes
    ----------
    star : Targets
        One star.
    population : PopulationConfig or None
        None: known planets alone.
    known : KnownPlanetTable or None
    known_rows : tuple of int
        Rows of the star's planets in that table.
    """

    star: Targets
    population: PopulationConfig | None
    known: KnownPlanetTable | None
    known_rows: tuple[int, ...]

    def content(self) -> dict[str, Any]:
        """Everything that decides its planets and their light; known planets by what their published orbits say."""
        orbits = [] if self.known is None else [self.known.orbits_of(row).columns for row in self.known_rows]
        return {
            "star": self.star.content(),
            "population": None if self.population is None else self.population.content(),
            "known": [{name: cells.astype(str).tolist() for name, cells in rows.items()} for rows in orbits],
            "rows": list(self.known_rows),
        }


@dataclass(frozen=True, eq=False)
class Looks:
    """Visits that a star can have.

    Attributes
    ----------
    options : tuple of Setting
        Ways to make a visit: band and time.
    open : ndarray of bool, shape (o, b)
        Slots in which each is possible.
    day, roll_deg : ndarray, shape (b,)
        When a visit in each slot takes place, after the start, and the roll of the first one there.
    """

    options: tuple[Setting, ...]
    open: BoolArray
    day: FloatArray
    roll_deg: FloatArray


@dataclass(frozen=True, eq=False)
class Shown:
    """What visits of a star are likely to show.

    Attributes
    ----------
    planets : PlanetSample
        All planets drawn that any date can show.
    seen : ndarray of int, shape (m,)
        Those of them that a visit can show.
    chance : ndarray, shape (o, b, m)
        Probability that a visit in a slot detects each of these.
    """

    planets: PlanetSample
    seen: IntArray
    chance: NDArray[np.float32]


class PlanningSky:
    """Planets with which schedules are made, and what visits show of them.

    Planets and their places are kept for the next strategy, chances for the same strategy where it is planned again
    with other facts about some stars (`cpic_planner.survey.facts`).

    Parameters
    ----------
    seed : int
    reach_arcsec : tuple of float
        Separations between which any band shows a planet; others are left out.
    """

    def __init__(self, seed: int, reach_arcsec: tuple[float, float]) -> None:
        self.seed = seed
        self._reach = reach_arcsec
        self._kept: dict[Hashable, tuple[PlanetSample, OrbitPlaces]] = {}
        self._shown: dict[Hashable, Shown] = {}

    def of(self, host: Host, epoch_mjd: float, days: FloatArray) -> tuple[PlanetSample, OrbitPlaces]:
        """Planets of one star, `N_DRAWS` new ones and `N_KNOWN` draws of each known one, and their places by day.

        Parameters
        ----------
        host : Host
        epoch_mjd : float
            Start of the survey.
        days : ndarray
            Days after it.
        """
        key = content_hash(host.content()), epoch_mjd, days.tobytes()
        if key not in self._kept:
            star = host.star
            who = str(star.name[0]), float(star_mass_msun(star)[0]), float(star.luminosity_lsun[0])
            draw = partial(draw_planet_sample, *who, epoch_mjd=epoch_mjd, seed=self.seed, stage="planning")
            parts = []
            if host.known is not None and host.known_rows:
                body = draw(None, known=host.known, known_rows=host.known_rows, n=N_KNOWN)
                behind = 0 if host.population is None else len(host.population.mixture)
                parts.append(replace(body, kind=np.full(len(body), behind)))
            if host.population is not None:
                parts.append(draw(host.population, n=N_DRAWS, one_each=True))
            planets = PlanetSample.joined(parts)
            distance = float(star.distance_pc[0])
            planets = planets.select(planets.within(*(edge * distance for edge in self._reach)))
            if len(self._kept) >= _MOST_KEPT:
                self._kept.clear()
            self._kept[key] = (planets, planets.places(days))
        return self._kept[key]

    def shown(self, strategy: SurveyStrategy, model: EtcModel, host: Host, looks: Looks, epoch_mjd: float) -> Shown:
        """What the visits that a star can have are likely to show.

        Parameters
        ----------
        strategy : SurveyStrategy
            Its name stands for its rules in what is kept.
        model : EtcModel
            That of the strategy.
        host : Host
        looks : Looks
        epoch_mjd : float
            Start of the survey.
        """
        visits = looks.options, looks.open.tobytes(), looks.day.tobytes(), looks.roll_deg.tobytes()
        key = strategy.name, content_hash(host.content()), visits, epoch_mjd
        if key not in self._shown:
            planets, places = self.of(host, epoch_mjd, looks.day)
            odds = np.zeros((*looks.open.shape, len(planets)), np.float32)
            rule, placed = strategy.detection, at_known_place(planets, host.known)
            zodis = dust_of(strategy, planets, self.seed, str(host.star.name[0]), "planning")
            for o, option in enumerate(looks.options):
                slots = np.flatnonzero(looks.open[o])
                if slots.size == 0:
                    continue
                there = OrbitPlaces(*(getattr(places, name)[slots] for name in OrbitPlaces.__dataclass_fields__))
                albedos, roll = albedos_of(host.population), looks.roll_deg[slots]
                signals = expected_signals(model, host.star, option, planets, albedos, there, roll, zodis)
                odds[o, slots] = detection_chance(signals, rule, placed, calibration=rule.calibration)
            seen = np.flatnonzero((odds > 0.0).any(axis=(0, 1)))
            self._shown[key] = Shown(planets, seen, odds[:, :, seen])
        return self._shown[key]


@dataclass(frozen=True)
class VisitOdds:
    """What a planned visit is likely to bring.

    Attributes
    ----------
    probability : float
        That it completes the detection of at least one planet.
    known : bool
        Whether that is more likely of a known planet than of a new one.
    """

    probability: float
    known: bool


def visit_odds(problem: Problem, visits: Iterable[PlannedVisit]) -> tuple[VisitOdds, ...]:
    """Return the odds of visits in the order of time, the star's earlier ones made as planned.

    Parameters
    ----------
    problem : Problem
        With the planets that the schedule was made with.
    visits : iterable of PlannedVisit
        In the order of time; what a reserve visit would show is taken from no later one.

    Notes
    -----
    With ``p`` the chance that the visit detects a planet and ``c`` that earlier visits have brought it to one detection
    less than it needs, each draw of a new planet stands for a Poisson number of mean ``w``, of which the visit
    completes ``mu = sum w p c``; those of a known planet add up to the probability ``q`` that it is completed. The
    probability of at least one is ``1 - exp(-mu) product(1 - q)``.
    """
    strategy, found = problem.strategy, []
    states: dict[int, FloatArray] = {}
    for visit in visits:
        star = problem.stars[visit.star]
        counts = states.setdefault(visit.star, np.eye(problem.needed, 1) * np.ones(len(star.weight)))
        chance = star.chance[visit.option, visit.slot].astype(np.float64)
        new = star.known == NEW
        # The scheduler's weights hold what a planet is worth to it; how likely it is does not.
        weight = star.weight / np.where(new, strategy.value_new, strategy.value_known)
        completed = weight * chance * counts[-1]
        each = [min(float(completed[star.known == row].sum()), 1.0) for row in np.unique(star.known[~new])]
        none_new, none_known = math.exp(-float(completed[new].sum())), math.prod(1.0 - item for item in each)
        found.append(VisitOdds(1.0 - none_new * none_known, none_known < none_new))
        if not visit.reserve:
            after = counts * (1.0 - chance)
            after[1:] += counts[:-1] * chance
            states[visit.star] = after
    return tuple(found)
