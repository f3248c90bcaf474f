"""What a survey spends and finds, event after event."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cpic_core import BoolArray, FloatArray, IntArray
from cpic_planner.survey.schedule import PlannedVisit
from cpic_planner.survey.universe import NEW, PlanetSample

if TYPE_CHECKING:
    from cpic_planner.survey.simulate import StarHistory, Survey

ROUNDING_H = 1e-9
_OF_BODY = ("radius_rjup", "semi_major_axis_au", "eccentricity", "inclination_deg")
_OF_VISIT = (
    "margin",
    "chance",
    "snr",
    "contrast",
    "separation_arcsec",
    "pa_deg",
    "roll_deg",
    "distance_au",
    "phase_deg",
)


@dataclass(eq=False)
class Clock:
    """Time of ``n`` universes, hours."""

    left: FloatArray
    slot: FloatArray
    promised: FloatArray
    search: FloatArray
    follow: FloatArray
    visits: IntArray

    @classmethod
    def of(cls, n: int, budget_h: float, promised_h: float) -> Clock:
        """Return the start of ``n`` universes: whole budget, and what planned visits will take of it."""
        zero = np.zeros(n)
        return cls(
            np.full(n, budget_h), zero.copy(), np.full(n, promised_h), zero.copy(), zero.copy(), np.zeros(n, np.int64)
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
        """Time of search and follow-up so far."""
        return self.search + self.follow


@dataclass(frozen=True, eq=False)
class SurveyTables:
    """What happened in ``n`` universes; ``universes``, ``detections`` and ``stars`` are columns of tables."""

    universes: dict[str, NDArray[Any]]
    detections: dict[str, NDArray[Any]]
    stars: dict[str, NDArray[Any]]


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
        count = int(new.sum())
        part: dict[str, Any] = {
            "universe": planets.universe[new],
            "planet": planets.number[new],
            "known_row": planets.known[new],
            "kind": planets.kind[new],
            "star": np.full(count, visit.star),
            "option": np.full(count, visit.option),
            "ordinal": np.full(count, visit.ordinal),
            "day": np.full(count, day),
            "used_h": used_h[planets.universe[new]],
        }
        part |= {name: getattr(planets, name)[new] for name in _OF_BODY}
        part |= {name: seen[name][new] for name in _OF_VISIT}
        self._parts.append(part)

    def columns(self, survey: Survey) -> dict[str, NDArray[Any]]:
        """Columns of the table of detections, names instead of positions."""
        names = (
            "universe",
            "planet",
            "known_row",
            "kind",
            "star",
            "option",
            "ordinal",
            "day",
            "used_h",
            *_OF_BODY,
            *_OF_VISIT,
        )
        kinds = dict.fromkeys(names[:7], np.int64)
        joined: dict[str, NDArray[Any]] = {
            name: np.concatenate([np.zeros(0), *(part[name] for part in self._parts)]).astype(kinds.get(name, float))
            for name in names
        }
        option, star = joined["option"], joined.pop("star")
        joined["star"] = np.array([str(survey.targets.name[i]) for i in star], object)
        joined["band"] = np.array([survey.options[i][o].band for i, o in zip(star, option, strict=True)], object)
        return joined

    def outcome(self, survey: Survey, stars: Mapping[int, StarHistory], clock: Clock, block: int) -> SurveyTables:
        """Return the columns of the three tables.

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
        new, known, characterised, with_planet = np.zeros((4, n), np.int64)
        rows = sorted(stars)
        of_star = np.zeros((2, len(rows)), np.int64)
        for row, i in enumerate(rows):
            star = stars[i]
            universe, fresh = star.planets.universe, star.planets.known == NEW
            kinds = zip((new, known), of_star, (star.found & fresh, star.found & ~fresh), strict=True)
            for count, total, found in kinds:
                np.add.at(count, universe[found], 1)
                total[row] = found.sum()
            if survey.strategy.follow_up.wanted:
                np.add.at(characterised, universe[star.found & star.shown.all(axis=0)], 1)
            some = np.zeros(n, bool)
            some[universe[star.found]] = True
            with_planet += some
        universes = {
            "new_planets": new,
            "known_planets": known,
            "stars_with_planet": with_planet,
            "characterised_planets": characterised,
            "noise_alarms": self.noise_alarms,
            "background_alarms": self.background_alarms,
            "visits": clock.visits,
            "search_h": clock.search,
            "follow_up_h": clock.follow,
        }
        per_star: dict[str, NDArray[Any]] = {
            "star": np.array([str(survey.targets.name[i]) for i in rows], object),
            "block": np.full(len(rows), block, np.int64),
            "universes": np.full(len(rows), n, np.int64),
            "visits": np.array([stars[i].visits for i in rows], np.int64),
            "search_h": np.array([stars[i].hours for i in rows]),
            "follow_up_h": np.array([stars[i].follow_h for i in rows]),
            "new_planets": of_star[0],
            "known_planets": of_star[1],
        }
        return SurveyTables(universes, self.columns(survey), per_star)
