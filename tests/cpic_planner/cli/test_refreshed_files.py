"""Refreshing end to end: one whole file or none, and the snapshot and earlier files as they were."""

import hashlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import catalogs
from catalogs import Cuts, RefreshError, TapService, open_catalogue
from cpic_core import InputError
from cpic_planner import load_targets, rank_targets, signal_to_noise
from cpic_planner.cli.catalog_command import refresh_catalog, target_path

pytestmark = pytest.mark.usefixtures("nothing_is_lost")
EMBEDDED = Path(catalogs.__file__).parent / "data"


def service(simbad, **changes):
    return TapService(**({"url": simbad.url, "timeout_s": 60.0, "retries": 0, "pause_s": 0.01} | changes))


def content(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())} if folder.exists() else {}


@pytest.fixture(scope="module", autouse=True)
def _snapshot_stays():
    before = hashlib.sha256(b"".join(content(EMBEDDED).values())).hexdigest()
    yield
    assert hashlib.sha256(b"".join(content(EMBEDDED).values())).hexdigest() == before


def test_result_is_one_dated_file_that_everything_downstream_takes(simbad, data_folder):
    steps = []
    done = refresh_catalog(service=service(simbad), step=steps.append)
    assert [path.name for path in data_folder.iterdir()] == [done.path.name]
    assert done.path.name == f"simbad_{done.made.queried_utc:%Y-%m-%dT%H%M%SZ}.ecsv"
    assert done.sha256 == hashlib.sha256(done.path.read_bytes()).hexdigest()
    assert len(steps) == 3
    frame = load_targets("latest")
    assert len(frame) == 10, "two of the twelve are fainter than V = 7"
    assert set(frame.columns) == set(load_targets().columns)
    assert done.path.name in frame.attrs["catalogue"]
    ranking = rank_targets(catalog="latest", time_s=3000.0, bands=["F520"])
    assert len(ranking.targets) == 10
    assert done.sha256[:12] in ranking.catalogue
    assert "parallax >= 25 mas and V <= 7" in ranking.sample
    answer = signal_to_noise("HD 999002", time_s=3000.0, separation_arcsec=0.5, bands=["F520"], catalog=done.path)[0]
    assert answer.status.value == "ok"
    assert "companions_not_searched" in answer.flags


def test_summary_lists_everything(simbad, data_folder):
    summary = refresh_catalog(service=service(simbad)).summary()
    assert summary["counts"]["stars"] == 12
    assert summary["changes_to_snapshot"]["v_mag_changed"] == ["eps Eri"]
    assert summary["changes_to_snapshot"]["removed"]["alf Boo"] == "not in the answer"
    assert len(summary["queries"]) == 2


FAILURES = [
    "500",
    "drop",
    pytest.param("hang", marks=pytest.mark.long),
    "html",
    "garbage",
    "cut",
    "short",
    "error",
    "server limit",
    "404",
]


@pytest.mark.parametrize("mode", FAILURES)
def test_failure_of_the_service_leaves_no_trace(simbad, data_folder, mode):
    refresh_catalog(service=service(simbad))
    before = content(data_folder)
    simbad.mode, simbad.failures = mode, 99
    with pytest.raises(RefreshError):
        refresh_catalog(service=service(simbad, timeout_s=0.4 if mode == "hang" else 60.0))
    assert content(data_folder) == before
    assert open_catalogue("latest").provenance


def spoil(question, change):
    """Change the rows of one of the two answers."""

    def alter(headings, rows):
        if (len(headings) > 10) == (question == "stars"):
            headings, rows = change(list(headings), [list(row) for row in rows])
        return headings, rows

    return alter


def put(column, value):
    def change(headings, rows):
        rows[0][[name.lower() for name, _, _ in headings].index(column)] = value
        return headings, rows

    return change


@pytest.mark.parametrize(
    ("question", "change", "words"),
    [
        ("stars", lambda headings, rows: (headings, []), "no star"),
        ("stars", lambda headings, rows: (headings, [*rows, rows[0]]), "of one name; same oid"),
        ("stars", put("plx_value", "NaN"), "plx_value = missing"),
        ("stars", put("plx_value", None), "plx_value = missing"),
        (
            "stars",
            lambda headings, rows: (headings[:-2] + headings[-1:], [row[:-2] + row[-1:] for row in rows]),
            "column v",
        ),
        ("measurements", lambda headings, rows: (headings[:3], [row[:3] for row in rows]), "column metallicity"),
    ],
)
@pytest.mark.parametrize("out", [None, "mine.ecsv"])
def test_an_answer_that_cannot_be_right_leaves_no_trace(simbad, data_folder, tmp_path, question, change, words, out):
    target = tmp_path / out if out else None
    if target:
        target.write_text("what was there")
    simbad.alter = spoil(question, change)
    with pytest.raises(RefreshError, match=words):
        refresh_catalog(service=service(simbad), out=target)
    assert not data_folder.exists()
    if target:
        assert target.read_text() == "what was there"
        assert list(tmp_path.glob(".*")) == []


def test_a_chosen_file_is_replaced_whole_and_nothing_else_is_written(simbad, data_folder, tmp_path):
    (tmp_path / "mine.ecsv").write_text("what was there")
    done = refresh_catalog(service=service(simbad), out=tmp_path / "mine.ecsv", cuts=Cuts(v_mag_max=4.0))
    assert done.path.read_text().startswith("# %ECSV")
    assert [path.name for path in tmp_path.iterdir()] == ["mine.ecsv"]
    assert not data_folder.exists()


def test_a_full_or_closed_disk_is_a_failure_in_one_line(simbad, data_folder, monkeypatch):
    def refuse(path, text, *, key):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("cpic_planner.cli.catalog_command.write_named", refuse)
    with pytest.raises(RefreshError, match="No space left on device.*--out or CPIC_DATA_DIR"):
        refresh_catalog(service=service(simbad))
    assert content(data_folder) == {}


def test_a_place_that_cannot_be_written_is_refused_before_the_question(simbad, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("CPIC_DATA_DIR", str(tmp_path / "file" / "data"))
    with pytest.raises(InputError, match="CPIC_DATA_DIR = .*a writable folder .Not a directory"):
        refresh_catalog(service=service(simbad))
    assert simbad.queries == []


@pytest.mark.parametrize("out", ["x.csv", "x", ".", "no/such/folder/x.ecsv", str(EMBEDDED / "stars.ecsv")])
def test_places_that_make_no_sense_are_bad_input(refused, out):
    refused("--out", target_path, out)


def test_interruption_leaves_no_trace(simbad, tmp_path):
    simbad.mode = "hang"
    code = "from cpic_planner.cli.main import main\nimport sys\nsys.exit(main(sys.argv[1:]))"
    process = subprocess.Popen(
        [sys.executable, "-c", code, "catalog", "refresh", "--url", simbad.url, "--timeout-s", "30"],
        env=os.environ | {"CPIC_DATA_DIR": str(tmp_path / "data")},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    deadline = time.monotonic() + 30
    while not simbad.queries and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert out == ""
    assert "interrupted" in err
    assert len([line for line in err.splitlines() if not line.endswith(" so far)")]) == 1
    assert not (tmp_path / "data").exists()
