"""The sky of a prediction is the sky of the images."""

import numpy as np
import pytest
from astropy.io import fits

from cpic_planner.etc import build_model
from cpic_planner.etc.rates import aperture_sky_e_s
from cpic_planner.queries import Strategy
from cpic_planner.targets import as_catalogue, find_target, targets_from_table
from simulator import load_instrument, observe


def predicted(instrument, *names):
    model = build_model(load_instrument(instrument), ("F662",), Strategy())
    table = as_catalogue("snapshot").table
    places = [int(np.flatnonzero(table.column("name") == find_target(name)[0].name[0])[0]) for name in names]
    return aperture_sky_e_s(model, targets_from_table(table.select(places)), "F662"), model


def test_uniform_sky_is_that_of_the_images():
    """Per open pixel of the hole: a star too faint to matter leaves the sky alone."""
    rates, model = predicted(None, "tau Cet")
    seen = observe({"name": "s", "cstar": {"v_mag": 39.0, "teff_k": 5800}}, band="F662", exposure_s=1.0, window="hole")
    metrics = model.metrics["F662"]
    assert rates.shape == (1,)
    assert rates[0] == pytest.approx(np.median(seen.mean_rate_map[metrics.hole]) * metrics.aperture_pixels, rel=1e-3)


def test_zodiacal_sky_is_each_targets_own():
    rates, _ = predicted({"sky": {"model": "zodiacal"}}, "tau Cet", "eps Eri", "61 Cyg A")
    uniform, _ = predicted(None, "tau Cet")
    assert rates.shape == (3,)
    assert len(set(rates)) == 3
    assert (rates < uniform).all()  # 21 mag/arcsec2 is brighter than the sky away from the ecliptic


def test_stray_light_counts_in_the_aperture(refused, tmp_path):
    without, model = predicted(None, "tau Cet")
    number, _ = predicted({"sky": {"stray_light": {"rate_e_s": 0.5}}}, "tau Cet")
    assert number - without == pytest.approx(0.5 * model.metrics["F662"].aperture_pixels)
    unit = fits.PrimaryHDU(np.full((1050, 1080), 0.25))
    unit.header["BUNIT"] = "electron / s"
    unit.writeto(tmp_path / "stray.fits")
    mapped, _ = predicted({"sky": {"stray_light": {"map_file": str(tmp_path / "stray.fits")}}}, "tau Cet")
    assert mapped - without == pytest.approx(0.25 * model.metrics["F662"].aperture_pixels)
    refused(r"stray", predicted, {"sky": {"stray_light": {"rate_e_s": -1}}}, "tau Cet")


def test_stray_light_of_a_map_is_that_under_the_hole(tmp_path):
    """A slope along rows and another along columns, and the hole laid on the frame around the star."""
    rows, columns = np.mgrid[:1050, :1080]
    slopes = fits.PrimaryHDU(1e-3 * rows + 1e-5 * columns)
    slopes.header["BUNIT"] = "electron / s"
    slopes.writeto(tmp_path / "slopes.fits")
    without, model = predicted(None, "tau Cet")
    mapped, _ = predicted({"sky": {"stray_light": {"map_file": str(tmp_path / "slopes.fits")}}}, "tau Cet")
    metrics, detector = model.metrics["F662"], model.instrument.detector
    half = len(metrics.hole) // 2
    under = np.zeros((1050, 1080), bool)
    row, column = detector.star_row - half, detector.star_column - half
    under[row : row + len(metrics.hole), column : column + len(metrics.hole)] = metrics.hole
    assert mapped - without == pytest.approx(slopes.data[under].mean() * metrics.aperture_pixels, rel=1e-9)
