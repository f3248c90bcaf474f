import pytest

from catalogs.errors import InputError
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


@pytest.mark.parametrize(
    ("kind", "keys", "words"),
    [
        ("SCI", {"scene": None}, ["scene", "missing"]),
        ("SCI", {"level_e": 5}, ["level_e", "FLAT, LASER", "not for SCI"]),
        ("SCI", {"camera": "VIS"}, ["camera", "BIAS, DARK"]),
        ("BIAS", {"exposure_s": 1}, ["exposure_s", "not for BIAS"]),
        ("BIAS", {"band": "F520"}, ["band", "not for BIAS"]),
        ("DARK", {"scene": SCENE}, ["scene", "SCI, DSF, CALS"]),
        ("BKG", {"level_e": 1}, ["level_e", "not for BKG"]),
        ("FLAT", {"offset_arcsec": [0, 0]}, ["offset_arcsec", "LASER"]),
        ("LASER", {"fidelity": "quick"}, ["fidelity", "not for LASER"]),
        ("SCI", {"band": "F521"}, ["band", "F521", "F520"]),
        ("SCI", {"band": []}, ["band", "at least one"]),
        ("SCI", {"exposure_s": [1, 0]}, ["exposure_s.1", "0", " s", "1e-06 to 1e+06"]),
        ("SCI", {"exposure_s": float("nan")}, ["exposure_s"]),
        ("SCI", {"exposure_s": "long"}, ["exposure_s.0", "long"]),
        ("SCI", {"em_gain": 1001}, ["em_gain", "1001", "1 to 1000"]),
        ("SCI", {"em_gain": 0.5}, ["em_gain.0", "0.5"]),
        ("SCI", {"band": "F940", "em_gain": 2}, ["em_gain", "near infrared"]),
        ("SCI", {"frames": 0}, ["frames", "1 to 1e+06"]),
        ("SCI", {"frames": True}, ["frames", "True"]),
        ("SCI", {"frames": 2.5}, ["frames", "2.5"]),
        ("SCI", {"seed": -1}, ["seed", "-1"]),
        ("SCI", {"star_offset_arcsec": [9, 0]}, ["star_offset_arcsec.0", "arcsec", "-8 to 8"]),
        ("SCI", {"role": "hero"}, ["role", "hero", "reference"]),
        ("SCI", {"roll_deg": "up"}, ["roll_deg", "deg"]),
        ("SCI", {"fidelity": "best"}, ["fidelity", "best", "standard"]),
        ("SCI", {"start_utc": "2028-13-01"}, ["start_utc", "2028-13-01", "UTC"]),
        ("SCI", {"switches": {"smeer": False}}, ["switches", "smeer", "smear"]),
        ("SCI", {"switches": {"reset_noise": False}, "band": "F520"}, ["switches", "reset_noise"]),
        ("SCI", {"obsid": 10**11}, ["obsid"]),
        ("SCI", {"exposure": 3}, ["exposure", "no such key", "exposure_s"]),
        ("SKY", {}, ["kind", "SKY", "BKG"]),
    ],
)
def test_a_bad_value_is_refused_by_name(kind, keys, words):
    with pytest.raises(InputError) as refused:
        entry(kind, **keys)
    for word in words:
        assert word in str(refused.value)


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
