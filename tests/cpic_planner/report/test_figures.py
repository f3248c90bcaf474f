import base64
import re

import numpy as np
import pytest

from cpic_planner.report.drawing import band_style, literal, new_figure, place_labels, style
from cpic_planner.report.figures import (
    contrast_diagram,
    margin_figure,
    panel_picture,
    plan_figures,
    sky_map,
    snr_figure,
)
from cpic_planner.report.sky_map import map_longitude, marker_area
from cpic_planner.validation.calibration import snr_scatter


def content(picture):
    return base64.b64decode(picture.uri.split(",", 1)[1])


def size_px(picture):
    return np.frombuffer(content(picture)[16:24], dtype=">u4").tolist()


@pytest.fixture(scope="module")
def pictures(plan, rank, limits, holes):
    return plan_figures(plan, rank, limits=limits, holes=holes)


def test_plan_figures_are_vector_drawings_with_words(pictures):
    assert set(pictures) == {"sky", "contrast", "calibration", "margin"}
    for picture in pictures.values():
        svg = content(picture).decode()
        assert picture.uri.startswith("data:image/svg+xml;base64,")
        assert "<dc:date>" not in svg
        assert "Matplotlib v" not in svg
        assert len(svg) < 400_000
        assert picture.alt
        assert picture.caption.endswith(".")


def test_axes_name_contrast_and_limit(pictures):
    # Text is drawn as glyphs; matplotlib leaves it in comments.
    svg = content(pictures["contrast"]).decode()
    words = re.findall(r"<!-- (.*?) -->", svg)
    assert "planet-to-star contrast (flux ratio)" in words
    assert any(re.search(r"contrast limit", word) for word in words)
    assert "5σ" in pictures["contrast"].caption


def test_same_bytes_twice(plan, rank, limits, holes, panels, pictures):
    again = plan_figures(plan, rank, limits=limits, holes=holes)
    assert {key: picture.uri for key, picture in again.items()} == {
        key: picture.uri for key, picture in pictures.items()
    }
    one = next(iter(panels.values()))
    assert panel_picture(one, "* tau Cet").uri == panel_picture(one, "* tau Cet").uri


def test_the_users_settings_neither_matter_nor_change(rank):
    import matplotlib as mpl

    before = margin_figure(rank).uri
    with mpl.rc_context({"font.size": 30.0, "axes.facecolor": "red", "svg.hashsalt": "x"}):
        assert margin_figure(rank).uri == before
        assert mpl.rcParams["font.size"] == 30.0


def test_panel_picture_is_a_palette_png_wide_enough(panels):
    picture = panel_picture(next(iter(panels.values())), "* tau Cet")
    data = content(picture)
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert size_px(picture)[0] >= 900
    assert data[25] == 3  # colour type: palette
    assert b"tEXt" not in data
    assert b"tIME" not in data
    assert len(data) < 160_000


def test_pyplot_is_not_used(rank):
    import subprocess
    import sys

    code = (
        "import sys\nfrom cpic_planner.report.drawing import new_figure, save, style\n"
        "with style():\n    f = new_figure(2); f.add_subplot().plot([1, 2]); save(f, 'svg', alt='', caption='')\n"
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)


def test_figures_of_an_empty_ranking_and_plan(rank, plan):
    empty = rank.model_copy(update={"targets": [], "counts": {}})
    for picture in (
        sky_map(empty),
        contrast_diagram(empty),
        margin_figure(empty),
        snr_figure(plan.model_copy(update={"targets": []})),
    ):
        assert picture.uri.startswith("data:image/svg+xml")


def test_sky_map_has_east_to_the_left():
    x = map_longitude([0.0, 90.0, 179.0, 181.0, 270.0])
    assert x == pytest.approx(np.deg2rad([0.0, -90.0, -179.0, 179.0, 90.0]))


def test_brighter_stars_are_larger():
    areas = marker_area([0.0, 3.0, 7.0])
    assert areas[0] > areas[1] > areas[2] > 0


def test_error_bars_of_recovered_snr():
    assert snr_scatter(0.0, 0.0, 50) == 1.0
    assert snr_scatter(10.0, 10.0, None) == 1.0
    # Monte Carlo: SNR 10 with its sigma estimated from 51 samples.
    draw = np.random.default_rng(5)
    snr = draw.normal(10.0, 1.0, 40_000) / draw.normal(size=(40_000, 51)).std(axis=1, ddof=1)
    assert snr_scatter(10.0, 10.0, 51) == pytest.approx(snr.std(), rel=0.05)
    # The planet's own noise dominates: a bright draw has a larger error, so the ratio scatters by half.
    bright = draw.poisson(400.0, 40_000).astype(float)
    assert snr_scatter(20.0, 1e3, 1000) == pytest.approx((bright / np.sqrt(bright)).std(), rel=0.05)


def test_bands_differ_in_colour_and_marker():
    looks = band_style(["F520", "F662", "F720", "F850", "F520"])
    assert len(looks) == 4
    assert len({colour for colour, _ in looks.values()}) == 4
    assert len({marker for _, marker in looks.values()}) == 4


def test_labels_do_not_overlap():
    draw = np.random.default_rng(2)
    x, y = draw.uniform(0.3, 0.7, (2, 12))
    with style():
        figure = new_figure(5.0)
        axes = figure.add_subplot()
        axes.set(xlim=(0, 1), ylim=(0, 1))
        place_labels(axes, x.tolist(), y.tolist(), [f"star {i}" for i in range(12)])
        figure.draw_without_rendering()
        renderer = figure.canvas.get_renderer()
        # The box of the words alone: an annotation's own extent includes its leader line.
        boxes = [type(text).__mro__[1].get_window_extent(text, renderer) for text in axes.texts]
    assert len(boxes) == 12
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])


def test_dollar_signs_are_literal():
    assert literal("a $b$ c") == r"a \$b\$ c"
