"""Effects of collected charge that stand alone."""

import numpy as np
import pytest

from simulator.camera import FrameNoise, VisibleCamera
from simulator.config import load_instrument


def test_the_glow_of_the_read_out_is_poisson_and_once_a_frame():
    detector = load_instrument({"detector": {"readout_glow": {"charge_e": 20000.0}}}).detector
    camera = VisibleCamera(detector.switched(off=("all",), on=("readout_glow",)))
    exposure = camera.prepare(np.zeros((300, 300)), 1.0, 1.0)
    adu = camera.expose(exposure, seed=1, path=("p",)).adu.astype(float)
    charge_e = (adu - detector.bias_adu) * detector.gain_e_adu
    assert charge_e.mean() == pytest.approx(20000.0, rel=2e-4)
    assert charge_e.var() == pytest.approx(20000.0 + detector.gain_e_adu**2 / 12, rel=0.02)
    expected_e = (camera.expected_adu(exposure).mean() - detector.bias_adu) * detector.gain_e_adu
    assert expected_e == pytest.approx(20000.0, rel=1e-9)
    assert FrameNoise.of(detector, 1.0, 1.0).added_e2["readout_glow"] == pytest.approx(20000.0, rel=1e-9)
