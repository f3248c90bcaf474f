"""The greedy schedule: the visits of most expected detections per hour, with a look ahead, into the calendar."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

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
