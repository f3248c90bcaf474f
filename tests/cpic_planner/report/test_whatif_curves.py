import numpy as np
import pytest

from cpic_planner.report.whatif_figures import convergence_figure, curves_figure, sweep_figure

SWEPT = [f"{base} contrast={value}" for base in ("one", "two") for value in ("1e-8", "3e-9", "1e-9")]
LONG = [f"{base} contrast={value}e-9" for base in ("one", "two", "three") for value in range(1, 5)]


def test_a_curve_ends_where_its_surveys_do_with_all_that_they_find(compared, drawn):
    result = compared()
    figure, picture = drawn(curves_figure, result)
    (axes,) = figure.axes
    for line, item in zip(axes.lines, result.strategies, strict=True):
        assert line.get_label() == item.name
        x, y = line.get_data()
        assert x[-1] == item.hours.survey_high
        assert y[-1] == pytest.approx(item.planets.mean)
        assert list(x[:-1]) == [point.x for point in item.curve if point.x < x[-1]]
    assert len(axes.collections) == 3
    assert "Budget: 1752 h (beyond the axis)" in picture.caption


def test_a_budget_in_reach_is_drawn(compared, drawn):
    result = compared(["one"])
    item = result.strategies[0]
    near = item.model_copy(update={"settings": item.settings | {"time_budget_h": 210.0}})
    figure, picture = drawn(curves_figure, result.model_copy(update={"strategies": [near]}))
    (axes,) = figure.axes
    assert axes.lines[-1].get_xdata() == [210.0, 210.0]
    assert axes.get_xlim()[1] > 210.0
    assert "Budget: 210.0 h (dashed)" in picture.caption


def test_more_than_a_few_strategies_are_thinned_out_and_said_to_be(compared, drawn):
    result = compared([f"s{i}" for i in range(40)])
    for draw in (curves_figure, convergence_figure):
        figure, picture = drawn(draw, result)
        (axes,) = figure.axes
        assert [line.get_label() for line in axes.lines] == ["s0", *(f"s{i}" for i in range(33, 40))]
        assert "Shown are the first strategy and the 7 of all 40 that find most." in picture.caption


@pytest.mark.parametrize("draw", [curves_figure, convergence_figure])
def test_a_long_sweep_has_a_panel_for_each_strategy(compared, drawn, draw):
    figure, _ = drawn(draw, compared(LONG))
    assert [axes.get_title() for axes in figure.axes] == ["one", "two", "three"]
    assert all(len(axes.lines) == 4 for axes in figure.axes)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == [f"contrast={value}e-9" for value in range(1, 5)]


def test_convergence_shows_mean_and_interval(compared, drawn):
    result = compared()
    figure, picture = drawn(convergence_figure, result)
    (axes,) = figure.axes
    assert axes.get_xscale() == "log"
    for line, item in zip(axes.lines, result.strategies, strict=True):
        assert line.get_xdata().tolist() == [10.0, 50.0, 200.0]
        assert line.get_ydata()[-1] == item.planets.mean
    widest = max(item.planets.high - item.planets.low for item in result.strategies)
    assert f"interval is {widest:.2f} planets" in picture.caption


def test_a_sweep_is_drawn_against_its_key(compared, drawn):
    result = compared(SWEPT)
    figure, _ = drawn(sweep_figure, result)
    planets, new = figure.axes
    assert planets.get_xscale() == "log"
    assert [label.get_text() for label in planets.get_xticklabels()] == ["1e-9", "3e-9", "1e-8"]
    for k, (bars, more) in enumerate(zip(planets.containers, new.containers, strict=True)):
        own = [result.strategies[i] for i in range(3 * k + 2, 3 * k - 1, -1)]
        x, y = bars.lines[0].get_data()
        assert x.tolist() == [1e-9, 3e-9, 1e-8]
        assert y.tolist() == [item.planets.mean for item in own]
        assert more.lines[0].get_ydata().tolist() == [item.new_planets.mean for item in own]
        ends = np.array([segment[:, 1] for segment in bars.lines[2][0].get_segments()])
        assert ends == pytest.approx(np.array([[item.planets.low, item.planets.high] for item in own]))
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["one", "two"]


def test_values_that_are_no_numbers_stand_side_by_side(compared, drawn):
    figure, _ = drawn(sweep_figure, compared(["a rule=blind", "a rule=expected"]))
    assert figure.axes[0].get_xscale() == "linear"
    assert [label.get_text() for label in figure.axes[0].get_xticklabels()] == ["blind", "expected"]
    assert sweep_figure(compared()) is None


def test_a_sweep_of_many_strategies_shows_those_that_find_most(compared, drawn):
    names = [f"s{i} drift={value} nm" for i in range(12) for value in (1, 2)]
    figure, picture = drawn(sweep_figure, compared(names))
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [f"s{i}" for i in range(4, 12)]
    assert "not shown: 4" in picture.caption
    assert figure._supxlabel.get_text() == "drift (nm)"
    assert [label.get_text() for label in figure.axes[0].get_xticklabels()] == ["1 nm", "2 nm"]


@pytest.mark.parametrize("draw", [curves_figure, convergence_figure])
def test_nothing_found_is_drawn(compared, drawn, draw):
    figure, picture = drawn(draw, compared(["one"], empty=True))
    assert picture.uri.startswith("data:image/svg+xml;base64,")
    assert figure.axes[0].lines[0].get_ydata()[-1] == 0.0
