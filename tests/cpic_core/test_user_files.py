"""Files that somebody named: only regular ones, bounded, and nothing of a stranger's file in a message."""

import hashlib
import os
import threading

import pytest

from cpic_core import (
    InputError,
    digest_of,
    file_state,
    is_file,
    load_mapping,
    load_yaml,
    only_sent_files,
    open_file,
    read_file,
    read_text,
    refuse_sent,
    was_sent,
)
from cpic_core.yaml_files import MAX_BYTES
from simulator.config import load_instrument


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
