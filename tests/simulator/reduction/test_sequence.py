"""Whole reductions: of files that another program wrote, and of the simulated camera at three gains, with pulls."""

import numpy as np
import pytest
from astropy.io import fits

from cpic_core import InputError
from cpic_planner.validation.frames import transferred
from simulator import calibrate, load_instrument, observe, read_level1, write_level0
from simulator.camera import MaskBit, load_calibration_set
from simulator.reduction import Masters, make_master, plans_for, read_level0, reduce_sequence
from simulator.reduction.masters import read_master, write_master

INSTRUMENT = load_instrument()


def masters_of(plans):
    """Make the masters of plans, each with those that it uses."""
    return Masters(
        {kind: (make_master(plan, masters_of({one.kind: one for one in plan.uses})), plan.files[0].exposure_s)
         for kind, plan in plans.items()}, {}
    )  # fmt: skip


def pulls_of(path, truth):
    """Return (reduced - truth) / error of good pixels, frame by frame."""
    frames = read_level1(path).iter_frames()
    return [(frame.image_e - truth)[frame.mask == 0] / frame.error_e[frame.mask == 0] for frame in frames]


def test_a_foreign_night_is_reduced_within_its_errors(night, tmp_path):
    level0 = {kind: read_level0(path, INSTRUMENT) for kind, path in night.paths.items()}
    assert [item.n_frames for item in level0.values()] == [20] * 4
    assert "EMGAIN = 1" in level0["SCI"].assumed
    made = reduce_sequence(level0["SCI"], masters_of(plans_for(level0["SCI"], level0.values())), tmp_path / "a_L1.fits")
    pulls = np.concatenate(pulls_of(tmp_path / "a_L1.fits", night.light_e))
    assert abs(pulls.mean()) < 0.05
    assert pulls.std() == pytest.approx(1.0, abs=0.05)
    found = read_level1(tmp_path / "a_L1.fits")
    assert (found.header["OBSTYPE"], found.header["OBJECT"], found.header["EXPTIME"]) == ("SCI", "a star", 10.0)
    assert (found.header["CRPIX1"], found.header["CRPIX2"]) == (32.5, 33.0)
    assert next(found.iter_frames()).mask[10, 12] & MaskBit.BAD
    assert made.mask_counts["bad"] == 20
    # The same bias, dark and flat calibrate every frame: the mean of 20 is no better than they are.
    mean = np.mean([frame.image_e for frame in found.iter_frames()], axis=0)
    frame_e2 = (found.error_e**2 - found.master_error_e**2) / 20.0
    good = night.flat > 0
    assert np.std(((mean - night.light_e) / np.sqrt(frame_e2 + found.master_error_e**2))[good]) == pytest.approx(
        1.0, abs=0.05
    )


def test_a_text_with_a_colon_stays_a_text(tmp_path):
    header = fits.Header({"OBSTYPE": "SCI", "EXPTIME": 5.0, "OBJECT": "HD: 40307"})
    fits.PrimaryHDU(np.zeros((64, 80), dtype=np.uint16), header=header).writeto(tmp_path / "colon.fits")
    assert read_level0(tmp_path / "colon.fits", INSTRUMENT).header["OBJECT"] == "HD: 40307"


def test_without_masters_the_header_is_used_and_said(night, tmp_path):
    level0 = read_level0(night.paths["SCI"], INSTRUMENT)
    made = reduce_sequence(level0, Masters({}, {}), tmp_path / "a_L1.fits")
    assert made.steps["bias"].startswith("none")
    assert made.steps["flat"] == "none, 1 everywhere"
    header = read_level1(tmp_path / "a_L1.fits").header
    assert (header["B_NAM"], header["F_NAM"]) == (made.steps["bias"], "none, 1 everywhere")


def test_a_single_frame_keeps_its_hits_and_says_so(night, tmp_path):
    with fits.open(night.paths["SCI"]) as units:
        fits.HDUList([units[0].copy(), units[1].copy()]).writeto(tmp_path / "one.fits")
    made = reduce_sequence(read_level0(tmp_path / "one.fits", INSTRUMENT), Masters({}, {}), tmp_path / "one_L1.fits")
    assert made.mask_counts["cosmic_ray"] == 0
    assert "single frame" in read_level1(tmp_path / "one_L1.fits").header["CR_MOD"]


def test_a_hit_is_flagged_with_its_neighbours(night, tmp_path):
    frames = fits.getdata(night.paths["BIAS"], 1)[None].repeat(6, axis=0)
    frames[2, 30, 40] += 3000
    header = fits.Header({"OBSTYPE": "DARK", "EXPTIME": 5.0, "GAIN": 2.0, "RDNOISE": 10.0, "ADCBITS": 16})
    fits.PrimaryHDU(frames, header=header).writeto(tmp_path / "cube.fits")
    level0 = read_level0(tmp_path / "cube.fits", INSTRUMENT)
    assert (level0.n_frames, level0.sections["active"]) == (6, (slice(0, 64), slice(0, 80)))
    reduce_sequence(level0, Masters({}, {}), tmp_path / "cube_L1.fits")
    hit = [
        np.argwhere(frame.mask & MaskBit.COSMIC_RAY) for frame in read_level1(tmp_path / "cube_L1.fits").iter_frames()
    ]
    assert [len(one) for one in hit] == [0, 0, 9, 0, 0, 0]
    np.testing.assert_array_equal(hit[2].mean(axis=0), [30, 40])


def test_masters_are_read_as_they_were_written(night, tmp_path):
    level0 = [read_level0(path, INSTRUMENT) for path in night.paths.values()]
    plan = plans_for(level0[-1], level0)["FLAT"]
    master = make_master(plan, masters_of({one.kind: one for one in plan.uses}))
    write_master(tmp_path / "flat.fits", master, 1.0)
    again, exposure_s = read_master(tmp_path / "flat.fits")
    assert (exposure_s, again.name, set(again.shared)) == (1.0, master.name, {one.name for one in plan.all()})
    np.testing.assert_array_equal(again.value, master.value)


@pytest.mark.parametrize(
    ("card", "value", "said"),
    [
        ("OBSTYPE", None, "OBSTYPE"),
        ("OBSTYPE", "PICTURE", "PICTURE"),
        ("EXPTIME", None, "EXPTIME"),
        ("EXPTIME", -1.0, "EXPTIME"),
        ("GAIN", 0.0, "GAIN"),
        ("EMGAIN", 0.1, "EMGAIN"),
        ("CAMERA", "NIR", "near-infrared"),
        ("DATASEC", "[1:999,1:64]", "DATASEC"),
        ("IMAGE", None, "images"),
    ],
)
def test_what_cannot_be_reduced_is_refused_in_one_line(tmp_path, card, value, said):
    header = {"OBSTYPE": "SCI", "EXPTIME": 5.0} | {card: value}
    data = None if card == "IMAGE" else np.zeros((64, 80), dtype=np.uint16)
    kept = {key: each for key, each in header.items() if each is not None}
    fits.PrimaryHDU(data, header=fits.Header(kept)).writeto(tmp_path / "bad.fits")
    with pytest.raises(InputError) as refused:
        read_level0(tmp_path / "bad.fits", INSTRUMENT)
    assert "\n" not in str(refused.value)
    assert said in str(refused.value)
    assert "bad.fits" in str(refused.value)


@pytest.mark.long
@pytest.mark.parametrize("gain", [1.0, 20.0, 300.0])
def test_pulls_are_those_of_the_stated_error(tmp_path, gain):
    """Darks, flats and a scene with every effect and masters of ten frames: width 1.00 +- 0.05, mean within 0.03."""
    many = {"n_frames": 10, "em_gain": gain}
    made = {
        "bias": calibrate("BIAS", realisation=1, **many),
        "dark": calibrate("DARK", exposure_s=17.0, realisation=2, **many),
        "flat": calibrate("FLAT", exposure_s=1.0, band="F662", level_e=20_000, n_frames=10, realisation=3),
        "bias_of_flat": calibrate("BIAS", n_frames=10, realisation=4),
        "darks": calibrate("DARK", exposure_s=34.0, realisation=5, **many),
        "flats": calibrate("FLAT", exposure_s=2.0, band="F662", level_e=20_000 / gain, realisation=6, **many),
        "scene": observe("paper_example", band="F662", exposure_s=17.0, realisation=7, **many),
    }
    level0 = {key: read_level0(write_level0(one, tmp_path, truth=False), INSTRUMENT) for key, one in made.items()}
    masters = [level0[key] for key in ("bias", "dark", "flat", "bias_of_flat")]
    detector = INSTRUMENT.detector
    response = load_calibration_set(detector).response_of(detector.switches)
    active = detector.sections["active"]
    for key in ("darks", "flats", "scene"):
        reduce_sequence(level0[key], masters_of(plans_for(level0[key], masters)), tmp_path / f"{key}_L1.fits")
        # Losses of transfer are in frames and flats alike; a part of the light arrives one pixel later.
        seen = np.maximum(transferred(response, detector, None), 1e-9)
        moments = []
        for index, frame in enumerate(read_level1(tmp_path / f"{key}_L1.fits").iter_frames()):
            light = made[key].light.map(made[key]._epoch(index)) * made[key].exposure_s
            truth = (transferred(light * response, detector, None) / seen)[active]
            pull = ((frame.image_e - truth) / frame.error_e)[frame.mask == 0]
            assert pull.size > 0.9 * truth.size
            moments.append((pull.mean(), pull.var()))
        mean, variance = np.mean(moments, axis=0)
        assert abs(mean) < 0.03, key
        assert np.sqrt(variance) == pytest.approx(1.0, abs=0.05), key
