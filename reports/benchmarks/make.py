"""Time every job that README or a report quotes, keep the baseline, and write this report.

``python reports/benchmarks/make.py`` (``make bench-baseline``) writes ``tests/benchmarks/baseline.json`` and
``report.md``; with ``--check`` (``make bench``) it writes nothing and fails where a job is slower than its baseline;
with ``--again`` it writes the report from the baseline that is there.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
BENCHMARKS = ROOT / "tests" / "benchmarks"
BASELINE = BENCHMARKS / "baseline.json"
REPORT = Path(__file__).with_name("report.md")
THREADS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
WORDS = {
    "copy": "copying 2048 x 2048 numbers three times",
    "draws": "800 000 normal and 200 000 Poisson numbers of PCG64",
    "fft": "a complex transform of 1024 x 1024",
    "dgemm": "a product of 640 x 640 matrices",
    "python": "60 000 turns of a loop over a dictionary",
}


def jobs_module() -> ModuleType:
    """Return the list of jobs."""
    spec = importlib.util.spec_from_file_location("benchmark_jobs", BENCHMARKS / "jobs.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def run(*more: str) -> int:
    """Run the benchmarks; lines go to the terminal."""
    command = [sys.executable, "-m", "pytest", "-q", "--benchmark-only", "--benchmark-quiet", "-rs"]
    command += ["-p", "no:cacheprovider", "--override-ini", "addopts=--import-mode=importlib", *more, str(BENCHMARKS)]
    return subprocess.run(command, cwd=ROOT, env=os.environ | THREADS, check=False).returncode


def number(value: float) -> str:
    """Three digits, without an exponent where people use none."""
    return f"{value:.3g}" if 1e-4 <= abs(value) < 1e4 or value == 0 else f"{value:.2e}"


def beside(found: dict[str, Any], other: str, ours: str) -> float:
    """How many times longer than ours another's job takes."""
    measure = "ratio" if found[other]["like"] == found[ours]["like"] else "seconds"
    return float(found[other][measure] / found[ours][measure])


def quoted_rows(jobs: dict[str, Any], found: dict[str, Any]) -> list[str]:
    """One row for each figure that a text quotes."""
    rows = []
    for name, job in jobs.items():
        one, ours = found.get(name), found.get(job.ours)
        for quote in job.quotes:
            (text,) = re.findall(quote.pattern, (ROOT / quote.file).read_text(encoding="utf-8"))
            if one is None or (quote.unit_s == 0 and ours is None):
                here = "not run"
            elif quote.unit_s == 0:
                here = f"{beside(found, name, job.ours):.1f} x"
            else:
                here = f"{number(one['seconds'])} s"
            said = f"{text} x" if quote.unit_s == 0 else f"{number(float(text) * quote.unit_s)} s"
            rows.append(f"| {said} | `{quote.file}` | {name} | {here} |")
    return rows


def job_rows(jobs: dict[str, Any], found: dict[str, Any]) -> list[str]:
    """One row for each job."""
    rows = []
    for name, job in jobs.items():
        one = found.get(name)
        if one is None:
            rows.append(f"| {name} | not run: its package is not installed | | | | | |")
            continue
        peers = [other for other, peer in jobs.items() if peer.ours == name and other in found]
        others = "; ".join(f"{other.rpartition('peer ')[2]}: {beside(found, other, name):.1f}" for other in peers)
        limit = "" if job.ours else f"{job.factor:g}"
        rows.append(
            f"| {name} | {number(one['seconds'])} | {one['like']} | {number(one['ratio'])} | "
            f"{100 * one['spread']:.0f} % | {limit} | {others} |"
        )
    return rows


def report(baseline: dict[str, Any]) -> str:
    """Return the text of the report."""
    jobs, machine = jobs_module().JOBS, baseline["machine"]
    found = baseline["jobs"]
    kinds = "\n".join(f"- `{kind}`: {words}" for kind, words in WORDS.items())
    return f"""# What the quoted times stand on

Regenerate with `make bench-baseline`; everything below is written by it. `make bench` measures again and compares.

{machine["processor"]} ({machine["architecture"]}, {machine["cores"]} cores), Python {machine["python"]}, numpy \
{machine["numpy"]}; load average {machine["load"]}. Processor time of one thread, processes that are started
included: the wall clock of an idle machine. On a busy one (load above the number of cores) times are too long, ratios
less so.

A time belongs to its machine. Every job therefore runs in turns with a workload of its own kind in the same process,
and what is kept and compared is the **ratio** of the medians:

{kinds}

`make bench` fails where the ratio of one of our jobs exceeds its baseline by more than the factor of its row, twice in
succession. Other packages' times are shown beside ours, never judged.

## Figures that texts quote

Quoted figures were measured when their text was written, on a quiet machine; the column on the right is this run.

| quoted | where | job | here |
|---|---|---|---|
{chr(10).join(quoted_rows(jobs, found))}

## Jobs

| job | seconds | kind | ratio | spread | regression above | others, times longer |
|---|---|---|---|---|---|---|
{chr(10).join(job_rows(jobs, found))}

Spread: half the width of the middle half of the rounds, of job and workload together.

Not timed here: the hours behind whole reports (`reports/blind_validator`), and a plan of five targets in four bands on
two cores, of which one target in one band is.
"""


def main() -> int:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--check", action="store_true", help="compare with the baseline and write nothing")
    how.add_argument("--again", action="store_true", help="write the report from the baseline that is there")
    asked = parser.parse_args()
    if asked.check:
        return run()
    failed = 0 if asked.again else run("--write-baseline")
    if not failed:
        REPORT.write_text(report(json.loads(BASELINE.read_text(encoding="utf-8"))), encoding="utf-8")
    return failed


if __name__ == "__main__":
    sys.exit(main())
