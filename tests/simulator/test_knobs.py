"""The dial: three names, a tolerance, never both."""

import pytest

from simulator.knobs import FIDELITIES, QUANTITIES, TOLERANCES, Knobs, dial_of, resolve_knobs


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
