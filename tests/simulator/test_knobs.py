"""The dial: three names, a tolerance, never both."""

import math

import pytest

from catalogs.errors import InputError
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


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"fidelity": "quick", "tolerance": 0.1}, ("tolerance", "without fidelity", "two names of one dial")),
        ({"fidelity": "standard", "tolerance": 0}, ("tolerance", "without fidelity")),
        ({"fidelity": "fast"}, ("fidelity", "fast", "quick, standard, reference")),
        ({"tolerance": -1e-9}, ("tolerance", "-1e-09", "0 to 0.5")),
        ({"tolerance": 0.51}, ("tolerance", "0.51", "0 to 0.5")),
        ({"tolerance": math.nan}, ("tolerance", "nan", "finite")),
        ({"tolerance": math.inf}, ("tolerance", "inf", "finite")),
        ({"tolerance": "2 %"}, ("tolerance", "2 %")),
    ],
)
def test_refusals_name_key_value_and_range(given, words):
    with pytest.raises(InputError) as refused:
        dial_of(**given)
    assert "\n" not in str(refused.value)
    for word in words:
        assert word in str(refused.value)


def test_own_knobs_have_no_name():
    own = Knobs(wavelength_nodes=2)
    assert own.tier == "custom"
    assert resolve_knobs(own) is own
