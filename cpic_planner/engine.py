"""The one parallel engine: independent tasks in this process, on a local Dask cluster, or on a given one.

Tasks are pure functions of their arguments, so results are the same for any number of workers. They are
handed to the caller as they finish, for checkpoints and progress; the caller orders them.
"""

from __future__ import annotations

import contextlib
import logging
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from catalogs.errors import InputError

__all__ = ["run_tasks"]

T = TypeVar("T")
_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")


def run_tasks(
    function: Callable[..., T],
    arguments: Sequence[tuple[Any, ...]],
    *,
    workers: int = 1,
    scheduler: str | None = None,
) -> Iterator[tuple[int, T]]:
    """Run ``function(*arguments[i])`` for every ``i``.

    Parameters
    ----------
    function : callable
        Importable, free of side effects.
    arguments : sequence of tuple
        Picklable arguments, one tuple a task.
    workers : int
        1 runs in this process; more start that many single-threaded local processes, which end with this one.
    scheduler : str, optional
        Address of a Dask scheduler (``tcp://host:port``) to use instead.

    Yields
    ------
    index : int
        Position in ``arguments``, in order of completion.
    result
        What the task returned.

    Raises
    ------
    InputError
        If ``workers`` is not 1 to 256, or the scheduler does not answer.
    """
    if isinstance(workers, bool) or not isinstance(workers, int) or not 1 <= workers <= 256:
        raise InputError("--workers", workers, allowed="an integer from 1 to 256")
    if scheduler is None and (workers == 1 or len(arguments) <= 1):
        with single_threaded_blas():
            for index, args in enumerate(arguments):
                yield index, function(*args)
        return
    with _client(workers, scheduler) as client:
        from distributed import as_completed

        futures = {client.submit(_pinned, function, args, pure=False): i for i, args in enumerate(arguments)}
        for future in as_completed(list(futures), loop=client.loop):
            yield futures[future], future.result()


def _ignore_interrupt() -> None:
    """A Ctrl-C in the terminal reaches every process; only the parent is to answer it, and then ends its workers."""
    with contextlib.suppress(ValueError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _pinned(function: Callable[..., T], args: tuple[Any, ...]) -> T:
    with single_threaded_blas():
        return function(*args)


@contextlib.contextmanager
def single_threaded_blas() -> Iterator[None]:
    """Pin BLAS to one thread: sums then have one order, and workers do not fight for cores."""
    from threadpoolctl import threadpool_limits

    with threadpool_limits(limits=1):
        yield


@contextlib.contextmanager
def _client(workers: int, scheduler: str | None) -> Iterator[Any]:
    import dask
    from distributed import Client, LocalCluster

    # Dask's own environment of workers makes the allocator give memory back at once, and leaves that to this process
    # and its children: arrays of some megabytes then cost more in page faults than in arithmetic.
    quiet = {"distributed.admin.log-format": "%(name)s %(message)s", "distributed.worker.daemon": True,
             "distributed.comm.timeouts.connect": "20s",
             "distributed.nanny.pre-spawn-environ": dict.fromkeys(_THREAD_VARIABLES, "1")}  # fmt: skip
    with dask.config.set(quiet), contextlib.ExitStack() as stack:
        logging.getLogger("distributed").setLevel(logging.ERROR)
        if scheduler is not None:
            try:
                client = stack.enter_context(Client(scheduler, timeout="20s", set_as_default=False))
            except (OSError, TimeoutError, ValueError) as error:
                raise InputError("--scheduler", scheduler, allowed="the address of a live Dask scheduler",
                                 hint=str(error).splitlines()[0]) from None  # fmt: skip
            yield client
            return
        old = {name: os.environ.get(name) for name in _THREAD_VARIABLES}
        os.environ.update(dict.fromkeys(_THREAD_VARIABLES, "1"))
        try:
            cluster = stack.enter_context(
                LocalCluster(n_workers=workers, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0",
                             host="127.0.0.1", silence_logs=logging.ERROR, memory_limit=0)
            )  # fmt: skip
            client = stack.enter_context(Client(cluster, set_as_default=False))
            client.run(_ignore_interrupt)
            yield client
        finally:
            for name, value in old.items():
                if value is None:
                    os.environ.pop(name, None)
                else:
                    os.environ[name] = value
