"""What the benchmarks share."""

import contextlib

import pytest


@pytest.fixture(scope="module")
def printed(request):
    """Context in which lines reach the terminal although pytest captures output."""
    plugins = request.config.pluginmanager

    @contextlib.contextmanager
    def lines():
        with plugins.get_plugin("capturemanager").global_and_fixture_disabled():
            yield plugins.get_plugin("terminalreporter").write_line

    return lines
