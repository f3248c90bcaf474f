"""A stack drawn at once against the sum of frames drawn one by one."""

import numpy as np
import pytest

from simulator.camera import VisibleCamera, excess_noise_factor2, stack_electrons, stackable, to_electrons
from simulator.outcome import Reason, Status

N = 30


@pytest.fixture(scope="module")
def camera(detector):
    return VisibleCamera(detector.switched(off=("nonlinearity",)))


@pytest.mark.parametrize(("gain", "level"), [(1.0, 300.0), (20.0, 0.4), (300.0, 2.0)])
def test_mean_and_variance_are_those_of_the_sum(bare, gain, level):
    det = bare(bias_adu=400)
    camera = VisibleCamera(det)
    exposure = camera.prepare(np.full((300, 300), level), 1.0, gain)
    once = stack_electrons(camera, exposure, N, seed=1, path=("once",))
    frames = [camera.expose(exposure, seed=1, path=("frames", i)).adu for i in range(N)]
    summed = sum(to_electrons(adu, det, gain) for adu in frames)
    mean = N * (level + det.dark_e_s + det.cic_e)
    factor2 = float(excess_noise_factor2(gain))
    variance = factor2 * mean + N * (det.read_noise_e**2 + det.gain_e_adu**2 / 12) / gain**2
    for stack in (once, summed):
        assert stack.mean() == pytest.approx(mean, abs=4.5 * np.sqrt(variance / stack.size) + 1e-4)
        assert stack.var() == pytest.approx(variance, rel=4.5 * np.sqrt((2 + 9 / mean) / stack.size))


def test_the_law_is_that_of_the_sum(bare):
    """Two-sample comparison of the whole distribution, tails of the register included."""
    from scipy import stats

    camera = VisibleCamera(bare(read_noise_e=5.0, bias_adu=400, gain_e_adu=1.0, adc_bits=16))
    exposure = camera.prepare(np.full((250, 250), 0.05), 1.0, 50.0)
    once = stack_electrons(camera, exposure, N, seed=2, path=("once",)).ravel()
    detector = camera.detector
    summed = sum(
        to_electrons(camera.expose(exposure, seed=2, path=("frames", i)).adu, detector, 50.0) for i in range(N)
    ).ravel()
    assert stats.ks_2samp(once, summed).pvalue > 1e-3


def test_what_is_common_to_frames_adds_up_too(camera):
    exposure = camera.prepare(np.zeros((200, 200)), 0.0, 1.0)
    levels = [stack_electrons(camera, exposure, N, seed=s, path=("level",)).mean() for s in range(60)]
    drift = camera.detector.bias_structure.drift_adu * camera.detector.gain_e_adu
    assert np.std(levels) == pytest.approx(drift * np.sqrt(N), rel=0.4)
    assert np.mean(levels) == pytest.approx(0, abs=4.5 * drift * np.sqrt(N / 60))


def test_frames_that_can_saturate_are_refused_with_the_limit(refused, camera, detector):
    for level, gain, reason in ((1e5, 1.0, Reason.PIXEL_FULL_WELL), (3000.0, 300.0, Reason.REGISTER_FULL_WELL)):
        exposure = camera.prepare(np.full((5, 5), level), 1.0, gain)
        answer = stackable(camera, exposure)
        assert answer.status is Status.SATURATED
        assert answer.reason is reason
        refused("one draw", stack_electrons, camera, exposure, 3, seed=1, path=("a",))
    curved = VisibleCamera(detector)
    answer = stackable(curved, curved.prepare(np.zeros((5, 5)), 1.0, 1.0))
    assert answer.reason is Reason.NOT_ADDITIVE
    assert "nonlinearity" in answer.message
    assert stackable(camera, camera.prepare(np.ones((5, 5)), 1.0, 20.0)).unwrap() < 0.1


@pytest.mark.parametrize(("gain", "level"), [(1.0, 10_000.0), (300.0, 1000.0)])
def test_a_sum_may_be_more_than_a_full_well(bare, gain, level):
    """Limits that no frame reaches do not cut their sum."""
    det = bare(gain_e_adu=100.0)
    camera = VisibleCamera(det)
    exposure = camera.prepare(np.full((100, 100), level), 1.0, gain)
    once = stack_electrons(camera, exposure, N, seed=3, path=("once",))
    summed = sum(to_electrons(camera.expose(exposure, seed=3, path=("frames", i)).adu, det, gain) for i in range(N))
    assert N * level > det.full_well_e or N * level * gain > det.register_full_well_e
    sigma = np.sqrt(N * (2 * level + (det.read_noise_e / gain) ** 2))
    assert once.mean() == pytest.approx(summed.mean(), abs=6 * sigma / 100)
    assert once.std() == pytest.approx(summed.std(), rel=0.06)


def test_limits_of_maps_count(refused, bare, tmp_path):
    import dataclasses

    camera = VisibleCamera(bare())
    exposure = camera.prepare(np.zeros((5, 5)), 0.0, 1.0)
    charge = np.zeros((5, 5))
    charge[2, 3] = 5e5
    assert stackable(camera, dataclasses.replace(exposure, cic_e=charge)).reason is Reason.PIXEL_FULL_WELL
    low = dataclasses.replace(exposure, bias_adu=np.full((5, 5), 3.0))
    assert stackable(camera, low).reason is Reason.ADC_RANGE
    for wrong in (0, -1, 1.5, "3", True, 10**7):
        refused("n_frames", stack_electrons, camera, exposure, wrong, seed=1, path=("a",))


def test_rounding_of_the_converter_is_in_the_sum(bare):
    det = bare().switched(off=("read_noise",))
    camera = VisibleCamera(det)
    stack = stack_electrons(camera, camera.prepare(np.full((300, 300), 100.0), 1.0, 1.0), N, seed=4, path=("r",))
    expected = N * (100.0 + det.cic_e) + N * det.gain_e_adu**2 / 12
    assert stack.var() == pytest.approx(expected, rel=0.03)
