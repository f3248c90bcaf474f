"""Plans of single stars, the best of them under a price of telescope time, and the best choice of one for each star."""

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from cpic_core import FloatArray
from cpic_planner.survey.greedy import promising
from cpic_planner.survey.schedule import ROUNDING, Problem, Room, StarValue, Visit

_TINY = 1e-12
_SWEEPS = 10
_STARTS = 2

Chosen = dict[int, list[Visit]]
"""Visits of every star that has some, in the order of the calendar."""


@dataclass(frozen=True)
class Plan:
    """Visits of one star in the order of the calendar, with what they cost and are worth together."""

    visits: tuple[Visit, ...]
    cost_h: float
    value: float


@dataclass(frozen=True)
class Prices:
    """The prices of an hour of telescope time, in planets: of the budget, and in every slot on top of that."""

    budget: float
    slots: FloatArray

    def near(self, other: "Prices") -> bool:
        """Return whether they hardly differ from others."""
        return bool(np.allclose(self.slots, other.slots) and np.isclose(self.budget, other.budget))


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


@dataclass(frozen=True)
class Shared:
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

    def net(star: int, visits: Sequence[Visit]) -> float:
        value = StarValue.of(problem.stars[star], problem.needed, visits).value
        return value - least_gain(problem) * len(visits)

    for _ in range(_SWEEPS):
        helped = False
        for star in group:
            left = Room(room.budget_h, room.slots_h.copy())
            for other, visits in made.items():
                for visit in visits if other != star else ():
                    left.take(other, visit, problem.cost_h(other, visit))
            starts = [made[star]] if star in made else promising(problem, left, star)
            for start in starts:
                visits = improved(problem, left, star, start, free)
                if net(star, visits) > net(star, made.get(star, ())) + _TINY:
                    made[star], helped = visits, True
                    break
        if not helped:
            break
    return {star: visits for star, visits in made.items() if visits}
