"""Bounds that no schedule can pass: of single stars under a price of telescope time, and their sum."""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cpic_core import FloatArray, IntArray
from cpic_planner.survey.plans import Pool, Prices, charges, least_gain, remarks_aside
from cpic_planner.survey.schedule import ROUNDING, Problem, Room, StarValue, Visit

_FALLS, _CLOSED = 1e-4, 1e-9
_DEEP = 5
_KEPT = (0.8, 0.5, 0.3, 0.1)


@dataclass(frozen=True)
class Bound:
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
        if not best.ended and star.most > _DEEP * problem.needed:
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


@dataclass(frozen=True, eq=False)
class _Branch:
    """Sets of visits: some that are made, with the first of the others from a place on and any after it.

    ``gains`` are what each of the others adds at most, in falling order; ``left`` is how many may still be made.
    """

    state: StarValue
    net: float
    visits: list[int]
    others: IntArray
    gains: FloatArray
    place: int
    left: int

    @property
    def bound(self) -> float:
        """What none of them passes, less the price of its time."""
        further = self.gains[self.place + 1 : self.place + self.left]
        return self.net + float(self.gains[self.place] + further[further > 0.0].sum())


@dataclass(frozen=True)
class _Found:
    """Better plans of a star, what no other passes, less the price of its time, and whether the search ended."""

    bound: float
    plans: list[list[Visit]]
    ended: bool


@dataclass(frozen=True, eq=False)
class _Star:
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
        item, needed = self.problem.stars[self.star], self.problem.needed
        needs = np.arange(needed, 0, -1)
        best, found = known, list[list[Visit]]()
        heap: list[tuple[float, int, _Branch]] = []
        made = 0

        def branch(state: StarValue, net: float, visits: list[int], others: IntArray) -> None:
            nonlocal made
            left = self.most - len(visits)
            spent = self.room.budget_h - float(self.cost_h[visits].sum()) + ROUNDING
            others = others[self.cost_h[others] <= spent]
            if left < 1 or not len(others):
                return
            each = (state.counts * self.ratios[needs - 1, left - 1] / needs[:, None]).sum(axis=0)
            gains = (self.chance @ (item.weight * each) - self.charge)[others]
            if not every:  # the best plan has no visit that takes more than it adds
                others, gains = others[gains > 0.0], gains[gains > 0.0]
            if len(others):
                made += 1
                order = np.argsort(-gains, kind="stable")
                new = _Branch(state, net, visits, others[order], gains[order], 0, left)
                heapq.heappush(heap, (-new.bound, made, new))

        branch(StarValue.none(item, needed), 0.0, [], np.arange(len(self.columns)))
        for _ in range(nodes):
            if not heap or -heap[0][0] <= best:
                break
            _, _, top = heapq.heappop(heap)
            column = int(top.others[top.place])
            option, slot = (int(part) for part in self.columns[column])
            state = top.state.after((option, slot))
            visits = [*top.visits, column]
            net = state.value - float(self.charge[visits].sum())
            if net > best:
                found.append([(int(o), int(s)) for o, s in self.columns[visits]])
                best = best if every else net
            if top.place + 1 < len(top.others):
                made += 1
                again = replace(top, place=top.place + 1)
                heapq.heappush(heap, (-again.bound, made, again))
            others = top.others[top.place + 1 :]
            branch(state, net, visits, others[~self.problem.near(item, slot)[self.columns[others, 1]]])
        rest = -heap[0][0] if heap else best
        return _Found(max(best, rest), found, rest <= best)

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
