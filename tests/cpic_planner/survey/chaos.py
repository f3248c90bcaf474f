"""Kill worker processes at random while a run goes on, to see that its results do not change."""

import contextlib
import os
import signal
import threading

import numpy as np
import psutil


def worker_pids():
    """Local workers of this process that live now."""
    found = []
    for child in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.Error):
            if "cpic_planner.jobs.worker" in child.cmdline():
                found.append(child.pid)
    return sorted(found)


@contextlib.contextmanager
def random_kills(pids, seed, every_s):
    """Send SIGKILL to one process of ``pids()`` after random waits of so many s in the mean; give those killed."""
    rng, done, stop = np.random.default_rng(seed), [], threading.Event()

    def work():
        while not stop.wait(rng.exponential(every_s)):
            for chosen in rng.permutation(pids())[:1].tolist():
                with contextlib.suppress(ProcessLookupError):
                    os.kill(chosen, signal.SIGKILL)
                    done.append(chosen)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        yield done
    finally:
        stop.set()
        thread.join()
