import pytest

from cpic_planner.report.whatif_rows import detections_figure, differences_figure, time_figure, yields_figure

MANY = [f"s{i}" for i in range(50)]
DRAWN = [yields_figure, differences_figure, time_figure, detections_figure]


def markers(axes):
    return [line for line in axes.lines if line.get_marker() not in ("None", "|", None, "")]


def test_yields_are_means_intervals_and_single_surveys(compared, drawn):
    result = compared()
    figure, _ = drawn(yields_figure, result)
    left, right = figure.axes
    for axes, quantity in ((left, "planets"), (right, "new_planets")):
        found = [getattr(item, quantity) for item in result.strategies]
        assert [line.get_xdata()[0] for line in markers(axes)] == [one.mean for one in found]
        thick = [line.get_xdata().tolist() for line in axes.lines if line.get_linewidth() == 8.0]
        assert thick == [[one.low, one.high] for one in found]
        thin = [line.get_xdata().tolist() for line in axes.lines if line.get_marker() == "|"]
        assert thin == [[one.survey_low, one.survey_high] for one in found]
    assert [label.get_text() for label in left.get_yticklabels()] == [item.name for item in result.strategies]


def test_differences_are_with_the_first_and_chance_is_open(compared, drawn):
    result = compared(["one", "two"])
    by = {item.quantity: item for item in result.differences}
    assert by["planets"].low > 0 > by["new_planets"].low
    figure, picture = drawn(differences_figure, result)
    for axes, quantity, filled in ((figure.axes[0], "planets", True), (figure.axes[1], "new_planets", False)):
        (marker,) = markers(axes)
        assert marker.get_xdata()[0] == by[quantity].mean
        assert (marker.get_markerfacecolor() != "white") == filled
    assert "than by one" in picture.caption
    assert "surely more: two." in picture.alt
    assert differences_figure(compared(["one"])) is None


def test_bars_add_up_to_the_time_used(compared, drawn):
    result = compared()
    figure, picture = drawn(time_figure, result)
    (axes,) = figure.axes
    ends = {}
    for bars in axes.containers[:-1]:
        for k, bar in enumerate(bars):
            ends[k] = bar.get_x() + bar.get_width()
    assert list(ends.values()) == pytest.approx([item.hours.mean for item in result.strategies])
    assert [text.get_text() for text in axes.texts] == ["1652 h unused", "1602 h unused", "1552 h unused"]
    assert axes.get_xlim()[1] < 300.0
    assert "beyond the axis" in picture.caption


def test_boxes_are_the_quantiles(compared, drawn):
    result = compared()
    figure, _ = drawn(detections_figure, result)
    snr, margin, contrast, separation = figure.axes
    assert [axes.get_xscale() for axes in figure.axes] == ["log", "log", "log", "linear"]
    for axes, key, scale in (
        (snr, "snr", 1),
        (margin, "margin", 1),
        (contrast, "contrast", 1e9),
        (separation, "separation_arcsec", 1),
    ):
        levels = [scale * value for value in result.strategies[0].quantiles[key]]
        assert axes.lines[0].get_xdata().tolist() == pytest.approx([levels[0], levels[-1]])
        assert axes.lines[1].get_xdata().tolist() == pytest.approx([levels[2]] * 2)
        box = axes.containers[0][0]
        assert (box.get_x(), box.get_x() + box.get_width()) == pytest.approx((levels[1], levels[3]))


def test_strategies_without_detections_have_no_box(compared, drawn):
    result = compared(["one", "two"])
    none = result.strategies[1].model_copy(update={"quantiles": {}})
    figure, picture = drawn(detections_figure, result.model_copy(update={"strategies": [result.strategies[0], none]}))
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == ["one"]
    assert "Strategies without any detection, not shown: 1." in picture.caption
    assert detections_figure(compared(empty=True)) is None


@pytest.mark.parametrize("draw", [yields_figure, differences_figure, time_figure])
def test_nothing_found_is_drawn(compared, draw):
    assert draw(compared(["one", "two"], empty=True)).uri.startswith("data:image/svg+xml;base64,")


@pytest.mark.parametrize("draw", DRAWN)
def test_rows_stay_readable(compared, drawn, draw):
    figure, picture = drawn(draw, compared(MANY))
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert labels == [name for name in ["s0", *MANY[11:]] if name != "s0" or draw is not differences_figure]
    assert figure.get_size_inches()[1] < 12.0
    assert "the 39 of all 50 that find most" in picture.caption
