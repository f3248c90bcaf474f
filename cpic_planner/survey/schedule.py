"""The problem that a scheduler solves, the worth of visits of a star, and the calendar that results.

Visits are worth the detections expected of the planets drawn for planning, and what a strategy gives for their orbits.
"""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from cpic_core import BoolArray, FloatArray
from cpic_planner.survey.candidates import Candidate
from cpic_planner.survey.strategy import SurveyStrategy
from cpic_planner.survey.universe import NEW

Visit = tuple[int, int]
"""Option and slot."""


@dataclass(frozen=True, eq=False)
class StarValue:
    """Value of a star after some visits.

    ``counts[c]`` is the probability that each planet was detected ``c`` times so far, for ``c`` below the number of
    detections that are needed.

    Notes
    -----
    A planet counts once it has been detected ``k`` times: the value of a set of visits is ``V = sum w P(count >= k)``.
    ``U = sum w E[min(count, k)] / k`` is at least as large, equal for ``k = 1``, and has diminishing returns (it is
    monotone and submodular), which `V` lacks for ``k > 1``: bounds are made of `U`.
    """

    star: Candidate
    needed: int
    counts: FloatArray
    value: float
    upper: float

    @classmethod
    def none(cls, star: Candidate, needed: int) -> "StarValue":
        """Return the state before any visit.

        Parameters
        ----------
        star : Candidate
        needed : int
            Detections that a planet needs.
        """
        counts = np.zeros((needed, len(star.weight)))
        counts[0] = 1.0
        return cls(star, needed, counts, 0.0, 0.0)

    @classmethod
    def of(cls, star: Candidate, needed: int, visits: Iterable[Visit]) -> "StarValue":
        """Return the state after a set of visits.

        Parameters
        ----------
        star : Candidate
        needed : int
            Detections that a planet needs.
        visits : iterable of Visit
        """
        state = cls.none(star, needed)
        for visit in visits:
            state = state.after(visit)
        return state

    def after(self, visit: Visit) -> "StarValue":
        """Return the state after one more visit."""
        option, slot = visit
        weight, shown = self.star.weight, self.counts * self.star.chance[option, slot]
        counts = self.counts - shown
        counts[1:] += shown[:-1]
        gain = upper = float(weight @ shown[-1])
        if self.needed > 1:
            upper = float(weight @ shown.sum(axis=0)) / self.needed
        return StarValue(self.star, self.needed, counts, self.value + gain, self.upper + upper)

    def gain(self) -> FloatArray:
        """Return what one more visit adds to `V`, for every option and slot, shape ``(o, b)``."""
        return np.asarray(self.star.chance @ (self.star.weight * self.counts[-1]))

    def gains(self) -> tuple[FloatArray, FloatArray]:
        """Return what one more visit adds to `V` and to `U`, for every option and slot, shape ``(o, b)``."""
        chance, w = self.star.chance, self.star.weight
        return self.gain(), chance @ (w * self.counts.sum(axis=0)) / self.needed


ROUNDING = 1e-9
"""Hours and days by which limits may be passed in sums of many."""


@dataclass(frozen=True)
class Problem:
    """The problem of a scheduler.

    ``slot_h`` are the lengths of the slots.
    """

    strategy: SurveyStrategy
    stars: tuple[Candidate, ...]
    slot_h: FloatArray

    @property
    def needed(self) -> int:
        """Detections that a planet needs."""
        return self.strategy.detection.visits_needed

    def cost_h(self, star: int, visit: Visit) -> float:
        """Return the telescope time of one visit of the star at a position."""
        return float(self.stars[star].cost_h[visit])

    def near(self, star: Candidate, slot: int) -> BoolArray:
        """Return the slots too near to one for another visit of the same star, itself among them.

        Parameters
        ----------
        star : Candidate
        slot : int
            Slot of the visit.
        """
        near = np.abs(star.day - star.day[slot]) < self.strategy.revisits.min_gap_days - ROUNDING
        near[slot] = True
        return np.asarray(near)

    def groups(self) -> tuple[list[int], ...]:
        """Return the stars that are served before all others (known planets, where they come first), and the rest."""
        wanted = self.strategy.targets.known_planets == "first"
        first = [i for i, star in enumerate(self.stars) if wanted and star.known_rows]
        rest = [i for i in range(len(self.stars)) if i not in first]
        return tuple(group for group in (first, rest) if group)


@dataclass(frozen=True)
class PlannedVisit:
    """One visit of the calendar.

    ``star`` is the position among the candidates, ``ordinal`` the visit's number among those of its star, ``reserve``
    whether it is made only where others have freed the time for it.
    """

    star: int
    option: int
    slot: int
    ordinal: int
    cost_h: float
    gain: float
    reserve: bool


@dataclass(frozen=True)
class Schedule:
    """A calendar of visits and what it promises.

    ``value`` is what the visits within the budget are worth on the planets of planning, ``bound`` what no schedule can
    pass, ``method`` who made it.
    """

    visits: tuple[PlannedVisit, ...]
    value: float
    bound: float
    method: str

    @property
    def distance(self) -> float:
        """How far below the bound the value may be, relative; 0 where nothing can be gained."""
        return max(0.0, 1.0 - self.value / self.bound) if self.bound > 0 else 0.0


@dataclass
class Room:
    """Time that is left while a schedule is made, in hours."""

    budget_h: float
    slots_h: FloatArray
    visits: dict[int, list[Visit]] = field(default_factory=dict)

    @classmethod
    def of(cls, problem: Problem, booked: Iterable[tuple[int, Visit]] = ()) -> "Room":
        """Return all of a strategy's time, less that of visits of stars."""
        room = cls(problem.strategy.time_budget_h, problem.strategy.slot_share * problem.slot_h)
        for star, visit in booked:
            room.take(star, visit, problem.cost_h(star, visit))
        return room

    def take(self, star: int, visit: Visit, cost_h: float) -> None:
        """Book a visit.

        Parameters
        ----------
        star : int
            Position of the star.
        visit : Visit
        cost_h : float
            Cost of the visit, h.
        """
        self.budget_h -= cost_h
        self.slots_h[visit[1]] -= cost_h
        self.visits.setdefault(star, []).append(visit)

    def holds(self, cost_h: FloatArray) -> BoolArray:
        """Return which costs ``(..., b)`` still fit."""
        return np.asarray((cost_h <= self.slots_h + ROUNDING) & (cost_h <= self.budget_h + ROUNDING))


def in_order(
    stars: Sequence[Candidate], booked: Sequence[tuple[int, Visit, float]], spare: Sequence[tuple[int, Visit, float]]
) -> tuple[PlannedVisit, ...]:
    """Return the visits in the order of the calendar: by slot, those within the budget first, then as booked."""
    every = [(*item, False) for item in booked] + [(*item, True) for item in spare]
    numbers, planned = Counter[int](), []
    for star, visit, gain, reserve in sorted(every, key=lambda item: (item[1][1], item[3])):
        planned.append(PlannedVisit(star, *visit, numbers[star], float(stars[star].cost_h[visit]), gain, reserve))
        numbers[star] += 1
    return tuple(planned)


@dataclass(frozen=True)
class VisitOdds:
    """The probable results of a planned visit.

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
        star = problem.stars[visit.star].detections
        counts = states.setdefault(visit.star, np.eye(problem.needed, 1) * np.ones(len(star.weight)))
        chance = star.chance[visit.option, visit.slot]
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
