"""Figures, sentences and files of contrast curves and operating characteristics."""

import base64
import csv
import io

import numpy as np
import pytest

from cpic_planner import contrast_curve, roc_curve
from cpic_planner.report.drawing import new_figure, power_ticks
from cpic_planner.report.searches import (
    completeness_csv,
    curve_figure,
    curve_pictures,
    curve_sentences,
    roc_figure,
    roc_pictures,
    roc_sentences,
)
from cpic_planner.results import RecoveredRow


@pytest.fixture(scope="module")
def plain():
    return contrast_curve("tau Cet", bands=["F662"], time_s=36000.0, separation_arcsec=[0.45, 0.6, 0.7])


@pytest.fixture(scope="module")
def imaged(plain):
    """The same, as if images had been measured: the limits 5 % higher, planets found half of the time."""
    points = [
        row.model_copy(
            update={
                "measured_limit": 1.05 * row.contrast_limit_threshold,
                "measured_limit_error": 0.1 * row.contrast_limit_threshold,
                "measured_throughput": 0.98,
            }
        )
        for row in plain.points
    ]
    share = {"recovered": 0.5, "recovered_low": 0.4, "recovered_high": 0.6, "predicted": 0.45}
    about = {"separation_arcsec": 0.6, "contrast": 2e-9, "n_injected": 20, "n_recovered": 10}
    recovered = [RecoveredRow(band=band, **about, **share) for band in ("F662",)]
    bands = [one.model_copy(update={"images": 20}) for one in plain.bands]
    update = {"points": points, "recovered": recovered, "images": 20, "injections": 20, "bands": bands}
    return plain.model_copy(update=update)


@pytest.fixture(scope="module")
def roc():
    return roc_curve("tau Cet", bands=["F662"], contrast=2e-9, separation_arcsec=0.6, time_s=36000.0)


@pytest.fixture(scope="module")
def counted(roc):
    """The same, as if 50 images had been searched and shown what is expected."""
    levels = []
    for row in roc.levels:
        hits = round(50 * row.detection_probability)
        share = {"recovered": hits / 50, "recovered_low": 0.9 * hits / 50, "recovered_high": min(1.1 * hits / 50, 1.0)}
        seen = {"n_searches": 50, "n_planets": 50, "n_detected": hits, "n_false": round(50 * row.false_alarms)}
        levels.append(row.model_copy(update=share | seen))
    return roc.model_copy(update={"levels": levels, "images": 50})


def test_pictures_are_drawings_with_words(imaged, counted):
    pictures = curve_pictures(imaged) | roc_pictures(counted)
    assert set(pictures) == {"curves", "maps", "recovered", "roc", "alarms"}
    for drawn in pictures.values():
        svg = base64.b64decode(drawn.uri.split(",", 1)[1]).decode()
        assert drawn.uri.startswith("data:image/svg+xml;base64,")
        assert "<dc:date>" not in svg
        assert len(svg) < 400_000
        assert drawn.alt.endswith(".")
        assert drawn.caption.endswith(".")


def test_without_images_there_is_nothing_of_them(plain, roc):
    assert set(curve_pictures(plain)) == {"curves", "maps"}
    assert set(roc_pictures(roc)) == {"roc"}


def test_figures_show_every_curve_and_every_point(imaged, counted):
    axes = curve_figure(imaged).axes
    curves, labels = axes[0], [text.get_text() for text in axes[0].get_legend().get_texts()]
    assert {"F662", "half found blind", "at the threshold", "measured in 20 images"} <= set(labels)
    lines = {(len(line.get_xdata()), line.get_linestyle()) for line in curves.get_lines()}
    assert (3, "-") in lines
    shown = np.concatenate([np.asarray(line.get_ydata(), float) for line in curves.get_lines()])
    for row in imaged.points:
        for limit in (row.contrast_limit_blind, row.contrast_limit_threshold, row.measured_limit):
            assert np.isclose(shown, limit, rtol=1e-12).any()
    low, high = curves.get_ylim()
    assert low < shown.min() < shown.max() < high
    left, right = roc_figure(counted).axes
    assert left.get_xscale() == "log"
    five = next(row for row in counted.levels if row.sigma == 5.0)
    rings = np.concatenate([item.get_offsets() for item in left.collections if len(item.get_offsets()) == 1])
    assert np.isclose(rings, (five.false_alarms, five.detection_probability)).all(axis=1).any()
    assert right.get_xlim() == right.get_ylim()


def test_one_separation_is_drawn_too():
    alone = contrast_curve("tau Cet", bands=["F662"], time_s=36000.0, separation_arcsec=0.6)
    figure = curve_figure(alone)
    figure.draw_without_rendering()
    assert len(figure.axes) == 2


def test_sentences_say_what_the_numbers_say(imaged, counted):
    said = " ".join(curve_sentences(imaged))
    assert "In 20 simulated images the limit at the threshold is 1.1 times the predicted one" in said
    assert "Of 20 injected planets blind searches find 10; the law of detection expects 9." in said
    best = min(row.contrast_limit_blind for row in imaged.points if row.band == "F662")
    assert f"F662: half of the planets of contrast {best:.1e}" in said
    five = next(row for row in counted.levels if row.sigma == 5.0)
    told = " ".join(roc_sentences(counted))
    assert f"find it in {five.n_detected}, and have 0 false alarms in 50 without it" in told


def test_a_band_without_a_limit_says_why():
    outside = contrast_curve("tau Cet", bands=["F662"], time_s=36000.0, separation_arcsec=0.1)
    (said,) = curve_sentences(outside)
    assert said.startswith("F662: no limit: ")
    curve_figure(outside).draw_without_rendering()


def test_the_file_of_the_map_has_every_cell(plain):
    rows = list(csv.DictReader(io.StringIO(completeness_csv(plain))))
    assert len(rows) == sum(len(one.separation_arcsec) * len(one.contrast) for one in plain.maps)
    (one,) = plain.maps
    cell = next(row for row in rows if float(row["contrast"]) == one.contrast[-1])
    assert float(cell["chance"]) == one.chance[0][-1]
    assert float(cell["azimuth_share"]) == one.azimuth_share[0]


def test_every_line_of_the_legend_is_seen_and_the_figure_fits_a_page(plain):
    """Where planets are found blind as faint as at a known place, the dashes stand on a pale line and not below it."""
    figure = curve_figure(plain)
    curves = figure.axes[0]
    handles = {text.get_text(): handle for text, handle in _legend(curves)}
    blind, known = handles["half found blind"], handles["half found at a known place"]
    assert blind.get_linewidth() > 2 * known.get_linewidth()
    assert blind.get_alpha() < 0.6
    lines = curves.get_lines()
    for band in {row.band for row in plain.points}:
        rows = [row for row in plain.points if row.band == band]
        wide, dashed = (
            next(i for i, line in enumerate(lines) if _draws(line, rows, name, width))
            for name, width in (
                ("contrast_limit_blind", blind.get_linewidth()),
                ("contrast_limit_known_place", known.get_linewidth()),
            )
        )
        assert wide < dashed  # what comes later is drawn on top
    width, height = figure.get_size_inches()
    assert height / width < 1.15  # 7 inches of text take at most 8.1 inches of a page of 9
    for panel in figure.axes[1:]:
        if panel.get_title():
            assert panel.get_title() in {one.band for one in plain.bands}
            assert "half found on the diagonal" in [text.get_text() for text, _ in _legend(panel)]


def _legend(axes):
    legend = axes.get_legend()
    return list(zip(legend.get_texts(), legend.legend_handles, strict=True))


def _draws(line, rows, name, width):
    values = [getattr(row, name) for row in rows]
    return line.get_linewidth() == width and np.allclose(np.asarray(line.get_ydata(), float), values, equal_nan=True)


@pytest.mark.parametrize(
    ("ends", "written"),
    [
        ((9e-10, 2e-8), ["10^{-9}", "10^{-8}"]),
        ((3e-10, 4e-6), ["10^{-9}", "10^{-8}", "10^{-7}", "10^{-6}"]),
        ((3e-9, 8e-9), [rf"{n} \times 10^{{-9}}" for n in range(3, 9)]),
        ((3e-9, 4e-8), [r"5 \times 10^{-9}", "10^{-8}", r"2 \times 10^{-8}"]),
    ],
)
def test_powers_of_ten_are_written_plainly(ends, written):
    """Multiples of them stand only where there are fewer than two powers."""
    figure = new_figure(3.0)
    axes = figure.add_subplot()
    axes.set(yscale="log", ylim=ends)
    power_ticks(axes.yaxis)
    figure.draw_without_rendering()
    places = zip(axes.yaxis.get_majorticklocs(), axes.yaxis.get_majorticklabels(), strict=True)
    assert [label.get_text() for at, label in places if ends[0] <= at <= ends[1]] == [f"${text}$" for text in written]
