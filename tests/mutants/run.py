"""Mutation test of the modules in `points.MODULES`: change one place, run the tests that mirror the module, see red.

    python tests/mutants/run.py --seed 1 --count 300 --workers 2
    python tests/mutants/run.py --all --module etc/rates --out rates.jsonl

Nothing is written into the checkout: the changes are made in copies of it. Every mutant is a fork of this process,
which has imported what the tests need of other packages and nothing of this project. Ends with status 1 if a mutant
survives that `equivalent.yaml` does not list, or if a listed one is killed (``--listed`` runs those too).
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import hashlib
import importlib
import json
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

# Before numpy: threads do not survive a fork, and compiled kernels are kept beside their copied source.
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")
os.environ.pop("NUMBA_CACHE_DIR", None)

from points import MODULES, ROOT, Point, equivalents, mirrors, population, sample

HEAVY = (
    "numpy",
    "scipy.stats",
    "scipy.optimize",
    "scipy.interpolate",
    "scipy.ndimage",
    "scipy.signal",
    "astropy.units",
    "astropy.io.fits",
    "astropy.coordinates",
    "astropy.table",
    "pandas",
    "pydantic",
    "yaml",
    "numba",
    "hcipy",
    "synphot",
    "photutils.aperture",
    "sep",
    "hypothesis",
    "hypothesis.extra.numpy",
    "mpmath",
    "pytest",
)
UNCOPIED = shutil.ignore_patterns(".*", "__pycache__", "out", "dist", "build", "*.egg-info")
MEMORY_BYTES = 8 << 30
Done = Callable[[Point, str, str, float], None]
SLACK_S, FACTOR = 10.0, 3.0  # time limit of a mutant: FACTOR times that of the unchanged tests, and SLACK_S


class Recorder:
    """Pytest plugin: the first test that fails; without an order, time and executed lines of every test instead."""

    def __init__(self, report: Path, traced: str, order: dict[str, int] | None):
        self.report, self.traced, self.order = report, traced, order
        self.test, self.by = "", ""
        self.seconds: Counter[str] = Counter()
        self.lines: dict[str, set[int]] = {}

    def pytest_configure(self) -> None:
        """Failing examples need not be made small."""
        from hypothesis import Phase, settings

        settings.register_profile("mutants", parent=settings.default, phases=[Phase.explicit, Phase.generate])
        settings.load_profile("mutants")

    def pytest_collection_modifyitems(self, items: list) -> None:
        """Tests that execute the changed line come first, the quickest of them at the head."""
        if self.order is None:
            sys.settrace(self._trace)
        else:
            items.sort(key=lambda item: self.order.get(item.nodeid, len(self.order)))

    def _trace(self, frame, event, argument):
        return self._line if frame.f_code.co_filename == self.traced else None

    def _line(self, frame, event, argument):
        self.lines.setdefault(self.test, set()).add(frame.f_lineno)
        return self._line

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self.test = nodeid

    def pytest_runtest_logreport(self, report) -> None:
        self.seconds[report.nodeid] += report.duration
        if report.failed:
            self.by = self.by or report.nodeid
            if self.order is not None:
                self._tell()
                os._exit(1)  # nobody needs the rest of the session

    def pytest_collectreport(self, report) -> None:
        if report.failed:
            self.by = self.by or f"{report.nodeid} (import)"

    def pytest_sessionfinish(self, exitstatus: int) -> None:
        sys.settrace(None)
        self._tell()
        if self.order is not None:
            os._exit(exitstatus)

    def _tell(self) -> None:
        heavy = [name for name in HEAVY if name in sys.modules]
        found = {
            "by": self.by,
            "heavy": heavy,
            "tests": {name: [seconds, sorted(self.lines.get(name, ()))] for name, seconds in self.seconds.items()},
        }
        self.report.write_text(json.dumps(found), encoding="utf-8")


@dataclass
class Child:
    """A pytest session in a process of its own."""

    pid: int
    started: float
    seen: float
    left_s: float
    slot: Path
    point: Point | None


def start(slot: Path, module: str, order: dict[str, int] | None, limit_s: float, point: Point | None = None) -> Child:
    """Fork a session of the tests that mirror a module, in the copy ``slot/tree``."""
    tree, report = slot / "tree", slot / "report.json"
    report.unlink(missing_ok=True)
    files = mirrors(module, tree)
    pid = os.fork()
    if pid:
        return Child(pid, time.monotonic(), time.monotonic(), limit_s, slot, point)
    status = 70
    try:
        os.setsid()
        log = os.open(slot / "log.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        for stream, target in ((os.open(os.devnull, os.O_RDONLY), 0), (log, 1), (log, 2)):
            os.dup2(stream, target)
        os.chdir(tree)
        sys.path[0] = str(tree)
        sys.dont_write_bytecode = order is not None
        os.environ.update(PYTHONPATH=str(tree), CPIC_CACHE_DIR=str(slot / "cache"), TMPDIR=str(slot))
        tempfile.tempdir = None
        if sys.dont_write_bytecode:
            os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, resource.RLIM_INFINITY))
        import pytest

        options = [
            "-q",
            "-p",
            "no:cacheprovider",
            "-p",
            "no:xdist",
            "-W",
            "ignore:Module already imported:pytest.PytestAssertRewriteWarning",
            f"--basetemp={slot / 'tmp'}",
        ]
        stop = [] if order is None else ["-x", "--tb=no"]
        status = int(pytest.main([*options, *stop, *files], [Recorder(report, str(tree / module), order)]))
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def stop(child: Child) -> None:
    """Kill a session with everything that it started."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child.pid, signal.SIGKILL)


def finished(child: Child) -> tuple[str, str] | None:
    """Status and killer of a session that has ended or run out of time."""
    pid, code = os.waitpid(child.pid, os.WNOHANG)
    if not pid:
        # Steps of at most a second: while both processes are suspended, no time counts.
        now = time.monotonic()
        child.left_s -= min(now - child.seen, 1.0)
        child.seen = now
        if child.left_s > 0:
            return None
        stop(child)
        os.waitpid(child.pid, 0)
        return "killed", f"{child.seen - child.started:.0f} s without an end"
    stop(child)  # what a failed test left running
    status = os.waitstatus_to_exitcode(code)
    report = child.slot / "report.json"
    by = json.loads(report.read_text(encoding="utf-8"))["by"] if report.exists() else ""
    if status in (5, 70):
        raise SystemExit(f"no test ran:\n{(child.slot / 'log.txt').read_text(encoding='utf-8')[-2000:]}")
    return ("survived", "") if status == 0 else ("killed", by or f"exit status {status}")


def unchanged(slot: Path, module: str) -> dict:
    """Time and executed lines of every test of the unchanged module; all must pass."""
    child = start(slot, module, None, 1800.0)
    try:
        while (found := finished(child)) is None:
            time.sleep(0.02)
    finally:
        stop(child)
    if found[0] == "killed":
        log = (slot / "log.txt").read_text(encoding="utf-8")
        raise SystemExit(f"{module}: its tests must pass before a mutant means anything ({found[1]})\n{log[-3000:]}")
    limit_s = FACTOR * (time.monotonic() - child.started) + SLACK_S
    report = json.loads((slot / "report.json").read_text(encoding="utf-8"))
    for name in report["heavy"]:
        importlib.import_module(name)
    gc.freeze()  # collections in the children pass over all this
    return {"tests": report["tests"], "limit_s": limit_s}


def order_for(point: Point, tests: dict) -> dict[str, int]:
    """Rank of every test: first those that execute the statement, then the others; by file, the quickest first."""
    touches = {
        name: any(point.lines[0] <= line <= point.lines[1] for line in lines) for name, (_, lines) in tests.items()
    }
    # File by file: fixtures of a module are made once.
    cost: Counter[str] = Counter()
    for name in tests:
        cost[name.partition("::")[0]] += tests[name][0] * touches[name]
    ranked = sorted(tests, key=lambda name: (not touches[name], cost[name.partition("::")[0]], tests[name][0]))
    return {name: rank for rank, name in enumerate(ranked)}


def run(points: list[Point], workers: int, work: Path, done: Done) -> None:
    """Run every mutant; ``done(point, status, by, seconds)`` takes the outcome."""
    first = work / "0"
    shutil.copytree(ROOT, first / "tree", ignore=UNCOPIED)
    (first / "cache").mkdir()
    sources, facts = {}, {}
    for module in dict.fromkeys(point.module for point in points):
        sources[module] = (first / "tree" / module).read_bytes()
        facts[module] = unchanged(first, module)
        say(f"{module}: {len(facts[module]['tests'])} tests pass unchanged")
    # No bytecode of the modules to be changed: it is only compared by size and second.
    for module in sources:
        file = first / "tree" / module
        for stale in (file.parent / "__pycache__").glob(f"{file.stem}.*.pyc"):
            stale.unlink()
    shutil.copytree(first / "cache", work / "cache")
    free = [first]
    for number in range(1, workers):
        shutil.copytree(first, work / str(number), ignore=shutil.ignore_patterns("tmp", "pytest-of-*"))
        free.append(work / str(number))
    queue, running = list(reversed(points)), []
    try:
        while queue or running:
            while queue and free:
                point, slot = queue.pop(), free.pop()
                file = slot / "tree" / point.module
                file.write_bytes(point.apply(sources[point.module]))
                # What a mutant computes wrongly must not be found by the next one. Entries are never changed in place.
                shutil.rmtree(slot / "cache")
                shutil.copytree(work / "cache", slot / "cache", copy_function=os.link)
                known = facts[point.module]
                running.append(start(slot, point.module, order_for(point, known["tests"]), known["limit_s"], point))
            time.sleep(0.01)
            for child in list(running):
                if (found := finished(child)) is not None:
                    running.remove(child)
                    free.append(child.slot)
                    (child.slot / "tree" / child.point.module).write_bytes(sources[child.point.module])
                    done(child.point, *found, time.monotonic() - child.started)
    finally:
        for child in running:
            stop(child)


def say(text: str) -> None:
    """Progress goes to standard error."""
    print(text, file=sys.stderr, flush=True)


def digest(module: str) -> str:
    """Changes with the module and the tests that mirror it: older results do not count."""
    parts = [(ROOT / file).read_bytes() for file in (module, *mirrors(module))]
    return hashlib.sha256(b"\0".join(parts)).hexdigest()[:16]


def shown(point: Point) -> str:
    """Place, line and change of a point, as `equivalent.yaml` names it."""
    again = f" (occurrence {point.occurrence})" if point.occurrence > 1 else ""
    return f"{point.module}:{point.row}: {point.function}: {point.change}{again}\n    {point.line}"


def table(points: list[Point], chosen: list[Point], outcome: dict[tuple, str]) -> str:
    """Counts of every module."""
    columns = ("points", "sampled", "killed", "equivalent", "survived")
    lines = [f"{'module':44}" + "".join(f"{name:>12}" for name in columns)]
    modules = list(dict.fromkeys(point.module for point in points))
    for module in [*modules, None]:
        ours = [outcome[point.name] for point in chosen if module in (None, point.module)]
        counts = (
            sum(module in (None, point.module) for point in points),
            len(ours),
            ours.count("killed"),
            ours.count("equivalent"),
            ours.count("survived"),
        )
        lines.append(f"{module or 'all':44}" + "".join(f"{count:12d}" for count in counts))
    return "\n".join(lines)


def modules_named(names: list[str] | None) -> list[str]:
    """Modules whose path ends with one of the names (without ``.py``)."""
    chosen = []
    for name in names or [""]:
        found = [module for module in MODULES if f"/{module}".endswith(f"/{name}.py" if name else "")]
        if not found:
            raise SystemExit(f"no module is named {name}; there are: {', '.join(MODULES)}")
        chosen += found
    return [module for module in MODULES if module in chosen]


def arguments() -> argparse.Namespace:
    """Options of the command."""
    parser = argparse.ArgumentParser(description="Change one place at a time and see whether a test fails.")
    parser.add_argument("--seed", type=int, default=1, help="seed of the sample (default: 1)")
    parser.add_argument("--count", type=int, default=300, help="number of mutants in the sample (default: 300)")
    parser.add_argument("--all", action="store_true", help="run every point instead of a sample")
    parser.add_argument("--workers", type=int, default=2, help="mutants that run at a time (default: 2)")
    parser.add_argument("--module", action="append", help="only this module, such as etc/rates; may be repeated")
    parser.add_argument("--listed", action="store_true", help="run the listed equivalents too: none may be killed")
    parser.add_argument(
        "--survivors-of", type=Path, metavar="FILE", help="only the survivors of such a file of results"
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="add results as JSON lines, and skip those it holds")
    return parser.parse_args()


def results(file: Path | None) -> dict[tuple, dict]:
    """Last result of every point in a file of results."""
    if file is None or not file.exists():
        return {}
    rows = map(json.loads, file.read_text(encoding="utf-8").splitlines())
    return {(row["module"], row["function"], row["line"], row["change"], row["occurrence"]): row for row in rows}


def main() -> int:
    """Sample, run, tell."""
    options = arguments()
    modules = modules_named(options.module)
    points = population(modules)
    chosen = points if options.all or options.survivors_of else sample(points, options.count, options.seed)
    if options.survivors_of:
        before = results(options.survivors_of)
        chosen = [point for point in chosen if before.get(point.name, {}).get("status") == "survived"]
    listed = dict(equivalents())
    digests = {module: digest(module) for module in modules}
    outcome = {
        name: row["status"] for name, row in results(options.out).items() if row["digest"] == digests.get(row["module"])
    }
    outcome |= {} if options.listed else dict.fromkeys(listed, "equivalent")
    todo = [point for point in chosen if point.name not in outcome]
    began, killers = time.monotonic(), {}

    def done(point: Point, status: str, by: str, seconds: float) -> None:
        outcome[point.name], killers[point.name] = status, by
        if status == "survived" and point.name not in listed:
            say(f"survived: {shown(point)}")
        if len(killers) % 25 == 0 or len(killers) == len(todo):
            say(f"{len(killers)} of {len(todo)} mutants, {time.monotonic() - began:.0f} s")
        if options.out:
            names = dict(zip(("module", "function", "line", "change", "occurrence"), point.name, strict=True))
            row = names | {"row": point.row, "status": status, "by": by, "seconds": round(seconds, 2)}
            with options.out.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(row | {"digest": digests[point.module]}) + "\n")

    say(f"{len(chosen)} of {len(points)} points, {len(todo)} to run")
    with tempfile.TemporaryDirectory(prefix="cpic-mutants-", ignore_cleanup_errors=True) as work:
        if todo:
            run(todo, options.workers, Path(work), done)
    wrong = [point for point in chosen if point.name in listed and outcome[point.name] == "killed"]
    for point in chosen:
        if point.name in listed and outcome[point.name] == "survived":
            outcome[point.name] = "equivalent"
    survivors = [point for point in chosen if outcome[point.name] == "survived"]
    print(table(points, chosen, outcome))
    for point in survivors:
        print(f"\nsurvived: {shown(point)}")
    for point in wrong:
        print(f"\nlisted as equivalent, but killed by {killers.get(point.name, 'a test')}: {shown(point)}")
    print(f"\n{len(survivors)} unexplained survivors of {len(chosen)} mutants, {time.monotonic() - began:.0f} s")
    return 1 if survivors or wrong else 0


if __name__ == "__main__":
    sys.exit(main())
