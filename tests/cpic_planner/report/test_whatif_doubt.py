"""The page of plans under doubt: the table, the figure and what they say are those of the record."""

import numpy as np
import pytest

from cpic_planner.report.whatif import WhatIfReport, whatif_document
from cpic_planner.report.whatif_figures import doubt_figure
from cpic_planner.report.writing import page_html
from cpic_planner.survey import load_strategies, with_doubt
from cpic_planner.survey.doubt import doubted, record_of

NAMES = ("one", "two")


@pytest.fixture(scope="module")
def record():
    config = with_doubt(load_strategies({"strategies": [{"name": name} for name in NAMES]}), "drift=0.02nm,0.2nm")
    # Mean of planets by strategy, value planned for and value played under.
    rate = np.array([[[3.0, 0.0], [2.0, 1.0]], [[1.0, 2.0], [0.5, 2.5]]])
    new = np.random.default_rng(1).poisson(rate[..., None], (*rate.shape, 400)).astype(float)
    zero = np.zeros_like(new)
    counts = {"new_planets": new, "known_planets": zero, "visits": zero, "hours": np.full_like(new, 120.0)}
    return record_of(config, doubted(config), counts)


@pytest.fixture(scope="module")
def result(compared, record):
    return compared(NAMES).model_copy(update={"doubt": record})


@pytest.fixture(scope="module")
def page(result):
    return page_html(whatif_document(WhatIfReport(result, {"doubt": doubt_figure(result)})))


def test_both_choices_are_shaded(record, reader):
    chosen = {(item.strategy, item.planned_for) for item in (record.decision.cautious, record.decision.expected)}
    picked = [tag for tag, attributes in reader.tags if tag == "tr" and attributes.get("class") == "pick"]
    assert len(picked) == len(chosen) + 1  # and the strategy that finds most


def test_the_figure_has_every_plan_and_value(result, record, drawn):
    figure, picture = drawn(doubt_figure, result)
    axes = figure.axes[0]
    shown = np.asarray(axes.images[0].get_array())
    losses = {(item.strategy, item.planned_for, item.played_under): item.loss.mean for item in record.cells}
    expected = [
        [losses[item.strategy, item.planned_for, value.text] for value in record.values] for item in record.choices
    ]
    np.testing.assert_allclose(shown, expected)
    assert [text.get_text() for text in axes.get_yticklabels()] == [
        f"{item.strategy}, for {item.planned_for}" for item in record.choices
    ]
    assert "4 plans under 2 values of drift" in picture.alt
    assert sum("best" in text.get_text() for text in axes.texts) == 2


def test_nothing_is_drawn_without_a_doubt(compared):
    assert doubt_figure(compared(NAMES)) is None
