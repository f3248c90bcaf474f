"""The command as users run it: how long, how much memory, and what happens when its processes are killed."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
from chaos import random_kills, worker_pids

COMMAND = (sys.executable, "-m", "cpic_planner.cli.main", "whatif", "survey_default")
UNIVERSES, WORKERS = 1000, 2


@contextlib.contextmanager
def peak_memory_mb(pid: int) -> Iterator[list[float]]:
    """Largest resident memory of a process and all below it, sampled twenty times a second."""
    peak, stop = [0.0], threading.Event()

    def work() -> None:
        while not stop.wait(0.05):
            total = 0
            with contextlib.suppress(psutil.Error):
                parent = psutil.Process(pid)
                for process in (parent, *parent.children(recursive=True)):
                    with contextlib.suppress(psutil.Error):
                        total += process.memory_info().rss
            peak[0] = max(peak[0], total / 1e6)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        yield peak
    finally:
        stop.set()
        thread.join()


def default_run(out: Path) -> dict[str, Any]:
    """The command as a user types it, with images: processor time of all its processes and memory."""
    command = [*COMMAND, "--universes", str(UNIVERSES), "--workers", str(WORKERS), "--out", str(out), "--json"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    with peak_memory_mb(process.pid) as peak:
        _, ended, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(ended)
    return {
        "status": process.returncode,
        "processor_s": usage.ru_utime + usage.ru_stime,
        "peak_mb": peak[0],
        "universes": UNIVERSES,
    }


def digests(folder: Path) -> dict[str, str]:
    """Checksums of the tables of a run."""
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest()[:16] for path in sorted(folder.glob("*.parquet"))}


def kills(seed: int = 3) -> dict[str, Any]:
    """The same run undisturbed, with workers killed at random, and with the client killed and started again."""
    with tempfile.TemporaryDirectory() as name:
        base = Path(name)
        quiet, disturbed, resumed = (base / part for part in ("quiet", "disturbed", "resumed"))
        more = ["--images", "0", "--no-facts", "--universes", str(2 * UNIVERSES), "--workers", str(WORKERS), "--json"]

        def start(out: Path) -> subprocess.Popen[bytes]:
            return subprocess.Popen(
                [*COMMAND, *more, "--out", str(out)], stdout=subprocess.DEVNULL, start_new_session=True
            )

        began = time.perf_counter()
        start(quiet).wait()
        wall = time.perf_counter() - began
        process = start(disturbed)
        with random_kills(lambda: worker_pids(process.pid), seed=seed, every_s=5.0) as done:
            status = process.wait()
        process = start(resumed)
        half = json.loads((quiet / "run.json").read_text())["computed_parts"] // 2
        while len(list(resumed.glob("parts/*"))) < half and process.poll() is None:
            time.sleep(0.1)
        with contextlib.suppress(ProcessLookupError):  # it has ended: nothing will be left to make
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        left = len(list(resumed.glob("parts/*")))
        again = start(resumed).wait()
        story = json.loads((resumed / "run.json").read_text())
        return {
            "quiet": digests(quiet),
            "disturbed": digests(disturbed),
            "resumed": digests(resumed),
            "worker_kills": len(done.pids),
            "parts": story["resumed_parts"] + story["computed_parts"],
            "kept_parts": story["resumed_parts"],
            "parts_at_kill": left,
            "quiet_s": wall,
            "status": [status, again],
        }
