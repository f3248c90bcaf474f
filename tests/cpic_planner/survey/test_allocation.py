"""Schedules and their bounds against all schedules of small problems."""

import ctypes
from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
from hypothesis import given, settings, strategies as st

from cpic_planner.survey.allocation import make_schedule
from cpic_planner.survey.schedule import Problem

LIMITS = st.fixed_dictionaries(
    {
        "budget_h": st.floats(2.0, 20.0),
        "share": st.sampled_from([0.15, 0.25, 0.4]),
        "gap_days": st.sampled_from([0.0, 25.0, 45.0]),
    }
)


def visits_of(schedule):
    return [(visit.star, (visit.option, visit.slot)) for visit in schedule.visits if not visit.reserve]


@settings(max_examples=40)
@given(seed=st.integers(0, 10_000), needed=st.sampled_from([1, 1, 2]), limits=LIMITS)
def test_values_and_bounds_hold_the_optimum_between_them(problems, seed, needed, limits):
    problem = problems.random_problem(seed, needed=needed, **limits)
    best = problems.optimum(problem)
    values = {}
    for method in ("greedy", "auto"):
        rules = problem.strategy
        rules = rules.model_copy(update={"scheduler": rules.scheduler.model_copy(update={"method": method})})
        schedule = make_schedule(replace(problem, strategy=rules))
        visits = visits_of(schedule)
        assert problems.allowed(problem, visits)
        assert schedule.value == pytest.approx(problems.worth(problem, visits, needed), abs=1e-9)
        assert schedule.value <= best + 1e-9
        assert schedule.bound >= best - 1e-6
        assert schedule.bound >= schedule.value
        values[method] = schedule
    assert values["auto"].value >= values["greedy"].value - 1e-9
    assert values["auto"].bound <= values["greedy"].bound + 1e-6
    if needed == 1:
        # Single detections: the programme comes as near to the optimum as it says, or as asked.
        assert values["auto"].value >= best * (1.0 - max(0.011, values["auto"].distance)) - 1e-9
        assert values["auto"].distance <= 0.011 + 1e-9


@pytest.mark.parametrize(("needed", "seeds", "most_lost"), [(2, 20, 0.02), (3, 40, 0.001)])
def test_several_visits_for_a_detection_are_planned_nearly_as_well_as_possible(problems, needed, seeds, most_lost):
    """Against all schedules of two stars and four slots; a survey that could show planets is never empty."""
    reached = []
    for seed in range(seeds):
        for budget_h, gap_days in ((6.0, 0.0), (10.0, 25.0), (15.0, 45.0)):
            problem = problems.random_problem(seed, slots=4, needed=needed, budget_h=budget_h, gap_days=gap_days)
            best = problems.optimum(problem)
            if best > 0.0:
                reached.append(make_schedule(problem).value / best)
    assert len(reached) >= 9
    assert min(reached) > 0.5
    assert np.mean(reached) > 1.0 - most_lost


@given(seed=st.integers(0, 300))
@settings(max_examples=1)
def test_larger_problems_end_within_their_gap(problems, seed):
    problem = problems.random_problem(seed, stars=6, slots=8, options=2, budget_h=30.0, method="auto", gap=0.02)
    schedule = make_schedule(problem)
    assert problems.allowed(problem, visits_of(schedule))
    assert schedule.distance <= 0.021


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


@settings(max_examples=25)
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
        # Where one detection is enough, visits of the programme are worth as much alone, not together.
        assert value >= least * len(visits) - 1e-9 or (method == "auto" and needed == 1)
        for star, visit in visits if needed == 1 else ():
            assert problems.outcomes(problem.stars[star], 1, [visit]) >= least - 1e-9


@settings(max_examples=15)
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
