import numpy as np
import pytest

from cpic_planner.report.whatif_maps import calendar_figure, stars_figure, visited

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
