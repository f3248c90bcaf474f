"""A small survey that is quick to make: three nearby stars, one band, two years in slots of sixty days.

Nothing excludes its planets, so that there are enough of them; tests of what does ask for it.
"""

import copy
import importlib.util
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cpic_planner.planets import StarLimits
from cpic_planner.survey import load_strategies
from cpic_planner.survey.prepare import prepare
from simulator.config import deep_merge

STARS = ["alf Cen A", "eps Eri", "tau Cet"]
TREE = {
    "universe": {"duration_days": 730, "slot_days": 60, "universes": 100, "exclusions": "none"},
    "defaults": {
        "time_budget_h": 300,
        "targets": {"names": STARS},
        "visit": {"bands": ["F520"], "time_s": 36000},
        "revisits": {"max_visits": 4},
    },
}


def _loaded(name, path):
    spec = importlib.util.spec_from_file_location(name, path)
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def brute_force():
    """Sampling, orbits and geometry that share no code with the survey; they lie beside the report that uses them."""
    return _loaded("whatif_brute_force", Path(__file__).resolve().parents[3] / "reports/examples/whatif/brute_force.py")


@pytest.fixture(scope="session")
def problems():
    """Small random scheduling problems, and the search through all their schedules."""
    return _loaded("survey_problems", Path(__file__).with_name("problems.py"))


@pytest.fixture(scope="session")
def small():
    """Make the configuration of some strategies: ``small({"name": ..., ...}, ..., universe={...})``."""

    def make(*strategies, universe=None):
        tree = copy.deepcopy(TREE)
        tree["universe"] = deep_merge(tree["universe"], universe or {})
        tree["strategies"] = [{"name": "plain"} | item for item in strategies or ({},)]
        return load_strategies(tree)

    return make


@pytest.fixture(scope="session")
def plain(small):
    """The small survey, prepared."""
    return prepare(small())


@pytest.fixture(scope="session")
def sharp(small):
    """The same without chance: expected significance decides, north is up, nothing known, no stop, no reserve."""
    return prepare(small(SHARP, universe={"known_planets": "off"}))


SHARP = {
    "detection": {"rule": "expected"},
    "revisits": {"roll": "north"},
    "stop": {"after_detection": False},
    "scheduler": {"reserve": 0},
}


@pytest.fixture(scope="session")
def sharp_tree():
    """What makes a strategy `sharp`."""
    return SHARP


@pytest.fixture(scope="session")
def change():
    """Copy of a survey with other settings of its strategy, by section."""

    def changed(survey, **sections):
        strategy = survey.strategy
        for name, values in sections.items():
            value = getattr(strategy, name).model_copy(update=values) if isinstance(values, dict) else values
            strategy = strategy.model_copy(update={name: value})
        return replace(survey, strategy=strategy)

    return changed


@pytest.fixture(scope="session")
def only_visits():
    """Copy of a survey with some of its planned visits, numbered anew."""

    def kept(survey, wanted):
        chosen, numbers = [], {}
        for visit in survey.schedule.visits:
            if wanted(visit):
                number = numbers.get(visit.star, 0)
                chosen.append(replace(visit, ordinal=number))
                numbers[visit.star] = number + 1
        assert chosen
        return replace(survey, schedule=replace(survey.schedule, visits=tuple(chosen)))

    return kept


@pytest.fixture(scope="session")
def excluding():
    """What is known of stars where velocities would have shown this share of all planets, whatever they are."""

    def made(names, share):
        limits = StarLimits.of(list(names), ())
        everywhere = {"ceiling": np.full_like(limits.ceiling, share), "reach_au": np.full_like(limits.reach_au, np.inf)}
        tiny = {name: getattr(limits, name) - 100.0 for name in ("log_m50", "log_m90")}
        return replace(limits, **everywhere, **tiny)

    return made


@pytest.fixture(scope="session")
def within_errors():
    """Whether a sample mean is within four standard errors of a value."""

    def check(sample, expected):
        sample = np.asarray(sample, float)
        error = sample.std(ddof=1) / np.sqrt(sample.size)
        assert abs(sample.mean() - expected) <= 4.0 * error, (sample.mean(), expected, error)

    return check
