import mmap
import sys
import time

import pytest

from cpic_planner.tradeoff.measure import peak_memory_mb, reset_peak_memory, timed
from cpic_planner.tradeoff.scenes import this_machine


def test_a_sleep_is_long_and_costs_no_processor_time():
    found = timed(lambda: time.sleep(0.05), budget_s=0.0)
    assert 0.05 <= found["wall_s"] < 1.0
    assert found["cpu_s"] < 0.02
    assert found["repeats"] == 1


def test_short_calls_are_timed_in_blocks():
    calls = []
    found = timed(lambda: calls.append(0), budget_s=0.05)
    assert found["wall_s"] < 1e-4
    assert len(calls) > 100
    assert 1 <= found["repeats"] <= 5


def _touch_mb(size):
    """Pages of the system's own: an array may reuse what earlier tests left on the heap, and cost none."""
    with mmap.mmap(-1, size * 1_000_000) as pages:
        for start in range(0, len(pages), mmap.PAGESIZE):
            pages[start] = 1


@pytest.mark.skipif(sys.platform != "linux", reason="the peak cannot be reset elsewhere")
def test_peak_memory_is_of_the_job_alone():
    _touch_mb(160)
    reset_peak_memory()
    before = peak_memory_mb()
    found = timed(lambda: _touch_mb(80), budget_s=0.0)
    assert found["peak_memory_mb"] - before == pytest.approx(80.0, abs=15.0)


def test_the_machine_is_described_without_a_name():
    import platform

    machine = this_machine()
    assert machine == this_machine()
    assert machine.cores >= 1
    assert machine.memory_gb > 0
    assert machine.blas != ""
    assert len(platform.node()) < 4 or platform.node() not in machine.model_dump_json()
