"""The one parallel engine: independent tasks in this process, on a local Dask cluster, or on a given one.

Tasks are pure functions of their arguments, so results are the same for any number of workers. They are
handed to the caller as they finish, for checkpoints and progress; the caller orders them. What happens when
workers or the scheduler die is told in `cpic_planner.jobs.cluster`.
"""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar
from urllib.parse import urlsplit

from cpic_core import InputError, numeric_context

T = TypeVar("T")
_PROTOCOLS = ("tcp", "tls", "ws", "wss")


class ClusterError(RuntimeError):
    """The cluster, not a task, ended the run; what was handed over until then is good."""


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
            from cpic_planner.jobs.local_cluster import local_cluster, quiet_dask

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
    >>> from cpic_planner.jobs.engine import run_tasks
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
    from cpic_planner.jobs.cluster import Work, run_on
    from cpic_planner.jobs.local_cluster import quiet_dask

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
        except ValueError:
            good = False
    if not good:
        raise InputError("--scheduler", scheduler, allowed="an address tcp://host:port")
    return scheduler
