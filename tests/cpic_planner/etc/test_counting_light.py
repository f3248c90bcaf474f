"""White noise of counted photons: which light counts where."""

from dataclasses import replace

import numpy as np
import pytest

from cpic_planner.etc.counting_light import LIGHT_ARRAYS, CountingLight, counted
from cpic_planner.etc.photon_counting import counting_law, counting_variance

LAW = counting_law(1000.0, 604, 100.0, 500.0)
PARTS = dict(
    zip(
        LIGHT_ARRAYS,
        np.array(
            [[0.02, 0.5], [0.01, 0.1], [0.03, 0.2], [0.02, 0.05], [0.02, 0.04], [17.0, 17.0], [1.0, 0.5], [34.0, 8.0]]
        ),
        strict=True,
    )
)
LIGHT = CountingLight(**PARTS, law=LAW, own_noise=True)


def test_each_light_counts_in_its_pixels():
    t = np.array([3.0, 2.0])
    quiet = PARTS["quiet_e_s"] * t + PARTS["quiet_e"]
    expected = (
        17.0 * counting_variance(quiet + PARTS["planet_e_s"] * t, LAW)
        + PARTS["mean_pixels"] * counting_variance(quiet, LAW)
        + PARTS["reference_pixels"] * counting_variance(PARTS["reference_e_s"] * t + PARTS["reference_e"], LAW)
    )
    np.testing.assert_allclose(LIGHT.frame_variance(t), expected, rtol=1e-14)
    without = expected - 17.0 * (
        counting_variance(quiet + PARTS["planet_e_s"] * t, LAW) - counting_variance(quiet, LAW)
    )
    np.testing.assert_allclose(replace(LIGHT, own_noise=False).frame_variance(t), without, rtol=1e-14)


def test_a_planet_too_bright_to_count_has_no_answer_either_way():
    t = np.array([1.0, 100.0])  # 0.02 and 50 electrons of the planet in each pixel
    for own in (True, False):
        value = replace(LIGHT, own_noise=own).frame_variance(t)
        assert np.isfinite(value[0])
        assert np.isposinf(value[1])


def test_no_pixels_no_noise_however_bright():
    np.testing.assert_array_equal(counted(np.array([0.0, 2.0]), np.array([1e9, 0.1]), LAW)[0], 0.0)
    assert counted(np.array([2.0]), np.array([0.1]), LAW)[0] == pytest.approx(2.0 * counting_variance(0.1, LAW))


def test_selected_spread_and_stacked():
    t = np.array([3.0, 2.0])
    both = LIGHT.frame_variance(t)
    np.testing.assert_array_equal(LIGHT.at(np.array([False, True])).frame_variance(t[1:]), both[1:])
    np.testing.assert_array_equal(
        LIGHT.spread((4, 2)).frame_variance(np.broadcast_to(t, (4, 2))), np.tile(both, (4, 1))
    )
    np.testing.assert_array_equal(CountingLight.stacked([LIGHT] * 3).frame_variance(np.tile(t, (3, 1)))[2], both)
