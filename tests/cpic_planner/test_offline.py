"""Without a network everything works but what asks for one: no command so much as tries to reach it."""

import importlib.util
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from cpic_planner.web import application

SCRIPT = Path(__file__).with_name("commands_that_write.py")
SHORT = ("etc", "few", "bias", "check", "instrument", "catalog", "cache", "visibility")


def loaded(path):
    spec = importlib.util.spec_from_file_location(f"tests_{path.parent.name}_{path.stem}", path)
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def commands():
    return loaded(SCRIPT)


@pytest.fixture(scope="module")
def web():
    """The browser of the tests of pages."""
    return loaded(SCRIPT.parent / "web" / "conftest.py")


@pytest.fixture
def attempts(commands, monkeypatch, tmp_path):
    """What tried to reach the network, which is not there."""
    told = []
    for attribute, what in commands.blocked(told).items():
        monkeypatch.setattr(socket, attribute, what)
    monkeypatch.chdir(tmp_path)
    return told


def test_the_fixture_sees_attempts_and_lets_none_through(attempts):
    with socket.socket() as mine, pytest.raises(OSError, match="unreachable"):
        mine.connect(("127.0.0.1", 9))
    with pytest.raises(OSError, match="unreachable"):
        socket.create_connection(("example.org", 80))
    assert attempts == ["('127.0.0.1', 9)", "('example.org', 80)"]


def test_commands_work_without(commands, attempts):
    commands.main(SHORT)
    assert attempts == []


PAGES = ("/etc?target=tau+Cet&bands=F662", "/priorities?sp_type=K&distance_max_pc=6&v_mag_max=5&bands=F520&limit=3")
SLOW_PAGES = ("/star?name=eps+Eri&date_utc=2030-01-01", "/openapi.json")


@pytest.mark.parametrize("address", [*PAGES, *(pytest.param(page, marks=pytest.mark.long) for page in SLOW_PAGES)])
def test_pages_work_without(web, attempts, address):
    assert web.Browser(application()).get(address).status == 200
    assert attempts == []


@pytest.mark.long
def test_known_works_without(tmp_path, record_property):
    """`test_same_bytes` runs the other commands that take long without a network."""
    run = [sys.executable, str(SCRIPT), "--offline", "known"]
    done = subprocess.run(run, cwd=tmp_path, env=os.environ, capture_output=True, text=True, check=True)
    assert len(done.stdout.splitlines()) == 1, done.stdout  # the fingerprint, and no attempt
    record_property("attempts to connect", 0)
