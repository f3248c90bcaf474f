"""Streams that are closed or full, no home, folders that cannot be written: answers and exit codes as documented."""

import json
import os
import shutil
import subprocess
import sys

import pytest

ANSWER = ["schema", "etc"]
TABLE = ["catalog", "info"]
BAD = ["etc", "tau Cet", "--snr", "-5"]
NULL = "/dev/null"


@pytest.mark.parametrize("argv", [ANSWER, TABLE], ids=" ".join)
@pytest.mark.parametrize("streams", [(None, "out", "err"), (NULL, "out", None), (NULL, "out", "/dev/full")])
def test_an_answer_needs_stdout_alone(server, tmp_path, argv, streams):
    expected = server.run(argv, tmp_path)
    assert (expected.status, expected.err) == (0, "")
    done = server.run(argv, tmp_path, streams=streams)
    assert (done.status, done.out) == (0, expected.out)


@pytest.mark.parametrize("streams", [(NULL, None, "err"), (None, None, None)])
def test_an_answer_that_nobody_wants_is_no_failure(server, tmp_path, streams):
    done = server.run(ANSWER, tmp_path, streams=streams)
    assert (done.status, done.err) == (0, "")


@pytest.mark.parametrize("argv", [ANSWER, TABLE], ids=" ".join)
def test_an_answer_that_is_lost_is_a_failure(server, tmp_path, argv):
    done = server.run(argv, tmp_path, streams=(NULL, "/dev/full", "err"))
    assert (done.status, done.err.count("\n")) == (1, 1), done
    assert "No space left on device" in done.err


def refused_in(text):
    """Return the lines of a refusal; a slow machine may be told of progress before it."""
    return [line for line in text.splitlines() if not line.endswith(" s so far)")]


@pytest.mark.parametrize(
    ("out", "error"), [("out", "err"), (None, "/dev/full"), ("/dev/full", None), (None, None), ("/dev/full", "err")]
)
def test_a_bad_question_ends_with_2_whoever_listens(server, tmp_path, out, error):
    done = server.run(BAD, tmp_path, streams=(NULL, out, error))
    assert (done.status, done.out) == (2, "")
    said = "cpic: --snr = -5.0: not accepted; allowed: 1e-06 to 1e+06"
    assert refused_in(done.err) == ([said] if error == "err" else [])


def test_a_user_without_a_home_loses_only_what_is_kept_there(harness, server, whole, tmp_path):
    """Nor is a folder called ~ made."""
    files, _ = whole("simulate")
    place = harness.Place(tmp_path / "run", "simulate")
    nothing = dict.fromkeys(("HOME", "CPIC_CACHE_DIR", "XDG_CACHE_HOME", "XDG_DATA_HOME", "CPIC_DATA_DIR"))
    done = server.run(place.argv, place.folder, fault={"kind": "homeless"}, environment=nothing)
    assert done.proof["asked"] >= 1
    place.check_finished(done, files)
    assert not list(tmp_path.rglob("~*"))


def test_a_folder_that_cannot_be_written_is_refused(tmp_path):
    """Root may write everywhere, so that it gives up that right."""
    place = tmp_path / "place"
    place.mkdir()
    place.chmod(0o555)
    command = [sys.executable, "-m", "cpic_planner.cli.main", "simulate", "--kind", "BIAS", "-q"]
    if os.geteuid() == 0:
        if shutil.which("setpriv") is None:
            pytest.skip("root cannot give up its rights without setpriv")
        command = ["setpriv", "--bounding-set=-dac_override,-dac_read_search", *command]
    done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    (said,) = refused_in(done.stderr)
    assert "a writable folder (Permission denied)" in said
    assert list(place.iterdir()) == []


def test_frames_take_no_further_file_and_no_further_memory(server, harness, whole, tmp_path):
    """At most 16 open files for 2 frames and for 80, and less than half of the memory that 78 more would take."""
    whole("simulate")  # what follows imports nothing
    rows, columns, memory_mb = 206, 236, {}
    camera = {"n_rows": rows, "n_columns": columns, "star_row": 100, "star_column": 100}
    for frames in (2, 80):
        asked = {"instrument": {"detector": camera}, "defaults": {}, "sequences": [{"kind": "BIAS", "frames": frames}]}
        (tmp_path / "x.yaml").write_text(json.dumps(harness.SIMULATION | asked))
        done = server.run(["simulate", "x.yaml", "--out", f"run{frames}", "-q"], tmp_path, most_files=16)
        assert done.status == 0, done
        memory_mb[frames] = done.memory_mb
    assert memory_mb[80] - memory_mb[2] < 0.5 * 78 * rows * columns * 2 / 1e6
