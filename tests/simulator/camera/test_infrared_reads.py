"""Reads and their reduction: closed forms and a direct least-squares fit."""

from __future__ import annotations

import numpy as np
import pytest

from simulator.camera.infrared_reads import ReadStack, read_times
from simulator.detectors.infrared import well_signal

WELL = 1e5


@pytest.mark.parametrize("loss", [0.0, 0.03, 0.4])
def test_signal_of_a_well(loss) -> None:
    charge = np.concatenate([np.linspace(0, 1.5e5, 200_001), [1e6, 1e9, 1e12]])
    signal = well_signal(charge, WELL, loss)
    assert (np.diff(signal) >= 0).all()
    assert signal[0] == 0
    below = charge <= WELL
    x = charge[below] / WELL
    np.testing.assert_allclose(signal[below], WELL * (x - loss * x**2), rtol=1e-12)
    top = WELL * (1 - loss + (0 if loss == 0 else (1 - 2 * loss) * 0.02))
    assert signal[-3:] == pytest.approx(top, rel=1e-12)


def test_the_bend_has_no_corner() -> None:
    step = 1e-3
    around = well_signal(np.array([WELL - step, WELL, WELL + step]), WELL, 0.03)
    before, after = np.diff(around) / step
    assert before == pytest.approx(0.94, abs=1e-5)
    assert after == pytest.approx(before, abs=1e-5)


def test_times() -> None:
    assert read_times("single", 1) == [1.0]
    assert list(read_times("cds", 2)) == [0.0, 1.0]
    assert list(read_times("up_the_ramp", 5)) == [0.0, 0.25, 0.5, 0.75, 1.0]


def fed(mode, reads, full=None, bias=1000.0, top=65535.0):
    """Stack of reads given as an array (reads, rows, columns)."""
    stack = ReadStack(mode, reads.shape[1:], bias, top)
    full = np.zeros(reads.shape, dtype=bool) if full is None else full
    for fraction, adu, over in zip(read_times(mode, len(reads)), reads, full, strict=True):
        stack.add(float(fraction), adu, over)
    return stack.result()


def test_single_and_double() -> None:
    reads = np.random.default_rng(0).uniform(900, 3000, (2, 5, 6))
    adu, lost, clipped = fed("single", reads[:1])
    assert np.array_equal(adu, reads[0])
    adu, lost, clipped = fed("cds", reads)
    assert adu == pytest.approx(np.clip(reads[1] - reads[0] + 1000, 0, None))
    assert not lost.any()
    assert np.array_equal(clipped, reads[1] - reads[0] < -1000)


@pytest.mark.parametrize("n", [2, 3, 8, 50])
def test_ramp_is_a_least_squares_fit(n) -> None:
    rng = np.random.default_rng(n)
    reads = 1000 + np.cumsum(rng.uniform(0, 100, (n, 4, 7)), axis=0)
    adu, lost, _ = fed("up_the_ramp", reads)
    slope = np.polyfit(np.linspace(0, 1, n), reads.reshape(n, -1), 1)[0].reshape(4, 7)
    assert adu == pytest.approx(slope + 1000, rel=1e-10)
    assert not lost.any()


def test_saturated_reads_are_left_out_of_the_ramp() -> None:
    rng = np.random.default_rng(1)
    reads = 1000 + np.cumsum(rng.uniform(0, 100, (8, 1, 8)), axis=0)
    full = np.zeros(reads.shape, dtype=bool)
    for pixel in range(8):
        full[pixel + 1 :, 0, pixel] = True  # pixel i has i + 1 good reads
    reads = np.where(full, 4e4, reads)
    adu, lost, _ = fed("up_the_ramp", reads, full)
    assert list(lost[0]) == [True] + [False] * 7
    assert adu[0, 0] == 65535
    for pixel in range(1, 8):
        slope = np.polyfit(np.linspace(0, 1, 8)[: pixel + 1], reads[: pixel + 1, 0, pixel], 1)[0]
        assert adu[0, pixel] == pytest.approx(slope + 1000, rel=1e-10)


def test_reads_above_the_converter_count_as_saturated() -> None:
    reads = np.array([0.0, 3e4, 6e4, 9e4, 12e4])[:, None, None] + 1000
    adu, lost, clipped = fed("up_the_ramp", reads)
    assert adu[0, 0] == 65535  # slope 120000 from the first three reads, beyond what 16 bits hold
    assert clipped.all()
    assert lost.all()
    late = np.array([0.0, 1e4, 2e4, 3e4, 9e4])[:, None, None] + 1000
    adu, lost, clipped = fed("up_the_ramp", late)
    assert adu[0, 0] == pytest.approx(1000 + 4e4)
    assert clipped.all()
    assert not lost.any()


@pytest.mark.parametrize("n", [2, 3, 5, 16])
def test_read_noise_of_a_ramp(n) -> None:
    """Equal weights over the ramp: variance of slope x time is 12 (n - 1) / (n (n + 1)) of a read's."""
    rng = np.random.default_rng(n)
    noise = rng.standard_normal((n, 400, 500)) * 10
    adu, _, _ = fed("up_the_ramp", 1000 + noise)
    expected = 100 * 12 * (n - 1) / (n * (n + 1))
    assert adu.var() == pytest.approx(expected, rel=4.5 * np.sqrt(2 / adu.size))


@pytest.mark.parametrize("n", [2, 3, 5, 16])
def test_photon_noise_of_a_ramp(n) -> None:
    """Correlated noise of arrivals: variance 6/5 (n^2 + 1) / (n (n + 1)) of the signal (n >= 2)."""
    rng = np.random.default_rng(n)
    signal = 900.0
    steps = rng.poisson(signal / (n - 1), (n - 1, 400, 500))
    reads = np.concatenate([np.zeros((1, 400, 500)), np.cumsum(steps, axis=0)]) + 1000
    adu, _, _ = fed("up_the_ramp", reads)
    expected = signal * 1.2 * (n**2 + 1) / (n * (n + 1))
    assert adu.var() == pytest.approx(expected, rel=4.5 * np.sqrt(2 / adu.size))
    assert abs(adu.mean() - 1000 - signal) < 4.5 * np.sqrt(expected / adu.size)


@pytest.mark.parametrize("mode", ["single", "cds", "up_the_ramp"])
@pytest.mark.parametrize("top", [65535.0, 40000.0])
def test_more_light_is_never_less_cut_off(mode, top) -> None:
    """A pixel that the converter cannot follow at some light is counted at any brighter light."""
    charge = WELL * np.geomspace(0.01, 100.0, 200)[None, :]
    reads = 1 if mode == "single" else 2 if mode == "cds" else 8
    stack = ReadStack(mode, charge.shape, 1000.0, top)
    for fraction in read_times(mode, reads):
        held = fraction * charge
        stack.add(float(fraction), well_signal(held, WELL, 0.03) / 2.0 + 1000.0, held >= WELL)
    adu, lost, clipped = stack.result()
    assert (np.diff(clipped[0].astype(int)) >= 0).all()
    if mode == "up_the_ramp":
        assert clipped[0, -1]
        assert (adu[clipped] == top).all()
        assert lost[clipped].all()
