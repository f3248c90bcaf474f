"""No test outside the benchmarks judges by a clock: how busy the machine is decides nothing."""

import ast
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parents[1]
CLOCKS = {"perf_counter", "monotonic", "process_time", "thread_time"}
FILES = sorted(
    path for path in TESTS.rglob("*.py") if not {"benchmarks", "mutants"} & set(path.relative_to(TESTS).parts)
)


def timed(tree):
    """Lines of asserts that hold a clock, or a name whose value came from one."""
    tainted = set()

    def holds(node):
        return any(
            (isinstance(part, ast.Attribute) and part.attr in CLOCKS)
            or (isinstance(part, ast.Name) and part.id in tainted)
            for part in ast.walk(node)
        )

    before = -1
    while len(tainted) > before:
        before = len(tainted)
        for node in ast.walk(tree):
            if isinstance(node, ast.Assign | ast.AugAssign) and holds(node.value):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                tainted |= {part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)}
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "append":
                tainted |= {part.id for part in [node.func.value] if isinstance(part, ast.Name) and holds(node.args[0])}
    return [node.lineno for node in ast.walk(tree) if isinstance(node, ast.Assert) and holds(node.test)]


@pytest.mark.parametrize(
    "text",
    [
        "began = time.monotonic()\nassert time.monotonic() - began < 5",
        "times = []\nstart = time.process_time()\ntimes.append(time.process_time() - start)\nassert min(times) < 2",
        "best = min(best, time.perf_counter() - start)\nmade = best\nassert made < 1",
    ],
)
def test_a_verdict_of_a_clock_is_seen(text):
    assert timed(ast.parse(text)) == [text.count("\n") + 1]


def test_a_deadline_of_waiting_is_none():
    assert timed(ast.parse("while time.monotonic() < deadline:\n    pass\nassert list(out)")) == []


def test_no_test_judges_by_a_clock():
    texts = {str(path.relative_to(TESTS)): path.read_text(encoding="utf-8") for path in FILES}
    clocked = {name: ast.parse(text) for name, text in texts.items() if any(clock in text for clock in CLOCKS)}
    assert {name: lines for name, tree in clocked.items() if (lines := timed(tree))} == {}
