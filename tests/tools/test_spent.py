"""What the tests of each file take."""

import subprocess
import sys
import time
from collections import Counter
from types import SimpleNamespace

import pytest

from tools import spent


def test_parts_of_tests_add_up_by_file(monkeypatch):
    monkeypatch.setattr(spent, "_SPENT", Counter())
    for name, seconds in (("a.py", 1.0), ("b.py", 2.5), ("a.py", 3.0)):
        spent.pytest_runtest_logreport(SimpleNamespace(location=(name, 1, "test"), processor_s=seconds))
    said = []
    spent.pytest_terminal_summary(SimpleNamespace(section=said.append, line=said.append))
    assert said[1:] == ["     4.0 s a.py", "     2.5 s b.py", "     6.5 s all 2 files"]


WORKED_S, STEP_S = 0.3, 0.01  # the system counts the time of a process in steps of a hundredth of a second
WORK = f"import time\nwhile time.process_time() < {WORKED_S}: pass"


def test_work_counts_wherever_it_is_done_and_waiting_does_not():
    """A report that came from another process still says so."""
    spent.pytest_runtest_logstart()
    taken = []
    for work in (lambda: subprocess.run([sys.executable, "-c", WORK], check=True), lambda: time.sleep(0.2)):
        work()
        making = spent.pytest_runtest_makereport()
        next(making)
        with pytest.raises(StopIteration) as made:
            making.send(pytest.TestReport("a.py::test", ("a.py", 1, "test"), {}, "passed", None, "call"))
        taken.append(pytest.TestReport._from_json(made.value.value._to_json()).processor_s)
    assert taken[0] > WORKED_S - 2 * STEP_S > taken[1] >= 0.0


@pytest.mark.parametrize("shown", [1, 2])
def test_the_longest_are_shown(shown):
    found = spent.lines(Counter({"a.py": 1, "b.py": 2}), shown)
    assert [line.split()[-1] for line in found] == [*["b.py", "a.py"][:shown], "files"]
