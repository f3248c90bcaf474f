"""Long runs whose open files and memory do not grow with what they do: ``python tests/faults/flat.py`` (``make flat``).

Simulations of 50 and of 1000 whole frames (7 GB), surveys of 500 and of 5000 universes, each in a process of its own,
without workers, whose sockets come and go. It is looked at a hundred times a second; files count where so many were
open for a tenth of a second in all, which the import of a module is not. Ends with status 1 where the larger one has
more files open at most, or a tenth more memory.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import harness

RUNS = {
    "whatif": ("whatif w.yaml --images 0 --workers 1 --universes", 500, 5000),
    "simulate": ("simulate paper_example --band F520 --exposure-s 17 --em-gain 20 --fidelity quick --frames", 50, 1000),
}
_PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 1e6
EVERY_S, LASTS = 0.01, 10


def looked_at(pid):
    """Open files and memory (MB) of a process; nothing when it has ended."""
    try:
        files = len(os.listdir(f"/proc/{pid}/fd"))
        return files, int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * _PAGE_MB
    except OSError:
        return 0, 0.0


def most(words, number):
    """Run a command in a folder of its own; returns the most open files that last, and most memory (MB)."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "w.yaml").write_text(harness.FILES["w.yaml"])
        argv = [*words.split(), str(number), "--out", "run", "-q"]
        run = [sys.executable, "-m", "cpic_planner.cli.main", *argv]
        process = subprocess.Popen(run, cwd=folder, stdout=subprocess.DEVNULL)
        seen, memory_mb = [], 0.0
        while process.poll() is None:
            files, now_mb = looked_at(process.pid)
            seen.append(files)
            memory_mb = max(memory_mb, now_mb)
            time.sleep(EVERY_S)
    assert process.returncode == 0
    return sorted(seen)[-LASTS], memory_mb


def main(names):
    bad = 0
    for name in names or RUNS:
        words, few, many = RUNS[name]
        small, large = most(words, few), most(words, many)
        bad += large[0] > small[0] or large[1] > 1.1 * small[1]
        print(
            f"{name}: {few} | {many}: at most {small[0]} | {large[0]} open files, {small[1]:.0f} | {large[1]:.0f} MB",
            flush=True,
        )
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
