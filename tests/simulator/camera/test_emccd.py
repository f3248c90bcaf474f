"""Gain against voltage: the e2v CCD201-20 data sheet (curves read to 10 %) and the inverse."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from simulator.detectors import excess_noise_factor2
from tests.simulator.frames import expected_adu_map, expose_frame, to_electrons

PATH = ("target", "science", "F520", 0, 3)


def _noisy(rate: float, exposure: float, gain: float, det, *, side: int = 400, tag: str = "a"):
    return expose_frame(np.full((side, side), rate), exposure, gain, det, seed=9, path=(tag,))


@pytest.mark.parametrize("gain", [1.1, 1000.0, *(pytest.param(gain, marks=pytest.mark.long) for gain in (1.0, 20.0))])
def test_mean_frame_is_the_expected_map(gain: float, bare_detector) -> None:
    rng = np.random.default_rng(0)
    rates = rng.uniform(0, 2, (24, 27))
    frames = np.stack(
        [expose_frame(rates, 3.0, gain, bare_detector, seed=2, path=("mean", i)).adu for i in range(500)]
    ).astype(float)
    expected = expected_adu_map(rates, 3.0, gain, bare_detector)
    pull = (frames.mean(axis=0) - expected) / (frames.std(axis=0) / np.sqrt(len(frames)))
    assert np.abs(pull).max() < 4.5
    assert pull.std() == pytest.approx(1, abs=0.3)


def test_photon_transfer(bare) -> None:
    """Gain, read noise and excess noise read back from a ramp, as at the bench."""
    det = bare(cic_e=0.0, dark_e_s=0.0, bias_adu=300)
    for gain in (1.0, 20.0):
        levels = np.array([0.0, 2e3, 5e3, 1e4, 2e4]) if gain == 1 else np.array([0.0, 200, 600, 1500, 3000])
        mean, variance = [], []
        for i, level in enumerate(levels):
            adu = _noisy(level, 1.0, gain, det, side=700, tag=f"ptc{gain}{i}").adu.astype(float)
            mean.append(adu.mean() - 300)
            variance.append(adu.var())
        slope, offset = np.polyfit(mean[1:], np.array(variance[1:]) - variance[0], 1)
        factor2 = float(excess_noise_factor2(gain))
        # Var(ADU) = F^2 g mean(ADU) / K + RN^2 / K^2 + 1/12
        assert slope == pytest.approx(factor2 * gain / det.gain_e_adu, rel=0.01)
        assert variance[0] - 1 / 12 == pytest.approx((det.read_noise_e / det.gain_e_adu) ** 2, rel=0.02)
        assert abs(offset) < 0.02 * variance[-1]


def test_all_switches_off_is_plain_arithmetic(bare) -> None:
    det = bare(cic_e=0.0, dark_e_s=0.0, read_noise_e=0.0)
    rates = np.zeros((5, 5))
    frame = expose_frame(rates, 10.0, 1.0, det, seed=1, path=PATH)
    assert (frame.adu == round(det.bias_adu)).all()
    bright = np.full((100, 100), 3e4)
    frame = expose_frame(bright, 1.0, 1.0, det, seed=1, path=PATH)
    expected = expected_adu_map(bright, 1.0, 1.0, det)
    assert np.abs(frame.adu - expected).max() < 6 * np.sqrt(3e4) / det.gain_e_adu + 0.5


def test_same_path_same_bytes_other_path_other_noise(bare_detector) -> None:
    rates = np.full((30, 40), 0.5)
    one = expose_frame(rates, 10.0, 20.0, bare_detector, seed=1, path=PATH).adu
    assert np.array_equal(one, expose_frame(rates, 10.0, 20.0, bare_detector, seed=1, path=PATH).adu)
    for seed, path in ((2, PATH), (1, (*PATH[:-1], 4))):
        other = expose_frame(rates, 10.0, 20.0, bare_detector, seed=seed, path=path).adu.astype(float)
        correlation = np.corrcoef(one.ravel(), other.ravel())[0, 1]
        assert abs(correlation) < 4 / np.sqrt(one.size)


def test_switching_a_stage_off_leaves_the_others_alone(bare) -> None:
    """A stage's numbers survive the switch of another one: differences are that stage's contribution alone."""
    base = bare(gain_e_adu=1.0, adc_bits=16, bias_adu=5000, read_noise_e=50)
    rates = np.full((60, 50), 0.4)

    def frame(gain: float = 1.0, **values):
        det = type(base)(**{**base.model_dump(), **values})
        return expose_frame(rates, 10.0, gain, det, seed=4, path=PATH).adu.astype(int)

    quiet = frame(read_noise_e=0.0)
    noise = frame() - quiet
    assert noise.std() == pytest.approx(50, rel=0.05)
    no_cic = frame(read_noise_e=0.0, cic_e=0.0)
    clock = quiet - no_cic
    assert set(np.unique(clock)) <= {0, 1, 2}
    assert clock.mean() == pytest.approx(0.02, abs=4 * np.sqrt(0.02 / clock.size))
    assert np.array_equal(frame(cic_e=0.0) - no_cic, noise)


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (137, 137), (33, 61)])
def test_any_window(shape: tuple[int, int], bare_detector) -> None:
    frame = expose_frame(np.full(shape, 0.1), 10.0, 20.0, bare_detector, seed=1, path=PATH)
    assert frame.adu.shape == shape
    assert frame.adu.dtype == np.uint16
    assert expected_adu_map(np.full(shape, 0.1), 10.0, 20.0, bare_detector).shape == shape


def test_each_limit_cuts_and_counts(bare) -> None:
    det = bare(full_well_e=1000.0, register_full_well_e=5000.0, gain_e_adu=0.1, adc_bits=12, bias_adu=100)
    rates = np.zeros((4, 6))
    rates[0, :2] = 1e5
    frame = expose_frame(rates, 1.0, 1.0, det, seed=1, path=PATH)
    assert frame.n_saturated_pixels == 8  # both columns are full
    assert frame.n_register_saturated == 0
    assert (frame.adu[:, :2] == 4095).all()
    assert frame.lost[:, :2].all()
    frame = expose_frame(rates, 1.0, 20.0, det, seed=1, path=PATH)
    assert frame.n_register_saturated == 24  # and trail along the rows to their ends
    assert frame.n_clipped >= 24
    level = expected_adu_map(rates, 1.0, 1.0, bare(full_well_e=1000.0))[0, 0]
    assert level == pytest.approx((1000 + det.cic_e) / 59 + 200)
    level = expected_adu_map(rates, 1.0, 20.0, bare(full_well_e=1000.0, register_full_well_e=5000.0))[0, 0]
    assert level == pytest.approx(5000 / 59 + 200)


def test_low_end_of_the_converter_is_counted(bare) -> None:
    det = bare(bias_adu=0.0)
    frame = _noisy(0.0, 0.0, 1.0, det)
    assert frame.n_clipped == pytest.approx(0.39 * 400**2, rel=0.05)
    assert frame.adu.min() == 0


@pytest.mark.parametrize("bits", [8, 12, 14, 16])
def test_no_wrap_at_any_flux(bits: int, bare) -> None:
    det = bare(adc_bits=bits, bias_adu=100)
    for rate in (0.0, 1e-300, 1e9, 1e15, 1e300):
        for exposure in (1e-6, 1.0, 1e6):
            adu = expose_frame(np.full((3, 3), rate), exposure, 1000.0, det, seed=1, path=PATH).adu
            assert adu.max() <= det.adc_max_adu
            if rate * exposure > 1e6:
                full = min(det.adc_max_adu, det.register_full_well_e / det.gain_e_adu + det.bias_adu)
                assert np.abs(adu - full).max() < 6 * det.read_noise_e / det.gain_e_adu
            expected = expected_adu_map(np.full((3, 3), rate), exposure, 1000.0, det)
            assert np.isfinite(expected).all()
            assert expected.max() <= det.adc_max_adu


@given(
    rate=st.floats(0, 1e12),
    more=st.floats(0, 1e12),
    exposure=st.floats(1e-6, 1e6),
    gain=st.floats(1, 1000),
    factor=st.floats(1, 10),
)
@settings(max_examples=100, deadline=None)
def test_expected_map_never_falls(bare_detector, rate, more, exposure, gain, factor) -> None:
    base = expected_adu_map([[rate]], exposure, gain, bare_detector)[0, 0]
    slack = 1e-9 * base
    assert expected_adu_map([[rate + more]], exposure, gain, bare_detector)[0, 0] >= base - slack
    assert expected_adu_map([[rate]], min(exposure * factor, 1e6), gain, bare_detector)[0, 0] >= base - slack
    assert expected_adu_map([[rate]], exposure, min(gain * factor, 1000), bare_detector)[0, 0] >= base - slack


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, -1.0, -1e-8])
def test_bad_rates_are_refused_with_their_pixel(refused, bad: float, bare_detector) -> None:
    rates = np.ones((4, 5))
    rates[2, 3] = bad
    for call in (
        lambda: expected_adu_map(rates, 1.0, 1.0, bare_detector),
        lambda: expose_frame(rates, 1.0, 1.0, bare_detector, seed=1, path=PATH),
    ):
        refused(r"rate_\w+\[y=2, x=3\]", call)


def test_rounding_error_negatives_are_zero_and_counted(refused, bare_detector) -> None:
    rates = np.ones((4, 5))
    rates[2, 3] = rates[0, 0] = -9e-10
    frame = expose_frame(rates, 1.0, 1.0, bare_detector, seed=1, path=PATH)
    assert frame.n_negative_rates == 2
    assert rates[0, 0] < 0
    refused("", expose_frame, np.full((2, 2), -1e-30), 1.0, 1.0, bare_detector, seed=1, path=PATH)


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"exposure_s": -1.0}, "exposure_s"),
        ({"exposure_s": np.nan}, "exposure_s"),
        ({"exposure_s": "long"}, "exposure_s"),
        ({"exposure_s": [1.0, 2.0]}, "exposure_s"),
        ({"em_gain": 0.5}, "em_gain"),
        ({"em_gain": 1001.0}, "em_gain"),
        ({"em_gain": None}, "em_gain"),
        ({"rate_map_e_s": np.ones(4)}, "rate_map_e_s"),
        ({"rate_map_e_s": np.ones((0, 4))}, "rate_map_e_s"),
        ({"path": "frame"}, "path"),
        ({"path": (1.5,)}, "path"),
        ({"seed": -1}, "seed"),
    ],
)
def test_refusals(refused, values: dict[str, object], named: str, bare_detector) -> None:
    arguments = {"rate_map_e_s": np.ones((3, 3)), "exposure_s": 1.0, "em_gain": 1.0, "seed": 1, "path": PATH}
    refused(named, expose_frame, **{**arguments, **values}, detector=bare_detector)


def test_to_electrons_inverts_the_expected_map(bare_detector) -> None:
    rates = np.linspace(0, 10, 20).reshape(4, 5)
    adu = expected_adu_map(rates, 30.0, 20.0, bare_detector)
    expected = (rates + bare_detector.dark_rate_e_s) * 30 + bare_detector.cic_e
    assert to_electrons(adu, bare_detector, 20.0) == pytest.approx(expected, rel=1e-11)
