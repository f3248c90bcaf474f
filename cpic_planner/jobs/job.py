"""One loop for all long work: hash, folder, resume, tasks, progress, result, products, record.

A kind of job is one function that returns a `Job`: what decides its result, the tasks that it has done, and the result
that it makes of their bodies. `run` does everything else, the same for every kind::

    def squares(n: int) -> Job[Total]:
        def work(runner: Runner[Any]) -> Total:
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
from typing import Any, Generic, TypedDict, TypeVar

from pydantic import BaseModel

from cpic_core import (
    Advance,
    InputError,
    Record,
    check_address,
    compute_once,
    digest_of,
    dump_json,
    fingerprint,
    numeric_context,
    promise_of,
    untold,
)
from cpic_planner import results
from cpic_planner.jobs.folder import LIST_NAME, RunFolder, check_run_folder, open_run_folder
from cpic_planner.version import __version__
from simulator.config import content_hash

T = TypeVar("T")


def run_tasks(
    function: Callable[..., T],
    arguments: Sequence[tuple[Any, ...]],
    *,
    common: tuple[Any, ...] = (),
    workers: int = 1,
    scheduler: str | None = None,
    patience_s: float = 60.0,
    crew: Callable[[], tuple[str, Any]] | None = None,
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
    crew : callable, optional
        Returns the address of a scheduler and the workers of this machine to use, where they are needed; without, they
        are started for this call.
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
    from cpic_planner.jobs.cluster import local_cluster, quiet_dask, run_on

    work: Any = (function, common, arguments)
    with contextlib.ExitStack() as own:
        if scheduler is not None:
            own.enter_context(quiet_dask())
            address, workers_here = scheduler, None
        else:
            address, workers_here = own.enter_context(local_cluster(workers)) if crew is None else crew()
        yield from run_on(address, work, patience_s, workers_here, met)


def in_this_process(n_tasks: int, workers: int, scheduler: str | None) -> bool:
    """Return whether `run_tasks` runs so many tasks one after the other where it is called."""
    return scheduler is None and (workers == 1 or n_tasks <= 1)


RECORD = "run.json"


def host() -> dict[str, Any]:
    """Return system, machine, Python, and number of cores: for the record of a run, never for its results."""
    system = {"system": platform.system(), "machine": platform.machine(), "python": platform.python_version()}
    return system | {"cpu_count": os.cpu_count()}


def versions() -> dict[str, str]:
    """Return versions of this package and of those that its results rest on."""
    names = ("cpic-planner", "numpy", "scipy", "astropy", "sep", "numba", "pydantic", "dask")
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


class Task(Record, eq=False):
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


class Cost(Record):
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


class Job(Record, Generic[R], eq=False):
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
    decides_parts : callable, optional
        Returns plain data that decide every finished task, without those that only say how many tasks there are: a
        folder of the same is continued. What decides the result by default.
    """

    kind: str
    results: int
    decides: Callable[[], Mapping[str, Any]]
    work: "Callable[[Runner[R]], R]"
    write: Callable[[RunFolder, R, Mapping[str, Any]], None] = lambda folder, result, bodies: None
    products: Sequence[str] = ()
    cost: Callable[[], Cost] | None = None
    result_file: str = ""
    decides_parts: Callable[[], Mapping[str, Any]] | None = None

    @functools.cached_property
    def digest(self) -> str:
        """Hash of everything that decides the result."""
        return self._hash_of(self.decides())

    @functools.cached_property
    def parts_digest(self) -> str:
        """Hash of everything that decides the finished tasks of a folder, whatever number of them is asked for."""
        return self.digest if self.decides_parts is None else self._hash_of(self.decides_parts())

    def _hash_of(self, decides: Mapping[str, Any]) -> str:
        versions_of = {"kind": self.kind, "results": self.results, "version": __version__}
        return content_hash(versions_of | dict(decides))

    @property
    def result_name(self) -> str:
        """Name of the file of the result."""
        return self.result_file or f"{self.kind}.json"


class RunSettings(TypedDict, total=False):
    """Keywords of `run` that decide how a job runs, never what it gives."""

    workers: int
    scheduler: str | None
    force: bool
    advance: Advance
    command: list[str] | None


@dataclass(eq=False)
class Runner(Generic[R]):
    """A job that runs: tasks that an earlier run finished are taken from its folder, the others are done and kept.

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
    bodies : dict
        Bodies of all finished tasks, by key.
    resumed_parts, computed_parts : int
        How many of them were there, and how many were done.
    result : model
        What the job gave; there is none before its end.
    """

    digest: str = ""
    workers: int = 1
    scheduler: str | None = None
    advance: Advance = untold
    output: RunFolder | None = None
    bodies: dict[str, Any] = field(default_factory=dict)
    resumed_parts: int = 0
    computed_parts: int = 0
    result: R = field(init=False)
    _open: contextlib.ExitStack | None = None
    _crew: tuple[str, Any] | None = None

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
        store: Any = None,
        kept: bool = True,
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
        store : object, optional
            Keeps bodies in place of the folder of the run: ``part(key)`` returns one that is there whole, or None, and
            ``save_part(key, body)`` keeps one, and returns it as ``part`` would. Each is kept before it is told.
        kept : bool
            Whether bodies are parts of the run; others are quicker made again than kept, and are not counted.
        tells : bool
            Whether ``function`` takes ``progress``, and tells it every step itself where it runs in this process.
        again : bool
            Do them all, whatever an earlier run finished.

        Returns
        -------
        dict
            Bodies by key, in the order of the tasks.
        """
        keeper: Any = (store or self.output) if kept else None
        every = {task.key: task for task in tasks}
        bodies: dict[str, Any] = {}
        for task in every.values() if keeper is not None and not again else ():
            if (body := keeper.part(task.key)) is not None:
                bodies[task.key] = body
                self.advance(f"{task.text or task.key} (kept)", task.steps)
        self.resumed_parts += len(bodies)
        waiting = [task for key, task in every.items() if key not in bodies]
        self.computed_parts += len(waiting) if kept else 0
        tells = tells and in_this_process(len(waiting), self.workers, self.scheduler)
        function = functools.partial(function, progress=self.advance) if tells else function
        arguments = [task.arguments for task in waiting]
        where: dict[str, Any] = {"workers": self.workers, "scheduler": self.scheduler}
        if self._open is not None:
            where["crew"] = functools.partial(self._shared_crew, self._open)
        if self.output is not None:
            where["met"] = self.output.met
        for position, body in run_tasks(function, arguments, common=common, **where):
            task = waiting[position]
            bodies[task.key] = body if keeper is None else keeper.save_part(task.key, body)
            if not tells:
                self.advance(task.text or task.key, task.steps)
        ordered = {key: bodies[key] for key in every}
        self.bodies |= ordered
        return ordered

    def _shared_crew(self, open_until_the_end: contextlib.ExitStack) -> tuple[str, Any]:
        """Return the workers of this machine that all tasks of the run share; they start when the first needs them."""
        if self._crew is None:
            from cpic_planner.jobs.cluster import local_cluster

            self._crew = open_until_the_end.enter_context(local_cluster(self.workers))
        return self._crew


def run(
    job: Job[R],
    out: str | Path | None = None,
    *,
    workers: int = 1,
    scheduler: str | None = None,
    force: bool = False,
    advance: Advance = untold,
    command: list[str] | None = None,
) -> Runner[R]:
    """Run a job.

    Parameters
    ----------
    job : Job
    out : str or Path, optional
        Output folder; resumed when it holds work of the same configuration, be it more or less of it. Nothing is
        written without.
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
    Runner
        With its ``result``.

    Raises
    ------
    InputError
        For bad input, or if ``out`` is in use or holds another configuration.
    """
    started, clock = datetime.now(UTC), time.monotonic()
    products = (job.result_name, RECORD, *job.products)
    if out is not None:
        check_run_folder(out, products=products, force=force)  # before the hash, for which some kinds work long
    runner = Runner[R](job.digest, workers, scheduler, advance)
    with contextlib.ExitStack() as stack:
        if out is not None:
            opened = open_run_folder(out, kind=job.kind, config_hash=job.parts_digest, products=products, force=force)
            runner.output = stack.enter_context(opened)
        with contextlib.ExitStack() as runner._open:
            result = job.work(runner)
        made_by = {"fingerprint": str(fingerprint())} if "fingerprint" in type(result).model_fields else {}
        runner.result = result.model_copy(update=made_by)
        if (folder := runner.output) is None:
            return runner
        folder.write(job.result_name, dump_json(runner.result.model_dump(mode="json")))
        job.write(folder, runner.result, runner.bodies)
        others = [other for other in folder.fingerprints if other != folder.fingerprint]
        record = results.RunRecord.of(
            runner,
            command=command or [],
            config_hash=job.digest,
            parts_hash=job.parts_digest,
            started_utc=started.isoformat(timespec="seconds"),
            finished_utc=datetime.now(UTC).isoformat(timespec="seconds"),
            wall_s=round(time.monotonic() - clock, 3),
            host=host(),
            versions=versions(),
            fingerprint=folder.fingerprint,
            software=results.FingerprintRecord.of(fingerprint(), processor=list(fingerprint().processor)),
            other_fingerprints=others,
            promise=promise_of(folder.fingerprint, *others),
            list_sha256=digest_of(folder.path / LIST_NAME),
        )
        folder.write(RECORD, dump_json(record.model_dump(mode="json")))
    return runner


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
