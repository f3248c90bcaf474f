"""Run one part of the chosen tests: ``pytest -m long -p tools.part --part 3/24``.

The parts are alike in length, have no test in common, and hold together all of them, so that successive changes can run
one part each where all would take too long.
"""

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option."""
    parser.addoption(
        "--part", metavar="K/N", help="every N-th of the chosen tests, beginning with number K (0 to N - 1)"
    )


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep the tests of the part, once those that are chosen otherwise are known."""
    written = config.getoption("--part")
    if written is None:
        return
    number, parts = (int(text) for text in written.split("/"))
    if not 0 <= number < parts:
        raise pytest.UsageError(f"--part {written}: not accepted; allowed: K/N with K from 0 to N - 1")
    kept = set(sorted(item.nodeid for item in items)[number::parts])
    config.hook.pytest_deselected(items=[item for item in items if item.nodeid not in kept])
    items[:] = [item for item in items if item.nodeid in kept]
