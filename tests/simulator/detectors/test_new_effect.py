"""An effect of one file and one line of the chain: what the program then knows of it by itself.

It runs in a process of its own, where the line is there before anything reads the chain.
"""

import pytest

from tests.simulator.detectors.chained import told_by

RMS_E, GAIN = 400.0, 20.0


@pytest.fixture(scope="module")
def told():
    """What the program says with the effect in the chain."""
    return told_by("with_pattern_noise.py", RMS_E, GAIN)


def test_it_is_configured(told):
    """Its default comes with its source, its range is held."""
    assert told["default"] == 0.0
    assert told["source"] == "none is known"
    assert "pattern_noise.rms_e = -1" in told["refused"]
    assert "0 to 10000" in told["refused"]


def test_it_is_drawn(told):
    """Frames and their sums have its variance beside that of the read noise and of the rounding."""
    output = told["read_noise_e"] ** 2 + told["k"] ** 2 / 12
    for key, more in (("frames", RMS_E**2), ("plain", 0.0)):
        frame, stack = told[key]
        # 90 000 pixels: the variance is known to 0.5 %
        assert frame * told["k"] ** 2 == pytest.approx(output + more, rel=0.03)
        assert stack * GAIN**2 == pytest.approx(output + more, rel=0.03)


def test_the_ledger_knows_it(told):
    """One row, kept, without numbers, or switched off; a size, and a choice by it."""
    kept, nothing, off = told["rows"]
    assert (kept["effect"], kept["decision"]) == ("pattern noise of the amplifier", "kept")
    assert nothing["reason"] == "pattern_noise.rms_e is 0"
    assert off["reason"] == "switched off"
    assert told["noise"][0] - told["noise"][1] == pytest.approx((RMS_E / GAIN) ** 2, rel=1e-9)
    assert 0.0 < told["size"]["snr"] < 0.5
    assert 0.4 < told["size"]["pixel_map"] <= 0.5  # nearly all of the variance of a dark pixel, halved
    assert not told["left_out"]


def test_the_exposure_time_calculator_counts_it(told):
    """The budget has its term, in proportion to the read noise; the SNR is lower by what it adds."""
    noisy, quiet = told["budget"]
    assert "pattern_noise_e2" not in quiet
    assert noisy["pattern_noise_e2"] == pytest.approx(
        noisy["read_noise_e2"] * (RMS_E / told["read_noise_e"]) ** 2, rel=1e-9
    )
    assert told["snr"][0] < 0.9 * told["snr"][1]
    assert told["words"] == "pattern noise of the amplifier"
