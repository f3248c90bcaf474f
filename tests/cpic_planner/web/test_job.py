"""The process of a job: it ends with its server, and the next one goes on with what was finished."""

import json
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
from cpic_planner.web.asking import IMAGES
from cpic_planner.web.job_queue import JobQueue, expected

ASKED = {"target": "tau Cet", "bands": "F520", "realisations": "1", "fidelity": "quick"}
SERVER = """
import sys, time
from pathlib import Path
from cpic_planner.web.asking import IMAGES
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
