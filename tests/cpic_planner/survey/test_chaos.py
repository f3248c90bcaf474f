"""Workers of this machine killed at random during a run: the report's helper, and what the run makes of it."""

import importlib.util
import sys
import time
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent


def load(name, path):
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def chaos():
    return load("chaos", HERE.parents[2] / "reports/whatif/chaos.py")


@pytest.fixture
def tasks(monkeypatch):
    monkeypatch.syspath_prepend(HERE)
    return load("cluster_tasks", HERE / "cluster_tasks.py")


@pytest.mark.long
def test_random_kills_do_not_change_the_files(chaos, tasks, tmp_path):
    whole = tasks.survey(tmp_path / "serial")[1]

    def victims():
        return chaos.worker_pids() if len(kills.pids) < 3 else []

    def advance(done):
        while done in (10, 20) and len(kills.pids) < done // 10:  # two at least, by the middle of the run
            time.sleep(0.01)

    with chaos.random_kills(victims, seed=2, every_s=0.2) as kills:
        parts, files = tasks.survey(tmp_path / "out", workers=2, advance=advance)
    assert 2 <= len(kills.pids) == len(set(kills.pids)) <= 3
    assert sorted(parts) == list(range(40))
    assert files == whole
    assert chaos.worker_pids() == []


def test_nothing_is_killed_where_nothing_runs(chaos):
    with chaos.random_kills(chaos.worker_pids, seed=1, every_s=0.001) as done:
        pass
    assert done.pids == []
