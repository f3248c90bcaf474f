"""What no schedule can pass: bounds of single stars under a price of telescope time, and their sum."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cpic_core import FloatArray, IntArray
from cpic_planner.survey.plans import Pool, Prices, charges, least_gain, remarks_aside
from cpic_planner.survey.schedule import ROUNDING, Problem, Room, StarValue, Visit

_FALLS = 2e-3
_KEPT = (0.5, 0.2)


def lagrangian_bound(
    problem: Problem, room: Room, pools: Sequence[Pool], prices: Prices, rounds: int, nodes: int = 0
) -> float:
    """Return a value that no schedule of some stars can pass.

    Parameters
    ----------
    problem : Problem
    room : Room
        Time that is left for them.
    pools : sequence of Pool
        Plans of the stars: those that are complete bound their stars exactly.
    prices : Prices
        Any that are not negative; the nearer to those at which time is shared best, the lower the bound.
    rounds, nodes : int
        Effort for each star: rounds of cuts, and nodes of a search tree for whole visits.

    Notes
    -----
    With prices on the budget and on slots, every schedule is worth at most the price of all the time that there is and,
    for each star, the best of its plans less the price of its own time (Lagrangian relaxation: Fisher 1981, Management
    Science 27, 1).
    """
    time = prices.budget * max(room.budget_h, 0.0) + float(prices.slots @ np.maximum(room.slots_h, 0.0))
    return time + sum(_of_star(problem, room, pool, prices, rounds, nodes) for pool in pools)


def _of_star(problem: Problem, room: Room, pool: Pool, prices: Prices, rounds: int, nodes: int) -> float:
    """Return what no plan of a star passes, less the price of its time; at least 0, that of no visit."""
    charge = charges(problem, pool.star, prices)
    if pool.complete:
        return max([plan.value - sum(charge[visit] for visit in plan.visits) for plan in pool.plans.values()] + [0.0])
    star = _Star.of(problem, room, pool.star, charge)
    bound = 0.0
    for fewest, most in star.spans():
        bound = max(bound, star.bound(pool, fewest, most, rounds, nodes))
    return bound


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
    ratios: FloatArray

    @classmethod
    def of(cls, problem: Problem, room: Room, star: int, charge: FloatArray) -> "_Star":
        """Parts of a star."""
        item = problem.stars[star]
        useful = room.holds(item.cost_h)
        if problem.needed == 1:  # a visit adds at most what it is worth alone
            useful &= StarValue.none(item, 1).gain() >= least_gain(problem)
        columns = np.argwhere(useful)
        at = columns[:, 0], columns[:, 1]
        cheapest = np.sort(np.where(useful, item.cost_h, np.inf).min(axis=0))
        affordable = int(np.sum(np.cumsum(cheapest) <= room.budget_h + ROUNDING))
        ratios = _ratios(problem, np.where(useful[..., None], item.chance, 0.0), min(item.visits_left, affordable))
        return cls(problem, room, star, columns, item.cost_h[at], charge[at], ratios)

    def spans(self) -> list[tuple[int, int]]:
        """Numbers of visits that are bounded together: few alone, as the ratio grows fast there."""
        needed, most = self.problem.needed, len(self.ratios)
        if needed == 1:
            return [(1, most)] if most else []
        ends = [end for end in (needed, needed + 1, needed + 3, 2 * needed + 6) if end < most]
        ends = [*ends, most] if most >= needed else []
        return list(zip([needed, *(end + 1 for end in ends[:-1])], ends, strict=True)) if ends else []

    def bound(self, pool: Pool, fewest: int, most: int, rounds: int, nodes: int) -> float:
        """Return the bound with between so many visits, by linear programming or with whole visits."""
        item = self.problem.stars[self.star]
        weighed = replace(item, weight=item.weight * self.ratios[most - 1])
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
            x, promised, top = _solved(self.charge, np.array(cuts), np.array(starts), rows, limits, fewest, nodes)
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
        """Number of visits, budget and slots that are too near, as rows of ``A x <= b``."""
        item, slots = self.problem.stars[self.star], self.columns[:, 1]
        rows, limits = [np.ones(len(slots)), self.cost_h], [float(most), self.room.budget_h]
        for slot in np.unique(slots):
            near = self.problem.near(item, int(slot))[slots] & (item.day[slots] >= item.day[slot])
            if near.sum() > 1:
                rows.append(near.astype(float))
                limits.append(1.0)
        return np.array(rows), np.array(limits)


def _ratios(problem: Problem, chance: FloatArray, most: int) -> FloatArray:
    """Return ``k P(count >= k) / E[min(count, k)]`` of every planet with its 1, 2, ... best chances, ``(most, m)``."""
    best = -np.sort(-chance.max(axis=0), axis=0)[:most]
    counts = np.zeros((problem.needed + 1, best.shape[-1]))
    counts[0] = 1.0
    found = np.zeros(best.shape)
    for row, p in enumerate(best):
        gone = counts[:-1] * p
        counts[:-1] -= gone
        counts[1:] += gone
        expected = (np.arange(1, problem.needed + 1)[:, None] * counts[1:]).sum(axis=0) / problem.needed
        found[row] = np.divide(counts[-1], expected, out=np.zeros_like(p), where=expected > 0.0)
    return np.minimum(found * (1.0 + ROUNDING), 1.0)


def _solved(
    charge: FloatArray,
    cuts: FloatArray,
    starts: FloatArray,
    rows: FloatArray,
    limits: FloatArray,
    fewest: int,
    nodes: int,
) -> tuple[FloatArray, float, float]:
    """Shares of the visits, what the cuts promise for them, and the bound of one programme."""
    from scipy.optimize import Bounds, LinearConstraint, milp

    n = len(charge)
    matrix = np.vstack([np.hstack([-cuts, np.ones((len(cuts), 1))]), np.hstack([rows, np.zeros((len(rows), 1))])])
    low = np.full(len(matrix), -np.inf)
    low[len(cuts)] = fewest
    kinds = np.append(np.full(n, float(nodes > 0)), 0.0)
    options: dict[str, Any] = {"node_limit": nodes} if nodes else {}
    with remarks_aside():
        found = milp(
            np.append(charge, -1.0),
            constraints=LinearConstraint(matrix, low, np.concatenate([starts, limits])),
            bounds=Bounds(np.append(np.zeros(n), -np.inf), np.append(np.ones(n), np.inf)),
            integrality=kinds,
            options=options,
        )
    if found.status == 2:  # no such number of visits
        return np.zeros(n), 0.0, 0.0
    bound = found.mip_dual_bound if nodes else found.fun
    if found.x is None:
        return np.zeros(n), 0.0, np.inf if bound is None else -float(bound)
    return found.x[:n], float(found.x[n]), -float(bound)
