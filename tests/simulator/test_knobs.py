"""The dial: three names, a tolerance, never both.

Albedos over insolation: linear between nodes in ln distance, clamped and flagged outside.
"""

import numpy as np
import pytest

from simulator.knobs import FIDELITIES, QUANTITIES, TOLERANCES, AlbedoFamily, Knobs, dial_of, resolve_knobs


@pytest.mark.parametrize("name", FIDELITIES)
def test_a_name_is_a_fixed_point(name):
    dial = dial_of(name)
    assert (dial.fidelity, dial.knobs, dial.tolerance) == (name, FIDELITIES[name], TOLERANCES[name])
    assert set(dial.tolerance) == set(QUANTITIES)
    assert dial.knobs.tier == name
    assert resolve_knobs(name) == dial.knobs


def test_without_any_it_is_standard():
    assert dial_of() == dial_of("standard")


def test_names_are_ordered():
    for quantity in QUANTITIES:
        quick, standard, reference = (TOLERANCES[name][quantity] for name in ("quick", "standard", "reference"))
        assert quick > standard > reference == 0.0
    for name in ("pupil_samples", "wavelength_nodes", "pixel_nodes", "stamp_pixels"):
        values = [getattr(FIDELITIES[tier], name) for tier in ("quick", "standard", "reference")]
        assert values == sorted(values)


def test_a_tolerance_leaves_the_knobs_open():
    dial = dial_of(tolerance=0.02)
    assert (dial.fidelity, dial.knobs) == ("custom", None)
    assert dial.tolerance == dict.fromkeys(QUANTITIES, 0.02)
    assert dial_of(tolerance=0.5).tolerance["snr"] == 0.5


def test_no_tolerance_at_all_is_the_reference():
    assert dial_of(tolerance=0) == dial_of(tolerance=0.0) == dial_of("reference")


def test_some_quantities_alone():
    dial = dial_of("standard").of("snr", "planet_flux")
    assert dial.tolerance == {"snr": 0.03, "planet_flux": 0.01}
    assert dial.knobs == FIDELITIES["standard"]


def test_own_knobs_have_no_name():
    own = Knobs(wavelength_nodes=2)
    assert own.tier == "custom"
    assert resolve_knobs(own) is own


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
