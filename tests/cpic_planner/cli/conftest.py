"""Commands in this process."""

import pytest

from cpic_planner.cli.main import main


@pytest.fixture(autouse=True)
def _each_ranking_once(kept_rankings):
    """Tests of commands ask the same questions again and again."""


@pytest.fixture
def call(capsys, request):
    """Run ``cpic``, with the ``COMMAND`` of the file if it has one; returns status, output and errors."""
    command = [request.module.COMMAND] if hasattr(request.module, "COMMAND") else []

    def run(*arguments):
        status = main([*command, *map(str, arguments)])
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


@pytest.fixture
def done(call):
    """Run it to a good end; returns output and errors."""

    def run(*arguments):
        status, out, err = call(*arguments)
        assert status == 0, err
        return out, err

    return run


@pytest.fixture
def refuses(call):
    """A command is refused with status 2 in one line of errors that holds some words; nothing else is written."""

    def check(arguments, words):
        status, out, err = call(*arguments)
        assert (status, out) == (2, ""), err
        assert err.count("\n") == 1
        wanted = [words] if isinstance(words, str) else words
        assert [word for word in wanted if word not in " ".join(err.split())] == [], err

    return check
