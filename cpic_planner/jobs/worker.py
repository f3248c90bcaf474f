"""The worker process of this machine: ``python -m cpic_planner.jobs.worker PARENT SCRATCH ARGUMENT...``."""

import os
import shutil
import sys
import threading
import time

_WATCH_S = 0.5


def end_with(parent: int, scratch: str = "") -> None:
    """End this process, busy or not, when its parent has gone.

    Parameters
    ----------
    parent : int
        Process id.
    scratch : str
        Folder that is removed then; empty for none.
    """
    threading.Thread(target=_watch, args=(parent, scratch), name="parent", daemon=True).start()


def _watch(parent: int, scratch: str) -> None:
    while os.getppid() == parent:
        time.sleep(_WATCH_S)
    if scratch:
        shutil.rmtree(scratch, ignore_errors=True)
    os._exit(1)


def main(arguments: list[str]) -> None:
    """Run Dask's worker with ``ARGUMENT...``; when process ``PARENT`` has gone, busy or not, end and leave nothing."""
    parent, scratch, *options = arguments
    end_with(int(parent), scratch)
    from distributed.cli.dask_worker import main as worker

    worker([*options, "--local-directory", scratch])


if __name__ == "__main__":
    main(sys.argv[1:])
