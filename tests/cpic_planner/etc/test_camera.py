"""One frame of a camera: what a configuration makes of it."""

import numpy as np
import pytest

from cpic_planner.etc import FrameCamera
from simulator.config import load_instrument

INFRARED = "F1265"


def visible(**changes):
    instrument = load_instrument({"detector": changes} if changes else None)
    return FrameCamera.of(instrument, "F520"), instrument.detector


def hybrid(**changes):
    instrument = load_instrument({"near_infrared": {"detector": changes}} if changes else None)
    return FrameCamera.of(instrument, INFRARED), instrument.detector_of(INFRARED)


def test_the_visible_camera_is_the_detector():
    camera, detector = visible()
    for name in tuple(
        """
        full_well_e register_full_well_e em_gain_max register_stages cic_e readout_s read_noise_e exposure_min_s
        exposure_max_s
    """.split()
    ):
        assert getattr(camera, name) == getattr(detector, name), name
    assert camera.dark_e_s == detector.dark_rate_e_s == pytest.approx(5e-4, rel=0.05)
    assert camera.rounding_e == pytest.approx(detector.gain_e_adu / 12**0.5)
    assert camera.read_variance_e2 == pytest.approx(detector.read_noise_e**2 + detector.gain_e_adu**2 / 12)
    room = (2**14 - 1 - detector.bias_adu) * detector.gain_e_adu - 5 * detector.read_noise_e
    assert camera.converter_e == pytest.approx(room)
    assert camera.line_shift_s == detector.transfer.line_shift_s
    assert camera.output_well_e == min(room, detector.register_full_well_e)
    assert (camera.light_factor, camera.blooms) == (1.0, True)


@pytest.mark.parametrize(
    ("switch", "changed"),
    [
        ("read_noise", {"read_noise_e": 0.0}),
        ("clock_charge", {"cic_e": 0.0}),
        ("dark", {"dark_e_s": 0.0}),
        ("em_register", {"em_gain_max": 1.0, "register_stages": 0}),
        ("smear", {"line_shift_s": 0.0}),
    ],
)
def test_what_is_switched_off_counts_nothing(switch, changed):
    plain, _ = visible()
    camera, _ = visible(switches={switch: False})
    for name, value in changed.items():
        assert getattr(camera, name) == value
        assert getattr(plain, name) != value


def test_a_converter_without_room():
    camera, _ = visible(adc_bits=8, bias_adu=250, read_noise_e=1000)
    assert camera.converter_e == 0.0


def ramp(n):
    """Variances of a line through ``n`` reads, from its weights: of one read, and of light over its mean."""
    x = np.arange(n) - (n - 1) / 2
    weights = (n - 1) * x / (x @ x)  # charge over the ramp
    shared = np.minimum.outer(np.arange(n), np.arange(n))  # charge of two reads has the light of the earlier in common
    return weights @ weights, weights @ shared @ weights / (n - 1)


@pytest.mark.parametrize("n", [2, 3, 8, 60])
def test_a_line_through_reads(n):
    camera, detector = hybrid(readout_mode="up_the_ramp", n_reads=n)
    reads, light = ramp(n)
    assert camera.read_noise_e**2 == pytest.approx(reads * detector.read_noise_e**2, rel=1e-12)
    assert camera.rounding_e**2 == pytest.approx(detector.gain_e_adu**2 / 12, rel=1e-12)  # of the slope alone
    assert camera.light_factor == pytest.approx(light, rel=1e-12)
    assert camera.exposure_min_s == pytest.approx(n * detector.frame_time_s)


def test_two_reads_are_double_sampling():
    double, detector = hybrid(readout_mode="cds")
    two, _ = hybrid(readout_mode="up_the_ramp", n_reads=2)
    assert double.read_noise_e == pytest.approx(2**0.5 * detector.read_noise_e)
    assert two.read_noise_e == pytest.approx(double.read_noise_e)
    assert two.light_factor == double.light_factor == 1.0


def test_one_read_keeps_the_noise_of_the_reset():
    camera, detector = hybrid(readout_mode="single")
    assert camera.read_noise_e**2 == pytest.approx(detector.read_noise_e**2 + detector.reset_noise_e**2)
    quiet, _ = hybrid(readout_mode="single", switches={"reset_noise": False})
    assert quiet.read_noise_e == detector.read_noise_e
    dark, _ = hybrid(switches={"dark": False, "read_noise": False})
    assert (dark.dark_e_s, dark.read_noise_e) == (0.0, 0.0)


def test_a_hybrid_array_has_no_register():
    camera, detector = hybrid()
    assert (camera.em_gain_max, camera.register_stages, camera.cic_e, camera.blooms) == (1.0, 0, 0.0, False)
    assert camera.register_full_well_e == np.inf
    assert camera.output_well_e == camera.converter_e < np.inf
    assert camera.full_well_e == detector.full_well_e
    assert camera.exposure_max_s == load_instrument().detector.exposure_max_s
