from __future__ import annotations

import numpy as np
import pytest

from simulator.camera import MaskBit
from simulator.camera.calibration_set import chosen_places, excess_map, flaw_mask, response_map, scatter_map

SHAPE = (500, 400)
N = SHAPE[0] * SHAPE[1]


@pytest.mark.parametrize("rms", [0.0, 0.01, 0.3])
def test_response(rms) -> None:
    response = response_map(SHAPE, rms, np.random.default_rng(1))
    assert response.mean() == pytest.approx(1, abs=1e-12)
    assert response.min() > 0
    assert response.std() == pytest.approx(rms, rel=4 / np.sqrt(2 * N) + (0.01 if rms == 0.3 else 0))


@pytest.mark.parametrize("rms", [0.0, 0.1, 0.35])
def test_scatter(rms) -> None:
    factor = scatter_map(SHAPE, rms, np.random.default_rng(2))
    assert factor.min() > 0
    assert abs(factor.mean() - 1) <= 4.5 * rms / np.sqrt(N)
    assert factor.std() == pytest.approx(rms, rel=0.02)


def test_wide_scatter_keeps_the_median_of_the_lognormal() -> None:
    factor = scatter_map(SHAPE, 3.0, np.random.default_rng(3))
    assert np.median(factor) == pytest.approx(1 / np.sqrt(10), rel=0.02)


@pytest.mark.parametrize("fraction", [0.0, 1e-5, 0.1, 0.5])
def test_places(fraction) -> None:
    chosen = chosen_places(SHAPE, fraction, np.random.default_rng(4))
    assert chosen.sum() == round(fraction * N)
    if fraction == 0.1:
        per_row = chosen.sum(axis=1)
        assert abs(per_row.mean() - 40) < 1e-9
        assert per_row.std() == pytest.approx(np.sqrt(400 * 0.1 * 0.9), rel=0.15)


def test_excess() -> None:
    hot = chosen_places(SHAPE, 0.2, np.random.default_rng(5))
    excess = excess_map(hot, 1000.0, np.random.default_rng(6))
    assert (excess[~hot] == 0).all()
    value = excess[hot]
    assert abs(value.mean() - 999) < 4.5 * 999 / np.sqrt(value.size)
    assert np.median(value) == pytest.approx(999 * np.log(2), rel=0.03)


def test_mask_limits_are_ten_and_a_hundred_medians() -> None:
    dark = np.full((9, 9), 1e-3)
    dark[0, :5] = 0.9e-2, 1.01e-2, 0.99e-1, 1.01e-1, 5.0
    bad = np.zeros((9, 9), dtype=bool)
    bad[0, 4] = bad[5, 5] = True
    mask = flaw_mask(bad, dark, (slice(0, 9), slice(0, 9)))
    good, warm, hot, fault = MaskBit.GOOD, MaskBit.WARM, MaskBit.HOT, MaskBit.BAD
    assert mask.dtype == np.uint8
    assert list(mask[0, :5]) == [good, warm, warm, hot, hot | fault]
    assert mask[5, 5] == fault
    assert np.count_nonzero(mask) == 5


def test_mask_of_a_camera_without_dark_current() -> None:
    dark = np.zeros((4, 4))
    dark[1, 1] = 5e-4
    mask = flaw_mask(np.zeros((4, 4), dtype=bool), dark, (slice(0, 4), slice(0, 4)))
    assert np.count_nonzero(mask) == 0
