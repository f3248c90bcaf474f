import contextlib
import os
import signal
import socket
import subprocess
import sys
import time

import dask
import distributed  # noqa: F401, its settings are there before one is changed for a test
import pytest

from cpic_core import ClusterError, stream
from cpic_planner.jobs.job import run_tasks


def draw(name, index):
    return stream(3, name, index).standard_normal(4).tolist()


ARGUMENTS = [("star", index) for index in range(6)]


def test_results_come_with_their_numbers():
    alone = dict(run_tasks(draw, ARGUMENTS, workers=1))
    assert sorted(alone) == list(range(6))
    assert alone[3] == draw("star", 3)


def test_errors_of_tasks_come_back_as_they_are(refused):
    from simulator.config import load_instrument

    refused("no_such_preset", list, run_tasks(load_instrument, [("no_such_preset",)] * 2, workers=2))


def test_common_arguments_come_first_and_results_are_the_same_for_any_number_of_workers():
    # builtins travel by name; a test function would need this file to be importable in the workers
    for workers in (1, 2):
        found = dict(run_tasks(pow, [(power, 7) for power in range(6)], common=(10,), workers=workers))
        assert found == {power: 10**power % 7 for power in range(6)}


class Heavy:
    """Counts how often it was unpacked in this process."""

    unpacked = 0

    def __setstate__(self, state):
        Heavy.unpacked += 1
        self.__dict__.update(state)


def weigh(heavy, index):
    time.sleep(0.01)
    return os.getpid(), Heavy.unpacked, len(heavy.load) + index


class Watched(list):
    """Notes how far its items were read."""

    highest = -1

    def __getitem__(self, index):
        self.highest = max(self.highest, index)
        return super().__getitem__(index)


def test_common_arguments_reach_each_worker_once_and_few_tasks_are_sent_out_at_a_time():
    heavy, arguments, found, ahead = Heavy(), Watched((index,) for index in range(100)), {}, []
    heavy.load = bytes(20_000_000)
    for done, (index, answer) in enumerate(run_tasks(weigh, arguments, common=(heavy,), workers=2)):
        found[index] = answer
        ahead.append(arguments.highest - done)
    assert [found[index][2] for index in range(100)] == [20_000_000 + index for index in range(100)]
    assert len({pid for pid, _, _ in found.values()}) == 2
    # On a loaded machine a worker unpacks it twice now and then; if tasks carried it, that would be fifty times.
    assert max(unpacked for _, unpacked, _ in found.values()) <= 2
    assert max(ahead) <= 4 * 2


def die(folder, index, times):
    """End the worker, the first so many times."""
    before = len(list(folder.glob(f"{index}-*")))
    if before < times:
        (folder / f"{index}-{before}").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return index


@pytest.mark.long
def test_an_innocent_task_outlives_many_workers(tmp_path, caplog):
    """Dask itself would give it up; here it had four deaths in company, three of them alone."""
    with dask.config.set({"distributed.scheduler.allowed-failures": 0}):
        done = [
            index for index, _ in run_tasks(die, [(i, 4 * (i == 2)) for i in range(12)], common=(tmp_path,), workers=2)
        ]
    assert sorted(done) == list(range(12))
    assert len(list(tmp_path.iterdir())) == 4
    assert "task 3 of 12: 1 workers died with it; it will run alone at the end" in caplog.text


@pytest.mark.long
def test_tasks_that_end_every_worker_are_named_after_all_others(tmp_path):
    arguments = [(index, 99 * (index == 2)) for index in range(6)]
    done = []
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        pytest.raises(ClusterError, match=r"task 3 of 6 ended its worker .*all others are done"),
    ):
        done.extend(index for index, _ in run_tasks(die, arguments, common=(tmp_path,), workers=2))
    assert sorted(done) == [index for index in range(6) if index != 2]
    assert len(list(tmp_path.iterdir())) == 5


def test_workers_that_never_start_end_the_run(monkeypatch, tmp_path):
    (tmp_path / "sitecustomize.py").write_text("import os\nos._exit(7)\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("cpic_planner.jobs.cluster._VAIN", 1)
    with pytest.raises(ClusterError, match="workers ended without a result, the last with status 7"):
        list(run_tasks(divmod, [(1, 1), (2, 1)], workers=2))


@pytest.mark.parametrize("workers", [0, -1, 1.5, True, 1000])
def test_worker_count_is_checked(refused, workers):
    refused("--workers", list, run_tasks(draw, ARGUMENTS, workers=workers))


@pytest.mark.parametrize(
    "address",
    [
        "nonsense",
        "not an address",
        "",
        "tcp://",
        "tcp://host",
        "127.0.0.1:8786",
        "host:8786",
        "http://host:8786",
        "tcp://host:port",
        "tcp://host:0",
        "tcp://host:99999",
        "tcp://[::1:8786",
    ],
)
def test_what_is_no_address_is_refused_before_dask_is_loaded(refused, address, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    for module in ("cluster", "local_cluster"):
        monkeypatch.delitem(sys.modules, f"cpic_planner.jobs.{module}", raising=False)
    refused(r"--scheduler.*tcp://host:port", list, run_tasks(divmod, [(1, 1)], scheduler=address))


def test_dead_scheduler_is_named(refused, monkeypatch):
    monkeypatch.setattr("cpic_planner.jobs.cluster._ANSWER_S", 0.3)
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{nobody.getsockname()[1]}"
        refused("--scheduler.*a live Dask scheduler", list, run_tasks(divmod, [(1, 1)], scheduler=address))


def children_of(pid):
    text = subprocess.run(["ps", "-eo", "pid,ppid"], capture_output=True, text=True, check=True).stdout
    pairs = [tuple(map(int, line.split())) for line in text.splitlines()[1:]]
    found, frontier = set(), {pid}
    while frontier:
        frontier = {child for child, parent in pairs if parent in frontier} - found
        found |= frontier
    return found


def alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def allocator(_):
    return {name: value for name, value in os.environ.items() if name.startswith("MALLOC_")}


def test_workers_keep_the_allocator_as_it_is():
    """Dask's own setting makes workers, and whatever this process starts later, twice as slow with arrays."""
    before = allocator(None)
    assert [found for _, found in run_tasks(allocator, [(0,), (1,)], workers=2)] == [before, before]
    assert allocator(None) == before


def test_no_worker_outlives_a_killed_parent(tmp_path):
    code = (
        "import time\nfrom cpic_planner.jobs.engine import run_tasks\n"
        "if __name__ == '__main__':\n"
        "    for index, _ in run_tasks(time.sleep, [(0.01,)] + [(60,)] * 3, workers=2):\n"
        "        print(index, flush=True)\n"
    )
    own_tmp = os.environ | {"TMPDIR": str(tmp_path)}
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=own_tmp)
    try:
        assert parent.stdout.readline().strip() == "0"
        workers = children_of(parent.pid)
        assert len(workers) >= 2
        os.kill(parent.pid, signal.SIGKILL)
        parent.wait()
        deadline = time.monotonic() + 20
        while any(map(alive, workers)) and time.monotonic() < deadline:
            time.sleep(0.1)
        assert [pid for pid in workers if alive(pid)] == []
        assert list(tmp_path.glob("cpic-workers-*")) == []
    finally:
        parent.stdout.close()
        for pid in children_of(parent.pid):
            with contextlib.suppress(OSError):
                os.kill(pid, signal.SIGKILL)
