"""The disk cache: an entry answers only the question it was made for, nothing that stands in its place does harm."""

import hashlib
import io
import json
import logging
import os
import subprocess
import sys
import time
from dataclasses import asdict

import numpy as np
import pytest

from cpic_core import cache, cache_info, clear_cache, compute_once

KEY, OTHER = "metrics-0123456789abcdef", "metrics-fedcba9876543210"
MAGIC = b"cpic-cache-2\n"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("CPIC_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.delenv("CPIC_CACHE_MAX_MB", raising=False)
    return tmp_path / "cache"


def asked(key=KEY, value=1.0, size=5):
    """What the cache says, and whether it was computed now."""
    calls = []

    def compute():
        calls.append(key)
        return {"a": np.full(size, value)}

    return compute_once(key, compute, lambda found: found["a"].reshape(size)).tolist(), bool(calls)


def entry_of(key, payload, **changes):
    """An entry whose sum is right, whatever its content."""
    said = {"key": key, "version": cache._version()} | changes
    whole = hashlib.sha256(f"{said['key']}\n{said['version']}\n".encode() + payload).hexdigest()
    return MAGIC + json.dumps(said | {"sum": whole}).encode() + b"\n" + payload


def packed(**arrays):
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def test_what_was_computed_is_read_with_its_types():
    made = {"a": np.arange(5.0), "b": np.array([[True]]), "c": np.asarray("word"), "d": np.float32([1.5])}
    for compute in (lambda: made, dict):
        found = compute_once(KEY, compute, dict)
        for name, array in made.items():
            np.testing.assert_array_equal(found[name], array)
            assert found[name].dtype == array.dtype
    assert cache_info().n_entries == 1
    assert clear_cache().n_entries == 1
    assert cache_info().n_entries == cache_info().size_bytes == 0


def test_entries_that_stand_under_each_others_names_answer_neither(folder, caplog):
    """Metrics of two instruments were once swapped: the answer was that of the other one, without a word."""
    asked(KEY, 1.0), asked(OTHER, 2.0)
    one, two = (folder / f"{key}.bin" for key in (KEY, OTHER))
    kept = one.read_bytes()
    one.write_bytes(two.read_bytes())
    two.write_bytes(kept)
    assert asked(KEY, 1.0) == ([1.0] * 5, True)
    assert asked(OTHER, 2.0) == ([2.0] * 5, True)
    assert [record.getMessage().count("it answers metrics-") for record in caplog.records] == [1, 1]
    assert asked(KEY) == ([1.0] * 5, False)


def test_no_flipped_bit_is_believed(folder):
    asked()
    path = folder / f"{KEY}.bin"
    good = path.read_bytes()
    with pytest.raises(LookupError):
        cache._stored(OTHER, dict)
    for place in range(len(good)):
        wrong = bytearray(good)
        wrong[place] ^= 1 << place % 8
        path.write_bytes(wrong)
        with pytest.raises(LookupError):
            cache._stored(KEY, dict)
        assert not path.exists()
    path.write_bytes(good)
    np.testing.assert_array_equal(cache._stored(KEY, dict)["a"], np.ones(5))


def test_bad_content_with_a_good_sum_is_computed_anew(folder, caplog):
    """Each once ended every run with an error until the cache was emptied."""
    objects = io.BytesIO()
    np.savez(objects, a=np.array([{}], dtype=object))
    contents = {
        "no npz": entry_of(KEY, b"words"),
        "empty": entry_of(KEY, b""),
        "other arrays": entry_of(KEY, packed(b=np.ones(5))),
        "another shape": entry_of(KEY, packed(a=np.ones(4))),
        "objects": entry_of(KEY, objects.getvalue()),
        "cut": entry_of(KEY, packed(a=np.ones(5))[:-30]),
        "the key is a list": entry_of([KEY], packed(a=np.ones(5))),
        "another key": entry_of(OTHER, packed(a=np.ones(5))),
        "nothing": b"",
        "a head without end": MAGIC + b"{" * 5000,
        "a head that is no mapping": MAGIC + b"[]\n" + packed(a=np.ones(5)),
    }
    folder.mkdir()
    for what, content in contents.items():
        caplog.clear()
        (folder / f"{KEY}.bin").write_bytes(content)
        assert asked(value=3.0) == ([3.0] * 5, True), what
        assert len(caplog.records) == 1, what
        assert KEY in caplog.text
        assert "\n" not in caplog.records[0].getMessage()
        assert asked() == ([3.0] * 5, False), what


@pytest.mark.parametrize("kind", ["pipe", "link to a device", "link to a file", "folder", "huge"])
def test_what_is_no_file_of_ours_is_not_read(folder, tmp_path, kind):
    folder.mkdir()
    path, decoy = folder / f"{KEY}.bin", tmp_path / "decoy"
    decoy.write_bytes(entry_of(KEY, packed(a=np.zeros(5))))
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "huge":
        with path.open("wb") as file:
            file.truncate(10**12)
    else:
        path.symlink_to("/dev/zero" if kind == "link to a device" else decoy)
    assert asked(value=4.0) == ([4.0] * 5, True)
    assert asked(value=4.0) == ([4.0] * 5, kind == "folder")
    assert decoy.read_bytes() == entry_of(KEY, packed(a=np.zeros(5)))


@pytest.mark.parametrize("old", [b"cpic-cache-1\n" + b"\0" * 40, entry_of(KEY, packed(a=np.zeros(5)), version="0.0.1")])
def test_entries_of_another_version_are_neither_read_nor_kept(folder, caplog, old):
    folder.mkdir()
    for key in (KEY, OTHER):
        (folder / f"{key}.bin").write_bytes(old)
    assert cache_info().n_entries == 2
    assert asked(value=5.0) == ([5.0] * 5, True)
    assert [path.name for path in folder.glob("*.bin")] == [f"{KEY}.bin"]
    assert caplog.records == [], "an update is no damage"


def test_the_least_recently_used_go_first_beyond_the_limit(folder, monkeypatch):
    keys = [f"modes-{number:016x}" for number in range(6)]
    monkeypatch.setenv("CPIC_CACHE_MAX_MB", "0.036")  # four entries of 8 kB
    for number, key in enumerate(keys[:4]):
        asked(key, size=1000)
        os.utime(folder / f"{key}.bin", (1000 + number,) * 2)
    assert asked(keys[0], size=1000)[1] is False, "read now: the last to go"
    for key in keys[4:]:
        asked(key, size=1000)
    assert sorted(path.stem for path in folder.glob("*.bin")) == [keys[0], *keys[3:]]
    assert sorted(path.stem for path in folder.glob("*.lock")) == [keys[0], *keys[3:]]
    info = cache_info()
    assert info.size_bytes <= info.limit_bytes == 36_000
    monkeypatch.setenv("CPIC_CACHE_MAX_MB", "0")
    assert asked(KEY)[1]
    assert cache_info().n_entries == 0


@pytest.mark.parametrize("limit", ["-1", "nan", "inf", "much", "1e10"])
def test_a_limit_that_is_none_is_refused(refused, monkeypatch, limit):
    monkeypatch.setenv("CPIC_CACHE_MAX_MB", limit)
    refused("CPIC_CACHE_MAX_MB = .* MB: not accepted; allowed: 0 to 1e9", asked)


def test_files_of_others_in_the_folder_stay(folder, monkeypatch):
    """The variable may name any folder: what is not ours is neither counted nor removed."""
    folder.mkdir()
    theirs = {"firmware.bin": b"theirs", "poetry.lock": b"", f"{OTHER}.bin": b"a name like ours", ".x.part": b"1"}
    for name, content in theirs.items():
        (folder / name).write_bytes(content)
    monkeypatch.setenv("CPIC_CACHE_MAX_MB", "0")
    asked()
    assert clear_cache().n_entries == 0
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == theirs


def test_what_a_killed_process_was_writing_is_removed_in_time(folder):
    folder.mkdir()
    old, new = folder / f".{KEY}.bin.abc_1.part", folder / f".{KEY}.bin.abc_2.part"
    for path in (old, new):
        path.write_bytes(b"half")
    os.utime(old, (time.time() - 7200.0,) * 2)
    asked()
    assert not old.exists()
    assert new.exists(), "it may be being written"
    clear_cache()
    assert list(folder.iterdir()) == []


def test_a_folder_that_cannot_be_used_is_a_warning(folder, caplog):
    folder.write_text("")
    assert asked() == ([1.0] * 5, True)
    assert "going on without" in caplog.text


def test_an_entry_that_cannot_be_removed_or_touched_is_no_failure(folder, monkeypatch, caplog):
    asked()
    (folder / f"{KEY}.bin").write_bytes(b"damaged")

    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pathlib.Path.unlink", refuse)
    monkeypatch.setattr("os.utime", refuse)
    assert asked() == ([1.0] * 5, True)
    assert asked() == ([1.0] * 5, False)
    assert "it is damaged" in caplog.text


COMPUTING = f"""
import sys, time
import numpy as np
from cpic_core import compute_once
def compute():
    print("computing", flush=True)
    time.sleep(float(sys.argv[1]))
    return {{"a": np.full(5, 7.0)}}
print(compute_once({KEY!r}, compute, lambda found: found["a"].tolist()), flush=True)
"""


def started(duration_s):
    return subprocess.Popen([sys.executable, "-c", COMPUTING, str(duration_s)], stdout=subprocess.PIPE, text=True)


def test_of_two_processes_one_computes_and_the_other_waits_and_reads(caplog):
    with started(0.5) as other:
        assert other.stdout.readline() == "computing\n"
        with caplog.at_level(logging.INFO):
            assert asked() == ([7.0] * 5, False)
        assert other.communicate()[0] == "[7.0, 7.0, 7.0, 7.0, 7.0]\n"
    assert f"another process computes {KEY}" in caplog.text


def test_a_process_that_was_killed_holds_nobody_up(folder):
    with started(60) as other:
        assert other.stdout.readline() == "computing\n"
        assert (folder / f"{KEY}.lock").exists()
        other.kill()
    assert asked() == ([1.0] * 5, True)
    assert asked() == ([1.0] * 5, False)


def test_keys_have_no_folders():
    for key in ("../x-0123456789abcdef", "k", "", "/etc/passwd", "a/b-0123456789abcdef", f"{KEY}\n"):
        with pytest.raises(ValueError, match="cache key"):
            asked(key)


def test_the_command_says_what_there_is(capsys, folder):
    from cpic_planner.cli.main import main

    asked()
    assert main(["cache", "info", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == asdict(cache_info()) | {"folder": str(folder)}
    assert main(["cache", "info"]) == 0
    assert "1 entries, 0.0 of at most 2000 MB" in capsys.readouterr().out
    assert main(["cache", "clear"]) == 0
    assert list(folder.iterdir()) == []
