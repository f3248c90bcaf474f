"""One loop for all long work: hash, folder, resume, tasks, progress, result, products, record.

A kind of job is one function that returns a `Job`: what decides its result, the tasks that it has done, and the result
that it makes of their bodies. `run` does everything else, the same for every kind::

    def squares(n: int) -> Job[Total]:
        def work(runner: Runner) -> Total:
            found = runner.finish(square, [Task(f"square {i}", (i,)) for i in range(n)])
            return Total(config_hash=runner.digest, total=sum(body["square"] for body in found.values()))

        return Job("squares", 1, lambda: {"n": n}, work)

Tasks are pure functions of their arguments, so results are the same for any number of workers: this process, a Dask
cluster on this machine, or a given one. They are handed over as they finish, for checkpoints and progress. What happens
when workers or the scheduler die is told in `cpic_planner.jobs.cluster`.

The record of a run, ``run.json``, has its clocks, host and versions, what made its numbers, and the measured pace of
this machine, so that estimates of run times hold on it.
"""

import contextlib
import functools
import hashlib
import os
import platform
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any, Generic, Protocol, TypedDict, TypeVar
from urllib.parse import urlsplit

from pydantic import BaseModel

from cpic_core import (
    Advance,
    InputError,
    compute_once,
    digest_of,
    dump_json,
    fingerprint,
    numeric_context,
    promise_of,
    untold,
)
from cpic_planner.jobs.folder import LIST_NAME, RunFolder, check_run_folder, open_run_folder
from cpic_planner.results import FingerprintRecord, RunRecord
from cpic_planner.version import __version__
from simulator.config import content_hash

T = TypeVar("T")
_PROTOCOLS = ("tcp", "tls", "ws", "wss")


@dataclass(eq=False)
class LocalPool:
    """Workers of this machine that several calls of `run_tasks` share: a context, at whose end they end.

    They start when the first call needs them.

    Attributes
    ----------
    workers : int
        Local processes.
    """

    workers: int
    _open: contextlib.ExitStack = field(default_factory=contextlib.ExitStack)
    _cluster: tuple[str, Any] | None = None

    def __enter__(self) -> "LocalPool":
        return self

    def __exit__(self, *error: object) -> None:
        self._cluster = None
        self._open.close()

    def cluster(self) -> tuple[str, Any]:
        """Return the address of their scheduler, and the workers."""
        if self._cluster is None:
            from cpic_planner.jobs.cluster import local_cluster, quiet_dask

            self._open.enter_context(quiet_dask())
            self._cluster = self._open.enter_context(local_cluster(self.workers))
        return self._cluster


def run_tasks(
    function: Callable[..., T],
    arguments: Sequence[tuple[Any, ...]],
    *,
    common: tuple[Any, ...] = (),
    workers: int = 1,
    scheduler: str | None = None,
    patience_s: float = 60.0,
    pool: LocalPool | None = None,
    met: Callable[[str], None] = lambda fingerprint: None,
) -> Iterator[tuple[int, T]]:
    """Run ``function(*common, *arguments[i])`` for every ``i``.

    Parameters
    ----------
    function : callable
        Importable, free of side effects.
    arguments : sequence of tuple
        Picklable arguments, one tuple a task.
    common : tuple
        Leading arguments that all tasks share; they travel to each worker once, so that they may be large. A task
        must not change them.
    workers : int
        1 runs in this process; more start that many single-threaded local processes, which end with this one.
    scheduler : str, optional
        Address of a Dask scheduler (``tcp://host:port``) to use instead.
    patience_s : float
        How long a scheduler that has gone may take to come back, in s.
    pool : LocalPool, optional
        Workers of this machine to use, where they are needed; without, they are started for this call.
    met : callable
        Told the fingerprint of a worker that has another processor than this process, before what it did is yielded.

    Yields
    ------
    index : int
        Position in ``arguments``, in order of completion; each once, whatever died meanwhile.
    result
        What the task returned.

    Raises
    ------
    InputError
        If ``workers`` is not 1 to 256, or ``scheduler`` is no address, does not answer, or has a worker of other code,
        data or libraries than this process.
    ClusterError
        If the scheduler went and did not come back, or a task ended its worker every time.
    Exception
        What a task raised, as it is.

    Examples
    --------
    >>> from cpic_planner.jobs.job import run_tasks
    >>> sorted(run_tasks(divmod, [(3,), (5,)], common=(17,)))
    [(0, (5, 2)), (1, (3, 2))]
    """
    if isinstance(workers, bool) or not isinstance(workers, int) or not 1 <= workers <= 256:
        raise InputError("--workers", workers, allowed="an integer from 1 to 256")
    if in_this_process(len(arguments), workers, scheduler):
        for index, args in enumerate(arguments):
            with numeric_context():
                result = function(*common, *args)
            yield index, result
        return
    check_address(scheduler)
    from cpic_planner.jobs.cluster import Work, quiet_dask, run_on

    work = Work(function, common, arguments)
    if scheduler is not None:
        with quiet_dask():
            yield from run_on(scheduler, work, patience_s, None, met)
    elif pool is not None:
        address, crew = pool.cluster()
        yield from run_on(address, work, patience_s, crew, met)
    else:
        with LocalPool(workers) as own:
            address, crew = own.cluster()
            yield from run_on(address, work, patience_s, crew, met)


def in_this_process(n_tasks: int, workers: int, scheduler: str | None) -> bool:
    """Return whether `run_tasks` runs so many tasks one after the other where it is called."""
    return scheduler is None and (workers == 1 or n_tasks <= 1)


def check_address(scheduler: str | None) -> str | None:
    """Refuse what can be no address of a scheduler, before anything slow is done with it; returns what it got."""
    if scheduler is None:
        return None
    good = isinstance(scheduler, str)
    if good:
        try:
            parts = urlsplit(scheduler)
            good = parts.scheme in _PROTOCOLS and bool(parts.hostname) and bool(parts.port)
        except ValueError:  # no port
            good = False
    if not good:
        raise InputError("--scheduler", scheduler, allowed="an address tcp://host:port")
    return scheduler


RECORD = "run.json"


def run_record(folder: RunFolder, run: object, **given: Any) -> RunRecord:
    """Return the record of a run that ends now.

    Parameters
    ----------
    folder : RunFolder
    run : object
        Has the workers and counts that a `RunRecord` names.
    **given
        Its other fields.
    """
    others = [other for other in folder.fingerprints if other != folder.fingerprint]
    return RunRecord.of(
        run,
        fingerprint=folder.fingerprint,
        finished_utc=datetime.now(UTC).isoformat(timespec="seconds"),
        host=host(),
        versions=versions(),
        software=FingerprintRecord.of(fingerprint(), processor=list(fingerprint().processor)),
        other_fingerprints=others,
        promise=promise_of(folder.fingerprint, *others),
        list_sha256=digest_of(folder.path / LIST_NAME),
        **given,
    )


def host() -> dict[str, Any]:
    """Return system, machine, Python, and number of cores: for the record of a run, never for its results."""
    system = {"system": platform.system(), "machine": platform.machine(), "python": platform.python_version()}
    return system | {"cpu_count": os.cpu_count()}


def versions() -> dict[str, str]:
    """Return versions of this package and of those that its results rest on."""
    names = ("cpic-planner", "numpy", "scipy", "astropy", "photutils", "numba", "pydantic", "dask")
    installed = dict.fromkeys(names, "not installed")
    for name in names:
        with contextlib.suppress(metadata.PackageNotFoundError):
            installed[name] = metadata.version(name)
    return installed


_REFERENCE_S = 0.048
"""Processor time of the piece of work on the core that the costs of jobs are stated for (Intel Xeon of 2.5 GHz)."""
_TRIES, _SIZE, _PRODUCTS, _DRAWS, _CALLS = 12, 256, 8, 200_000, 4000


def piece_s() -> float:
    """Return the processor time of one piece of work (s), which has a part of each kind of work of the jobs.

    The parts take about a third each: complex matrix products, as a propagation of light has them; draws of Poisson
    and gamma variates and a sort, as frames have them; calls of numpy on short arrays, as rankings and calendars do.
    """
    import numpy as np

    generator = np.random.default_rng(0)
    matrix = generator.random((_SIZE, _SIZE)) + 1j * generator.random((_SIZE, _SIZE))
    mean, short = np.full(_DRAWS, 3.0), np.arange(16.0)
    begun = time.process_time()
    for _ in range(_PRODUCTS):
        matrix @ matrix
    generator.poisson(mean)
    generator.gamma(3.0, size=_DRAWS // 2)
    np.sort(generator.random(_DRAWS // 2))
    for number in range(_CALLS):
        float(np.sum(short * number))
    return time.process_time() - begun


@functools.cache
def pace() -> float:
    """Return the processor time of work on this machine over that of the core that costs are stated for.

    It is the quickest of a few tries, since other processes slow down a try but never speed it up, and is kept in the
    cache: measured once for each machine and version, in about half a second.
    """
    import numpy as np

    digest = hashlib.sha256(str(fingerprint()).encode()).hexdigest()[:16]

    def measured() -> Mapping[str, Any]:
        return {"pace": np.array(min(piece_s() for _ in range(_TRIES)) / _REFERENCE_S)}

    return compute_once(f"pace-{digest}", measured, lambda arrays: float(arrays["pace"]))


R = TypeVar("R", bound=BaseModel)


@dataclass(frozen=True, eq=False)
class Task:
    """One independent piece of work.

    Attributes
    ----------
    key : str
        Names its finished body on disk; equal keys mean equal bodies.
    arguments : tuple
        Of the function that does it, picklable.
    text : str
        What progress says of it; the key by default.
    steps : int
        How many steps of progress it is.
    """

    key: str
    arguments: tuple[Any, ...]
    text: str = ""
    steps: int = 1


class PartStore(Protocol):
    """Keeps finished bodies; `cpic_planner.jobs.folder.RunFolder` is one, for bodies that are JSON objects."""

    def part(self, key: str) -> Any | None:
        """Return what an earlier run finished under ``key``; None if it is not there, or not whole."""

    def save_part(self, key: str, body: Any) -> Any:
        """Keep a finished body whole, and return it as `part` would."""


class Unkept:
    """Keeps nothing: for a run without a folder, and for bodies that are quicker made again than kept."""

    def part(self, key: str) -> None:
        """Find nothing."""
        return

    def save_part(self, key: str, body: Any) -> Any:
        """Return the body."""
        return body


@dataclass(frozen=True)
class Cost:
    """Expected cost of a job.

    Attributes
    ----------
    counts : mapping
        What there is to do, by name.
    times_s : sequence of float
        Processor time of each task, on the core of `cpic_planner.jobs.job`.
    start_s : float
        Time that no worker shortens.
    pool_s : float
        Time that starting several workers adds.
    memory_mb, worker_mb : float
        Memory, and what each worker adds to it.
    disk_mb : float
    """

    counts: Mapping[str, float]
    times_s: Sequence[float]
    start_s: float
    memory_mb: float
    disk_mb: float
    pool_s: float = 0.0
    worker_mb: float = 0.0

    def at(self, workers: int, pace: float = 1.0) -> dict[str, float]:
        """Return counts, processor and wall time, memory and disk with so many workers, on a machine of such a pace.

        The wall time is that of a machine which does nothing else; no number of workers ends before the longest task.
        """
        busy = max(min(workers, len(self.times_s)), 1)
        most = max(sum(self.times_s) / busy, max(self.times_s, default=0.0))
        wall_s = pace * (self.start_s + (self.pool_s if busy > 1 else 0.0) + most)
        cpu_s = pace * (self.start_s + (busy * self.pool_s if busy > 1 else 0.0) + sum(self.times_s))
        memory_mb = self.memory_mb + self.worker_mb * workers
        return {**self.counts, "cpu_s": cpu_s, "wall_s": wall_s, "memory_mb": memory_mb, "disk_mb": self.disk_mb}


@dataclass(frozen=True, eq=False)
class Job(Generic[R]):
    """Long work of one kind; `run` runs it, `estimate` says what it costs.

    Attributes
    ----------
    kind : str
        Kind of run, which the output folder names.
    results : int
        Raised when the same configuration gives other numbers, so that old folders are not resumed.
    decides : callable
        Returns plain data that decide the result; called once, when the hash is needed.
    work : callable
        Has the tasks done by the `Runner` that it gets, and returns the result.
    write : callable
        Writes the products beside the result into the folder, from the result and the bodies by key.
    products : sequence of str
        Names of the files that ``write`` and ``work`` write.
    cost : callable
        Returns the `Cost`, without working.
    result_file : str
        Name of the file of the result, ``KIND.json`` by default.
    """

    kind: str
    results: int
    decides: Callable[[], Mapping[str, Any]]
    work: "Callable[[Runner], R]"
    write: Callable[[RunFolder, R, Mapping[str, Any]], None] = lambda folder, result, bodies: None
    products: Sequence[str] = ()
    cost: Callable[[], Cost] | None = None
    result_file: str = ""

    @functools.cached_property
    def digest(self) -> str:
        """Hash of everything that decides the result."""
        versions_of = {"kind": self.kind, "results": self.results, "version": __version__}
        return content_hash(versions_of | dict(self.decides()))

    @property
    def result_name(self) -> str:
        """Name of the file of the result."""
        return self.result_file or f"{self.kind}.json"


@dataclass(frozen=True)
class Finished(Generic[R]):
    """A finished job.

    Attributes
    ----------
    result : model
    bodies : dict
        What its tasks returned, by key.
    resumed_parts, computed_parts : int
        Tasks that an earlier run had finished, and those that this one did.
    """

    result: R
    bodies: Mapping[str, Any]
    resumed_parts: int
    computed_parts: int


class RunSettings(TypedDict, total=False):
    """Keywords of `run` that decide how a job runs, never what it gives."""

    workers: int
    scheduler: str | None
    force: bool
    advance: Advance
    command: list[str] | None


@dataclass(eq=False)
class Runner:
    """Does tasks: those that an earlier run finished are taken from its folder, the others are done and kept.

    Attributes
    ----------
    digest : str
        Hash of everything that decides the result.
    workers, scheduler
        As of `cpic_planner.jobs.job.run_tasks`.
    advance : Advance
        Told about every finished task.
    output : RunFolder or None
        Open folder of the run.
    pool : LocalPool or None
        Workers of this machine that all tasks of the run share.
    bodies : dict
        Bodies of all finished tasks, by key.
    resumed_parts, computed_parts : int
        How many of them were there, and how many were done.
    """

    digest: str = ""
    workers: int = 1
    scheduler: str | None = None
    advance: Advance = untold
    output: RunFolder | None = None
    pool: LocalPool | None = None
    bodies: dict[str, Any] = field(default_factory=dict)
    resumed_parts: int = 0
    computed_parts: int = 0

    @property
    def folder(self) -> RunFolder:
        """The folder of a run that cannot do without.

        Raises
        ------
        InputError
            If it has none.
        """
        if self.output is None:
            raise InputError("--out", None, allowed="a folder", hint="this kind of run keeps its parts there")
        return self.output

    def finish(
        self,
        function: Callable[..., Any],
        tasks: Iterable[Task],
        *,
        common: tuple[Any, ...] = (),
        store: PartStore | None = None,
        tells: bool = False,
        again: bool = False,
    ) -> dict[str, Any]:
        """Run tasks.

        Parameters
        ----------
        function : callable
            Does one; importable, without side effects.
        tasks : iterable of Task
            Those of equal keys are done once.
        common : tuple
            Leading arguments that all tasks share.
        store : PartStore, optional
            Where bodies are kept, the folder of the run by default. Each body is kept before it is told or counted;
            those of `Unkept` are no parts of the run, and are not counted.
        tells : bool
            Whether ``function`` takes ``progress``, and tells it every step itself where it runs in this process.
        again : bool
            Do them all, whatever an earlier run finished.

        Returns
        -------
        dict
            Bodies by key, in the order of the tasks.
        """
        keeper: PartStore = store or self.output or Unkept()
        every = {task.key: task for task in tasks}
        kept: dict[str, Any] = {}
        for task in () if again else every.values():
            if (body := keeper.part(task.key)) is not None:
                kept[task.key] = body
                self.advance(f"{task.text or task.key} (kept)", task.steps)
        self.resumed_parts += len(kept)
        waiting = [task for key, task in every.items() if key not in kept]
        tells = tells and in_this_process(len(waiting), self.workers, self.scheduler)
        function = functools.partial(function, progress=self.advance) if tells else function
        arguments = [task.arguments for task in waiting]
        where: dict[str, Any] = {"workers": self.workers, "scheduler": self.scheduler, "pool": self.pool}
        if self.output is not None:
            where["met"] = self.output.met
        done = run_tasks(function, arguments, common=common, **where)
        for position, body in done:
            task = waiting[position]
            kept[task.key] = keeper.save_part(task.key, body)
            self.computed_parts += not isinstance(store, Unkept)
            if not tells:
                self.advance(task.text or task.key, task.steps)
        ordered = {key: kept[key] for key in every}
        self.bodies |= ordered
        return ordered


def run(
    job: Job[R],
    out: str | Path | None = None,
    *,
    workers: int = 1,
    scheduler: str | None = None,
    force: bool = False,
    advance: Advance = untold,
    command: list[str] | None = None,
) -> Finished[R]:
    """Run a job.

    Parameters
    ----------
    job : Job
    out : str or Path, optional
        Output folder; resumed when it holds work of the same configuration. Nothing is written without.
    workers : int
        Local worker processes, 1 to 256; the result does not depend on it.
    scheduler : str, optional
        Dask scheduler to use instead.
    force : bool
        Remove what a run of another configuration wrote into ``out``, and nothing else.
    advance : Advance
        Called with a text after each finished piece of work.
    command : list of str, optional
        Command line, kept in ``run.json``.

    Returns
    -------
    Finished

    Raises
    ------
    InputError
        For bad input, or if ``out`` is in use or holds another configuration.
    """
    started, clock = datetime.now(UTC), time.monotonic()
    products = (job.result_name, RECORD, *job.products)
    if out is not None:
        check_run_folder(out, products=products, force=force)  # before the hash, for which some kinds work long
    runner = Runner(job.digest, workers, scheduler, advance)
    with contextlib.ExitStack() as stack:
        if out is not None:
            opened = open_run_folder(out, kind=job.kind, config_hash=job.digest, products=products, force=force)
            runner.output = stack.enter_context(opened)
        result = _worked(job, runner)
        if (folder := runner.output) is not None:
            folder.write(job.result_name, dump_json(result.model_dump(mode="json")))
            job.write(folder, result, runner.bodies)
            times = {"started_utc": started.isoformat(timespec="seconds"), "wall_s": round(time.monotonic() - clock, 3)}
            record = run_record(folder, runner, command=command or [], config_hash=job.digest, **times)
            folder.write(RECORD, dump_json(record.model_dump(mode="json")))
    return Finished(result, runner.bodies, runner.resumed_parts, runner.computed_parts)


def _worked(job: Job[R], runner: Runner) -> R:
    """Return the result of a job whose tasks share the workers of this machine, with what made it."""
    with LocalPool(runner.workers) as runner.pool:
        result = job.work(runner)
    if "fingerprint" not in type(result).model_fields:
        return result
    return result.model_copy(update={"fingerprint": str(fingerprint())})


def estimate(job: Job[Any], *, workers: int = 1) -> dict[str, float]:
    """Return what a job would do, and its processor and wall time (s) here, memory and disk (MB), without working.

    Parameters
    ----------
    job : Job
    workers : int
        Local worker processes.
    """
    assert job.cost is not None, f"{job.kind} has no estimate"
    return job.cost().at(workers, pace())
