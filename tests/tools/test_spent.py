"""What the tests of each file take."""

from collections import Counter
from types import SimpleNamespace

import pytest

from tools import spent


def test_parts_of_tests_add_up_by_file(monkeypatch):
    monkeypatch.setattr(spent, "_SPENT", Counter())
    for name, seconds in (("a.py", 1.0), ("b.py", 2.5), ("a.py", 3.0)):
        spent.pytest_runtest_logreport(SimpleNamespace(location=(name, 1, "test"), duration=seconds))
    said = []
    spent.pytest_terminal_summary(SimpleNamespace(section=said.append, line=said.append))
    assert said[1:] == ["     4.0 s a.py", "     2.5 s b.py", "     6.5 s all 2 files"]


@pytest.mark.parametrize("shown", [1, 2])
def test_the_longest_are_shown(shown):
    found = spent.lines(Counter({"a.py": 1, "b.py": 2}), shown)
    assert [line.split()[-1] for line in found] == [*["b.py", "a.py"][:shown], "files"]
