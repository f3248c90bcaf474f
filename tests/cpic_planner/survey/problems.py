"""Small random scheduling problems, and all their schedules."""

import itertools
from dataclasses import replace

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, linprog, milp

from cpic_planner.survey.candidates import Candidate
from cpic_planner.survey.detection import Setting
from cpic_planner.survey.schedule import Problem
from cpic_planner.survey.strategy import SurveyStrategy
from cpic_planner.survey.universe import NEW

SETTING = Setting("F520", 10.0, 10.0, 100.0, 200.0)


def candidate(rng, *, options=1, slots=4, planets=6, visits_left=3, day=None, known=()):
    """A star with random costs and chances; every fifth visit is impossible."""
    cost = rng.uniform(1.0, 6.0, (options, slots))
    cost[rng.random((options, slots)) < 0.2] = np.inf
    chance = (rng.random((options, slots, planets)) * (rng.random((options, slots, planets)) < 0.6)).astype(np.float64)
    day = 30.0 * np.arange(slots) + rng.uniform(0.0, 29.0, slots) if day is None else day
    weight, new = rng.uniform(0.0, 0.3, planets), np.full(planets, NEW)
    return Candidate(0, (SETTING,) * options, cost, chance, weight, known, visits_left, day, new)


def strategy(*, budget_h=10.0, share=0.25, needed=1, gap_days=0.0, max_visits=3, first="any", **scheduler):
    """A strategy of the given limits."""
    return SurveyStrategy(
        name="x",
        time_budget_h=budget_h,
        slot_share=share,
        detection={"visits_needed": needed},
        revisits={"max_visits": max(max_visits, needed), "min_gap_days": gap_days},
        targets={"known_planets": first},
        scheduler={"min_gain": 0.0, "reserve": 0.0} | scheduler,
    )


def random_problem(seed, *, stars=2, slots=3, options=1, slot_h=28.0, **more):
    """A problem with few enough visits to try all subsets of them."""
    rng = np.random.default_rng(seed)
    made = tuple(
        candidate(rng, slots=slots, options=options, visits_left=int(rng.integers(1, 4))) for _ in range(stars)
    )
    return Problem(strategy(**more), made, np.full(slots, slot_h))


def outcomes(star, needed, visits):
    """Value by the tree of all outcomes, planet by planet."""
    value = 0.0
    for planet, weight in enumerate(star.weight):
        chances = [float(star.chance[option, slot, planet]) for option, slot in visits]
        for hits in itertools.product((False, True), repeat=len(chances)):
            if sum(hits) >= needed:
                value += weight * float(np.prod([p if hit else 1.0 - p for p, hit in zip(chances, hits, strict=True)]))
    return value


def allowed(problem, visits):
    """Whether visits ``(star, (option, slot))`` keep all limits."""
    rules = problem.strategy
    costs = [problem.stars[star].cost_h[visit] for star, visit in visits]
    if not np.isfinite(costs).all() or sum(costs) > rules.time_budget_h + 1e-9:
        return False
    for slot, length in enumerate(problem.slot_h):
        used = sum(cost for cost, (_, visit) in zip(costs, visits, strict=True) if visit[1] == slot)
        if used > rules.slot_share * length + 1e-9:
            return False
    for i, star in enumerate(problem.stars):
        own = [visit[1] for owner, visit in visits if owner == i]
        if len(own) > star.visits_left or len(set(own)) < len(own):
            return False
        days = np.sort(star.day[own])
        if np.any(np.diff(days) < rules.revisits.min_gap_days - 1e-9):
            return False
    return True


def schedules(problem):
    """All sets of visits that keep the limits, each in the order of star, option and slot."""
    every = [
        (i, (int(o), int(s))) for i, star in enumerate(problem.stars) for o, s in np.argwhere(np.isfinite(star.cost_h))
    ]
    for size in range(len(every) + 1):
        yield from ([*visits] for visits in itertools.combinations(every, size) if allowed(problem, visits))


def optimum(problem):
    """Best value of any set of visits."""
    needed, known = problem.strategy.detection.visits_needed, {}

    def of_star(i, visits):
        if (i, visits) not in known:
            known[i, visits] = outcomes(problem.stars[i], needed, visits)
        return known[i, visits]

    stars = range(len(problem.stars))
    return max(
        sum(of_star(i, tuple(visit for owner, visit in visits if owner == i)) for i in stars)
        for visits in schedules(problem)
    )


def large_problem(seed, *, needed, budget_h):
    """Seven stars with up to twenty visits, some of them too near to each other."""
    problem = random_problem(
        seed, stars=7, slots=20, needed=needed, budget_h=budget_h, gap_days=(35.0, 60.0)[seed % 2], max_visits=20
    )
    return replace(problem, stars=tuple(replace(star, visits_left=20) for star in problem.stars))


def every_plan(problem, star):
    """All sets of visits of a star that keep its limits, ``(n, slots)`` of bool, with their values; one option."""
    needed, rules = problem.strategy.detection.visits_needed, problem.strategy
    counts = np.eye(1, needed)[..., None] * np.ones(len(star.weight))
    made, value = np.zeros((1, len(star.day)), bool), np.zeros(1)
    for slot in np.argsort(star.day):
        cost = star.cost_h[0, slot]
        if not cost <= rules.slot_share * problem.slot_h[slot]:
            continue
        near = np.abs(star.day - star.day[slot]) < rules.revisits.min_gap_days
        free = ~made[:, near].any(axis=1) & (made.sum(axis=1) < star.visits_left)
        chance = star.chance[0, slot].astype(float)
        before, more = counts[free], made[free]
        after = before * (1.0 - chance)
        after[:, 1:] += before[:, :-1] * chance
        more[:, slot] = True
        value = np.concatenate([value, value[free] + (before[:, -1] * chance) @ star.weight])
        counts, made = np.concatenate([counts, after]), np.concatenate([made, more])
    return made, value


def long_search(problem):
    """Best value of one plan for each star, of all plans that there are.

    Prices of the time by linear programming over more and more plans, until no plan of all is worth more than its time;
    then whole ones among all that can be in a schedule better than the best of those.
    """
    n, limits = len(problem.stars), problem.strategy.slot_share * problem.slot_h
    high = np.concatenate([[problem.strategy.time_budget_h], limits, np.ones(n)])
    every = [every_plan(problem, star) for star in problem.stars]
    hours = [
        made * np.nan_to_num(star.cost_h[0], posinf=0.0) for (made, _), star in zip(every, problem.stars, strict=True)
    ]
    rows = [[0] for _ in every]

    def programme():
        matrix = [
            np.concatenate([[hours[i][row].sum()], hours[i][row], np.eye(n)[i]]) for i in range(n) for row in rows[i]
        ]
        return np.array(matrix).T, -np.concatenate([every[i][1][rows[i]] for i in range(n)])

    while True:
        matrix, worth_ = programme()
        found = linprog(worth_, A_ub=matrix, b_ub=high)
        price = -found.ineqlin.marginals[: 1 + len(limits)]
        net = [every[i][1] - hours[i] @ (price[0] + price[1:]) for i in range(n)]
        bound = price @ high[: len(price)] + sum(part.max() for part in net)
        if bound + found.fun < 1e-9:
            break
        rows = [sorted({*rows[i], *np.argsort(-net[i])[:3].tolist()}) for i in range(n)]

    def whole():
        matrix, worth_ = programme()
        ones, rule = np.ones(len(worth_)), LinearConstraint(matrix, -np.inf, high)
        return -milp(worth_, constraints=rule, bounds=Bounds(0, 1), integrality=ones, options={"mip_rel_gap": 0.0}).fun

    slack = bound - whole() + 1e-9
    rows = [sorted({0, *np.flatnonzero(part >= part.max() - slack).tolist()}) for part in net]
    return whole()


def worth(problem, visits, needed):
    """Value of a set of visits of all stars."""
    return sum(
        outcomes(star, needed, [visit for owner, visit in visits if owner == i]) for i, star in enumerate(problem.stars)
    )
