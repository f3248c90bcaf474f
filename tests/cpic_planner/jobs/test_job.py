"""Jobs that no command has: the loop gives them all that others have, on one worker or several; pace of a machine."""

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time

import dask
import distributed  # noqa: F401, its settings are there before one is changed for a test
import numpy
import pytest
from pydantic import BaseModel

from cpic_core import PROMISES, ClusterError, InputError, fingerprint, stream
from cpic_core.provenance import WORDS
from cpic_planner.jobs import Cost, Job, Runner, Task, check_tree, estimate, pace, run
from cpic_planner.jobs.job import host, piece_s, run_tasks, versions
from cpic_planner.results import RunRecord

N = 5


class Total(BaseModel):
    config_hash: str
    total: int


def square(number, pause_s=0.0, progress=None):
    for _ in range(0 if progress is None else 2):
        progress(f"half of {number}")
    time.sleep(pause_s)
    return {"square": number**2}


def squares(n, *, pause_s=0.0, seed=1, tells=False):
    """The whole of a new kind: its tasks, its result, what decides it, a product, its cost."""

    def work(runner):
        tasks = [Task(f"square {i}", (i, pause_s), steps=2) for i in range(n)]
        found = runner.finish(square, tasks, tells=tells)
        return Total(config_hash=runner.digest, total=sum(body["square"] for body in found.values()))

    def write(folder, result, bodies):
        folder.write("squares.csv", "".join(f"{key},{body['square']}\n" for key, body in bodies.items()))

    return Job(
        "squares",
        1,
        lambda: {"n": n, "seed": seed},
        work,
        write=write,
        products=("squares.csv",),
        cost=lambda: Cost({"n_tasks": n}, [pause_s] * n, start_s=1.0, pool_s=2.0, memory_mb=5.0, disk_mb=0.1),
    )


class Told(list):
    def __call__(self, text, steps=1, /):
        self.append((text, steps))


def products(folder):
    return {name: (folder / name).read_bytes() for name in ("squares.json", "squares.csv")}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    out = tmp_path_factory.mktemp("job") / "whole"
    return out, run(squares(N), out)


def test_result_products_and_record(whole):
    out, done = whole
    assert json.loads((out / "squares.json").read_text()) == {"config_hash": squares(N).digest, "total": 30}
    assert (out / "squares.csv").read_text().splitlines()[2] == "square 2,4"
    record = RunRecord.model_validate_json((out / "run.json").read_text())
    assert (record.resumed_parts, record.computed_parts, record.workers) == (0, N, 1)
    assert record.config_hash == done.result.config_hash
    assert (record.fingerprint, record.promise) == (str(fingerprint()), PROMISES[0])
    assert (record.software.code, record.software.libraries) == (fingerprint().code, fingerprint().libraries)
    assert record.started_utc <= record.finished_utc
    assert (done.resumed_parts, done.computed_parts, list(done.bodies)) == (0, N, [f"square {i}" for i in range(N)])


def test_a_later_version_of_results_is_another_configuration():
    job = squares(N)
    later = Job(job.kind, job.results + 1, job.decides, job.work)
    assert len({job.digest, later.digest, squares(N, seed=2).digest, squares(N + 1).digest}) == 4
    assert squares(N, pause_s=1.0).digest == job.digest  # how long it takes decides nothing


def begun_by(out, word):
    """Make a run one that was begun by another process, which differs in one word of its fingerprint."""
    words = str(fingerprint()).split("-")
    words[WORDS.index(word)] = "00000000"
    path = out / "cpic-run.jsonl"
    path.write_text(path.read_text().replace(str(fingerprint()), "-".join(words)))
    return "-".join(words)


def test_what_another_processor_began_goes_on_and_the_record_says_so(tmp_path):
    run(squares(N), tmp_path)
    other = begun_by(tmp_path, "processor")
    done = run(squares(N), tmp_path)
    assert (done.resumed_parts, done.computed_parts) == (N, 0)
    record = json.loads((tmp_path / "run.json").read_text())
    assert (record["other_fingerprints"], record["promise"]) == ([other], PROMISES[1])


@pytest.mark.parametrize("word", ["code", "presets", "catalogue", "libraries"])
def test_what_other_software_began_is_refused_unless_forced(tmp_path, word, refused):
    run(squares(N), tmp_path)
    begun_by(tmp_path, word)
    refused(f"made with other {word}; choose another folder, or --force", run, squares(N), tmp_path)
    done = run(squares(N), tmp_path, force=True)
    assert (done.resumed_parts, done.computed_parts) == (0, N)


def test_started_again_it_keeps_what_is_finished(whole, tmp_path):
    out, told = tmp_path / "o", Told()
    run(squares(N), out, advance=told)
    assert told == [(f"square {i}", 2) for i in range(N)]
    next((out / "parts").glob("square_3*")).unlink()
    told.clear()
    done = run(squares(N), out, advance=told, command=["squares"])
    assert (done.resumed_parts, done.computed_parts) == (N - 1, 1)
    assert told == [(f"square {i} (kept)", 2) for i in (0, 1, 2, 4)] + [("square 3", 2)]
    assert products(out) == products(whole[0])
    record = json.loads((out / "run.json").read_text())
    assert (record["resumed_parts"], record["computed_parts"], record["command"]) == (N - 1, 1, ["squares"])


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.long)])
def test_killed_half_way_it_goes_on_and_gives_the_same_bytes(whole, tmp_path, workers):
    """With workers they have tasks in flight when it is killed."""
    out = tmp_path / "again"
    code = (
        f"import sys; sys.path.insert(0, {os.path.dirname(__file__)!r})\n"
        "from cpic_planner.jobs.job import run\nfrom test_job import squares\n"
        "if __name__ == '__main__':\n"
        f"    run(squares({N}, pause_s={0.2 * workers}), {str(out)!r}, workers={workers})\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code])
    deadline = time.monotonic() + 60
    while len(list(out.glob("parts/*.json"))) < 2 and time.monotonic() < deadline:
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert not (out / "squares.json").exists(), "it had finished before the kill"
    done = run(squares(N), out, workers=workers)
    assert done.resumed_parts >= 2
    assert done.resumed_parts + done.computed_parts == N
    assert products(out) == products(whole[0])
    assert not list(out.glob(".cpic-*"))
    assert check_tree(out) == []


def test_any_number_of_workers_gives_the_same_bytes(whole, tmp_path):
    done = run(squares(N), tmp_path / "two", workers=2)
    assert products(tmp_path / "two") == products(whole[0])
    assert list(done.bodies) == list(whole[1].bodies)  # in the order of the tasks, not of their end


def test_a_folder_has_one_run_at_a_time(tmp_path):
    refusals = []

    def advance(text, steps=1, /):
        with pytest.raises(InputError, match=f"in use by pid {os.getpid()}") as refusal:
            run(squares(N), tmp_path)
        refusals.append(refusal)

    run(squares(N), tmp_path, advance=advance)
    assert len(refusals) == N


def test_another_configuration_needs_force_and_leaves_what_it_did_not_write(refused, tmp_path):
    out = tmp_path / "o"
    run(squares(N), out)
    (out / "notes.txt").write_text("precious")
    refused("--force", run, squares(2), out)
    assert run(squares(2), out, force=True).result.total == 1
    assert sorted(path.name[:8] for path in (out / "parts").iterdir()) == ["square_0", "square_1"]
    assert (out / "notes.txt").read_text() == "precious"


def test_a_product_does_not_take_the_place_of_a_foreign_file(refused, tmp_path):
    (tmp_path / "squares.csv").write_text("mine")
    refused(r"squares\.csv", run, squares(N), tmp_path, force=True)
    assert [path.name for path in tmp_path.iterdir()] == ["squares.csv"]


def test_without_a_folder_nothing_is_written(whole, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = run(squares(N))
    assert (done.result, done.bodies) == (whole[1].result, whole[1].bodies)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="--out"):
        _ = Runner().folder


def test_a_function_may_tell_its_own_steps_in_this_process(tmp_path):
    told = Told()
    run(squares(2, tells=True), tmp_path / "one", advance=told)
    assert told == [("half of 0", 1)] * 2 + [("half of 1", 1)] * 2
    told.clear()
    run(squares(2, tells=True), tmp_path / "two", advance=told, workers=2)
    assert sorted(told) == [("square 0", 2), ("square 1", 2)]


def test_equal_keys_are_done_once():
    told = Told()
    runner = Runner(advance=told)
    assert runner.finish(square, [Task("a", (2,)), Task("b", (3,), "third"), Task("a", (2,))]) == {
        "a": {"square": 4},
        "b": {"square": 9},
    }
    assert told == [("a", 1), ("third", 1)]


def test_an_estimate_works_nothing(monkeypatch):
    monkeypatch.setattr("cpic_planner.jobs.job.pace", lambda: 1.0)
    times = {"cpu_s": 41.0, "wall_s": 41.0}
    assert estimate(squares(4, pause_s=10.0)) == {"n_tasks": 4, **times, "memory_mb": 5.0, "disk_mb": 0.1}
    assert estimate(squares(4, pause_s=10.0), workers=2)["wall_s"] == 23.0
    assert estimate(squares(4, pause_s=10.0), workers=3)["wall_s"] == pytest.approx(3 + 40 / 3)
    cost = Cost({}, [1.0, 7.0, 1.0], start_s=0.0, memory_mb=100.0, disk_mb=0.0, worker_mb=10.0)
    no_sooner = {"cpu_s": 9.0, "wall_s": 7.0, "memory_mb": 130.0, "disk_mb": 0.0}
    assert cost.at(3) == no_sooner  # no worker ends before the longest
    assert cost.at(1)["wall_s"] == 9.0


def test_an_estimate_is_of_the_machine_it_runs_on(monkeypatch):
    quick = estimate(squares(4, pause_s=10.0), workers=2)
    monkeypatch.setattr("cpic_planner.jobs.job.pace", lambda: 3.0 * pace())
    slow = estimate(squares(4, pause_s=10.0), workers=2)
    for name in ("wall_s", "cpu_s"):
        assert slow[name] == pytest.approx(3.0 * quick[name])
    assert (slow["memory_mb"], slow["disk_mb"]) == (quick["memory_mb"], quick["disk_mb"])


def test_the_record_is_plain_and_names_what_results_rest_on():
    record = {"host": host(), "versions": versions()}
    assert json.loads(json.dumps(record)) == record
    assert record["versions"]["numpy"] == numpy.__version__
    assert record["versions"]["numba"] != "not installed"


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
        "import time\nfrom cpic_planner.jobs.job import run_tasks\n"
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


@pytest.fixture
def anew(monkeypatch, tmp_path):
    """The pace, measured in an empty cache."""
    monkeypatch.setenv("CPIC_CACHE_DIR", str(tmp_path))
    pace.cache_clear()
    yield pace
    pace.cache_clear()


def test_the_piece_is_work_of_a_moment():
    assert 0.005 < piece_s() < 1.0


def test_the_quickest_try_counts_and_is_kept(anew, monkeypatch):
    tries = iter([0.48, 0.096, *[0.5] * 10])
    monkeypatch.setattr("cpic_planner.jobs.job.piece_s", lambda: next(tries))
    assert anew() == pytest.approx(2.0)
    anew.cache_clear()
    assert anew() == pytest.approx(2.0)  # from the cache: there is no further try
