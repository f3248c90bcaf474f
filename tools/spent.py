"""Say what the tests of each file take in seconds, clean-up included: ``make test PYTEST='-p tools.spent'``."""

from collections import Counter

import pytest

SHOWN = 40
_SPENT: Counter[str] = Counter()


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Add what a part of a test took to its file."""
    _SPENT[report.location[0]] += report.duration  # type: ignore[assignment]  # a counter counts seconds as well


def lines(spent: Counter[str], shown: int = SHOWN) -> list[str]:
    """Return a line for each of the files that take longest, and one for all.

    Parameters
    ----------
    spent : Counter
        Seconds by file.
    shown : int, optional
        Most files that are listed.
    """
    found = [f"{seconds:8.1f} s {name}" for name, seconds in spent.most_common(shown)]
    return [*found, f"{sum(spent.values()):8.1f} s all {len(spent)} files"]


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """List the files below the result."""
    terminalreporter.section("seconds by file")
    for line in lines(_SPENT):
        terminalreporter.line(line)
