"""Small random scheduling problems, and all their schedules."""

import itertools

import numpy as np

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
    chance = (rng.random((options, slots, planets)) * (rng.random((options, slots, planets)) < 0.6)).astype(np.float32)
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
    needed = problem.strategy.detection.visits_needed
    return max(worth(problem, visits, needed) for visits in schedules(problem))


def worth(problem, visits, needed):
    """Value of a set of visits of all stars."""
    return sum(
        outcomes(star, needed, [visit for owner, visit in visits if owner == i]) for i, star in enumerate(problem.stars)
    )
