"""The pace of commands beside the parent's."""

import pytest

from tools import pace


def test_a_command_is_timed_in_both_trees_and_a_failing_one_is_told(tmp_path):
    one, two = (pace.Tree(pace.ROOT, tmp_path / name) for name in ("one", "two"))
    slow = "import os, numpy\nfor _ in range(int(os.environ['PYTHONPATH'] != '') * 40): numpy.sort(numpy.ones(100_000))"
    old, new = pace.ratio(one, two, ("-c", slow), 1)
    assert old > 0.0
    assert new > 0.0
    with pytest.raises(SystemExit, match="no such module"):
        one.cpu_s(("-c", "raise SystemExit('no such module')"))
