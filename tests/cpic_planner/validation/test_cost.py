"""What a task is expected to take: from what its dial makes of it."""

from dataclasses import replace

import pytest

from cpic_planner.confirmed import images_cost
from cpic_planner.etc.model import build_model
from cpic_planner.etc.planet import ReferencePlanet
from cpic_planner.targets import find_target
from cpic_planner.validation.cost import task_cost
from cpic_planner.validation.task import prepare_task
from simulator import load_instrument


@pytest.fixture(scope="module")
def task():
    model = build_model(load_instrument(), ["F850"])
    target, _ = find_target("tau Cet")
    ready = prepare_task(model, target, "F850", time_s=3600.0, planet=ReferencePlanet(), seed=1, realisations=8)
    return replace(ready, n_frames=30)


def test_tiers_are_ordered_in_time(task):
    coarse, fine, whole = (
        task_cost(replace(task, **dial))
        for dial in ({"tolerance": 0.2}, {"fidelity": "standard"}, {"fidelity": "reference"})
    )
    assert coarse.work_s < fine.work_s < 0.1 * whole.work_s
    assert coarse.memory_mb <= fine.memory_mb < whole.memory_mb


def test_frames_are_those_that_are_drawn(task):
    assert (task_cost(task).frames, task_cost(task).realisations) == (0, 8)
    audited = task_cost(replace(task, audit=True))
    assert audited.frames == 2 * 30
    assert audited.work_s > task_cost(task).work_s
    whole = task_cost(replace(task, fidelity="reference"))
    assert (whole.frames, whole.realisations) == (8 * 2 * 30, 8)
    fewer = replace(task, fidelity="reference", strategy=task.strategy | {"reference_ratio": 0.5})
    assert task_cost(fewer).frames == 8 * 45


def test_more_work_takes_longer(task):
    twice = replace(task, realisations=16)
    assert task_cost(twice).work_s > task_cost(task).work_s
    short, long = (task_cost(replace(task, fidelity="reference", n_frames=n)).work_s for n in (30, 300))
    assert long > 3 * short


def test_workers_share_pieces_and_no_piece_is_shared(task):
    one, two, many = (images_cost([task, task]).at(workers)["wall_s"] for workers in (1, 2, 8))
    assert one > two == many
    assert images_cost([task]).at(8)["wall_s"] == images_cost([task]).at(1)["wall_s"]
    empty = images_cost([]).at(2)
    assert (empty["n_tasks"], empty["n_frames"], empty["memory_mb"]) == (0, 0, 0.0)
