"""Subtraction of 30 science frames by 30 reference frames, beside pyKLIP called once per frame; one thread each.

``make bench`` prints the times. There is no limit on the clock here, machines differ, but one on the ratio.
"""

import time
from collections.abc import Iterator

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from cpic_planner.validation import rdi_subtract
from cpic_planner.validation.roll import roll_subtract

klip = pytest.importorskip("pyklip.klip")

SIDE, FRAMES, ROUNDS = 137, 30, 9
_Y, _X = np.indices((SIDE, SIDE)) - SIDE // 2
_RADIUS = np.hypot(_X, _Y)
REGIONS = {
    "quadrant": (_RADIUS > 13.3) & (_RADIUS < 49.8) & (_X > 0) & (_Y > 0),
    "annulus": (_RADIUS > 13.3) & (_RADIUS < 49.8),
    "whole stamp": np.ones((SIDE, SIDE), dtype=bool),
}
LINES: list[str] = []


@pytest.fixture(scope="module", autouse=True)
def times(printed) -> Iterator[None]:
    yield
    with printed() as line:
        line(f"\nreference-star subtraction, {FRAMES} + {FRAMES} frames, best of {ROUNDS}, milliseconds")
        for text in LINES:
            line(text)


@pytest.fixture(scope="module")
def frames():
    """Photon noise on speckles of a common field, 1e4 electrons at most: modes from large to small."""
    rng = np.random.default_rng(1)
    field = 1e3 * np.exp(np.clip(rng.normal(size=(SIDE, SIDE)), -4, 2.3))
    return rng.poisson(field, (2, FRAMES, SIDE, SIDE)).astype(float)


def side_by_side(*jobs):
    """Shortest time of each job, taken in turns so that a busy machine is busy for all."""
    best = [np.inf] * len(jobs)
    for _ in range(ROUNDS):
        for index, job in enumerate(jobs):
            began = time.perf_counter()
            job()
            best[index] = min(best[index], time.perf_counter() - began)
    return best


@pytest.mark.parametrize("modes", [1, 10, 29])
@pytest.mark.parametrize("name", REGIONS)
def test_subtraction_beside_the_peer(benchmark, frames, name, modes):
    region = REGIONS[name]
    science, references = frames
    rows, library = science[:, region], references[:, region]

    def ours():
        return rdi_subtract(science, references, modes, region=region)

    def peer():
        return np.stack([klip.klip_math(row, library, np.array([modes]))[:, 0] for row in rows])

    with threadpool_limits(1):
        residuals = benchmark.pedantic(ours, rounds=3, warmup_rounds=1).residuals[:, region]
        expected = peer()
        mine, theirs = side_by_side(ours, peer)
    assert np.abs(residuals - expected).max() < 1e-8 * np.abs(expected).max()
    LINES.append(f"  {name:12s} {region.sum():6d} px {modes:3d} modes  {1e3 * mine:8.2f}  pyKLIP {1e3 * theirs:8.2f}"
                 f"  ratio {theirs / mine:6.1f}")  # fmt: skip
    assert theirs > 10.0 * mine


@pytest.mark.parametrize("centering", ["temporal", "none"])
def test_two_rolls(benchmark, frames, centering):
    first, second = frames
    with threadpool_limits(1):
        benchmark.pedantic(
            lambda: roll_subtract(first, second, 10, region=REGIONS["annulus"], centering=centering),
            rounds=ROUNDS,
            warmup_rounds=1,
        )
    LINES.append(f"  annulus, two rolls, 10 modes, {centering:8s}  {1e3 * benchmark.stats.stats.min:8.2f}")
