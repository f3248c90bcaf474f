"""Show how long commands take beside the parent of a change: ``python -m tools.pace [PARENT]``; 1 where one is slower.

Both trees run in turns, with caches of their own, and what counts is the processor time of whole processes: medians. A
command that seems slower than `ALLOWED` is measured once more, in more rounds: the machine has other things to do.
"""

from __future__ import annotations

import io
import os
import statistics
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ALLOWED = 1.2
ROUNDS = 3
CPIC = ("-m", "cpic_planner.cli.main")
WARM = "import cpic_planner as cpic\nfor place in range({times}): cpic.{ask}, separation_arcsec=0.42 + place * 1e-3)"
COMMANDS = {
    "cpic --help": (*CPIC, "--help"),
    "cpic etc": (*CPIC, "etc", "tau Cet", "--detect", "--separation-arcsec", "0.45"),
    "cpic rank": (*CPIC, "rank"),
    "50 x exposure_time": ("-c", WARM.format(times=50, ask='exposure_time("tau Cet", snr=10')),
    "30 x detection": ("-c", WARM.format(times=30, ask='exposure_time("tau Cet", detect=True')),
    "50 x contrast_limit": ("-c", WARM.format(times=50, ask='contrast_limit("tau Cet", time_s=36e3')),
}


class Tree:
    """A tree of the project, with a folder for its caches and for what its commands write."""

    def __init__(self, root: Path, folder: Path) -> None:
        self.folder = folder
        caches = {"CPIC_CACHE_DIR": str(folder / "cache"), "NUMBA_CACHE_DIR": str(folder / "numba")}
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
        self.environment = os.environ | caches | threads | {"PYTHONPATH": str(root)}
        self.environment.pop("PYTHONDONTWRITEBYTECODE", None)
        folder.mkdir()

    def cpu_s(self, command: tuple[str, ...]) -> float:
        """Run a command and return its processor time."""
        if not hasattr(os, "wait4"):
            raise SystemExit("this system does not say what a process has taken")
        said = self.folder / "said.txt"
        with said.open("wb") as errors:
            process = subprocess.Popen(
                (sys.executable, *command),
                cwd=self.folder,
                env=self.environment,
                stdout=subprocess.DEVNULL,
                stderr=errors,
            )
            _, status, used = os.wait4(process.pid, 0)
        process.returncode = status  # it is waited for
        if status:
            raise SystemExit(f"{' '.join(command)} failed:\n{said.read_text(encoding='utf-8')[-2000:]}")
        return used.ru_utime + used.ru_stime


def ratio(before: Tree, now: Tree, command: tuple[str, ...], rounds: int) -> tuple[float, float]:
    """Return the medians of the processor time of a command in two trees, in turns, after one run of each."""
    times = [(before.cpu_s(command), now.cpu_s(command)) for _ in range(rounds + 1)][1:]
    old, new = (statistics.median(each) for each in zip(*times, strict=True))
    return old, new


def main(words: list[str]) -> int:
    """Print the times of both, and return 1 where a command is slower than its parent's."""
    parent = words[0] if words else "HEAD~1"
    archive = subprocess.run(["git", "archive", parent], cwd=ROOT, capture_output=True, check=True).stdout
    slower = False
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with tarfile.open(fileobj=io.BytesIO(archive)) as files:
            files.extractall(folder / "parent", filter="data")
        before, now = Tree(folder / "parent", folder / "before"), Tree(ROOT, folder / "now")
        print(f"processor seconds, {parent} -> here; load {os.getloadavg()[0]:.1f}")
        for what, command in COMMANDS.items():
            old, new = ratio(before, now, command, ROUNDS)
            if new > ALLOWED * old:
                old, new = ratio(before, now, command, 3 * ROUNDS)
            slower |= new > ALLOWED * old
            print(f"  {what:28}{old:7.2f}  ->{new:7.2f}   x {new / old:.2f}{'  SLOWER' if new > ALLOWED * old else ''}")
    return int(slower)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
