from simulator.config import load_instrument, load_scene
from simulator.config.base import validate
from simulator.config.simulation import SEQUENCE_KINDS, SequenceConfig, meaningful_keys

INSTRUMENT = load_instrument()
SCENE = load_scene("paper_example")


def entry(kind="SCI", **keys):
    sky = {"scene": SCENE} if kind in ("SCI", "DSF", "CALS") else {}
    return validate(SequenceConfig, {"kind": kind, "instrument": INSTRUMENT} | sky | keys)


def test_lists_are_a_grid_with_the_gain_fastest():
    one = entry(band=["F520", "F662"], exposure_s=[30, 300], em_gain=[1, 20])
    assert list(one.grid()) == [
        (band, exposure, gain) for band in ("F520", "F662") for exposure in (30.0, 300.0) for gain in (1.0, 20.0)
    ]


def test_single_values_and_other_spellings_are_understood():
    one = entry(bands="F520", n_frames=3, em_gains=5, exposures_s=2)
    assert list(one.grid()) == [("F520", 2.0, 5.0)]
    assert one.frames == 3


def test_defaults():
    one = entry()
    assert one.band == ("F520", "F662", "F720", "F850")
    assert (one.exposure_s, one.em_gain, one.frames, one.seed, one.role) == ((10.0,), (1.0,), 1, 1, "science")
    assert entry("CALS").role == "calibration"
    assert entry("CALS", role="science").role == "science"
    assert list(entry("BIAS").grid()) == [("", 0.0, 1.0)]
    assert list(entry("BIAS", exposure_s=0).grid()) == [("", 0.0, 1.0)]
    assert entry("DARK", camera="NIR").cameras == ("NIR",)


def test_every_kind_has_keys_of_its_own_and_common_ones():
    assert all({"frames", "seed", "em_gain"} <= set(meaningful_keys(kind)) for kind in SEQUENCE_KINDS)
    assert "scene" in meaningful_keys("DSF")
    assert "scene" not in meaningful_keys("FLAT")


def test_switches_of_each_camera():
    one = entry(band=["F520", "F940"], switches={"all": False, "read_noise": True})
    visible, infrared = one.switches_for("VIS"), one.switches_for("NIR")
    assert visible["smear"] is False
    assert "smear" not in infrared
    assert visible["read_noise"] is infrared["read_noise"] is True
    assert sum(visible.values()) == sum(infrared.values()) == 1
    assert entry(switches={"smear": False}).switches_for("VIS") == {"smear": False}


def test_quantities_are_converted():
    from astropy import units as u

    assert entry(exposure_s=2 * u.min).exposure_s == (120.0,)
