"""The table of what was checked says what the reports say, and fails where they no longer say it."""

import re

import pytest

from tools.site import validation
from tools.site.validation import Check

ROWS = re.findall(r"^\| (?!claim|---)(.+) \|$", validation.page(), re.MULTILINE)


def test_every_row_has_claim_reference_tolerance_and_finding():
    assert len(ROWS) == sum(map(len, validation.CHECKS.values())) >= 20
    assert all(len([cell for cell in row.split(" | ") if cell.strip()]) == 5 for row in ROWS)


def test_no_row_of_a_report_that_asks_is_left_out():
    of_runs = {"10 min", "1 at most, 10 % more"}  # times: nothing of the model hangs on them
    table = re.compile(r"^\|\s+\| asked \| found \| met \|\n.*?(?=\n\n)", re.MULTILINE | re.DOTALL)
    for name in {check.report for checks in validation.CHECKS.values() for check in checks}:
        found = table.search(validation.report(name))
        asked = {line.split("|")[2].strip() for line in found[0].splitlines()[2:]} if found else set()
        shown = {row.split(" | ")[2] for row in ROWS if f"[{name}]" in row}
        assert asked - shown - of_runs <= {""}, name


def test_what_is_asked_and_found_stands_in_the_report():
    row = next(row for row in ROWS if row.startswith("least time of an observation"))
    asked, found = row.split(" | ")[2:4]
    assert f"| {asked} | {found} | yes |" in validation.report("etc_accuracy")


def test_what_is_not_met_is_said(monkeypatch):
    text = "|  | asked | found | met |\n|---|---|---|---|\n| noise of stars | 3% | 5% | **no** |\n"
    monkeypatch.setattr(validation, "report", lambda name: text)
    assert "| 3% | 5% (**not met**) |" in validation.row(Check("noise", "trials", "made_up", "noise of stars"))


def test_a_report_that_no_longer_says_it_stops_the_build():
    with pytest.raises(ValueError, match="no row of the report etc_accuracy says 'noise of nothing'"):
        validation.row(Check("noise", "trials", "etc_accuracy", "noise of nothing"))
