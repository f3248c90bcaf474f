"""Light of a scene from tables, against images of it."""

import math

import numpy as np
import pytest

from simulator import load_instrument, observe
from simulator.imaging import psf_metrics
from simulator.ledger.light import SceneLight
from simulator.target import scene_sources


def light_of(scene, instrument, band, **more):
    settings = {
        "measured": ("b",),
        "full": False,
        "star_offset_arcsec": (0.0, 0.0),
        "sky_e_s_arcsec2": 0.0,
        "stray_e_s": 0.0,
        "drift_nm": 0.0,
    } | more
    return SceneLight(
        instrument, band, psf_metrics(instrument, band), scene_sources(scene, instrument, band), **settings
    )


def test_star_and_planet_are_those_of_the_image(make, calm):
    scene = make()
    seen = observe(scene, band="F662", exposure_s=1.0, window="hole", instrument=calm)
    found = light_of(scene, calm, "F662")
    star = seen.light.star.rate_e_s[0]
    np.testing.assert_allclose(found.star_e_s, star, rtol=1e-6, atol=1e-9 * star.max())
    place = found.planets[0]
    y, x = np.indices(star.shape)
    near = np.hypot(y - seen.truth.y_pixel[1], x - seen.truth.x_pixel[1]) < 1.5
    light = seen.mean_rate_map - star
    assert place.peak_e_s == pytest.approx(light[near].max(), rel=0.15)
    assert place.halo_e_s == pytest.approx(float((place.weights * star[place.place]).sum()), rel=1e-6)
    assert place.weights.sum() == pytest.approx(found.aperture_pixels, rel=1e-3)


@pytest.mark.parametrize("place", [(1.5, 1.2), (3.0, 0.1), (7.0, 6.0), (14.0, -2.0)])
def test_wings_of_a_companion_lie_within_the_bounds(place, make, calm):
    x, y = place
    star = {
        "name": "t",
        "v_mag": 4.0,
        "teff_k": 5800,
        "separation_arcsec": math.hypot(x, y),
        "pa_deg": math.degrees(math.atan2(-x, y)) % 360,
    }
    on, off = (
        observe(make(stars=part), band="F662", exposure_s=1.0, window="hole", instrument=calm) for part in ([star], [])
    )
    light = on.mean_rate_map - off.mean_rate_map
    found = light_of(make(stars=[star]), calm, "F662")
    source, planet = found.sources[1], found.planets[0]
    inside = float((planet.weights * light[planet.place]).sum())
    assert source.least_e_s[0] <= inside <= source.aperture_e_s[0]
    assert light.max() <= source.peak_e_s < 50 * light.max()


def test_whole_frames_know_what_lies_beyond(make):
    star = {"name": "t", "v_mag": 2.0, "teff_k": 5800, "separation_arcsec": 5.0, "pa_deg": 0.0}
    instrument = load_instrument()
    window, frame = (light_of(make(stars=[star]), instrument, "F662", full=full) for full in (False, True))
    assert window.outside_e_s.size == 0
    assert frame.beyond_peaks_e_s == (0.0, 0.0)
    assert frame.outside_e_s.max() >= 0.9 * frame.sources[1].peak_e_s
    # in a column of the window: it would bloom into it
    assert window.beyond_peaks_e_s[0] == pytest.approx(frame.sources[1].peak_e_s, rel=0.05)
    assert window.beyond_peaks_e_s[1] < 0.1 * window.beyond_peaks_e_s[0]
