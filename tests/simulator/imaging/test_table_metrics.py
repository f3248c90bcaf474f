"""Figures of a band of which a table is known: shipped telescopes against what was published of them.

Diffraction of a round pupil, against what is known of it in closed form.
"""

import math

import numpy as np
import pytest

from simulator.config import load_instrument
from simulator.imaging import TableMetrics, metrics_key, psf_metrics
from simulator.imaging.table_metrics import airy, disc_light

HWO, ROMAN = load_instrument("hwo_like"), load_instrument("roman_hlc_like")


@pytest.mark.parametrize(
    ("band", "separation", "planet", "star", "floor", "pixels"),
    [
        ("V500", 5.66446706, 0.02150748 / 4.16e-09, 9.180666e-05 / 65.61865517, 2.662393e-06 / 65.61865517, 9.04621),
        (
            "I1000",
            2.83223353,
            0.01511871 / 2.80338e-09,
            4.194011e-4 / 44.21734738,
            1.216262e-05 / 44.21734738,
            36.18484,
        ),
        ("V500", 4.71135924, 0.02741471 / 5.954985e-09, 9.805969e-05 / 42.84162, 2.843731e-06 / 42.84162, 9.04621),
    ],
)
def test_rates_are_those_of_the_comparison_of_calculators(band, separation, planet, star, floor, pixels):
    """Stark et al. 2025 (arXiv:2502.18556), EBS: count rates over fluxes (ph/s/cm2/nm) of planet, star, floor."""
    metrics, configuration = psf_metrics(HWO, band), HWO.band(band)
    rate = HWO.telescope.area_cm2 * configuration.t_opt * configuration.qe * configuration.width_nm
    x = np.array(separation * HWO.lambda_d_arcsec(band))
    assert rate * float(metrics.core_throughput(x, 0.0)) == pytest.approx(planet, rel=2e-3)
    assert rate * float(metrics.halo_aperture(x, 0.0)) == pytest.approx(star, rel=5e-3)
    variance, common = metrics.stability(x)
    assert rate * math.sqrt(variance) == pytest.approx(floor, rel=5e-3)
    assert common
    assert metrics.aperture_pixels == pytest.approx(pixels, rel=5e-3)


def test_cores_of_the_roman_table_have_their_own_size_and_sky():
    """At a row, 6.1 lambda/D: 0.00234 arcsec2 and 0.43045 of the sky, as in the public table."""
    metrics = psf_metrics(ROMAN, "CGI1")
    x, y = np.array(6.1 * ROMAN.lambda_d_arcsec("CGI1")), np.array(0.0)
    assert float(metrics.core_pixels(x, y)) * metrics.pixel_scale_arcsec**2 == pytest.approx(0.00234, rel=1e-6)
    assert float(metrics.sky_share(x, y)) * metrics.apodizer_energy == pytest.approx(0.43045, rel=1e-6)
    assert float(metrics.dust_transmission(x, y, metrics.core_throughput(x, y))) == pytest.approx(0.43045, rel=1e-6)
    assert float(metrics.core_throughput(x, y)) == pytest.approx(0.04326, rel=1e-6)


def test_the_key_of_figures_holds_the_content_of_the_file(tmp_path):
    text = "separation_arcsec,core_throughput,raw_contrast\n0.1,0.05,1e-9\n0.3,0.05,1e-9\n"
    keys, names = set(), ("a.csv", "b.csv")
    for name in names:
        (tmp_path / name).write_text(text, encoding="utf-8")
        keys.add(metrics_key(load_instrument({"coronagraph": {"table": str(tmp_path / name)}}), "F662"))
    assert len(keys) == 1
    (tmp_path / "b.csv").write_text(text.replace("0.05", "0.06"), encoding="utf-8")
    keys.add(metrics_key(load_instrument({"coronagraph": {"table": str(tmp_path / "b.csv")}}), "F662"))
    assert len(keys) == 2


def test_another_contrast_is_the_same_table_with_more_light():
    metrics = psf_metrics(HWO, "V500")
    assert isinstance(metrics, TableMetrics)
    bright = metrics.brightened(1e-10 / metrics.median_contrast)
    assert bright.median_contrast == pytest.approx(1e-10, rel=1e-12)
    x = np.array(0.2)
    ratio = 1e-10 / metrics.median_contrast
    assert float(bright.halo_aperture(x, 0.0) / metrics.halo_aperture(x, 0.0)) == pytest.approx(ratio, rel=1e-12)
    assert float(bright.core_throughput(x, 0.0)) == float(metrics.core_throughput(x, 0.0))
    assert bright.stability(x)[0] == metrics.stability(x)[0]


def test_light_beside_the_core_is_that_of_the_pupil():
    """All of a source's columns and rings hold the light that passes: 0.43 of the collected in the Roman table."""
    metrics = psf_metrics(ROMAN, "CGI1")
    passed = float(metrics.table.columns["occulter_transmission"].max())
    assert metrics.column_profile.sum() == pytest.approx(passed, rel=0.02)
    pixel = np.arange(len(metrics.wing_profile), dtype=float)
    rings = 2.0 * np.pi * float(pixel[3:] @ metrics.wing_profile[3:])
    assert 0.1 * passed < rings < 0.6 * passed
    middle = len(metrics.aperture_map) // 2
    assert metrics.aperture_map[middle, middle] == metrics.aperture_map.max()
    np.testing.assert_allclose(metrics.aperture_map, metrics.aperture_map.T)


@pytest.mark.parametrize(
    ("width", "obstruction"),
    [
        (0.0, 0.2),
        (0.2, 0.36),
        *(pytest.param(*one, marks=pytest.mark.long) for one in ((0.0, 0.0), (0.0, 0.36), (0.2, 0.0), (0.2, 0.2))),
    ],
)
def test_all_the_light_is_somewhere(obstruction, width):
    """Within 200 lambda/D all but the wings' 2 / (pi^2 u), which obstruction raises by (1 + e) / (1 - e^2)."""
    u = np.linspace(0.0, 200.0, 400_001)
    total = np.trapezoid(2.0 * np.pi * u * airy(u, obstruction, width), u)
    outside = 2.0 / np.pi**2 / 200.0 * (1.0 + obstruction) / (1.0 - obstruction**2)
    assert total == pytest.approx(1.0 - outside, abs=3e-4)


def test_the_middle_and_the_first_dark_ring():
    """pi / 4 (1 - e^2) of the light per square lambda/D in the middle; dark at 1.2197 lambda/D."""
    assert float(airy(0.0)) == pytest.approx(np.pi / 4.0, rel=1e-9)
    assert float(airy(0.0, 0.3)) == pytest.approx(np.pi / 4.0 * (1.0 - 0.09), rel=1e-9)
    assert float(airy(1.219670)) < 1e-12


@pytest.mark.parametrize(("radius", "light"), [(1.219670, 0.837785), (2.233131, 0.909900)])
def test_discs_to_the_dark_rings_hold_what_books_say(radius, light):
    """Born & Wolf, 8.5.2: 83.8 and 91.0 per cent; 1 - J0^2 - J1^2 at the zeros of J1."""
    assert float(disc_light(np.zeros(1), radius, 0.0, 0.0)[0]) == pytest.approx(light, abs=2e-3)


def test_discs_beside_the_source_hold_the_brightness_times_their_area():
    at = np.array([20.0, 40.0])
    found = disc_light(at, 0.7, 0.0, 0.3)
    smooth = np.array([np.mean(airy(np.linspace(s - 0.7, s + 0.7, 99), 0.0, 0.3)) for s in at])
    np.testing.assert_allclose(found, smooth * np.pi * 0.49, rtol=0.05)
