"""Every figure of speed that a text quotes has a benchmark, and every benchmark a baseline; nothing is timed here."""

import importlib.util
import json
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "tests" / "benchmarks"
PEERS = ("HCIPy", "pyKLIP")


@pytest.fixture(scope="module")
def jobs():
    spec = importlib.util.spec_from_file_location("house_benchmark_jobs", FOLDER / "jobs.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module.JOBS


@pytest.fixture(scope="module")
def baseline():
    return json.loads((FOLDER / "baseline.json").read_text(encoding="utf-8"))


def test_the_baseline_covers_every_job(jobs, baseline):
    missing = [name for name in jobs if name not in baseline["jobs"]]
    # Other packages need not be installed where a baseline is made.
    assert [name for name in missing if not name.partition(": peer ")[2]] == []
    assert set(baseline["jobs"]) <= set(jobs)
    assert set(baseline["machine"]) == {"processor", "architecture", "cores", "python", "numpy", "load"}
    for name, one in baseline["jobs"].items():
        assert one["like"] == jobs[name].like
        assert one["ratio"] > 0
        assert one["seconds"] > 0
        assert 0 <= one["spread"] < 1


def test_every_quoted_figure_is_found_once(jobs):
    texts = {}
    for name, job in jobs.items():
        assert job.factor > 1
        assert not job.ours or job.ours in jobs, name
        for quote in job.quotes:
            text = texts.setdefault(quote.file, (ROOT / quote.file).read_text(encoding="utf-8"))
            found = re.findall(quote.pattern, text)
            assert len(found) == 1, f"{name}: {quote.pattern} is in {quote.file} {len(found)} times"
            assert float(found[0]) > 0


def test_others_are_named_as_such(jobs):
    peers = {name.rpartition(": peer ")[2].split(":")[0] for name in jobs if ": peer " in name}
    assert peers == set(PEERS)
