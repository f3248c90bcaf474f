from __future__ import annotations

import numpy as np
import pytest

from catalogs.errors import InputError
from simulator.camera.infrared_hits import checked_hits, hit_times, tracks_of


def test_hits_become_a_map() -> None:
    hits = checked_hits((np.array([0, 7, 7, 11]), np.array([5, 1, 2, 9])), (3, 4))
    assert hits.sum() == 17
    assert hits[0, 0] == 5
    assert hits[1, 3] == 3
    assert hits[2, 3] == 9
    assert checked_hits(([], []), (3, 4)).sum() == 0


@pytest.mark.parametrize(
    ("hits", "words"),
    [
        (([12], [1]), "cosmic_rays pixels = 12.*0 to 11"),
        (([-1], [1]), "cosmic_rays pixels = -1"),
        (([1.5], [1]), "integer indices"),
        (([1, 2], [1]), "two lists of one length"),
        (([1], [-1]), r"electrons\[0\] = -1"),
        (([1], [np.nan]), r"electrons\[0\] = nan"),
        (([1], [0.5]), "whole electrons"),
        (([1], [1e13]), "electrons"),
    ],
)
def test_refusals(hits, words) -> None:
    with pytest.raises(InputError, match=words):
        checked_hits(hits, (3, 4))


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
