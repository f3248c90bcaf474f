"""Our numbers beside those of other people, which are recorded: each within what the report allows."""

import ast
import re
from pathlib import Path

import pytest

from reports.external import comparison

REPORT = Path(comparison.__file__).with_name("report.md")


@pytest.mark.parametrize("name", comparison.ORDER)
def test_every_number_agrees_or_is_known_to_differ(name):
    module = dict(comparison.comparisons())[name]
    rows = module.rows(comparison.recorded(name))
    assert rows
    for row in rows:
        assert row.tolerance > 0, row.what
        assert row.agrees or not row.expected, f"{row.what}: {row.ours} beside {row.theirs}, {row.why}"
        assert row.agrees or row.why, f"{row.what}: nothing says why they differ"
    # The pages are as new as the code.
    assert comparison.section(name, module, rows) in REPORT.read_text(encoding="utf-8")
    assert comparison.page(module, rows) == REPORT.with_name("rows").joinpath(f"{name}.md").read_text(encoding="utf-8")


def imported(module):
    """Return the first names of what a module imports at its top."""
    top = ast.parse(Path(module.__file__).read_text(encoding="utf-8")).body
    named = [item for item in top if isinstance(item, ast.Import | ast.ImportFrom)]
    return {
        name.partition(".")[0]
        for item in named
        for name in ([item.module] if isinstance(item, ast.ImportFrom) else [part.name for part in item.names])
    }


def test_who_is_asked_needs_only_itself():
    """``peer()`` runs where nothing of ours is installed, and always in the same version."""
    asked = {name: module for name, module in comparison.comparisons() if hasattr(module, "peer")}
    assert asked
    for name, module in asked.items():
        assert imported(module) <= {"__future__", "math", "copy", "json", "pathlib", "typing", "numpy", "reports"}, name
        version = module.REFERENCE.version
        pinned = [re.split("==|@", package)[-1] for package in module.REFERENCE.packages]  # a release or a commit
        assert any(pin == version or f"commit {pin[:7]}" in version for pin in pinned), name
