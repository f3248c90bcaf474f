"""Three separations near the star, each by one definition and one number in pages, reports, products and refusals."""

import functools
import re
from pathlib import Path

import numpy as np
import pytest
import scipy

from cpic_core import Status
from cpic_planner.etc import build_model, place_status, usable_range_arcsec
from simulator import load_instrument, single_band_psf
from simulator.observing.observation import _optics_keywords

ROOT = Path(__file__).parents[2]
INSTRUMENT = load_instrument()
BANDS = INSTRUMENT.visible_bands()
INNER_WORKING_ANGLE = re.compile(r"inner working angle|\bIWA\b")


@functools.cache
def core_of(band):
    """Core throughput on the diagonal, mask included, and the separations."""
    separation = np.linspace(0.05, 0.95, 2000)
    offset = separation / np.sqrt(2.0)
    return separation, build_model(INSTRUMENT, [band]).metrics[band].core_throughput(offset, offset)


def iwa_arcsec(band):
    separation, core = core_of(band)
    above = int(np.argmax(core > 0.5 * core.max()))
    crossing = scipy.interpolate.interp1d(core[above - 2 : above + 2], separation[above - 2 : above + 2])
    return float(crossing(0.5 * core.max()))


def corner_arcsec(band):
    """4.3 lambda/D of a telescope of 2 m."""
    return 4.3 * INSTRUMENT.band(band).center_nm * 1e-9 / 2.0 * 180.0 * 3600.0 / np.pi


def closest_arcsec(band):
    """The corner, and an aperture of 0.7 lambda/D that touches both edges of the square."""
    return corner_arcsec(band) * (1.0 + 0.7 * np.sqrt(2.0) / 4.3)


def rows_of(path, *cells):
    """Cells of the rows of a page's tables that begin with some cells."""
    lines = [line.strip("| ").split(" | ") for line in (ROOT / path).read_text().splitlines() if line.startswith("| ")]
    return [line for line in lines if [re.sub(r"[`{}]|term", "", cell) for cell in line[: len(cells)]] == list(cells)]


@pytest.mark.parametrize("band", BANDS)
def test_each_is_worked_out_by_its_definition(band):
    metrics = build_model(INSTRUMENT, [band]).metrics[band]
    assert metrics.iwa_arcsec == pytest.approx(iwa_arcsec(band), abs=5e-4)
    assert metrics.hole_inner_corner_arcsec == pytest.approx(corner_arcsec(band), rel=1e-6)
    assert usable_range_arcsec(INSTRUMENT, band)[0] == pytest.approx(closest_arcsec(band), rel=1e-6)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("inner corner of the dark hole", corner_arcsec),
        ("inner working angle", iwa_arcsec),
        ("closest separation of a planet", closest_arcsec),
    ],
)
def test_the_page_on_the_dark_hole_has_all_three(name, value):
    ((_, *cells),) = rows_of("docs/explanation/dark_hole.md", name)
    assert [float(cell) for cell in cells] == pytest.approx([value(band) for band in BANDS], abs=5.1e-4)


@pytest.mark.parametrize("band", BANDS)
def test_reports_have_the_same(band):
    one = rows_of("reports/paper/psf_chromaticity/report.md", "cpic_default", "dark hole", band)[0]
    assert [float(cell) for cell in one[3:5]] == pytest.approx([corner_arcsec(band), iwa_arcsec(band)], abs=6e-4)
    (row,) = rows_of("reports/external/report.md", f"inner working angle (arcsec), {band}")
    assert float(row[2]) == pytest.approx(iwa_arcsec(band), abs=5e-4)


@pytest.mark.parametrize("page", ["docs/how_to/own_instrument.md"])
def test_the_corners_of_the_instruments(page):
    for preset in ("cpic_default", "cpic_2q"):
        ((_, _, corners),) = rows_of(page, preset)
        told = [float(text) for text in re.findall(r"0\.\d+", corners)[:4]]
        metrics = build_model(load_instrument(preset)).metrics.values()
        assert told == pytest.approx([one.hole_inner_corner_arcsec for one in metrics], abs=6e-4)


@pytest.mark.parametrize("band", BANDS)
def test_products_and_refusals_have_the_same(band):
    words = _optics_keywords(INSTRUMENT, band, single_band_psf(band))
    assert words["IWA"] == pytest.approx(iwa_arcsec(band), abs=5e-4)
    assert words["HOLEIN"] == pytest.approx(corner_arcsec(band), rel=1e-6)
    model, closest = build_model(INSTRUMENT, [band]), closest_arcsec(band)
    assert place_status(model, band, closest + 1e-6)[0] is Status.OK
    status, _, text = place_status(model, band, closest - 1e-4)
    assert status is Status.OUTSIDE_FIELD
    assert f"closest separation {closest:.3f} arcsec (diagonal)" in text


def test_no_page_gives_the_inner_working_angle_another_number():
    """Any number of arcsec beside the words is it in some band, or the published requirement of 0.19 arcsec."""
    known, seen = [0.19, *(iwa_arcsec(band) for band in BANDS)], 0
    pages = [ROOT / "README.template.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "simulator/presets").rglob("*.yaml")]
    for page in pages:
        for line in filter(INNER_WORKING_ANGLE.search, page.read_text().splitlines()):
            told = [float(text) for text in re.findall(r"\b0\.\d+", line)]
            seen += len(told)
            assert all(min(abs(one - right) for right in known) < 6e-4 for one in told), (page, line)
            assert "lambda/D" not in line, (page, line)
    assert seen >= 7
