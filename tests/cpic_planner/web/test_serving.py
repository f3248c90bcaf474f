"""Check how the server begins and ends."""

import threading

import uvicorn

from cpic_planner.web import serving


def test_an_interrupted_server_waits_for_the_figure_that_it_draws_beforehand(monkeypatch, tmp_path):
    """A daemon thread that is cut inside compiled code killed the process by SIGSEGV or SIGABRT."""
    begun, interrupted, daemons = threading.Event(), threading.Event(), []

    def figure(*_):
        daemons.append(threading.current_thread().daemon)
        begun.set()
        assert interrupted.wait(30)

    def run(*_, **__):
        assert begun.wait(30)
        interrupted.set()

    monkeypatch.setattr(serving, "drawn", figure)
    monkeypatch.setattr(uvicorn, "run", run)
    serving.serve("127.0.0.1", 8765, jobs=tmp_path / "jobs")
    assert daemons == [False]
