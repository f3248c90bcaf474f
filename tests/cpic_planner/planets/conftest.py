"""Campaigns of astrometry, which several tests simulate and fit."""

import importlib.util
import sys
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def campaigns():
    """Simulated epochs of planets and fits of them that share no code with what predicts their errors."""
    spec = importlib.util.spec_from_file_location("planets_campaigns", Path(__file__).with_name("campaigns.py"))
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
