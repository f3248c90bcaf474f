"""The queue of jobs: order, limits, tokens, and what a server that stops or is killed leaves behind."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from cpic_core import InputError
from cpic_planner.web.job_queue import MOST_ASKERS, FullError, JobQueue

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
