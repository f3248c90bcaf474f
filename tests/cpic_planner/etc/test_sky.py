"""The sky of a prediction is the sky of the images."""

from dataclasses import replace

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


@pytest.mark.parametrize("sky", [{}, {"model": "uniform"}, {"season": "date"}])
def test_sky_is_that_of_the_images(sky):
    """Per open pixel of the hole: a star too faint to matter leaves the sky alone."""
    instrument = {"sky": sky}
    rates, model = predicted(instrument, "tau Cet")
    place = find_target("tau Cet")[0]
    star = {"v_mag": 39.0, "teff_k": 5800, "ra_deg": place.ra_deg.item(), "dec_deg": place.dec_deg.item()}
    seen = observe({"name": "s", "cstar": star}, band="F662", exposure_s=1.0, window="hole", instrument=instrument)
    metrics = model.metrics["F662"]
    assert rates.shape == (1,)
    assert rates[0] == pytest.approx(np.median(seen.mean_rate_map[metrics.hole]) * metrics.aperture_pixels, rel=1e-3)


def test_zodiacal_sky_is_each_targets_own():
    rates, _ = predicted(None, "tau Cet", "eps Eri", "61 Cyg A")
    uniform, _ = predicted({"sky": {"model": "uniform"}}, "tau Cet")
    assert rates.shape == (3,)
    assert len(set(rates)) == 3
    assert (rates < uniform).all()  # 21 mag/arcsec2 is brighter than the sky away from the ecliptic


def test_the_sky_of_a_date_is_that_of_the_targets():
    """The median is the same at every date; Arcturus stands opposite the Sun in April, beside it in October."""
    rates = {}
    for season in ("median", "date"):
        model = build_model(load_instrument({"sky": {"season": season}}), ("F662",), Strategy())
        for date in ("2028-04-20", "2028-10-20"):
            target = find_target("Arcturus", date_utc=date)[0]
            rates[season, date] = aperture_sky_e_s(model, target, "F662")[0]
    assert rates["median", "2028-04-20"] == pytest.approx(rates["median", "2028-10-20"], rel=1e-4)
    assert rates["date", "2028-10-20"] > 2.0 * rates["date", "2028-04-20"]


def test_a_sky_of_22_mag_in_closed_form():
    """Photons of V = 22 in F662 and a square arcsecond, the clear disc, losses and aperture, to 5 %."""
    named = {"model": "uniform", "brightness_v_mag_arcsec2": 22.0}
    rates, model = predicted({"sky": named}, "tau Cet")
    metrics, band = model.metrics["F662"], model.instrument.bands["F662"]
    # Sun: V-R of Cousins 0.352 (Ramirez et al. 2012); 702 ph/s/cm2/A at R = 0 (Bessell 1998), 641 nm.
    photons = 702.0 * 10.0 ** (-0.4 * (22.0 - 0.352)) * 10.0 * band.width_nm * np.pi * 100.0**2
    solid_angle = np.pi * metrics.aperture_radius_arcsec**2
    expected = photons * band.t_opt * band.qe * solid_angle * metrics.apodizer_energy
    assert rates[0] == pytest.approx(expected, rel=0.05)


def test_a_star_without_coordinates_gets_the_median_of_the_sky():
    model = build_model(load_instrument(), ("F662",), Strategy())
    star = find_target("tau Cet")[0]
    nowhere = replace(star, ra_deg=np.array([np.nan]), dec_deg=np.array([np.nan]))
    middle = replace(star, ra_deg=np.array([180.0]), dec_deg=np.array([-32.86]))  # about 30 degrees from the ecliptic
    rates = [aperture_sky_e_s(model, target, "F662")[0] for target in (nowhere, middle)]
    assert rates[0] == pytest.approx(rates[1], rel=0.01)


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
