"""A kind of job that no command has: one function, and the loop gives it all that the others have."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy
import pytest
from pydantic import BaseModel

from cpic_core import PROMISES, InputError, fingerprint
from cpic_core.provenance import WORDS
from cpic_planner.jobs import Cost, Job, Runner, Task, check_tree, estimate, pace, run
from cpic_planner.jobs.job import host, versions
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
