"""The page of threats and promises names tests and targets that exist, at least one test for each promise."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "trust.md").read_text(encoding="utf-8")
TEST = re.compile(r"`(tests/[\w/]+\.py)::(\w+)`")


def promises():
    rows = [line for line in PAGE.splitlines() if line.startswith("| ")]
    return [row for row in rows if not row.startswith(("| Promise", "| ---"))]


def test_each_promise_says_against_what_and_names_a_test():
    assert len(promises()) > 20
    for row in promises():
        promise, against, tests = (cell.strip() for cell in row.strip("|").split("|"))
        assert promise.endswith((".", ")")), row
        assert against, row
        assert TEST.sub("", tests).strip(", ") == "", row
        assert TEST.search(tests), row


def test_every_test_that_the_page_names_exists():
    there = {}
    for name in {name for name, _ in TEST.findall(PAGE)}:
        path = ROOT / name
        nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if path.is_file() else ()
        there[name] = {node.name for node in nodes if isinstance(node, ast.FunctionDef)}
    assert [f"{name}::{test}" for name, test in TEST.findall(PAGE) if test not in there[name]] == []


def test_every_target_that_the_page_names_exists():
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M))
    assert set(re.findall(r"`make ([a-z-]+)`", PAGE)) <= targets
