"""The queue of jobs: order, limits, tokens, and what a server that stops or is killed leaves behind."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from pydantic import BaseModel

from cpic_core import InputError, fingerprint
from cpic_core.provenance import WORDS
from cpic_planner.jobs import Job, Task, check_tree, worker
from cpic_planner.jobs.folder import open_run_folder
from cpic_planner.results import StarImagesResult
from cpic_planner.web import job_queue
from cpic_planner.web.addresses import IMAGES
from cpic_planner.web.job_queue import MOST_ASKERS, FullError, JobQueue, expected

ONE, TWO, THREE = (f"{number:016x}" for number in (1, 2, 3))
PAIRS = (("target", "tau Cet"),)
QUICK = [sys.executable, "-c", "import sys, pathlib; (pathlib.Path(sys.argv[1]) / 'did').write_text('x')"]
SLOW = [sys.executable, "-c", "import time; time.sleep(60)"]
BAD = [sys.executable, "-c", "raise SystemExit(3)"]


def queue_of(folder, words=QUICK, **limits):
    return JobQueue(folder, command=lambda place: [*words, str(place)], **limits)


def ask(queue, *names):
    return [queue.ask(name, PAIRS, cost_s=2.0, tasks=1) for name in names]


def until(queue, name, *states):
    for _ in range(2000):
        found = queue.standing(name)
        if found is None or found.state in states:
            return found
        time.sleep(0.02)
    raise AssertionError(found)


def test_a_job_is_done_and_the_same_question_is_the_same_job(tmp_path):
    with queue_of(tmp_path / "q") as queue:
        queue.start()
        (token,) = ask(queue, ONE)
        assert token
        assert until(queue, ONE, "done").place == 0
        assert (queue.run_folder(ONE).parent / "did").exists()
        assert ask(queue, ONE) == [""]  # answered from its result: there is nothing to cancel
        assert not queue.withdraw(ONE, token)
        assert queue.standing(TWO) is None
        assert queue.run_folder(TWO) is None


def test_places_in_the_queue_and_its_limit(tmp_path):
    with queue_of(tmp_path, most_waiting=2) as queue:
        ask(queue, TWO, ONE)
        assert [queue.standing(name).place for name in (TWO, ONE)] == [1, 2]
        with pytest.raises(FullError):
            ask(queue, THREE)
        assert queue.standing(THREE) is None
        assert ask(queue, ONE)[0]  # the same again takes no place
        assert queue.waiting() == 2


def test_only_askers_cancel_and_the_last_one_ends_the_job(tmp_path):
    with queue_of(tmp_path, SLOW) as queue:
        first, second = ask(queue, ONE, ONE)
        assert not queue.withdraw(ONE, "another")
        assert not queue.withdraw(ONE, "")
        assert queue.withdraw(ONE, first)
        assert not queue.withdraw(ONE, first)  # once
        assert queue.standing(ONE).state == "waiting"
        assert queue.withdraw(ONE, second)
        assert queue.standing(ONE) is None
        assert not (tmp_path / ONE).exists()
        assert first not in "".join(path.read_text() for path in tmp_path.rglob("*.json"))


def test_a_running_job_is_stopped_by_its_asker(tmp_path):
    with queue_of(tmp_path, SLOW) as queue:
        queue.start()
        token, _ = ask(queue, ONE, TWO)
        until(queue, ONE, "running")
        assert queue.withdraw(ONE, token)
        until(queue, ONE)
        assert until(queue, TWO, "running").state == "running"
        assert not (tmp_path / ONE).exists()


def test_tokens_of_one_job_are_counted(tmp_path):
    with queue_of(tmp_path) as queue:
        tokens = ask(queue, *[ONE] * (MOST_ASKERS + 1))
        assert all(tokens[:-1])
        assert tokens[-1] == ""


@pytest.mark.parametrize(("words", "limit_s", "state"), [(BAD, 60.0, "failed"), (SLOW, 0.1, "late")])
def test_what_fails_or_takes_too_long_says_so_and_can_be_asked_again(tmp_path, words, limit_s, state):
    with queue_of(tmp_path, words, limit_s=limit_s) as queue:
        queue.start()
        ask(queue, ONE)
        assert until(queue, ONE, "done", "failed", "late").state == state
        assert queue.run_folder(ONE) is None
    with queue_of(tmp_path) as queue:
        assert queue.standing(ONE).state == state
        queue.start()
        assert ask(queue, ONE)[0]
        until(queue, ONE, "done")


def test_the_oldest_results_make_place(tmp_path):
    with queue_of(tmp_path, most_kept=2) as queue:
        queue.start()
        ask(queue, THREE, ONE, TWO)
        until(queue, TWO, "done")
        assert queue.standing(THREE) is None
        assert {path.name for path in tmp_path.iterdir() if path.is_dir()} == {ONE, TWO}


def test_a_server_that_stops_leaves_its_jobs_to_the_next(tmp_path):
    with queue_of(tmp_path, SLOW) as queue:
        queue.start()
        tokens = ask(queue, TWO, ONE)
        until(queue, TWO, "running")
    with queue_of(tmp_path) as queue:
        assert [queue.standing(name).state for name in (TWO, ONE)] == ["waiting", "waiting"]
        assert [queue.standing(name).place for name in (TWO, ONE)] == [1, 2]
        assert queue.withdraw(ONE, tokens[1])  # tokens are good there too
        queue.start()
        until(queue, TWO, "done")


KILLED = """
import sys, time
from pathlib import Path
from cpic_planner.web.job_queue import JobQueue
queue = JobQueue(Path(sys.argv[1]), command=lambda place: [sys.executable, "-c", "import time; time.sleep(60)"])
queue.start()
for number in range(1, 6):
    queue.ask(f"{number:016x}", (("target", "tau Cet"),), cost_s=1.0, tasks=1)
while queue.standing(f"{1:016x}").state != "running":
    time.sleep(0.01)
print(next(job for job in queue._jobs.values() if job.process).process.pid, flush=True)
time.sleep(60)
"""


def test_a_server_that_is_killed_loses_nothing(tmp_path):
    server = subprocess.Popen([sys.executable, "-c", KILLED, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    working = int(server.stdout.readline())
    server.kill()
    server.wait()
    server.stdout.close()
    os.kill(working, signal.SIGKILL)  # real ones end by themselves, see `cpic_planner.jobs.worker.end_with`
    (tmp_path / ONE / ".asked.json.x.part").write_text("{")  # what a write leaves that was cut short
    (tmp_path / f"{9:016x}").mkdir()
    with queue_of(tmp_path) as queue:
        names = [f"{number:016x}" for number in range(1, 6)]
        assert [queue.standing(name).place for name in names] == [1, 2, 3, 4, 5]
        queue.start()
        for name in names:
            until(queue, name, "done")


def test_a_folder_is_of_its_own_kind_and_one_servers(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("x")
    with pytest.raises(InputError, match="is empty, or of an earlier cpic serve"):
        queue_of(tmp_path / "mine")
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["thesis.tex"]
    with queue_of(tmp_path / "q"), pytest.raises(InputError, match="no other server"):
        queue_of(tmp_path / "q")
    (tmp_path / "q" / "cpic-jobs.json").write_text(json.dumps({"schema_version": 2}))
    with pytest.raises(InputError, match="of this version"):
        queue_of(tmp_path / "q")


ASKED = {"target": "tau Cet", "bands": "F520", "realisations": "1", "fidelity": "quick"}
SERVER = """
import sys, time
from pathlib import Path
from cpic_planner.web.addresses import IMAGES
from cpic_planner.web.job_queue import JobQueue
queue = JobQueue(Path(sys.argv[1]))
queue.ask(sys.argv[2], IMAGES.canonical(eval(sys.argv[3])), cost_s=1.0, tasks=2)
queue.start()
while queue.standing(sys.argv[2]).state != "running":
    time.sleep(0.01)
print(next(job for job in queue._jobs.values() if job.process).process.pid, flush=True)
time.sleep(600)
"""


def lives(pid):
    status = Path(f"/proc/{pid}/status")
    return status.exists() and "State:\tZ" not in status.read_text()


def waited(done):
    for _ in range(2400):
        if found := done():
            return found
        time.sleep(0.05)
    raise AssertionError(done)


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs /proc")
def test_a_killed_server_takes_its_job_along_and_the_next_one_finishes_it(tmp_path):
    given = [("bands", "F662"), *ASKED.items()]
    pairs = IMAGES.canonical(given)
    name, cost = expected(pairs)
    assert cost["n_tasks"] == 2
    words = [sys.executable, "-c", SERVER, str(tmp_path), name, repr(given)]
    server = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    working = int(server.stdout.readline())
    waited((tmp_path / name / "progress.json").exists)  # one band of two is done
    server.kill()
    server.wait()
    server.stdout.close()
    waited(lambda: not lives(working))
    assert not (tmp_path / name / "outcome.json").exists()
    with JobQueue(tmp_path) as queue:
        queue.start()
        waited(lambda: queue.standing(name).state in ("done", "failed"))
        assert queue.standing(name).state == "done"
        run = queue.run_folder(name)
    record = json.loads((run / "run.json").read_text())
    assert (record["resumed_parts"], record["computed_parts"]) == (1, 1)
    result = StarImagesResult.model_validate_json((run / "star_images.json").read_text())
    assert result.config_hash == name
    assert [band.band for band in result.targets[0].bands] == ["F662", "F520"]


def test_the_hash_is_that_of_what_decides_the_result():
    def hashed(**changes):
        return expected(IMAGES.canonical((ASKED | changes).items()))[0]

    mine = hashed()
    assert mine == hashed(target="HIP 8102") == hashed(time="10h")
    assert (
        len({mine, hashed(seed="2"), hashed(time_s="2h"), hashed(target="eps Eri"), hashed(date_utc="2040-01-01")}) == 5
    )


def test_what_cannot_be_asked_names_its_parameter():
    with pytest.raises(InputError) as caught:
        expected(IMAGES.canonical((ASKED | {"target": "nowhere"}).items()))
    assert caught.value.key == "target"


class Total(BaseModel):
    config_hash: str
    total: int


def square(number):
    return {"square": number**2}


def squares(pairs):
    def work(runner):
        found = runner.finish(square, [Task("square 7", (7,))])
        return Total(config_hash=runner.digest, total=sum(body["square"] for body in found.values()))

    return Job("squares", 1, dict, work)


@pytest.mark.parametrize(("word", "total"), [("code", 49), ("presets", 49), ("libraries", 49), ("processor", 1)])
def test_what_a_server_of_other_software_began_is_begun_anew_and_said(tmp_path, monkeypatch, caplog, word, total):
    """A part of it is wrong: another processor alone goes on with it."""
    words = str(fingerprint()).split("-")
    words[WORDS.index(word)] = "0" * 8
    where = {"kind": "squares", "config_hash": squares(()).digest, "fingerprint": "-".join(words)}
    with open_run_folder(tmp_path / "run", **where) as folder:
        folder.save_part("square 7", {"square": 1})
    (tmp_path / "asked.json").write_text('{"pairs": []}')
    monkeypatch.setattr(job_queue, "job_of", squares)
    monkeypatch.setattr(worker, "end_with", lambda pid: None)
    monkeypatch.setattr(job_queue.os, "nice", lambda by: 0)
    job_queue.main("1", str(tmp_path))
    assert json.loads((tmp_path / "run" / "squares.json").read_text())["total"] == total
    record = json.loads((tmp_path / "run" / "run.json").read_text())
    assert (record["resumed_parts"], record["computed_parts"]) == ((0, 1) if total == 49 else (1, 0))
    assert record["fingerprint"] == str(fingerprint())
    said = f"begun anew: what it holds was made with other {word}" if total == 49 else "another processor takes part"
    assert said in caplog.text
    assert check_tree(tmp_path / "run") == []
