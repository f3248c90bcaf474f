from dataclasses import replace
from datetime import datetime
from types import SimpleNamespace

import numpy as np
import pytest

from cpic_core import InputError
from cpic_planner.simulation import check_light, plan_sequences
from simulator.config import load_simulation
from simulator.products import product_name, sequence_times, write_level0


def planned(*sequences, instrument=None, **defaults):
    tree = {"name": "x", "sequences": list(sequences)} | ({"defaults": defaults} if defaults else {})
    return plan_sequences(load_simulation(tree, instrument=instrument))


def test_sequences_are_counted_and_follow_each_other():
    tree = {"overhead_s": 100, "detector": {"readout_s": 2}}
    found = planned(
        {"kind": "BIAS", "frames": 5},
        {"kind": "DARK", "exposure_s": [3, 30], "frames": 2},
        {"scene": {"name": "star", "cstar": {"v_mag": 4, "teff_k": 5200}}, "band": ["F520", "F662"], "exposure_s": 8},
        {"kind": "BIAS"},
        instrument=tree,
    )
    assert [item.obsid for item in found] == [f"4000000000{number}" for number in range(1, 7)]
    begins = [datetime.fromisoformat(item.start_utc) for item in found]
    # Only what looks at the sky is acquired, once for all of its bands.
    assert [(later - begins[0]).total_seconds() for later in begins] == [0, 10, 20, 184, 194, 204]


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


PERIOD_S, WINDOW_S = 5553.6, 0.46 * 5553.6


def visits(star, **more):
    """Sequences of a programme: role, number and window of the visit, frames, and seconds after the begin."""
    found = planned({"scene": star, "band": "F520", "exposure_s": 300, **more}, instrument={"overhead_s": 600})
    first = datetime.fromisoformat(found[0].start_utc)
    after = [(datetime.fromisoformat(item.start_utc) - first).total_seconds() for item in found]
    parts = [item.part for item in found]
    return [
        (part.role, part.visit, part.window, part.n_frames, second) for part, second in zip(parts, after, strict=True)
    ]


@pytest.mark.parametrize(
    ("scheme", "science", "reference", "orbits"),
    [
        ("interleaved", (0, 0), (0, 0), 2),
        ("half", (0, 0), (WINDOW_S / 2, WINDOW_S / 2), 1),
        ("swapped", (0, WINDOW_S / 2), (WINDOW_S / 2, 0), 1),
        ("other_star", (0, 0), (PERIOD_S / 4, PERIOD_S / 4), 1),
    ],
)
def test_visits_begin_where_the_scheme_opens_windows(star, scheme, science, reference, orbits):
    found = visits(star, frames=2, visits=4, reference_scheme=scheme)
    assert len(found) == 8
    for role, visit, window, n_frames, after_s in found:
        in_orbit = science if role == "science" else reference
        assert (after_s - in_orbit[visit % 2] + 1.0) % PERIOD_S == pytest.approx(1.0, abs=1e-5)
        assert (window, n_frames) == (0, 2)
    assert found == sorted(found, key=lambda item: item[-1])
    assert (found[-1][-1] + 1.0) // PERIOD_S == 4 * orbits - 1
    ends = [item[-1] + 2 * 301 + 600 for item in found]
    assert all(later[-1] >= end - 1e-3 for end, later in zip(ends, found[1:], strict=False))


def test_a_visit_longer_than_a_window_goes_on_in_the_next_orbit(star):
    found = visits(star, frames=20, visits=1, reference_visits=1)
    # 8 frames of 301 s fit into 2555 s.
    assert [(role, window, frames) for role, _, window, frames, _ in found] == [
        (role, window, frames) for role in ("science", "reference") for window, frames in enumerate((8, 8, 4))
    ]
    assert [after_s for *_, after_s in found] == pytest.approx([PERIOD_S * k for k in range(6)], abs=1e-5)


def test_gaps_and_references_of_another_number(star):
    found = visits(star, frames=4, visits=4, reference_visits=2, reference_ratio=0.5, visit_gap_h=24)
    assert [role[0] for role, *_ in found] == list("srssrs")
    assert [frames for *_, frames, _ in found] == [4] * 6  # half as many frames in half as many visits
    gaps = [later - found[k][-1] for k, later in enumerate(item[-1] for item in found[1:])]
    assert [gap > 86400 for gap in gaps] == [False, True, True, False, True]


def test_a_frame_has_to_fit_into_its_window(star, refused):
    refused("a frame fits into the window", visits, star, exposure_s=2600, visits=2)
    refused("at most 677.3 s", visits, star, exposure_s=700, visits=2, reference_scheme="half")
    visits(star, exposure_s=2500, visits=2)


def test_realisations_of_programmes_are_their_own(star):
    one, two = {"scene": star, "band": "F520", "role": "reference"}, {"scene": star, "band": "F520", "visits": 2}
    found = planned(one, two, two)
    assert [item.realisation for item in found] == [0, *[1] * 4, *[2] * 4]
    assert [item.folder for item in found[1:]] == [
        f"programme_{k}/visit_00{visit}_{role}" for k in (1, 2) for visit in (1, 2) for role in ("science", "reference")
    ]


def test_a_single_visit_is_no_programme(star):
    plain, one = planned({"scene": star, "band": "F520"}), planned({"scene": star, "band": "F520", "visits": 1})
    assert [item.settings() for item in plain] == [item.settings() for item in one]
    assert (one[0].folder, one[0].part) == ("", None)


def test_visits_share_the_common_part_and_nothing_else(small, star):
    """The common screen changes science frames alike, and references not at all."""

    def maps(common_fraction):
        drift = {"visit_nm": 0.005, "walk_nm_per_sqrt_hour": 0, "common_fraction": common_fraction, "orbital_nm": 0}
        found = planned(
            {"scene": star, "band": "F520", "visits": 2, "fidelity": "quick"},
            instrument=small.changed({"drift": drift}),
        )
        return {(item.part.role, item.part.visit): item.build().mean_rate_map for item in found}

    alone, shared = maps(0.0), maps(1.0)
    for visit in (0, 1):
        assert np.array_equal(alone["reference", visit], shared["reference", visit])
    own = [alone["science", visit] - alone["reference", visit] for visit in (0, 1)]
    common = [shared["science", visit] - alone["science", visit] for visit in (0, 1)]
    inside = np.abs(own[0]) > 0
    correlation = [np.corrcoef(first[inside], second[inside])[0, 1] for first, second in (own, common)]
    assert abs(correlation[0]) < 0.5
    assert correlation[1] > 0.95


def test_references_are_what_is_asked_for(star):
    other = star | {"name": "other"}
    planet = {"separation_arcsec": 0.5, "pa_deg": 45, "radius_rjup": 1, "phase_deg": 90, "distance_au": 5}
    found = planned(
        {"scene": star | {"planets": [planet]}, "band": "F520", "visits": 2, "roll_deg": 10},
        {"scene": star, "band": "F520", "visits": 2, "reference_scene": other, "reference_roll_deg": 30},
    )
    own, others = found[1].entry, found[5].entry
    assert (own.scene.name, own.scene.planets, own.roll_deg) == ("star", (), 10)
    assert (others.scene.name, others.roll_deg, found[4].entry.roll_deg) == ("other", 30, 0)


@pytest.mark.parametrize(
    ("sequence", "words"),
    [
        ({"visits": 2, "role": "reference"}, "visits = 2.*role is reference"),
        ({"reference_scheme": "half"}, "reference_scheme = half.*programmes with reference visits"),
        ({"visits": 2, "reference_visits": 0, "reference_roll_deg": 3}, "reference_roll_deg"),
        ({"visit_gap_h": 2}, "visit_gap_h = 2.*several visits"),
        ({"visits": 3, "reference_visits": 2, "reference_scheme": "swapped"}, "reference_visits = 2.*as many as"),
    ],
)
def test_what_programmes_cannot_be(star, sequence, words):
    with pytest.raises(InputError, match=words):
        planned({"scene": star, "band": "F520", **sequence})


def test_windows_hold_the_frames_of_one_visit(small, star):
    sequence = {"scene": star, "band": "F520", "exposure_s": 800, "frames": 4, "fidelity": "quick"}
    sequence["switches"] = {"cosmic_rays": False}
    (plain,) = planned(sequence, instrument=small)
    first, second, *_ = planned(sequence | {"reference_visits": 1}, instrument=small)
    assert [item.part.first_frame for item in (first, second)] == [0, 3]
    frames = [frame.adu for item in (first, second) for frame in item.build().iter_full_frames()]
    assert np.array_equal(frames, plain.build().frames)
    assert second.build().header["VISWIN"] == 2


def test_names_fit_times_that_are_no_whole_microseconds(star):
    instrument = {"drift": {"orbital_period_s": 5555.123456789}, "detector": {"readout_s": 1.0}}
    sequence = {"scene": star, "band": "F520", "exposure_s": 299.123456, "frames": 9, "visits": 12}
    for item in planned(sequence, instrument=instrument, start_utc="2030-05-06T07:08:09.123456"):
        times = sequence_times(item.start_utc, item.exposure_s, item.readout_s, item.n_frames)
        what = SimpleNamespace(camera=item.camera, kind="SCI", instrument=item.entry.instrument)
        assert product_name(what, times, item.obsid) == item.name
