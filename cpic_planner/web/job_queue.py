"""Jobs that visitors ask for: a queue in a folder, one process at a time, and the results that they leave.

The process of one job is ``python -m cpic_planner.web.job_queue PARENT FOLDER``.

Layout::

    DIR/cpic-jobs.json        says that the folder is of this kind
    DIR/queue.lock            held by the one server that works on it
    DIR/ID/asked.json         question, place in the order, hashes of the tokens of those who asked
    DIR/ID/progress.json      how far it is, written by the process that works
    DIR/ID/outcome.json       how it ended; a job without is waiting, also after a restart
    DIR/ID/run/               folder of the run: its finished parts, then its products

Every file is written whole. A job that a stopped server leaves behind waits for the next one, which goes on with what
was finished.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import logging
import os
import re
import secrets
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pydantic import BaseModel, PrivateAttr

from cpic_core import (
    THREAD_VARIABLES,
    InputError,
    LockHeld,
    dump_json,
    exclusive_lock,
    numeric_context,
    parse_json,
    read_text,
    write_text,
)
from cpic_planner.queries import called_as
from cpic_planner.web.addresses import IMAGES, Pairs

if TYPE_CHECKING:
    from cpic_planner.jobs import Job
    from cpic_planner.results import StarImagesResult

_LOG = logging.getLogger(__name__)
State = Literal["waiting", "running", "done", "failed", "late"]
MOST_WAITING, MOST_KEPT, MOST_ASKERS = 20, 500, 50
"""Jobs that wait, jobs that ended, and askers of one job, at most."""
LIMIT_S = 3600.0
"""Longest wall time of a job."""
_KIND = {"schema_version": 1, "kind": "cpic-planner jobs"}
_ID = re.compile(r"[0-9a-f]{16}")
_MOST_BYTES = 1_000_000
_ASKED = ("order", "cost_s", "tasks", "askers")
"""What a job's folder holds of it beside the question."""
_NICE = 10
RESULT = "star_images.json"
"""File of the result in the folder of a run."""


class FullError(Exception):
    """The queue is full: as many jobs wait as may."""


class JobAnswer(BaseModel):
    """The progress of a job, for programs."""

    schema_version: Literal[1] = 1
    kind: Literal["job"] = "job"
    id: str
    state: State
    place: int
    """Place in the queue, 1 for the next one; 0 where it does not wait."""
    finished: int
    """Finished pieces of ``tasks``."""
    tasks: int
    expected_s: float
    """Expected processor time."""
    address: str
    result: str | None
    """Address of the result; null where there is none yet."""
    token: str | None = None
    """What cancels the job; only whoever asked is told."""
    _pairs: Pairs = PrivateAttr(default=())

    @property
    def pairs(self) -> Pairs:
        """The question."""
        return self._pairs


@dataclass(eq=False)
class _Job:
    id: str
    pairs: Pairs
    order: int
    cost_s: float
    tasks: int
    askers: list[str]
    state: State = "waiting"
    process: subprocess.Popen[bytes] | None = None
    withdrawn: bool = False

    def asked(self) -> dict[str, Any]:
        return {"schema_version": 1, "pairs": self.pairs} | {name: getattr(self, name) for name in _ASKED}


def _command(folder: Path) -> list[str]:
    return [sys.executable, "-P", "-m", "cpic_planner.web.job_queue", str(os.getpid()), str(folder)]


class JobQueue:
    """The queue of one folder; a context, in which it works if it is started.

    Parameters
    ----------
    folder : Path
        Made where it is not there.
    command : callable
        Command line of the process that does the job of a folder.
    limit_s : float
        Longest time of one.
    most_waiting, most_kept : int
        How many may wait, and how many that ended are kept.

    Raises
    ------
    InputError
        If the folder cannot be used, holds something else, or another server works on it.
    """

    def __init__(
        self,
        folder: Path,
        *,
        command: Callable[[Path], Sequence[str]] = _command,
        limit_s: float = LIMIT_S,
        most_waiting: int = MOST_WAITING,
        most_kept: int = MOST_KEPT,
    ) -> None:
        self.folder, self._command, self._limit_s = folder, command, limit_s
        self._most_waiting, self._most_kept = most_waiting, most_kept
        self._changed, self._closing = threading.Condition(), False
        self._open = contextlib.ExitStack()
        self._thread: threading.Thread | None = None
        _claim(folder)
        try:
            self._open.enter_context(exclusive_lock(folder / "queue.lock", wait=False))
        except LockHeld:
            raise _refused(folder, "no other server works on") from None
        self._jobs = {job.id: job for job in filter(None, map(_read, sorted(folder.iterdir())))}

    def __enter__(self) -> JobQueue:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def start(self) -> None:
        """Begin to work on what waits, in a thread."""
        self._thread = threading.Thread(target=self._work, name="cpic-jobs", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop; what was running waits for the next start."""
        with self._changed:
            self._closing = True
            for job in self._jobs.values():
                if job.process is not None:
                    job.process.kill()
            self._changed.notify_all()
        if self._thread is not None:
            self._thread.join()
        self._open.close()

    def ask(self, name: str, pairs: Pairs, *, cost_s: float, tasks: int) -> str:
        """Ask for a job, which is the same for the same question.

        Parameters
        ----------
        name : str
            Its hash.
        pairs : sequence of (str, str)
        cost_s : float
        tasks : int

        Returns
        -------
        str
            Token with which the asker can withdraw; empty where there is nothing to withdraw from.

        Raises
        ------
        FullError
            If it is a new one, and as many wait as may.
        """
        token = secrets.token_urlsafe(16)
        with self._changed:
            job = self._jobs.get(name)
            if job is not None and (job.state == "done" or len(job.askers) >= MOST_ASKERS):
                return ""
            folder = self.folder / name
            if job is None or job.state in ("failed", "late"):
                if len(self._waiting()) >= self._most_waiting:
                    raise FullError
                order = max((other.order for other in self._jobs.values()), default=0) + 1
                job = _Job(name, pairs, order, cost_s, tasks, [])
                folder.mkdir(exist_ok=True)
                for left in ("outcome.json", "progress.json"):
                    (folder / left).unlink(missing_ok=True)
            job.askers.append(_hash(token))
            write_text(folder / "asked.json", dump_json(job.asked()))
            self._jobs[name] = job
            self._changed.notify_all()
        return token

    def standing(self, name: str) -> JobAnswer | None:
        """Return how far a job is; None where there is none of that name."""
        with self._changed:
            job = self._jobs.get(name)
            if job is None:
                return None
            waiting = self._waiting()
            place = waiting.index(job) + 1 if job in waiting else 0
            state = job.state
        said = _json(self.folder / name / "progress.json") or {}
        address = f"/jobs/{name}"
        answer = JobAnswer(
            id=name,
            state=state,
            place=place,
            finished=min(int(said.get("done", 0)), job.tasks),
            tasks=job.tasks,
            expected_s=job.cost_s,
            address=address,
            result=f"{address}/{RESULT}" if state == "done" else None,
        )
        answer._pairs = job.pairs
        return answer

    def waiting(self) -> int:
        """Return how many jobs wait."""
        with self._changed:
            return len(self._waiting())

    def withdraw(self, name: str, token: str) -> bool:
        """Take back that one asked; the job ends when all who asked have.

        Returns
        -------
        bool
            Whether there is such a job that has not ended, and the token is of one who asked for it.
        """
        with self._changed:
            job, mine = self._jobs.get(name), _hash(token)
            if job is None or job.state not in ("waiting", "running") or mine not in job.askers:
                return False
            job.askers.remove(mine)
            if job.askers:
                write_text(self.folder / name / "asked.json", dump_json(job.asked()))
                return True
            job.withdrawn = True
            if job.process is None:
                self._remove(job)
            else:
                job.process.kill()
        return True

    def run_folder(self, name: str) -> Path | None:
        """Return the folder of the run of a job that is done; None of others."""
        with self._changed:
            job = self._jobs.get(name)
            return self.folder / name / "run" if job is not None and job.state == "done" else None

    def _waiting(self) -> list[_Job]:
        waiting = (job for job in self._jobs.values() if job.state == "waiting")
        return sorted(waiting, key=lambda job: job.order)

    def _remove(self, job: _Job) -> None:
        """Forget a job; its files are gone for readers at once."""
        del self._jobs[job.id]
        gone = self.folder / f".gone-{job.id}-{secrets.token_hex(4)}"
        (self.folder / job.id).rename(gone)
        shutil.rmtree(gone, ignore_errors=True)

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closing or self._waiting())
                if self._closing:
                    return
                job = self._waiting()[0]
                process = job.process = self._started(self.folder / job.id)
                job.state = "running"
            late = False
            try:
                process.wait(self._limit_s)
            except subprocess.TimeoutExpired:
                late = True
                process.kill()
                process.wait()
            with self._changed:
                job.process = None
                self._ended(job, process.returncode, late)
                self._changed.notify_all()

    def _started(self, folder: Path) -> subprocess.Popen[bytes]:
        # What can be imported here can be there; threads are set before the libraries load.
        paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
        environment = os.environ | dict.fromkeys(THREAD_VARIABLES, "1") | {"PYTHONPATH": paths}
        nothing = subprocess.DEVNULL
        # A session of its own: a Ctrl-C in the terminal is for the server to answer.
        return subprocess.Popen(
            list(self._command(folder)), env=environment, stdin=nothing, stdout=nothing, start_new_session=True
        )

    def _ended(self, job: _Job, status: int, late: bool) -> None:
        if job.withdrawn:
            self._remove(job)
            return
        if self._closing and status != 0:
            job.state = "waiting"
            return
        if status != 0:
            _LOG.warning("job %s ended with status %d%s", job.id, status, " after its time" * late)
        job.state = "done" if status == 0 else "late" if late else "failed"
        write_text(self.folder / job.id / "outcome.json", dump_json({"schema_version": 1, "state": job.state}))
        ended = [other for other in self._jobs.values() if other.state not in ("waiting", "running")]
        for old in sorted(ended, key=lambda other: other.order)[: max(len(ended) - self._most_kept, 0)]:
            self._remove(old)


def read_pairs(folder: Path) -> Pairs:
    """Return the question of a job's folder."""
    asked = _json(folder / "asked.json") or {}
    return tuple((str(name), str(text)) for name, text in asked["pairs"])


def _claim(folder: Path) -> None:
    """Make a folder one of this kind, unless it holds something else."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not (folder / "cpic-jobs.json").exists():
            if any(folder.iterdir()):
                raise _refused(folder, "is empty, or of an earlier cpic serve")
            write_text(folder / "cpic-jobs.json", dump_json(_KIND))
        for left in folder.glob(".gone-*"):
            shutil.rmtree(left, ignore_errors=True)
    except OSError as error:
        raise _refused(folder, f"is writable ({error.strerror})") from None
    if _json(folder / "cpic-jobs.json") != _KIND:
        raise _refused(folder, "is of an earlier cpic serve of this version")


def _refused(folder: Path, what: str) -> InputError:
    return InputError("--jobs", str(folder), allowed=f"a folder that {what}")


def _read(folder: Path) -> _Job | None:
    """Return the job of a folder; None where it is none, or its question is not readable."""
    if not _ID.fullmatch(folder.name):
        return None
    asked, ended = _json(folder / "asked.json"), _json(folder / "outcome.json") or {}
    try:
        job = _Job(folder.name, read_pairs(folder), **{name: (asked or {})[name] for name in _ASKED})
    except (KeyError, TypeError, ValueError):
        _LOG.warning("the question of job %s is damaged: it is passed over", folder.name)
        return None
    job.state = ended.get("state", "waiting")
    return job


def _json(path: Path) -> dict[str, Any] | None:
    """Return what a file of the folder holds; None where there is none, or it is damaged."""
    try:
        tree = parse_json(read_text(path, key="--jobs", allowed="a file of the queue", max_bytes=_MOST_BYTES))
    except (InputError, ValueError):
        return None
    return tree if isinstance(tree, dict) else None


def _hash(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()


def job_of(pairs: Pairs) -> Job[StarImagesResult]:
    """Return the job that an address asks for.

    Raises
    ------
    InputError
        For the first fault, naming the parameter.
    """
    from cpic_planner.api import model_of
    from cpic_planner.api.functions import stars_named
    from cpic_planner.confirm import star_images_job
    from cpic_planner.targets import as_catalogue

    with called_as(IMAGES.names | {"star": "target"}):
        question = IMAGES.question(pairs)
        (star,) = stars_named(question)
        return star_images_job(question, model_of(question), star, as_catalogue(question.catalog).provenance)


@functools.lru_cache(maxsize=256)
def expected(pairs: Pairs) -> tuple[str, Mapping[str, float]]:
    """Return the hash of the job that an address asks for, and its expected cost; errors as of `job_of`."""
    from cpic_planner.jobs import estimate

    job = job_of(pairs)
    with called_as(IMAGES.names):
        return job.digest, estimate(job)


def main(parent: str, folder: str) -> None:
    """Do the job of a folder, and end when the server has gone."""
    from cpic_planner.jobs import run
    from cpic_planner.jobs.worker import end_with

    end_with(int(parent))
    os.nice(_NICE)
    place, done = Path(folder), 0

    def advance(text: str, steps: int = 1, /) -> None:
        nonlocal done
        done += steps
        write_text(place / "progress.json", dump_json({"done": done, "text": text}))

    # One that a killed server left behind may still be ending.
    with exclusive_lock(place / "job.lock"), numeric_context():
        # Forced: what a server of other code left there is begun anew.
        run(job_of(read_pairs(place)), place / "run", advance=advance, force=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
