"""Limits of clean pixels, against the exact law of compound counts by Fourier inversion, and against draws."""

import numpy as np
import pytest
from scipy.special import ndtr

from simulator.detectors.gain import multiply
from simulator.reduction import PixelLaw

STAGES, READ_NOISE_E = 604, 110.0


def exact_tail(mean: float, gain: float, sigma: float, limit: float) -> tuple[float, float]:
    """Chance that Poisson electrons through the register plus Gaussian noise exceed a limit; and their mean there."""
    size = 1 << int(np.ceil(np.log2(gain * (3.0 * limit + 60.0))))
    p = np.expm1(np.log(gain) / STAGES)
    z = np.exp(-2j * np.pi * np.arange(size // 2 + 1) / size)
    for _ in range(STAGES):
        z = z * (1.0 - p + p * z)
    pmf = np.maximum(np.fft.irfft(np.exp(mean * (z - 1.0)), size), 0.0)
    value = np.arange(size) / gain
    reach = (value - limit) / sigma
    beyond = ndtr(reach)
    density = np.exp(-0.5 * np.minimum(reach**2, 700.0)) / np.sqrt(2.0 * np.pi)
    return float(pmf @ beyond), float(pmf @ (value * beyond + sigma * density))


@pytest.mark.parametrize(
    ("gain", "mean"),
    [(g, m) for g in (1.0, 20.0, 300.0, 1000.0) for m in (0.01, 0.3, 10.0)] + [(1.0, 1e4), (300.0, 100.0)],
)
def test_known_mean(gain: float, mean: float) -> None:
    """The chance is below what is asked for, not by much; the mean loses less than 1e-3, or 1e-6 of the read noise."""
    sigma, asked = READ_NOISE_E / gain, 1e-6
    limit = float(PixelLaw(gain, STAGES, sigma, asked).limit_of_mean(mean))
    chance, cut_off = exact_tail(mean, gain, sigma, limit)
    # Where hardly a frame holds an electron the bound gives away most.
    assert (0.02 if mean > 0.1 or sigma > 1.0 else 0.002) * asked < chance < 0.5 * asked
    assert cut_off - mean * chance < 1e-3 * mean + 1e-6 * sigma


@pytest.mark.parametrize(
    ("gain", "n_frames"),
    [
        pytest.param(gain, n_frames, marks=[pytest.mark.long] * ((row + column) % 2))
        for row, gain in enumerate((1.0, 20.0, 300.0, 1000.0))
        for column, n_frames in enumerate((2, 3, 30))
    ],
)
def test_unknown_mean(gain: float, n_frames: int) -> None:
    """The same limit holds whatever the level, with few frames and with many."""
    rng, asked, size = np.random.default_rng(int(gain) + n_frames), 1e-3, 300_000
    chances = []
    for mean in (0.01, 0.1, 1.0, 30.0, 1e4):
        shape = (n_frames, size // n_frames)
        seen = multiply(rng.poisson(mean, shape), gain, rng=rng) / gain
        seen += rng.normal(0.0, READ_NOISE_E / gain, shape)
        law = PixelLaw(gain, STAGES, READ_NOISE_E / gain, asked)
        limit = law.limit_beside_others(seen.sum(axis=0), n_frames)
        chances.append(float(np.mean(seen > limit)) / asked)
    assert max(chances) < 0.35
    assert max(chances) > 0.03


def test_drift_is_allowed_for() -> None:
    """A frame whose light is 10 % above the others' is no hit."""
    rng = np.random.default_rng(3)
    seen = rng.poisson(1e4, (10, 20_000)).astype(float)
    seen[4] = rng.poisson(1.1e4, 20_000)
    law = PixelLaw(1.0, STAGES, sigma_e=1.0, false_alarm=1e-6)
    total = seen.sum(axis=0)
    assert np.mean(seen[4] > law.limit_beside_others(total, 10)) > 0.5
    assert not np.any(seen[4] > law.limit_beside_others(total * 9 / 9.09, 10, drift=0.12))


def test_each_pixel_has_its_own_limit() -> None:
    """Many pixels at once take nearly the limits that they get alone; none is below."""
    mean = np.geomspace(1e-3, 1e5, 5000)
    law = PixelLaw(300.0, STAGES, sigma_e=0.4, false_alarm=1e-6)
    together = law.limit_of_mean(mean)
    alone = np.array([float(law.limit_of_mean(one)) for one in mean[::500]])
    assert (together[::500] >= alone * (1 - 1e-12)).all()
    assert together[::500] == pytest.approx(alone, rel=2e-3)
    assert law.limit_of_mean(np.zeros(0)).shape == (0,)
