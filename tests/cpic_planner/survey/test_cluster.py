"""A real scheduler and real workers, killed with a task in flight: the same files in the end, each part counted once.

The task itself says that it has begun, and cannot end before the kill.
"""

import contextlib
import importlib.util
import logging
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from cpic_core import ClusterError
from cpic_planner.jobs.folder import open_run_folder
from cpic_planner.survey import run_whatif
from cpic_planner.survey.tables import ResultStore

pytestmark = pytest.mark.long
HERE = Path(__file__).resolve().parent
PATHS = os.pathsep.join([str(HERE), str(HERE.parents[2]), os.environ.get("PYTHONPATH", "")])
EVERY_PART = list(range(40))


@pytest.fixture(scope="module")
def tasks():
    """The module of the run, under the name by which workers import it."""
    spec = importlib.util.spec_from_file_location("cluster_tasks", HERE / "cluster_tasks.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def undisturbed(tasks, tmp_path_factory):
    done, files = tasks.survey(tmp_path_factory.mktemp("serial") / "out")
    assert done == EVERY_PART
    return files


class Cluster:
    """Processes of a scheduler and its workers on this machine, at one address for life."""

    def __init__(self, scratch):
        self.scratch = scratch
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.processes = []
        self.scheduler = None
        self.workers = []

    def start(self, program, *options, **environment):
        process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                f"distributed.cli.dask_{program}",
                *options,
                "--host",
                "127.0.0.1",
                "--no-dashboard",
            ],
            env=os.environ | {"PYTHONPATH": PATHS} | environment,
            cwd=self.scratch,
            stderr=subprocess.DEVNULL,
        )
        self.processes.append(process)
        return process

    def start_scheduler(self, **environment):
        self.scheduler = self.start("scheduler", "--port", str(self.port), **environment)

    def start_workers(self, n_workers):
        options = ("--no-nanny", "--nthreads", "1", "--memory-limit", "0", "--local-directory", str(self.scratch))
        self.workers = [self.start("worker", self.address, *options) for _ in range(n_workers)]

    def kill(self, process):
        os.kill(process.pid, signal.SIGKILL)
        process.wait()

    def close(self):
        for process in self.processes:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
        for process in self.processes:
            process.wait()


@pytest.fixture
def cluster(tmp_path):
    made = Cluster(tmp_path)
    try:
        yield made
    finally:
        made.close()


@pytest.fixture
def held(tmp_path):
    """Where the task that waits for a kill says that it has begun."""
    (tmp_path / "held").mkdir()
    return tmp_path / "held"


def test_a_worker_dies(tasks, undisturbed, cluster, held, tmp_path):
    """The one that is left does its work."""
    cluster.start_scheduler()
    cluster.start_workers(2)
    killed = []

    def advance(done):
        if done == 10:
            (pid,) = tasks.begun(held)
            cluster.kill(next(worker for worker in cluster.workers if worker.pid == pid))
            (held / "go").touch()
            killed.append(pid)

    done, files = tasks.survey(tmp_path / "out", scheduler=cluster.address, advance=advance, held=held)
    assert sorted(done) == EVERY_PART
    assert files == undisturbed
    left = {worker.pid for worker in cluster.workers} - set(killed)
    assert {*tasks.begun(held)} == {*killed, *left}  # begun twice, the second time by the other one
    assert done.index(tasks.HELD) >= 10


class Told(logging.Handler):
    """Keeps what the dispatcher says, and acts on it."""

    def __init__(self, on):
        super().__init__()
        self.on = on
        self.lines = []

    def emit(self, record):
        self.lines.append(record.getMessage())
        for part, act in self.on.items():
            if part in self.lines[-1]:
                act()


def test_the_scheduler_dies_and_its_workers_with_it(tasks, undisturbed, cluster, held, tmp_path):
    """The new one has no worker at first, and is one of those that then give tasks up."""
    cluster.start_scheduler()
    cluster.start_workers(2)
    hasty = {"DASK_DISTRIBUTED__SCHEDULER__NO_WORKERS_TIMEOUT": "200ms"}
    killed = []

    def advance(done):
        if done == 10:
            killed.extend(tasks.begun(held))
            cluster.kill(cluster.scheduler)
            (held / "go").touch()

    told = Told(
        {
            "has gone": lambda: cluster.start_scheduler(**hasty),
            "no workers": lambda: killed and cluster.start_workers(2),
        }
    )
    logger = logging.getLogger("cpic_planner.jobs.cluster")
    logger.addHandler(told)
    try:
        done, files = tasks.survey(tmp_path / "out", scheduler=cluster.address, advance=advance, held=held)
    finally:
        logger.removeHandler(told)
    assert sorted(done) == EVERY_PART
    assert done.index(tasks.HELD) >= 10
    assert len(killed) == 1 < len(tasks.begun(held))  # in flight when the scheduler went, and begun again
    assert files == undisturbed
    for line, text in zip(
        ("has gone: waiting up to 60 s", "is back: sending 30 unfinished", "has no workers", "has workers again"),
        told.lines[-4:],
        strict=True,
    ):
        assert line in text


def test_a_scheduler_that_stays_away_ends_the_run_with_one_line(tasks, undisturbed, cluster, held, tmp_path):
    cluster.start_scheduler()
    cluster.start_workers(2)

    def advance(done):
        if done == 10:
            assert len(tasks.begun(held)) == 1
            cluster.kill(cluster.scheduler)

    with pytest.raises(ClusterError, match=r"did not come back in 1 s; 30 tasks are not finished, the others are kept"):
        tasks.survey(tmp_path / "out", scheduler=cluster.address, advance=advance, patience_s=1.0, held=held)
    with open_run_folder(tmp_path / "out", kind="whatif", config_hash="c0ffee") as folder:
        assert len(ResultStore(folder, tasks.TABLES).finished()) == 10
    done, files = tasks.survey(tmp_path / "out")
    assert len(done) == 30
    assert tasks.HELD in done
    assert files == undisturbed


def test_the_client_dies(tasks, undisturbed, cluster, held, tmp_path):
    cluster.start_scheduler()
    cluster.start_workers(2)
    code = (
        "import cluster_tasks\n"
        f"cluster_tasks.survey({str(tmp_path / 'out')!r}, scheduler={cluster.address!r}, held={str(held)!r},\n"
        "                     advance=lambda done: print(done, flush=True))"
    )
    client = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": PATHS}
    )
    with client.stdout:
        for line in client.stdout:
            if line.strip() == "15":
                assert len(tasks.begun(held)) == 1
                cluster.kill(client)
                (held / "go").touch()
                break
    client.wait()
    with open_run_folder(tmp_path / "out", kind="whatif", config_hash="c0ffee") as folder:
        kept = ResultStore(folder, tasks.TABLES).finished()
    assert 15 <= len(kept) < len(EVERY_PART)
    assert str(tasks.HELD) not in kept
    done, files = tasks.survey(tmp_path / "out", scheduler=cluster.address)
    assert sorted(done + [int(key) for key in kept]) == EVERY_PART
    assert files == undisturbed


TABLES = ("universes.parquet", "detections.parquet", "stars.parquet", "whatif.json", "visits.csv")


def test_workers_die_while_strategies_are_planned_and_played(small, cluster, tmp_path):
    """Both workers are killed with plans in flight, and again with blocks in flight: the same files in the end."""
    few = (
        {"name": "plain"},
        {"name": "deep", "visit": {"time_s": 72000}},
        {"name": "short", "visit": {"time_s": 9000}},
    )
    config = small(*few, universe={"universes": 300, "exclusions": ["rv"], "facts": True})
    cluster.start_scheduler()
    cluster.start_workers(2)
    told = []

    def advance(text, steps=1, /):
        kind = "plan" if text.endswith("plan") else "block"
        told.append(kind)
        if told.count(kind) == 1:  # of 3 plans, or of 9 blocks
            for worker in cluster.workers:
                cluster.kill(worker)
            cluster.start_workers(2)

    folders = {"serial": {}, "two": {"workers": 2}, "killed": {"scheduler": cluster.address, "advance": advance}}
    for name, how in folders.items():
        run_whatif(config, tmp_path / name, pages=False, **how)
    assert told.count("plan") == len(few)
    for table in TABLES:
        assert len({(tmp_path / name / table).read_bytes() for name in folders}) == 1, table
