"""Mutation points of `make mutants`: right places, names that last, a seeded sample, and equivalents with a reason."""

import ast
import importlib.util
import re
import sys
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


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
