"""Saturation: what the ETC forbids is what the camera of the images calls saturated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import nbinom, norm, poisson

from cpic_core import InputError, Reason, Status
from cpic_planner.etc import FrameCamera
from simulator.config import load_instrument
from simulator.signal import Wells, frame_limit, gain_caps, largest_gain, longest_exposure_s, overflow, pixel_saturated
from simulator.signal.saturation import crest_e, largest_mean_e
from tests.simulator.frames import expose_frame

INSTRUMENT = load_instrument()
COARSE = load_instrument({"detector": {"adc_bits": 12}})
CAMERA = FrameCamera.of(INSTRUMENT, "F520")
INFRARED = FrameCamera.of(INSTRUMENT, "F1265")
PEAKS = np.geomspace(1e-4, 1e9, 40)


@pytest.mark.parametrize("instrument", [INSTRUMENT, COARSE], ids=["default", "coarse converter"])
@pytest.mark.parametrize("gain", [1.0, 20.0, 1000.0])
def test_hole_pixels_saturate_as_in_the_images(instrument, gain):
    camera = FrameCamera.of(instrument, "F520")
    seen = [pixel_saturated(float(peak), gain, instrument.detector).reason for peak in PEAKS]
    said = [frame_limit(0.0, float(peak), 0.0, 1.0, gain, camera) for peak in PEAKS]
    assert said == seen
    assert {Reason.NONE, Reason.PIXEL_FULL_WELL} & set(said)
    assert len(set(said)) > 1


@pytest.mark.parametrize("instrument", [INSTRUMENT, COARSE], ids=["default", "coarse converter"])
def test_the_largest_gain_is_that_of_the_images(instrument):
    camera = FrameCamera.of(instrument, "F520")
    for peak, gain in zip(PEAKS.tolist(), largest_gain(PEAKS, 0.0, 1.0, camera).tolist(), strict=True):
        caps = gain_caps(peak, 0.0, peak, 1.0, camera)
        if pixel_saturated(peak, 1.0, instrument.detector).status is Status.SATURATED:
            assert caps["hole"] == caps["frame"] == 0.0
            continue
        assert [caps["hole"], caps["frame"]] == pytest.approx([gain, gain], rel=1e-12)
        assert pixel_saturated(peak, gain * (1 - 1e-9), instrument.detector).status is Status.OK
        if gain < instrument.detector.em_gain_max:
            assert pixel_saturated(peak, gain * (1 + 1e-9), instrument.detector).status is Status.SATURATED


def test_hybrid_arrays_do_not_bloom():
    assert longest_exposure_s(1e9, 0.0, 1e9, INFRARED) == np.inf
    assert frame_limit(1e9, 1.0, 1e9, 10.0, 1.0, INFRARED) is Reason.NONE
    assert frame_limit(0.0, 1e9, 0.0, 10.0, 1.0, INFRARED) is not Reason.NONE


def test_dark_pixels_never_saturate():
    assert longest_exposure_s(0.0, 0.0, 0.0, CAMERA, 1000.0) == np.inf
    assert largest_gain(0.0, 0.0, 1e6, CAMERA) == CAMERA.em_gain_max
    assert gain_caps(0.0, 0.0, 0.0, 300.0, CAMERA) == dict.fromkeys(("hole", "register_tail", "frame"), 1000.0)


def crest(mean_e, factor):
    """Mean and five standard deviations of a law whose variance is ``factor`` times its mean."""
    return mean_e + 5.0 * (factor * mean_e) ** 0.5


def cameras():
    """Cameras of all kinds: wells of 0.1 to a million electrons, with and without blooming, register and converter."""
    rng = np.random.default_rng(11)
    for k in range(60):
        pixel, register, converter = 10 ** rng.uniform(-1, 6, 3)
        yield (
            replace(
                CAMERA,
                full_well_e=pixel,
                register_full_well_e=register,
                converter_e=(np.inf, 0.0, converter)[k % 3],
                em_gain_max=(1.0, 1e3, 1e9)[k // 3 % 3],
                blooms=k % 2 == 0,
            ),
            10 ** rng.uniform(-3, 5, (12, 3)),
            10 ** rng.uniform(-2, 2, 12),
        )


def fills_of(column, hole, tail, exposure_s, gain, camera):
    """Say how full each well is, by its name: the definition of saturation, written out."""
    column, tail = (max(column, hole), tail) if camera.blooms else (hole, 0.0)
    output = gain * crest(hole * exposure_s, 2.0)
    return {
        Reason.PIXEL_FULL_WELL: crest(column * exposure_s, 1.0) / camera.full_well_e,
        Reason.REGISTER_FULL_WELL: max(output, gain * crest(tail * exposure_s, 2.0)) / camera.register_full_well_e,
        Reason.ADC_RANGE: output / camera.converter_e if camera.converter_e else np.inf,
    }


def test_the_limit_that_a_frame_breaks_furthest():
    for camera, rates, exposures in cameras():
        for (column, hole, tail), exposure_s in zip(rates, exposures, strict=True):
            for gain in (1.0, 30.0):
                fills = fills_of(column, hole, tail, exposure_s, gain, camera)
                worst = max(fills, key=fills.get)
                expected = worst if fills[worst] > 1.0 else Reason.NONE
                assert frame_limit(column, hole, tail, exposure_s, gain, camera) is expected


def test_the_longest_frame_by_bisection():
    for camera, rates, _ in cameras():
        for column, hole, tail in rates[:4]:
            for gain in (1.0, 30.0):
                found = float(longest_exposure_s(column, hole, tail, camera, gain))
                if camera.converter_e == 0.0:
                    assert found == 0.0
                    continue

                def excess(log_s, given=(column, hole, tail), gain=gain, camera=camera):
                    return max(fills_of(*given, np.exp(log_s), gain, camera).values()) - 1.0

                assert found == pytest.approx(np.exp(brentq(excess, -60, 60, xtol=1e-13)), rel=1e-9)
            assert longest_exposure_s(column, hole, tail, camera) == longest_exposure_s(column, hole, tail, camera, 1.0)


def test_the_largest_gains_by_definition():
    for camera, rates, exposures in cameras():
        for (_, hole, tail), exposure_s in zip(rates, exposures, strict=True):
            out = min(camera.register_full_well_e, camera.converter_e) / crest(hole * exposure_s, 2.0)
            beside = camera.register_full_well_e / crest(tail * exposure_s, 2.0) if camera.blooms else np.inf
            found = largest_gain(hole, tail, exposure_s, camera)
            assert found == pytest.approx(min(out, beside, camera.em_gain_max), rel=1e-12)


def test_caps_by_definition():
    """A cap is 0 where gain 1 is too much, or where a pixel that it is to spare overflows its own well at any gain."""
    for camera, rates, exposures in cameras():
        for (frame, hole, tail), exposure_s in zip(rates, exposures, strict=True):
            out = min(camera.register_full_well_e, camera.converter_e)
            beside = tail if camera.blooms else 0.0
            wells = {"hole": (hole, out), "frame": (frame, out), "register_tail": (beside, camera.register_full_well_e)}
            expected = {}
            for name, (rate, well) in wells.items():
                cap = min(well / crest(rate * exposure_s, 2.0) if rate else np.inf, camera.em_gain_max)
                spilt = name != "register_tail" and crest(rate * exposure_s, 1.0) > camera.full_well_e
                expected[name] = 0.0 if cap < 1.0 or spilt else cap
            found = gain_caps(hole, tail, frame, exposure_s, camera)
            assert found == pytest.approx(expected, rel=1e-12)


def test_wells_of_no_electrons_bind_no_pixel_without_light():
    """Nothing over nothing: a pixel without light never saturates, whatever the well."""
    full = replace(CAMERA, converter_e=0.0)
    well = float(longest_exposure_s(2.0, 0.0, 0.0, full)) * 2.0
    assert crest(well, 1.0) == pytest.approx(CAMERA.full_well_e, rel=1e-12)
    assert largest_gain(0.0, 0.0, 1.0, full) == CAMERA.em_gain_max
    assert largest_gain(0.0, 0.0, 1.0, replace(CAMERA, register_full_well_e=0.0)) == CAMERA.em_gain_max


def test_a_gain_of_one_that_just_fits_is_allowed():
    mean = 50.0
    camera = replace(CAMERA, register_full_well_e=crest(mean, 2.0), converter_e=np.inf)
    assert gain_caps(mean, mean, mean, 1.0, camera) == dict.fromkeys(("hole", "register_tail", "frame"), 1.0)


def test_charge_that_just_fits_its_pixel_is_allowed():
    camera = replace(CAMERA, register_full_well_e=np.inf, converter_e=np.inf)
    mean = float(largest_mean_e(camera.full_well_e, 1.0))
    assert gain_caps(mean, 0.0, mean, 1.0, camera)["hole"] == camera.em_gain_max
    assert gain_caps(mean * (1 + 1e-12), 0.0, mean, 1.0, camera)["hole"] == 0.0


@pytest.mark.parametrize("factor2", [1.0, 2.0])
def test_a_margin_and_the_mean_that_has_it(factor2):
    mean = np.array([0.0, 0.5, 4.0, 1e6])
    np.testing.assert_allclose(crest_e(mean, factor2), mean + 5.0 * np.sqrt(factor2 * mean), rtol=1e-15)
    np.testing.assert_allclose(crest_e(mean, factor2, 8.0), mean + 8.0 * np.sqrt(factor2 * mean), rtol=1e-15)
    found = [largest_mean_e(float(level), factor2) for level in crest_e(mean, factor2)]
    np.testing.assert_allclose(found, mean, rtol=1e-9)
    assert largest_mean_e(-3.0, factor2) == 0.0
    assert largest_mean_e(np.inf, factor2) == np.inf


def test_pixels_bloom_unless_it_is_said():
    wells = {"full_well_e": 8e4, "register_full_well_e": 7e5, "converter_e": 9e5, "em_gain_max": 1e3}
    assert Wells(**wells).blooms
    assert Wells(**wells).output_well_e == 7e5
    assert Wells(**wells | {"converter_e": 6e5}).output_well_e == 6e5


@pytest.mark.parametrize("factor2", [1.0, 1.7, 2.0])
def test_overflow_is_that_of_a_normal_law_of_the_square_root(factor2):
    """Mean excess and chance beyond the limit, both by the density there; over 12 sigma there is none."""
    well = 5e4
    edges = np.sqrt(well) - 0.5 * np.sqrt(factor2) * np.array([12.0001, 11.9999, 0.5001, 0.4999])
    mean = np.concatenate([[-2.0, 0.0, 0.3, 4.7e4, 4.9e4, 4.96e4, 5e4, 6e4], edges**2])
    z = 2.0 * (np.sqrt(well) - np.sqrt(np.maximum(mean, 0.0))) / np.sqrt(factor2)
    around = np.sqrt(np.maximum(mean, 1.0))
    near = around * norm.pdf(z) * (1.0 + 1.0 / np.maximum(z, 1e-9))
    expected = np.where(z > 12.0, 0.0, np.where(z > 0.5, near, 1.0 + around))
    np.testing.assert_allclose(overflow(mean, well, factor2), expected, rtol=1e-12)
    assert overflow(1.0, 1.5625, 1.0) == 2.0  # half a sigma below
    assert overflow(1.0, 49.0, 1.0) == pytest.approx(norm.pdf(12.0) * 13.0 / 12.0, rel=1e-12, abs=0.0)
    z = 2.0 * (1.5 - np.sqrt(0.25))
    assert overflow(0.25, 2.25, 1.0) == pytest.approx(norm.pdf(z) * (1.0 + 1.0 / z), rel=1e-12, abs=0.0)


@pytest.mark.parametrize("mean", [20.0, 300.0])
def test_no_counts_overflow_by_more(mean):
    """Mean charge beyond a limit, of Poisson counts and of counts with twice their variance, in electrons."""
    level = np.arange(int(mean + 40 * np.sqrt(2 * mean)) + 60)
    for law, factor2 in ((poisson(mean), 1.0), (nbinom(mean, 0.5), 2.0)):
        for well in (mean + 3 * np.sqrt(mean), mean + 6 * np.sqrt(mean)):
            lost = float(np.maximum(level - well, 0.0) @ law.pmf(level))
            assert 0.0 < lost < float(overflow(mean, well, factor2)) * np.sqrt(factor2)


def test_pixel_saturated_names_the_limit(bare_detector) -> None:
    fine = pixel_saturated(100.0, 20.0, bare_detector)
    assert fine.unwrap() == pytest.approx(20 * (100 + 5 * np.sqrt(200)) / 730000)
    # Charge in a pixel has the variance of its Poisson law, that of the register's output twice as much.
    bright = pixel_saturated(7e4, 1.0, bare_detector)
    assert bright.unwrap() == pytest.approx((7e4 + 5 * np.sqrt(7e4)) / bare_detector.full_well_e, rel=1e-12)
    full = pixel_saturated(1e5, 1.0, bare_detector)
    assert full.reason is Reason.PIXEL_FULL_WELL
    assert "pixel full well" in full.message
    assert pixel_saturated(2000.0, 1000.0, bare_detector).reason is Reason.REGISTER_FULL_WELL
    assert pixel_saturated(1e-3, 1e4, bare_detector).value is not None
    with pytest.raises(InputError, match="em_gain"):
        pixel_saturated(1e-3, 10_001.0, bare_detector)


def test_pixel_saturated_by_the_converter(bare) -> None:
    """Bias and margin leave half an electron of the range of a converter, or none: then any light is too much."""
    short = {"adc_bits": 8, "gain_e_adu": 1.0}
    half = bare(bias_adu=254.5, read_noise_e=0.0, **short)
    assert pixel_saturated(0.1, 1.0, half, 0.0).unwrap() == pytest.approx(0.2, rel=1e-12)
    for read_noise_e in (1.0, 110.0):
        none = bare(bias_adu=254, read_noise_e=read_noise_e, **short)
        assert pixel_saturated(1e-6, 1.0, none, 1.0).reason is Reason.ADC_RANGE
    narrow = bare(gain_e_adu=10, adc_bits=12)
    full = (4095 - narrow.bias_adu) * 10 / 1000.0
    assert pixel_saturated(1000.0, full * (1 + 1e-9), narrow, 0.0).reason is Reason.ADC_RANGE
    assert pixel_saturated(1000.0, full * (1 - 1e-9), narrow, 0.0).unwrap() == pytest.approx(1.0, rel=1e-8)


@pytest.mark.parametrize("peak", [30.0, 3000.0])
def test_frames_at_the_cap_do_not_saturate_and_beyond_do(peak: float, bare_detector) -> None:
    rates = np.full((200, 200), peak)
    gain = min(bare_detector.em_gain_max, bare_detector.register_full_well_e / (peak + 5 * np.sqrt(2 * peak)))
    frame = expose_frame(rates, 1.0, gain, bare_detector, seed=1, path=("cap",))
    # Gamma-like tails are heavier than a normal's: 5 sigma leave a few pixels in 1e5 at small signals.
    assert frame.n_saturated_pixels == 0
    assert frame.n_register_saturated + frame.n_clipped <= 40000 * 1e-4
    over = pixel_saturated(peak, min(2 * gain, 1000.0), bare_detector)
    if 2 * gain < 1000:
        assert over.status is Status.SATURATED


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ((-1.0, 2.0, 5.0), "peak"),
        ((np.nan, 2.0, 5.0), "peak"),
        ((1.0, 0.0, 5.0), "gain"),
        ((1.0, 2.0, -1.0), "n_sigma"),
        ((1.0, 2.0, 100.5), "n_sigma"),
    ],
)
def test_refusals(refused, arguments: tuple[float, float, float], named: str, bare_detector) -> None:
    peak, gain, margin = arguments
    refused(named, pixel_saturated, peak, gain, bare_detector, margin)
    refused("one number", pixel_saturated, np.ones(3), 1.0, bare_detector)
