"""Parts of the tests: together all of them, none twice."""

import json
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
# All in one process: to start it takes longer than to collect.
COLLECT = """\
import contextlib, io, json, sys, pytest
def collected(words):
    with contextlib.redirect_stdout(io.StringIO()) as told, contextlib.redirect_stderr(told):
        status = pytest.main(["-q", "--collect-only", "-p", "tools.part", "-p", "no:cacheprovider", *words])
    return int(status), told.getvalue()
print(json.dumps([collected(words) for words in json.loads(sys.argv[1])]))
"""


@pytest.fixture(scope="module")
def collected(tmp_path_factory):
    """Status and output with the options of each part."""
    folder = tmp_path_factory.mktemp("parts")
    (folder / "pytest.ini").write_text("[pytest]\nmarkers = long: takes minutes\n", encoding="utf-8")
    (folder / "test_parts.py").write_text(TESTS, encoding="utf-8")
    asked = [["-m", "long"], *(["-m", "long", f"--part={part}"] for part in ("0/3", "1/3", "2/3", "3/3", "-1/3"))]
    command = [sys.executable, "-c", COLLECT, json.dumps(asked)]
    where = {"cwd": folder, "env": {"PYTHONPATH": str(Path(__file__).resolve().parents[2])}}
    told = json.loads(subprocess.run(command, capture_output=True, text=True, check=True, **where).stdout)
    return {words[-1].removeprefix("--part="): answer for words, answer in zip(asked, told, strict=True)}


def names(told):
    return [line for line in told[1].splitlines() if "::" in line]


def test_parts_hold_together_every_long_test_once(collected):
    parts = [names(collected[f"{k}/3"]) for k in range(3)]
    assert sorted(name for part in parts for name in part) == [f"test_parts.py::test_long[{x}]" for x in range(7)]
    assert sorted(map(len, parts)) == [2, 2, 3]


def test_without_a_part_all_run(collected):
    assert len(names(collected["long"])) == 7


@pytest.mark.parametrize("part", ["3/3", "-1/3"])
def test_a_part_that_is_not_there_is_refused(collected, part):
    status, told = collected[part]
    assert status == pytest.ExitCode.USAGE_ERROR
    assert f"--part {part}: not accepted; allowed: K/N with K from 0 to N - 1" in told
