"""A small run on a cluster, importable by its workers and by a client that is a process of its own."""

import os
import time
from pathlib import Path

import numpy as np

from cpic_core import stream
from cpic_planner.jobs.folder import open_run_folder
from cpic_planner.jobs.job import run_tasks
from cpic_planner.results import Column
from cpic_planner.survey.tables import ResultStore, Table

N_TASKS = 40
TABLES = (
    Table(
        "draws",
        (Column("star", "string", "star"), Column("draw", "int64", "universe"), Column("found", "float64", "planets")),
        key=("star", "draw"),
    ),
    Table("time", (Column("part", "int32", "task"), Column("time_s", "float64", "time", "s")), key=("part",)),
)
MODEL = np.linspace(0.5, 1.5, 100_000)
TASK_S = 0.03
HELD = 5


def observe(model, held, index):
    """Rows of one part; short, but longer than what a cluster needs to hand it out.

    Task `HELD` says in the folder ``held``, if there is one, that it has begun, and in which process; it ends when the
    folder has a file ``go``.
    """
    time.sleep(TASK_S)
    if held and index == HELD:
        Path(held, f"begun-{os.getpid()}").touch()
        while not Path(held, "go").exists():
            time.sleep(TASK_S)
    rng = stream(11, "part", index)
    draws = np.arange(index, 200, N_TASKS)
    found = model[rng.integers(len(model), size=len(draws))] + rng.standard_normal(len(draws))
    return {
        "draws": {"star": [f"star {index % 3}"] * len(draws), "draw": draws, "found": found},
        "time": {"part": [index], "time_s": [float(model[index])]},
    }


def begun(held):
    """Processes in which task `HELD` has begun, once there is one."""
    while not (marks := list(Path(held).glob("begun-*"))):
        time.sleep(TASK_S)
    return [int(mark.name.partition("-")[2]) for mark in marks]


def survey(out, *, advance=lambda done: None, held="", **cluster):
    """Do what is not there yet; the numbers of the parts done here, in order, and the files at the end."""
    with open_run_folder(out, kind="whatif", config_hash="c0ffee") as folder:
        store = ResultStore(folder, TABLES)
        kept = store.finished()
        waiting = [index for index in range(N_TASKS) if str(index) not in kept]
        done = []
        for position, tables in run_tasks(
            observe, [(index,) for index in waiting], common=(MODEL, str(held)), **cluster
        ):
            store.save_part(str(waiting[position]), tables)
            done.append(waiting[position])
            advance(len(done))
        files = store.merge(expected=[str(index) for index in range(N_TASKS)])
        return done, {name: path.read_bytes() for name, path in files.items()}
