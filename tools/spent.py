"""Print the processor time that the tests of each file take: ``make test PYTEST='-p tools.spent'``.

Clean-up counts, and so do processes that a test started and waited for. How busy the machine is does not.
"""

import os
from collections import Counter
from collections.abc import Generator

import pytest

SHOWN = 40
_SPENT: Counter[str] = Counter()
_SEEN = 0.0


def _processor_s() -> float:
    """Return what this process and the processes that it waited for have taken so far in s."""
    return sum(os.times()[:4])


def pytest_runtest_logstart() -> None:
    """Begin to count."""
    global _SEEN
    _SEEN = _processor_s()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Write what a part of a test took into its report, which travels from the process that ran it."""
    global _SEEN
    report = yield
    before, _SEEN = _SEEN, _processor_s()
    report.processor_s = _SEEN - before  # type: ignore[attr-defined]  # a report keeps and sends what it is given
    return report


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Add what a part of a test took to its file."""
    _SPENT[report.location[0]] += report.processor_s


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
    terminalreporter.section("seconds of the processor by file")
    for line in lines(_SPENT):
        terminalreporter.line(line)
