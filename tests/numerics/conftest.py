"""Oracles of the closed forms lie beside the tests, which are no package."""

import importlib
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

HERE = Path(__file__).resolve().parent
NAMES = ("oracle", "inventory", "refusals", "round_trips")


def load():
    """Modules with oracles, by name."""
    sys.path.insert(0, str(HERE))
    try:
        return SimpleNamespace(**{name: importlib.import_module(name) for name in NAMES})
    finally:
        sys.path.remove(str(HERE))


@pytest.fixture(scope="session")
def numerics():
    """Oracles, inventory, refusals and round trips."""
    return load()
