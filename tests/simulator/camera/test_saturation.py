from __future__ import annotations

import numpy as np
import pytest

from simulator.camera import binding_limit, expose_frame, gain_cap, pixel_saturated
from simulator.outcome import Reason, Status


def test_cap_by_hand(bare_detector) -> None:
    peak = 1000.0
    level = peak + 5 * np.sqrt(2 * peak)
    cap = gain_cap(peak, bare_detector)
    assert float(cap.gain) == pytest.approx(bare_detector.register_full_well_e / level)
    assert str(cap.limit) == Reason.REGISTER_FULL_WELL
    assert cap.outcome().unwrap() == float(cap.gain)


def test_cap_by_the_converter(bare) -> None:
    det = bare(gain_e_adu=10, adc_bits=12)
    cap = gain_cap(1000.0, det, n_sigma=0)
    assert float(cap.gain) == pytest.approx((4095 - det.bias_adu) * 10 / 1000)
    assert str(cap.limit) == Reason.ADC_RANGE


def test_faint_pixels_are_capped_by_the_register_s_largest_gain(bare_detector) -> None:
    cap = gain_cap([0.0, 1e-3], bare_detector)
    assert (cap.gain == bare_detector.em_gain_max).all()
    assert (cap.limit == "").all()


def test_no_gain_at_all(bare, bare_detector) -> None:
    cap = gain_cap([79000.0, 1e5], bare_detector)
    assert not cap.feasible.any()
    assert (cap.gain == 0).all()
    assert (cap.limit == Reason.PIXEL_FULL_WELL).all()
    outcome = cap.outcome(1)
    assert outcome.status is Status.SATURATED
    assert outcome.reason is Reason.PIXEL_FULL_WELL
    small = gain_cap(50000.0, bare(register_full_well_e=4e4))
    assert small.outcome().reason is Reason.REGISTER_FULL_WELL
    coarse = gain_cap(1.0, bare(adc_bits=8, bias_adu=254, gain_e_adu=1))
    assert coarse.outcome().reason is Reason.ADC_RANGE


def test_cap_is_where_the_binding_limit_starts(bare_detector) -> None:
    peaks = np.geomspace(500, 7e4, 40)
    cap = gain_cap(peaks, bare_detector)
    assert (binding_limit(peaks, cap.gain * (1 - 1e-9), bare_detector) == "").all()
    assert (binding_limit(peaks, cap.gain * (1 + 1e-9), bare_detector) == cap.limit).all()
    assert (np.diff(cap.gain) < 0).all()


def test_pixel_saturated_names_the_limit(bare_detector) -> None:
    fine = pixel_saturated(100.0, 20.0, bare_detector)
    assert fine.unwrap() == pytest.approx(20 * (100 + 5 * np.sqrt(200)) / 730000)
    full = pixel_saturated(1e5, 1.0, bare_detector)
    assert full.reason is Reason.PIXEL_FULL_WELL
    assert "pixel full well" in full.message
    assert pixel_saturated(2000.0, 1000.0, bare_detector).reason is Reason.REGISTER_FULL_WELL


@pytest.mark.parametrize("peak", [30.0, 3000.0])
def test_frames_at_the_cap_do_not_saturate_and_beyond_do(peak: float, bare_detector) -> None:
    rates = np.full((200, 200), peak)
    gain = float(gain_cap(peak, bare_detector).gain)
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
    ],
)
def test_refusals(refused, arguments: tuple[float, float, float], named: str, bare_detector) -> None:
    peak, gain, margin = arguments
    refused(named, binding_limit, peak, gain, bare_detector, margin)
    refused("one number", pixel_saturated, np.ones(3), 1.0, bare_detector)
