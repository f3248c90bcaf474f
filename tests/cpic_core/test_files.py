"""Whole files, locks, and arrays in npz files: the same bytes for the same content, and a plain refusal of damage.

Files that somebody named: only regular ones, bounded, and nothing of a stranger's file in a message.
"""

import hashlib
import json
import os
import re
import socket
import subprocess
import sys
import threading

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cpic_core import (
    InputError,
    LockHeld,
    byte_planes,
    check_writable,
    digest_of,
    dump_json,
    exclusive_lock,
    file_state,
    guarded,
    is_file,
    load_mapping,
    load_yaml,
    of_byte_planes,
    only_sent_files,
    open_file,
    read_file,
    read_npz,
    read_text,
    refuse_sent,
    unguarded,
    visible,
    was_sent,
    whole_file,
    write_bytes,
    write_named,
    write_npz,
)
from cpic_core.yaml_files import MAX_BYTES
from simulator.config import load_instrument


def test_failed_write_leaves_the_old_file_and_no_litter(tmp_path, monkeypatch):
    path = tmp_path / "a.txt"
    write_bytes(path, b"old")

    def fail(*args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", fail)
    with pytest.raises(OSError, match="No space"):
        write_bytes(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_whole_file_appears_at_the_end_and_replaces_only_when_asked(tmp_path):
    path = tmp_path / "a.bin"
    with whole_file(path, overwrite=False) as file:
        file.write(b"new")
        assert not path.exists()
    assert path.read_bytes() == b"new"
    with pytest.raises(FileExistsError), whole_file(path, overwrite=False):
        pytest.fail("opened")
    with whole_file(path) as file:
        file.write(b"newer")
    assert path.read_bytes() == b"newer"
    with pytest.raises(TypeError), whole_file(path) as file:
        file.write("text is no bytes")
    assert path.read_bytes() == b"newer"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("links", [True, False])
def test_whole_file_keeps_what_another_process_wrote_meanwhile(tmp_path, monkeypatch, links):
    if not links:
        monkeypatch.setattr("pathlib.Path.hardlink_to", lambda *_: (_ for _ in ()).throw(OSError(95, "no links")))
    path, other = tmp_path / "a.bin", tmp_path / "b.bin"
    with pytest.raises(FileExistsError) as refused, whole_file(path, overwrite=False):
        path.write_bytes(b"theirs")
    assert refused.value.filename == str(path)
    assert path.read_bytes() == b"theirs"
    with whole_file(other, overwrite=False) as file:
        file.write(b"mine")
    assert other.read_bytes() == b"mine"
    assert sorted(tmp_path.iterdir()) == [path, other]


def test_json_refuses_nan_and_keeps_doubles(tmp_path):
    with pytest.raises(ValueError, match="not JSON compliant"):
        dump_json({"a": float("nan")})
    value = 0.1 + 0.2
    assert json.loads(dump_json({"a": value}))["a"] == value


def test_lock_is_refused_while_held_and_free_after_the_holder_is_killed(tmp_path):
    path = tmp_path / "lock"
    code = (
        "import time\nfrom cpic_core.files import exclusive_lock\n"
        f"with exclusive_lock({str(path)!r}) as f:\n"
        "    f.write('held'); f.flush(); print('in', flush=True); time.sleep(60)"
    )
    holder = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert holder.stdout.readline().strip() == "in"
    with pytest.raises(LockHeld, match="held"), exclusive_lock(path, wait=False):
        pass
    holder.kill()
    holder.wait()
    holder.stdout.close()
    with exclusive_lock(path, wait=False):
        pass


ARRAYS = {"b": np.arange(6.0).reshape(2, 3), "a": np.array([1, 2], dtype=np.int16)}


def test_round_trip_and_same_bytes(tmp_path):
    write_npz(tmp_path / "one.npz", ARRAYS)
    write_npz(tmp_path / "two.npz", dict(reversed(ARRAYS.items())))
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    back = read_npz(tmp_path / "one.npz")
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(back[name], array)
        assert back[name].dtype == array.dtype


@pytest.mark.parametrize("kind", ["<f4", ">f4", "<f8"])
def test_byte_planes_hold_every_bit(kind):
    numbers = np.array([[0.0, -1.5, np.inf], [np.nan, 5e-39, 0.1]], kind)
    planes = byte_planes(numbers)
    # The heaviest byte comes last: -1.5 is sign and seven bits of the exponent, then its last bit and the half.
    assert planes.dtype == np.uint8
    assert planes[-2:, 0, 1].tolist() == {4: [0xC0, 0xBF], 8: [0xF8, 0xBF]}[numbers.itemsize]
    assert of_byte_planes(planes).tobytes() == numbers.astype(kind.replace(">", "<")).tobytes()


@pytest.mark.parametrize("damage", ["missing", "text", "cut", "flipped", "pickle"])
def test_damaged_files_are_refused_in_one_line(refused, tmp_path, damage):
    path = tmp_path / "file.npz"
    if damage == "text":
        path.write_text("not arrays")
    elif damage == "pickle":
        np.savez(path, a=np.array([{"key": 1}], dtype=object))
    elif damage != "missing":
        write_npz(path, ARRAYS | {"c": np.random.default_rng(1).normal(size=4000)})
        body = bytearray(path.read_bytes())
        if damage == "cut":
            body = body[: len(body) // 2]
        else:
            body[len(body) // 2] ^= 0xFF
        path.write_bytes(bytes(body))
    refused("npz file of plain arrays", read_npz, path)


@given(st.text("'=+-@\t\r1.e x", max_size=8))
def test_a_guarded_cell_is_no_formula_and_reads_back(text):
    cell = guarded(text)
    assert unguarded(cell) == visible(text)
    assert unguarded(text) == text or text.startswith("'")
    if cell.startswith(("=", "+", "-", "@", "\t", "\r")):
        assert cell == visible(text)
        float(cell)  # a number stays as it is


@pytest.mark.parametrize(("name", "folder"), [("a/b", True), (".", True), ("a.txt", False), ("file", False)])
def test_what_can_be_written_is_not_made(tmp_path, name, folder):
    (tmp_path / "file").write_text("")  # is replaced
    check_writable(tmp_path / name, key="--out", folder=folder)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    ("name", "folder", "words"),
    [
        ("file", True, "a writable folder (Not a directory)"),
        ("file/a/b", True, "a writable folder (Not a directory)"),
        ("dangling", True, "a writable folder (No such file or directory)"),
        (".", False, "a writable file (this is a folder)"),
        ("a/b", False, "a writable file (No such file or directory)"),
        ("x" * 300, True, "a writable folder (File name too long)"),
        ("a\0b", True, "a writable folder (embedded null byte)"),
    ],
)
def test_what_cannot_be_written_is_refused(tmp_path, refused, name, folder, words):
    (tmp_path / "file").write_text("")
    (tmp_path / "dangling").symlink_to("nowhere")
    refused(f"--out = .*{re.escape(words)}", check_writable, tmp_path / name, key="--out", folder=folder)


def special(place, kind):
    """Make something of a kind that is no regular file; returns its path and what a refusal says of it."""
    path = place / "out.csv"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "socket":
        listening = socket.socket(socket.AF_UNIX)
        listening.bind(str(path))
        listening.close()
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to(
            {"link to nothing": "nothing", "link to a device": "/dev/null", "link to itself": "out.csv"}[kind]
        )
    words = {
        "link to a device": "this is a device",
        "link to nothing": "No such file",
        "link to itself": "symbolic links",
    }
    return path, words.get(kind, f"this is a {kind}")


@pytest.mark.parametrize("kind", ["pipe", "socket", "folder", "link to a device", "link to nothing", "link to itself"])
def test_what_is_no_regular_file_is_not_replaced(tmp_path, refused, kind):
    path, words = special(tmp_path, kind)
    before = os.lstat(path)
    refused(f"--out = .*a writable file .*{words}", write_named, path, "text", key="--out")
    refused(f"--out = .*a writable file .*{words}", check_writable, path, key="--out")
    assert os.lstat(path).st_mode == before.st_mode
    assert os.lstat(path).st_ino == before.st_ino


def test_a_link_stays_and_its_file_is_written(tmp_path):
    (tmp_path / "far").mkdir()
    (tmp_path / "far" / "target.csv").write_text("old")
    (tmp_path / "between").symlink_to("far/target.csv")
    (tmp_path / "out.csv").symlink_to("between")
    assert write_named(tmp_path / "out.csv", "new", key="--out") == (tmp_path / "far" / "target.csv").resolve()
    assert os.readlink(tmp_path / "out.csv") == "between"
    assert (tmp_path / "far" / "target.csv").read_text() == "new"
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["between", "far", "out.csv", "target.csv"]


def read(path, max_bytes=100):
    return read_file(path, key="file", allowed="a file", max_bytes=max_bytes)


def test_a_file_is_read_also_through_a_link_and_from_home(tmp_path, monkeypatch):
    (tmp_path / "x").write_bytes(b"\xef\xbb\xbfhello")
    (tmp_path / "link").symlink_to("x")
    assert read(tmp_path / "link") == b"\xef\xbb\xbfhello"
    monkeypatch.setenv("HOME", str(tmp_path))
    assert read_text("~/x", key="file", allowed="a file", max_bytes=100) == "hello"
    assert digest_of(tmp_path / "x") == hashlib.sha256(b"\xef\xbb\xbfhello").hexdigest()
    with open_file(tmp_path / "x", key="file", allowed="a file", max_bytes=8) as file:
        assert file.seek(3) == 3


@pytest.mark.parametrize("name", ["pipe", "link", "folder", "", "no", "\0", "/dev/zero", "/dev/random", "/dev/full"])
def test_what_is_no_regular_file_is_refused(refused, tmp_path, name):
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("/dev/zero")
    refused("a file", read, name if name.startswith("/") else tmp_path / name)


def test_what_is_too_large_is_refused_before_it_is_read(refused, tmp_path):
    with (tmp_path / "large").open("wb") as file:
        file.truncate(2**40)  # a hole: it takes no room
    refused("at most 100 bytes", read, tmp_path / "large")
    refused(f"at most {MAX_BYTES} bytes", load_yaml, tmp_path / "large")


def test_a_file_that_does_not_tell_its_size_is_read_no_further_than_allowed(refused):
    assert os.stat("/proc/self/status").st_size == 0
    refused("at most 10 bytes", read, "/proc/self/status", 10)


SECRET = "hunter2"
STRANGERS = {
    "a password file": f"root:x:0:0:{SECRET}:/root:/bin/bash\nuser:x:1:1::/home:/bin/sh\n",
    "settings of others": f"password: {SECRET}\nuser: me\n",
    "of another kind": f"kind: Secret\nname: {SECRET}\ndata: {{password: {SECRET}}}\n",
    "a list": f"- {SECRET}\n",
    "a word": SECRET,
    "one key twice": f"{SECRET}: 1\n{SECRET}: 2\n",
    "a tag": f"a: !{SECRET} 1\n",
    "an alias": f"a: *{SECRET}\n",
    "no YAML": f"a: '{SECRET}\n b: {{",
    "a kind of its own": f"kind: [{SECRET}]\n",
}


@pytest.mark.parametrize("kind", ["instrument", "scene"])
@pytest.mark.parametrize("text", STRANGERS.values(), ids=STRANGERS)
def test_a_file_of_somebody_else_is_not_quoted(tmp_path, text, kind):
    path = tmp_path / "x.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as refused:
        load_mapping(path, kind, ("detector", "cstar"))
    assert SECRET not in str(refused.value)
    assert "x.yaml" in str(refused.value)


def test_a_file_of_ours_is_quoted(refused, tmp_path):
    path = tmp_path / "x.yaml"
    path.write_text("kind: instrument\ndetector: 1\ndetector: 2\n")
    refused("line 3 column 1 = duplicate key 'detector'", load_mapping, path, "instrument", ())
    path.write_text("Detector: {read_noise_e: 1}\nnonsense: 2\n")
    assert load_mapping(path, "instrument", ("detector",)) == {"Detector": {"read_noise_e": 1}, "nonsense": 2}
    path.write_text("kind: scene\n")
    assert load_mapping(path, "instrument", ("detector",)) == {"kind": "scene"}


def test_a_pipe_that_somebody_writes_to_is_not_read(refused, tmp_path):
    """Opening one for writing waits for a reader: none comes."""
    path = tmp_path / "pipe"
    os.mkfifo(path)
    writer = threading.Thread(target=lambda: path.open("wb").close(), daemon=True)
    writer.start()
    refused("this is a pipe", read, path)
    assert writer.is_alive()
    reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    writer.join(5)
    os.close(reader)
    assert not writer.is_alive()


def test_where_files_are_sent_names_mean_what_was_sent_and_nothing_on_the_disk(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.txt").write_text("of the disk")
    (tmp_path / "b.txt").write_text("of the disk")
    about = {"key": "file", "allowed": "a file", "max_bytes": 100}
    before = file_state("a.txt")
    with only_sent_files({"a.txt": b"as sent"}):
        assert read_text("a.txt", **about) == "as sent"
        assert (is_file("a.txt"), is_file("b.txt"), was_sent("a.txt"), was_sent("b.txt")) == (True, False, True, False)
        assert digest_of("a.txt") == hashlib.sha256(b"as sent").hexdigest()
        assert file_state("a.txt") != before
        for name in ("b.txt", str(tmp_path / "a.txt"), "./a.txt/../b.txt", "/etc/passwd", "~/.netrc"):
            with pytest.raises(InputError, match="no such file was sent"):
                read_text(name, **about)
        with pytest.raises(InputError, match="at most 3 bytes"):
            read_text("a.txt", **about | {"max_bytes": 3})
        with pytest.raises(InputError, match="command line"):
            refuse_sent("a.txt", key="grid")
        assert load_instrument("as_published").name == "as_published"
    assert read_text("a.txt", **about) == "of the disk"
    assert not was_sent("a.txt")
    assert load_instrument().name
