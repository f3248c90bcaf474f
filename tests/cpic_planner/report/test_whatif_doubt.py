"""The page of plans under doubt: the table, the figure and what they say are those of the record."""

import numpy as np
import pytest

from cpic_planner.report.document import page_html
from cpic_planner.report.whatif import WhatIfReport, whatif_document
from cpic_planner.report.whatif_figures import doubt_figure
from cpic_planner.report.words import decimals
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


def test_the_section_says_what_the_record_says(record, page, words, compared):
    assert record.statement in words
    assert 'id="doubt"' not in page_html(whatif_document(WhatIfReport(compared(NAMES), {})))
    assert "Plan drift 0.02 nm weight 68.8 % drift 0.2 nm weight 31.2 %" in words
    for choice in record.choices:
        row = f"{choice.strategy}, for {choice.planned_for}"
        for value in record.values:
            (cell,) = (
                item
                for item in record.cells
                if (item.strategy, item.planned_for, item.played_under)
                == (choice.strategy, choice.planned_for, value.text)
            )
            row += f" {cell.planets.mean:.2f}"
            if cell.loss.mean:
                row += f" loses {cell.loss.mean:.3f} ({decimals(cell.loss.low, 3)} to {decimals(cell.loss.high, 3)})"
            else:
                row += " best"
        assert f"{row} {choice.largest_loss:.3f} {choice.planets:.2f}" in words
    assert "If the strategy is settled" in words


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
