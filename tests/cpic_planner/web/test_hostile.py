"""Hostile requests over real connections: each is refused in one line, none quotes a file, none breaks the server.

This is a slice with short limits of time; ``make hostile`` runs 600 against ``cpic serve``.
"""

import contextlib
import http.client
import importlib.util
import socket
import sys
import threading
from pathlib import Path

import pytest
import uvicorn

from cpic_planner.web import application, guard
from cpic_planner.web.job_queue import JobQueue
from cpic_planner.web.serving import UVICORN

_SPEC = importlib.util.spec_from_file_location("hostile", Path(__file__).with_name("hostile.py"))
hostile = importlib.util.module_from_spec(_SPEC)
sys.modules["hostile"] = hostile
_SPEC.loader.exec_module(hostile)
SLICE = 120


@pytest.fixture
def served(monkeypatch, tmp_path):
    """Port of a server with short limits."""
    monkeypatch.setattr(guard, "HEAD_S", 0.4)
    monkeypatch.setattr(guard, "BODY_S", 0.4)
    for name in ("secret", "secret.yaml"):
        (tmp_path / name).write_text(f"kind: instrument\nname: {hostile.SECRET}\n")
    monkeypatch.chdir(tmp_path)
    with JobQueue(tmp_path / "jobs") as queue, socket.socket() as wire:
        wire.bind(("127.0.0.1", 0))
        app = application(jobs=queue, folder=tmp_path)
        server = uvicorn.Server(uvicorn.Config(app, http=guard.TimedProtocol, **UVICORN))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [wire]})
        thread.start()
        hostile.wait_for(wire.getsockname()[1])
        yield wire.getsockname()[1]
        server.should_exit = True
        thread.join()


@pytest.mark.parametrize("sent", [b"", b"GET /jobs HTTP/1.1\r\nHost: 127.0.0.1\r\n", b"GET"])
def test_connections_without_a_request_keep_nobody_out(served, monkeypatch, sent):
    monkeypatch.setattr(guard, "HEAD_S", 60.0)
    with contextlib.ExitStack() as stack:
        lines = []
        for _ in range(300):
            lines.append(stack.enter_context(socket.create_connection(("127.0.0.1", served), 10)))
            lines[-1].sendall(sent)
        for _ in range(3):
            assert hostile.answer(served, hostile.request("GET /jobs HTTP/1.1"), 20.0).startswith(b"HTTP/1.1 200")
        lines[-1].settimeout(0.2)
        with pytest.raises(TimeoutError):
            lines[-1].recv(1)  # the newest one may still ask
        lines[0].settimeout(5.0)
        with contextlib.suppress(ConnectionResetError):
            assert lines[0].recv(1) == b""  # the oldest one may not


def test_there_are_five_hundred_and_the_same_for_a_seed():
    every = hostile.hostile(600)
    assert len(set(every)) == 600
    assert every == hostile.hostile(600)
    assert every != hostile.hostile(600, seed=2)
    assert {item.kind for item in every} == set("path file value ranking huge host method encoding post slow".split())


def test_a_slice_is_refused(served, caplog):
    every = [item for item in hostile.hostile(600) if item.kind == "slow"] + hostile.hostile(SLICE, seed=3)
    kinds, found = hostile.tried(served, every)
    assert found == []
    assert len(kinds) == len(hostile.KINDS)
    assert "a request failed" not in caplog.text
    alive = hostile.answer(served, hostile.request("GET /jobs HTTP/1.1"), 30.0)
    assert alive.startswith(b"HTTP/1.1 200")


def test_a_slow_head_is_told_and_a_pause_between_requests_is_not_one(served):
    late = hostile.answer(served, hostile.Hostile("slow", b"GET /etc HTTP/1.1\r\n"), 30.0)
    assert late.startswith(b"HTTP/1.1 408 ")
    assert late.endswith(b"The head of a request arrives within 0.4 s.\n")
    browser = http.client.HTTPConnection("127.0.0.1", served, timeout=30)
    for pause_s in (0.0, 0.8):
        threading.Event().wait(pause_s)
        browser.request("GET", "/style.css")
        wire = browser.sock
        assert browser.getresponse().read().startswith(b":root")
        assert browser.sock is wire  # the same connection goes on
    wire.sendall(b"GET /sty")  # a head that does not come
    assert wire.recv(100_000).startswith(b"HTTP/1.1 408 ")
    browser.close()
