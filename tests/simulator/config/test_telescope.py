import pytest

from cpic_core import InputError
from simulator import load_instrument


def test_switches_of_one_camera():
    plain = load_instrument()
    seen = plain.switched({"persistence": True, "read_noise": False}, camera="NIR")
    assert seen.near_infrared.detector.switches.persistence
    assert not seen.near_infrared.detector.switches.read_noise
    assert not plain.switched({"smear": False}, camera="VIS").detector.switches.smear
    assert plain.switched(None, camera="VIS") is plain


@pytest.mark.parametrize(
    ("camera", "name", "other"),
    [("NIR", "smear", "near-infrared"), ("VIS", "persistence", "visible"), ("VIS", "cosmic", "visible")],
)
def test_switches_of_the_other_camera_are_refused_by_name(camera, name, other):
    with pytest.raises(InputError, match=rf"switches = {name}.*cosmic_rays.*the {other} camera") as refused:
        load_instrument().switched({name: False}, camera=camera)
    assert name not in refused.value.allowed.split(", ")


@pytest.mark.parametrize("switches", [["smear"], {"smear": 1}])
def test_what_is_no_mapping_to_truth_values_is_refused(refused, switches):
    refused("switches", load_instrument().switched, switches, camera="VIS")
