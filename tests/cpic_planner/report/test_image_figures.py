import base64
import math
import re

import numpy as np
import pytest

from cpic_planner.report import write_figure
from cpic_planner.report.image_figures import (
    Panels,
    albedo_figure,
    albedo_picture,
    compass,
    residual_limit,
    spectrum_figure,
    stack_scale,
)
from cpic_planner.validation import fit_albedo
from cpic_planner.validation.albedo_fit import albedo_model
from simulator.config import load_instrument, load_scene
from simulator.imaging import HoleZone
from simulator.passbands import Passbands
from simulator.target import stellar_spectrum
from tests.cpic_planner.measured import band


def _panels(**changes):
    image = np.zeros((5, 7))
    values = {
        "band": "F520",
        "science": image,
        "reference": image,
        "residual": image,
        "pixel_scale_arcsec": 0.1,
        "aperture_radius_arcsec": 0.04,
        "zone": HoleZone(0.05, 0.25),
    }
    return Panels(**(values | changes))


def test_compass_of_the_default_detector_is_north_up_east_left():
    north, east = compass(-1)
    assert north == pytest.approx((0.0, 1.0), abs=1e-12)
    assert east == pytest.approx((-1.0, 0.0), abs=1e-12)


def test_compass_of_the_mirrored_detector_is_north_up_east_right():
    north, east = compass(1)
    assert north == pytest.approx((0.0, 1.0), abs=1e-12)
    assert east == pytest.approx((1.0, 0.0), abs=1e-12)


def test_roll_turns_the_compass():
    # A roll of 90 deg brings PA 90 (east) to +y; with parity -1 the PA 0 direction is then at +x.
    north, east = compass(-1, 90.0)
    assert north == pytest.approx((1.0, 0.0), abs=1e-12)
    assert east == pytest.approx((0.0, 1.0), abs=1e-12)


def test_geometry():
    panels = _panels()
    assert panels.star_pixel == (3.0, 2.0)
    assert panels.extent_arcsec == pytest.approx((-0.35, 0.35, -0.25, 0.25))
    hole = panels.inside_hole()
    assert hole.sum() == 16  # offsets of one or two pixels in x and in y, four quadrants
    assert not hole[2].any()
    assert not hole[:, 3].any()
    assert not hole[:, [0, 6]].any()


@pytest.mark.parametrize(
    "changes",
    [
        {"science": np.zeros(3)},
        {"residual": np.zeros((2, 2))},
        {"pixel_scale_arcsec": 0.0},
        {"aperture_radius_arcsec": float("nan")},
        {"parity": 0},
    ],
)
def test_bad_panels_are_refused(refused, changes):
    refused("", _panels, **changes)


def test_scales_come_from_the_hole(panels):
    one = next(iter(panels.values()))
    hole = one.inside_hole()
    low, high, width = stack_scale(one)
    assert one.science[hole].min() <= low < high <= max(one.science[hole].max(), one.reference[hole].max())
    assert 0 < width < high - low
    limit, sigma = residual_limit(one), np.nanstd(one.residual[hole])
    assert 4 * sigma < limit < 9 * sigma


def test_scales_of_empty_and_constant_images_are_usable():
    nothing = np.full((5, 7), np.nan)
    for image in (np.zeros((5, 7)), nothing):
        low, high, width = stack_scale(_panels(science=image, reference=image))
        assert low < high
        assert width > 0
        assert residual_limit(_panels(residual=image)) > 0


TRUTH = (1.0, -0.5)


@pytest.fixture(scope="module")
def model():
    passbands = Passbands.from_instrument(load_instrument())
    return albedo_model(
        passbands.bands[:4],
        stellar_spectrum(1.35, "K1V"),
        radius_rjup=1.0,
        distance_au=0.8775,
        phase_deg=90.0,
        insolation_au=2.0,
    )


def fitted(model, relative, bands=None):
    values = model.contrast(*TRUTH)
    chosen = bands or model.bands
    measured = {name: (values[i], relative * values[i]) for i, name in enumerate(model.bands) if name in chosen}
    return fit_albedo(measured, model)


@pytest.fixture(scope="module")
def fit(model):
    return fitted(model, 0.03)


@pytest.fixture(scope="module")
def spectrum():
    wavelength = np.linspace(400.0, 1000.0, 301)
    return wavelength, 5e-8 + 1e-8 * np.sin(wavelength / 40.0)


def test_regions_are_those_of_the_fit(model, fit):
    posterior, _ = albedo_figure(fit, model, truth=TRUTH).axes
    filled = posterior.collections[0]
    assert list(filled.levels[:2]) == [fit.level(0.95), fit.level(0.68)]
    marks = {line.get_label(): line.get_xydata()[0] for line in posterior.lines}
    assert marks["truth"] == pytest.approx(TRUTH)
    assert marks["best fit"] == pytest.approx((fit.log10_mh, fit.log10_fsed))
    assert posterior.get_xlim() == (fit.log10_mh_grid[0], fit.log10_mh_grid[-1])


def test_contrasts_stand_where_they_were_measured(model, fit, spectrum):
    _, contrasts = albedo_figure(fit, model, spectrum=spectrum).axes
    bars = contrasts.containers
    assert len(bars) == 4
    for bar, wavelength, value, error in zip(bars, model.wavelength_nm, fit.contrasts, fit.errors, strict=True):
        assert bar.lines[0].get_xydata()[0] == pytest.approx([wavelength, value * 1e8])
        upright = bar.lines[2][1].get_segments()[0]
        assert np.ptp(upright[:, 1]) == pytest.approx(2 * error * 1e8)
    drawn = next(line for line in contrasts.lines if line.get_label() == "input spectrum").get_xydata()
    assert drawn[:, 1] == pytest.approx(1e8 * np.interp(drawn[:, 0], *spectrum))
    assert "10^{-8}" in contrasts.get_ylabel()


def test_it_says_what_is_open(model, fit):
    tight, loose, one = fitted(model, 0.004), fitted(model, 0.5), fitted(model, 0.1, bands=("F520",))
    assert "both constrained\nwithin the ranges" in albedo_figure(tight, model).axes[0].get_title()
    assert "not constrained\nopen at low and high [M/H]" in albedo_figure(loose, model).axes[0].get_title()
    degenerate = albedo_figure(one, model, truth=TRUTH)
    assert "degenerate" in degenerate.axes[0].get_title()
    assert "best fit" not in {line.get_label() for line in degenerate.axes[0].lines}
    assert "of 1 band" in degenerate.axes[1].get_title()


def test_nothing_overlaps_or_leaves_the_figure(model, spectrum):
    for fit in (fitted(model, 0.03), fitted(model, 0.5)):
        figure = albedo_figure(fit, model, truth=TRUTH, spectrum=spectrum)
        left, right = (axes.get_tightbbox() for axes in figure.axes)
        assert left.x1 < right.x0 + 1
        assert left.x0 >= -1
        assert right.x1 <= figure.bbox.width + 1
        for axes in figure.axes:
            assert axes.get_legend().get_window_extent().y1 < axes.get_window_extent().y0


def test_picture_is_the_same_every_time(model, fit, tmp_path):
    one, again = (albedo_picture(fit, model, truth=TRUTH) for _ in range(2))
    assert one == again
    assert base64.b64decode(one.uri.split(",")[1]).startswith(b"<?xml")
    low, high = fit.interval("log10_mh")
    assert f"{low:.2f} to {high:.2f}" in one.caption
    assert "F520, F662, F720, F850" in one.alt
    path = write_figure(albedo_figure(fit, model), tmp_path / "albedo.png")
    assert path.stat().st_size > 5000


def test_a_spectrum_has_two_equal_columns(refused, model, fit):
    refused("spectrum", albedo_figure, fit, model, spectrum=([500.0, 600.0], [1e-8]))
    # Gaps in the spectrum are left out, not drawn and not in the way.
    figure = albedo_figure(fit, model, spectrum=([450.0, 600.0, 900.0], [1e-8, math.nan, 1e-8]))
    assert np.isfinite(figure.axes[1].get_ylim()).all()


SCENE = {
    "name": "s",
    "cstar": {"v_mag": 4.0, "teff_k": 5500, "distance_pc": 4.0},
    "planets": [
        {"name": "b$", "radius_rjup": 1, "phase_deg": 90, "separation_arcsec": 0.5, "pa_deg": 10, "albedo": "jupiter"},
        {"name": "c", "radius_rjup": 0.4, "phase_deg": 90, "separation_arcsec": 0.6, "pa_deg": 20, "albedo": 0.3},
    ],
}


def drawn_words(picture):
    return re.findall(r"<!-- (.*?) -->", base64.b64decode(picture.uri.split(",", 1)[1]).decode())


def measured(planet, name, contrast):
    return band(
        name,
        planet=planet,
        true_contrast=contrast,
        recovered_contrast=1.1 * contrast,
        contrast_error=0.2 * contrast,
        contrast_mean_error=0.07 * contrast,
    )


def test_every_planet_with_a_measurement_is_drawn():
    bands = [measured("b$", "F520", 1e-8), measured("b$", "F850", 6e-9), measured("c", "F520", 8e-10)]
    picture = spectrum_figure(load_scene(SCENE), load_instrument(), bands)
    words = drawn_words(picture)
    assert {"b$: input", "b$: recovered", "c: recovered", "input in the band"} <= set(words)
    assert "of b$, c in 3 measurements" in picture.alt
    one = spectrum_figure(load_scene(SCENE), load_instrument(), bands[:2])
    assert not any("c: recovered" in word for word in drawn_words(one))
    assert one.uri == spectrum_figure(load_scene(SCENE), load_instrument(), bands[:2]).uri


def test_nothing_measured_is_no_picture():
    refused = measured("b$", "F520", 1e-8).model_copy(update={"recovered_contrast": None})
    assert spectrum_figure(load_scene(SCENE), load_instrument(), [refused]) is None
    assert spectrum_figure(load_scene(SCENE), load_instrument(), []) is None
