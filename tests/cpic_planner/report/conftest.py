"""A synthetic but realistic plan: 20 stars, 2 confirmed targets in 4 bands, every kind of outcome, a hostile name.

The builders lie beside this file, one module for each kind of report.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from matplotlib.figure import Figure

from cpic_planner.report import drawing
from cpic_planner.report.drawing import Picture
from cpic_planner.report.image_figures import Panels
from cpic_planner.report.ranking_figures import HoleEdges, LimitCurve
from cpic_planner.results import (
    ConfirmResult,
    EtcResult,
    Explanation,
    ModellingRecord,
    PlanResult,
    RankResult,
    SensitivityResult,
    WhatIfResult,
)

HOSTILE = "<script>alert('x')</script>"


def _loaded(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"report_{name}", Path(__file__).with_name(f"{name}.py"))
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


RANKINGS = _loaded("rankings")
CONFIRMATIONS = _loaded("confirmations")


@pytest.fixture(scope="session")
def rank() -> RankResult:
    return RANKINGS.ranking(HOSTILE)


@pytest.fixture(scope="session")
def sensitivity(rank: RankResult) -> SensitivityResult:
    return RANKINGS.sensitivity_of(rank, HOSTILE)


@pytest.fixture(scope="session")
def explanation(rank: RankResult) -> Explanation:
    return RANKINGS.explanation_of(rank)


@pytest.fixture(scope="session")
def make_modelled() -> Callable[..., ModellingRecord]:
    return CONFIRMATIONS.modelled


@pytest.fixture(scope="session")
def plan(rank: RankResult) -> PlanResult:
    return CONFIRMATIONS.plan_of(rank)


@pytest.fixture(scope="session")
def confirmation(plan: PlanResult) -> ConfirmResult:
    """A scene with a planet of a hostile name, measured in three bands and outside in one, and a second planet."""
    return CONFIRMATIONS.confirmation_of(plan, HOSTILE)


@pytest.fixture(scope="session")
def panels(plan: PlanResult) -> dict[str, Panels]:
    return _loaded("image_panels").panels_of(plan)


@pytest.fixture(scope="session")
def limits() -> list[LimitCurve]:
    separation = np.linspace(0.24, 0.95, 40)
    curve = 8e-10 * (1 + (0.3 / separation) ** 4)
    return [LimitCurve("α Cen B, F662", separation, curve), LimitCurve("τ Cet, F520", separation, 3 * curve)]


@pytest.fixture(scope="session")
def holes() -> list[HoleEdges]:
    return [
        HoleEdges("F520", 0.231, 1.0),
        HoleEdges("F662", 0.294, 1.0),
        HoleEdges("F720", 0.319, 1.0),
        HoleEdges("F850", 0.377, 1.0),
    ]


@pytest.fixture(scope="session")
def etc_answers(rank: RankResult) -> EtcResult:
    return _loaded("etc_results").answers_about(rank.reference_planet)


@pytest.fixture(scope="session")
def compared() -> Callable[..., WhatIfResult]:
    """Comparisons of strategies with the given names; ``empty`` ones find and visit nothing."""
    return _loaded("comparisons").comparer(HOSTILE)


@pytest.fixture(scope="session")
def read() -> Callable[[str], HTMLParser]:
    """Tags and visible text of a page whose tags are balanced."""
    return _loaded("page_reader").read


@pytest.fixture(scope="module")
def reader(page: str, read: Callable[[str], HTMLParser]) -> HTMLParser:
    """The ``page`` of the file, read."""
    return read(page)


@pytest.fixture(scope="module")
def words(reader: HTMLParser) -> str:
    return reader.words


@pytest.fixture
def drawn(monkeypatch) -> Callable[..., tuple[Figure, Picture]]:
    """Run a function that draws; returns the matplotlib figure and its picture."""

    def draw(function, *arguments):
        kept, save = [], drawing.save

        def keep(figure, *args, **options):
            kept.append(figure)
            return save(figure, *args, **options)

        with monkeypatch.context() as patch:
            patch.setattr(drawing, "save", keep)
            picture = function(*arguments)
        return kept[0], picture

    return draw
