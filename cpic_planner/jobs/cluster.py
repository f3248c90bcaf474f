"""Tasks on a Dask cluster of which any process may die at any time.

A worker that dies loses the tasks it held; Dask gives them to others. It gives a task up when several workers died
with it, whether or not it was to blame, so here such a task is run once more with nothing else in flight: what ends
its workers then as well is named in one error, after everything else has finished. A scheduler that goes takes all
tasks with it (and, in Dask, its workers): the client waits for one at the same address and sends again what is not
finished. A result is handed over when it has arrived here and never asked for again, so nothing is counted twice.

Workers say what they are before they do anything, and those of other code, data or libraries are refused; only the
processor may differ. The client asks every worker of a given scheduler, at the start and when one joins. A worker that
gets a task before it was asked, as our own do, compares the fingerprints itself.

Only a few tasks a worker are in flight, so that the scheduler never holds the arguments of a long run.
"""

import contextlib
import logging
import os
import subprocess
import sys
import tempfile
import time
import uuid
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass, field
from typing import Any

import dask
from distributed import Client, LocalCluster, get_worker
from distributed.protocol.pickle import dumps, loads
from distributed.scheduler import KilledWorker, NoValidWorkerError, NoWorkerError
from distributed.security import Security

from cpic_core import (
    THREAD_VARIABLES,
    ClusterError,
    Fingerprint,
    InputError,
    Record,
    differing_words,
    fingerprint,
    numeric_context,
)
from cpic_planner.version import __version__

_LOG = logging.getLogger(__name__)
_REGISTER_S = 120  # for a worker to find the scheduler
_VAIN = 8  # workers in the place of each one, without a result meanwhile
_ANSWER_S = 20.0  # for a scheduler that should be there
_ATTEMPT_S = 5.0  # for one attempt to reach a scheduler that has gone: Dask's own attempts grow ever rarer
_NOBODY = (NoWorkerError, NoValidWorkerError)
_POLL_S = 0.01
_FETCH_S = 2.0  # for a result at first
_PULSE_S = 0.5  # between looks at which workers there are
_ENCRYPTED = ("tls://", "wss://")
_IN_FLIGHT = 4  # tasks sent out for every thread of the cluster
_FRUITLESS = 10  # losses of the scheduler in a row without a single result between them
_DEATHS_ALONE = 4  # of workers with one and the same task alone in flight, after which the task is to blame
_ENOUGH_BLAMED = 3  # such tasks, after which the run ends: it may be all of them


class ForeignWorkerError(ClusterError):
    """A worker has other code, data or libraries than the client."""


class Introduced(Record):
    """The words in which a worker introduces itself."""

    version: str
    fingerprint: Fingerprint

    def differences(self) -> list[str]:
        """Say how it differs from this process, the processor apart, each in a few words."""
        other = fingerprint().differences(self.fingerprint)
        return other if self.version == __version__ else [f"version {self.version} (here {__version__})", *other]


def introduced() -> Introduced:
    """Return what this process is."""
    return Introduced(__version__, fingerprint())


def call(asked: str, load: bytes, common: tuple[Any, ...]) -> tuple[str, Any]:
    """Do a task that came as bytes, where this process is what the client is.

    Parameters
    ----------
    asked : str
        Fingerprint of the client.
    load : bytes
        Function and arguments, pickled.
    common : tuple
        Leading arguments.

    Returns
    -------
    tuple
        Fingerprint of this process, and what the task returned.

    Raises
    ------
    ForeignWorkerError
        If more than the processor differs.
    """
    function, args = unpacked(asked, load)
    with numeric_context():
        return str(fingerprint()), function(*common, *args)


def unpacked(asked: str, load: bytes) -> Any:
    """Return what came as bytes; parameters and errors are those of `call`."""
    if other := set(differing_words(asked, str(fingerprint()))) - {"processor"}:
        raise ForeignWorkerError(_foreign(get_worker().address, [f"other {word}" for word in sorted(other)]))
    return loads(load)


def refuse_foreign(client: Any, workers: Collection[str], scheduler: str | None) -> None:
    """Refuse workers that differ in more than the processor; one that does not answer is asked by its first task.

    Parameters
    ----------
    client : distributed.Client
    workers : collection of str
        Their addresses.
    scheduler : str or None
        Address of the scheduler that the caller named; None for workers that we started.

    Raises
    ------
    InputError, ForeignWorkerError
        Naming the first one, and what it has otherwise; the second for our own workers.
    """
    ask = {"workers": list(workers), "on_error": "return", "callback_timeout": _ANSWER_S}
    try:
        answers = client.sync(client._run, introduced, **ask)
    except TimeoutError:  # a busy machine; losses of the scheduler are other errors
        return
    for address, answer in sorted(answers.items()):
        if isinstance(answer, OSError):  # it has gone
            continue
        # Code without this module cannot answer.
        other = answer.differences() if isinstance(answer, Introduced) else [f"other code ({answer})".splitlines()[0]]
        if other and scheduler is not None:
            allowed = "a scheduler whose workers have this code and these libraries"
            raise InputError("--scheduler", scheduler, allowed=allowed, hint=_foreign(address, other))
        if other:
            raise ForeignWorkerError(f"{_foreign(address, other)}: were files changed while the run went on?")


def _foreign(address: str, other: list[str]) -> str:
    return f"worker {address} has {', '.join(other)}"


@contextlib.contextmanager
def quiet_dask() -> Iterator[None]:
    """Use Dask's settings for our runs."""
    settings = {
        "distributed.admin.log-format": "%(name)s %(message)s",
        "distributed.comm.timeouts.connect": "20s",
        "distributed.admin.large-graph-warning-threshold": "1GiB",
    }
    # What its loggers report of losses is told here in one line each.
    loggers = [logging.getLogger(name) for name in ("distributed", "distributed.client")]
    levels = [logger.level for logger in loggers]
    with dask.config.set(settings):
        for logger in loggers:
            logger.setLevel(logging.CRITICAL)
        try:
            yield
        finally:
            for logger, level in zip(loggers, levels, strict=True):
                logger.setLevel(level)


@contextlib.contextmanager
def local_cluster(workers: int) -> "Iterator[tuple[str, LocalWorkers]]":
    """Yield the address of a scheduler and its workers, single-threaded processes that end with this one."""
    where: dict[str, Any] = {"dashboard_address": "127.0.0.1:0", "host": "127.0.0.1"}
    with (
        quiet_dask(),
        LocalCluster(n_workers=0, processes=True, silence_logs=logging.CRITICAL, **where) as cluster,
        tempfile.TemporaryDirectory(prefix="cpic-workers-", ignore_cleanup_errors=True) as scratch,
    ):
        crew = LocalWorkers(cluster.scheduler_address, workers, scratch)
        try:
            crew.replace_dead()
            yield cluster.scheduler_address, crew
        finally:
            crew.close()


class LocalWorkers:
    """Worker processes of one scheduler; one that dies, at whatever moment, is followed by another.

    Dask's own nannies do not replace a worker that is killed while it starts.
    """

    def __init__(self, address: str, n_workers: int, scratch: str) -> None:
        worker = [sys.executable, "-P", "-m", "cpic_planner.jobs.worker", str(os.getpid()), scratch, address]
        limits = ["--nthreads=1", "--memory-limit=0", "--host=127.0.0.1", f"--death-timeout={_REGISTER_S}"]
        self._command = [*worker, *limits, "--no-nanny", "--no-dashboard"]
        # What can be imported here can be there; threads are set before the libraries load.
        paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
        own = {"PYTHONPATH": paths, "DASK_LOGGING__DISTRIBUTED": "critical"}
        self._environment = os.environ | dict.fromkeys(THREAD_VARIABLES, "1") | own
        self._processes: list[subprocess.Popen[bytes] | None] = [None] * n_workers
        self._replaced = 0

    def replace_dead(self) -> None:
        """Start a worker in every place that has none.

        Raises
        ------
        ClusterError
            If that happens again and again without a result.
        """
        for place, process in enumerate(self._processes):
            status = None if process is None else process.poll()
            if process is not None and status is None:
                continue
            if process is not None:
                self._replaced += 1
                _LOG.info("worker %d ended with status %s: starting another", place + 1, status)
            if self._replaced > _VAIN * len(self._processes) + _VAIN:
                raise ClusterError(f"{self._replaced} workers ended without a result, the last with status {status}")
            # A session of its own: a Ctrl-C in the terminal is for the parent to answer.
            self._processes[place] = subprocess.Popen(
                self._command, env=self._environment, stdin=subprocess.DEVNULL, start_new_session=True
            )

    def fruitful(self) -> None:
        """Note that workers bring results."""
        self._replaced = 0

    def close(self) -> None:
        """End all workers at once: their tasks have no side effects."""
        for process in filter(None, self._processes):
            process.kill()
        for process in filter(None, self._processes):
            process.wait()


Work = tuple[Callable[..., Any], tuple[Any, ...], Sequence[tuple[Any, ...]]]
"""The work to run: a function, leading arguments that all tasks share, and those of each task."""


class TaskQueue:
    """Tasks that are not sent out: those that wait, and those that Dask gave up and that are to run alone."""

    def __init__(self, total: int) -> None:
        self._total = total
        self._waiting = deque(range(total))
        self._suspects: deque[int] = deque()
        self._deaths_alone: dict[int, int] = {}
        self._blamed: list[int] = []

    @property
    def left(self) -> int:
        """How many they are."""
        return len(self._waiting) + len(self._suspects)

    def next(self, flying: int, room: int) -> int | None:
        """Return the task to send out next, if any, with so many in flight and room for so many."""
        if self._waiting:
            return self._waiting[0] if flying < room else None
        return self._suspects[0] if self._suspects and not flying else None

    def sent(self, index: int) -> None:
        """Note that the next task has gone."""
        (self._suspects if index in self._deaths_alone else self._waiting).popleft()

    def put_back(self, indices: Iterable[int]) -> None:
        """Send tasks that were lost out again, before the others."""
        for index in sorted(indices, reverse=True):
            (self._suspects if index in self._deaths_alone else self._waiting).appendleft(index)

    def suspect(self, index: int, deaths: int) -> None:
        """Put a task that Dask gave up aside, or blame it for the deaths that nothing else in flight explains."""
        if index not in self._deaths_alone:
            text = "task %d of %d: %d workers died with it; it will run alone at the end"
            _LOG.warning(text, index + 1, self._total, deaths)
            self._deaths_alone[index] = 0
        else:
            self._deaths_alone[index] += deaths
        if self._deaths_alone[index] < _DEATHS_ALONE:
            self._suspects.append(index)
            return
        self._blamed.append(index)
        if len(self._blamed) >= _ENOUGH_BLAMED:
            self.tell_blamed()

    def tell_blamed(self) -> None:
        """Raise for the tasks to blame."""
        if self._blamed:
            numbers = ", ".join(str(index + 1) for index in sorted(self._blamed))
            rest = f"{self.left} others are not finished" if self.left else "all others are done"
            often = f"task {numbers} of {self._total} ended its worker {_DEATHS_ALONE} times or more"
            why = "with nothing else running: short of memory, or a crash in native code"
            raise ClusterError(f"{often} {why}; {rest}")


class _LaterError(Exception):
    """The result of a task is not to be had now."""


class _LostError(Exception):
    """The scheduler no longer knows our tasks."""


def run_on(
    address: str, work: Work, patience_s: float, own: LocalWorkers | None, met: Callable[[str], None]
) -> Iterator[tuple[int, Any]]:
    """Run all tasks on the cluster of the scheduler at ``address``; see `cpic_planner.jobs.job.run_tasks`."""
    queue = TaskQueue(len(work[2]))
    losses = 0
    link = _Link(address, work, _first_client(address), own, met)
    try:
        while queue.left or link.flying:
            try:
                link.look_after()
                while (index := queue.next(len(link.flying), link.room)) is not None:
                    link.send(index)
                    queue.sent(index)
                for index in link.ready():
                    try:
                        value = link.take(index)
                    except _LaterError:
                        break
                    except KilledWorker as error:
                        queue.suspect(index, error.allowed_failures + 1)
                        continue
                    except _NOBODY:  # a scheduler that is set to give up when it has no workers
                        queue.put_back([index])
                        continue
                    losses = 0
                    if own is not None:
                        own.fruitful()
                    yield index, value
            except _LostError:
                losses += 1
                if losses > _FRUITLESS:
                    raise ClusterError(f"the scheduler {address} lost all tasks {losses} times in a row") from None
                queue.put_back(link.flying)
                link.close()
                _LOG.warning("the scheduler %s has gone: waiting up to %.0f s for it", address, patience_s)
                link = _Link(address, work, _next_client(address, patience_s, queue.left), own, met)
                _LOG.warning("the scheduler %s is back: sending %d unfinished tasks again", address, queue.left)
        queue.tell_blamed()
    finally:
        link.close()


def _first_client(address: str) -> Any:
    _check_certificates(address)
    try:
        return _client(address, _ANSWER_S)
    except (OSError, ValueError, RuntimeError) as error:
        hint = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError("--scheduler", address, allowed="the address of a live Dask scheduler", hint=hint) from None


def _check_certificates(address: str) -> None:
    """Refuse an encrypted connection for which Dask's settings name no certificates, or none that can be read."""
    if not address.startswith(_ENCRYPTED):
        return
    try:
        there, hint = Security().get_connection_args("client").get("ssl_context") is not None, ""
    except (OSError, ValueError) as error:  # of ssl too
        there, hint = False, f" ({error.strerror if isinstance(error, OSError) else error})"
    if not there:
        allowed = "with certificates in Dask's settings: distributed.comm.tls.ca-file, client.cert and client.key"
        raise InputError("--scheduler", address, allowed=allowed, hint=f"there are none that can be read{hint}")


def _next_client(address: str, patience_s: float, left: int) -> Any:
    end = time.monotonic() + patience_s
    while (rest := end - time.monotonic()) > 0:
        with contextlib.suppress(OSError):
            return _client(address, min(_ATTEMPT_S, rest))
        time.sleep(_POLL_S)
    raise ClusterError(
        f"the scheduler {address} has gone and did not come back in {patience_s:.0f} s; "
        f"{left} tasks are not finished, the others are kept"
    )


def _client(address: str, timeout_s: float) -> Any:
    return Client(address, timeout=timeout_s, set_as_default=False)


@dataclass
class _Link:
    """Our tasks at one scheduler, from the connection to its loss."""

    address: str
    work: Work
    client: Any
    own: LocalWorkers | None
    met: Callable[[str], None]
    flying: dict[int, Any] = field(default_factory=dict)
    room: int = _IN_FLIGHT
    _fetch_s: float = _FETCH_S
    _name: str = field(default_factory=lambda: f"cpic-{uuid.uuid4().hex}")
    _sent: int = 0
    _common: Any = None
    _next_look_s: float = 0.0
    _idle: bool = False
    _asked: str = field(default_factory=lambda: str(fingerprint()))
    _greeted: set[str] = field(default_factory=set)

    def look_after(self) -> None:
        """Notice a lost scheduler at once, and now and then which workers there are; ask new ones what they are."""
        if self.client.status != "running":
            raise _LostError
        if time.monotonic() < self._next_look_s:
            return
        if self.own is not None:
            self.own.replace_dead()
        with self._lossy():
            workers = self.client.nthreads(callback_timeout=_ANSWER_S)
        if self.own is None:  # our own compare for themselves, at their first task
            self._greet(set(workers))
        threads = sum(workers.values())
        self._next_look_s = time.monotonic() + _PULSE_S
        self.room = _IN_FLIGHT * max(threads, 1)
        if (threads == 0) != self._idle:
            self._idle = threads == 0
            if self.own is None:
                state = "has no workers: waiting for some" if self._idle else "has workers again"
                _LOG.warning("the scheduler %s %s", self.address, state)

    def _greet(self, workers: set[str], *, again: bool = False) -> None:
        """Ask workers what they are, those that said it only if ``again``; raises where one is to be refused."""
        if new := workers if again else workers - self._greeted:
            with self._lossy():
                refuse_foreign(self.client, new, self.address if self.own is None else None)
        self._greeted = workers

    def send(self, index: int) -> None:
        """Send one task out."""
        # Pickled here: Dask neither searches the arguments for names of tasks nor needs our modules to schedule them.
        function, common, arguments = self.work
        load = dumps((function, arguments[index]))
        with self._lossy():
            if common and self._common is None:
                # A task of its own: workers take its result from one another, and what dies with one is made again.
                self._common = self.client.submit(unpacked, self._asked, dumps(common), key=self._key("common"))
            shared = () if self._common is None else self._common
            self.flying[index] = self.client.submit(call, self._asked, load, shared, key=self._key("task"))

    def _key(self, kind: str) -> tuple[str, int]:
        self._sent += 1
        return f"{self._name}-{kind}", self._sent

    def ready(self) -> list[int]:
        """Return the tasks that ended in one way or other, after a short wait if there is none."""
        ended = [index for index, future in self.flying.items() if future.status not in ("pending", "lost")]
        if not ended and self.flying:
            time.sleep(_POLL_S)
        return ended

    def take(self, index: int) -> Any:
        """Fetch the result of a task that ended, or raise what it raised."""
        future = self.flying[index]
        try:
            # Not for ever: a result that died with its worker is made again only when there is another worker.
            worker, value = future.result(timeout=self._fetch_s)
        except Exception as error:
            if future.status != "error":
                if isinstance(error, TimeoutError) and self.client.status == "running":
                    self._fetch_s *= 2  # or it was on its way, but long
                    raise _LaterError from error
                if isinstance(error, (OSError, CancelledError)) or self.client.status != "running":
                    raise _LostError from error
                raise
            del self.flying[index]
            given_up = error.task if isinstance(error, (KilledWorker, *_NOBODY)) else None
            if self._common is not None and given_up == self._common.key:
                self._common = None  # to be made anew for the next task
            if given_up is None:  # the fault of a worker that is not what this process is?
                with contextlib.suppress(_LostError), self._lossy():
                    self._greet(set(self.client.nthreads(callback_timeout=_ANSWER_S)), again=True)
            raise
        del self.flying[index]
        self._fetch_s = _FETCH_S
        if worker != self._asked:
            self.met(worker)
        return value

    @contextlib.contextmanager
    def _lossy(self) -> Iterator[None]:
        """Tell the loss of the scheduler from other errors."""
        try:
            yield
        except (OSError, CancelledError) as error:
            raise _LostError from error
        except RuntimeError as error:
            if self.client.status != "running":
                raise _LostError from error
            raise

    def close(self) -> None:
        """Give all tasks up and leave."""
        self.flying.clear()
        self._common = None
        with contextlib.suppress(OSError, RuntimeError, CancelledError):
            self.client.close(timeout=_ATTEMPT_S)
