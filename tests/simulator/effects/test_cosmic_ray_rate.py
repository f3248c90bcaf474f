import pytest

from simulator.config import load_instrument
from simulator.effects import cosmic_ray_rate

CONFIG = load_instrument().cosmic_rays


def test_cycle_at_its_turning_points():
    assert cosmic_ray_rate(CONFIG, 2019.96) == 1.0
    assert cosmic_ray_rate(CONFIG, 2019.96 + 5.5) == pytest.approx(0.7, rel=1e-12)
    assert cosmic_ray_rate(CONFIG, 2019.96 + 2.75) == pytest.approx(0.85, rel=1e-12)
    assert cosmic_ray_rate(CONFIG, 2030.96) == pytest.approx(1.0, rel=1e-12)


def test_rate_is_highest_at_solar_minimum_and_bounded():
    rates = [cosmic_ray_rate(CONFIG, 1972.0 + 0.1 * i) for i in range(1290)]
    assert 0.7 <= min(rates) < 0.7001
    assert 0.9999 < max(rates) <= 1.0


def test_dates_and_years_agree():
    assert cosmic_ray_rate(CONFIG, "2027-07-02T12:00:00") == pytest.approx(cosmic_ray_rate(CONFIG, 2027.5), rel=1e-12)


def test_orbit_and_depth_scale_it():
    other = CONFIG.model_copy(update={"orbit_factor": 1.3, "cycle_depth": 1.0, "peak_rate_per_s_cm2": 2.0})
    assert cosmic_ray_rate(other, 2019.96) == pytest.approx(2.6, rel=1e-12)
    assert cosmic_ray_rate(other, 2025.46) == pytest.approx(0.0, abs=1e-12)


def test_bad_dates_are_refused(refused):
    refused("when", cosmic_ray_rate, CONFIG, "soon")
