""""""

import base64
import io
import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from cpic_planner.report import drawing, new_figure, place_labels, style
from cpic_planner.report.drawing import band_style, literal, save
from cpic_planner.report.image_figures import Mark, PanelSheet, shown_in_both_lights, snr_figure, tick_labels
from cpic_planner.report.plan import plan_figures
from cpic_planner.report.ranking_figures import contrast_diagram, map_longitude, margin_figure, marker_area, sky_map
from cpic_planner.report.whatif_figures import detections_figure, differences_figure, time_figure, yields_figure


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


@pytest.mark.long
def test_same_bytes_twice(plan, rank, limits, holes, panels, pictures):
    again = plan_figures(plan, rank, limits=limits, holes=holes)
    assert {key: picture.uri for key, picture in again.items()} == {
        key: picture.uri for key, picture in pictures.items()
    }
    one = next(iter(panels.values()))
    assert PanelSheet().picture(one, "* tau Cet").uri == PanelSheet().picture(one, "* tau Cet").uri


def test_the_users_settings_neither_matter_nor_change(rank):
    import matplotlib as mpl

    before = margin_figure(rank).uri
    with mpl.rc_context({"font.size": 30.0, "axes.facecolor": "red", "svg.hashsalt": "x"}):
        assert margin_figure(rank).uri == before
        assert mpl.rcParams["font.size"] == 30.0


def test_panel_picture_is_a_palette_png_wide_enough(panels):
    picture = PanelSheet().picture(next(iter(panels.values())), "* tau Cet")
    data = content(picture)
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert size_px(picture)[0] >= 900
    assert data[25] == 3  # colour type: palette
    assert b"tEXt" not in data
    assert b"tIME" not in data
    assert len(data) < 160_000


@pytest.mark.parametrize("form", ["svg", "png"])
def test_a_figure_without_a_canvas_of_its_own_is_saved(form):
    """Scripts of reports draw on plain figures."""
    figure = Figure(figsize=(2.0, 1.0))
    figure.subplots().plot([0.0, 1.0])
    picture = save(figure, form, alt="a line", caption="")
    assert len(picture.uri) > 500


def test_a_picture_in_both_lights_is_the_same_pixels_and_turns_all_but_the_images(panels):
    """Places of the images: where the picture has colours."""
    picture = PanelSheet().picture(next(iter(panels.values())), "* tau Cet")
    shown = shown_in_both_lights(picture)
    tree = ElementTree.fromstring(content(shown).decode())
    space = "{http://www.w3.org/2000/svg}"
    assert tree.find(f"{space}image").get("href") == picture.uri
    assert (shown.alt, shown.caption, shown.width_px) == (picture.alt, picture.caption, picture.width_px)
    assert shown_in_both_lights(shown) is shown
    pixels = np.asarray(Image.open(io.BytesIO(content(picture))).convert("RGB"), float)
    coloured = np.ptp(pixels, axis=2) > 16
    kept, near, (rows, columns) = np.zeros(coloured.shape, bool), np.zeros(coloured.shape, bool), coloured.shape
    for x, y, wide, high in re.findall(r"M(\S+) (\S+)h(\d\S*?)v(\d\S*?)h-", tree.find(f"{space}path").get("d")[9:]):
        top, bottom = (round(share * rows) for share in (float(y), float(y) + float(high)))
        left, right = (round(share * columns) for share in (float(x), float(x) + float(wide)))
        kept[top:bottom, left:right] = True
        near[top - 2 : bottom + 2, left - 2 : right + 2] = True
    assert coloured[kept].mean() > 0.5
    assert not coloured[~near].any()


def test_a_picture_does_not_depend_on_those_before_it_on_the_same_sheet(panels):
    one, other = list(panels.values())[:2]
    marks = Mark(-0.5, 0.35), Mark(-0.4, 0.3, "star", "a star"), Mark(0.3, -0.4, "candidate")
    marked = replace(one, marks=marks)
    small = replace(other, science=1e6 * other.science, zone=replace(other.zone, outer_arcsec=0.5), roll_deg=40.0)
    sheet = PanelSheet()
    first, second, third, *again = [sheet.picture(each, "* tau Cet").uri for each in (marked, small, one, marked, one)]
    assert [first, second, third] == [PanelSheet().picture(each, "* tau Cet").uri for each in (marked, small, one)]
    assert again == [first, third]
    assert len({first, second, third}) == 3


@pytest.mark.parametrize(
    ("outer_arcsec", "factor"),
    [
        (0.21, 3e7),
        (0.707, 1.0),
        (12.0, 1e-9),
        *(pytest.param(*one, marks=pytest.mark.long) for one in ((0.21, 1e-9), (0.45, 1.0), (12.0, 3e7))),
    ],
)
def test_words_of_the_panels_stay_inside_and_apart(panels, outer_arcsec, factor):
    one = next(iter(panels.values()))
    # a pixel scale of its own, so that the hole holds the same pixels
    ratio = outer_arcsec / one.zone.outer_arcsec
    scaled = replace(
        one,
        pixel_scale_arcsec=ratio * one.pixel_scale_arcsec,
        zone=replace(one.zone, inner_arcsec=ratio * one.zone.inner_arcsec, outer_arcsec=outer_arcsec),
        **{name: factor * getattr(one, name) for name in ("science", "reference", "residual")},
    )
    sheet, kept = PanelSheet(), []
    sheet.picture(scaled, "* tau Cet")
    figure = sheet._figure
    page = figure.bbox
    for axes in figure.axes:
        words = [axes.title, axes.xaxis.label, axes.yaxis.label]
        for axis in (axes.xaxis, axes.yaxis):
            low, high = axis.get_view_interval()
            words += [tick.label1 for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
        boxes = [word.get_window_extent() for word in words if word.get_visible() and word.get_text()]
        assert boxes
        for box in boxes:
            assert page.x0 <= box.x0 <= box.x1 <= page.x1
            assert page.y0 <= box.y0 <= box.y1 <= page.y1
            assert not any(box.overlaps(other) for other in kept)
            kept.append(box)


@pytest.mark.parametrize(
    ("ticks", "labels", "power"),
    [
        ([390.0, 640.0, 1080.0], ["390", "640", "1080"], ""),
        ([-0.15, 0.0, 0.15], ["−0.15", "0.00", "0.15"], ""),
        ([-1.5e-3, 0.0, 1.5e-3], ["−1.5", "0.0", "1.5"], "10⁻³ "),
        ([3.8e7, 6.3e7, 1.04e8, 1.7e8], ["0.38", "0.63", "1.04", "1.70"], "10⁸ "),
        ([1000.0, 1000.5], ["1000.0", "1000.5"], ""),
        ([0.0], ["0"], ""),
        ([], [], ""),
    ],
)
def test_ticks_of_a_colour_bar(ticks, labels, power):
    assert tick_labels(ticks) == (labels, power)


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


def drawn_words(picture):
    """Texts of a drawing: glyphs carry them as comments."""
    return re.findall(r"<!-- (.*?) -->", content(picture).decode())


def test_recovered_snr_has_the_error_of_its_mean_and_the_mean_ratio_its_band(plan):
    words = drawn_words(snr_figure(plan))
    assert "recovered = predicted" in words
    assert {"predicted over recovered", "1.03 ± 0.04"} <= set(words)
    assert snr_figure(plan).caption.startswith(
        "Each symbol is one planet in one band: the mean of up to 8 realisations"
    )
    assert "(5 %)" in snr_figure(plan).caption
    # without errors the same points are drawn, without bars
    bare = [band.model_copy(update={"recovered_snr_error": None}) for band in plan.targets[0].bands]
    target = plan.targets[0].model_copy(update={"bands": bare})
    assert snr_figure(plan.model_copy(update={"targets": [target]})).uri != snr_figure(plan).uri


def test_snr_of_a_scene_counts_its_measurements(confirmation):
    assert "of 4 measurements" in snr_figure(confirmation).alt  # one of five is outside the field


def test_marks_are_drawn_where_they_are(panels):
    one = next(iter(panels.values()))
    plain = PanelSheet().picture(one, "* tau Cet")
    marked = replace(
        one, marks=(*one.marks, Mark(-0.4, 0.3, "star", "a $tar"), Mark(0.3, -0.4, "candidate"), Mark(9.0, 9.0, "star"))
    )
    assert PanelSheet().picture(marked, "* tau Cet").uri != plain.uri
    outside = replace(one, marks=(*one.marks, Mark(9.0, 9.0, "star", "far")))
    assert PanelSheet().picture(outside, "* tau Cet").uri == plain.uri
    empty = replace(one, marks=())
    assert "there is no planet" in PanelSheet().picture(empty, "* tau Cet").alt
    assert "the planet is at x 0.35, y 0.35 arcsec" in plain.alt


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


@pytest.mark.parametrize("spread", [1.0, 20.0])
def test_the_points_decide_the_frame_and_no_error_bar_does(plan, spread, monkeypatch):
    """One long bar does not push all points into a corner: the axes end near the points."""
    made = []
    monkeypatch.setattr(drawing, "new_figure", lambda height: made.append(new_figure(height)) or made[-1])
    bands = [
        band.model_copy(
            update={"predicted_snr": 3.0 * factor, "recovered_snr": 2.9 * factor, "recovered_snr_error": error}
        )
        for band, factor, error in zip(plan.targets[0].bands, (1, 1.5, 4, spread), (2.85, 0.1, 0.1, 0.1), strict=True)
    ]
    target = plan.targets[0].model_copy(update={"bands": bands})
    snr_figure(plan.model_copy(update={"targets": [target]}))
    (axes,) = made[0].axes
    for (low, high), least, most in (
        (axes.get_xlim(), 3.0, 3.0 * max(4.0, spread)),
        (axes.get_ylim(), 2.9, 2.9 * max(4.0, spread)),
    ):
        assert low in (0.0, pytest.approx(least / 1.4))
        assert most < high <= 1.4 * most * (1 + 1e-9)


def test_the_dashed_line_is_the_inverse_of_what_its_label_says(plan, monkeypatch):
    """The label says predicted over recovered; the figure has recovered against predicted."""
    made = []
    monkeypatch.setattr(drawing, "new_figure", lambda height: made.append(new_figure(height)) or made[-1])
    snr_figure(plan)
    (line,) = (line for line in made[0].axes[0].lines if "predicted over recovered" in str(line.get_label()))
    assert line.get_ydata()[1:] / line.get_xdata()[1:] == pytest.approx(1.0 / plan.calibration["etc_ratio"])
