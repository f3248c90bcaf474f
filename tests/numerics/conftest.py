"""The oracles lie beside the report that uses them as well."""

import importlib
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

REPORT = Path(__file__).resolve().parents[2] / "reports/numerics"
NAMES = ("oracle", "inventory", "refusal", "refusals", "round_trips")


def load():
    """Modules of the report on numerics; its folder is no package."""
    sys.path.insert(0, str(REPORT))
    try:
        return SimpleNamespace(**{name: importlib.import_module(name) for name in NAMES})
    finally:
        sys.path.remove(str(REPORT))


@pytest.fixture(scope="session")
def numerics():
    """Oracles, inventory, refusals and round trips."""
    return load()
