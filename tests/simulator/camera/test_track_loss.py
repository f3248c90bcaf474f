"""Tracks that touch an aperture, against tracks thrown on a plane."""

import math

import numpy as np
import pytest

from simulator import load_instrument
from simulator.camera.track_loss import aperture_loss_per_s, mean_projection_um
from simulator.effects.cosmic_ray_rate import cosmic_ray_rate


def test_rate_is_that_of_sticks_thrown_on_a_disc():
    """Crofton: straight tracks of the mean length, any direction, on a disc widened by their charge's reach."""
    config = load_instrument()
    rays, pixel = config.cosmic_rays, config.detector.pixel_um
    length = mean_projection_um(rays.physical.depth_um, rays.physical.max_length_um)
    radius = 6.0
    rate = aperture_loss_per_s(config, "F662", aperture_radius_pixel=radius) / cosmic_ray_rate(
        rays, config.mission.start_utc
    )
    rng, n, side = np.random.default_rng(3), 400_000, 400.0
    reach = (radius + 0.25) * pixel + 3.1 * rays.physical.diffusion_um
    x, y = side * (rng.random((2, n)) - 0.5)
    along = np.clip(-x, -length / 2, length / 2)  # nearest point of a stick along x
    hits = np.hypot(x + along, y) < reach
    assert rate * 1e8 == pytest.approx(hits.mean() * side**2, rel=0.03)


def test_particles_off_touch_nothing():
    off = load_instrument({"detector": {"switches": {"cosmic_rays": False}}})
    assert aperture_loss_per_s(off, "F662") == 0.0


def test_mean_projection_without_a_longest_chord():
    assert mean_projection_um(14.0, 1e9) == pytest.approx(math.pi / 2 * 14.0, rel=1e-6)
