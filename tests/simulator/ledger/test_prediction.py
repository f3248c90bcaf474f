"""Sizes of what images leave out of a visit, against images that have it."""

from copy import copy

import numpy as np
import pytest

from simulator.config import load_instrument, load_scene
from simulator.imaging import aperture_sums, overlap_weights, single_band_psf
from simulator.ledger import forecast
from simulator.ledger.inventory import LEFT_OUT
from simulator.ledger.visit import Visit, _left_out


def of_planet(separation, visits=1, pointing_mas=1.0, **star):
    place = {"separation_arcsec": separation, "pa_deg": 45.0, "radius_rjup": 1.0, "phase_deg": 90.0}
    bright = {"name": "s", "v_mag": 3.0, "teff_k": 5800, "distance_pc": 5.0}
    scene = load_scene({"name": "s", "cstar": bright | star, "planets": [place]})
    instrument = load_instrument({"drift": {"pointing_mas": pointing_mas}})
    how = {"band": "F520", "exposure_s": 10.0, "n_frames": 100, "em_gain": 300.0, "visits": visits}
    return forecast(scene, instrument, **how), Visit(scene, instrument, **how)


@pytest.fixture(scope="module")
def imager():
    return single_band_psf("F520", instrument=load_instrument()).imager


@pytest.mark.parametrize("separation", [0.45, 0.6, 0.8])
def test_what_images_leave_out_is_what_a_moved_and_a_wide_star_change(separation, imager):
    """Aperture sums of the star behind the mask, moved by 1 mas, and of a disc of 8 mas, at places of the annulus."""
    _, visit = of_planet(separation)
    figures = visit.metrics
    axis = imager.stamp_axis(masked=True)
    weights = overlap_weights(figures.aperture_radius_arcsec / figures.pixel_scale_arcsec)
    offset = (np.arange(len(figures.raw_contrast)) - len(figures.raw_contrast) // 2) * figures.pixel_scale_arcsec
    near = figures.zone.covers(offset, offset, -figures.aperture_radius_arcsec)
    near &= np.abs(np.hypot(offset[:, None], offset) - separation) < 1.5 * figures.lambda_d_arcsec

    def sums(x_mas, y_mas):
        return aperture_sums(imager.image(axis, axis, source_arcsec=(1e-3 * x_mas, 1e-3 * y_mas)), weights)[near]

    still, moved = sums(0.0, 0.0), [sums(1.0, 0.0), sums(0.0, 1.0)]
    half_of_all = 0.5 * (visit.star_e_s * 1000.0) ** 2 / sum(visit.variances[0].values())
    true = half_of_all * 2.0 * sum(float(((one - still) ** 2).mean()) for one in moved)
    assert true <= _left_out(visit)["pointing"]["snr"] <= 1.5**2 * true
    # Eight points at r / sqrt(2) have the second moments of the disc.
    angles, reach = 2.0 * np.pi * np.arange(8) / 8, 8.0 / np.sqrt(2.0)
    disc = np.mean([sums(reach * np.cos(a), reach * np.sin(a)) for a in angles], axis=0) - still
    wide = copy(visit)
    wide.star_radius_mas, wide.visits = 8.0, 9
    true = half_of_all * 9.0 * float((disc**2).mean())
    assert true <= _left_out(wide)["stellar_disc"]["snr"] <= 3.0**2 * true


@pytest.mark.parametrize(
    ("star", "radius_mas"),
    [
        ({"v_mag": 0.01, "teff_k": 5795}, 4.253),
        ({"v_mag": 0.01, "teff_k": None, "spectral_type": "G2V"}, 4.253),
        ({"v_mag": 3.5, "teff_k": 5344}, 1.03),
    ],
)
def test_the_disc_of_a_star_follows_its_light_and_temperature(star, radius_mas):
    """Radii by interferometry: alpha Cen A 4.253 mas (Kervella et al. 2017), tau Cet 1.03 (di Folco et al. 2007)."""
    assert of_planet(0.6, **star)[1].star_radius_mas == pytest.approx(radius_mas, rel=0.05)


def test_what_images_leave_out_is_said_with_its_size():
    found, visit = of_planet(0.6, visits=16)
    sizes = _left_out(visit)
    rows = {row.key: row for row in found.rows}
    for key in LEFT_OUT:
        assert rows[key].decision == "skipped"
        assert found.sizes[key] == sizes[key]
        assert 0.0 < sizes[key]["snr"] < 0.01
    assert sizes["stellar_disc"]["snr"] == pytest.approx(16.0 * of_planet(0.6)[0].sizes["stellar_disc"]["snr"], rel=0.2)
    assert of_planet(0.6, pointing_mas=0.0)[0].sizes["pointing"]["snr"] == 0.0
