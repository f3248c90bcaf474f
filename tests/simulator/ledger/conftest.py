"""Scenes of the ledger, and the modules of its report."""

import importlib.util
import sys
from math import atan2, degrees, hypot
from pathlib import Path
from types import SimpleNamespace

import pytest

from simulator import load_instrument, load_scene

REPORT = Path(__file__).resolve().parents[3] / "reports/truth/effect_ledger"


@pytest.fixture(scope="session")
def report():
    """Modules of the report: random scenes, and what the ledger is compared with."""
    found = {}
    for name in ("scenes", "truth"):
        spec = importlib.util.spec_from_file_location(name, REPORT / f"{name}.py")
        sys.modules[name] = found[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(found[name])
    return SimpleNamespace(**found)


@pytest.fixture(scope="session")
def calm():
    """The default instrument without drift."""
    return load_instrument({"drift": {"visit_nm": 0, "walk_nm_per_sqrt_hour": 0, "orbital_nm": 0.0}})


@pytest.fixture(scope="session")
def make():
    """Scenes: ``make(x, y)`` has a bright planet there, ``stars`` others, ``more`` is of the central star."""

    def scene(x=0.42, y=0.42, *, stars=(), **more):
        planet = {
            "name": "b",
            "radius_rjup": 1,
            "distance_au": 0.2,
            "phase_deg": 60,
            "separation_arcsec": hypot(x, y),
            "pa_deg": degrees(atan2(-x, y)) % 360,
        }
        star = {"name": "star", "v_mag": 4.0, "teff_k": 5800} | more
        return load_scene({"name": "s", "cstar": star, "planets": [planet], "stars": list(stars)})

    return scene
