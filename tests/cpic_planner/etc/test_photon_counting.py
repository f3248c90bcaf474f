"""Photon counting against the register's own distribution, Monte Carlo of the register, and closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from cpic_planner.etc.photon_counting import (
    MAX_MEAN_E,
    CountingLaw,
    CountingLight,
    counted,
    counting_law,
    counting_variance,
)
from simulator.detectors import excess_noise_factor2, stage_probability
from simulator.detectors.gain import multiply, output_pmf

# Mean electrons, and frames of a stack in which the mean is known to a fourth of itself or better.
STACKS = ((0.003, 40000), (0.03, 4000), (0.3, 1500), (1.0, 1500))


LAW = counting_law(1000.0, 604, 100.0, 500.0)
PARTS = {
    "planet_e_s": [0.02, 0.5],
    "quiet_e_s": [0.01, 0.1],
    "reference_e_s": [0.03, 0.2],
    "quiet_e": [0.02, 0.05],
    "reference_e": [0.02, 0.04],
    "science_pixels": [17.0, 17.0],
    "mean_pixels": [1.0, 0.5],
    "reference_pixels": [34.0, 8.0],
}
PARTS = {name: np.array(value) for name, value in PARTS.items()}
LIGHT = CountingLight(**PARTS, law=LAW, own_noise=True)


@pytest.mark.parametrize(
    ("gain", "stages", "read_noise", "sigma", "most"),
    [
        (300.0, 604, 110.0, 3.0, 30),
        (1000.0, 604, 110.0, 5.0, 5),
        (20.0, 604, 110.0, 1.0, 40),
        (1.0, 604, 110.0, 5.0, 40),
        (50.0, 8, 3.0, 4.0, 40),
        (2.0, 604, 0.1, 3.0, 40),
        (300.0, 604, 3.0, 0.0, 5),
        (100.0, 604, 110.0, 20.0, 40),
    ],
)
def test_table_is_the_register_blurred_by_the_read_noise(gain, stages, read_noise, sigma, most):
    """The same sum from the whole distribution of the output, which takes a hundred times as long."""
    law = counting_law(gain, stages, read_noise, sigma * read_noise)
    p = float(stage_probability(gain, stages))
    for n in {0, 1, 2, most}:
        size = 1 << math.ceil(math.log2(gain * (n + math.sqrt(72 * n) + 36) + n + 40))
        pmf = output_pmf(n, p, stages, size)
        expected = float(pmf @ ndtr(np.arange(size) / read_noise - sigma))
        assert law.e[n] == pytest.approx(expected, abs=1e-11 if sigma <= 5 else 1e-8)
    assert np.all(np.diff(law.e) >= 0)
    assert np.all((law.e >= 0) & (law.e <= 1))


@pytest.mark.parametrize(
    ("gain", "sigma"),
    [
        (300.0, 3.0),
        (1000.0, 5.0),
        *(pytest.param(*one, marks=pytest.mark.long) for one in ((300.0, 5.0), (1000.0, 3.0))),
    ],
)
def test_counts_and_scatter_match_monte_carlo(gain, sigma):
    """Photons through the register, read noise, threshold; the mean of many pixels inverted by bisection."""
    rng, read_noise, stacks = np.random.default_rng(11), 110.0, 200
    law = counting_law(gain, 604, read_noise, sigma * read_noise)
    for mean, frames in STACKS:
        output = multiply(rng.poisson(mean, (stacks, frames)), gain, rng=rng)
        counts = (output + read_noise * rng.standard_normal(output.shape) > sigma * read_noise).mean(axis=1)
        expected = float(law.q(mean))
        error = math.sqrt(expected * (1 - expected) / output.size)
        assert abs(counts.mean() - expected) < 4.5 * error
        low, high = np.zeros(stacks), np.full(stacks, MAX_MEAN_E)
        for _ in range(50):
            middle = 0.5 * (low + high)
            short = law.q(middle) < counts
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        assert low.min() > 0.0  # no stack has so few counts that the inverse is cut off
        ratio = low.var(ddof=1) * frames / float(counting_variance(mean, law))
        assert ratio == pytest.approx(1.0, abs=0.03 + 4.5 * math.sqrt(2 / stacks))


def test_scatter_of_a_perfect_register():
    """No read noise: one electron or more is one count, and the variance is exp(mean) - 1."""
    mean = np.array([0.0, 1e-6, 0.1, 1.0, 3.0, MAX_MEAN_E])
    for law in (counting_law(1000.0, 604, 0.0, 0.0), counting_law(1000.0, 604, 1e-3, 6e-3)):
        assert law.q(mean) == pytest.approx(-np.expm1(-mean), abs=2e-9)
        assert counting_variance(mean, law)[1:] == pytest.approx(np.expm1(mean[1:]), rel=2e-3)


@pytest.mark.parametrize(
    ("gain", "sigma", "expected"),
    [
        (300.0, 3.0, (1.86, 1.34, 0.99, 0.77)),
        (1000.0, 5.0, (1.34, 1.17, 1.07, 0.96)),
        (3000.0, 5.0, (1.32, 1.29, 1.25, 1.17)),
    ],
)
def test_first_order_law_gives_the_known_gains_over_analogue(gain, sigma, expected):
    """An exponential register, one electron as good as several: the usual estimate.

    The exact law is better than that, 5 % at 0.01 electrons and gain 300 because read noise lifts outputs over the
    threshold, 27 % at 0.3 because two electrons pass it more often than one.
    """
    mean, read_noise = np.array([0.01, 0.03, 0.1, 0.3]), 100.0
    analogue = excess_noise_factor2(gain) * mean + read_noise**2 / gain**2
    passed = np.full(41, np.exp(-sigma * read_noise / gain))
    passed[0] = ndtr(-sigma)
    usual = CountingLaw(gain, read_noise, sigma * read_noise, passed)
    found = np.sqrt(analogue / counting_variance(mean, usual))
    assert found == pytest.approx(expected, abs=0.012)
    exact = np.sqrt(analogue / counting_variance(mean, counting_law(gain, 604, read_noise, sigma * read_noise)))
    assert np.all(exact > found)
    assert exact == pytest.approx(found, rel=0.28 if gain < 1000 else 0.13)


def test_where_counts_say_nothing():
    law = counting_law(1000.0, 604, 110.0, 550.0)
    mean = np.array([0.0, 1e-300, MAX_MEAN_E, MAX_MEAN_E * 1.001, 1e300])
    assert law.usable(mean).tolist() == [True, True, True, False, False]
    variance = counting_variance(mean, law)
    assert np.isfinite(variance).tolist() == law.usable(mean).tolist()
    assert not np.isnan(variance).any()
    assert np.all(np.diff(counting_variance(np.linspace(0.05, MAX_MEAN_E, 200), law)) > 0)
    # a threshold that no electron passes without a register
    blind = counting_law(1.0, 604, 110.0, 1100.0)
    assert not blind.usable([0.0, 1.0]).any()
    assert np.isinf(counting_variance([0.0, 1.0], blind)).all()


def test_arrays_keep_their_shape():
    law = counting_law(300.0, 604, 110.0, 330.0)
    mean = np.full((2, 3, 4), 0.1)
    assert counting_variance(mean, law).shape == law.q(mean).shape == (2, 3, 4)
    assert counting_variance(0.1, law).shape == ()


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ((0.5, 604, 110.0, 330.0), "em_gain"),
        ((300.0, 0, 110.0, 330.0), "stages"),
        ((300.0, 604, -1.0, 0.0), "read_noise_e"),
        ((300.0, 604, 110.0, math.nan), "threshold_e"),
        ((300.0, 604, 110.0, 2300.0), "at most 20 times"),
        ((300.0, 604, 0.0, 1.0), "threshold_e"),
    ],
)
def test_bad_registers_are_refused(refused, arguments, word):
    refused(word, counting_law, *arguments)


@pytest.mark.parametrize("mean", [-0.1, math.nan, math.inf])
def test_bad_means_are_refused(refused, mean):
    law = counting_law(300.0, 604, 110.0, 330.0)
    for ask in (law.q, law.usable, lambda value: counting_variance(value, law)):
        refused("mean_e", ask, mean)
    refused("0 to 8", law.q, 8.1)


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


@pytest.mark.parametrize("n_frames", [5, 400])
def test_electrons_of_counts_are_unbiased_and_scatter_as_predicted(n_frames):
    """Along a line even a share of 1 in five frames is finite, and the mean of many pixels is their light."""
    law, rng, mean = counting_law(1000.0, 604, 100.0, 500.0), np.random.default_rng(4), 0.4
    share = rng.binomial(n_frames, law.q(mean), 40_000) / n_frames
    found = law.electrons(share, share.mean())
    error = np.sqrt(counting_variance(mean, law) / n_frames)
    assert found.mean() == pytest.approx(mean, abs=5.0 * error / 200.0)
    assert found.std() == pytest.approx(float(error), rel=0.02)
    brighter = law.electrons(law.q(mean + 0.02), law.q(mean))
    assert brighter == pytest.approx(mean + 0.02, abs=1e-3)
