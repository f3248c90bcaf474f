import itertools
from pathlib import Path

import numpy as np
import pytest

from cpic_planner.api import answered
from cpic_planner.etc import build_model, contrast_limit, etc_result
from cpic_planner.etc.questions import exposure_time, signal_to_noise
from cpic_planner.queries import EtcQuestion, Strategy
from cpic_planner.report import MOST_STARS, check_figure_name, etc_curves, etc_figure, rank_figure, style, write_figure
from cpic_planner.targets import find_target
from simulator.config import load_instrument

BANDS = ["F520", "F850"]
TIME_S = 7200.0


@pytest.fixture(scope="module")
def model():
    return build_model(load_instrument(), BANDS)


@pytest.fixture(scope="module")
def star():
    return find_target("tau Cet")[0]


def result_of(model, star, answers):
    return etc_result(model, star, answers, note="", planet=None, asked={}, catalogue="")


@pytest.fixture(scope="module")
def answers(model, star):
    return signal_to_noise(model, star, time_s=TIME_S, separation_arcsec=0.6)


@pytest.fixture(scope="module")
def curves(model, star, answers):
    return etc_curves(model, star, answers, time_s=TIME_S)


def test_a_line_holds_what_the_question_answers(model, star, curves, answers):
    line = curves.times[0]
    fixed = build_model(model.instrument, model.bands, Strategy(visits=answers[0].visits))
    for i in (60, 70, 89):
        one = signal_to_noise(fixed, star, time_s=float(line.time_s[i]), separation_arcsec=0.6, bands=["F520"])[0]
        assert line.snr[i] == pytest.approx(one.value, rel=1e-12)
        # The best frames are those of the SNR, which is flat there: rounding leaves them open by the root of 1e-16.
        assert line.significance[i] == pytest.approx(one.significance, rel=1e-8)
        assert line.threshold == pytest.approx(one.threshold, rel=1e-12)
    assert [line.label for line in curves.times] == BANDS


def test_lines_pass_through_the_answer_and_never_fall(curves, answers):
    for line, answer in zip(curves.times, answers, strict=True):
        assert line.point == (answer.time_s, answer.snr, answer.significance)
        assert np.interp(np.log(answer.time_s), np.log(line.time_s), line.snr) == pytest.approx(answer.snr, rel=0.01)
        assert np.all(np.diff(line.snr[np.isfinite(line.snr)]) >= -1e-12)


def test_limits_against_separation(model, star, curves):
    for line in curves.limits:
        for i in (0, 17, len(line.contrast) - 1):
            one = contrast_limit(
                model, star, time_s=TIME_S, separation_arcsec=float(line.separation_arcsec[i]), bands=[line.label]
            )[0]
            assert line.contrast[i] == pytest.approx(one.value, rel=1e-9)
    assert curves.limit_level == "a detection"
    assert curves.limits[0].planets[0][0] == 0.6


@pytest.mark.parametrize(("level", "words"), [({"snr": 7.0}, "SNR 7"), ({"sigma": 4.0}, "4 sigma")])
def test_levels_of_the_limit(model, star, level, words):
    answers = contrast_limit(model, star, time_s=TIME_S, separation_arcsec=[0.5, 0.7], bands=["F520"], **level)
    curves = etc_curves(model, star, answers, time_s=TIME_S, best_band="F520", **level)
    assert curves.limit_level == words
    assert [line.label for line in curves.times] == ["F520, 0.500″", "F520, 0.700″"]
    key = "snr" if "snr" in level else "significance"
    for line, answer in zip(curves.times, answers, strict=True):
        assert getattr(answer, key) == pytest.approx(level.get("snr") or level.get("sigma"), rel=1e-9)
        assert np.nanmax(getattr(line, key)) >= getattr(answer, key) * (1 - 1e-9)


def test_places_without_a_planet_have_no_line(model, star):
    answers = exposure_time(model, star, snr=5.0, separation_arcsec=0.2)
    curves = etc_curves(model, star, answers, time_s=TIME_S, snr=5.0)
    assert curves.times == ()
    figure = etc_figure(result_of(model, star, answers), curves)
    assert len(figure.axes) == 2


def test_the_figure_says_what_it_shows(model, star, answers, curves):
    figure = etc_figure(result_of(model, star, answers), curves)
    times, limits, budget = figure.axes
    assert times.get_xlabel() == "wall time allowed (h)"
    assert limits.get_xlabel() == "separation on the diagonal (arcsec)"
    assert limits.get_ylabel() == "planet-to-star contrast (flux ratio)"
    assert "2.00 h" in limits.get_title()
    assert budget.get_xlabel() == "share of the variance of the answer (%)"
    for axes in (times, limits, budget):  # no legend over the data
        box = axes.get_legend().get_window_extent()
        assert box.y1 < axes.get_window_extent().y0
    widths = np.array([[bar.get_width() for bar in group] for group in budget.containers])
    assert widths.sum(axis=0) == pytest.approx(100.0)
    assert widths.min() >= -1e-9


def test_axes_of_a_figure_do_not_overlap(model, star, answers, curves):
    figure = etc_figure(result_of(model, star, answers), curves)
    boxes = [axes.get_tightbbox() for axes in figure.axes]
    for i, one in enumerate(boxes):
        for other in boxes[i + 1 :]:
            assert not (
                one.x0 < other.x1 - 1 and other.x0 < one.x1 - 1 and one.y0 < other.y1 - 1 and other.y0 < one.y1 - 1
            )
    whole = figure.bbox
    assert all(box.x0 >= -1 and box.x1 <= whole.width + 1 and box.y0 >= -1 for box in boxes)


@pytest.mark.parametrize("ending", ["svg", pytest.param("pdf", marks=pytest.mark.long)])
def test_files_are_the_same_every_time(rank, tmp_path, ending):
    first = write_figure(rank_figure(rank), tmp_path / f"a.{ending}").read_bytes()
    again = write_figure(rank_figure(rank), tmp_path / f"b.{ending}").read_bytes()
    assert first == again
    assert len(first) > 5000


def test_names_and_folders_of_figures(refused, rank, tmp_path):
    refused(r"png, pdf, svg", check_figure_name, Path("figure.gif"))
    refused("writable", write_figure, rank_figure(rank, 2), tmp_path / "no" / "such" / "f.png")


def test_bars_of_the_ranking(rank):
    left, right = rank_figure(rank, 5).axes
    assert [bar.get_width() for bar in left.patches] == pytest.approx([100 * row.score for row in rank.targets[:5]])
    assert left.get_xlabel() == "completeness per hour (%/h)"
    names = [label.get_text() for label in left.get_yticklabels()]
    assert names[0] == "1  α Cen B"
    points = {x for line in right.lines for x in np.atleast_1d(line.get_xdata())}
    assert {row.detection_margin for row in rank.targets[:5]} <= points


@pytest.mark.parametrize(("asked", "drawn"), [(3, 3), (30, 30), (MOST_STARS + 1, MOST_STARS)])
def test_as_many_stars_are_drawn_as_asked_for_and_their_names_can_be_read(rank, asked, drawn):
    many = rank.model_copy(update={"targets": rank.targets * 6})
    figure = rank_figure(many, asked)
    assert figure.get_suptitle().startswith(f"First {drawn} of {len(many.targets)} stars")
    boxes = [label.get_window_extent() for label in figure.axes[0].get_yticklabels()]
    assert len(boxes) == drawn
    assert all(lower.y1 <= upper.y0 for upper, lower in itertools.pairwise(boxes))


def test_a_ranking_without_any_frame_can_be_drawn(rank):
    last = rank.model_copy(update={"targets": rank.targets[-1:]})
    assert len(rank_figure(last).axes) == 2


@pytest.mark.parametrize(
    "more",
    [{"bands": ["F520"]}, {"separation_arcsec": [0.4, 0.5, 0.6]}, {"bands": ["all"]}, {"separation_arcsec": 2.0}],
)
def test_all_words_lie_in_the_figure_and_legends_on_no_axes(more):
    figure = answered(EtcQuestion.of({"target": "tau Cet", "time_s": 36e3} | more)).figure()
    with style():
        figure.canvas.draw()
        renderer = figure.canvas.get_renderer()
        found = figure.get_tightbbox(renderer)  # inches
        wide, high = figure.get_size_inches()
        assert found.x0 >= 0.0
        assert found.y0 >= 0.0
        assert found.x1 <= wide
        assert found.y1 <= high
        boxes = [axes.get_window_extent(renderer) for axes in figure.axes]
        for axes in figure.axes:
            legend = axes.get_legend()
            if legend is not None:
                own = legend.get_window_extent(renderer)
                assert not any(own.overlaps(box) for box in boxes)


@pytest.mark.parametrize("more", [{}, {"bands": ["F520"]}, {"separation_arcsec": [0.4, 0.5, 0.6]}])
def test_labels_are_no_longer_than_their_axes_and_words_are_told_once(more):
    """A label of an axis stays beside it, titles above do not touch it, and bands have one legend."""
    figure = answered(EtcQuestion.of({"target": "tau Cet", "time_s": 36e3} | more)).figure()
    with style():
        figure.canvas.draw()
        titles = [axes.title.get_window_extent() for axes in figure.axes if axes.get_title()]
        for axes in figure.axes:
            for label, long in ((axes.yaxis.label, "height"), (axes.xaxis.label, "width")):
                box = label.get_window_extent()
                assert getattr(box, long) <= getattr(axes.get_window_extent(), long), label.get_text()
                assert not any(box.overlaps(title) for title in titles)
    words = [text.get_text() for axes in figure.axes[:2] for text in axes.get_legend().get_texts()]
    assert len(words) == len(set(words))
    assert "best visit" not in figure.axes[0].get_title()
