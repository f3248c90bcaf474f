"""The dust disc: brightness from magnitudes, light of the disc, and apertures on rendered images."""

import math

import numpy as np
import pytest

from simulator import load_instrument, observe
from simulator.imaging import aperture_sums, overlap_weights, psf_metrics
from simulator.signal import aperture_exozodi, exozodi_disc
from simulator.signal.light import exozodi_fraction_arcsec2

ZODIS = 50.0


def figures(band):
    return psf_metrics(load_instrument(), band)


@pytest.mark.parametrize(("absolute_v_mag", "distance_pc"), [(4.83, 10.0), (4.83, 3.7), (1.4, 7.7), (6.9, 25.0)])
@pytest.mark.parametrize("au", [0.5, 1.0, 5.2])
def test_brightness_is_that_of_magnitudes(absolute_v_mag, distance_pc, au):
    """22 mag/arcsec2 at 1 au of a star of M_V 4.83, in proportion to light and r^-2; over the star's own light."""
    surface = 22.0 - 2.5 * math.log10(3.0) + (absolute_v_mag - 4.83) + 5 * math.log10(au)
    star = absolute_v_mag + 5 * math.log10(distance_pc / 10)
    found = exozodi_fraction_arcsec2(au / distance_pc, 3.0)
    assert found == pytest.approx(10 ** (-0.4 * (surface - star)), rel=1e-12)


def test_brightness_in_numbers():
    assert exozodi_fraction_arcsec2(1.0, 1.0) == pytest.approx(1.355e-9, rel=1e-3)
    assert exozodi_fraction_arcsec2([0.5, 1.0], [[1.0], [2.0]]).shape == (2, 2)
    assert exozodi_fraction_arcsec2(0.5, 0.0) == 0.0


def test_disc_holds_the_light_between_its_edges():
    disc = exozodi_disc(ZODIS)
    edge = np.geomspace(disc.inner_arcsec, disc.outer_arcsec, 20001)
    middle = np.sqrt(edge[1:] * edge[:-1])
    light = np.sum(exozodi_fraction_arcsec2(middle, ZODIS) * np.pi * np.diff(edge**2))
    assert disc.contrast == pytest.approx(light, rel=1e-6)
    assert (disc.slope, disc.inclination_deg) == (-2.0, 0.0)
    assert exozodi_disc(0.0) is None
    instrument = load_instrument()
    assert all(disc.outer_arcsec > instrument.hole_outer_arcsec(band) * math.sqrt(2) for band in instrument.bands)


@pytest.mark.parametrize("band", ["F520", "F850"])
def test_apertures_of_images_hold_as_much(band):
    """Every aperture that lies in the hole."""
    instrument, metrics = load_instrument(), figures(band)
    bare = {"name": "s", "cstar": {"v_mag": 5.0, "teff_k": 5800}}
    asked = {"band": band, "exposure_s": 1.0, "window": "hole", "fidelity": "quick", "instrument": instrument}
    dusty = observe(bare | {"extended": [exozodi_disc(ZODIS)]}, **asked)
    clean = observe(bare, **asked)
    seen = (dusty.mean_rate_map - clean.mean_rate_map) / dusty.truth.sources[0].rate_e_s
    radius, pixel = metrics.aperture_radius_arcsec, metrics.pixel_scale_arcsec
    sums = aperture_sums(seen, overlap_weights(radius / pixel))
    offset = (np.arange(len(sums)) - len(sums) // 2) * pixel
    x, y = np.meshgrid(offset, offset)
    low, high = metrics.hole_inner_arcsec + radius, metrics.hole_outer_arcsec - radius
    inside = (np.minimum(abs(x), abs(y)) >= low) & (np.maximum(abs(x), abs(y)) <= high)
    assert inside.sum() > 500
    ratio = sums[inside] / aperture_exozodi(metrics, ZODIS, x[inside], y[inside])
    assert ratio.mean() == pytest.approx(1.0, abs=0.01)
    assert np.all(abs(ratio - 1.0) < 0.026)


def test_mask_keeps_the_light_away():
    metrics = figures("F520")
    open_, edge, behind = aperture_exozodi(metrics, ZODIS, [0.4, metrics.mask_half_width_arcsec, 0.0], 0.4)
    assert open_ > edge > behind == 0.0
    area = math.pi * metrics.aperture_radius_arcsec**2
    most = exozodi_fraction_arcsec2(0.4 * math.sqrt(2), ZODIS) * area * metrics.apodizer_energy
    assert 0.97 * most < open_ < 0.98 * most  # less the far wings
    assert np.isfinite(aperture_exozodi(metrics, ZODIS, 0.0, 0.0))


def test_amount_scales_and_none_is_zero():
    metrics = figures("F520")
    x = np.linspace(0.2, 0.6, 6).reshape(2, 3)
    one = aperture_exozodi(metrics, ZODIS, x, 0.5)
    assert one.shape == (2, 3)
    assert aperture_exozodi(metrics, 2 * ZODIS, x, 0.5) == pytest.approx(2 * one, rel=1e-12)
    assert aperture_exozodi(metrics, 0.0, x, 0.5).tolist() == [[0.0] * 3] * 2


@pytest.mark.parametrize(
    ("ask", "word"),
    [
        (lambda: exozodi_fraction_arcsec2(0.0, 1.0), "separation_arcsec"),
        (lambda: exozodi_fraction_arcsec2(math.nan, 1.0), "separation_arcsec"),
        (lambda: exozodi_fraction_arcsec2(0.5, -1.0), "n_zodis"),
        (lambda: exozodi_disc(-1.0), "n_zodis"),
        (lambda: exozodi_disc(1e6), "n_zodis"),
        (lambda: aperture_exozodi(figures("F520"), ZODIS, math.inf, 0.0), "x_arcsec"),
    ],
)
def test_bad_input_is_refused(refused, ask, word):
    refused(word, ask)
