"""Kernels against exact laws, brute force and conservation."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numba import njit
from scipy import stats

from cpic_core import stream
from simulator.detectors import kernels, visible as collection
from simulator.detectors.gain import pixel_keys
from simulator.detectors.visible import chances_of_loss


def counts_of(mean, draws=1_000_000):
    out = np.empty(draws)
    means = np.full(draws, mean)
    kernels.draw_poisson(means, np.exp(-means), pixel_keys(stream(1, "poisson", str(mean))), out)
    return out


@pytest.mark.parametrize("mean", [0.0, 1e-300, 1e-3, 0.3, 5.0, 9.999, 10.001, 30.0, 1e3, 1e6])
def test_poisson_counts_follow_their_law(mean):
    counts = counts_of(mean)
    assert (counts == np.rint(counts)).all()
    low, high = int(counts.min()), int(counts.max())
    below = np.cumsum(np.bincount((counts - low).astype(int))) / counts.size
    assert np.abs(below - stats.poisson.cdf(np.arange(low, high + 1), mean)).max() * np.sqrt(counts.size) < 2.2
    assert abs(counts.mean() - mean) <= 4.5 * np.sqrt(mean / counts.size)


@pytest.mark.parametrize("mean", [1e9, 1e12, 1e15])
def test_poisson_counts_at_the_largest_means(mean):
    pull = (counts_of(mean, 20_000) - mean) / np.sqrt(mean)
    assert abs(pull.mean()) < 4 / np.sqrt(pull.size)
    assert pull.std() == pytest.approx(1, abs=4 / np.sqrt(2 * pull.size))


@pytest.mark.parametrize(
    ("n", "transfers", "inefficiency"),
    [(1, 1000, 1e-5), (3, 1500, 1e-3), (40, 2000, 1e-5), (700, 2000, 1e-5), (1500, 2000, 1e-5), (80_000, 2000, 1e-5)],
)
def test_losses_of_transfer_are_binomial(n, transfers, inefficiency):
    """First losses by their exact law, charge further back by its mean: the oracle is the number of losses."""
    columns = 400_000
    chances = chances_of_loss(np.full(4, transfers), inefficiency)
    charge = np.zeros((4, columns))
    charge[0] = n
    assert kernels.shift_back(charge, *chances, True, pixel_keys(stream(2, "shift", n))) == 0
    assert (charge.sum(axis=0) == n).all()
    stay = stats.binom.pmf(0, transfers, inefficiency)
    staying = charge[0]
    low = int(staying.min())
    below = np.cumsum(np.bincount((staying - low).astype(int))) / columns
    # Charge left behind once more at its next pixel goes on from there: 0 is the pixel's own electrons alone.
    law = stats.binom.cdf(np.arange(low, int(staying.max()) + 1), n, stay)
    assert np.abs(below - law).max() * np.sqrt(columns) < 2.2
    for back in (1, 2):
        mean = n * stats.binom.pmf(back, transfers, inefficiency)
        assert charge[back].mean() == pytest.approx(mean, abs=4.5 * np.sqrt((mean + 1e-9) / columns) + 1e-6)


def test_chances_of_loss_against_the_binomial_law():
    for inefficiency in (0.0, 1e-9, 1e-5, 1e-3):
        for n in (1, 2, 3, 10, 2000):
            first, second, third = (float(x[0]) for x in chances_of_loss(np.array([n]), inefficiency))
            exact = [stats.binom.sf(k, n, inefficiency) for k in range(3)]
            assert first == pytest.approx(exact[0], rel=1e-9, abs=1e-300)
            assert first * second == pytest.approx(exact[1], rel=2e-3, abs=1e-15)
            assert first * second * third == pytest.approx(exact[2], rel=4e-3, abs=1e-15)


@given(seed=st.integers(0, 2**32), by_row=st.booleans(), top=st.sampled_from([1, 300, 10**9]))
@settings(max_examples=40, deadline=None)
def test_transfer_conserves_charge(seed, by_row, top):
    rng = np.random.default_rng(seed)
    charge = rng.integers(0, top, (23, 17), endpoint=True).astype(float)
    chances = chances_of_loss(np.full(23 if by_row else 17, 3000), 1e-4)
    before = charge.sum()
    lost = kernels.shift_back(charge, *chances, by_row, pixel_keys(rng))
    assert charge.sum() + lost == before
    assert charge.min() >= 0
    assert (charge == np.rint(charge)).all()


def spilled(charge, full_well=100.0):
    after, flags = charge.copy(), np.zeros(charge.shape, bool)
    drained = kernels.vertical_spill(after, full_well, flags)
    return after, drained, flags


def brute_spill(column, full_well):
    """Column by column in whole numbers: upward halves fill the room above them, then downward halves."""
    pixels = np.minimum(column, full_well).astype(int)
    drained = [0, 0]
    excess = np.maximum(column - full_well, 0).astype(int)
    up = excess - excess // 2
    carry = 0
    for r in range(len(column)):
        take = min(full_well - pixels[r], carry)
        pixels[r] += take
        carry += up[r] - take
    drained[1] = carry
    carry = 0
    for r in reversed(range(len(column))):
        take = min(full_well - pixels[r], carry)
        pixels[r] += take
        carry += excess[r] // 2 - take
    drained[0] = carry
    return pixels, drained


@given(seed=st.integers(0, 2**32), level=st.sampled_from([10, 120, 1000, 10**9]))
@settings(max_examples=60, deadline=None)
def test_blooming_conserves_charge_and_is_its_own_limit(seed, level):
    rng = np.random.default_rng(seed)
    charge = np.where(rng.random((31, 7)) < 0.2, rng.integers(0, level, (31, 7), endpoint=True), 3).astype(float)
    after, (bottom, top), flags = spilled(charge)
    assert after.sum() + bottom + top == charge.sum()
    assert after.max() <= 100
    assert np.array_equal(spilled(after)[0], after)
    assert (after[~flags] == charge[~flags]).all()
    more = charge.copy()
    more[rng.integers(31), rng.integers(7)] += 500
    assert (spilled(more)[0] >= after).all()
    for c in range(7):
        pixels, _ = brute_spill(charge[:, c], 100)
        assert (after[:, c] == pixels).all()
    assert bottom + top == sum(sum(brute_spill(charge[:, c], 100)[1]) for c in range(7))


@pytest.mark.parametrize(("brightest", "called"), [(100.0, 0), (100.5, 1)])
def test_blooming_asks_the_compiled_kernel_only_where_a_pixel_overflows(monkeypatch, brightest, called):
    charge = np.full((6, 5), 7.0)
    charge[2, 3] = brightest
    asked = []

    def load(name):
        asked.append(name)
        return kernels

    monkeypatch.setattr(collection, "load_kernels", load)
    whole = SimpleNamespace(rows=slice(None), columns=slice(None))
    exposure = SimpleNamespace(place=whole, detector=SimpleNamespace(full_well_e=100.4))
    after = charge.copy()
    collection.Blooming().expect(after, exposure)
    assert len(asked) == called
    np.testing.assert_array_equal(after, spilled(charge)[0])


def test_a_spike_spreads_evenly_up_and_down():
    charge = np.zeros((1024, 3))
    charge[512, 1] = 101 * 100
    after, drained, flags = spilled(charge)
    assert drained == (0, 0)
    assert np.flatnonzero(after[:, 1]).tolist() == list(range(462, 563))
    assert (flags == (after > 0)).all()
    charge[:] = 1e9
    after, (bottom, top), _ = spilled(charge)
    assert (after == 100).all()
    assert bottom + top == charge.sum() - after.sum()


@given(seed=st.integers(0, 2**32))
@settings(max_examples=40, deadline=None)
def test_tails_of_the_register_conserve_charge(seed):
    rng = np.random.default_rng(seed)
    charge = np.where(rng.random((9, 41)) < 0.1, rng.integers(0, 3000, (9, 41)), 5).astype(float)
    after, flags = charge.copy(), np.zeros(charge.shape, bool)
    residue = kernels.serial_spill(after, 100.0, flags)
    assert after.sum() + residue == charge.sum()
    assert after.max() <= 100
    # Charge only moves towards pixels read later.
    assert (np.cumsum(after, axis=1) <= np.cumsum(charge, axis=1)).all()
    assert (after[~flags] == charge[~flags]).all()


def test_a_tail_is_as_long_as_its_charge():
    charge = np.zeros((2, 50))
    charge[0, 10] = 1050
    flags = np.zeros(charge.shape, bool)
    assert kernels.serial_spill(charge, 100.0, flags) == 0
    assert charge[0, 10:21].tolist() == [100] * 10 + [50]
    assert np.flatnonzero(flags[0]).tolist() == list(range(10, 21))


@pytest.mark.parametrize("level", [30.0, 2000.0, 70_000.0, 1e9])
def test_the_curve_of_a_pixel_keeps_its_mean_in_whole_electrons(level):
    """Up to the full well; what comes beyond it is not lost."""
    b, full_well = 1.26e-7, 80_000.0
    charge = np.full(400_000, level)
    kernels.compress_counts(charge, b, full_well, pixel_keys(stream(4, "curve", int(level))))
    assert (charge == np.rint(charge)).all()
    held = min(level, full_well)
    loss = b * held**2 / (1 + b * held)
    assert level - charge.mean() == pytest.approx(loss, abs=4.5 * np.sqrt(min(loss, 0.25) / charge.size) + 1e-6)


def test_draws_of_pixels_are_uniform_and_independent():
    """Means, neighbours, draws of one pixel and neighbouring keys, each over many keys."""

    @njit
    def fill(keys, draw, out):
        for i in range(out.size):
            out[i] = kernels._uniform(keys, i, draw)

    size, found = 50_000, []
    one, two, other = (np.empty(size) for _ in range(3))
    for number in range(200):
        keys = pixel_keys(stream(6, "keys", number))
        fill(keys, 0, one)
        fill(keys, 1, two)
        fill(keys + np.uint64(1), 0, other)
        a, b, c = (np.sqrt(12) * (x - 0.5) for x in (one, two, other))
        found.append([a.mean(), (a[1:] * a[:-1]).mean(), (a * b).mean(), (a * c).mean()])
    pulls = np.array(found) * np.sqrt(size)
    assert np.abs(pulls.mean(axis=0)).max() < 4 / np.sqrt(len(pulls))
    assert pulls.std(axis=0) == pytest.approx(np.ones(4), abs=4 / np.sqrt(2 * len(pulls)))
    assert stats.kstest(one, "uniform").pvalue > 1e-4


def test_normal_numbers_of_pixels():
    @njit
    def fill(keys, out):
        for i in range(out.size):
            out[i] = kernels._normal(kernels._bits(keys, i, 0), keys, i)

    z = np.empty(4_000_000)
    fill(pixel_keys(stream(7, "normal")), z)
    assert stats.kstest(z[:1_000_000], "norm").pvalue > 1e-4
    for moment, mean, spread in ((1, 0, 1), (2, 1, 2), (3, 0, 15), (4, 3, 96)):
        assert (z**moment).mean() == pytest.approx(mean, abs=4.5 * np.sqrt(spread / z.size))
    for edge in (3.0, kernels._EDGE, 4.5):
        beyond = 2 * stats.norm.sf(edge) * z.size
        assert (np.abs(z) > edge).sum() == pytest.approx(beyond, abs=4.5 * np.sqrt(beyond))


def test_rounding_at_random_keeps_the_mean():
    charge = np.full(1_000_000, 2.3)
    kernels.round_stochastic(charge, pixel_keys(stream(5, "round")))
    assert set(np.unique(charge)) == {2.0, 3.0}
    assert charge.mean() == pytest.approx(2.3, abs=4.5 * np.sqrt(0.21 / charge.size))


def test_the_converter_cuts_and_counts():
    level = np.array([-1e20, -0.6, -0.4, 0.5, 1.5, 2.4, 16383.4, 16383.6, 1e20])
    out, clipped = np.empty(9, np.uint16), np.zeros(9, bool)
    assert kernels.digitise(level, 16383.0, out, clipped) == 4
    assert out.tolist() == [0, 0, 0, 0, 2, 2, 16383, 16383, 16383]
    assert clipped.tolist() == [True, True, False, False, False, False, False, True, True]
