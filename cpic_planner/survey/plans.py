"""Plans of single stars, the best of them under a price of telescope time, and the best choice of one for each star.

The greedy schedule puts the visits of most expected detections per hour, with a look ahead, into the calendar.
"""

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from cpic_core import FloatArray
from cpic_planner.survey.candidates import Candidate
from cpic_planner.survey.schedule import ROUNDING, Problem, Room, StarValue, Visit


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
    """Return whether the calendar still holds a bundle: other stars may have taken its slots."""
    left = room.slots_h.copy()
    for visit in bundle.visits:
        left[visit[1]] -= star.cost_h[visit]
    enough = bool(left[[slot for _, slot in bundle.visits]].min() >= -ROUNDING)
    return enough and bundle.cost_h <= room.budget_h + ROUNDING


def _best_bundle(problem: Problem, state: StarValue, room: Room, star: int) -> _Bundle | None:
    """Return the next visits of a star that give most per hour together; None where none is worth its time."""
    found = _grown(problem, state, room, star, ())
    if state.needed > 1 and not room.visits.get(star):
        # The best single visits may leave no time or slot for as many as a detection needs.
        starts = [
            start for chance_first in (True, False) if (start := surest(problem, state, room, star, chance_first))
        ]
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
        visit = first[k] if k < len(first) else next_visit(problem, state, trial, [*own, *visits])
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
    item = problem.stars[star]
    none = StarValue.none(item, problem.needed)
    starts = [surest(problem, none, room, star, first) for first in (True, False)] if problem.needed > 1 else []
    left, state, made = Room(room.budget_h, room.slots_h.copy()), none, list[Visit]()
    while len(made) < item.visits_left and (visit := next_visit(problem, state, left, made)) is not None:
        state = state.after(visit)
        left.take(star, visit, problem.cost_h(star, visit))
        made.append(visit)
    return [start for start in (tuple(made), *starts) if start]


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
