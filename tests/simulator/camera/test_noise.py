"""Noise of pixels against a register followed stage by stage, and against frames of both cameras."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from simulator import load_instrument
from simulator.camera import FrameNoise, InfraredCamera, noise as noise_module
from simulator.detectors import FrameTerm, excess_noise_factor2
from tests.simulator.frames import expose_frame, to_electrons


def pixel_variance_e2(charge_e, gain, detector):
    return float(FrameNoise.of(detector, gain, 0.0).charge_variance_e2(charge_e))


def test_terms_by_hand(bare) -> None:
    det = bare(read_noise_e=110, gain_e_adu=59)
    assert pixel_variance_e2(0.0, 1.0, det) == pytest.approx(110**2 + 59**2 / 12)
    assert pixel_variance_e2(3.5, 1.0, det) == pytest.approx(3.5 + 110**2 + 59**2 / 12)
    expected = float(excess_noise_factor2(300.0)) * 3.5 + (110 / 300) ** 2 + (59 / 300) ** 2 / 12
    assert pixel_variance_e2(3.5, 300.0, det) == pytest.approx(expected)


@pytest.mark.parametrize("gain", [1.0, 1.1, 2.0, 20.0, 300.0, 1000.0])
def test_frames_have_this_mean_and_variance(gain: float, bare) -> None:
    det = bare(cic_e=0.3, dark_e_s=0.05, bias_adu=400)
    rate, exposure, side = 0.2, 10.0, 500
    frame = expose_frame(np.full((side, side), rate), exposure, gain, det, seed=5, path=("noise", int(gain * 10)))
    electrons = to_electrons(frame.adu, det, gain)
    mean = (rate + 0.05) * exposure + 0.3
    variance = pixel_variance_e2((rate + 0.05) * exposure + 0.3, gain, det)
    assert frame.n_clipped == frame.n_saturated_pixels == frame.n_register_saturated == 0
    assert abs(electrons.mean() - mean) < 4 * np.sqrt(variance / side**2)
    # Kurtosis of the compound gain law is at most 6/n + 6/lambda, plus 3 of a normal.
    assert electrons.var() == pytest.approx(variance, rel=4 * np.sqrt((2 + 9 / mean) / side**2))


SWITCHES = ("photon_noise", "dark", "clock_charge", "em_register", "read_noise")
LIGHT = np.array([0.0, 1e-4, 0.3, 50.0, 1e6])


def through_register(mean_e, variance_e2, gain, stages):
    """Return the variance at the output over gain^2: a stage doubles each electron with the probability ``p``."""
    p, mean, variance = gain ** (1.0 / stages) - 1.0, mean_e, variance_e2
    for _ in range(stages):
        mean, variance = mean * (1.0 + p), variance * (1.0 + p) ** 2 + mean * p * (1.0 - p)
    return variance / gain**2


# Without photon noise the register's own noise on light that does not fluctuate is outside what is asked here.
@pytest.mark.parametrize("on", [on for on in itertools.product((True, False), repeat=5) if on[0] or not on[3]])
def test_a_pixel_has_the_variance_of_its_electrons_stage_by_stage(on):
    switched = dict(zip(SWITCHES, on, strict=True))
    own = {"cic_e": 0.07, "read_noise_e": 83.0, "gain_e_adu": 47.0, "dark_293k_e_s": 0.0, "switches": switched}
    for gain, dark_e in itertools.product((1.0, 1.7, 40.0, 1000.0), (0.0, 0.2, 30.0)):
        detector = load_instrument({"detector": own | {"dark_e_s": dark_e / 4.0}}).detector
        drawn = (LIGHT + dark_e * switched["dark"]) * switched["photon_noise"] + 0.07 * switched["clock_charge"]
        charge = drawn  # of Poisson counts and a gain without noise
        if switched["em_register"]:
            charge = through_register(drawn, drawn, gain, detector.register_stages)
        # A uniform error of one step, and the amplifier behind the register.
        behind = ((83.0**2 if switched["read_noise"] else 0.0) + 47.0**2 / 12.0) / gain**2
        noise = FrameNoise.of(detector, gain, 4.0)
        np.testing.assert_allclose(noise.variance_e2(LIGHT), charge + behind, rtol=1e-10, atol=1e-300)
        assert noise.gaussian_e2 == pytest.approx(behind, rel=1e-14)
        assert noise.pedestal_e == pytest.approx(dark_e * switched["dark"] + 0.07 * switched["clock_charge"])


@pytest.mark.parametrize("mode", ["single", "cds", "up_the_ramp"])
@pytest.mark.parametrize("off", [(), ("read_noise",), ("dark",)], ids=str)
def test_a_pixel_of_a_hybrid_array_has_the_variance_of_its_frames(mode, off):
    """Several reads of one charge, rounded once: frames of even light with few electrons and with many."""
    flaws = ("flat", "dark_structure", "bad_pixels", "cosmic_rays", "persistence", "nonlinearity")
    own = {"read_noise_e": 12.0, "gain_e_adu": 3.0, "reset_noise_e": 20.0, "dark_e_s": 4.0, "readout_mode": mode}
    tree = {"near_infrared": {"detector": own | {"n_reads": 7, "frame_time_s": 1.0}}}
    detector = load_instrument(tree).near_infrared.detector.switched(off=(*flaws, "interpixel_capacitance", *off))
    camera = InfraredCamera(detector)
    for rate_e_s in (0.0, 200.0):
        exposure = camera.prepare(np.full((300, 300), rate_e_s), 10.0)
        electrons = camera.expose(exposure, seed=4, path=("noise", mode)).adu * detector.gain_e_adu
        said = float(FrameNoise.of(detector, 1.0, 10.0).variance_e2(10.0 * rate_e_s))
        assert electrons.var() == pytest.approx(said, rel=4.5 * np.sqrt(2.0 / electrons.size))


def test_a_register_that_is_off_adds_no_noise(bare) -> None:
    """Charge is multiplied exactly then, and what is behind the register is divided by the gain as ever."""
    off = bare(read_noise_e=110, gain_e_adu=59).switched(off=("em_register",))
    frame = expose_frame(np.full((400, 400), 50.0), 1.0, 300.0, off, seed=5, path=("exact",))
    said = pixel_variance_e2(50.0, 300.0, off)
    assert said == pytest.approx(50.0 + (110**2 + 59**2 / 12) / 300.0**2)
    assert to_electrons(frame.adu, off, 300.0).var() == pytest.approx(said, rel=4.5 * np.sqrt(2.0 / 400**2))


def test_what_another_effect_adds(monkeypatch):
    """Electrons with time and of every frame are counted, what comes behind the register is divided by the gain."""
    detector, terms = load_instrument().detector, {"pattern": FrameTerm(0.01, 0.2, 900.0)}
    plain = FrameNoise.of(detector, 30.0, 5.0)
    real = noise_module.added_variance
    monkeypatch.setattr(noise_module, "added_variance", lambda *given: real(*given) | terms)
    noise = FrameNoise.of(detector, 30.0, 5.0)
    assert noise.gaussian_e2 == pytest.approx(plain.gaussian_e2 + 1.0, rel=1e-12)
    assert noise.pedestal_e == pytest.approx(plain.pedestal_e + 0.25, rel=1e-12)
    more = noise.variance_e2(LIGHT) - plain.variance_e2(LIGHT)
    np.testing.assert_allclose(more, plain.factor2 * 0.25 + 1.0, rtol=1e-6)
    bare = FrameNoise(1.5, 0.1, 2.0, 3.0, 0.4, True)
    assert (bare.gaussian_e2, bare.pedestal_e) == (5.0, 0.5)
    assert float(bare.variance_e2(10.0)) == pytest.approx(1.5 * 10.5 + 5.0, rel=1e-14)
