import pytest

from simulator.config import load_instrument
from simulator.config.detector import InfraredSwitches


def test_shipped_camera_is_labelled_assumed():
    instrument = load_instrument()
    detector = instrument.near_infrared.detector
    assert detector.shape == (512, 640)
    known = {key: item for key, item in instrument.provenance.items() if key.startswith("near_infrared.detector.")}
    numbers = set()
    for key, value in detector.model_dump().items():
        if key in ("flaws", "persistence"):
            numbers |= {f"near_infrared.detector.{key}.{name}" for name in value}
        elif key != "switches":
            numbers.add(f"near_infrared.detector.{key}")
    assert set(known) == numbers
    assert {item.confidence for item in known.values()} == {"A"}
    assert all(item.source for item in known.values())


def test_switched(refused):
    detector = load_instrument().near_infrared.detector
    none = detector.switched(off=("all",))
    assert not any(none.switches.model_dump().values())
    some = none.switched(on=("flat", "dark"))
    assert {name for name, on in some.switches.model_dump().items() if on} == {"flat", "dark"}
    assert all(detector.switched(on=("all",)).switches.model_dump().values())
    assert set(InfraredSwitches.model_fields) == set(detector.switches.model_dump())
    refused("switches = cic", detector.switched, off=("cic",))


@pytest.mark.parametrize(
    ("mode", "exposure_s", "reads"),
    [
        ("single", 30.0, 1),
        ("cds", 30.0, 2),
        ("cds", 0.0, 2),
        ("up_the_ramp", 30.0, 8),
        ("up_the_ramp", 0.0, 2),
        ("up_the_ramp", 0.033, 2),
        ("up_the_ramp", 0.066, 3),
        ("up_the_ramp", 0.0989, 3),
        ("up_the_ramp", 0.231, 8),
        ("up_the_ramp", 1e6, 8),
    ],
)
def test_reads_that_fit_into_an_exposure(mode, exposure_s, reads):
    detector = load_instrument({"near_infrared": {"detector": {"readout_mode": mode}}}).near_infrared.detector
    assert detector.reads_of(exposure_s) == reads
