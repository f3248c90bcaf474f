"""Sequences: epochs, streams, stacks, both cameras."""

import itertools

import numpy as np
import pytest

from cpic_core import InputError
from simulator import calibrate, load_instrument, observe

SCENE = {"name": "s", "cstar": {"v_mag": 6.0, "teff_k": 5800}}
STILL = {"nonlinearity": False, "cosmic_rays": False}


def test_a_stack_is_the_sum_of_the_frames_in_mean():
    settings = {"band": "F662", "exposure_s": 2.0, "n_frames": 24, "em_gain": 20.0, "window": "hole"}
    seen = observe(SCENE, **settings, switches=STILL | {"stripes": False, "interference": False, "bias_drift": False})
    assert seen.light.epochs == 12
    hole = seen.psf.metrics.hole
    detector = seen.instrument.detector
    frames = (seen.frames.astype(float) - detector.bias_adu).sum(axis=0) * detector.gain_e_adu / 20
    stack = seen.stack()
    difference = (stack - frames)[hole]
    assert difference.mean() == pytest.approx(0, abs=4.5 * difference.std() / np.sqrt(hole.sum()))
    assert np.array_equal(stack, seen.stack())
    assert stack[hole].var() == pytest.approx(frames[hole].var(), rel=6 * np.sqrt(2 / hole.sum()))


def test_a_stack_of_what_saturates_or_does_not_add_up_is_refused(refused):
    bright = observe(
        SCENE | {"cstar": {"v_mag": 0.0, "teff_k": 5800}},
        band="F662",
        exposure_s=300.0,
        em_gain=20.0,
        window="hole",
        switches=STILL,
    )
    refused("one draw", bright.stack)
    refused("cosmic_rays", observe(SCENE, band="F940", exposure_s=1.0, window="hole").stack)


def test_light_of_epochs_is_shared_out_over_the_frames(refused):
    seen = observe(SCENE, band="F662", exposure_s=1.0, n_frames=30, window="hole")
    maps = [seen.rate_map(i) for i in range(30)]
    assert sum(not np.array_equal(a, b) for a, b in itertools.pairwise(maps)) == 11
    assert np.mean(maps, axis=0) == pytest.approx(seen.mean_rate_map, rel=0.2)
    refused("frame", seen.frame, 30)


def test_infrared_frames_have_their_own_detector():
    config = load_instrument()
    seen = observe(SCENE, band="F940", exposure_s=20.0, n_frames=2)
    assert seen.shape == config.near_infrared.detector.shape
    frame = seen.frame(1)
    assert frame.adu.dtype == np.uint16
    assert seen.header["CAMERA"] == "NIR"
    assert seen.header["PIXSCALE"] == config.near_infrared.pixel_scale_arcsec
    assert "EMVOLT" not in seen.header
    dim = observe(
        SCENE | {"cstar": {"v_mag": 12.0, "teff_k": 5800}}, band="F940", exposure_s=1.0, switches={"cosmic_rays": False}
    )
    difference = dim.frame(0).adu - dim.expected
    good = (dim.frame(0).mask == 0) & (dim.expected < 5000)
    assert difference[good].mean() == pytest.approx(0, abs=4.5 * difference[good].std() / np.sqrt(good.sum()))


def test_times_and_sections_of_a_sequence():
    seen = observe(SCENE, band="F520", exposure_s=1.0, start_utc="2029-03-01")
    assert seen.start_utc == "2029-03-01T00:00:00"
    assert seen.sections["active"] == (slice(2, 1026), slice(24, 1048))
    assert seen.readout_s == seen.instrument.detector.readout_s
    stamp = observe(SCENE, band="F520", exposure_s=1.0, window="hole")
    assert stamp.sections["active"] == (slice(0, 137), slice(0, 137))
    assert stamp.first_pixel == (514 - 68, 536 - 68)


def test_a_window_is_cut_from_the_same_detector():
    """Flaws of the pixels in a window are those of the same pixels in the frame."""
    off = {
        "photon_noise": False,
        "em_register": False,
        "read_noise": False,
        "interference": False,
        "bias_drift": False,
        "clock_charge": False,
        "cosmic_rays": False,
        "smear": False,
    }
    whole, part = (
        observe(SCENE, band="F662", exposure_s=100.0, window=window, switches=off) for window in ("full", "hole")
    )
    row, column = part.first_pixel
    cut = whole.frame(0).adu[row : row + 137, column : column + 137].astype(int)
    assert np.abs(cut - part.frame(0).adu)[:, 3:].max() <= 1


def infrared(**settings):
    """Frames of the near-infrared camera whose charge comes out late, of a star that fills some pixels."""
    bright = SCENE | {"cstar": {"v_mag": -1.0, "teff_k": 5800}}
    sticky = {"near_infrared": {"detector": {"persistence": {"fraction": 0.05}}}}
    on = {"persistence": True, "cosmic_rays": False}
    standard = {"exposure_s": 20.0, "n_frames": 6, "switches": on, "instrument": sticky}
    return observe(bright, band="F940", window="hole", **(standard | settings))


def test_persistence_is_the_mean_charge_of_earlier_frames():
    seen = infrared()
    detector = seen.instrument.near_infrared.detector
    late, pace = detector.persistence, 20.0 + seen.readout_s
    assert seen.frame(0).charge.get("persistence", 0.0) == 0.0
    for index in (1, 5):
        expected = 0.0
        for past in range(index):
            charge = seen.prepared(seen.rate_map(past)).mean_e
            assert charge.max() > detector.full_well_e
            age = (index - past) * pace - 20.0
            share = np.exp(-age / late.decay_s) - np.exp(-(age + 20.0) / late.decay_s)
            expected += late.fraction * np.minimum(charge, detector.full_well_e).sum() * share
        found = seen.frame(index).charge["persistence"]
        assert expected > 1e4
        assert found == pytest.approx(expected, abs=4.5 * np.sqrt(expected))
    assert seen.frame(5).charge["persistence"] > 3 * seen.frame(1).charge["persistence"]


def test_persistence_does_not_depend_on_which_frames_were_drawn():
    forward = [frame.adu for frame in infrared().iter_full_frames()]
    alone = infrared()
    for index in (5, 0, 3, 5, 1):
        np.testing.assert_array_equal(alone.frame(index).adu, forward[index])


def test_persistence_leaves_the_other_numbers_and_costs_nothing_when_off():
    with_it, without = infrared(), infrared(switches={"cosmic_rays": False})
    np.testing.assert_array_equal(with_it.frame(0).adu, without.frame(0).adu)
    assert "persistence" not in without.frame(3).charge
    assert not without._held_e
    book, other = with_it.frame(3).charge, without.frame(3).charge
    assert book["photons"] == other["photons"]
    assert book["dark"] == other["dark"]


@pytest.mark.parametrize("index", [1.5, -1, 2, "1", True, None, float("nan"), [0]])
def test_frames_that_are_not_there_are_refused_by_name(refused, index):
    seen = observe(SCENE, band="F662", exposure_s=1.0, n_frames=2, window="hole")
    for method in (seen.frame, seen.rate_map):
        refused("frame = .*an integer from 0 to 1$", method, index)
    np.testing.assert_array_equal(seen.frame(np.int64(1)).adu, seen.frame(1).adu)


def test_frames_of_an_epoch_are_counted_once():
    seen = observe(SCENE, band="F662", exposure_s=1.0, n_frames=30, window="hole")
    epochs = [seen._epoch(index) for index in range(30)]
    first = [epochs.index(epoch) for epoch in range(12)]
    assert [seen._first_frame(epoch) for epoch in range(13)] == [*first, 30]


def test_the_rate_of_cosmic_rays_is_only_asked_for_where_they_are(monkeypatch):
    def refuse(*args):
        raise AssertionError("nobody needs it")

    monkeypatch.setattr("simulator.observing.sequence.cosmic_ray_rate", refuse)
    observe(SCENE, band="F662", exposure_s=1.0, window="hole", switches=STILL).frame(0)
    bias = calibrate("BIAS", switches={"nonlinearity": False})
    assert bias.frame(0).n_cosmic_rays == 0
    assert bias.stack().shape == bias.shape  # frames without exposure add up, whatever the switch of particles says


@pytest.mark.parametrize("start", ["2016-12-31T23:59:60", "1972-01-01", "2100-12-31"])
def test_every_begin_that_is_accepted_can_be_drawn(start):
    observe(SCENE, band="F662", exposure_s=1.0, window="hole", start_utc=start).frame(0)
    with pytest.raises(InputError, match="start_utc = 2101-01-01"):
        observe(SCENE, band="F662", exposure_s=1.0, window="hole", start_utc="2101-01-01")


def test_level_of_the_bias_is_that_of_its_map(tmp_path):
    from astropy.io import fits

    values = np.full((1050, 1080), 300.0)
    values[:, ::3] += 7.0
    hdu = fits.PrimaryHDU(values)
    hdu.header["BUNIT"] = "adu"
    hdu.writeto(tmp_path / "bias.fits")
    seen = calibrate("BIAS", instrument={"detector": {"calibration_files": {"bias": str(tmp_path / "bias.fits")}}})
    assert seen.header["BIASLEV"] == 300.0
    assert np.median(seen.frame(0).adu) == pytest.approx(300.0, abs=2)
    row = next(row for row in seen.ledger if row.effect == "stripes of the bias")
    assert row.decision == "kept"
    assert "replaced by the map bias.fits" in row.reason
