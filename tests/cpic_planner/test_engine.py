import contextlib
import os
import signal
import subprocess
import sys
import time

import pytest

from catalogs.errors import InputError
from cpic_planner.engine import run_tasks
from simulator.rng import stream


def draw(name, index):
    return stream(3, name, index).standard_normal(4).tolist()


ARGUMENTS = [("star", index) for index in range(6)]


def test_same_results_for_any_number_of_workers():
    alone = dict(run_tasks(draw, ARGUMENTS, workers=1))
    # builtins travel by name; a test function would need this file to be importable in the workers
    together = dict(run_tasks(divmod, [(17, n) for n in range(1, 7)], workers=2))
    assert sorted(alone) == list(range(6))
    assert alone[3] == draw("star", 3)
    assert together == {n - 1: divmod(17, n) for n in range(1, 7)}


def test_errors_of_tasks_come_back_as_they_are():
    from simulator.config import load_instrument

    with pytest.raises(InputError, match="no_such_preset"):
        list(run_tasks(load_instrument, [("no_such_preset",)] * 2, workers=2))


@pytest.mark.parametrize("workers", [0, -1, 1.5, True, 1000])
def test_worker_count_is_checked(workers):
    with pytest.raises(InputError, match="--workers"):
        list(run_tasks(draw, ARGUMENTS, workers=workers))


def test_dead_scheduler_is_named():
    with pytest.raises(InputError, match="--scheduler"):
        list(run_tasks(divmod, [(1, 1)], scheduler="not an address"))


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


def test_no_worker_outlives_a_killed_parent():
    code = (
        "import time\nfrom cpic_planner.engine import run_tasks\n"
        "if __name__ == '__main__':\n"
        "    for index, _ in run_tasks(time.sleep, [(0.01,)] + [(60,)] * 3, workers=2):\n"
        "        print(index, flush=True)\n"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
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
    finally:
        parent.stdout.close()
        for pid in children_of(parent.pid):
            with contextlib.suppress(OSError):
                os.kill(pid, signal.SIGKILL)
