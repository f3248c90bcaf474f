"""Oracles of the exposure-time calculator; they lie beside the report that uses them as well."""

import importlib.util
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

REPORT = Path(__file__).resolve().parents[3] / "reports/truth/etc_accuracy"


@pytest.fixture(scope="session")
def oracles():
    """Modules of the report on the accuracy of the ETC: Monte Carlo of stacks, and brute force."""
    found = {}
    for name in ("monte_carlo", "regimes", "counting", "real_stars", "brute_force", "random_problems"):
        spec = importlib.util.spec_from_file_location(name, REPORT / f"{name}.py")
        sys.modules[name] = found[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(found[name])
    return SimpleNamespace(**found)
