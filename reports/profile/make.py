"""Regenerate this report: ``python reports/profile/make.py`` (about four minutes; needs the project's git history).

Where the time of the main commands goes, stage by stage, how far each stage is from the least that this machine could
do it in, and what parity (`simulator.imaging.pupil_symmetry`) and kept stamps changed. Both states of the project run
side by side, each on one thread in a process of its own, so that their ratio holds on a busy machine too.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import os
import platform
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from stages import JOBS, REST
from threadpoolctl import threadpool_limits

from cpic_core import write_text

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
BEFORE = "f62324f"  # the commit before the propagation was taken apart
THREADS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
MAIN = "cpic plan"
LEAST_SHARE = 0.005  # stages below are summed up

Result = dict[str, Any]


def machine() -> str:
    """Type of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{names[0]} ({platform.machine()})" if names else platform.machine()


def best_s(job: Callable[[], Any], rounds: int = 7) -> float:
    """Least processor time of a few runs: what the machine can do."""
    job()
    times = []
    for _ in range(rounds):
        began = time.process_time()
        job()
        times.append(time.process_time() - began)
    return min(times)


def rates() -> dict[str, float]:
    """What one thread of this machine does in a second: the floors."""
    rng = np.random.Generator(np.random.SFC64(1))
    n = 1024
    left, right, product = rng.random((n, n)), rng.random((n, n)), np.empty((n, n))
    long = [np.zeros(2**23) for _ in range(3)]
    draws = np.empty(2**21)
    words = np.arange(8, dtype=np.uint32)
    few = 2000

    def streams() -> None:
        for _ in range(few):
            np.random.Generator(np.random.SFC64(np.random.SeedSequence(words)))

    return {
        "flop": 2.0 * n**3 / best_s(lambda: np.matmul(left, right, out=product)),
        "bytes": 3.0 * long[0].nbytes / best_s(lambda: np.add(long[0], long[1], out=long[2])),
        "normals": draws.size / best_s(lambda: rng.standard_normal(out=draws)),
        "streams": few / best_s(streams),
    }


FLOORS = {
    "flop": "real products of matrices that parity leaves, at the rate of `numpy.matmul` on 1024 x 1024 doubles",
    "bytes": "bytes in and out once, at the bandwidth of `numpy.add` on 64 MB arrays",
    "normals": "as many normal variates (three a pixel of a frame: photons, register, read noise) from SFC64",
    "streams": "as many `SeedSequence`, `SFC64` and `Generator` objects",
}


def floor_s(stage: Result, speed: dict[str, float]) -> float | None:
    """Least time of a stage's work, None where none can be stated."""
    work = stage["work"]
    return sum(amount / speed[name] for name, amount in work.items()) if work else None


@contextmanager
def sources(before: str) -> Iterator[Path]:
    """The project as it was: a folder, or a commit of this repository."""
    if Path(before).is_dir():
        yield Path(before).resolve()
        return
    with tempfile.TemporaryDirectory() as folder:
        packed = subprocess.run(["git", "-C", str(ROOT), "archive", before], check=True, capture_output=True).stdout
        with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
            archive.extractall(folder, filter="data")
        yield Path(folder)


def run(job: str, root: Path) -> Result:
    """One job with the package of a folder."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "result.json"
        settings = os.environ | THREADS | {"PYTHONPATH": str(root)}
        subprocess.run([sys.executable, str(HERE / "stages.py"), job, str(out)], check=True, env=settings, cwd=folder)
        answer: Result = json.loads(out.read_text())
    print(f"{job}, {root}: {answer['cpu_s']:.2f} s of processor", flush=True)
    return answer


def measured(before: str, after: Path) -> dict[str, tuple[Result, Result]]:
    """Both states of every job, at the same time."""
    found = {}
    with sources(before) as old, ThreadPoolExecutor(2) as pool:
        for job in JOBS:
            first, second = pool.map(lambda root, job=job: run(job, root), (old, after))
            found[job] = first, second
    return found


def csv_text(results: dict[str, tuple[Result, Result]], speed: dict[str, float]) -> str:
    """All stages of all jobs."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["job", "state", "stage", "calls", "cpu_s", "share", "floor_s", "times_floor"])
    for job, pair in results.items():
        for state, result in zip(("before", "after"), pair, strict=True):
            for name, stage in by_time(result):
                least = floor_s(stage, speed)
                table.writerow(
                    [
                        job,
                        state,
                        name,
                        stage["calls"],
                        f"{stage['cpu_s']:.4g}",
                        f"{stage['cpu_s'] / result['cpu_s']:.4f}",
                        "" if not least else f"{least:.4g}",
                        "" if not least else f"{stage['cpu_s'] / least:.3g}",
                    ]
                )
    return text.getvalue()


def by_time(result: Result) -> list[tuple[str, Result]]:
    """Stages, longest first, what belongs to none of them last."""
    return sorted(result["stages"].items(), key=lambda item: (item[0] == REST, -item[1]["cpu_s"]))


def stage_table(pair: tuple[Result, Result], speed: dict[str, float]) -> str:
    """One job."""
    before, after = pair
    lines = [
        "| stage | calls | before (s) | after (s) | share after | floor (s) | times its floor |",
        "|---|---|---|---|---|---|---|",
    ]
    names = sorted({*before["stages"], *after["stages"]}, key=lambda name: (name == REST, -_cpu(before, name)))
    small = [0.0, 0.0]
    for name in names:
        times = _cpu(before, name), _cpu(after, name)
        if name != REST and max(times[0] / before["cpu_s"], times[1] / after["cpu_s"]) < LEAST_SHARE:
            small = [total + part for total, part in zip(small, times, strict=True)]
            continue
        stage = after["stages"].get(name, {"calls": 0, "work": {}})
        least = floor_s(stage, speed)
        ends = f"{least:.2g} | {times[1] / least:.1f}" if least else " | "
        lines.append(
            f"| {name} | {stage['calls'] or ''} | {times[0]:.2f} | {times[1]:.2f} | "
            f"{100 * times[1] / after['cpu_s']:.0f} % | {ends} |"
        )
    if any(small):
        lines.append(
            f"| stages below {100 * LEAST_SHARE:g} % | | {small[0]:.2f} | {small[1]:.2f} | "
            f"{100 * small[1] / after['cpu_s']:.0f} % | | |"
        )
    lines.append(f"| **all** | | **{before['cpu_s']:.2f}** | **{after['cpu_s']:.2f}** | 100 % | | |")
    return "\n".join(lines)


def _cpu(result: Result, name: str) -> float:
    stage = result["stages"].get(name)
    return float(stage["cpu_s"]) if stage else 0.0


def bars(pair: tuple[Result, Result], speed: dict[str, float]) -> Figure:
    """Stages of the plan before and after, and their floors."""
    before, after = pair
    names = [name for name, stage in by_time(before) if stage["cpu_s"] > 0.01 * before["cpu_s"]]
    figure = Figure(figsize=(8.0, 0.42 * len(names) + 1.2), layout="constrained")
    axes = figure.add_subplot()
    places = np.arange(len(names))[::-1]
    for shift, result, colour, label in ((0.2, before, "#b9c4d0", "before"), (-0.2, after, "#1f5f8b", "after")):
        axes.barh(places + shift, [_cpu(result, name) for name in names], 0.38, color=colour, label=label)
    floors = [floor_s(after["stages"].get(name, {"work": {}}), speed) for name in names]
    known = [(place, least) for place, least in zip(places, floors, strict=True) if least]
    if known:
        axes.plot(
            [least for _, least in known],
            [place - 0.2 for place, _ in known],
            "|",
            color="#d1495b",
            markersize=13,
            markeredgewidth=2.5,
            label="floor of this machine",
        )
    axes.set_yticks(places, names)
    axes.set_xlabel("processor time of one cpic plan (s)")
    axes.legend(loc="lower right", frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def report(results: dict[str, tuple[Result, Result]], speed: dict[str, float], before: str) -> str:
    """Everything that was found, as text."""
    plan = results[MAIN]
    stage = {name: (_cpu(plan[0], name), _cpu(plan[1], name)) for name in plan[1]["stages"]}
    fields = stage["propagation"]
    totals = "\n".join(
        f"| `{job}` | {old['cpu_s']:.2f} | {new['cpu_s']:.2f} | {old['cpu_s'] / new['cpu_s']:.2f} | "
        f"{old['wall_s'] / new['wall_s']:.2f} | {old['peak_bytes'] / 1e6:.0f} | {new['peak_bytes'] / 1e6:.0f} |"
        for job, (old, new) in results.items()
    )
    parts = "\n\n".join(f"## `{job}`\n\n{stage_table(pair, speed)}" for job, pair in results.items())
    what = "\n".join(f"- {text}: {speed[name]:.3g} a second" for name, text in FLOORS.items())
    state = f"commit {before}" if not Path(before).is_dir() else "a folder with other sources"
    return f"""# Where the time goes

Regenerate with `python reports/profile/make.py`; everything below is written by it.

{machine()}, one thread a process. Before is {state}.
Both states run at the same time. Times are processor time: on an idle machine that is the wall clock. Libraries are
loaded and kernels compiled beforehand. Time belongs to the innermost stage; a stage is timed from outside, by a
function put around it.

| command | before (s) | after (s) | times faster | by wall clock | peak before (MB) | peak after (MB) |
|---|---|---|---|---|---|---|
{totals}

Propagation in `{MAIN}` is {fields[0] / fields[1]:.1f} times faster than before: pupil and nodes are symmetric about
both axes, so that real matrices on a quarter of them do what complex ones on all of them did (on half of them for the
star off the mask). Nothing in it is approximated: images agree with the direct product to 1e-14 of the peak. Stamps and
transforms of the same optics are made once for all stars.

![processor time by stage](profile.png)

{parts}

The plan is the five best targets in four bands, the simulation 30 whole frames of `paper_example`, `etc` one star in
all bands, `rank` the whole catalogue.

## Floors

The least time in which this machine could do the work of a stage, by its measured rates:

{what}

They are lower bounds. A frame also has transfers, particles and bias, whose floor is not counted. Where a stage is many
small steps of different kinds (search, photometry, pictures, ranking) no floor is stated.
"""


def main() -> None:
    """Measure and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--before", default=BEFORE, help="commit, or folder with the sources, to compare with")
    parser.add_argument("--after", type=Path, default=ROOT, help="folder with the sources to measure")
    options = parser.parse_args()
    with threadpool_limits(1):
        speed = rates()
    results = measured(options.before, options.after.resolve())
    write_text(HERE / "results.csv", csv_text(results, speed))
    write_text(HERE / "report.md", report(results, speed, options.before))
    bars(results[MAIN], speed).savefig(HERE / "profile.png", format="png", dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main()
