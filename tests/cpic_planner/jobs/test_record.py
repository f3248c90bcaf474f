"""How fast this machine works: measured once, from the quickest of several tries."""

import pytest

from cpic_planner.jobs import pace
from cpic_planner.jobs.job import piece_s


@pytest.fixture
def anew(monkeypatch, tmp_path):
    """The pace, measured in an empty cache."""
    monkeypatch.setenv("CPIC_CACHE_DIR", str(tmp_path))
    pace.cache_clear()
    yield pace
    pace.cache_clear()


def test_the_piece_is_work_of_a_moment():
    assert 0.005 < piece_s() < 1.0


def test_the_quickest_try_counts_and_is_kept(anew, monkeypatch):
    tries = iter([0.48, 0.096, *[0.5] * 10])
    monkeypatch.setattr("cpic_planner.jobs.job.piece_s", lambda: next(tries))
    assert anew() == pytest.approx(2.0)
    anew.cache_clear()
    assert anew() == pytest.approx(2.0)  # from the cache: there is no further try
