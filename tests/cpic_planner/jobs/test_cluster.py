"""Tasks on clusters of which anything may die; workers of other code are refused, another processor is noted."""

import contextlib
import os
import pickle
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cpic_core import ClusterError, InputError, differing_words, fingerprint
from cpic_planner.jobs import cluster
from cpic_planner.jobs.cluster import TaskQueue, quiet_dask
from cpic_planner.jobs.job import run_tasks

ROOM = 8


def send(queue, flying=0):
    index = queue.next(flying, ROOM)
    if index is not None:
        queue.sent(index)
    return index


def test_tasks_go_in_order_while_there_is_room():
    queue = TaskQueue(3)
    assert queue.next(ROOM, ROOM) is None
    assert [send(queue, flying) for flying in range(4)] == [0, 1, 2, None]
    assert queue.left == 0


def test_lost_tasks_go_first_and_in_order():
    queue = TaskQueue(5)
    sent = [send(queue) for _ in range(3)]
    queue.put_back(reversed(sent))
    assert queue.left == 5
    assert [send(queue) for _ in range(5)] == [0, 1, 2, 3, 4]


def test_a_suspect_goes_last_and_alone_even_after_a_loss():
    queue = TaskQueue(3)
    assert send(queue) == 0
    queue.suspect(0, 4)
    assert [send(queue, 1), send(queue, 1)] == [1, 2]
    assert queue.next(1, ROOM) is None
    assert send(queue) == 0
    queue.put_back([0, 2])  # its connection was lost
    assert [send(queue), send(queue, 1), send(queue)] == [2, None, 0]


@pytest.mark.parametrize(("deaths", "trials"), [(1, 4), (2, 2), (4, 1), (11, 1)])
def test_blame_needs_four_deaths_alone_however_soon_dask_gives_up(deaths, trials):
    queue = TaskQueue(1)
    send(queue)
    queue.suspect(0, deaths)
    for _ in range(trials):
        queue.tell_blamed()  # nobody yet
        assert send(queue) == 0
        queue.suspect(0, deaths)
    assert queue.left == 0
    with pytest.raises(ClusterError, match="task 1 of 1 ended its worker .* all others are done"):
        queue.tell_blamed()


def test_it_may_be_all_of_them():
    queue = TaskQueue(50)
    for index in range(4):
        assert send(queue) == index
        queue.suspect(index, 4)
    while send(queue) != 49:
        pass
    assert send(queue) == 0
    queue.suspect(0, 4)
    assert send(queue) == 1
    queue.suspect(1, 4)
    assert send(queue) == 2
    with pytest.raises(ClusterError, match="task 1, 2, 3 of 50 ended its worker .* 1 others are not finished"):
        queue.suspect(2, 4)


ROOT = Path(__file__).resolve().parents[3]
OWN = (str(ROOT), str(Path(__file__).parent))


@pytest.fixture(scope="module")
def scheduler():
    """A scheduler in this process, without workers."""
    from distributed import LocalCluster

    with (
        quiet_dask(),
        LocalCluster(n_workers=0, processes=True, silence_logs=50, host="127.0.0.1", dashboard_address=None) as cluster,
    ):
        yield cluster.scheduler_address


@contextlib.contextmanager
def worker(address, scratch, *paths, **environment):
    """A worker process that imports from ``paths`` first."""
    code = f"import sys; sys.path[:0] = {list(paths)!r}; from distributed.cli.dask_worker import main; main()"
    options = ["--no-nanny", "--nthreads=1", "--memory-limit=0", "--no-dashboard", "--host=127.0.0.1"]
    started = subprocess.Popen(
        [sys.executable, "-P", "-c", code, address, *options, f"--local-directory={scratch}"],
        env=os.environ | environment,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield started
    finally:
        started.kill()
        started.wait()


@pytest.fixture
def other_code(tmp_path):
    """The packages with another random stream in one of them, which gives other frames without a word."""
    place = tmp_path / "other"
    shutil.copytree(ROOT / "cpic_core", place / "cpic_core", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("catalogs", "simulator", "cpic_planner"):
        (place / name).symlink_to(ROOT / name)
    streams = place / "cpic_core" / "runtime.py"
    text = streams.read_text()
    assert "np.random.SFC64(" in text
    streams.write_text(text.replace("np.random.SFC64(", "np.random.PCG64("))
    return str(place)


def test_a_worker_of_other_code_is_refused_before_a_task_runs(scheduler, other_code, tmp_path):
    ran = tmp_path / "ran"
    with (
        worker(scheduler, tmp_path, other_code),
        pytest.raises(InputError, match=r"--scheduler .*\(worker tcp://127.0.0.1:\d+ has other code\)$") as caught,
    ):
        list(run_tasks(os.mkdir, [(str(ran),)] * 4, scheduler=scheduler))
    assert "\n" not in str(caught.value)
    assert not ran.exists()


@pytest.mark.long
def test_one_that_joins_later_is_refused_too(scheduler, other_code, tmp_path):
    with worker(scheduler, tmp_path, *OWN):
        going = run_tasks(time.sleep, [(0.3,)] * 1000, scheduler=scheduler)
        next(going)
        with worker(scheduler, tmp_path, other_code), pytest.raises(InputError, match="has other code"):
            list(going)


def test_another_processor_is_accepted_and_told(scheduler, tmp_path):
    met = []
    with worker(scheduler, tmp_path, *OWN, NUMBA_CPU_NAME="generic"):
        found = dict(run_tasks(divmod, [(3,), (5,)], common=(17,), scheduler=scheduler, met=met.append))
    assert found == {0: (5, 2), 1: (3, 2)}
    assert len(met) == 2
    assert {tuple(differing_words(str(fingerprint()), other)) for other in met} == {("processor",)}


def test_a_worker_that_was_not_asked_compares_for_itself(monkeypatch):
    asked = str(fingerprint())
    load = pickle.dumps((divmod, (3,)))
    assert cluster.call(asked, load, (17,)) == (asked, (5, 2))
    monkeypatch.setattr(cluster, "get_worker", lambda: type("Worker", (), {"address": "tcp://there:1"}))
    wrong = "-".join(["ffffffff", *asked.split("-")[1:]])
    with pytest.raises(cluster.ForeignWorkerError, match="worker tcp://there:1 has other code$"):
        cluster.call(wrong, b"not even unpacked", ())


class Client:
    """Stands for one that has asked."""

    def __init__(self, **answers):
        self.answers, self._run = {name.replace("_", "://"): what for name, what in answers.items()}, None

    def sync(self, *asked, **how):
        return self.answers


def test_code_without_a_handshake_is_other_code_and_a_worker_that_has_gone_is_passed_over():
    mine = cluster.introduced()
    cluster.refuse_foreign(Client(tcp_a=mine, tcp_b=OSError("gone")), ["tcp://a", "tcp://b"], "tcp://s:1")
    older = Client(tcp_a=ModuleNotFoundError("No module named 'cpic_planner.jobs.cluster'"))
    with pytest.raises(InputError, match=r"\(worker tcp://a has other code \(No module named"):
        cluster.refuse_foreign(older, ["tcp://a"], "tcp://s:1")
    newer = cluster.Introduced("9.9.9", mine.fingerprint)
    with pytest.raises(ClusterError, match=r"worker tcp://a has version 9.9.9 \(here .*were files changed"):
        cluster.refuse_foreign(Client(tcp_a=newer), ["tcp://a"], None)


@pytest.mark.parametrize(("name", "said"), [(None, "there are none"), ("/nowhere.pem", "No such file")])
def test_encryption_without_certificates_is_refused_at_once(refused, name, said):
    import dask

    settings = {f"distributed.comm.tls.{key}": name for key in ("ca-file", "client.cert", "client.key")}
    with dask.config.set(settings):
        line = refused("with certificates in Dask's", list, run_tasks(divmod, [(1, 1)], scheduler="tls://127.0.0.1:1"))
    assert said in line
