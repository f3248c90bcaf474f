import json
import multiprocessing
import subprocess
import sys

import numpy as np
import pytest

from cpic_core import LockHeld, dump_json, exclusive_lock, files, whole_file, write_bytes
from cpic_core.files import write_json


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
    assert json.loads(write_json(tmp_path / "x.json", {"a": value}).read_text())["a"] == value


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


@pytest.fixture
def cache_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("CPIC_CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_cache_gives_back_what_was_put(cache_folder):
    assert files.get_arrays("k") is None
    files.put_arrays("k", {"a": np.arange(5.0), "b": np.array([[True]])})
    found = files.get_arrays("k")
    np.testing.assert_array_equal(found["a"], np.arange(5.0))
    assert files.cache_info().n_entries == 1
    assert files.clear_cache().n_entries == 1
    assert files.cache_info().n_entries == 0


@pytest.mark.parametrize("damage", [lambda b: b[:-3], lambda b: b[:40] + b"x" + b[41:], lambda b: b""])
def test_damaged_entry_is_rebuilt(cache_folder, damage, caplog):
    files.put_arrays("k", {"a": np.arange(5.0)})
    entry = next(cache_folder.glob("*.bin"))
    entry.write_bytes(damage(entry.read_bytes()))
    calls = []

    def compute():
        calls.append(1)
        return {"a": np.ones(2)}

    np.testing.assert_array_equal(files.compute_once("k", compute)["a"], np.ones(2))
    np.testing.assert_array_equal(files.compute_once("k", compute)["a"], np.ones(2))
    assert calls == [1]
    assert "damaged" in caplog.text


def test_unwritable_cache_is_a_warning(tmp_path, monkeypatch, caplog):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("CPIC_CACHE_DIR", str(tmp_path / "file" / "cache"))
    np.testing.assert_array_equal(files.compute_once("k", lambda: {"a": np.ones(1)})["a"], np.ones(1))
    assert "going on without" in caplog.text


def _slow_compute(folder, queue):
    import os
    import time

    os.environ["CPIC_CACHE_DIR"] = folder

    def compute():
        time.sleep(0.5)
        queue.put("computed")
        return {"a": np.ones(1)}

    files.compute_once("shared", compute)


def test_two_processes_compute_once(cache_folder):
    context = multiprocessing.get_context("spawn")
    queue = context.Queue()
    both = [context.Process(target=_slow_compute, args=(str(cache_folder), queue)) for _ in range(2)]
    for process in both:
        process.start()
    for process in both:
        process.join(30)
    assert queue.get(timeout=5) == "computed"
    assert queue.empty()
