"""Subtraction of 30 science frames by 30 reference frames, beside pyKLIP called once per frame; one thread each."""

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from cpic_planner.validation import rdi_subtract, roll_subtract

SIDE, FRAMES = 137, 30
_Y, _X = np.indices((SIDE, SIDE)) - SIDE // 2
_RADIUS = np.hypot(_X, _Y)
REGIONS = {
    "quadrant": (_RADIUS > 13.3) & (_RADIUS < 49.8) & (_X > 0) & (_Y > 0),
    "annulus": (_RADIUS > 13.3) & (_RADIUS < 49.8),
    "whole stamp": np.ones((SIDE, SIDE), dtype=bool),
}


@pytest.fixture(scope="module")
def frames():
    """Photon noise on speckles of a common field, 1e4 electrons at most: modes from large to small."""
    rng = np.random.default_rng(1)
    field = 1e3 * np.exp(np.clip(rng.normal(size=(SIDE, SIDE)), -4, 2.3))
    return rng.poisson(field, (2, FRAMES, SIDE, SIDE)).astype(float)


@pytest.fixture(autouse=True)
def _one_thread():
    with threadpool_limits(1):
        yield


@pytest.mark.parametrize("modes", [1, 10, 29])
@pytest.mark.parametrize("name", REGIONS)
def test_subtraction(timed, frames, name, modes):
    region = REGIONS[name]
    found = timed(f"subtraction: {name}, {modes} modes", lambda: rdi_subtract(*frames, modes, region=region), repeats=3)
    assert found.residuals.shape == frames[0].shape


@pytest.mark.parametrize("modes", [1, 10, 29])
@pytest.mark.parametrize("name", REGIONS)
def test_subtraction_by_the_peer(timed, frames, name, modes):
    klip = pytest.importorskip("pyklip.klip", reason="pyKLIP is not installed")
    region = REGIONS[name]
    rows, library = frames[0][:, region], frames[1][:, region]
    expected = timed(
        f"subtraction: {name}, {modes} modes: peer pyKLIP",
        lambda: np.stack([klip.klip_math(row, library, np.array([modes]))[:, 0] for row in rows]),
        rounds=5,
    )
    residuals = rdi_subtract(*frames, modes, region=region).residuals[:, region]
    assert np.abs(residuals - expected).max() < 1e-8 * np.abs(expected).max()


@pytest.mark.parametrize("centering", ["temporal", "none"])
def test_two_rolls(timed, frames, centering):
    timed(
        f"subtraction: two rolls, {centering}",
        lambda: roll_subtract(*frames, 10, region=REGIONS["annulus"], centering=centering),
        repeats=3,
    )
