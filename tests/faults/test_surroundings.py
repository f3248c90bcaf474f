"""Streams that are closed or full, no home, folders that cannot be written: answers and exit codes as documented."""

import os
import shutil
import subprocess
import sys

import pytest

ANSWER = ["schema", "etc"]
TABLE = ["cache", "info"]
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


@pytest.mark.parametrize("error", ["err", None, "/dev/full"])
@pytest.mark.parametrize("out", ["out", None, "/dev/full"])
def test_a_bad_question_ends_with_2_whoever_listens(server, tmp_path, out, error):
    done = server.run(BAD, tmp_path, streams=(NULL, out, error))
    assert (done.status, done.out) == (2, "")
    assert done.err == ("cpic: --snr = -5.0: not accepted; allowed: 1e-06 to 1e+06\n" if error == "err" else "")


def test_a_user_without_a_home_loses_only_what_is_kept_there(harness, server, whole, tmp_path):
    """Nor is a folder called ~ made."""
    files, _ = whole("simulate")
    place = harness.Place(tmp_path / "run", "simulate")
    nothing = dict.fromkeys(("HOME", "CPIC_CACHE_DIR", "XDG_CACHE_HOME", "XDG_DATA_HOME", "CPIC_DATA_DIR"))
    done = server.run(place.argv, place.folder, fault={"kind": "homeless"}, environment=nothing)
    assert done.proof["asked"] >= 1
    place.check_finished(done, files)
    assert not list(tmp_path.rglob("~*"))


@pytest.mark.parametrize("argv", [["simulate", "--kind", "BIAS", "--out", "run"], ["simulate", "--kind", "BIAS"]])
def test_a_folder_that_cannot_be_written_is_refused(server, tmp_path, argv):
    """Root may write everywhere, so that it gives up that right."""
    place = tmp_path / "place"
    place.mkdir()
    place.chmod(0o555)
    command = [sys.executable, "-m", "cpic_planner.cli.main", *argv, "-q"]
    if os.geteuid() == 0:
        if shutil.which("setpriv") is None:
            pytest.skip("root cannot give up its rights without setpriv")
        command = ["setpriv", "--bounding-set=-dac_override,-dac_read_search", *command]
    done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "a writable folder (Permission denied)" in done.stderr
    assert list(place.iterdir()) == []
