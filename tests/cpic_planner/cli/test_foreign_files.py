"""Every option that names a file, given somebody else's: one line that quotes nothing of it."""

import os
import socket

import pytest

from cpic_core import InputError
from cpic_planner import exposure_time, load_dm_surface, load_instrument, load_psf, load_scene
from cpic_planner.cli.main import main
from simulator.target.albedo_grid import load_albedo_grid

SECRET = "hunter2"
TEXTS = {
    "a password file": f"root:x:0:0:{SECRET}:/root:/bin/bash\nuser:x:1:1:{SECRET}:/home:/bin/sh\n",
    "settings": f"password: {SECRET}\nuser: {SECRET}\n",
    "a table": f"{SECRET},password\n1,{SECRET}\n2,{SECRET}\n",
    "numbers, then words": f"1 2\n3 {SECRET}\n",
    "cut YAML": f"{SECRET}: {{'{SECRET}': '{SECRET}\n",
}
COMMANDS = {
    "instrument": ["etc", "tau Cet", "--snr", "5", "--instrument", "{}"],
    "catalog": ["rank", "--catalog", "{}"],
    "population": ["rank", "--population", "{}"],
    "known planets": ["rank", "--known-planets", "{}"],
    "known": ["known", "tau Cet", "--known-planets", "{}"],
    "albedo": ["etc", "tau Cet", "--snr", "5", "--albedo", "{}.csv"],
    "overrides": ["confirm", "paper_science", "--simulator-overrides", "{}"],
    "scene": ["confirm", "{}"],
    "simulation": ["simulate", "{}", "--dry-run"],
    "simulated table": ["simulate", "{}.csv", "--dry-run"],
    "visibility": ["visibility", "tau Cet", "--visibility", "{}"],
    "strategies": ["whatif", "{}"],
    "spectrum": ["simulate", "scene.yaml", "--dry-run"],
}


def refusal(capsys, command, name):
    status = main([word.format(name) for word in command])
    _, err = capsys.readouterr()
    return status, err


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text("kind: scene\nname: x\ncstar: {v_mag: 3, teff_k: 5000, spectrum: own}\n")
    return tmp_path


@pytest.mark.parametrize("text", TEXTS)
@pytest.mark.parametrize("command", COMMANDS)
def test_a_foreign_file_is_refused_without_a_word_of_it(here, capsys, command, text):
    names = ("own", "own.csv", "own.yaml") if command == "simulation" else ("own", "own.csv")
    for name in names:
        (here / name).write_text(TEXTS[text])
    status, err = refusal(capsys, COMMANDS[command], "own.yaml" if command == "simulation" else "own")
    assert status == 2
    assert err.count("\n") == 1
    assert SECRET not in err
    assert "own" in err


@pytest.mark.parametrize("command", COMMANDS)
def test_a_pipe_is_refused(here, capsys, command):
    for name in ("own", "own.csv"):
        os.mkfifo(here / name)
    status, err = refusal(capsys, COMMANDS[command], "own")
    assert status == 2
    assert err.count("\n") == 1


@pytest.mark.parametrize("load", [load_instrument, load_scene, load_psf, load_dm_surface, load_albedo_grid])
@pytest.mark.parametrize("text", TEXTS)
def test_python_says_no_more(here, load, text):
    (here / "own").write_text(TEXTS[text])
    with pytest.raises(InputError) as refused:
        load(here / "own")
    assert SECRET not in str(refused.value)


def test_the_password_file_itself():
    with pytest.raises(InputError) as refused:
        exposure_time("tau Cet", snr=5, separation_arcsec=0.5, instrument="/etc/passwd")
    assert "root" not in str(refused.value)
    assert "a YAML mapping of kind instrument" in str(refused.value)


@pytest.mark.parametrize("place", ["http", "file"])
def test_a_catalogue_that_refers_elsewhere_is_refused_and_nothing_is_opened(here, capsys, place):
    """A server once heard of the planner: GET /leak?host=planner. A pipe would hold its reader for ever."""
    os.mkfifo(here / "pipe")
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setblocking(False)
        port = server.getsockname()[1]
        address = f"http://127.0.0.1:{port}/leak?host=planner" if place == "http" else f"file://{here}/pipe"
        (here / "e.vot").write_text(
            f'<VOTABLE><RESOURCE><TABLE><FIELD name="v_mag" datatype="double"/><DATA><BINARY><STREAM href="{address}"/>'
            "</BINARY></DATA></TABLE></RESOURCE></VOTABLE>"
        )
        status, err = refusal(capsys, ["rank", "--catalog", "{}"], "e.vot")
        with pytest.raises(BlockingIOError):
            server.accept()
    assert status == 2
    assert err.count("\n") == 1
    assert "references are not followed" in err


@pytest.mark.parametrize("name", ["x.fits", "link.fits"])
def test_a_check_of_what_is_no_file_ends(here, capsys, name):
    (here / "tree").mkdir()
    if name == "x.fits":
        os.mkfifo(here / "tree" / name)
    else:
        (here / "tree" / name).symlink_to("/dev/zero")
    assert main(["check", "tree"]) == 1
    assert "is not readable as FITS" in " ".join(capsys.readouterr().out.split())
