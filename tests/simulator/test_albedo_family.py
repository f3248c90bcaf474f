"""Albedos over insolation: linear between nodes in ln distance, clamped and flagged outside."""

import numpy as np

from simulator.albedo_family import AlbedoFamily

FAMILY = AlbedoFamily(
    np.array([0.5, 1.0, 4.0]), np.array([400.0, 800.0]), np.array([[0.1, 0.2], [0.3, 0.4], [0.5, 0.8]]), 1050.0
)


def test_nodes_and_the_geometric_middle():
    np.testing.assert_allclose(FAMILY.at(1.0).albedo, [0.3, 0.4], rtol=1e-15)
    np.testing.assert_allclose(FAMILY.at(2.0).albedo, [0.4, 0.6], rtol=1e-15)


def test_ends_hold_outside_and_say_so():
    np.testing.assert_allclose(FAMILY.at(0.01).albedo, [0.1, 0.2], rtol=1e-15)
    np.testing.assert_allclose(FAMILY.at(1e6).albedo, [0.5, 0.8], rtol=1e-15)
    np.testing.assert_array_equal(FAMILY.outside([0.4, 0.5, 4.0, 4.1]), [True, False, False, True])


def test_weights_are_a_partition():
    nodes, weights = FAMILY.corners(np.geomspace(0.1, 10.0, 50))
    assert nodes.shape == weights.shape == (50, 2)
    np.testing.assert_allclose(weights.sum(axis=-1), 1.0, rtol=1e-15)
    assert weights.min() >= 0.0
