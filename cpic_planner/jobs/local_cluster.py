"""A Dask cluster on this machine: the scheduler in this process, workers below it that are replaced when they die."""

import contextlib
import logging
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from typing import Any

import dask
from distributed import LocalCluster

from cpic_core import THREAD_VARIABLES
from cpic_planner.jobs.engine import ClusterError

_LOG = logging.getLogger(__name__)
_REGISTER_S = 120  # for a worker to find the scheduler
_VAIN = 8  # workers in the place of each one, without a result meanwhile


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
