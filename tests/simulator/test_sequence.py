"""Sequences: epochs, streams, stacks, both cameras."""

import itertools

import numpy as np
import pytest

from catalogs.errors import InputError
from simulator import load_instrument, observe

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


def test_a_stack_of_what_saturates_or_of_infrared_frames_is_refused():
    bright = observe(SCENE | {"cstar": {"v_mag": 0.0, "teff_k": 5800}}, band="F662", exposure_s=300.0, em_gain=20.0,
                     window="hole", switches=STILL)  # fmt: skip
    with pytest.raises(InputError, match="one draw"):
        bright.stack()
    with pytest.raises(InputError, match="visible"):
        observe(SCENE, band="F940", exposure_s=1.0, window="hole").stack()


def test_light_of_epochs_is_shared_out_over_the_frames():
    seen = observe(SCENE, band="F662", exposure_s=1.0, n_frames=30, window="hole")
    maps = [seen.rate_map(i) for i in range(30)]
    assert sum(not np.array_equal(a, b) for a, b in itertools.pairwise(maps)) == 11
    assert np.mean(maps, axis=0) == pytest.approx(seen.mean_rate_map, rel=0.2)
    with pytest.raises(InputError, match="frame"):
        seen.frame(30)


def test_infrared_frames_have_their_own_detector():
    config = load_instrument()
    seen = observe(SCENE, band="F940", exposure_s=20.0, n_frames=2)
    assert seen.shape == config.near_infrared.detector.shape
    frame = seen.frame(1)
    assert frame.adu.dtype == np.uint16
    assert seen.header["CAMERA"] == "NIR"
    assert seen.header["PIXSCALE"] == config.near_infrared.pixel_scale_arcsec
    assert "EMVOLT" not in seen.header
    dim = observe(SCENE | {"cstar": {"v_mag": 12.0, "teff_k": 5800}}, band="F940", exposure_s=1.0,
                  switches={"cosmic_rays": False})  # fmt: skip
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
    off = {"photon_noise": False, "em_register": False, "read_noise": False, "interference": False, "bias_drift": False,
           "clock_charge": False, "cosmic_rays": False, "smear": False}  # fmt: skip
    whole, part = (
        observe(SCENE, band="F662", exposure_s=100.0, window=window, switches=off) for window in ("full", "hole")
    )
    row, column = part.first_pixel
    cut = whole.frame(0).adu[row : row + 137, column : column + 137].astype(int)
    assert np.abs(cut - part.frame(0).adu)[:, 3:].max() <= 1
