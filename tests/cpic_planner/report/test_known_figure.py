"""Separation against time: the tracks and the edges of the dark holes are where the result says."""

import dataclasses

import numpy as np
import pytest

from catalogs.known_planets import load_known_planets
from cpic_planner.etc.model import build_model
from cpic_planner.known_answer import known_answer
from cpic_planner.known_completeness import KnownChoice
from cpic_planner.report.known_figure import known_figure
from cpic_planner.targets import find_target
from simulator import load_instrument
from simulator.config.albedo import albedo_spec

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
    assert [line.get_label() for line in tracks] == ["b", "c", "d"]
    for line, row in zip(tracks, result.planets, strict=True):
        np.testing.assert_array_equal(line.get_ydata(), row.track.separation_median_arcsec)
        np.testing.assert_allclose(line.get_xdata(), np.array(row.track.mjd) - UNIX_MJD)
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
