"""Runs of a folder: found by their marks, shown as they were written, and nothing else."""

import json
import os
from pathlib import Path

import pytest

from cpic_core import InputError
from cpic_planner.jobs.folder import open_run_folder
from cpic_planner.results import RankResult
from cpic_planner.web import application, runs
from cpic_planner.web.runs import runs_of

HASH, OTHER = "0123456789abcdef", "fedcba9876543210"


def run_in(folder, kind="plan", config_hash=HASH, *, record=True, **files):
    with open_run_folder(folder, kind=kind, config_hash=config_hash) as made:
        for name, text in {f"{kind}.json": "{}", "report.html": "<p>report</p>"}.items():
            made.write(name, files.get(name, text))
        made.save_part("secret", {"xyzzy": 1})
        if record:
            made.write("run.json", json.dumps({"finished_utc": "2028-01-02T03:04:05+00:00", "host": "xyzzy"}))


@pytest.fixture
def folder(tmp_path):
    run_in(tmp_path / "first")
    run_in(tmp_path / "deep" / "er" / "second", "whatif", OTHER, record=False)
    ranking = {"schema_version": 1, "kind": "rank", "config_hash": "ab12"}
    (tmp_path / "ranking.json").write_text(json.dumps(ranking, indent=2))
    (tmp_path / "other.json").write_text('{"kind": "rank"')
    (tmp_path / "secret.html").write_text("xyzzy")
    return tmp_path


@pytest.fixture
def shown(browser, folder):
    return type(browser)(application(folder=folder))


def test_runs_are_listed_with_kind_state_date_and_hash(shown):
    runs = {run["title"]: run for run in shown.get("/runs?format=json").json["runs"]}
    assert {title: (run["kind"], run["state"], run["config_hash"]) for title, run in runs.items()} == {
        "first": ("plan", "finished", HASH),
        "second": ("whatif", "not finished", OTHER),
        "ranking": ("rank", "finished", "ab12"),
    }
    assert runs["first"]["date_utc"] == "2028-01-02T03:04:05+00:00"
    page = shown.get("/runs").text
    assert page.index("first") < page.index("second")  # the latest first
    for run in runs.values():
        assert f'href="/runs/{run["id"]}"' in page
        assert shown.get(f"/runs/{run['id']}").status == 200
        for address in run["files"]:
            assert shown.get(address).status == 200, address


def test_a_report_is_shown_as_it_was_written_and_runs_nothing(shown):
    told = shown.get(f"/runs/{HASH}/report.html")
    assert told.text == "<p>report</p>"
    assert told.headers["content-security-policy"].startswith("sandbox; default-src 'none'")
    assert "script" not in told.headers["content-security-policy"]


def test_a_running_one_says_so(folder):
    with open_run_folder(folder / "third", kind="plan", config_hash="cd34"):
        assert [run.state for run in runs_of(folder) if run.title == "third"] == ["running"]
    (folder / "third" / "run.lock").write_text("in use by pid 999999999, started then")
    assert [run.state for run in runs_of(folder) if run.title == "third"] == ["not finished"]


def test_copies_have_numbers(folder):
    run_in(folder / "copy")
    assert {run.id for run in runs_of(folder) if run.config_hash == HASH} == {HASH, f"{HASH}-2"}


@pytest.mark.parametrize(
    "address",
    [
        f"/runs/{HASH}/run.json",
        f"/runs/{HASH}/cpic-run.jsonl",
        f"/runs/{HASH}/parts",
        f"/runs/{HASH}/..%2fsecret.html",
        f"/runs/{HASH}/%2e%2e/secret.html",
        f"/runs/{HASH}/secret.html",
        f"/runs/{HASH}/ranking.csv",
        "/runs/first",
        "/runs/first/report.html",
        "/runs/..",
        "/runs/%2e%2e%2fsecret.html",
        "/runs//secret.html",
        "/runs/%00",
        f"/runs/{HASH}%00/report.html",
    ],
)
def test_nothing_else_is_shown(shown, address):
    told = shown.get(address)
    assert told.status in (404, 405)
    assert "xyzzy" not in told.text
    assert told.text.count("\n") == 1


def test_what_was_changed_or_is_a_link_is_not_shown(shown, folder):
    (folder / "first" / "report.html").write_text("<p>xyzzy!</p>")
    told = shown.get(f"/runs/{HASH}/report.html")
    assert (told.status, "xyzzy" in told.text) == (404, False)
    (folder / "first" / "report.html").unlink()
    os.symlink(folder / "secret.html", folder / "first" / "report.html")
    told = shown.get(f"/runs/{HASH}/report.html")
    assert (told.status, "xyzzy" in told.text) == (404, False)
    os.symlink("/etc", folder / "etc")
    assert all(run.title != "etc" for run in runs_of(folder))


def test_damaged_lists_are_passed_over(folder):
    for number, text in enumerate(("", "{", "[]\n", '{"kind": "plan", "config_hash": "../x"}\n', '{"kind": 1}\n')):
        (folder / f"bad{number}").mkdir()
        (folder / f"bad{number}" / "cpic-run.jsonl").write_text(text)
    assert {run.title for run in runs_of(folder)} == {"first", "second", "ranking"}


def test_without_a_folder_the_page_says_how(ask):
    assert "cpic serve --folder DIR" in ask("/runs").text
    with pytest.raises(InputError, match="--folder"):
        application(folder=Path("/nowhere/at/all"))


def test_a_ranking_says_at_its_beginning_what_it_is():
    """It is known by the first thousand bytes of its file."""
    assert list(RankResult.model_fields)[:4] == ["schema_version", "kind", "fingerprint", "config_hash"]


def test_a_path_of_the_server_is_in_no_refusal(shown, monkeypatch, caplog):
    """What is refused inside, and no question of a visitor, is a fault of the server."""

    def refused():
        raise InputError("--cache", "/xyzzy/cache", allowed="a folder")

    monkeypatch.setattr(runs, "costs", refused)
    told = shown.get("/commands")
    assert told.status == 500
    assert "xyzzy" not in told.text
    assert "xyzzy" in caplog.text
