from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.ndimage import convolve

from simulator.detectors import PastExposure, tracks_of
from simulator.detectors.infrared import ExponentialPersistence, InterpixelKernel, hit_times, neighbour_kernel


def test_persistence_against_an_integral() -> None:
    model = ExponentialPersistence(0.01, 120.0)
    rate = model([PastExposure(np.full((3, 4), 5e4), 30.0)], 60.0)
    released = quad(lambda t: 0.01 * 5e4 / 120 * np.exp(-t / 120), 30, 90)[0]
    assert rate == pytest.approx(np.full((3, 4), released / 60), rel=1e-9)


def test_persistence_gives_back_no_more_than_it_took() -> None:
    model = ExponentialPersistence(0.02, 300.0)
    charge = np.array([[1e5, 0.0]])
    assert model([PastExposure(charge, 0.0)], 1e6) * 1e6 == pytest.approx(0.02 * charge, rel=1e-12)


def test_persistence_adds_up_and_starts_at_its_peak() -> None:
    model = ExponentialPersistence(0.01, 100.0)
    one, two = PastExposure(np.full((2, 2), 1e4), 10.0), PastExposure(np.full((2, 2), 3e4), 200.0)
    assert model([one, two], 5.0) == pytest.approx(model([one], 5.0) + model([two], 5.0))
    assert model([PastExposure([[1e4]], 0.0)], 0.0) == pytest.approx(np.array([[1.0]]))
    assert model([PastExposure([[1e4]], 1e12)], 5.0) == 0


@pytest.mark.parametrize(
    ("call", "key"),
    [
        (lambda: ExponentialPersistence(1.5, 100.0), "fraction"),
        (lambda: ExponentialPersistence(0.1, 0.0), "decay_s"),
        (lambda: ExponentialPersistence(0.1, 1.0)([PastExposure([[-1.0]], 0.0)], 1.0), r"charge_e\[y=0, x=0\]"),
        (lambda: ExponentialPersistence(0.1, 1.0)([PastExposure([[np.nan]], 0.0)], 1.0), r"charge_e\[y=0, x=0\]"),
        (lambda: ExponentialPersistence(0.1, 1.0)([PastExposure([[1.0]], -1.0)], 1.0), "age_s"),
        (lambda: ExponentialPersistence(0.1, 1.0)([PastExposure(np.ones((2, n)), 1.0) for n in (2, 3)], 1.0), "shape"),
        (lambda: InterpixelKernel(np.ones((3, 3))), "kernel sum"),
        (lambda: InterpixelKernel(np.ones((5, 5)) / 25), "shape"),
        (lambda: InterpixelKernel([[0, -0.1, 0], [0, 1.1, 0], [0, 0, 0]]), "interpixel kernel"),
        (lambda: neighbour_kernel(0.3), "interpixel_coupling"),
    ],
)
def test_refusals(refused, call, key) -> None:
    refused(key, call)


def test_kernel_against_scipy() -> None:
    kernel = np.random.default_rng(0).uniform(0, 1, (3, 3))
    kernel /= kernel.sum()
    signal = np.zeros((20, 30))
    signal[2:-2, 2:-2] = np.random.default_rng(1).uniform(0, 1e4, (16, 26))
    assert InterpixelKernel(kernel)(signal) == pytest.approx(convolve(signal, kernel, mode="constant"), rel=1e-12)


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (5, 1), (12, 9)])
def test_kernel_conserves_the_signal_at_edges(shape) -> None:
    kernel = np.random.default_rng(0).uniform(0, 1, (3, 3))
    kernel /= kernel.sum()
    signal = np.random.default_rng(1).uniform(0, 1e4, shape)
    coupled = InterpixelKernel(kernel)(signal)
    assert coupled.shape == shape
    assert coupled.sum() == pytest.approx(signal.sum(), rel=1e-12)
    assert (coupled >= 0).all()


def test_neighbours() -> None:
    signal = np.zeros((5, 5))
    signal[2, 2] = 100.0
    coupled = neighbour_kernel(0.01)(signal)
    assert coupled[2, 2] == pytest.approx(96)
    assert coupled[2, 1] == coupled[2, 3] == coupled[1, 2] == coupled[3, 2] == 1.0
    assert coupled.sum() == pytest.approx(100)
    assert np.array_equal(neighbour_kernel(0.0)(signal), signal)


def test_pixels_that_touch_are_one_track() -> None:
    hit = np.zeros((8, 8), dtype=bool)
    hit[0, 0] = hit[1, 1] = hit[2, 2] = hit[5, 5] = hit[5, 6] = hit[7, 0] = True
    assert tracks_of(hit)[1] == 3
    times = hit_times(hit, np.random.default_rng(0))
    assert times[0, 0] == times[1, 1] == times[2, 2]
    assert times[5, 5] == times[5, 6]
    assert np.unique(times[hit]).size == 3
    assert (times[~hit] == 0).all()
    assert ((times[hit] > 0) & (times[hit] < 1)).all()


def test_arrivals_are_uniform() -> None:
    hit = np.zeros((400, 400), dtype=bool)
    hit[::2, ::2] = True
    times = np.sort(hit_times(hit, np.random.default_rng(1))[hit])
    empirical = np.arange(1, times.size + 1) / times.size
    assert np.abs(empirical - times).max() * np.sqrt(times.size) < 2.2
