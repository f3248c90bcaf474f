"""An effect that needs the frame before, of one file and one line of the chain: drawn, predicted, and never dropped.

It runs in a process of its own, where the line is there before anything reads the chain.
"""

import pytest

from simulator.camera import FrameNoise, VisibleCamera, stackable
from simulator.config import load_instrument
from simulator.detectors import Effect
from tests.simulator.detectors.chained import told_by

FRACTION, GAIN = 0.1, 20.0


@pytest.fixture(scope="module")
def told():
    """What the program says with the effect in the chain."""
    return told_by("with_afterglow.py", FRACTION, GAIN)


def test_frames_hold_what_comes_back(told):
    """Mean and variance behind a frame of the same light are those of the law; the first frame has none."""
    (mean, variance), (mean_alone, variance_alone) = told["frames"]
    assert mean - mean_alone == pytest.approx(FRACTION * 1000.0, rel=0.01)
    behind = told["noise"][0]
    # 90 000 pixels: the variance is known to 0.5 %.
    assert variance == pytest.approx(told["noise"][1], rel=0.03)
    assert (variance - behind) / (variance_alone - behind) == pytest.approx(1.0 + FRACTION, rel=0.03)
    first, second = told["sequence"]
    assert first is None
    assert second == pytest.approx(FRACTION, rel=0.02)
    assert told["untouched"]


def test_calculator_and_ledger_count_it(told):
    """The ledger has its row and size, the calculator its term and a lower SNR."""
    kept, nothing, off = told["rows"]
    assert (kept["decision"], nothing["reason"], off["reason"]) == ("kept", "afterglow.fraction is 0", "switched off")
    assert told["size"]["planet_flux"] == FRACTION
    assert 0.0 < told["size"]["snr"] - FRACTION < 0.5 * FRACTION
    assert told["size"]["pixel_map"] > 0.0
    glowing, plain = told["budget"]
    assert "afterglow_e2" not in plain
    light = sum(plain[f"{name}_e2"] for name in ("halo", "companion", "sky", "exozodi", "dark", "smear"))
    assert glowing["afterglow_e2"] == pytest.approx(FRACTION * light, rel=1e-9)
    # All light is counted once more, of the planet too: the SNR falls by less than half the fraction.
    assert 1.0 - 0.5 * FRACTION < told["snr"][0] / told["snr"][1] < 0.99


def test_what_cannot_have_it_refuses(told):
    """Sums of frames and counted photons name it."""
    assert told["stackable"] == told["hole"] == "afterglow does not add up over frames: switch it off"
    for key in ("stack", "hole_stacks"):
        assert "afterglow does not add up over frames" in told[key]
    assert "switches.afterglow" in told["counting"]


def test_a_memory_says_what_comes_back():
    """A class that predictions would not know of is none."""
    with pytest.raises(TypeError, match="must say what comes back"):
        type("Forgetful", (Effect,), {"switch": "x", "remembers": True})


def test_persistence_has_its_variance():
    """Charge that comes out late is noise: all that a frame leaves, in frames of the same light."""
    on = load_instrument({"near_infrared": {"detector": {"switches": {"persistence": True}}}}).near_infrared.detector
    fraction = on.persistence.fraction
    quiet = FrameNoise.of(on.switched(off=("persistence",)), 1.0, 60.0)
    noise = FrameNoise.of(on, 1.0, 60.0)
    assert noise.of_past == fraction > 0.0
    more = float(noise.variance_e2(1e4) - quiet.variance_e2(1e4))
    assert more == pytest.approx(quiet.factor2 * fraction * (1e4 + quiet.dark_e), rel=1e-9)


def test_sums_without_a_memory_are_as_they_were():
    """Nothing is refused where nothing remembers."""
    camera = VisibleCamera(load_instrument().detector.switched(off=("all",), on=("photon_noise", "read_noise")))
    assert camera.memory_s == 0.0
    assert stackable(camera, camera.prepare([[1.0] * 20] * 20, 1.0, 1.0)).status.value == "ok"
