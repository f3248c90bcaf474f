"""Bounds on what any schedule can be worth, and the allocation by mixed-integer programming that comes near them."""

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpic_core import FloatArray, IntArray
from cpic_planner.survey.greedy import greedy
from cpic_planner.survey.schedule import Problem, Room, Schedule, StarValue, Visit, in_order

_ROUNDS = 12
_NODES = 500
_MANY, _SLOW = 200, 0.25
_SWEEPS = 20
_KEPT = 0.5
_CHOSEN = 1e-6


@dataclass
class _Cut:
    """``value of the star <= start + gains . x``, over all columns."""

    star: int
    start: float
    gains: FloatArray


def make_schedule(problem: Problem) -> Schedule:
    """Schedule of a strategy, with its distance from the bound.

    Both methods state the same bound: the value that linear programming gives a relaxation in which visits may be made
    in part and each star is worth at most what its cuts allow. ``milp`` then asks for whole visits, round after round,
    until the best allocation is within the strategy's ``gap`` of its own bound or that hardly falls any more; the
    better of it and the greedy one is improved by exchanging single visits as long as that helps. Where a detection
    needs several visits, the greedy schedule is improved like that too, and problems of up to 200 possible visits go
    through ``milp`` whatever the method: it takes less than a second there. Stars that come
    first (known planets) are allocated before the others, and the others get what is left: the bound, which knows no
    such order, may then be farther away.

    Notes ----- With ``U`` of `cpic_planner.survey.schedule.StarValue`, which has diminishing returns, every set of
    visits T of a star is worth at most ``U(A) + sum over T of the gains of single visits after A``, for any set A
    (Nemhauser & Wolsey 1981). Cuts are added where the last solution was promised more than it is worth.
    """
    room, booked = greedy(problem)
    cuts_at = _by_star((star, visit) for star, visit, _ in booked)
    everyone = _Programme(problem, Room.of(problem), range(len(problem.stars)))
    everyone.add_prefixes(cuts_at)
    bound = everyone.rounds(whole=False)[1]
    method, several = "greedy", problem.needed > 1
    asked = problem.strategy.scheduler.method == "milp"
    if everyone.columns and (asked or (several and len(everyone.columns) <= _MANY)):
        chosen, own_bound = _allocated(problem, everyone, cuts_at)
        bound = min(bound, own_bound)
        if _rank(problem, chosen) > _rank(problem, cuts_at):
            method, cuts_at = "milp", chosen
    value = _value(problem, cuts_at)
    if asked or several:
        chosen = exchanged(problem, cuts_at)
        better = _value(problem, chosen)
        if method == "milp" or better > value:
            if method == "greedy":
                method = "greedy, exchanged"
            value = better
            booked = [item for star in sorted(chosen) for item in _gains(problem, star, chosen[star])]
            room = Room.of(problem, [(star, visit) for star, visit, _ in booked])
    spare: list[tuple[int, Visit, float]] = []
    reserve = problem.strategy.scheduler.reserve
    if reserve > 0.0:
        room.budget_h += reserve * problem.strategy.time_budget_h
        spare = greedy(problem, room=room)[1]
    return Schedule(in_order(problem.stars, booked, spare), value, max(bound, value), method)


def _allocated(
    problem: Problem, everyone: "_Programme", made: dict[int, list[Visit]]
) -> tuple[dict[int, list[Visit]], float]:
    """Whole visits of all stars, group after group, and the bound where there is one group."""
    groups = problem.groups()
    if len(groups) == 1:
        chosen, bound = everyone.rounds(whole=True)
        return _worthwhile(problem, chosen), bound
    room = Room.of(problem)
    found: dict[int, list[Visit]] = {}
    for group in groups:
        programme = _Programme(problem, room, group)
        if not programme.columns:
            continue
        programme.add_prefixes({star: made[star] for star in group if star in made})
        chosen = _worthwhile(problem, programme.rounds(whole=True)[0])
        for star, visit in _pairs(chosen):
            room.take(star, visit, problem.cost_h(star, visit))
        found |= chosen
    return found, np.inf


def _worthwhile(problem: Problem, made: dict[int, list[Visit]]) -> dict[int, list[Visit]]:
    """Return the stars whose visits are worth together what the strategy asks of them.

    Where one detection is enough, the programme has no other columns. Where several are needed, it counts detections,
    and may choose visits that show different planets, or one of them too seldom.
    """
    least = problem.strategy.scheduler.min_gain
    if problem.needed == 1:
        return made
    worth = {star: _worth(problem, star, visits).value for star, visits in made.items()}
    return {star: visits for star, visits in made.items() if worth[star] > 0.0 and worth[star] >= least * len(visits)}


def _rank(problem: Problem, made: dict[int, list[Visit]]) -> tuple[float, ...]:
    """Values of the groups of stars, the first to be served first."""
    return tuple(_value(problem, {star: made[star] for star in group if star in made}) for group in problem.groups())


def _worth(problem: Problem, star: int, visits: Sequence[Visit]) -> StarValue:
    return StarValue.of(problem.stars[star], problem.needed, visits)


def _pairs(made: dict[int, list[Visit]]) -> list[tuple[int, Visit]]:
    """Visits with their stars, star after star."""
    return [(star, visit) for star, visits in sorted(made.items()) for visit in visits]


def _by_star(visits: Iterable[tuple[int, Visit]]) -> dict[int, list[Visit]]:
    made: dict[int, list[Visit]] = {}
    for star, visit in visits:
        made.setdefault(star, []).append(visit)
    return made


def _gains(problem: Problem, star: int, visits: Sequence[Visit]) -> list[tuple[int, Visit, float]]:
    """Visits of a star in the order of the calendar, with what each adds."""
    state = _worth(problem, star, ())
    found = []
    for visit in sorted(visits, key=lambda item: item[1]):
        after = state.after(visit)
        found.append((star, visit, after.value - state.value))
        state = after
    return found


def _value(problem: Problem, made: dict[int, list[Visit]]) -> float:
    return sum(_worth(problem, star, visits).value for star, visits in sorted(made.items()))


def exchanged(problem: Problem, made: dict[int, list[Visit]]) -> dict[int, list[Visit]]:
    """Visits after exchanges of one for another of the same star, as long as the value grows."""
    room = Room.of(problem, [(star, visit) for star, visits in made.items() for visit in visits])
    for _ in range(_SWEEPS):
        helped = [_exchange(problem, room, star) for star in sorted(room.visits)]
        if not any(helped):
            break
    return room.visits


def _exchange(problem: Problem, room: Room, star: int) -> bool:
    """Put each visit of a star where it adds most to the others; whether that helped."""
    item = problem.stars[star]
    helped = False
    for visit in list(room.visits[star]):
        others = [other for other in room.visits[star] if other != visit]
        state = _worth(problem, star, others)
        cost = problem.cost_h(star, visit)
        room.budget_h += cost
        room.slots_h[visit[1]] += cost
        gains = np.where(room.holds(item.cost_h), state.gains()[0], -np.inf)
        for _, slot in others:
            gains[:, problem.near(item, slot)] = -np.inf
        option, slot = (int(part) for part in np.unravel_index(int(np.argmax(gains)), gains.shape))
        best = (option, slot) if gains[option, slot] > gains[visit] + _CHOSEN * _CHOSEN else visit
        room.visits[star] = others
        room.take(star, best, problem.cost_h(star, best))
        helped |= best != visit
    return helped


@contextlib.contextmanager
def _remarks_aside() -> Iterator[None]:
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


class _Programme:
    """Columns, limits and cuts of some stars of a problem, in the room that is left for them."""

    def __init__(self, problem: Problem, room: Room, stars: Sequence[int]) -> None:
        self.problem = problem
        self.budget_h = room.budget_h
        self.slots_h = room.slots_h.copy()
        # A visit adds at most what it is worth alone: those worth less than the strategy asks are never made. Where a
        # detection needs several, it is they together that have to be worth it.
        least = problem.strategy.scheduler.min_gain if problem.needed == 1 else 0.0
        self.columns: list[tuple[int, Visit]] = []
        for i in stars:
            alone = _worth(problem, i, ()).gains()[1]
            fits = problem.stars[i].cost_h <= np.minimum(self.slots_h, self.budget_h)
            useful = np.argwhere(fits & (alone >= least) & (alone > 0.0))
            self.columns += [(i, (int(option), int(slot))) for option, slot in useful]
        self.cuts: list[_Cut] = []
        owner = np.array([star for star, _ in self.columns], int)
        self._own = [np.flatnonzero(owner == i) for i in range(len(problem.stars))]

    def add_prefixes(self, made: dict[int, list[Visit]]) -> None:
        """Cuts of every star after none, one, two ... of its visits."""
        for star in range(len(self.problem.stars)):
            visits = made.get(star, [])
            for count in range(len(visits) + 1):
                self._add(star, visits[:count])

    def _add(self, star: int, visits: Sequence[Visit]) -> float:
        """One cut; returns what the visits are worth in `U`."""
        state = _worth(self.problem, star, visits)
        upper = state.gains()[1]
        gains = np.zeros(len(self.columns))
        for k in self._own[star]:
            visit = self.columns[k][1]
            gains[k] = 0.0 if visit in visits else upper[visit]
        self.cuts.append(_Cut(star, state.upper, gains))
        return state.upper

    def rounds(self, *, whole: bool) -> tuple[dict[int, list[Visit]], float]:
        """Solve, cut where too much was promised, and solve again; visits chosen and the least bound."""
        before = bound = np.inf
        chosen: dict[int, list[Visit]] = {}
        best_value = -np.inf
        gap = self.problem.strategy.scheduler.gap
        for _ in range(_ROUNDS):
            x, promised, top = self._solve(whole)
            bound = min(bound, top)
            made = _by_star(column for column, part in zip(self.columns, x, strict=True) if part > _KEPT)
            value, worst = 0.0, 0.0
            for star in range(len(self.problem.stars)):
                worth = self._add(star, made.get(star, ()))
                value += worth
                worst = max(worst, promised[star] - worth)
            real = _value(self.problem, made)
            if real > best_value:
                best_value, chosen = real, made
            if worst <= _CHOSEN * max(bound, _CHOSEN) or (whole and bound - real <= gap * bound):
                break
            if whole and len(self.columns) > _MANY and before - bound < _SLOW * gap * bound:
                break
            before = bound
        return chosen, float(bound)

    def _solve(self, whole: bool) -> tuple[FloatArray, FloatArray, float]:
        """Shares of the columns, promised values of the stars, and the bound of one programme."""
        from scipy.optimize import Bounds, LinearConstraint, milp
        from scipy.sparse import csr_array, hstack, vstack

        n, stars = len(self.columns), len(self.problem.stars)
        if n == 0:
            return np.zeros(0), np.zeros(stars), 0.0
        cuts = csr_array(np.stack([cut.gains for cut in self.cuts]))
        at = np.arange(len(self.cuts)), [cut.star for cut in self.cuts]
        mark = csr_array((np.ones(len(self.cuts)), at), shape=(len(self.cuts), stars))
        rows, limits = self._limits()
        below = hstack([rows, csr_array((rows.shape[0], stars))])
        high = np.concatenate([[cut.start for cut in self.cuts], limits])
        constraints = LinearConstraint(vstack([hstack([-cuts, mark]), below]), -np.inf, high)
        # Visits between none and whole, values of the stars without limits: their sum is to be large.
        cost, most, kinds = np.repeat([[0.0, 1.0, float(whole)], [-1.0, np.inf, 0.0]], [n, stars], axis=0).T
        options = {"mip_rel_gap": 0.2 * self.problem.strategy.scheduler.gap, "node_limit": _NODES} if whole else {}
        with _remarks_aside():
            found = milp(cost, constraints=constraints, bounds=Bounds(0.0, most), integrality=kinds, options=options)
        if found.x is None:  # no whole allocation within the nodes: none is promised
            return np.zeros(n), np.zeros(stars), np.inf
        bound = found.mip_dual_bound if whole else found.fun
        return found.x[:n], found.x[n:], -float(bound)

    def _limits(self) -> tuple[Any, FloatArray]:
        """Budget, slots, visits of each star, and slots that are too near, as rows of ``A x <= b``."""
        from scipy.sparse import csr_array

        problem = self.problem
        cost = np.array([problem.cost_h(*column) for column in self.columns])
        slot = np.array([visit[1] for _, visit in self.columns])
        every = np.arange(len(cost))
        rows: list[tuple[IntArray, FloatArray, float]] = [(every, cost, self.budget_h)]
        for b in np.unique(slot):
            mine = every[slot == b]
            rows.append((mine, cost[mine], float(self.slots_h[b])))
        for star, own in zip(problem.stars, self._own, strict=True):
            rows.append((own, np.ones(own.size), float(star.visits_left)))
            for b in np.unique(slot[own]):
                near = own[(slot[own] >= b) & problem.near(star, int(b))[slot[own]]]
                if near.size > 1:
                    rows.append((near, np.ones(near.size), 1.0))
        columns, values, limits = zip(*rows, strict=True)
        at = np.repeat(np.arange(len(rows)), [len(part) for part in columns]), np.concatenate(columns)
        return csr_array((np.concatenate(values), at), shape=(len(rows), len(cost))), np.array(limits)
