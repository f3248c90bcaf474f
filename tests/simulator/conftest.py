"""Detectors of the default instrument."""

from __future__ import annotations

import pytest

from simulator.config.detector import Detector, InfraredDetector
from simulator.config.instrument import load_instrument


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
