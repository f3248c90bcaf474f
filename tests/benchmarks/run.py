"""Time every job that README or a report quotes: ``python tests/benchmarks/run.py`` (``make bench-baseline``).

Writes ``baseline.json``; with ``--check`` (``make bench``) it writes nothing and fails where a job is slower than its
baseline.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
THREADS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")


def run(*more: str) -> int:
    """Run the benchmarks; lines go to the terminal."""
    command = [sys.executable, "-m", "pytest", "-q", "--benchmark-only", "--benchmark-quiet", "-rs"]
    command += ["-p", "no:cacheprovider", "--override-ini", "addopts=--import-mode=importlib", *more, str(HERE)]
    return subprocess.run(command, cwd=ROOT, env=os.environ | THREADS, check=False).returncode


def main() -> int:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="compare with the baseline and write nothing")
    return run(*([] if parser.parse_args().check else ["--write-baseline"]))


if __name__ == "__main__":
    sys.exit(main())
