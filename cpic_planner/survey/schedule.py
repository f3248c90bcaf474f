"""The schedule of a strategy: which visits fill its calendar, and how far that may be from the best one.

Visits are worth the detections expected of the planets drawn for planning, and what a strategy gives for their orbits.
A greedy choice puts those of most value per hour, with a look ahead, into the calendar. Plans of single stars are then
made that pay at a price of telescope time, one is chosen for each star, and a bound says what no schedule can pass.
"""

import contextlib
import ctypes
import math
import os
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cpic_core import BoolArray, FloatArray, IntArray, Record, load_kernels
from cpic_planner.survey.candidates import Candidate
from cpic_planner.survey.strategy import SurveyStrategy
from cpic_planner.survey.universe import NEW

Visit = tuple[int, int]
"""Option and slot."""


class StarValue(Record, eq=False):
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


class Problem(Record):
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


class PlannedVisit(Record):
    """One visit of the calendar.

    ``star`` is the position among the candidates, ``ordinal`` the visit's number among those of its star, ``reserve``
    whether it is made only where others have freed the time for it. ``probability`` is that it completes the detection
    of at least one planet, ``known`` tells whether that is more likely of a known planet than of a new one
    (`with_odds`).
    """

    star: int
    option: int
    slot: int
    ordinal: int
    cost_h: float
    gain: float
    reserve: bool
    probability: float = 0.0
    known: bool = False


class Schedule(Record):
    """A calendar of visits and what it promises.

    ``value`` is what the visits within the budget are worth on the planets of planning, ``bound`` what no schedule can
    pass (infinite where none was asked for), ``method`` who made it.
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

    def after(self, problem: Problem, made: Mapping[int, Sequence[Visit]] | None = None) -> "Room":
        """Return a copy, less the time of visits of stars."""
        left = Room(self.budget_h, self.slots_h.copy())
        for star, visits in (made or {}).items():
            for visit in visits:
                left.take(star, visit, problem.cost_h(star, visit))
        return left

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


def with_odds(problem: Problem, visits: Iterable[PlannedVisit]) -> tuple[PlannedVisit, ...]:
    """Return visits with their odds, the star's earlier ones made as planned.

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
    states: dict[int, StarValue] = {}
    for visit in visits:
        star, way = problem.stars[visit.star].detections, (visit.option, visit.slot)
        state = states.get(visit.star) or StarValue.none(star, problem.needed)
        new = star.known == NEW
        # The scheduler's weights hold what a planet is worth to it; how likely it is does not.
        weight = star.weight / np.where(new, strategy.value_new, strategy.value_known)
        completed = weight * star.chance[way] * state.counts[-1]
        each = [min(float(completed[star.known == row].sum()), 1.0) for row in np.unique(star.known[~new])]
        none_new, none_known = math.exp(-float(completed[new].sum())), math.prod(1.0 - item for item in each)
        found.append(replace(visit, probability=1.0 - none_new * none_known, known=none_known < none_new))
        states[visit.star] = state if visit.reserve else state.after(way)
    return tuple(found)


class Plan(Record):
    """Visits of one star, with what they cost and are worth together."""

    visits: tuple[Visit, ...]
    cost_h: float
    value: float

    @property
    def density(self) -> float:
        """Value per hour."""
        return self.value / self.cost_h


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
    bundles: dict[int, Plan | None] = {}
    booked: list[tuple[int, Visit, float]] = []
    for group in problem.groups():
        while True:
            for i in group:
                bundle = bundles.get(i)
                if i not in bundles or (bundle is not None and not _fits(problem, room, {i: bundle.visits})):
                    bundles[i] = _best_bundle(problem, states[i], room, i)
            ready = [(bundle.density, -i) for i in group if (bundle := bundles[i]) is not None]
            if not ready:
                break
            i = -max(ready)[1]
            chosen = bundles.pop(i)
            assert chosen is not None
            for visit in chosen.visits:
                room.take(i, visit, problem.cost_h(i, visit))
                before, states[i] = states[i], states[i].after(visit)
                booked.append((i, visit, states[i].value - before.value))
    return room, booked


def _best_bundle(problem: Problem, state: StarValue, room: Room, star: int) -> Plan | None:
    """Return the next visits of a star that give most per hour together; None where none is worth its time.

    Each bundle goes on with the visit of most value per hour. Where one detection is enough, each visit adds less than
    the one before: as many are weighed as the strategy looks ahead. Where several are needed, the first visits add
    nothing and later ones more and more: bundles of all lengths are weighed, until the value per hour has fallen for
    as many visits as a detection needs.
    """
    own, needed, least = room.visits.get(star, []), state.needed, problem.strategy.scheduler.min_gain
    most = state.star.visits_left - len(own)
    starts: list[tuple[Visit, ...]] = [()]
    if needed > 1 and not own:
        # The best single visits may leave no time or slot for as many as a detection needs.
        starts += [start for surely in (True, False) if (start := surest(problem, state, room, star, surely))]
    best: Plan | None = None
    for start in starts:
        grown: Plan | None = None
        for visits, value in _grown(problem, state, room, star, start):
            cost = sum(problem.cost_h(star, visit) for visit in visits)
            worthwhile = value >= least * len(visits) and value > 0.0
            if worthwhile and (grown is None or value / cost > grown.density):
                grown = Plan(visits, cost, value)
            full = len(visits) >= (min(problem.strategy.scheduler.look_ahead, most) if needed == 1 else most)
            if full or (needed > 1 and grown is not None and len(visits) >= len(grown.visits) + needed):
                break
        if grown is not None and (best is None or grown.density > best.density):
            best = grown
    return best


def _grown(
    problem: Problem, state: StarValue, room: Room, star: int, first: Sequence[Visit] = ()
) -> Iterator[tuple[tuple[Visit, ...], float]]:
    """Yield more and more visits of a star, each the one of most value per hour, with what they add together.

    They begin with some visits, and end with those that the star can have or that are worth their time.
    """
    left, own, made, begin = room.after(problem), room.visits.get(star, []), list[Visit](), state.value
    while len(own) + len(made) < state.star.visits_left:
        visit = first[len(made)] if len(made) < len(first) else next_visit(problem, state, left, [*own, *made])
        if visit is None:
            break
        state = state.after(visit)
        left.take(star, visit, problem.cost_h(star, visit))
        made.append(visit)
        yield tuple(made), state.value - begin


def surest(problem: Problem, state: StarValue, room: Room, star: int, chance_first: bool) -> tuple[Visit, ...]:
    """Return just as many visits as a detection needs that show one planet in each of them; none where none can.

    Of all sets of visits with their gaps, found slot after slot for every planet by itself: the surest one, or the
    cheapest. There is a calendar that is worth anything exactly where the cheapest set fits into the budget.
    """
    item, needed = state.star, state.needed
    chance = np.where(room.holds(item.cost_h)[..., None], item.chance, 0.0) * (item.weight > 0.0)
    if min(needed, item.visits_left) < needed or not chance.any():
        return ()
    with np.errstate(divide="ignore"):
        score = np.log(chance) if chance_first else np.where(chance > 0.0, -item.cost_h[..., None], -np.inf)
    order = np.argsort(item.day, kind="stable")
    day, gap = item.day[order], problem.strategy.revisits.min_gap_days - ROUNDING
    # Slots before each one that are far enough away; never itself.
    before = np.minimum(np.searchsorted(day, day - gap, side="right"), np.arange(len(day)))
    of_slot = score.max(axis=0)[order]
    best = np.full((needed + 1, len(day) + 1, score.shape[-1]), -np.inf)
    best[0] = 0.0
    for count in range(1, needed + 1):
        for slot in range(len(day)):
            best[count, slot + 1] = np.maximum(best[count, slot], best[count - 1, before[slot]] + of_slot[slot])
    end = best[needed, -1]
    worth = np.log(np.maximum(item.weight, np.finfo(float).tiny)) + end if chance_first else end
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
    return tuple(made[::-1]) if cost <= room.budget_h + ROUNDING else ()


def next_visit(problem: Problem, state: StarValue, room: Room, made: Sequence[Visit]) -> Visit | None:
    """Return the visit that adds most per hour, of those worth the least a visit has to be; the first of equals."""
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


def promising(problem: Problem, room: Room, star: int) -> list[tuple[Visit, ...]]:
    """Return visits of a star to begin with: those of most value per hour each, the surest and the cheapest.

    Parameters
    ----------
    problem : Problem
    room : Room
        Time that is left, without visits of the star.
    star : int
    """
    none = StarValue.none(problem.stars[star], problem.needed)
    starts = [surest(problem, none, room, star, first) for first in (True, False)] if problem.needed > 1 else []
    grown = [visits for visits, _ in _grown(problem, none, room.after(problem), star)]
    return [start for start in (*grown[-1:], *starts) if start]


_TINY = 1e-12
_SWEEPS = 10
_STARTS = 2
Chosen = dict[int, list[Visit]]
"""Visits of every star that has some, in the order of the calendar."""


class Prices(Record):
    """The prices of an hour of telescope time, in planets: of the budget, and in every slot on top of that."""

    budget: float
    slots: FloatArray

    def near(self, other: "Prices") -> bool:
        """Return whether they hardly differ from others."""
        return bool(np.allclose(other.slots, self.slots) and np.isclose(other.budget, self.budget))


def charges(problem: Problem, star: int, prices: Prices) -> FloatArray:
    """Return the price of the time of each visit of a star, shape ``(o, b)``; infinite where none is possible."""
    cost = problem.stars[star].cost_h
    each = prices.budget + prices.slots
    return np.asarray(np.where(np.isfinite(cost), np.nan_to_num(cost, posinf=0.0) * each, np.inf))


@dataclass
class Pool:
    """Plans of a star to choose from."""

    star: int
    plans: dict[tuple[Visit, ...], Plan] = field(default_factory=dict)

    def add(self, problem: Problem, visits: Iterable[Visit]) -> bool:
        """Add a plan; whether it is new."""
        own = tuple(sorted(visits, key=lambda visit: (visit[1], visit[0])))
        if not own or own in self.plans:
            return False
        value = StarValue.of(problem.stars[self.star], problem.needed, own).value
        self.plans[own] = Plan(own, sum(problem.cost_h(self.star, visit) for visit in own), value)
        return True


@contextlib.contextmanager
def remarks_aside() -> Iterator[None]:
    """Send to the error output what the solver prints: the standard output may be that of ``--json``."""
    flush = getattr(ctypes.CDLL(None), "fflush", None) if os.name == "posix" else None
    sys.stdout.flush()
    kept = os.dup(1)
    try:
        os.dup2(2, 1)
        yield
    finally:
        if flush is not None:  # it prints through C, which has a buffer of its own
            flush(None)
        os.dup2(kept, 1)
        os.close(kept)


def least_gain(problem: Problem) -> float:
    """Return what a visit has to add to the others of its star: what the strategy asks for, and something at all.

    Schedules are chosen by their value less that of all their visits: the best one has no visit that adds less.
    """
    return max(problem.strategy.scheduler.min_gain, _TINY)


def improved(problem: Problem, room: Room, star: int, start: Sequence[Visit], prices: Prices) -> list[Visit]:
    """Improve visits of one star, one by one, as long as their value less the price of their time grows.

    Visits are added, dropped and exchanged for others; each pays what the strategy asks of a visit, too.

    Parameters
    ----------
    problem : Problem
    room : Room
        Time that is left for the star, without any visits of it.
    star : int
    start : sequence of Visit
    prices : Prices
    """
    item = problem.stars[star]
    charge = np.where(room.holds(item.cost_h), charges(problem, star, prices) + least_gain(problem), np.inf)
    made = list(start)

    def best(others: Sequence[Visit], kept: Visit | None) -> tuple[Visit | None, float]:
        """Return the visit that adds most to others, none if that is best, and how much more than the one kept."""
        state = StarValue.of(item, problem.needed, others)
        left = room.budget_h - sum(float(item.cost_h[visit]) for visit in others)
        net = np.where(item.cost_h <= left + ROUNDING, state.gain() - charge, -np.inf)
        for _, slot in others:
            net[:, problem.near(item, slot)] = -np.inf
        now = 0.0 if kept is None else float(net[kept])
        at = np.unravel_index(int(np.argmax(net)), net.shape)
        top = float(net[at])
        found = (int(at[0]), int(at[1])) if top > 0.0 else None
        return found, max(top, 0.0) - now

    for _ in range(_SWEEPS):
        helped = False
        for visit in list(made):
            others = [other for other in made if other != visit]
            found, more = best(others, visit)
            if more > _TINY:
                made, helped = others + ([found] if found else []), True
        while len(made) < item.visits_left:
            found, more = best(made, None)
            if found is None or more <= _TINY:
                break
            made.append(found)
            helped = True
        if not helped:
            break
    return made


def pools_of(problem: Problem, room: Room, group: Sequence[int], made: Chosen) -> list[Pool]:
    """Return plans of stars to begin with: the greedy choice's, the surest, the cheapest, and all beginnings.

    Parameters
    ----------
    problem : Problem
    room : Room
    group : sequence of int
        Stars.
    made : dict
        Visits of the greedy choice.
    """
    pools = [Pool(star) for star in group]
    for pool in pools:
        for start in (made.get(pool.star, ()), *promising(problem, room, pool.star)):
            for count in range(1, len(start) + 1):
                pool.add(problem, start[:count])
    return pools


def priced(problem: Problem, room: Room, pools: Sequence[Pool], rounds: int) -> None:
    """Add plans that are worth more than the time they take, at the prices at which those known share it best.

    Notes
    -----
    Column generation (Dantzig & Wolfe 1960; Barnhart et al. 1998, Operations Research 46, 316) with an inexact search
    for new plans: what it finds are schedules, not bounds.
    """
    least = least_gain(problem)
    for _ in range(rounds):
        prices = share(problem, room, pools, least=least).prices
        helped = False
        for pool in pools:
            costs = charges(problem, pool.star, prices)

            def net(plan: Plan, costs: FloatArray = costs) -> float:
                return plan.value - sum(float(costs[visit]) + least for visit in plan.visits)

            for start in sorted(pool.plans.values(), key=net)[: -1 - _STARTS : -1]:
                helped |= pool.add(problem, improved(problem, room, pool.star, start.visits, prices))
        if not helped:
            break


class Shared(Record):
    """The sharing of time by plans: the chosen, the value that no choice passes, and prices (of parts)."""

    chosen: Chosen
    bound: float
    prices: Prices


def share(
    problem: Problem, room: Room, pools: Sequence[Pool], *, least: float = 0.0, nodes: int = 0, gap: float = 0.0
) -> Shared:
    """Choose at most one plan of each star: in parts, with prices, or whole with up to ``nodes`` of a search tree.

    Parameters
    ----------
    problem : Problem
    room : Room
    pools : sequence of Pool
    least : float
        What each visit has to pay beside its time.
    nodes : int
        0: plans may be taken in parts.
    gap : float
        Relative distance from the bound at which the search may end.
    """
    from scipy.optimize import Bounds, LinearConstraint, linprog, milp
    from scipy.sparse import csr_array

    every = [(at, plan) for at, pool in enumerate(pools) for plan in pool.plans.values()]
    slots = len(room.slots_h)
    nothing = Prices(0.0, np.zeros(slots))
    if not every:
        return Shared({}, 0.0, nothing)
    rows, columns, parts = [], [], []
    for column, (at, plan) in enumerate(every):
        star = pools[at].star
        for visit in plan.visits:
            rows.append(1 + visit[1])
            columns.append(column)
            parts.append(problem.cost_h(star, visit))
        rows += [0, 1 + slots + at]
        columns += [column, column]
        parts += [plan.cost_h, 1.0]
    matrix = csr_array((parts, (rows, columns)), shape=(1 + slots + len(pools), len(every)))
    high = np.concatenate([[room.budget_h], room.slots_h, np.ones(len(pools))])
    worth = np.array([least * len(plan.visits) - plan.value for _, plan in every])
    if not nodes:
        with remarks_aside():
            found = linprog(worth, A_ub=matrix, b_ub=np.maximum(high, 0.0), bounds=(0.0, None), method="highs")
        marginal = np.maximum(-found.ineqlin.marginals, 0.0)
        return Shared({}, -float(found.fun), Prices(float(marginal[0]), marginal[1 : 1 + slots]))
    options = {"mip_rel_gap": gap, "node_limit": nodes}
    with remarks_aside():
        found = milp(
            worth,
            constraints=LinearConstraint(matrix, -np.inf, np.maximum(high, 0.0) + ROUNDING / 2),
            bounds=Bounds(0.0, 1.0),
            integrality=np.ones(len(every)),
            options=options,
        )
    if found.x is None:
        return Shared({}, np.inf, nothing)
    chosen = {pools[at].star: list(plan.visits) for (at, plan), x in zip(every, found.x, strict=True) if x > 0.5}
    return Shared(chosen, -float(found.mip_dual_bound), nothing)


def exchanged(problem: Problem, room: Room, group: Sequence[int], made: Chosen) -> Chosen:
    """Improve the visits of each star in the time that the others leave, as long as that helps.

    Parameters
    ----------
    problem : Problem
    room : Room
        Time that is left for all of them.
    group : sequence of int
        Stars that may be visited.
    made : dict
    """
    free = Prices(0.0, np.zeros(len(room.slots_h)))
    made = dict(made)
    for _ in range(_SWEEPS):
        helped = False
        for star in group:
            left = room.after(problem, {other: visits for other, visits in made.items() if other != star})
            starts = [made[star]] if star in made else promising(problem, left, star)
            for start in starts:
                visits = improved(problem, left, star, start, free)
                if _net(problem, {star: visits}) > _net(problem, {star: made.get(star, [])}) + _TINY:
                    made[star], helped = visits, True
                    break
        if not helped:
            break
    return {star: visits for star, visits in made.items() if visits}


_FALLS, _CLOSED = 1e-4, 1e-9
_DEEP = 5
_KEPT = (0.8, 0.5, 0.3, 0.1)


class Bound(Record):
    """The bound that no schedule of some stars can pass.

    Attributes
    ----------
    value : float
        Price of all the time that there is, and ``stars``.
    stars : tuple of float
        What no plan of each star passes, less the price of its time.
    prices : Prices
        Those at which it was found.
    ended : bool
        Whether the search for the best plan of each star ended within its effort.
    """

    value: float
    stars: tuple[float, ...]
    prices: Prices
    ended: bool


def lagrangian_bound(
    problem: Problem, room: Room, pools: Sequence[Pool], prices: Prices, rounds: int, nodes: int
) -> Bound:
    """Return a value that no schedule of some stars can pass.

    Parameters
    ----------
    problem : Problem
    room : Room
        Time that is left for them.
    pools : sequence of Pool
        Plans of the stars; better ones that are found on the way are added.
    prices : Prices
        Any that are not negative; the nearer to those at which time is shared best, the lower the bound.
    rounds, nodes : int
        Effort for each star: rounds of cuts where many visits can be made, and nodes of a search tree.

    Notes
    -----
    With prices on the budget and on slots, every schedule is worth at most the price of all the time that there is and,
    for each star, the best of its plans less the price of its own time (Lagrangian relaxation: Fisher 1981, Management
    Science 27, 1).
    """
    time = prices.budget * max(room.budget_h, 0.0) + float(prices.slots @ np.maximum(room.slots_h, 0.0))
    found, ended = [], True
    for pool in pools:
        charge = charges(problem, pool.star, prices)
        star = _Star.of(problem, room, pool.star, charge)
        known = max([plan.value - sum(charge[visit] for visit in plan.visits) for plan in pool.plans.values()] + [0.0])
        best = star.searched(known, nodes)
        bound, ended = best.bound, ended and best.ended
        for visits in best.plans:
            pool.add(problem, visits)
        if rounds and not best.ended and star.most > _DEEP * problem.needed:
            bound = min(bound, max([0.0] + [star.bound(pool, *span, rounds) for span in star.spans()]))
        found.append(float(bound))
    return Bound(time + sum(found), tuple(found), prices, ended)


def add_all_near(problem: Problem, room: Room, pools: Sequence[Pool], bound: Bound, value: float, nodes: int) -> bool:
    """Add every plan that a schedule better than a known one can have; whether these are all.

    Parameters
    ----------
    problem : Problem
    room : Room
    pools : sequence of Pool
        Of the stars of the bound.
    bound : Bound
    value : float
        Of the known schedule.
    nodes : int
        Effort for each star.

    Notes
    -----
    At the prices of the bound, a plan that is farther below its star's bound than the known schedule is below the
    bound of all leaves less than the known value to any schedule with it (as in Baldacci, Christofides & Mingozzi 2008,
    Mathematical Programming 115, 351).
    """
    every, slack = True, max(bound.value - value, 0.0) * (1.0 + _CLOSED) + _CLOSED * bound.value
    for pool, top in zip(pools, bound.stars, strict=True):
        star = _Star.of(problem, room, pool.star, charges(problem, pool.star, bound.prices))
        found = star.searched(top - slack, nodes, every=True)
        every &= found.ended
        for visits in found.plans:
            pool.add(problem, visits)
    return every


class _Found(Record):
    """Better plans of a star, what no other passes, less the price of its time, and whether the search ended."""

    bound: float
    plans: list[list[Visit]]
    ended: bool


class _Star(Record, eq=False):
    """A star with the visits that fit, what they cost, and how much of `U` each number of visits can be worth.

    Notes
    -----
    A planet that needs ``k`` detections counts with ``P(count >= k)`` in the value, and with ``E[min(count, k)] / k``,
    the mean of ``P(count >= i)`` over ``i = 1 ... k``, in `U`. Each ratio ``P(count >= k) / P(count >= i)`` grows with
    the chance of every visit and with further visits: the count is a sum of independent trials, log-concave, and grows
    in the order of likelihood ratios (Shaked & Shanthikumar 2007, Stochastic Orders, theorem 1.C.9). With at most ``n``
    visits the ratio of the two is therefore at most that of the planet's ``n`` best chances, one a slot, and `U` with
    weights times that bounds the value. It keeps the diminishing returns of `U`: for any set A, a set T of visits is
    worth at most ``U(A) + sum over T of the gains of single visits after A`` (Nemhauser & Wolsey 1981).
    """

    problem: Problem
    room: Room
    star: int
    columns: IntArray
    cost_h: FloatArray
    charge: FloatArray
    chance: FloatArray
    ratios: FloatArray

    @classmethod
    def of(cls, problem: Problem, room: Room, star: int, charge: FloatArray) -> "_Star":
        """Return the parts of a star."""
        item = problem.stars[star]
        useful = room.holds(item.cost_h)
        if problem.needed == 1:  # a visit adds at most what it is worth alone
            useful &= StarValue.none(item, 1).gain() >= least_gain(problem)
        columns = np.argwhere(useful)
        at = columns[:, 0], columns[:, 1]
        cheapest = np.sort(np.where(useful, item.cost_h, np.inf).min(axis=0))
        affordable = int(np.sum(np.cumsum(cheapest) <= room.budget_h + ROUNDING))
        shown = np.where(useful[..., None], item.chance, 0.0)
        ratios = _ratios(problem.needed, shown, min(item.visits_left, affordable))
        return cls(problem, room, star, columns, item.cost_h[at], charge[at], item.chance[at], ratios)

    @property
    def most(self) -> int:
        """Visits that it can have."""
        return int(self.ratios.shape[1])

    def spans(self) -> list[tuple[int, int]]:
        """Return the numbers of visits that are bounded together: few alone, as the ratio grows fast there."""
        needed, most = self.problem.needed, self.most
        if needed == 1:
            return [(1, most)] if most else []
        ends = [end for end in (*range(needed, 2 * needed + 3), 4 * needed) if end < most]
        ends = [*ends, most] if most >= needed else []
        return list(zip([needed, *(end + 1 for end in ends[:-1])], ends, strict=True)) if ends else []

    def searched(self, known: float, nodes: int, *, every: bool = False) -> "_Found":
        """Search all plans for better ones than one that is known, the most promising first.

        After some visits, ``t`` more add at most the sum of their gains, each planet's chance to be seen as often as it
        still needs bounded as by `U`: the bound of a branch is that of its best ``t`` visits that are not excluded.

        Parameters
        ----------
        known : float
            Value less price of a plan that is known.
        nodes : int
            Sets of visits that are tried.
        every : bool
            Look for all that are better, not only for the best.
        """
        if not self.most:
            return _Found(known, [], True)
        item, slots = self.problem.stars[self.star], self.columns[:, 1]
        near = np.array([self.problem.near(item, slot)[slots] for slot in slots.tolist()])
        column, planet = np.nonzero(self.chance)
        start = np.searchsorted(column, np.arange(len(slots) + 1))
        shown = start, planet, self.chance[column, planet], item.weight
        limits = self.charge, self.cost_h, near, self.ratios, self.room.budget_h + ROUNDING
        kernel = load_kernels("cpic_planner.survey.plan_search").best_plans
        plans, bound, ended = kernel(shown, limits, known, nodes, every)
        return _Found(bound, [[(int(o), int(s)) for o, s in self.columns[visits]] for visits in plans], ended)

    def bound(self, pool: Pool, fewest: int, most: int, rounds: int) -> float:
        """Return the bound with between so many visits, by linear programming."""
        item = self.problem.stars[self.star]
        weighed = replace(item, weight=item.weight * self.ratios[-1, most - 1])
        rows, limits = self._limits(most)
        cuts: list[FloatArray] = []
        starts: list[float] = []

        def cut(visits: Sequence[Visit]) -> None:
            state = StarValue.of(weighed, self.problem.needed, visits)
            gains = state.gains()[1][self.columns[:, 0], self.columns[:, 1]]
            taken = set(visits)
            gains[[tuple(column) in taken for column in self.columns.tolist()]] = 0.0
            cuts.append(gains)
            starts.append(state.upper)

        cut(())
        best = max(pool.plans.values(), key=lambda plan: plan.value, default=None)
        if best is not None:
            cut(best.visits)
        bound = np.inf
        for _ in range(rounds):
            x, promised, top = _solved(self.charge, np.array(cuts), np.array(starts), rows, limits, fewest)
            fell, bound = bound - top, min(bound, top)
            sets = {tuple(tuple(part) for part in self.columns[x > kept].tolist()) for kept in _KEPT}
            worst = 0.0
            for visits in sorted(sets):
                cut(visits)
                worst = max(worst, promised - (starts[-1] + float(cuts[-1] @ x)))
            if bound <= 0.0 or worst <= 1e-9 or fell <= _FALLS * bound:
                break
        return bound

    def _limits(self, most: int) -> tuple[FloatArray, FloatArray]:
        """Return number of visits, budget and slots that are too near, as rows of ``A x <= b``."""
        item, slots = self.problem.stars[self.star], self.columns[:, 1]
        rows, limits = [np.ones(len(slots)), self.cost_h], [float(most), self.room.budget_h]
        for slot in np.unique(slots):
            near = self.problem.near(item, int(slot))[slots] & (item.day[slots] >= item.day[slot])
            if near.sum() > 1:
                rows.append(near.astype(float))
                limits.append(1.0)
        return np.array(rows), np.array(limits)


def _ratios(needed: int, chance: FloatArray, most: int) -> FloatArray:
    """Return ``i P(count >= i) / E[min(count, i)]`` of every planet with its 1, 2, ... best chances, one a slot.

    The shape is ``(k, most, m)``, for ``i = 1 ... k``.
    """
    best = -np.sort(-chance.max(axis=0), axis=0)[:most]
    below = np.zeros((needed, best.shape[-1]))  # probability of 0, 1, ... k - 1
    below[0] = 1.0
    found = np.zeros((needed, *best.shape))
    for row, p in enumerate(best):
        gone = below * p
        below = below - gone
        below[1:] += gone[:-1]
        reached = 1.0 - np.cumsum(below, axis=0)  # of at least 1, 2, ... k
        expected = np.cumsum(reached, axis=0) / np.arange(1, needed + 1)[:, None]
        found[:, row] = np.divide(reached, expected, out=np.ones_like(expected), where=expected > _CLOSED)
        found[row + 1 :, row] = 0.0
    return np.minimum(found * (1.0 + ROUNDING) + ROUNDING * (found > 0.0), 1.0)


def _solved(
    charge: FloatArray, cuts: FloatArray, starts: FloatArray, rows: FloatArray, limits: FloatArray, fewest: int
) -> tuple[FloatArray, float, float]:
    """Return the shares of the visits, what the cuts promise for them, and the bound of one programme."""
    from scipy.optimize import linprog

    n = len(charge)
    few = np.append(-np.ones(n), 0.0)[None]
    matrix = np.vstack([np.hstack([-cuts, np.ones((len(cuts), 1))]), np.hstack([rows, np.zeros((len(rows), 1))]), few])
    high = np.concatenate([starts, limits, [-float(fewest)]])
    each = [*[(0.0, 1.0)] * n, (None, None)]
    with remarks_aside():
        found = linprog(np.append(charge, -1.0), A_ub=matrix, b_ub=high, bounds=each, method="highs")
    if found.status == 2:  # no such number of visits
        return np.zeros(n), 0.0, 0.0
    if found.x is None:
        return np.zeros(n), 0.0, np.inf
    return found.x[:n], float(found.x[n]), -float(found.fun)


class Effort(Record):
    """Limits of the work for one strategy; counts, not seconds, so that every machine makes the same schedule.

    Attributes
    ----------
    rounds : int
        How often prices are found and plans added that pay at these; as often again for the bound, at most.
    choice : int
        Nodes of the search tree that chooses among plans.
    gap : float
        Relative distance from the bound at which that search ends.
    nodes : int
        Nodes of the search trees for the plans of all stars together, each time that prices are found for the bound.
    bounds : int
        How often that is.
    cuts : int
        Rounds of cuts for the bound of a star that can have many visits.
    """

    rounds: int
    choice: int
    gap: float
    nodes: int
    bounds: int
    cuts: int


_USUAL = Effort(rounds=6, choice=2000, gap=1e-4, nodes=8000, bounds=2, cuts=10)
EFFORTS = {
    "greedy": _USUAL,
    "auto": _USUAL,
    "exact": Effort(rounds=40, choice=100_000, gap=0.0, nodes=400_000, bounds=20, cuts=40),
}


def make_schedule(problem: Problem, effort: Effort | None = None, *, bounded: bool = True) -> Schedule:
    """Return the schedule of a strategy, with its distance from a bound.

    A greedy choice comes first. Then several plans are made for each star, sets of visits that are worth what their
    time costs, one of them or none is chosen for each, and the visits of each star are exchanged for better ones as
    long as that helps. Visits that pay only together are so weighed together, however many a detection needs. Stars
    that come first (known planets) are planned before the others, and the others get what is left: the bound, which
    knows no such order, may then be farther away.

    Parameters
    ----------
    problem : Problem
    effort : Effort, optional
        That of the strategy's method by default.
    bounded : bool
        Whether the bound is wanted; the visits are the same without.
    """
    rule = problem.strategy.scheduler
    effort = effort or EFFORTS[rule.method]
    full, booked = greedy(problem)
    made = full.visits
    chosen, bound = _planned(problem, made, effort if bounded else replace(effort, cuts=0), bounded)
    method = "greedy"
    if rule.method != "greedy" and _rank(problem, chosen) > _rank(problem, made):
        method = "plans of stars"
        booked = [item for star in sorted(chosen) for item in _gains(problem, star, chosen[star])]
    room = Room.of(problem, [(star, visit) for star, visit, _ in booked])
    value = sum(gain for _, _, gain in booked)
    spare: list[tuple[int, Visit, float]] = []
    if rule.reserve > 0.0:
        room.budget_h += rule.reserve * problem.strategy.time_budget_h
        spare = greedy(problem, room=room)[1]
    return Schedule(in_order(problem.stars, booked, spare), value, max(bound, value) if bounded else math.inf, method)


def _planned(problem: Problem, made: Chosen, effort: Effort, bounded: bool) -> tuple[Chosen, float]:
    """Return the plans of all stars, group after group, and what no schedule can pass."""
    groups, room = problem.groups(), Room.of(problem)
    found: Chosen = {}
    bound = 0.0
    part = effort if len(groups) == 1 else replace(effort, nodes=effort.nodes // 4, bounds=1)
    for group in groups:
        chosen, bound = _of_group(problem, room, group, made, part)
        room = room.after(problem, dict(sorted(chosen.items())))
        found |= chosen
    if bounded and len(groups) > 1:
        bound = _of_group(problem, Room.of(problem), range(len(problem.stars)), made | found, effort)[1]
    return found, bound


def _of_group(problem: Problem, room: Room, group: Sequence[int], made: Chosen, effort: Effort) -> tuple[Chosen, float]:
    """Return the plans of stars in the time that is left for them, and what no schedule of these can pass."""
    each = effort.nodes // max(len(group), 1)
    pools = pools_of(problem, room, group, made)
    priced(problem, room, pools, effort.rounds)
    found: list[Bound] = []
    for _ in range(effort.bounds):
        prices = share(problem, room, pools).prices
        if found and found[-1].prices.near(prices):
            break
        found.append(lagrangian_bound(problem, room, pools, prices, effort.cuts, each))
    own = {star: made[star] for star in group if star in made}
    chosen = _best(problem, room, group, pools, own if _fits(problem, room, own) else {}, effort)
    value = sum(StarValue.of(problem.stars[star], problem.needed, visits).value for star, visits in chosen.items())
    least = min(item.value for item in found)
    ended = min((item for item in found if item.ended), key=lambda item: item.value, default=None)
    if ended is not None and value < ended.value and add_all_near(problem, room, pools, ended, value, each):
        least = min(least, max(value, share(problem, room, pools, nodes=effort.choice, gap=effort.gap).bound))
    return _best(problem, room, group, pools, chosen, effort), least


def _best(
    problem: Problem, room: Room, group: Sequence[int], pools: Sequence[Pool], known: Chosen, effort: Effort
) -> Chosen:
    """Return the better of a choice among plans and a known schedule, after exchanges of visits."""
    least = least_gain(problem)
    chosen = share(problem, room, pools, least=least, nodes=effort.choice, gap=effort.gap).chosen
    if not _fits(problem, room, chosen) or _net(problem, known) >= _net(problem, chosen):
        chosen = known
    return exchanged(problem, room, group, chosen)


def _fits(problem: Problem, room: Room, made: Mapping[int, Sequence[Visit]]) -> bool:
    """Return whether what is left holds all of these visits."""
    left = room.after(problem, made)
    return left.budget_h >= -ROUNDING and bool((left.slots_h >= -ROUNDING).all())


def _net(problem: Problem, made: Chosen) -> float:
    """Return the value of visits less what each of them has to be worth."""
    least = least_gain(problem)
    return sum(
        StarValue.of(problem.stars[star], problem.needed, visits).value - least * len(visits)
        for star, visits in sorted(made.items())
    )


def _rank(problem: Problem, made: Chosen) -> tuple[float, ...]:
    """Return what groups of stars are worth, the first served first; the same sums in any order or processor."""
    worth = (_net(problem, {star: made[star] for star in group if star in made}) for group in problem.groups())
    return tuple(float(f"{value:.12g}") for value in worth)


def _gains(problem: Problem, star: int, visits: Sequence[Visit]) -> list[tuple[int, Visit, float]]:
    """Return the visits of a star in the order of the calendar, with what each adds."""
    state = StarValue.none(problem.stars[star], problem.needed)
    found = []
    for visit in sorted(visits, key=lambda item: item[1]):
        after = state.after(visit)
        found.append((star, visit, after.value - state.value))
        state = after
    return found
