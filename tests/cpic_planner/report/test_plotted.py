"""Values of figures are those that were drawn: found again from the figure, its scales and its places."""

import numpy as np
import pytest

from cpic_planner.report.document import Paragraph, Table, cell
from cpic_planner.report.drawing import date_axis, new_figure, style
from cpic_planner.report.plotted import panels_of, values_blocks

HOURS, RATES = np.array([0.5, 1.0, 2.0, 4.0]), np.array([np.nan, 3.25, 1e-8, 12345.6])


@pytest.fixture(scope="module")
def figure():
    with style():
        figure = new_figure(4.0, layout=None)
        lines, bars, days, empty = figure.subplots(2, 2).ravel()
        lines.plot(HOURS, RATES, label="_rate of $b$".replace("$", r"\$"))
        lines.plot(HOURS, 2.0 * RATES, label="twice")
        lines.plot(HOURS, -RATES)
        lines.axhline(7.5, label="_level")
        lines.set(xscale="log", xlim=(0.1, 10.0), xlabel="time (h)", ylabel="rate (1/h)", title="rates")
        bars.barh([0, 1], [30.0, 60.0], label="first")
        bars.barh([0, 1], [70.0, 40.0], left=[30.0, 60.0], label="_rest")
        bars.plot([5.0], [1], marker="o", ls="none", label="mark")
        bars.set_yticks([0, 1], ["F520", "F662"])
        bars.set(xlabel="share (%)", ylim=(1.5, -0.5))
        days.stairs([10.0, np.nan, 30.0], [21184.0, 21185.0, 21186.0, 21187.0], baseline=None, label="minutes")
        date_axis(days)
        empty.plot([0.0, 1.0], [0.0, 1.0])
    return figure


def test_lines_have_their_points_names_and_levels(figure):
    lines, _, _ = panels_of(figure)
    assert (lines["title"], lines["x"]["label"], lines["y"]["label"]) == ("rates", "time (h)", "rate (1/h)")
    assert [line["name"] for line in lines["lines"]] == ["rate of $b$", "twice"]
    assert lines["lines"][0]["x"] == HOURS.tolist()
    assert lines["lines"][0]["y"] == [None, 3.25, 1e-8, 12346.0]
    assert lines["levels"] == [{"name": "level", "y": 7.5}]


def test_a_place_on_the_picture_is_a_value_by_box_and_scale(figure):
    """As the script of pages reads them: shares of the picture, and of the logarithm where the scale has one."""
    panel, axes = panels_of(figure)[0], figure.axes[0]
    left, bottom, wide, high = panel["box"]
    x, y = 2.0, 5000.0
    share_x = np.log(x / panel["x"]["low"]) / np.log(panel["x"]["high"] / panel["x"]["low"])
    share_y = (y - panel["y"]["low"]) / (panel["y"]["high"] - panel["y"]["low"])
    drawn = figure.transFigure.inverted().transform(axes.transData.transform((x, y)))
    assert (left + share_x * wide, bottom + share_y * high) == pytest.approx(tuple(drawn), abs=1e-4)
    assert (panel["x"]["log"], panel["y"]["log"]) == (True, False)


def test_rows_have_what_stands_in_them(figure):
    panel = panels_of(figure)[1]
    assert panel["rows"] == ["F520", "F662"]
    assert panel["lines"] == []
    found = {(bar["name"], bar["row"]): bar["high"] - bar["low"] for bar in panel["bars"]}
    stood = {("first", 0): 30.0, ("first", 1): 60.0, ("rest", 0): 70.0, ("rest", 1): 40.0, ("mark", 1): 5.0}
    assert found == stood


def test_tables_have_every_value_and_dates_as_days(figure):
    """From the first value to the last, gaps between them too."""
    blocks = list(values_blocks(panels_of(figure)))
    tables = [block for block in blocks if isinstance(block, Table)]
    texts = [[[cell(column, row) for column in table.columns] for row in table.entries] for table in tables]
    assert [column.heading for column in tables[0].columns] == ["time (h)", "rate of $b$", "twice"]
    assert texts[0] == [
        ["1.000", "3.250", "6.500"],
        ["2.000", "1.000 × 10⁻⁸", "2.000 × 10⁻⁸"],
        ["4.000", "12346", "24691"],
    ]
    assert texts[1] == [["F520", "30.00", "70.00", "–"], ["F662", "60.00", "40.00", "5.000"]]
    assert texts[2] == [["2028-01-01", "10.00"], ["2028-01-02", "–"], ["2028-01-03", "30.00"]]
    assert [block.text for block in blocks if isinstance(block, Paragraph)] == ["rate (1/h): level: 7.500."]
