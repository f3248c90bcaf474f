"""What visits of a star are worth: expected detections of the planets drawn for planning, visit after visit.

The greedy schedule: the visits of most expected detections per hour, with a look ahead, into the calendar.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from cpic_core import BoolArray, FloatArray
from cpic_planner.survey.candidates import Candidate
from cpic_planner.survey.strategy import SurveyStrategy

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
        """Before any visit.

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
        """After a set of visits.

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
        """After one more visit."""
        option, slot = visit
        p = self.star.chance[option, slot].astype(np.float64)
        w = self.star.weight
        gain, upper = float((w * p) @ self.counts[-1]), float((w * p) @ self.counts.sum(axis=0)) / self.needed
        counts = self.counts * (1.0 - p)
        counts[1:] += self.counts[:-1] * p
        return StarValue(self.star, self.needed, counts, self.value + gain, self.upper + upper)

    def gains(self) -> tuple[FloatArray, FloatArray]:
        """What one more visit adds to `V` and to `U`, for every option and slot, shape ``(o, b)``."""
        chance, w = self.star.chance, self.star.weight
        return chance @ (w * self.counts[-1]), chance @ (w * self.counts.sum(axis=0)) / self.needed


_ROUNDING = 1e-9


@dataclass(frozen=True)
class Problem:
    """What is to be scheduled.

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
        """Telescope time of one visit of the star at a position."""
        return float(self.stars[star].cost_h[visit])

    def near(self, star: Candidate, slot: int) -> BoolArray:
        """Slots too near to one for another visit of the same star, itself among them.

        Parameters
        ----------
        star : Candidate
        slot : int
            Slot of the visit.
        """
        near = np.abs(star.day - star.day[slot]) < self.strategy.revisits.min_gap_days - _ROUNDING
        near[slot] = True
        return np.asarray(near)

    def groups(self) -> tuple[list[int], ...]:
        """Stars that are served before all others (known planets, where they come first), and the rest."""
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
        """All of a strategy's time, less that of visits of stars.

        Parameters
        ----------
        problem : Problem
        booked : iterable of (star, visit), optional
        """
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
        """Which costs ``(..., b)`` still fit."""
        return np.asarray((cost_h <= self.slots_h + _ROUNDING) & (cost_h <= self.budget_h + _ROUNDING))


@dataclass(frozen=True)
class _Bundle:
    """Visits of one star that are weighed together."""

    visits: tuple[Visit, ...]
    gains: tuple[float, ...]
    cost_h: float
    density: float


def greedy(problem: Problem, *, room: Room | None = None) -> tuple[Room, list[tuple[int, Visit, float]]]:
    """Fill the calendar.

    Again and again the bundle of most value per hour is booked: the best next visit of a star, or the best two, up to
    ``look_ahead`` of them, each in the slot where it adds most; where a detection needs several visits, bundles of any
    length. Stars that come first (known planets) are served until
    they have nothing more to give.

    Parameters
    ----------
    problem : Problem
    room : Room, optional
        Time that is left, with what is booked already; all of it by default.

    Returns
    -------
    room : Room
    booked : list of (star, visit, gain)
        In the order of booking.
    """
    room = Room.of(problem) if room is None else room
    stars = problem.stars
    states = {i: StarValue.of(star, problem.needed, room.visits.get(i, ())) for i, star in enumerate(stars)}
    bundles: dict[int, _Bundle | None] = {}
    booked: list[tuple[int, Visit, float]] = []
    for group in problem.groups():
        while True:
            for i in group:
                bundle = bundles.get(i)
                if i not in bundles or (bundle is not None and not _fits(bundle, stars[i], room)):
                    bundles[i] = _best_bundle(problem, states[i], room, i)
            ready = [(bundle.density, -i) for i in group if (bundle := bundles[i]) is not None]
            if not ready:
                break
            i = -max(ready)[1]
            chosen = bundles.pop(i)
            assert chosen is not None
            for visit, gain in zip(chosen.visits, chosen.gains, strict=True):
                room.take(i, visit, problem.cost_h(i, visit))
                states[i] = states[i].after(visit)
                booked.append((i, visit, gain))
    return room, booked


def _fits(bundle: _Bundle, star: Candidate, room: Room) -> bool:
    """Whether the calendar still holds a bundle: other stars may have taken its slots."""
    left = room.slots_h.copy()
    for visit in bundle.visits:
        left[visit[1]] -= star.cost_h[visit]
    enough = bool(left[[slot for _, slot in bundle.visits]].min() >= -_ROUNDING)
    return enough and bundle.cost_h <= room.budget_h + _ROUNDING


def _best_bundle(problem: Problem, state: StarValue, room: Room, star: int) -> _Bundle | None:
    """Return the next visits of a star that give most per hour together; None where none is worth its time."""
    found = _grown(problem, state, room, star, ())
    if state.needed > 1 and not room.visits.get(star):
        # The best single visits may leave no time or slot for as many as a detection needs.
        starts = [start for surest in (True, False) if (start := _surest(problem, state, room, star, surest))]
        for other in [_grown(problem, state, room, star, start) for start in starts]:
            if other is not None and (found is None or other.density > found.density):
                found = other
    return found


def _grown(problem: Problem, state: StarValue, room: Room, star: int, first: Sequence[Visit]) -> _Bundle | None:
    """Return the best bundle that begins with some visits and goes on with that of most value per hour.

    Where one detection is enough, each visit adds less than the one before: as many are weighed as the strategy looks
    ahead. Where several are needed, the first visits add nothing and later ones more and more: bundles of all lengths
    are weighed, until the value per hour has fallen for as many visits as a detection needs.
    """
    own, needed = list(room.visits.get(star, ())), state.needed
    trial = Room(room.budget_h, room.slots_h.copy(), {star: own})
    best: _Bundle | None = None
    visits: list[Visit] = []
    gains: list[float] = []
    cost = value = 0.0
    length = problem.strategy.scheduler.look_ahead if needed == 1 else state.star.visits_left
    for k in range(min(length, state.star.visits_left - len(own))):
        visit = first[k] if k < len(first) else _next_visit(problem, state, trial, [*own, *visits])
        if visit is None:
            break
        after = state.after(visit)
        gains.append(after.value - state.value)
        value += gains[-1]
        state, spent = after, float(state.star.cost_h[visit])
        cost += spent
        trial.budget_h -= spent
        trial.slots_h[visit[1]] -= spent
        visits.append(visit)
        worthwhile = value >= problem.strategy.scheduler.min_gain * len(visits) and value > 0.0
        if worthwhile and (best is None or value / cost > best.density):
            best = _Bundle(tuple(visits), tuple(gains), cost, value / cost)
        if needed > 1 and best is not None and len(visits) >= len(best.visits) + needed:
            break
    return best


def _surest(problem: Problem, state: StarValue, room: Room, star: int, surest: bool) -> tuple[Visit, ...]:
    """Return just as many visits as a detection needs that show one planet in each of them; none where none can.

    Of all sets of visits with their gaps, found slot after slot for every planet by itself: the ``surest`` one, or the
    cheapest. There is a calendar that is worth anything exactly where the cheapest set fits into the budget.
    """
    item, needed = state.star, state.needed
    chance = np.where(room.holds(item.cost_h)[..., None], item.chance, 0.0) * (item.weight > 0.0)
    if min(needed, item.visits_left) < needed or not chance.any():
        return ()
    with np.errstate(divide="ignore"):
        score = np.log(chance) if surest else np.where(chance > 0.0, -item.cost_h[..., None], -np.inf)
    order = np.argsort(item.day, kind="stable")
    day, gap = item.day[order], problem.strategy.revisits.min_gap_days - _ROUNDING
    # Slots before each one that are far enough away; never itself.
    before = np.minimum(np.searchsorted(day, day - gap, side="right"), np.arange(len(day)))
    of_slot = score.max(axis=0)[order]
    best = np.full((needed + 1, len(day) + 1, score.shape[-1]), -np.inf)
    best[0] = 0.0
    for count in range(1, needed + 1):
        for slot in range(len(day)):
            best[count, slot + 1] = np.maximum(best[count, slot], best[count - 1, before[slot]] + of_slot[slot])
    end = best[needed, -1]
    worth = np.log(np.maximum(item.weight, np.finfo(float).tiny)) + end if surest else end
    planet = int(np.argmax(worth))
    if not np.isfinite(end[planet]):
        return ()
    made: list[Visit] = []
    count, slot = needed, len(day)
    while count:
        if best[count, slot, planet] > best[count, slot - 1, planet]:
            made.append((int(np.argmax(score[:, order[slot - 1], planet])), int(order[slot - 1])))
            count, slot = count - 1, int(before[slot - 1])
        else:
            slot -= 1
    cost = sum(float(item.cost_h[visit]) for visit in made)
    return tuple(made[::-1]) if cost <= room.budget_h + _ROUNDING else ()


def _next_visit(problem: Problem, state: StarValue, room: Room, made: Sequence[Visit]) -> Visit | None:
    """The visit that adds most per hour, of those worth the least that a visit has to be; the earliest of equals."""
    cost = np.where(room.holds(state.star.cost_h), state.star.cost_h, np.inf)
    for _, taken in made:
        cost[:, problem.near(state.star, taken)] = np.inf
    value, upper = state.gains()
    if state.needed == 1:
        cost[value < problem.strategy.scheduler.min_gain] = np.inf
    with np.errstate(divide="ignore", invalid="ignore"):
        density = np.where(np.isfinite(cost), (value if state.needed == 1 else upper) / cost, 0.0)
    if density.max(initial=0.0) <= 0.0:
        return None
    slot, option = np.unravel_index(int(np.argmax(density.T)), density.T.shape)
    return int(option), int(slot)


def in_order(
    stars: Sequence[Candidate], booked: Sequence[tuple[int, Visit, float]], spare: Sequence[tuple[int, Visit, float]]
) -> tuple[PlannedVisit, ...]:
    """Visits in the order of the calendar: by slot, those within the budget first, then as booked.

    Parameters
    ----------
    stars : sequence of Candidate
    booked, spare : sequence of tuple
    """
    every = [(*item, False) for item in booked] + [(*item, True) for item in spare]
    numbers, planned = Counter[int](), []
    for star, visit, gain, reserve in sorted(every, key=lambda item: (item[1][1], item[3])):
        planned.append(PlannedVisit(star, *visit, numbers[star], float(stars[star].cost_h[visit]), gain, reserve))
        numbers[star] += 1
    return tuple(planned)
