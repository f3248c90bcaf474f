"""Parts of the tests: together all of them, none twice."""

import subprocess
import sys
from pathlib import Path

import pytest

TESTS = """\
import pytest

@pytest.mark.long
@pytest.mark.parametrize("x", range(7))
def test_long(x):
    assert x < 7

def test_short():
    raise AssertionError
"""


def collected(folder, *options):
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "--collect-only",
        "-p",
        "tools.part",
        "-p",
        "no:cacheprovider",
        *options,
    ]
    ran = subprocess.run(command, cwd=folder, capture_output=True, text=True, env=None, check=False)
    return ran, [line for line in ran.stdout.splitlines() if "::" in line]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).resolve().parents[2]))
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = long: takes minutes\n", encoding="utf-8")
    (tmp_path / "test_parts.py").write_text(TESTS, encoding="utf-8")
    return tmp_path


def test_parts_hold_together_every_long_test_once(folder):
    parts = [collected(folder, "-m", "long", "--part", f"{k}/3")[1] for k in range(3)]
    assert sorted(name for part in parts for name in part) == [f"test_parts.py::test_long[{x}]" for x in range(7)]
    assert sorted(map(len, parts)) == [2, 2, 3]


def test_without_a_part_all_run(folder):
    assert len(collected(folder, "-m", "long")[1]) == 7


@pytest.mark.parametrize("part", ["3/3", "-1/3"])
def test_a_part_that_is_not_there_is_refused(folder, part):
    ran, _ = collected(folder, f"--part={part}")
    assert ran.returncode == pytest.ExitCode.USAGE_ERROR
    assert f"--part {part}: not accepted; allowed: K/N with K from 0 to N - 1" in ran.stderr + ran.stdout
