"""Figures of a ranking call a star detected by its verdict, and a margin what it is."""

import re

import pytest
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure

from cpic_planner.registry import SCORES
from cpic_planner.report import drawing
from cpic_planner.report.ranking_figures import contrast_diagram, margin_figure, rank_figure, sky_map
from cpic_planner.report.words import VERDICTS


@pytest.fixture
def mixed(rank):
    """Stars of every verdict, margins on either side of 1: many visits detect a planet of margin below 1."""
    cases = [
        ("ok", "detected", 0.6),
        ("ok", "detected", 3.0),
        ("ok", "measured_not_detected", 1.2),
        ("unreachable", "unreachable", 0.3),
        ("unreachable", "unreachable", 1.1),
    ]
    rows = [
        row.model_copy(update={"status": status, "verdict": verdict, "detection_margin": margin})
        for row, (status, verdict, margin) in zip(rank.targets, cases, strict=False)
    ]
    return rank.model_copy(update={"targets": rows})


@pytest.fixture
def drawn(monkeypatch):
    """Every figure that is made, by the pictures it becomes."""
    made = []
    plain = drawing.new_figure

    def kept(*arguments, **named):
        made.append(plain(*arguments, **named))
        return made[-1]

    monkeypatch.setattr(drawing, "new_figure", kept)
    return made


def words_of(figure: Figure) -> list[str]:
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes)]
    return [text.get_text() for legend in legends if legend for text in legend.get_texts()]


@pytest.mark.parametrize("draw", [margin_figure, sky_map, contrast_diagram, rank_figure])
def test_legends_have_the_words_of_the_verdicts(mixed, drawn, draw):
    draw(mixed)
    (figure,) = drawn
    counted = {re.sub(r"^reference planet: | \(\d+\)$", "", word) for word in words_of(figure)}
    assert set(VERDICTS.values()) <= counted
    assert "ok" not in counted
    said = " ".join([*words_of(figure), *(axes.get_xlabel() for axes in figure.axes)])
    assert not re.search(r"margin[^;]*1|detection margin|: detection", said)


@pytest.mark.parametrize("draw", [margin_figure, sky_map, contrast_diagram])
def test_counts_are_those_of_the_verdicts_whatever_the_margins(mixed, drawn, draw):
    draw(mixed)
    words = " ".join(words_of(drawn[0]))
    for verdict, count in (("detected", 2), ("measured, not detected", 1), ("unreachable", 2)):
        assert re.search(rf"(^|[ :]){verdict} \({count}\)", words), (verdict, words)


def test_a_detected_star_has_the_colour_of_its_verdict_below_margin_1(mixed):
    _, right = rank_figure(mixed).axes
    (line,) = (line for line in right.lines if line.get_label() == "detected")
    assert sorted(line.get_xdata()) == [0.6, 3.0]
    assert line.get_color() == drawing.VERDICT_STYLE["detected"][0]
    assert "threshold\nat a known place" in right.get_xlabel()


def test_older_results_without_a_verdict_are_told_by_their_status(rank):
    groups = drawing.by_verdict(row.model_copy(update={"verdict": None}) for row in rank.targets)
    assert sum(map(len, groups.values())) == len(rank.targets)
    assert [row.status for row in groups["detected"]] == ["ok"] * len(groups["detected"])
    assert {"unreachable", "saturated"} <= set(groups)


@pytest.mark.parametrize("name", list(SCORES))
def test_the_bar_is_what_orders_the_stars(rank, name):
    rows = [row.model_copy(update={"score": 20.0 - number}) for number, row in enumerate(rank.targets)]
    figure = rank_figure(rank.model_copy(update={"targets": rows, "score_name": name}), 5)
    left, (factor, unit) = figure.axes[0], SCORES[name].written
    assert (factor, unit) == {"completeness_per_hour": (100.0, "%/h"), "completeness": (100.0, "%")}.get(
        name, (1.0, SCORES[name].unit)
    )
    assert [bar.get_width() for bar in left.patches] == [factor * score for score in (20.0, 19.0, 18.0, 17.0, 16.0)]
    assert left.get_xlabel().startswith(SCORES[name].title)
    assert left.get_xlabel().endswith(f"({unit})" if unit else SCORES[name].title)
    assert any(isinstance(one, ErrorbarContainer) for one in left.containers) == name.startswith("completeness")


@pytest.mark.parametrize("count", [1, 5, 20])
def test_words_lie_in_the_figure(mixed, rank, count):
    for figure in (rank_figure(rank, count), rank_figure(mixed, count)):
        figure.draw_without_rendering()
        for axes in figure.axes:
            for text in (axes.xaxis.label, axes.yaxis.label, *axes.get_yticklabels()):
                if text.get_visible() and text.get_text():
                    box = text.get_window_extent()
                    assert box.x0 >= 0
                    assert box.x1 <= figure.bbox.x1, text.get_text()
