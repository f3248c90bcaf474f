"""A coronagraph as maps: places, means over rings, and what is refused."""

import numpy as np
import pytest
from astropy.io import fits

from cpic_core import InputError
from simulator.config import load_instrument
from simulator.config.coronagraph import coronagraph_table
from simulator.imaging import psf_metrics

UNIT, STEP, SIDE = 0.04, 0.01, 81
OFFSET = STEP * (np.arange(SIDE) - SIDE // 2)
X, Y = np.meshgrid(OFFSET, OFFSET)
CORE = 0.06 + 0.05 * X  # more on the right, the mean of a ring is 0.06
MAPS = {
    "core_throughput": CORE,
    "raw_contrast": np.full((SIDE, SIDE), 2e-9) * (1.0 + Y),
    "contrast_stability": np.full((SIDE, SIDE), 1e-10),
    "occulter_transmission": np.full((SIDE, SIDE), 0.4),
}
NUMBERS = {"pixel_scale_arcsec": STEP, "inner_arcsec": 0.1, "outer_arcsec": 0.35}


def written(tmp_path, name="maps.npz", **changes):
    content = {key: value for key, value in (MAPS | NUMBERS | changes).items() if value is not None}
    np.savez(tmp_path / name, **content)
    return str(tmp_path / name)


def as_fits(tmp_path):
    hdus = [fits.PrimaryHDU(), *(fits.ImageHDU(values, name=name) for name, values in MAPS.items())]
    for card, value in (("PIXSCALE", STEP), ("INNER", 0.1), ("OUTER", 0.35)):
        hdus[0].header[card] = value
    fits.HDUList(hdus).writeto(tmp_path / "maps.fits")
    return str(tmp_path / "maps.fits")


@pytest.mark.parametrize("write", [written, as_fits])
def test_values_by_place_and_their_means_over_rings(tmp_path, write):
    table = coronagraph_table(write(tmp_path), UNIT)
    assert table.separation_arcsec[[0, -1]] == pytest.approx([0.1, 0.35])
    np.testing.assert_allclose(table.columns["core_throughput"], 0.06, rtol=1e-9)
    np.testing.assert_allclose(table.at_place("core_throughput", [0.2, -0.2, 0.0], 0.0), [0.07, 0.05, 0.06])
    np.testing.assert_allclose(table.at_place("core_throughput", 0.123456, [0.0, 0.3]), 0.06 + 0.05 * 0.123456)
    np.testing.assert_allclose(table.at_place("raw_contrast", 0.1, [0.2, -0.2]), [2.4e-9, 1.6e-9])
    assert table.constant("noise_fraction") is None


def test_scales_edges_and_constants_in_lambda_d(tmp_path):
    own = {"pixel_scale_arcsec": None, "inner_arcsec": None, "outer_arcsec": None}
    own |= {"pixel_scale_lambda_d": 0.25, "inner_lambda_d": 3.0, "outer_lambda_d": 8.0, "noise_fraction": 0.9}
    table = coronagraph_table(written(tmp_path, **own), UNIT)
    assert table.separation_arcsec[[0, -1]] == pytest.approx([0.12, 0.32])
    assert table.constant("noise_fraction") == 0.9


def test_without_edges_the_core_says_where_planets_may_be(tmp_path):
    """From half the most of the core outward, to the edge of the map."""
    core = np.where(np.hypot(X, Y) < 0.15, 0.01, 0.06)
    own = {"inner_arcsec": None, "outer_arcsec": None, "core_throughput": core}
    table = coronagraph_table(written(tmp_path, **own), UNIT)
    assert table.separation_arcsec[0] == pytest.approx(0.15, abs=STEP)
    assert table.separation_arcsec[-1] == pytest.approx(0.39)


def test_metrics_follow_the_place(tmp_path):
    instrument = load_instrument({"coronagraph": {"table": {"F662": written(tmp_path)}}})
    metrics = psf_metrics(instrument, "F662")
    np.testing.assert_allclose(metrics.core_throughput([0.2, -0.2], [0.0, 0.0]), [0.07, 0.05])
    np.testing.assert_allclose(metrics.halo_aperture([0.0, 0.0], [0.2, -0.2]), 0.06 * 2e-9 * np.array([1.2, 0.8]))
    assert metrics.zone.usable_range_arcsec(metrics.aperture_radius_arcsec) == pytest.approx((0.1, 0.35))


@pytest.mark.parametrize(
    ("own", "said"),
    [
        ({"core_throughput": None}, "core_throughput"),
        ({"raw_contrast": None}, "raw_contrast"),
        ({"pixel_scale_arcsec": None}, "pixel_scale_arcsec"),
        ({"pixel_scale_arcsec": -1.0}, "above 0"),
        ({"core_throughput": CORE[:-1, :-1]}, "odd side"),
        ({"core_throughput": CORE[:, :-2]}, "square map"),
        ({"core_throughput": 30 * CORE}, "0 to 1"),
        ({"core_throughput": np.where(X > 0.3, np.nan, CORE)}, "finite"),
        ({"raw_contrast": -MAPS["raw_contrast"]}, "0 to 1"),
        ({"occulter_transmission": np.full((SIDE, SIDE), 0.01)}, "at least core_throughput"),
        ({"outer_arcsec": 0.1, "inner_arcsec": 0.2}, "inner and an outer edge"),
        ({"inner_arcsec": np.nan}, "one finite number"),
    ],
)
def test_what_is_no_coronagraph_is_refused_in_one_line(tmp_path, own, said):
    with pytest.raises(InputError, match=said) as refused:
        coronagraph_table(written(tmp_path, **own), UNIT)
    assert "\n" not in str(refused.value)
