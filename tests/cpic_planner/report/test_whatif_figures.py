import numpy as np
import pytest

from cpic_planner.report import drawing
from cpic_planner.report.whatif_figures import (
    FEW,
    WHATIF_FIGURES,
    calendar_figure,
    convergence_figure,
    curves_figure,
    left_out,
    looks_of,
    row_label,
    shown_rows,
    stars_figure,
    sweep_figure,
    sweep_of,
    visited,
    whatif_figures,
)

ALL = ["yields", "differences", "curves", "time", "calendar", "sky", "detections", "convergence"]


@pytest.mark.parametrize(
    ("names", "empty", "keys"),
    [
        (["one", "two"], False, ALL),
        pytest.param(["one"], False, [key for key in ALL if key != "differences"], marks=pytest.mark.long),
        (["one", "two"], True, ["yields", "differences", "curves", "time", "convergence"]),
        (["one drift=x1 (0.05 nm)", "one drift=0.1 nm"], False, ["sweep", *ALL]),
    ],
)
def test_what_there_is_is_drawn_under_titles_of_the_report(compared, names, empty, keys):
    import matplotlib.pyplot as plt

    figures = whatif_figures(compared(names, empty=empty))
    assert list(figures) == keys
    assert [key for key in WHATIF_FIGURES if key in figures] == keys
    for picture in figures.values():
        assert picture.alt
        assert picture.caption.endswith(".")
    assert plt.get_fignums() == []


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


JAN_2028 = 21184.0  # days since 1970


def test_stars_stand_by_their_best_rank(compared):
    result = compared()
    assert [target.rank for members in visited(result).values() for _, target in members[:1]] == [1, 2, 3]
    flipped = result.strategies[1].targets[::-1]
    ranked = [target.model_copy(update={"rank": k}) for k, target in enumerate(flipped)]
    other = result.strategies[1].model_copy(update={"targets": ranked})
    changed = result.model_copy(update={"strategies": [result.strategies[0], other]})
    assert next(iter(visited(changed))) == "5 $ star $"


def test_every_planned_visit_has_its_mark(compared, drawn):
    result = compared()
    figure, picture = drawn(calendar_figure, result)
    (axes,) = figure.axes
    for line, item in zip(axes.lines, result.strategies, strict=True):
        expected = [JAN_2028 + 30.0 * slot + 15.0 for target in item.targets for slot in target.slots]
        assert line.get_xdata().tolist() == expected
        assert np.round(line.get_ydata()).tolist() == [
            float(k) for k, target in enumerate(item.targets) for _ in target.slots
        ]
    labels = [label.get_text() for label in axes.get_yticklabels()]
    assert labels == ["ε Eri ●", "<script>alert('x')</script>", r"5 \$ star \$"]
    assert "slot of 30 days" in picture.caption


def test_many_strategies_become_counts(compared, drawn):
    names = [f"s{i}" for i in range(40)]
    result = compared(names)
    figure, picture = drawn(calendar_figure, result)
    mesh = figure.axes[0].collections[-1]
    counts = np.zeros((3, 12))
    for item in result.strategies:
        for row, target in enumerate(item.targets):
            counts[row, target.slots] += 1
    assert np.array_equal(np.ma.filled(mesh.get_array(), 0.0), counts)
    assert figure.axes[1].get_ylabel() == "strategies, of 40"
    assert "in how many strategies" in picture.caption


def test_only_so_many_rows_are_drawn(compared, drawn):
    result = compared(["one"])
    one = result.strategies[0]
    stars = [one.targets[0].model_copy(update={"name": f"HD {k}", "rank": k}) for k in range(1, 61)]
    crowded = result.model_copy(update={"strategies": [one.model_copy(update={"targets": stars})]})
    figure, picture = drawn(calendar_figure, crowded)
    assert len(figure.axes[0].get_yticklabels()) == 40
    assert "not shown: 20" in picture.caption
    assert stars_figure(crowded).alt.startswith("Map of the sky with 60 visited stars")


def test_the_sky_has_the_best_of_every_star_and_rings_for_known_planets(compared, drawn):
    result = compared()
    figure, picture = drawn(stars_figure, result)
    axes, bar = figure.axes
    (dots,) = [item for item in axes.collections if item.get_array() is not None]
    best = [max(target.planets_per_100h for _, target in members) for members in visited(result).values()]
    assert sorted(dots.get_array()) == pytest.approx(sorted(best))
    assert bar.get_ylabel() == "planets found per 100 h"
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["ecliptic", "known planet (1)"]
    assert "ε Eri" in picture.alt


def test_stars_that_show_nothing_are_hollow(compared, drawn):
    result = compared(["one"])
    one = result.strategies[0]
    none = [target.model_copy(update={"planets_per_100h": 0.0}) for target in one.targets]
    figure, _ = drawn(
        stars_figure, result.model_copy(update={"strategies": [one.model_copy(update={"targets": none})]})
    )
    assert len(figure.axes) == 1
    assert "nothing found (3)" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_no_visits_no_maps(compared):
    result = compared(empty=True)
    assert calendar_figure(result) is None
    assert stars_figure(result) is None


LIMITS_SWEPT = [f"{base} contrast={value}" for base in ("a b", "c") for value in ("1e-8", "3e-9", "1e-9")]


def test_a_sweep_is_read_from_the_names_with_ascending_values(compared):
    sweep = sweep_of(compared(LIMITS_SWEPT).strategies)
    assert (sweep.key, sweep.values, sweep.numbers) == ("contrast", ("1e-9", "3e-9", "1e-8"), (1e-9, 3e-9, 1e-8))
    assert sweep.lines == {"a b": {"1e-8": 0, "3e-9": 1, "1e-9": 2}, "c": {"1e-8": 3, "3e-9": 4, "1e-9": 5}}


def test_of_two_keys_the_one_with_most_values_is_the_axis(compared):
    names = [
        f"a drift=x{drift} ({0.05 * drift:g} nm) rule={rule}"
        for drift in (1, 2)
        for rule in ("blind", "expected", "known_place")
    ]
    sweep = sweep_of(compared(names).strategies)
    assert (sweep.key, sweep.numbers) == ("rule", None)
    assert sweep.values == ("blind", "expected", "known_place")
    assert list(sweep.lines) == ["a drift=x1 (0.05 nm)", "a drift=x2 (0.1 nm)"]


def test_numbers_of_a_sweep_have_their_unit(compared):
    """A factor stands where its value stands, and an axis never mixes units."""
    sweep = sweep_of(compared(["a drift=x4 (0.2 nm)", "a drift=0.1 nm", "a drift=x1 (0.05 nm)"]).strategies)
    assert sweep.values == ("x1 (0.05 nm)", "0.1 nm", "x4 (0.2 nm)")
    assert (sweep.numbers, sweep.unit, sweep.title) == ((0.05, 0.1, 0.2), "nm", "drift (nm)")
    sweep = sweep_of(compared(["a throughput=x2", "a throughput=x0.5"]).strategies)
    assert (sweep.numbers, sweep.title) == ((0.5, 2.0), "throughput (x)")
    sweep = sweep_of(compared(["a time_s=1 h", "a time_s=60 s"]).strategies)
    assert (sweep.numbers, sweep.title) == (None, "time_s")


@pytest.mark.parametrize(
    "names", [["a", "b"], ["a contrast=1", "b"], ["a contrast=1", "a drift=2"], ["a contrast=1", "b contrast=1"]]
)
def test_names_that_vary_nothing_are_no_sweep(compared, names):
    assert sweep_of(compared(names).strategies) is None


def test_few_strategies_differ_in_colour_and_marker(compared):
    looks = looks_of(compared([f"s{i}" for i in range(FEW)]).strategies)
    assert len({colour for colour, _ in looks}) == len({marker for _, marker in looks}) == FEW


def test_many_look_alike_or_as_their_line_of_a_sweep(compared):
    assert len(set(looks_of(compared([f"s{i}" for i in range(40)]).strategies))) == 1
    names = [f"{base} contrast={value}" for base in "ab" for value in range(1, 8)]
    looks = looks_of(compared(names).strategies)
    assert len(set(looks)) == 2
    assert len(set(looks[:7])) == 1


def test_rows_are_the_first_and_those_that_find_most(compared):
    strategies = compared([f"s{i}" for i in range(12)]).strategies  # each finds more than the one before
    assert shown_rows(strategies, 4) == [0, 9, 10, 11]
    assert shown_rows(strategies) == list(range(12))
    assert left_out(strategies) == ""
    assert left_out(strategies, 4) == " Shown are the first strategy and the 3 of all 12 that find most."


def test_labels_are_plain_text_and_keep_both_ends():
    assert row_label("a $x$") == r"a \$x\$"
    label = row_label(f"{'x' * 40} contrast=1e-9")
    assert len(label) <= 34
    assert label.startswith("xxx")
    assert label.endswith("contrast=1e-9")


@pytest.mark.parametrize(
    ("limits", "ticks"), [((3.0, 30.0), ["5", "10", "20"]), ((8.0, 1500.0), ["10", "100", "1000"])]
)
def test_a_log_axis_has_everyday_numbers(limits, ticks):
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    axes.set_xlim(limits)
    drawing.plain_log_axis(axes)
    axes.set_xlim(limits)
    axes.figure.canvas.draw()
    shown = [text.get_text() for text in axes.get_xticklabels() if limits[0] <= text.get_position()[0] <= limits[1]]
    assert shown == ticks
