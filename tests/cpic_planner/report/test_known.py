"""Separation against time: the tracks and the edges of the dark holes are where the result says."""

import dataclasses

import numpy as np
import pytest

from catalogs import load_known_planets
from cpic_planner.etc import build_model
from cpic_planner.ranking import KnownChoice
from cpic_planner.ranking.known_answer import known_answer
from cpic_planner.report import known_figure, visibility_figure, write_figure
from cpic_planner.survey.visibility import load_visibility, visibility_result
from cpic_planner.targets import Targets, find_target
from simulator import load_instrument
from simulator.config import albedo_spec

UNIX_MJD = 40587.0


@pytest.fixture(scope="module")
def answers():
    model = build_model(load_instrument(), bands=("F520", "F850"))
    choice = KnownChoice(load_known_planets(), "2028-01-01T00:00:00", 61771.0, albedo_spec("jupiter"), 100)

    def answer(name, years=5.0, mjd=61771.0):
        return known_answer(model, find_target(name)[0], dataclasses.replace(choice, mjd=mjd), years=years)

    return answer


def test_tracks_and_edges(answers):
    result = answers("ups And")
    (axes,) = known_figure(result).axes
    tracks = [line for line in axes.lines if len(line.get_xdata()) > 2]
    own = ["", ", 16 % are below", ", 84 % are below"]
    assert [line.get_label().lstrip("_") for line in tracks] == [f"{planet}{end}" for planet in "bcd" for end in own]
    counted = [row.track for row in result.planets if row.counted]  # e is a candidate
    drawn = [
        values
        for track in counted
        for values in (track.separation_median_arcsec, track.separation_low_arcsec, track.separation_high_arcsec)
    ]
    for number, (line, values) in enumerate(zip(tracks, drawn, strict=True)):
        np.testing.assert_array_equal(line.get_ydata(), values)
        np.testing.assert_allclose(line.get_xdata(), np.array(counted[number // 3].mjd) - UNIX_MJD)
    edges = {round(float(line.get_ydata()[0]), 9) for line in axes.lines if len(line.get_xdata()) == 2}
    for hole in result.holes:
        assert {round(hole.inner_arcsec, 9), round(hole.outer_arcsec, 9)} <= edges
    low, high = axes.get_ylim()
    assert low == 0.0
    assert high > max(hole.inner_arcsec for hole in result.holes)
    words = [text.get_text() for text in axes.get_legend().get_texts()]
    assert any("F520" in word for word in words)


def test_unknown_phases_are_said(answers):
    (axes,) = known_figure(answers("51 Eri")).axes
    assert "b, phase unknown" in [text.get_text() for text in axes.get_legend().get_texts()]


@pytest.mark.parametrize("years", [0.01, 0.3, 2.0, 40.0, 100.0])
def test_any_length_has_dates(answers, years):
    (axes,) = known_figure(answers("eps Eri", years=years)).axes
    labels = [label.get_text() for label in axes.get_xticklabels()]
    assert sum(bool(label) for label in labels) >= 3


ORBIT = load_instrument().mission.orbit


def result_of(*names, days=366, start="2028-01-01", step=1.0, **limits):
    stars = Targets.joined([find_target(name)[0] for name in names])
    return visibility_result(stars, load_visibility(limits), ORBIT, start_utc=start, n_days=days, step_days=step)


@pytest.fixture(scope="module")
def year():
    return result_of("rho1 Cnc")


@pytest.fixture(scope="module")
def calendar():
    return result_of("tau Cet", "rho1 Cnc", "bet Hyi", step=2.0)


def boxes_apart(figure):
    boxes = [axes.get_tightbbox() for axes in figure.axes]
    whole = figure.bbox
    assert all(box.x0 >= -1 and box.x1 <= whole.width + 1 and box.y0 >= -1 for box in boxes)
    for i, one in enumerate(boxes):
        for other in boxes[i + 1 :]:
            assert not (
                one.x0 < other.x1 - 1 and other.x0 < one.x1 - 1 and one.y0 < other.y1 - 1 and other.y0 < one.y1 - 1
            )


def test_the_year_of_one_star(year):
    figure = visibility_figure(year)
    top, bottom = figure.axes
    assert top.get_ylabel() == "minutes per orbit"
    assert bottom.get_ylabel() == "angle (deg)"
    assert "ρ¹ Cnc" in figure.get_suptitle()
    sun, moon = bottom.lines[:2]
    assert sun.get_ydata().tolist() == year.targets[0].days.sun_deg
    assert moon.get_ydata().tolist() == year.targets[0].days.moon_deg
    # 1 January 2028 is day 21184 of matplotlib.
    assert top.get_xlim() == (21184.0, 21184.0 + 366)
    stairs = [patch.get_data() for patch in top.patches if hasattr(patch, "get_data")]
    days = np.array(year.targets[0].days.visible_s) / 60
    assert any(np.array_equal(np.nan_to_num(item.values), days) for item in stairs)
    limits = {float(line.get_ydata()[0]) for line in bottom.lines[2:]}
    assert limits == {50.0, 20.0, 140.0}
    labels = [text.get_text() for text in top.get_legend().get_texts()]
    assert {"too near the Sun", "too near the Moon", "panels out of the Sun"} <= set(labels)
    assert "behind the Earth" not in labels
    boxes_apart(figure)


def test_days_that_are_blocked_are_shaded(year):
    top, _ = visibility_figure(year).axes
    shaded = {}
    for patch in top.patches:
        if patch.get_hatch():
            box = patch.get_path().get_extents(patch.get_patch_transform())
            shaded[patch.get_hatch()] = shaded.get(patch.get_hatch(), 0.0) + box.width
    blocked = {name: days for name, days in year.targets[0].blocked_days.items() if days}
    assert sorted(shaded.values()) == pytest.approx(sorted(blocked.values()))


def test_the_calendar_of_several_stars(calendar):
    figure = visibility_figure(calendar)
    axes, scale = figure.axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["τ Cet", "ρ¹ Cnc", "β Hyi"]
    assert scale.get_ylabel() == "minutes per orbit"
    assert axes.get_ylim() == (2.5, -0.5)
    (image,) = axes.images
    assert image.get_array().shape[:2] == (3, 183)
    boxes_apart(figure)


def test_stars_and_limits_of_every_kind_can_be_drawn():
    never = result_of("tau Cet", days=40, sun_deg=180)
    assert len(visibility_figure(never).axes) == 2
    assert len(visibility_figure(result_of("tau Cet", "eps Eri", days=40, sun_deg=180)).axes) == 2
    free = result_of("bet Hyi", days=5, step=0.1, panel_turn_deg=90)
    _, bottom = visibility_figure(free).axes
    assert {float(line.get_ydata()[0]) for line in bottom.lines[2:]} == {50.0, 20.0}
    fixed = result_of("bet Hyi", days=5, panel="fixed")
    _, bottom = visibility_figure(fixed).axes
    assert {float(line.get_ydata()[0]) for line in bottom.lines[2:]} == {50.0, 20.0, 65.0, 115.0}


@pytest.mark.long
def test_files_are_the_same_every_time(calendar, tmp_path):
    """As PNG; other figures are tested as SVG and PDF."""
    first, again = (write_figure(visibility_figure(calendar), tmp_path / f"{name}.png").read_bytes() for name in "ab")
    assert again == first
    assert len(first) > 5000


@pytest.mark.parametrize("name", ["eps Eri", "51 Eri", "ups And", "HD 192310"])
def test_edges_that_are_named_are_in_the_picture(answers, name):
    """Both edges of every dark hole lie on the axis, and one shade stands for all holes."""
    result = answers(name)
    (axes,) = known_figure(result).axes
    low, high = axes.get_ylim()
    for hole in result.holes:
        assert low < hole.inner_arcsec < hole.outer_arcsec < high
    spans = [patch for patch in axes.patches if patch.get_width() == 1.0]
    assert len(spans) == 1


@pytest.mark.parametrize(("name", "bands"), [("eps Eri", 1), ("51 Eri", 0)])
def test_an_unknown_phase_has_lines_and_no_band(answers, name, bands):
    (axes,) = known_figure(answers(name)).axes
    assert len(axes.collections) == bands
    assert any("16 % are below" in line.get_label() for line in axes.lines)
