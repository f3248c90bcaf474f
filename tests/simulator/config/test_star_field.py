import numpy as np
import pytest
from scipy import stats

from catalogs.errors import InputError
from simulator.config import load_scene
from simulator.config.star_field import star_field


def test_the_preset_is_what_its_comment_says():
    scene = load_scene("star_field")
    star = scene.cstar
    centre = {"v_mag": star.v_mag, "teff_k": star.teff_k, "ra_deg": star.ra_deg, "dec_deg": star.dec_deg}
    assert star_field(300, seed=1, centre=centre) == scene


def test_counts_rise_by_the_slope_between_the_limits():
    slope, low, high = 0.3, 13.0, 20.0
    v_mag = np.array([star.v_mag for star in star_field(4000, seed=5, counts_per_mag=slope).stars])
    assert v_mag.min() >= low
    assert v_mag.max() <= high

    def below(limit):
        return (10 ** (slope * limit) - 10 ** (slope * low)) / (10 ** (slope * high) - 10 ** (slope * low))

    assert stats.kstest(v_mag, below).pvalue > 1e-4


def test_places_are_even_over_the_square():
    stars = star_field(4000, seed=5, half_width_arcsec=8.0).stars
    angle = np.radians([star.pa_deg for star in stars])
    distance = np.array([star.separation_arcsec for star in stars])
    for axis in (distance * np.sin(angle), distance * np.cos(angle)):
        assert stats_even(axis, 8.0) > 1e-4


def stats_even(values, half):
    return stats.kstest(values, stats.uniform(-half, 2 * half).cdf).pvalue


def test_equal_seeds_give_equal_fields_and_others_do_not():
    assert star_field(20, seed=3) == star_field(20, seed=3)
    assert star_field(20, seed=3) != star_field(20, seed=4)


def test_a_bad_centre_is_refused():
    with pytest.raises(InputError, match="v_mag"):
        star_field(3, centre={"teff_k": 5000})
