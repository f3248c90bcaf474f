"""Figures of the validator: drawn, described, and without dates."""

import base64

import numpy as np
import pytest
from cpic_planner.report.validation_figures import completeness_figure, contrast_curve_figure, roc_figure

from cpic_planner.validation import CompletenessMap, ContrastCurve, RocCurve

SEPARATION = np.linspace(0.3, 0.9, 7)
LIMIT = 1e-8 * (0.5 / SEPARATION) ** 2


def measured():
    contrast = np.where(SEPARATION < 0.35, np.inf, 1.05 * LIMIT)
    ones = np.ones(SEPARATION.size)
    return ContrastCurve(SEPARATION, contrast, ones, 6 * ones, 0.1 * ones, 5.0)


def roc(shift):
    level = np.linspace(2.5, 7.0, 46)
    chance = 1 / (1 + np.exp(2 * (level - 5 - shift)))
    false = np.round(2e4 * np.exp(-0.5 * level**2)).astype(int)
    return RocCurve(level, false, 2e4, np.round(200 * chance).astype(int), 200)


def recovered():
    contrast = np.geomspace(1e-9, 1e-7, 6)
    hits = np.round(20 / (1 + (LIMIT[:, None] / contrast) ** 3)).astype(int)
    return CompletenessMap(SEPARATION, contrast, hits, 20, 5.0)


@pytest.mark.parametrize(
    ("picture", "words"),
    [
        (
            lambda: contrast_curve_figure(measured(), title="tau Cet F662", predicted=(SEPARATION, LIMIT)),
            "6 separations",
        ),
        (lambda: roc_figure({"matched filter": roc(0.3), "aperture": roc(-0.2)}, title="$ 5"), "aperture"),
        (lambda: completeness_figure(recovered(), title="tau Cet", predicted=(SEPARATION, LIMIT)), "7 separations"),
        (lambda: contrast_curve_figure(measured(), title="alone"), "separation"),
    ],
)
def test_figures_are_drawings_with_words(picture, words):
    drawn = picture()
    svg = base64.b64decode(drawn.uri.split(",", 1)[1]).decode()
    assert drawn.uri.startswith("data:image/svg+xml;base64,")
    assert "<dc:date>" not in svg
    assert len(svg) < 400_000
    assert words in drawn.alt
    assert drawn.caption
    assert picture().uri == drawn.uri
