"""Schedules and their bounds against all schedules of small problems."""

import ctypes
from dataclasses import replace
from unittest import mock

import numpy as np
import pytest
import scipy.optimize
from hypothesis import given, settings, strategies as st

from cpic_planner.survey import schedule as module
from cpic_planner.survey.schedule import Effort, Problem, make_schedule

LIMITS = st.fixed_dictionaries(
    {
        "budget_h": st.floats(2.0, 20.0),
        "share": st.sampled_from([0.15, 0.25, 0.4]),
        "gap_days": st.sampled_from([0.0, 25.0, 45.0]),
    }
)


def visits_of(schedule):
    return [(visit.star, (visit.option, visit.slot)) for visit in schedule.visits if not visit.reserve]


def with_method(problem, method):
    rules = problem.strategy
    scheduler = rules.scheduler.model_copy(update={"method": method})
    return replace(problem, strategy=rules.model_copy(update={"scheduler": scheduler}))


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), needed=st.integers(1, 3), limits=LIMITS)
def test_values_and_bounds_hold_the_optimum_between_them(problems, seed, needed, limits):
    problem = problems.random_problem(seed, needed=needed, **limits)
    best = problems.optimum(problem)
    values = {}
    for method in ("greedy", "auto", "exact"):
        schedule = make_schedule(with_method(problem, method))
        visits = visits_of(schedule)
        assert problems.allowed(problem, visits)
        assert schedule.value == pytest.approx(problems.worth(problem, visits, needed), abs=1e-9)
        assert schedule.value <= best + 1e-9
        assert schedule.bound >= best - 1e-9
        assert schedule.bound >= schedule.value
        values[method] = schedule.value
    assert values["auto"] >= values["greedy"] - 1e-9
    assert values["exact"] == pytest.approx(best, rel=1e-6, abs=1e-9)


def against_all_schedules(problems, needed, seeds, least):
    """By default, against all schedules of two stars and four slots; at least so many surveys can show a planet."""
    reached, tops = [], []
    for seed in range(seeds):
        limits = {"budget_h": (6.0, 10.0, 15.0, 100.0)[seed % 4], "gap_days": (0.0, 25.0, 45.0)[seed % 3]}
        problem = problems.random_problem(seed + 1000 * needed, slots=4, needed=needed, **limits)
        best = problems.optimum(problem)
        if best > 0.0:
            schedule = make_schedule(problem)
            reached.append(schedule.value / best)
            tops.append(schedule.bound / best)
    assert len(reached) >= least
    assert min(reached) > 0.5
    assert np.mean(reached) >= 0.98
    assert min(tops) >= 1.0 - 1e-9
    assert np.mean(tops) <= 1.5


@pytest.mark.parametrize(("needed", "seeds", "least"), [(1, 36, 34), (3, 120, 20)])
def test_small_problems_are_planned_as_well_as_possible(problems, needed, seeds, least):
    against_all_schedules(problems, needed, seeds, least)


@pytest.mark.long
@pytest.mark.parametrize(("needed", "seeds", "least"), [(1, 140, 135), (2, 240, 160), (3, 620, 100)])
def test_four_hundred_small_problems_are_planned_as_well_as_possible(problems, needed, seeds, least):
    against_all_schedules(problems, needed, seeds, least)


def against_a_long_search(problems, seeds):
    reached, tops = [], []
    for needed in (1, 2, 3):
        for seed in seeds:
            problem = problems.large_problem(seed, needed=needed, budget_h=(30.0, 60.0)[seed // 2 % 2])
            best, schedule = problems.long_search(problem), make_schedule(problem)
            assert problems.allowed(problem, visits_of(schedule))
            reached.append(schedule.value / best)
            tops.append(schedule.bound / best)
    return np.array(reached), np.array(tops)


def test_seven_stars_with_twenty_visits_are_planned_nearly_as_well_as_possible(problems):
    reached, tops = against_a_long_search(problems, [4])
    assert reached.min() >= 0.98
    assert reached.max() <= 1.0 + 1e-6
    assert tops.min() >= 1.0 - 1e-6
    assert tops.max() <= 1.5


@pytest.mark.long
def test_more_of_seven_stars_with_twenty_visits(problems, record_property):
    reached, tops = against_a_long_search(problems, range(12))
    record_property("surveys", len(reached))
    record_property("value over the optimum, mean and least", f"{reached.mean():.4f} {reached.min():.4f}")
    record_property("bound over the optimum, mean and most", f"{tops.mean():.4f} {tops.max():.4f}")
    assert reached.mean() >= 0.98
    assert reached.max() <= 1.0 + 1e-6
    assert tops.min() >= 1.0 - 1e-6
    assert tops.mean() <= 1.5


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000), needed=st.integers(1, 3), limits=LIMITS, nodes=st.sampled_from([0, 3, 12]))
def test_bounds_are_true_wherever_the_search_ends(problems, seed, needed, limits, nodes):
    """With no search tree at all it is the cuts that bound a star; with a few nodes, whichever is lower."""
    problem = problems.random_problem(seed, slots=4, needed=needed, **limits)
    effort = Effort(rounds=0, choice=1, gap=0.1, nodes=nodes, bounds=1, cuts=3)
    with mock.patch.object(module, "_DEEP", 0 if nodes < 12 else 5):
        schedule = make_schedule(problem, effort)
    assert problems.allowed(problem, visits_of(schedule))
    assert schedule.bound >= problems.optimum(problem) - 1e-9


def test_a_problem_that_the_programme_solves_better(problems):
    """Budget for two cheap visits or one dear one that gives more an hour, but less in all."""
    rng = np.random.default_rng(0)
    star = problems.candidate(rng, slots=2, planets=1, visits_left=1)
    stars = tuple(
        replace(star, cost_h=np.full((1, 2), cost), chance=np.full((1, 2, 1), chance, np.float32), weight=np.ones(1))
        for cost, chance in ((6.0, 0.7), (5.0, 0.5), (5.0, 0.5))
    )
    found = {
        method: make_schedule(
            Problem(problems.strategy(budget_h=10.0, share=1.0, method=method), stars, np.full(2, 100.0))
        )
        for method in ("greedy", "auto")
    }
    assert found["greedy"].value == pytest.approx(0.7, rel=1e-6)
    assert found["auto"].value == pytest.approx(1.0, rel=1e-6)
    assert found["auto"].method == "plans of stars"
    assert found["auto"].distance < 0.01
    assert found["greedy"].bound >= 1.0


@settings(max_examples=12)
@given(seed=st.integers(0, 10_000), needed=st.integers(1, 2), least=st.sampled_from([0.02, 0.1, 0.3]))
def test_bounds_hold_where_visits_have_to_be_worth_something(problems, seed, needed, least):
    """Visits of less worth are never made, and what is made is within the bound."""
    for method in ("greedy", "auto"):
        problem = problems.random_problem(seed, stars=3, needed=needed, budget_h=12.0, min_gain=least, method=method)
        schedule = make_schedule(problem)
        visits = visits_of(schedule)
        assert problems.allowed(problem, visits)
        value = problems.worth(problem, visits, needed)
        assert schedule.value == pytest.approx(value, abs=1e-9)
        assert schedule.bound >= value - 1e-9
        assert value >= least * len(visits) - 1e-9
        for star, visit in visits if needed == 1 else ():
            assert problems.outcomes(problem.stars[star], 1, [visit]) >= least - 1e-9


@settings(max_examples=8)
@given(seed=st.integers(0, 10_000), budget_h=st.floats(4.0, 12.0))
def test_stars_that_come_first_are_served_as_well_as_they_can_be(problems, seed, budget_h):
    """The first star gets the best of all its schedules, whatever that costs the other one."""
    problem = problems.random_problem(seed, first="first", budget_h=budget_h, method="auto")
    known, other = problem.stars
    problem = replace(problem, stars=(other, replace(known, known_rows=(0,), weight=known.weight * 1e-3)))
    schedule = make_schedule(problem)
    visits = visits_of(schedule)
    assert problems.allowed(problem, visits)
    best = problems.optimum(replace(problem, stars=problem.stars[1:]))
    found = problems.worth(problem, [item for item in visits if item[0] == 1], 1)
    assert found >= best * (1.0 - 0.011) - 1e-9
    assert schedule.bound >= problems.optimum(problem) - 1e-9
    # The other one gets the best of what is left.
    mine = [item for item in visits if item[0] == 1]
    left = max(
        problems.worth(problem, [item for item in both if item[0] == 0], 1)
        for both in problems.schedules(problem)
        if [item for item in both if item[0] == 1] == sorted(mine)
    )
    assert schedule.value - found >= left * (1.0 - 0.011) - 1e-9


@pytest.mark.parametrize("method", ["greedy", "auto"])
def test_reserve_visits_come_on_top(problems, method):
    without = make_schedule(problems.random_problem(5, stars=4, slots=6, budget_h=8.0, method=method))
    problem = problems.random_problem(5, stars=4, slots=6, budget_h=8.0, method=method, reserve=1.0)
    schedule = make_schedule(problem)
    assert visits_of(schedule) == visits_of(without)
    assert schedule.value == without.value
    every = [(visit.star, (visit.option, visit.slot)) for visit in schedule.visits]
    assert len(every) > len(visits_of(schedule))
    # All of them keep the limits of a budget that is as much larger.
    larger = problem.strategy.model_copy(update={"time_budget_h": 16.0})
    assert problems.allowed(replace(problem, strategy=larger), every)


def test_nothing_to_do(problems):
    for stars in ((), (replace(problems.candidate(np.random.default_rng(1)), cost_h=np.full((1, 4), np.inf)),)):
        for method in ("greedy", "auto"):
            schedule = make_schedule(Problem(problems.strategy(method=method), stars, np.full(4, 100.0)))
            assert schedule.visits == ()
            assert (schedule.value, schedule.bound, schedule.distance) == (0.0, 0.0, 0.0)


def test_what_the_solver_prints_is_not_on_the_standard_output(problems, monkeypatch, capfd):
    """It writes through C, past Python; the standard output is that of ``--json``."""
    real = scipy.optimize.milp

    def talking(*args, **options):
        ctypes.CDLL(None).puts(b"a remark of the solver")
        return real(*args, **options)

    monkeypatch.setattr(scipy.optimize, "milp", talking)
    print("before")
    make_schedule(problems.random_problem(3, method="auto"))
    print("after")
    out, err = capfd.readouterr()
    assert out == "before\nafter\n"
    assert "a remark of the solver" in err
