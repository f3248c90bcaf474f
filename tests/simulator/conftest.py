"""Detectors of the default instrument."""

from __future__ import annotations

import numpy as np
import pytest

from simulator.config import Detector, InfraredDetector, load_instrument


@pytest.fixture(scope="session")
def detector() -> Detector:
    """Default detector."""
    return load_instrument().detector


@pytest.fixture(scope="session")
def changed(detector: Detector):
    """Default detector with changed values."""
    return lambda **values: Detector(**{**detector.model_dump(), **values})


@pytest.fixture(scope="session")
def infrared() -> InfraredDetector:
    """Default near-infrared detector."""
    return load_instrument().near_infrared.detector


BARE = ("photon_noise", "dark", "blooming", "clock_charge", "em_register", "register_full_well", "read_noise")


def register_pmf(n: int, gain: float, stages: int = 604) -> np.ndarray:
    """Exact law of the register's output for ``n`` electrons.

    The generating function of one stage is ``z (1 - p + p z)``; iterated over the stages on the unit circle, raised
    to ``n`` and transformed back, it gives every probability.
    """
    p = np.expm1(np.log(gain) / stages)
    spread = np.sqrt(max(n * gain * (gain - 1), 1.0))
    top = int(n * gain + (40 * gain if n < 50 else 14 * spread)) + 64
    size = 1 << int(np.ceil(np.log2(top)))
    z = np.exp(-2j * np.pi * np.arange(size // 2 + 1) / size)
    for _ in range(stages):
        z = z * (1 - p + p * z)
    return np.clip(np.fft.irfft(z**n, size), 0, None)


def moments(pmf: np.ndarray) -> tuple[float, float, float]:
    """Mean, variance and fourth central moment."""
    k = np.arange(pmf.size)
    mean = float(k @ pmf)
    return mean, float((k - mean) ** 2 @ pmf), float((k - mean) ** 4 @ pmf)


@pytest.fixture(scope="session")
def exact():
    """The oracle's two functions."""
    return register_pmf, moments


@pytest.fixture(scope="session")
def bare():
    """Identical, linear pixels without transfer losses and without structure of the bias; with changed values."""
    plain = load_instrument().detector.switched(off=("all",), on=BARE)

    return lambda **values: Detector(**{**plain.model_dump(), **values})


@pytest.fixture(scope="session")
def bare_detector(bare) -> Detector:
    """The same with the default's values."""
    return bare()
