import base64
import math

import numpy as np
import pytest

from cpic_planner.report import write_figure
from cpic_planner.report.image_figures import albedo_figure, albedo_picture
from cpic_planner.validation import fit_albedo
from cpic_planner.validation.albedo_fit import albedo_model
from simulator import load_instrument
from simulator.passbands import Passbands
from simulator.target import stellar_spectrum

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


def fitted(model, relative, bands=None, **settings):
    values = model.contrast(*TRUTH)
    chosen = bands or model.bands
    measured = {name: (values[i], relative * values[i]) for i, name in enumerate(model.bands) if name in chosen}
    return fit_albedo(measured, model, **settings)


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
    grey = fit_albedo({"F520": (9e-8, 1e-9), "F850": (7e-8, 1e-9), "F662": (9e-8, 1e-9)}, model, grey_error=0.3)
    assert f"common factor {grey.grey:.2f}" in albedo_figure(grey, model).axes[1].get_title()


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
