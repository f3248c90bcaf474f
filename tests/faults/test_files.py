"""Disks that are full or broken, and kills, at steps of writing: what a run promises of its files.

All commands, and 50 kills of each, half of them at random times: ``make kills``.
"""

import hashlib
import os
import shutil
import subprocess

import pytest

KINDS = ("kill", "full", "broken")


def test_the_steps_are_those_of_the_writer(whole):
    """A product is made whole under another name, synchronised, listed, and only then gets its own."""
    files, steps = whole("tiny")
    part = f"parts/square_7-{hashlib.sha256(b'square 7').hexdigest()[:8]}.json"
    assert set(files) == {"squares.json", "pages/square.txt", part}
    temporary, listed = ".cpic-*/.product.*.part", "cpic-run.jsonl"
    for name in ("squares.json", part, "run.json"):
        end = steps.index(f"rename {name}")
        assert steps[end - 8 : end] == [
            *(f"{operation} {temporary}" for operation in ("open", "write", "sync", "chmod")),
            "rename .cpic-*/product",
            *(f"{operation} {listed}" for operation in ("open", "write", "sync")),
        ]


@pytest.mark.parametrize("kind", KINDS)
def test_a_run_that_breaks_at_any_step_of_writing_continues(harness, server, whole, tmp_path, kind):
    """Every step that stands for its like; a step of each file that is made has a name of its own."""
    files, steps = whole("tiny")
    ends = set()
    for at in (at for at, step in enumerate(steps) if step not in steps[:at]):
        fault = {"kind": kind, "at": at}
        ends.add(harness.check_broken(server, "tiny", tmp_path / str(at), fault, files, steps).status)
    assert ends == ({-1} if kind == "kill" else {0, 1})  # 0: the last step, which tidies up, may fail


@pytest.mark.parametrize(("kind", "step"), [("kill", "rename CAL"), ("full", "write .cpic")])
def test_a_simulation_that_breaks_continues(harness, server, whole, tmp_path, kind, step):
    files, steps = whole("simulate")
    operation, place = step.split()
    like = [at for at, name in enumerate(steps) if name.startswith(f"{operation} ") and place in name]
    harness.check_broken(server, "simulate", tmp_path / "run", {"kind": kind, "at": like[len(like) // 2]}, files, steps)


def test_a_file_that_cannot_be_read_any_more_is_made_again(harness, server, whole, tmp_path):
    """A disk error in a part that an earlier run finished: it is kept aside, as what cannot be recognised, and done."""
    files, steps = whole("tiny")
    place = harness.Place(tmp_path / "run", "tiny")
    at = steps.index("rename squares.json")
    server.run(place.argv, place.folder, root=str(place.out), fault={"kind": "kill", "at": at})
    (part,) = (name for name in files if name.startswith("parts/"))
    fault = {"kind": "unreadable", "name": part}
    done = server.run(place.argv, place.folder, root=str(place.out), fault=fault)
    assert done.proof == {"read": part}
    assert done.status == 0, done
    assert "doing it again" in done.err
    aside = place.results().keys() - files.keys()
    assert aside == {f"{part}.changed-1"}
    (place.out / aside.pop()).unlink()
    place.check_finished(done, files)


def test_a_run_of_another_version_is_refused_and_nothing_of_it_is_touched(harness, server, whole, tmp_path):
    files, steps = whole("tiny")
    place = harness.Place(tmp_path / "run", "tiny", decoys=False)
    kill = {"kind": "kill", "at": steps.index("rename squares.json")}
    assert server.run(place.argv, place.folder, root=str(place.out), fault=kill).signal == 9
    before = harness.tree(place.out)
    done = server.run(place.argv, place.folder, fault={"kind": "version", "version": "99.0"})
    assert done.proof == {"version": "99.0"}
    assert (done.status, done.err.count("\n")) == (2, 1), done
    assert "another folder" in done.err
    after = harness.tree(place.out)
    assert {name for name in before if before[name] != after.get(name)} <= {"run.lock"}
    place.check_finished(server.run(place.argv, place.folder), files)


@pytest.mark.parametrize("shift_s", [10 * 365 * 86400.0, -10 * 365 * 86400.0])
@pytest.mark.parametrize("looks", [0, 1, 2])
def test_a_clock_that_jumps_changes_nothing_but_the_story(harness, server, whole, tmp_path, shift_s, looks):
    files, _ = whole("tiny")
    place = harness.Place(tmp_path / "run", "tiny")
    done = server.run(place.argv, place.folder, fault={"kind": "clock", "at": looks, "shift_s": shift_s})
    assert done.proof == {"looks": looks, "shift_s": shift_s}
    place.check_finished(done, files)


def test_a_small_disk_that_is_really_full(harness, server, whole, tmp_path):
    """A file system of 120 kB, on which the part and the result find a place, and the product does not."""
    files, _ = whole("tiny")
    disk = tmp_path / "run"
    disk.mkdir()
    if os.geteuid() or shutil.which("mount") is None:
        pytest.skip("only root may mount")
    size = "-o", "size=120k"
    if subprocess.run(["mount", "-t", "tmpfs", *size, "tmpfs", disk], capture_output=True, check=False).returncode:
        pytest.skip("nothing may be mounted here")
    try:
        place = harness.Place(disk / "place", "tiny")
        done = server.run(place.argv, place.folder)
        assert (done.status, done.err.count("\n")) == (1, 1), done
        assert "No space left on device" in done.err
        place.check_untouched()
        place.check_no_half(files)
        subprocess.run(["mount", "-o", "remount,size=4m", disk], check=True)
        place.check_finished(server.run(place.argv, place.folder), files)
    finally:
        subprocess.run(["umount", disk], check=True)


def test_a_kill_after_a_part_of_the_work(kills, server, whole, tmp_path):
    """One of those of the long proof; where the machine is so quick that there is nothing left to kill, earlier."""
    files, _ = whole("simulate")
    for number in range(10):
        fault = {"kind": "time", "after_s": 0.3 / 2**number}
        if kills.check_killed(server, "simulate", tmp_path / str(number), fault, files):
            return
    pytest.fail("nothing was killed")
