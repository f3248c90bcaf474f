"""What a worker process of this machine runs: ``python -m cpic_planner.cluster.worker PARENT ARGUMENT...``."""

from __future__ import annotations

import os
import sys
import threading
import time

_WATCH_S = 0.5


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_WATCH_S)
    os._exit(1)


def main(arguments: list[str]) -> None:
    """Run Dask's worker with the arguments after the first, and end, busy or not, when process ``PARENT`` has gone."""
    threading.Thread(target=_watch, args=(int(arguments[0]),), name="parent", daemon=True).start()
    from distributed.cli.dask_worker import main as worker

    worker(arguments[1:])


if __name__ == "__main__":
    main(sys.argv[1:])
