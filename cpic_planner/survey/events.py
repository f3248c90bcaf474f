"""Tables of a survey's results: what it spends and finds, event after event; fields of a row are the columns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cpic_core import BoolArray, FloatArray, IntArray, NDArray
from cpic_planner.results import Row, column, columns_of
from cpic_planner.survey.orbits import FoundOrbits, found_orbits
from cpic_planner.survey.schedule import PlannedVisit
from cpic_planner.survey.store import Table
from cpic_planner.survey.universe import NEW, PlanetSample

if TYPE_CHECKING:
    from cpic_planner.survey.history import StarHistory
    from cpic_planner.survey.simulate import Survey

ROUNDING_H = 1e-9
PLANETS = ("new_planets", "known_planets")
"""Columns that add up to the planets found."""
HOURS = ("search_h", "follow_up_h", "alarm_h")
"""Columns that add up to the telescope time used."""


class UniverseRow(Row):
    """One universe of a strategy."""

    strategy: str = column("name of the strategy")
    universe: int = column("number of the universe, the same sky for every strategy")
    new_planets: int = column("planets found that nobody knew")
    new_planets_unconditional: int = column(
        "the same of the whole population, had nobody looked before: with planets that velocities, stability and known "
        "giants exclude, in the same visits"
    )
    known_planets: int = column("known planets seen")
    stars_with_planet: int = column("stars with a planet found")
    characterised_planets: int = column("planets found and seen in every band of the follow-up")
    orbits_known: int = column("planets found whose orbit is known, what is published and logged included")
    confirmed_planets: int = column("planets found where a published orbit has them, or seen again in another visit")
    noise_alarms: int = column("noise taken for a planet")
    background_alarms: int = column("background stars taken for a planet")
    visits: int = column("visits made")
    search_h: float = column("telescope time of the search")
    follow_up_h: float = column("telescope time of follow-up, visits for orbits, and second visits of true candidates")
    alarm_h: float = column("telescope time of visits that only false alarms asked for")


class DetectionRow(Row):
    """One planet that a strategy finds in one universe."""

    strategy: str = column("name of the strategy")
    universe: int = column("number of the universe")
    star: str = column("name in the catalogue")
    planet: int = column("number of the planet around its star, known ones first")
    known_row: int = column("row in the table of known planets, -1 for a new planet")
    kind: int = column("number of the planet's kind in the population; the last one is that of known planets")
    ordinal: int = column("number of the visit among those of its star")
    option: int = column("way to visit the star: number of its frames")
    band: str = column("band of the visit")
    day: float = column("since the start of the survey", unit="d")
    used_h: float = column("telescope time used by then")
    radius_rjup: float = column("radius")
    semi_major_axis_au: float = column("of the orbit")
    eccentricity: float = column("of the orbit")
    inclination_deg: float = column("of the orbit")
    margin: float = column("predicted significance over threshold")
    chance: float = column("probability that this visit detects it")
    snr: float = column("predicted photometric SNR")
    contrast: float = column("true planet-to-star ratio of detected rates")
    separation_arcsec: float = column("projected")
    pa_deg: float = column("position angle, east of north")
    roll_deg: float = column("position angle of the detector's +y axis")
    distance_au: float = column("true distance from the star")
    phase_deg: float = column("star-planet-observer")
    exozodi_zodis: float = column("dust around the star, in solar systems")


class StarRow(Row):
    """The visits and findings of a strategy at one star in one block of universes."""

    strategy: str = column("name of the strategy")
    star: str = column("name in the catalogue")
    block: int = column("block of universes that the sums run over")
    universes: int = column("universes of the block")
    visits: int = column("visits of the search, sum")
    search_h: float = column("telescope time of the search, sum")
    follow_up_h: float = column("telescope time of the follow-up, sum")
    alarm_h: float = column("telescope time of visits that only false alarms asked for, sum")
    new_planets: int = column("planets found that nobody knew, sum")
    new_planets_unconditional: int = column("the same with the planets that are excluded, sum")
    known_planets: int = column("known planets seen, sum")
    orbits_known: int = column("planets whose orbit is known, sum")


class OrbitRow(Row):
    """The orbit of one planet that a strategy finds in one universe, with enough positions; errors are 1 sigma."""

    strategy: str = column("name of the strategy")
    universe: int = column("number of the universe")
    star: str = column("name in the catalogue")
    planet: int = column("number of the planet around its star, known ones first")
    epochs: int = column("positions: visits of search, follow-up and the observation log that show it")
    arc_periods: float = column("from the first position to the last, in periods of the planet")
    axis_error: float = column("of the semi-major axis, relative")
    period_error: float = column("relative")
    eccentricity_error: float = column("of the eccentricity")
    inclination_error_deg: float = column("of the inclination")
    next_day: float = column("next window of the star, since the start of the survey", unit="d")
    place_error_arcsec: float = column("of the predicted place then, rms distance")
    place_error_lambda_d: float = column("the same, in lambda/D of the last band that showed it")
    orbit_known: bool = column("whether both errors are within the rule of the strategy")


TABLES = (
    Table("universes", columns_of(UniverseRow), key=("strategy", "universe")),
    Table("detections", columns_of(DetectionRow), key=("strategy", "universe", "star", "planet")),
    Table("stars", columns_of(StarRow), key=("strategy", "star", "block")),
    Table("orbits", columns_of(OrbitRow), key=("strategy", "universe", "star", "planet")),
)
_DTYPES = {item.name: "int64" if item.dtype == "string" else item.dtype for item in columns_of(DetectionRow)}
"""Types of the columns of detections while they are counted, where a star is its position."""
_ORBIT_DTYPES = {item.name: object if item.dtype == "string" else item.dtype for item in columns_of(OrbitRow)}


@dataclass(eq=False)
class Clock:
    """Time of ``n`` universes, hours."""

    left: FloatArray
    slot: FloatArray
    promised: FloatArray
    search: FloatArray
    follow: FloatArray
    alarm: FloatArray
    visits: IntArray

    @classmethod
    def of(cls, n: int, budget_h: float, promised_h: float) -> Clock:
        """Return the start of ``n`` universes: whole budget, and what planned visits will take of it."""
        return cls(
            left=np.full(n, budget_h),
            slot=np.zeros(n),
            promised=np.full(n, promised_h),
            search=np.zeros(n),
            follow=np.zeros(n),
            alarm=np.zeros(n),
            visits=np.zeros(n, np.int64),
        )

    def affords(self, cost_h: float) -> BoolArray:
        """Return the universes whose slot and budget hold a cost."""
        return np.asarray((self.slot >= cost_h - ROUNDING_H) & (self.left >= cost_h - ROUNDING_H))

    def spend(self, go: BoolArray, cost_h: float, on: FloatArray) -> None:
        """Take the cost of one visit in the universes ``go`` from slot and budget, and note what it was spent on."""
        for account in (self.left, self.slot):
            account[go] -= cost_h
        on[go] += cost_h
        self.visits[go] += 1

    @property
    def used(self) -> FloatArray:
        """Time of search, follow-up and false alarms so far."""
        return self.search + self.follow + self.alarm


@dataclass(frozen=True, eq=False)
class SurveyTables:
    """The events in ``n`` universes; each field holds the columns of the table of its name."""

    universes: dict[str, NDArray[Any]]
    detections: dict[str, NDArray[Any]]
    stars: dict[str, NDArray[Any]]
    orbits: dict[str, NDArray[Any]]


class Events:
    """Detections and false alarms of ``n`` universes."""

    def __init__(self, n: int) -> None:
        self.noise_alarms = np.zeros(n, np.int64)
        self.background_alarms = np.zeros(n, np.int64)
        self._parts: list[dict[str, Any]] = []

    def alarms(self, go: BoolArray, noise: IntArray, background: IntArray) -> None:
        """Count the false alarms of a visit where it was made.

        Parameters
        ----------
        go : ndarray of bool
            Universes in which the visit is made, shape (n,).
        noise : ndarray of int
            False alarms by noise, shape (n,).
        background : ndarray of int
            False alarms by background stars, shape (n,).
        """
        self.noise_alarms[go] += noise[go]
        self.background_alarms[go] += background[go]

    def detections(
        self,
        planets: PlanetSample,
        new: BoolArray,
        visit: PlannedVisit,
        seen: Mapping[str, FloatArray],
        day: float,
        used_h: FloatArray,
    ) -> None:
        """Note the planets that a visit adds.

        Parameters
        ----------
        planets : PlanetSample
        new : ndarray of bool
            Which planets the visit adds.
        visit : PlannedVisit
        seen : mapping of str to ndarray
            What the visit shows of each planet, by name.
        day : float
            Day of the visit after the epoch.
        used_h : ndarray
            Hours used so far in each universe.
        """
        given: dict[str, Any] = vars(planets) | vars(visit) | dict(seen)
        given |= {"planet": planets.number, "known_row": planets.known, "day": day, "used_h": used_h[planets.universe]}
        names = [name for name in _DTYPES if name in given]
        self._parts.append({name: np.broadcast_to(given[name], new.shape)[new] for name in names})

    def columns(self, survey: Survey) -> dict[str, NDArray[Any]]:
        """Return the columns of the table of detections, names instead of positions."""
        joined: dict[str, NDArray[Any]] = {
            name: np.concatenate([np.zeros(0), *(part[name] for part in self._parts)]).astype(dtype)
            for name, dtype in _DTYPES.items()
            if name not in ("strategy", "band")
        }
        option, star = joined["option"], joined.pop("star")
        joined["star"] = np.array([str(survey.targets.name[i]) for i in star], object)
        joined["band"] = np.array([survey.options[i][o].band for i, o in zip(star, option, strict=True)], object)
        return joined

    @staticmethod
    def counts(stars: Mapping[int, StarHistory], clock: Clock) -> dict[str, NDArray[Any]]:
        """Return planets found, visits made and hours used in each universe."""
        found: dict[str, NDArray[Any]] = {name: np.zeros(len(clock.left), np.int64) for name in PLANETS}
        for star in stars.values():
            for name, new in zip(PLANETS, (True, False), strict=True):
                some = star.found & ((star.planets.known == NEW) == new)
                np.add.at(found[name], star.planets.universe[some], 1)
        return found | {"visits": clock.visits, "hours": clock.used}

    def outcome(self, survey: Survey, stars: Mapping[int, StarHistory], clock: Clock, block: int) -> SurveyTables:
        """Return the columns of the tables.

        Parameters
        ----------
        survey : Survey
        stars : mapping of int to StarHistory
            By position among the candidates.
        clock : Clock
        block : int
            Number of the block of universes.
        """
        n = len(clock.left)
        rows, orbits = [], []
        counted = (
            "new_planets",
            "new_planets_unconditional",
            "known_planets",
            "stars_with_planet",
            "characterised_planets",
            "orbits_known",
            "confirmed_planets",
        )
        universes: dict[str, NDArray[Any]] = {name: np.zeros(n, np.int64) for name in counted}
        for i, star in sorted(stars.items()):
            fresh = star.planets.known == NEW
            shown = star.counts >= survey.strategy.detection.visits_needed
            found = {"new_planets": star.found & fresh, "new_planets_unconditional": shown & fresh}
            found["known_planets"] = star.found & ~fresh
            own = found_orbits(survey, i, star, star.found)
            orbits.append(_orbit_columns(own, star.planets, str(survey.targets.name[i])))
            found["orbits_known"] = np.isin(np.arange(len(star.planets)), own.planet[own.known])
            numbers = [int(some.sum()) for some in found.values()]
            rows.append((str(survey.targets.name[i]), block, n, star.visits, *star.hours, *numbers))
            found["confirmed_planets"] = star.found & star.confirmed
            if survey.strategy.follow_up.wanted:
                found["characterised_planets"] = star.found & star.shown.all(axis=0)
            for name, some in found.items():
                np.add.at(universes[name], star.planets.universe[some], 1)
            universes["stars_with_planet"] += star.universes_of(star.found)
        universes |= {"noise_alarms": self.noise_alarms, "background_alarms": self.background_alarms}
        universes |= {"visits": clock.visits, "search_h": clock.search, "follow_up_h": clock.follow}
        universes["alarm_h"] = clock.alarm
        per_star = {
            item.name: np.array([row[k] for row in rows], object if item.dtype == "string" else item.dtype)
            for k, item in enumerate(columns_of(StarRow)[1:])
        }
        nothing = {item.name: np.zeros(0, _ORBIT_DTYPES[item.name]) for item in columns_of(OrbitRow)[1:]}
        joined = {name: np.concatenate([empty, *(own[name] for own in orbits)]) for name, empty in nothing.items()}
        return SurveyTables(universes, self.columns(survey), per_star, joined)


def _orbit_columns(orbits: FoundOrbits, planets: PlanetSample, star: str) -> dict[str, NDArray[Any]]:
    """Return the columns of the table of orbits for one star."""
    mine = planets.select(orbits.planet)
    given = vars(orbits.quality) | vars(orbits) | {"universe": mine.universe, "planet": mine.number}
    given |= {"star": np.full(len(mine), star, object), "orbit_known": orbits.known}
    return {item.name: given[item.name] for item in columns_of(OrbitRow)[1:]}


def rows_of(tables: SurveyTables, strategy: str, first_universe: int) -> dict[str, Mapping[str, NDArray[Any]]]:
    """Return the columns of all tables of one block, universes by their number in the survey."""
    n = len(tables.universes["visits"])
    found = tables.detections["universe"]
    columns = {
        "universes": tables.universes | {"universe": first_universe + np.arange(n)},
        "detections": tables.detections | {"universe": first_universe + found},
        "stars": tables.stars,
        "orbits": tables.orbits | {"universe": first_universe + tables.orbits["universe"]},
    }
    lengths = n, len(found), len(tables.stars["star"]), len(tables.orbits["star"])
    return {
        name: own | {"strategy": np.full(length, strategy, object)}
        for (name, own), length in zip(columns.items(), lengths, strict=True)
    }
