import numpy as np
import pytest

from simulator import load_instrument
from simulator.products.orbit import EARTH_RADIUS_KM, CircularOrbit, earth_radius_deg

CONFIG = load_instrument().mission.orbit


def orbit(**values):
    return CircularOrbit(CONFIG.model_copy(update=values))


def test_default_orbit_has_the_published_period_speed_and_drift():
    default = orbit()
    assert default.period_s / 60 == pytest.approx(92.56, abs=0.01)
    _, velocity = default.state(np.linspace(0, 6000, 50))
    assert np.linalg.norm(velocity, axis=-1) == pytest.approx(7.67, abs=0.01)
    assert default.node_rate_deg_day == pytest.approx(-6.03, abs=0.01)
    assert 360 / abs(default.node_rate_deg_day) == pytest.approx(59.7, abs=0.1)
    relative = abs(default.node_rate_deg_day) + 360 / 365.2422
    assert 360 / relative == pytest.approx(51.3, abs=0.1)
    assert earth_radius_deg(default.radius_km) == pytest.approx(70.2, abs=0.05)


def test_position_keeps_its_radius_and_its_plane():
    tilted = orbit(inclination_deg=41.5, node_deg=33.0, phase_deg=0.0)
    position, velocity = tilted.state(np.array([0.0]))
    node = np.deg2rad(33.0)
    assert position[0] == pytest.approx(tilted.radius_km * np.array([np.cos(node), np.sin(node), 0.0]), abs=1e-6)
    normal = np.cross(position[0], velocity[0])
    assert np.degrees(np.arccos(normal[2] / np.linalg.norm(normal))) == pytest.approx(41.5, abs=0.1)
    many, _ = tilted.state(np.linspace(0, 1e7, 1000))
    assert np.linalg.norm(many, axis=-1) == pytest.approx(EARTH_RADIUS_KM + 400.0, rel=1e-12)
    assert np.abs(many[:, 2]).max() == pytest.approx(tilted.radius_km * np.sin(np.deg2rad(41.5)), rel=1e-3)


def test_velocity_is_the_derivative_of_position():
    tilted = orbit(node_deg=200.0, phase_deg=77.0)
    moments, step = np.linspace(0, 2e6, 40), 0.01
    before, _ = tilted.state(moments - step)
    after, _ = tilted.state(moments + step)
    _, velocity = tilted.state(moments)
    assert np.abs((after - before) / (2 * step) - velocity).max() < 1e-6


def test_the_node_goes_round_at_its_rate():
    tilted = orbit()
    # whole revolutions later the telescope is at the node again, which has moved
    turns = 155
    position, _ = tilted.state(np.array([turns * tilted.period_s]))
    moved = np.degrees(np.arctan2(position[0, 1], position[0, 0]))
    assert moved == pytest.approx(tilted.node_rate_deg_day * turns * tilted.period_s / 86400, abs=1e-6)
    assert position[0, 2] == pytest.approx(0.0, abs=1e-3)


def test_axes_of_the_plane_hold_the_orbit():
    tilted = orbit(inclination_deg=50.0, node_deg=33.0)
    moments = np.linspace(0, 1e7, 200)
    towards_node, ahead = tilted.plane(moments)
    position, _ = tilted.state(moments)
    normal = np.cross(towards_node, ahead)
    assert np.linalg.norm(normal, axis=-1) == pytest.approx(1.0, abs=1e-12)
    assert np.abs(np.einsum("ij,ij->i", normal, position)).max() < 1e-8 * tilted.radius_km
    assert normal[:, 2] == pytest.approx(np.cos(np.deg2rad(50.0)), abs=1e-12)
    # The pole of the orbit goes round as its node does.
    turned = np.unwrap(np.arctan2(normal[:, 1], normal[:, 0]))
    rate = np.rad2deg(np.polyfit(moments / 86400, turned, 1)[0])
    assert rate == pytest.approx(tilted.node_rate_deg_day, rel=1e-9)
