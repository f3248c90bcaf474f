import contextlib
import http.client
import os
import re
import signal
import socket
import subprocess
import sys
import time

import pytest

from cpic_planner.cli import upkeep_command
from cpic_planner.cli.main import main

COMMAND = "serve"


def test_without_the_extra_one_line_says_what_to_install(refuses, monkeypatch):
    monkeypatch.setattr(upkeep_command, "_NEEDED", ("starlette", "no_such_package"))
    refuses([], ["not installed", 'pip install "cpic-planner[web]"'])


@pytest.mark.parametrize("port", ["0", "65536", "http"])
def test_ports_that_are_none(refuses, port):
    refuses(["--port", port], ["--port"])


def test_folders_that_cannot_be_used_are_refused_before_anything_is_served(refuses, tmp_path):
    (tmp_path / "mine.txt").write_text("x")
    refuses(["--jobs", str(tmp_path)], ["--jobs", "is empty, or of an earlier cpic serve"])
    refuses(["--folder", str(tmp_path / "nowhere")], ["--folder", "a folder that is there"])


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def asked(port, address, method="GET", body=None, **headers):
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", port, timeout=60)) as line:
        line.request(method, address, body, headers)
        with line.getresponse() as told:
            return told.status, told.read()


@pytest.fixture(scope="module")
def port(tmp_path_factory):
    """A server of its own process."""
    number, folder = free_port(), tmp_path_factory.mktemp("jobs")
    command = [sys.executable, "-m", "cpic_planner.cli.main", "serve", "--port", str(number), "--jobs", str(folder)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": "."}) as server:
        assert re.match(rf"cpic: http://127.0.0.1:{number}/etc ", server.stderr.readline())
        for _ in range(600):
            try:
                socket.create_connection(("127.0.0.1", number), 1).close()
                break
            except OSError:
                time.sleep(0.1)
        yield number
        server.send_signal(signal.SIGINT)
        assert server.wait(30) in (0, 130)


def test_a_server_answers_as_the_command_line(port, capsys):
    status, body = asked(port, "/etc?target=tau+Cet&snr=5&separation_arcsec=0.36&format=json")
    assert status == 200
    assert main(["etc", "tau Cet", "--snr", "5", "--separation-arcsec", "0.36", "--json"]) == 0
    assert body.decode() == capsys.readouterr().out


def test_a_server_refuses_other_names_bodies_and_long_addresses(port):
    assert asked(port, "/etc", Host="evil.example")[0] == 421
    assert asked(port, "/etc", body=b"x=1")[0] == 413
    assert asked(port, "/runs", "POST", b"x=1")[0] == 405
    assert asked(port, f"/etc?target={'a' * 5000}")[0] == 414
    assert asked(port, f"/etc?target={'a' * 100_000}")[0] in (400, 414, 431)
    assert asked(port, "/etc")[0] == 200


def test_a_server_is_reached_from_this_machine_alone(port):
    here = socket.gethostbyname(socket.gethostname())
    if here.startswith("127."):
        here = "127.0.0.2"
    with pytest.raises(OSError):
        socket.create_connection((here, port), 1)
