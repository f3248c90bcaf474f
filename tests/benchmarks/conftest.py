"""What the benchmarks share: each is timed in turns with a workload of its kind and compared with the baseline.

``make bench`` runs them all and fails where one has become slower; ``make bench-baseline`` writes the baseline anew.
"""

from __future__ import annotations

import importlib.util
import json
import os
import platform
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

HERE = Path(__file__).resolve().parent
BASELINE = HERE / "baseline.json"


def _load(name: str) -> ModuleType:
    """Import a module that lies beside this file."""
    spec = importlib.util.spec_from_file_location(f"benchmark_{name}", HERE / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


JOBS = _load("jobs").JOBS
CLOCK = _load("workloads").Clock()


def pytest_addoption(parser):
    group = parser.getgroup("cpic")
    group.addoption("--write-baseline", action="store_true", help="keep these ratios instead of checking them")
    group.addoption("--results", type=Path, help="write what was measured to this JSON file")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    for item in items:
        if HERE in item.path.parents:
            item.add_marker(pytest.mark.benchmark(timer=CLOCK))


def machine() -> dict[str, str]:
    """Processor, versions and how busy it was, for those who read the baseline."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {
        "processor": names[0] if names else platform.processor() or "unknown",
        "architecture": platform.machine(),
        "cores": str(os.cpu_count()),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "load": f"{os.getloadavg()[1]:.1f}" if hasattr(os, "getloadavg") else "unknown",
    }


class Record:
    """What was measured so far, and the baseline that it is held against."""

    def __init__(self, config: pytest.Config) -> None:
        self.measured: dict[str, dict[str, object]] = {}
        self.writes = config.getoption("--write-baseline")
        self.baseline = json.loads(BASELINE.read_text()) if BASELINE.exists() else {"machine": {}, "jobs": {}}

    def verdict(self, name: str) -> tuple[float | None, bool]:
        """How many times its baseline a job is, and whether that is a regression; work of others never is."""
        known = self.baseline["jobs"].get(name)
        if known is None:
            return None, not self.writes
        times = self.measured[name]["ratio"] / known["ratio"]
        return times, times > JOBS[name].factor and not JOBS[name].ours and not self.writes

    def beside_ours(self, name: str) -> float | None:
        """How many times longer than our job of the same result another's takes, where both were run."""
        other, ours = self.measured[name], self.measured.get(JOBS[name].ours)
        if ours is None:
            return None
        measure = "ratio" if other["like"] == ours["like"] else "seconds"
        return other[measure] / ours[measure]


RECORD = pytest.StashKey[Record]()


def pytest_configure(config):
    config.stash[RECORD] = Record(config)


@pytest.fixture(scope="session")
def references():
    """The workloads, warm."""
    made = sys.modules["benchmark_workloads"].workloads()
    for work in made.values():
        work()
    return made


@pytest.fixture
def clock():
    """The clock of the benchmarks: processes that report their own time add to it."""
    return CLOCK


@pytest.fixture
def timed(benchmark, references, request):
    """Function that runs a named job in turns with its workload, keeps the ratio, and fails on a regression.

    The ratio is that of the medians. One that would be a regression is measured once more: what else the machine does
    comes and goes.
    """
    record = request.config.stash[RECORD]

    def once(name, function, rounds, repeats):
        work, spent = references[JOBS[name].like], []

        def workload():
            began = CLOCK()
            work()
            spent.append(CLOCK() - began)

        def job():
            for _ in range(repeats - 1):
                function()
            return function()

        return workload, job, spent

    def run(name, function, *, rounds=7, repeats=1):
        job_of = JOBS[name]  # a job that is not listed is not compared with anything
        workload, job, spent = once(name, function, rounds, repeats)
        answer = benchmark.pedantic(job, setup=workload, rounds=rounds, warmup_rounds=int(rounds > 1))
        workload()
        taken = [seconds / repeats for seconds in benchmark.stats.stats.data]
        _keep(record, name, taken, spent)
        if record.verdict(name)[1] and not job_of.ours and name in record.baseline["jobs"]:
            first = record.measured[name]
            workload, job, spent = once(name, function, rounds, repeats)
            taken = []
            for _ in range(rounds):
                workload()
                began = CLOCK()
                job()
                taken.append((CLOCK() - began) / repeats)
            _keep(record, name, taken, spent)
            if first["ratio"] < record.measured[name]["ratio"]:
                record.measured[name] = first
        beside = record.beside_ours(name)
        assert beside is None or beside > job_of.at_least, f"{name}: {beside:.1f} times ours"
        times, slower = record.verdict(name)
        if times is None:
            assert not slower, f"{name}: not in baseline.json; run `make bench-baseline`"
        else:
            assert not slower, f"{name}: {times:.2f} times its baseline, at most {job_of.factor:g} allowed"
        return answer

    return run


def _keep(record: Record, name: str, taken: list[float], spent: list[float]) -> None:
    """Keep the median time, its ratio to the workload's, and the spread of both: half the range of the middle half."""
    unit = float(np.median(spent))
    low, middle, high = np.percentile(taken, [25.0, 50.0, 75.0])
    unit_low, unit_high = np.percentile(spent, [25.0, 75.0])
    spread = 0.5 * ((high - low) / middle + (unit_high - unit_low) / unit)
    record.measured[name] = {
        "like": JOBS[name].like,
        "seconds": float(f"{middle:.4g}"),
        "ratio": float(f"{middle / unit:.4g}"),
        "spread": float(f"{spread:.2g}"),
        "rounds": len(taken),
    }


def pytest_terminal_summary(terminalreporter, config):
    record = config.stash[RECORD]
    if not record.measured:
        return
    line = terminalreporter.write_line
    line("")
    line(f"{'job':58s} {'seconds':>9s} {'ratio to':>16s} {'spread':>7s} {'baseline':>9s} {'times':>6s}  beside ours")
    for name, one in record.measured.items():
        known = record.baseline["jobs"].get(name)
        times, slower = record.verdict(name)
        beside = record.beside_ours(name)
        times_longer = f"{beside:.1f} x" if beside else ""
        line(
            f"{name:58s} {one['seconds']:9.4f} {one['ratio']:9.3g} {one['like']:6s} {100 * one['spread']:5.0f} %"
            f" {known['ratio'] if known else float('nan'):9.3g} {times or float('nan'):6.2f}  {times_longer}"
            f"{'  SLOWER' if slower else ''}"
        )


def pytest_sessionfinish(session):
    record = session.config.stash[RECORD]
    if not record.measured:
        return
    found = {"machine": machine(), "jobs": dict(record.measured)}
    results = session.config.getoption("--results")
    if results is not None:
        results.write_text(json.dumps(found, indent=1) + "\n")
    if record.writes:
        # What was not run this time, such as work of packages that are not installed, keeps its last figures.
        jobs = {name: (record.baseline["jobs"] | record.measured).get(name) for name in JOBS}
        found["jobs"] = {name: one for name, one in jobs.items() if one is not None}
        BASELINE.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n")
