"""Saturation: what the ETC forbids is what the camera of the images calls saturated."""

from dataclasses import replace

import numpy as np
import pytest

from cpic_planner.etc.camera import FrameCamera
from cpic_planner.etc.limits import frame_limit, gain_caps, largest_gain, longest_exposure_s
from simulator.camera.saturation import binding_limit, gain_cap
from simulator.config import load_instrument
from simulator.outcome import Reason

INSTRUMENT = load_instrument()
COARSE = load_instrument({"detector": {"adc_bits": 12}})
CAMERA = FrameCamera.of(INSTRUMENT, "F520")
INFRARED = FrameCamera.of(INSTRUMENT, "F1265")
PEAKS = np.geomspace(1e-4, 1e9, 40)


@pytest.mark.parametrize("instrument", [INSTRUMENT, COARSE], ids=["default", "coarse converter"])
@pytest.mark.parametrize("gain", [1.0, 20.0, 1000.0])
def test_hole_pixels_saturate_as_in_the_images(instrument, gain):
    camera = FrameCamera.of(instrument, "F520")
    seen = binding_limit(PEAKS, gain, instrument.detector)
    said = [frame_limit(0.0, float(peak), 0.0, 1.0, gain, camera).value for peak in PEAKS]
    assert said == list(seen)
    assert {"", "pixel_full_well"} & set(said)
    assert len(set(said)) > 1


@pytest.mark.parametrize("instrument", [INSTRUMENT, COARSE], ids=["default", "coarse converter"])
def test_the_largest_gain_is_that_of_the_images(instrument):
    camera = FrameCamera.of(instrument, "F520")
    there = gain_cap(PEAKS, instrument.detector)
    here = largest_gain(PEAKS, 0.0, 1.0, camera)
    np.testing.assert_allclose(here[there.feasible], there.gain[there.feasible], rtol=1e-12)
    caps = [gain_caps(float(peak), 0.0, float(peak), 1.0, camera) for peak in PEAKS]
    np.testing.assert_allclose([cap["hole"] for cap in caps], there.gain, rtol=1e-12)
    np.testing.assert_allclose([cap["frame"] for cap in caps], there.gain, rtol=1e-12)


@pytest.mark.parametrize("camera", [CAMERA, INFRARED, FrameCamera.of(COARSE, "F520")], ids=["visible", "nir", "12 bit"])
def test_three_functions_agree(camera):
    """At the longest exposure the frame just fits, at the largest gain of any exposure too."""
    rng = np.random.default_rng(3)
    for _ in range(300):
        column, hole, tail = 10 ** rng.uniform((0, -4, -4), (6, 4, 5))
        gain = float(np.exp(rng.uniform(0, np.log(camera.em_gain_max)))) if camera.em_gain_max > 1 else 1.0
        longest = float(longest_exposure_s(column, hole, tail, camera, gain))
        assert frame_limit(column, hole, tail, longest * (1 - 1e-9), gain, camera) is Reason.NONE
        assert frame_limit(column, hole, tail, longest * (1 + 1e-6), gain, camera) is not Reason.NONE
        exposure = float(longest_exposure_s(column, hole, tail, camera)) * rng.uniform(0.01, 1.0)
        cap = float(largest_gain(hole, tail, exposure, camera))
        assert 1.0 - 1e-9 <= cap <= camera.em_gain_max
        assert frame_limit(column, hole, tail, exposure, cap * (1 - 1e-9), camera) is Reason.NONE
        if cap < camera.em_gain_max:
            assert frame_limit(column, hole, tail, exposure, cap * (1 + 1e-6), camera) is not Reason.NONE


def test_columns_count_their_own_well_and_no_gain():
    longest = float(longest_exposure_s(1e3, 0.01, 0.0, CAMERA, 1000.0))
    mean = 1e3 * longest
    assert mean + 5 * mean**0.5 == pytest.approx(CAMERA.full_well_e, rel=1e-12)
    assert frame_limit(1e3, 0.01, 0.0, longest * 1.001, 1000.0, CAMERA) is Reason.PIXEL_FULL_WELL


def test_a_tail_needs_the_register_only():
    mean = 20.0 * 300.0
    gain = float(largest_gain(0.001, 20.0, 300.0, CAMERA))
    assert gain * (mean + 5 * (2 * mean) ** 0.5) == pytest.approx(CAMERA.register_full_well_e, rel=1e-12)
    assert frame_limit(1.0, 0.001, 20.0, 300.0, gain * 1.001, CAMERA) is Reason.REGISTER_FULL_WELL
    narrow = replace(CAMERA, converter_e=CAMERA.converter_e / 100)
    assert float(largest_gain(0.001, 20.0, 300.0, narrow)) == pytest.approx(gain, rel=1e-12)


def test_hybrid_arrays_do_not_bloom():
    assert longest_exposure_s(1e9, 0.0, 1e9, INFRARED) == np.inf
    assert frame_limit(1e9, 1.0, 1e9, 10.0, 1.0, INFRARED) is Reason.NONE
    assert frame_limit(0.0, 1e9, 0.0, 10.0, 1.0, INFRARED) is not Reason.NONE


def test_dark_pixels_never_saturate():
    assert longest_exposure_s(0.0, 0.0, 0.0, CAMERA, 1000.0) == np.inf
    assert largest_gain(0.0, 0.0, 1e6, CAMERA) == CAMERA.em_gain_max
    assert gain_caps(0.0, 0.0, 0.0, 300.0, CAMERA) == dict.fromkeys(("hole", "register_tail", "frame"), 1000.0)


def test_a_converter_without_room_lets_no_frame_through():
    full = replace(CAMERA, converter_e=0.0)
    assert longest_exposure_s(0.0, 1.0, 0.0, full) == 0.0
    assert frame_limit(0.0, 1.0, 0.0, 1.0, 1.0, full) is Reason.ADC_RANGE


def test_caps_that_spare_more_are_smaller():
    caps = gain_caps(0.05, 30.0, 400.0, 30.0, CAMERA)
    assert caps["frame"] < caps["register_tail"] < caps["hole"]
    assert gain_caps(1e5, 0.0, 1e5, 30.0, CAMERA)["hole"] == 0.0
