"""The schedule of a strategy, and the bound that says how far it may be from the best one."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from cpic_planner.survey.bounds import add_all_near, lagrangian_bound
from cpic_planner.survey.plans import Chosen, Pool, exchanged, greedy, least_gain, pools_of, priced, share
from cpic_planner.survey.schedule import ROUNDING, Problem, Room, Schedule, StarValue, Visit, in_order


@dataclass(frozen=True)
class Effort:
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


def make_schedule(problem: Problem, effort: Effort | None = None) -> Schedule:
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
    """
    rule = problem.strategy.scheduler
    effort = effort or EFFORTS[rule.method]
    _, booked = greedy(problem)
    made = _by_star((star, visit) for star, visit, _ in booked)
    chosen, bound = _planned(problem, made, effort)
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
    return Schedule(in_order(problem.stars, booked, spare), value, max(bound, value), method)


def _planned(problem: Problem, made: Chosen, effort: Effort) -> tuple[Chosen, float]:
    """Return the plans of all stars, group after group, and what no schedule can pass."""
    groups, room = problem.groups(), Room.of(problem)
    found: Chosen = {}
    bound = 0.0
    part = effort if len(groups) == 1 else replace(effort, nodes=effort.nodes // 4, bounds=1)
    for group in groups:
        chosen, bound = _of_group(problem, room, group, made, part)
        for star, visits in sorted(chosen.items()):
            for visit in visits:
                room.take(star, visit, problem.cost_h(star, visit))
        found |= chosen
    if len(groups) > 1:
        bound = _of_group(problem, Room.of(problem), range(len(problem.stars)), made | found, effort)[1]
    return found, bound


def _of_group(problem: Problem, room: Room, group: Sequence[int], made: Chosen, effort: Effort) -> tuple[Chosen, float]:
    """Return the plans of stars in the time that is left for them, and what no schedule of these can pass."""
    each = effort.nodes // max(len(group), 1)
    pools = pools_of(problem, room, group, made)
    priced(problem, room, pools, effort.rounds)
    prices = share(problem, room, pools).prices
    bound = lagrangian_bound(problem, room, pools, prices, effort.cuts, each)
    for _ in range(1, effort.bounds):
        before, prices = prices, share(problem, room, pools).prices
        if prices.near(before):
            break
        again = lagrangian_bound(problem, room, pools, prices, effort.cuts, each)
        bound = min(bound, again, key=lambda item: item.value)
    own = {star: made[star] for star in group if star in made}
    chosen = _best(problem, room, group, pools, own if _fits(problem, room, own) else {}, effort)
    value = sum(StarValue.of(problem.stars[star], problem.needed, visits).value for star, visits in chosen.items())
    least = bound.value
    if value < least and bound.ended and add_all_near(problem, room, pools, bound, value, each):
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


def _fits(problem: Problem, room: Room, made: Chosen) -> bool:
    """Return whether what is left holds all of these visits."""
    left = Room(room.budget_h, room.slots_h.copy())
    for star, visits in made.items():
        for visit in visits:
            left.take(star, visit, problem.cost_h(star, visit))
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


def _by_star(visits: Iterable[tuple[int, Visit]]) -> Chosen:
    made: Chosen = {}
    for star, visit in visits:
        made.setdefault(star, []).append(visit)
    return made


def _gains(problem: Problem, star: int, visits: Sequence[Visit]) -> list[tuple[int, Visit, float]]:
    """Return the visits of a star in the order of the calendar, with what each adds."""
    state = StarValue.none(problem.stars[star], problem.needed)
    found = []
    for visit in sorted(visits, key=lambda item: item[1]):
        after = state.after(visit)
        found.append((star, visit, after.value - state.value))
        state = after
    return found
