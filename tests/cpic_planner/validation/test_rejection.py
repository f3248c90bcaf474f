"""Cosmic rays: found where they are, none where they are not, and no light lost."""

import functools

import numpy as np
import pytest
from scipy.ndimage import correlate

from cpic_planner.validation import aperture_weights, combine, filled, reject_cosmic_rays
from simulator import load_instrument
from simulator.detectors import excess_noise_factor2
from simulator.detectors.gain import multiply
from simulator.effects import draw_cosmic_rays

RADIUS, READ_NOISE_E, SIDE = 2.32, 110.0, 128


@functools.lru_cache(maxsize=4)
def tracks(n_frames: int, exposure_s: float, flux: float, seed: int) -> np.ndarray:
    """Charge of particles, frames (n, y, x)."""
    rng, config = np.random.default_rng(seed), load_instrument().cosmic_rays
    charge = np.zeros((n_frames, SIDE, SIDE), dtype=np.int64)
    for frame in charge:
        hits = draw_cosmic_rays(config, frame.shape, 13.0, exposure_s, flux, rng)
        frame.reshape(-1)[hits.pixels] += hits.electrons
    return charge


def read_out(electrons: np.ndarray, gain: float, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return multiply(electrons, gain, rng=rng) / gain + rng.normal(0.0, READ_NOISE_E / gain, electrons.shape)


def rejected(frames: np.ndarray, gain: float, **more: object) -> np.ndarray:
    usable = np.ones(frames.shape, dtype=bool)
    return reject_cosmic_rays(frames, usable, em_gain=gain, read_noise_e=READ_NOISE_E, **more).rejected


def aperture_sums(frames: np.ndarray) -> np.ndarray:
    """Sums in apertures that do not overlap, (n, apertures)."""
    weights = aperture_weights((9, 9), 4.0, 4.0, RADIUS)
    sums = np.stack([correlate(frame.astype(float), weights, mode="constant") for frame in frames])
    return sums[:, 4:-4:5, 4:-4:5].reshape(len(frames), -1)


@pytest.mark.parametrize("gain", [1.0, 20.0, 300.0, 1000.0])
def test_clean_frames_stay_whole(gain: float) -> None:
    """Levels 0.01 to 1e4 e-: at most 1e-6 false hits asked for, fewer found, and the mean unmoved by 1e-3."""
    rng = np.random.default_rng(int(gain))
    false, size = 0, 0
    for level in (0.01, 0.1, 1.0, 10.0, 100.0, 1e4):
        frames = read_out(rng.poisson(level, (30, SIDE, SIDE)), gain, 7)
        usable = np.ones(frames.shape, dtype=bool)
        found = reject_cosmic_rays(frames, usable, em_gain=gain, read_noise_e=READ_NOISE_E)
        false, size = false + found.n_hit, size + frames.size
        if level >= 1.0:
            before, after = frames.sum(axis=0).mean(), combine(frames, ~found.rejected).image_e.mean()
            assert abs(after - before) / (30 * level) < 1e-3
    assert false <= max(1e-6 * size, 1.0)


def test_bias_at_a_hundred_thousand_times_the_rate() -> None:
    """With a chance of 1e-3 rejection would show what it does to a mean: less than that chance times ten."""
    rng = np.random.default_rng(2)
    frames = read_out(rng.poisson(1.0, (30, SIDE, SIDE)), 300.0, 3)
    out = rejected(frames, 300.0, false_alarm=1e-3, grow=False)
    change = combine(frames, ~out).image_e.mean() / frames.sum(axis=0).mean() - 1.0
    assert 0 < out.mean() < 0.3e-3
    assert -3e-3 < change < 0
    neighbours = rejected(frames, 300.0, false_alarm=1e-3) & ~out
    assert neighbours.mean() > 5 * out.mean()
    # Neighbours go whatever they hold: their mean is that of all.
    error = frames.std() / np.sqrt(neighbours.sum())
    assert abs(frames[neighbours].mean() - frames.mean()) < 4 * error


@pytest.mark.parametrize(("gain", "n_frames"), [(20.0, 30), (300.0, 30), (1000.0, 30), (300.0, 3), (300.0, 2)])
@pytest.mark.parametrize("flux", [0.7, 5.0])
def test_hits_are_found_at_gain(gain: float, n_frames: int, flux: float) -> None:
    """Every aperture that was struck is found, and a thousandth of the charge stays at most."""
    if n_frames < 4:
        flux = 0.7  # two hits in one pixel of three frames cannot be told from light
    charge = tracks(n_frames, 300.0, flux, 5)
    frames = read_out(np.random.default_rng(1).poisson(0.5, charge.shape) + charge, gain, 2)
    out = rejected(frames, gain)
    before, after = aperture_sums(charge), aperture_sums(np.where(out, 0, charge))
    struck = before > 20.0
    assert struck.sum() >= 5
    assert np.mean(aperture_sums(out)[struck] > 0) > 0.995
    assert after.sum() < 1e-3 * before.sum()


def test_what_stays_without_gain_is_below_the_noise() -> None:
    """At gain 1 hits hide in the read noise: what stays adds less than 2 % to that of the stack."""
    charge = tracks(30, 300.0, 1.0, 5)
    frames = read_out(np.random.default_rng(1).poisson(0.5, charge.shape) + charge, 1.0, 2)
    after = aperture_sums(np.where(rejected(frames, 1.0), 0, charge)).sum(axis=0)
    white = READ_NOISE_E * np.sqrt(30 * np.sum(aperture_weights((9, 9), 4.0, 4.0, RADIUS) ** 2))
    assert 0 < after.std() < 0.2 * white
    assert after.mean() < 0.1 * white


def test_planet_keeps_its_light() -> None:
    """A planet at SNR 100: not a pixel goes without particles, and with them its mean is right."""
    rows, columns = np.indices((SIDE, SIDE)) - SIDE // 2
    planet = np.exp(-(rows**2 + columns**2) / (2 * 1.45**2)) / (2 * np.pi * 1.45**2)
    gain, n_frames = 300.0, 30
    per_frame = 1.3e4 * float(excess_noise_factor2(gain)) / n_frames
    light = np.random.default_rng(4).poisson(per_frame * planet + 0.2, (n_frames, SIDE, SIDE))
    weights = aperture_weights((SIDE, SIDE), SIDE // 2, SIDE // 2, RADIUS)
    frames = read_out(light, gain, 5)
    assert not rejected(frames, gain).any()
    flux = float(np.sum(weights * (frames.sum(axis=0) - 0.2 * n_frames)))
    error = np.sqrt(np.sum(weights**2 * n_frames * 2 * (per_frame * planet + 0.2)))
    assert flux / error > 90

    charge = tracks(n_frames, 300.0, 5.0, 6)
    assert aperture_sums(charge).max() > 100
    hit = read_out(light + charge, gain, 5)
    summed = combine(hit, ~rejected(hit, gain)).image_e
    assert np.sum(weights * (summed - 0.2 * n_frames)) == pytest.approx(flux, abs=4 * 0.3 * error)


def test_two_hits_of_one_pixel() -> None:
    """The second hit raises the mean that the first is compared with; both go."""
    frames = read_out(np.random.default_rng(0).poisson(0.3, (10, 9, 9)), 300.0, 1)
    frames[2, 4, 4] += 3000.0
    frames[7, 4, 4] += 400.0
    expected = np.zeros(frames.shape, dtype=bool)
    expected[2, 3:6, 3:6] = expected[7, 3:6, 3:6] = True
    assert (rejected(frames, 300.0) == expected).all()


def test_few_frames_are_named() -> None:
    frames = np.zeros((1, 8, 8))
    frames[0, 4, 4] = 1e4
    usable = np.ones(frames.shape, dtype=bool)
    one = reject_cosmic_rays(frames, usable, em_gain=300.0, read_noise_e=READ_NOISE_E)
    assert not one.rejected.any()
    assert one.fraction == 0
    for n_frames in (2, 3):
        more = np.concatenate([frames, np.zeros((n_frames - 1, 8, 8))])
        found = reject_cosmic_rays(more, np.ones(more.shape, bool), em_gain=300.0, read_noise_e=READ_NOISE_E)
        assert found.n_hit == 1
        assert found.rejected[0, 3:6, 3:6].all()
        assert found.rejected.sum() == 9
        assert found.fraction == 9 / more.size
    # A pixel with one usable frame has nothing beside it.
    alone = np.concatenate([frames, np.zeros((2, 8, 8))])
    usable = np.ones(alone.shape, dtype=bool)
    usable[1:, 4, 4] = False
    assert reject_cosmic_rays(alone, usable, em_gain=300.0, read_noise_e=READ_NOISE_E).n_hit == 0


def test_unusable_frames_are_not_looked_at() -> None:
    frames = read_out(np.random.default_rng(0).poisson(1.0, (10, 9, 9)), 300.0, 1)
    usable = np.ones(frames.shape, dtype=bool)
    frames[3, 4, 4], usable[3, 4, 4] = 1e6, False
    assert reject_cosmic_rays(frames, usable, em_gain=300.0, read_noise_e=READ_NOISE_E).n_hit == 0


def test_pedestal_is_noise_too() -> None:
    """Dark current of 100 e- that calibration has taken off: without its noise clean frames look hit."""
    frames = read_out(np.random.default_rng(0).poisson(100.0, (30, 64, 64)), 300.0, 1) - 100.0
    assert rejected(frames, 300.0).any()
    assert not rejected(frames, 300.0, pedestal_e=np.full((64, 64), 100.0)).any()


def test_sums_with_holes() -> None:
    rng = np.random.default_rng(1)
    frames, usable = rng.normal(5.0, 1.0, (6, 4, 5)), rng.random((6, 4, 5)) < 0.6
    usable[:, 0, 0], usable[:, 1, 1] = False, True
    whole = combine(frames, usable)
    plain, covered = filled(frames, usable)
    for y in range(4):
        for x in range(5):
            kept = frames[usable[:, y, x], y, x]
            assert whole.n_usable[y, x] == kept.size
            if kept.size:
                assert whole.image_e[y, x] == pytest.approx(6 * kept.mean(), rel=1e-12)
                assert whole.variance_factor[y, x] == 6 / kept.size
                assert plain[:, y, x].sum() == pytest.approx(whole.image_e[y, x], rel=1e-12)
                assert (plain[usable[:, y, x], y, x] == kept).all()
    assert np.isnan(whole.image_e[0, 0])
    assert np.isinf(whole.variance_factor[0, 0])
    assert not whole.covered[0, 0]
    assert (plain[:, 0, 0] == 0).all()
    assert not covered[0, 0]
    assert (covered == whole.covered).all()


def test_holes_leave_sums_unbiased() -> None:
    rng = np.random.default_rng(2)
    frames, usable = rng.poisson(3.0, (20, 100, 100)).astype(float), rng.random((20, 100, 100)) < 0.8
    sums = combine(frames, usable)
    error = np.sqrt(20 * 3.0 * sums.variance_factor.mean() / 1e4)
    assert abs(sums.image_e.mean() - 60.0) < 4 * error
    pulls = (sums.image_e - 60.0) / np.sqrt(60.0 * sums.variance_factor)
    assert pulls.std() == pytest.approx(1.0, abs=4 / np.sqrt(2e4))


def test_refusals(refused) -> None:
    frames, usable = np.zeros((3, 4, 4)), np.ones((3, 4, 4), dtype=bool)
    good = {"em_gain": 20.0, "read_noise_e": 100.0}
    refused("usable", reject_cosmic_rays, frames, usable[0], **good)
    refused("frames", combine, frames[0], usable)
    broken = frames.copy()
    broken[1, 2, 3] = np.nan
    refused(r"frames\[1, y=2, x=3\]", filled, broken, usable)
    for key, value in (("em_gain", 0.5), ("read_noise_e", -1.0), ("false_alarm", 0.0), ("drift", np.nan)):
        refused(key, reject_cosmic_rays, frames, usable, **good | {key: value})
