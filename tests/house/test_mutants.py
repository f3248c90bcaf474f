"""Mutation points of `make mutants`: right places, names that last, a seeded sample, and equivalents with a reason."""

import ast
import importlib.util
import re
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCE = '''\
"""Text 1 + 1."""

__all__ = ["law"]
WIDTH: "2 + 2" = 3


@cache(maxsize=8)
def law(x: int | None, *, scale: float = 2.0) -> list[1]:
    """Add 1 to x."""
    assert x > 0
    if x is None or not (0 < x):
        raise ValueError(f"{x + 1}", 5 * x)
    y = (x) + (  # µ: a comment - with an operator
        -scale
    )
    y **= 1_000
    return zip(y ** (x - 1) * 0.0, x not in y, True, strict=True), "é" * 2, 1j @ x
'''
CHANGED = {
    'WIDTH: "2 + 2" = 4',
    "def law(x: int | None, *, scale: float = 4.0) -> list[1]:",
    "if x is not None or not (0 < x):",
    "if x is None and not (0 < x):",
    "if x is None or  (0 < x):",
    "if x is None or not (0 <= x):",
    "if x is None or not (0 > x):",
    "if x is None or not (1 < x):",
    "y = (x) - (  # µ: a comment - with an operator",
    "scale",
    "y *= 1_000",
    "y **= 1001",
    'return zip((y * (x - 1)) * 0.0, x not in y, True, strict=True), "é" * 2, 1j @ x',
    'return zip(y ** (x + 1) * 0.0, x not in y, True, strict=True), "é" * 2, 1j @ x',
    'return zip(y ** (x - 2) * 0.0, x not in y, True, strict=True), "é" * 2, 1j @ x',
    'return zip(y ** (x - 1) / 0.0, x not in y, True, strict=True), "é" * 2, 1j @ x',
    'return zip(y ** (x - 1) * 1.0, x not in y, True, strict=True), "é" * 2, 1j @ x',
    'return zip(y ** (x - 1) * 0.0, x in y, True, strict=True), "é" * 2, 1j @ x',
    'return zip(y ** (x - 1) * 0.0, x not in y, False, strict=True), "é" * 2, 1j @ x',
    'return zip(y ** (x - 1) * 0.0, x not in y, True, strict=True), "é" / 2, 1j @ x',
    'return zip(y ** (x - 1) * 0.0, x not in y, True, strict=True), "é" * 3, 1j @ x',
    'return zip(y ** (x - 1) * 0.0, x not in y, True, strict=True), "é" * 2, 2j @ x',
}


@pytest.fixture(scope="module")
def points():
    spec = importlib.util.spec_from_file_location("house_points", ROOT / "tests" / "mutants" / "points.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def population(points):
    return points.population()


def test_a_mutant_differs_in_one_line_and_nothing_unseen_is_changed(points):
    found = points.points_of("law.py", SOURCE.encode())
    before = SOURCE.splitlines()
    lines = []
    for point in found:
        after = point.apply(SOURCE.encode()).decode()
        ast.parse(after)
        changed = [row for row, pair in enumerate(zip(before, after.splitlines(), strict=True), 1) if len({*pair}) > 1]
        assert changed == [point.row]
        assert before[point.row - 1].strip() == point.line
        assert point.lines[0] <= point.row <= point.lines[1]
        lines.append(after.splitlines()[point.row - 1].strip())
    assert set(lines) == CHANGED
    assert len(lines) == len(CHANGED)


def test_every_point_of_the_modules_is_another_program(points, population):
    assert Counter(point.name for point in population).most_common(1)[0][1] == 1
    assert {point.module for point in population} == set(points.MODULES)
    assert len(population) > 1000
    for point in points.sample(population, 40, seed=3):
        source = (ROOT / point.module).read_bytes()
        assert ast.dump(ast.parse(point.apply(source))) != ast.dump(ast.parse(source)), point.name


def test_equivalents_name_one_point_each_and_say_why(points, population):
    listed = list(points.equivalents())
    names = {point.name for point in population}
    assert [name for name, _ in listed if name not in names] == []
    assert [name for name, count in Counter(name for name, _ in listed).items() if count > 1] == []
    assert [name for name, why in listed if not re.fullmatch(r"[A-Z0-9`].{20,}\.", why, re.S)] == []


LAW = """\
def law(x):
    if x >= 0:
        return x
    return -x
"""
LISTED = """\
- module: simulator/signal/saturation.py
  function: law
  line: "if x >= 0:"
  change: ">= -> >"
  reason: Zero is the same with either sign.
"""
CHECK = """\
import sys
import tempfile
from pathlib import Path

from simulator.signal.saturation import law


def test_it_is_the_copy():
    assert Path(sys.modules["simulator.signal.saturation"].__file__).is_relative_to(tempfile.gettempdir())


def test_values():
    assert [law(x) for x in (-2, 0, 3)] == [2, 0, 3]
"""


def test_runner_finds_the_survivor_and_leaves_the_sources_alone(tmp_path):
    """A small project whose tests see two changes of four; one of the others is listed."""
    limits = "simulator/signal/saturation.py"
    files = {limits: LAW, "tests/simulator/signal/test_saturation.py": CHECK, "pyproject.toml": ""}
    for name, content in (files | {"simulator/__init__.py": "", "simulator/signal/__init__.py": ""}).items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(content, encoding="utf-8")
    shutil.copytree(ROOT / "tests" / "mutants", tmp_path / "tests" / "mutants")
    listed = tmp_path / "tests" / "mutants" / "equivalent.yaml"
    listed.write_text(LISTED, encoding="utf-8")

    before = sorted(file for file in tmp_path.rglob("*") if "__pycache__" not in file.parts)
    command = [sys.executable, tmp_path / "tests/mutants/run.py", "--all", "--module", "signal/saturation"]
    found = subprocess.run(command, capture_output=True, text=True)
    assert found.returncode == 1, found.stderr
    assert re.search(r"^all +4 +4 +2 +1 +1$", found.stdout, re.M), found.stdout
    assert re.findall("survived: .*", found.stdout) == [f"survived: {limits}:2: law: 0 -> 1"]
    assert sorted(file for file in tmp_path.rglob("*") if "__pycache__" not in file.parts) == before
    assert (tmp_path / limits).read_text(encoding="utf-8") == LAW


def test_modules_have_mirrors_and_no_compiled_code(points):
    """Kernels on the disk cache of Numba would not see a change of what they import."""
    for module in points.MODULES:
        assert points.mirrors(module)
        assert "numba" not in (ROOT / module).read_text(encoding="utf-8")
    kernels = [
        file
        for folder in ("cpic_core", "catalogs", "simulator", "cpic_planner")
        for file in (ROOT / folder).rglob("*.py")
        if "@njit" in file.read_text(encoding="utf-8")
    ]
    assert len(kernels) >= 2
    ours = re.compile(r"^\s*(from|import) (catalogs|simulator|cpic_planner)", re.M)
    assert [file for file in kernels if ours.search(file.read_text(encoding="utf-8"))] == []
