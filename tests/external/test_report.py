"""Our numbers beside those of other people, which are recorded: each within what the report allows."""

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
