from dataclasses import replace
from datetime import datetime

import pytest

from cpic_core import InputError
from cpic_planner.simulation.sequences import check_light, plan_sequences
from simulator.config import load_simulation
from simulator.products import write_level0


def planned(*sequences, instrument=None, **defaults):
    tree = {"name": "x", "sequences": list(sequences)} | ({"defaults": defaults} if defaults else {})
    return plan_sequences(load_simulation(tree, instrument=instrument))


def test_sequences_are_counted_and_follow_each_other():
    tree = {"overhead_s": 100, "detector": {"readout_s": 2}}
    found = planned(
        {"kind": "BIAS", "frames": 5}, {"kind": "DARK", "exposure_s": [3, 30], "frames": 2}, instrument=tree
    )
    assert [item.obsid for item in found] == ["40000000001", "40000000002", "40000000003"]
    begins = [datetime.fromisoformat(item.start_utc) for item in found]
    assert [(later - begins[0]).total_seconds() for later in begins] == [0, 110, 220]


def test_a_begin_of_its_own_starts_the_clock_again():
    found = planned(
        {"kind": "BIAS"}, {"kind": "BIAS", "start_utc": "2030-05-01T12:00:00", "em_gain": [1, 2]}, {"kind": "BIAS"}
    )
    assert [item.start_utc[:19] for item in found] == [
        "2028-01-01T00:00:00",
        "2030-05-01T12:00:00",
        "2030-05-01T12:00:01",
        "2030-05-01T12:00:02",
    ]


def test_a_leap_second_is_a_second():
    found = planned({"kind": "DARK", "start_utc": "2016-12-31T23:59:58", "exposure_s": 0.9}, {"kind": "BIAS"})
    assert found[1].start_utc.startswith("2016-12-31T23:59:60.0")


def test_numbers_that_are_given(refused):
    found = planned({"kind": "BIAS", "obsid": "40000000100", "em_gain": [1, 2]}, {"kind": "BIAS"})
    assert [item.obsid for item in found] == ["40000000100", "40000000101", "40000000003"]
    with pytest.raises(InputError, match=r"simulation\.sequences\.1\.obsid = 40000000001.*sequences\.0"):
        planned({"kind": "BIAS"}, {"kind": "BIAS", "obsid": 40000000001})
    refused("begin with 4", planned, {"kind": "BIAS", "obsid": 50000000001})


def test_prefix_of_the_instrument():
    (only,) = planned({"kind": "BIAS"}, instrument={"mission": {"obsid_prefix": "123456"}})
    assert only.obsid == "12345600001"


def test_noise_of_the_same_scene_is_independent_unless_asked(star):
    def numbers(*sequences, **defaults):
        return [item.realisation for item in planned(*sequences, scene=star, band="F520", **defaults)]

    assert numbers({"exposure_s": [30, 300], "em_gain": [1, 20]}) == [0, 1, 2, 3]
    assert numbers({}, {"role": "reference"}, {"band": "F662"}, {"seed": 2}, {}) == [0, 0, 0, 0, 1]
    assert numbers({"realisation": 5, "exposure_s": [1, 2]}, {}) == [5, 5, 0]
    assert numbers({}, {"realisation": 0}) == [1, 0]
    # a dark field and a science frame of one scene share the names of their streams
    assert numbers({"kind": "SCI"}, {"kind": "DSF"}) == [0, 1]


def test_more_sequences_leave_the_first_ones_as_they_are(star):
    sequence = {"scene": star, "band": "F520"}
    assert [item.settings() for item in planned(sequence, sequence)] == [
        item.settings() for item in planned(sequence, sequence, {"kind": "BIAS"})[:2]
    ]


def test_names_are_those_of_the_files(small, star, tmp_path):
    quick = {"frames": 2, "band": "F520", "exposure_s": 1.5}
    kinds = [{"kind": kind} for kind in ("BIAS", "DARK", "FLAT")]
    for item in planned(*kinds, {"scene": star, "fidelity": "quick", "roll_deg": 30}, instrument=small, **quick):
        made = write_level0(item.build(), tmp_path, obsid=item.obsid)
        assert made == tmp_path / item.name.file
        assert (tmp_path / item.name.truth).is_file()
        assert (tmp_path / item.name.params).is_dir()


def test_settings_reach_the_sequence(small, star):
    (item,) = planned(
        {
            "kind": "CALS",
            "scene": star,
            "band": "F520",
            "frames": 3,
            "exposure_s": 0.5,
            "em_gain": 4,
            "roll_deg": 12,
            "star_offset_arcsec": [0.3, -0.3],
            "role": "reference",
            "seed": 9,
            "realisation": 6,
            "fidelity": "quick",
            "switches": {"smear": False},
            "start_utc": "2031-01-02T03:04:05",
        },
        instrument=small,
    )
    made = item.build()
    assert (made.kind, made.n_frames, made.exposure_s, made.em_gain, made.roll_deg) == ("CALS", 3, 0.5, 4.0, 12.0)
    assert (made.star_offset_arcsec, made.role, made.seed, made.realisation) == ((0.3, -0.3), "reference", 9, 6)
    assert made.start_utc == "2031-01-02T03:04:05"
    assert made.header["FIDELITY"] == "quick"
    assert made.instrument.detector.switches.smear is False
    assert made.instrument.detector.switches.dark is True


def test_settings_of_calibrations_reach_them(small):
    laser, flat = (
        item.build()
        for item in planned(
            {"kind": "LASER", "level_e": 1e5, "offset_arcsec": [0.4, -0.4]},
            {"kind": "FLAT", "level_e": 500},
            instrument=small,
            band="F520",
            exposure_s=2,
        )
    )
    row, column = divmod(int(laser.mean_rate_map.argmax()), laser.shape[1])
    assert (column - 118) * 0.016153 == pytest.approx(0.4, abs=0.01)
    assert (row - 100) * 0.016153 == pytest.approx(-0.4, abs=0.01)
    assert flat.mean_rate_map.max() == pytest.approx(250)


def test_light_that_cannot_be_computed_is_refused_before_any_frame(refused, tmp_path):
    (tmp_path / "short.txt").write_text("wavelength_nm photlam\n600 1\n700 2\n")
    scene = {"name": "s", "cstar": {"v_mag": 5, "spectrum": str(tmp_path / "short.txt")}}
    found = planned({"scene": scene, "band": "F850"})
    refused("of s in F850", check_light, found)
    check_light(tuple(replace(item, entry=item.entry.model_copy(update={"scene": None})) for item in found))
