"""The reduced stack: its noise is the one it states."""

import numpy as np
import pytest

from cpic_planner.validation import pedestal_e, reduce_stack
from simulator import load_instrument
from simulator.camera import VisibleCamera
from simulator.detectors import excess_noise_factor2

DETECTOR = load_instrument().detector
SIDE = 41
REGION = np.zeros((SIDE, SIDE), bool)
REGION[4:18, 4:18] = REGION[23:37, 23:37] = True
SETTINGS = {"region": REGION, "exposure_s": 10.0, "em_gain": 200.0, "detector": DETECTOR}
DARK_E = DETECTOR.cic_e + 10.0 * DETECTOR.dark_e_s


def light(level=2.0):
    """A smooth halo, electrons per frame and pixel."""
    y, x = np.indices((SIDE, SIDE)) - SIDE // 2
    return level * np.exp(-np.hypot(x, y) / 12.0)


def sums(rng, mean_e, counts):
    """Gaussian sums of frames with the variance of an EMCCD."""
    factor2 = float(excess_noise_factor2(200.0, DETECTOR.register_stages))
    read = (DETECTOR.read_noise_e**2 + DETECTOR.gain_e_adu**2 / 12) / 200.0**2
    counts = np.asarray(counts, float)[:, None, None]
    sigma = np.sqrt(counts * (factor2 * mean_e + read))
    return counts * mean_e + sigma * rng.standard_normal((len(counts), SIDE, SIDE))


@pytest.mark.parametrize(
    ("modes", "scale", "free"), [(0, 1.0, False), (2, 1.0, False), (0, 3.0, False), (0, 1.0, True)]
)
def test_white_variance_is_the_scatter_over_realisations(modes, scale, free):
    rng = np.random.default_rng(modes)
    science_n, reference_n = [20, 21, 19, 20], [10, 11, 10, 9, 10]
    pulls = []
    for _ in range(60):
        science = sums(rng, light() + DARK_E, science_n)
        mean = light() / scale + DARK_E
        reference = np.multiply.outer(reference_n, mean) if free else sums(rng, mean, reference_n)
        stack = reduce_stack(
            science,
            reference,
            n_modes=modes,
            science_frames=science_n,
            reference_frames=reference_n,
            reference_scale=scale,
            noise_free_reference=free,
            **SETTINGS,
        )
        pulls.append(stack.image_e[REGION] / np.sqrt(stack.white_variance_e2[REGION]))
    pulls = np.array(pulls)
    assert abs(pulls.mean()) < 4 / np.sqrt(pulls.size)
    # A mode of noise takes 1 / pixels of the variance; smoothing moves the light of the edges by some per cent.
    assert np.mean(pulls**2) == pytest.approx(1.0, abs=0.015 + 4 * np.sqrt(2 / pulls.size) + modes / REGION.sum())


def test_sums_of_unequal_length_count_by_their_frames():
    """Noise-free: four sums of 1, 2, 3 and 4 frames of a planet on a halo add up to ten frames of the planet."""
    planet = np.zeros((SIDE, SIDE))
    planet[9:13, 9:13] = 0.5
    counts = np.array([1, 2, 3, 4])
    science = np.multiply.outer(counts, light() + DARK_E + planet)
    reference = np.multiply.outer([5, 5], light() + DARK_E)
    stack = reduce_stack(science, reference, n_modes=0, science_frames=counts, reference_frames=5, **SETTINGS)
    np.testing.assert_allclose(stack.image_e, np.where(REGION, 10 * planet, 0.0), atol=1e-9)
    assert stack.integration_s == 100.0
    inner = np.zeros_like(REGION)
    inner[7:15, 7:15] = True
    np.testing.assert_allclose(stack.halo_e[inner], 10 * light()[inner], rtol=0.03)


def test_a_fainter_reference_star_is_scaled_without_its_dark_charge():
    science = (light() + DARK_E)[None]
    reference = (light() / 7.0 + DARK_E)[None]
    stack = reduce_stack(science, reference, n_modes=0, reference_scale=7.0, **SETTINGS)
    np.testing.assert_allclose(stack.image_e[REGION], 0.0, atol=1e-12)
    # Sky is no light of the star: scaled with it, it leaves a level and no more.
    sky = reduce_stack(science + 3.0, reference + 3.0, n_modes=0, reference_scale=7.0, **SETTINGS)
    np.testing.assert_allclose(sky.image_e[REGION], 0.0, atol=1e-12)


def test_pixels_beyond_the_region_hold_nothing():
    rng = np.random.default_rng(0)
    stack = reduce_stack(
        sums(rng, light(), [3, 3]),
        sums(rng, light(), [3, 3]),
        n_modes=1,
        science_frames=3,
        reference_frames=3,
        **SETTINGS,
    )
    for image in (stack.image_e, stack.white_variance_e2, stack.halo_e):
        assert not image[~REGION].any()
    assert (stack.white_variance_e2[REGION] > 0).all()


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"science_frames": 0}, "science_frames"),
        ({"science_frames": [1, 2, 3]}, "science_frames"),
        ({"reference_frames": [[1.0]]}, "reference_frames"),
        ({"reference_scale": 0.0}, "reference_scale"),
        ({"reference_scale": float("nan")}, "reference_scale"),
    ],
)
def test_what_does_not_fit_is_refused(refused, changes, key):
    images = np.ones((2, SIDE, SIDE))
    refused(key, reduce_stack, images, images, n_modes=0, **SETTINGS | changes)


def test_a_single_image_is_no_sequence(refused):
    refused("science_e", reduce_stack, np.ones((SIDE, SIDE)), np.ones((2, SIDE, SIDE)), n_modes=0, **SETTINGS)


def test_the_pedestal_is_the_dark_charge_of_the_camera_at_any_temperature():
    for kelvin in (193.0, 250.0):
        detector = DETECTOR.model_copy(update={"temperature_k": kelvin}).switched(off=("dark_structure",))
        quiet = VisibleCamera(detector).prepare(np.zeros((9, 9)), 10.0, 200.0).mean_e
        assert pedestal_e(detector, 10.0) == pytest.approx(float(np.median(quiet)) + detector.cic_e, rel=1e-6)
    assert pedestal_e(DETECTOR.switched(off=("dark", "clock_charge")), 10.0) == 0.0
