"""``cpic catalog`` and ``--catalog`` as a person meets them: outputs, exit statuses, one line of error."""

from __future__ import annotations

import json
from shlex import split

import pytest

pytestmark = pytest.mark.usefixtures("nothing_is_lost")
STARS = "Name,plx [mas],Vmag,SpT,mood\nmine,273.8,3.5,G8V,fine\nHD 20794,165.5,4.26,G8V,\nfaint one,100,8.5,G2V,\n"


@pytest.fixture
def stars(tmp_path):
    (tmp_path / "mine.csv").write_text(STARS)
    return str(tmp_path / "mine.csv")


def test_refresh_says_what_it_did(done, simbad, data_folder):
    out, _ = done("catalog", "refresh", "--url", simbad.url)
    (written,) = data_folder.iterdir()
    assert out.rstrip().endswith(f"wrote {written}")
    for words in ("blend of components", "added", "HD 999001", "removed", "eps Eri"):
        assert words in out


def test_refresh_as_json_and_nothing_else_on_stdout(call, simbad, data_folder):
    status, out, _ = call(
        "catalog", "refresh", "--url", simbad.url, "--json", "--v-mag-max", "4.5", "--parallax-min-mas", "50"
    )
    summary = json.loads(out)
    assert status == 0
    assert summary["cuts"] == {"v_mag_max": 4.5, "parallax_min_mas": 50.0}
    assert summary["counts"]["stars"] == 5
    assert summary["file"] == str(next(data_folder.iterdir()))
    assert "f.V <= 4.5" in summary["queries"][0]


def test_dry_run_asks_nothing_and_writes_nothing(done, simbad, data_folder):
    out, _ = done("catalog", "refresh", "--url", simbad.url, "--dry-run")
    assert simbad.url in out
    assert out.count("SELECT") == 2
    assert str(data_folder) in out
    out, _ = done("catalog", "refresh", "--dry-run", "--json", "--out", str(data_folder.parent / "x.ecsv"))
    plan = json.loads(out)
    assert plan["out"] == str(data_folder.parent / "x.ecsv")
    assert len(plan["queries"]) == 2
    assert simbad.paths == []
    assert not data_folder.exists()


@pytest.mark.parametrize(
    ("mode", "words"),
    [
        ("500", "HTTP 500"),
        ("hang", "within 0.3 s"),
        ("garbage", "VOTable"),
        ("server limit", "cut off"),
        ("error", "maintenance"),
    ],
)
def test_failure_is_one_line_with_a_remedy_and_status_1(call, simbad, data_folder, mode, words):
    simbad.mode, simbad.failures = mode, 99
    patience = "0.3" if mode == "hang" else "60"
    status, out, err = call("catalog", "refresh", "--url", simbad.url, "--timeout-s", patience, "--retries", "0")
    assert status == 1
    assert out == ""
    assert err.count("\n") == 1
    assert words in err
    assert "; " in err, "the remedy follows"
    assert not data_folder.exists()


def test_retries_are_announced(call, done, simbad, data_folder, monkeypatch):
    monkeypatch.setattr("time.sleep", lambda seconds: None)
    simbad.mode, simbad.failures = "drop", 2
    _, err = done("catalog", "refresh", "--url", simbad.url)
    assert err.count("trying again") == 2
    status, _, err = call("-q", "catalog", "refresh", "--url", simbad.url)
    assert (status, err) == (0, "")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--v-mag-max", "nan"], ["--v-mag-max", "finite"]),
        (["--parallax-min-mas", "0"], ["--parallax-min-mas"]),
        (["--retries", "-1"], ["retries"]),
        (["--timeout-s", "0"], ["--timeout-s"]),
        (["--maxrec", "0"], ["maxrec"]),
        (["--url", "simbad"], ["url", "http"]),
        (["--out", "x.csv"], ["--out", ".ecsv"]),
        (["--nonsense"], ["--nonsense"]),
    ],
)
def test_bad_options_are_bad_input(refuses, data_folder, arguments, words):
    refuses(["catalog", "refresh", *arguments], words)


def test_info_lists_refreshed_tables_and_the_latest(call, done, simbad, data_folder):
    out, _ = done("catalog", "info")
    assert "No refreshed table" in out
    assert call("catalog", "refresh", "--url", simbad.url)[0] == 0
    (written,) = data_folder.iterdir()
    older = written.with_name("simbad_2020-01-02T030405Z.ecsv")
    older.write_bytes(written.read_bytes())
    _, out, _ = call("catalog", "info")
    assert "2020-01-02 03:04 UTC" in out
    assert out.count("--catalog latest") == 1
    _, out, _ = call("catalog", "info", "--json")
    found = json.loads(out)
    assert found["latest"] == str(written)
    assert [item["file"] for item in found["refreshed"]] == [str(written), str(older)]


def test_rank_takes_a_file_latest_or_the_snapshot(call, done, simbad, data_folder, stars):
    status, out, err = call("rank", "--catalog", stars, "--band", "F520", "--json")
    result = json.loads(out)
    assert status == 0
    assert {row["name"] for row in result["targets"]} == {"mine", "HD 20794", "faint one"}, "no limit of V by itself"
    assert result["targets"][0]["ra_deg"] is None
    assert "mine.csv" in result["catalogue"]
    assert result["sample"].startswith("every star of mine.csv;")
    assert "columns not used: mood" in err
    status, out, _ = call("rank", "--catalog", stars, "--band", "F520", "--v-mag-max", "7", "--json")
    assert len(json.loads(out)["targets"]) == 2
    assert "with V <= 7;" in json.loads(out)["sample"]
    assert call("catalog", "refresh", "--url", simbad.url)[0] == 0
    out, err = done("rank", "--catalog", "latest", "--band", "F520", "--json")
    assert len(json.loads(out)["targets"]) == 10
    rough = ["rank", "--band", "F520", "--planets", "50", "--v-mag-max", "4", "--json"]
    _, plain, _ = call(*rough)
    _, named, _ = call(*rough, "--catalog", "snapshot")
    assert plain == named
    assert len(json.loads(plain)["targets"]) > 50


def test_same_star_gives_the_same_answer_from_any_table(call, tmp_path):
    _, out, _ = call("etc", "tau Cet", "--time-s", "7200", "--separation-arcsec", "0.5", "--band", "F520", "--json")
    expected = json.loads(out)
    from cpic_planner.targets import find_target

    star, _ = find_target("tau Cet")
    columns = ("ra_deg", "dec_deg", "distance_pc", "v_mag", "teff_k", "log_g", "metallicity")
    text = f"name,{','.join(columns)}\nmy own,{','.join(str(getattr(star, name)[0]) for name in columns)}\n"
    (tmp_path / "own.csv").write_text(text)
    status, out, _ = call(
        "etc",
        "my own",
        "--catalog",
        str(tmp_path / "own.csv"),
        *split("--time-s 7200 --separation-arcsec 0.5 --band F520 --json"),
    )
    found = json.loads(out)
    assert status == 0
    assert found["answers"][0]["snr"] == expected["answers"][0]["snr"]
    assert "own.csv" in found["catalogue"]
    assert "own.csv" in found["note"]
    assert "own.csv" not in expected["catalogue"]


def test_written_rankings_of_stars_without_a_position_read_back(call, done, tmp_path, stars):
    from astropy.table import Table

    for name in ("r.ecsv", "r.csv"):
        assert call("rank", "--catalog", stars, "--band", "F520", "--out", str(tmp_path / name))[0] == 0
    table = Table.read(tmp_path / "r.ecsv", format="ascii.ecsv")
    assert table["ra_deg"].mask.all()
    out, err = done("rank", "--catalog", str(tmp_path / "r.csv"), "--band", "F520", "--json")
    assert len(json.loads(out)["targets"]) == 3
    assert "columns not used" in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["rank", "--catalog", "nothere.csv"], ["nothere.csv", "snapshot, latest"]),
        (["rank", "--catalog", "latest"], ["latest", "cpic catalog refresh"]),
        (["etc", "tau Cet", "--catalog", "nothere.csv"], ["nothere.csv"]),
        (["plan", "--catalog", "nothere.csv", "--dry-run"], ["nothere.csv"]),
        (["rank", "--catalog", ""], ["catalog"]),
    ],
)
def test_a_missing_table_is_bad_input(refuses, data_folder, arguments, words):
    refuses(arguments, words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["etc", "Vega", "--catalog"], ["Vega", "a star of mine.csv"]),
        (["etc", "mino", "--catalog"], ["nearest: mine"]),
        (["etc", "tau Cet", "--catalog"], ["tau Cet is in the embedded catalogue, but not in this table"]),
        (["rank", "--v-mag-max", "1", "--catalog"], ["--v-mag-max", "leaves a star"]),
        (["rank", "--v-mag-max", "3.9", "--singles", "--dwarfs", "--v-mag-max", "nan", "--catalog"], ["--v-mag-max"]),
    ],
)
def test_stars_that_a_table_has_not(call, stars, arguments, words):
    status, _, err = call(*arguments, stars)
    assert status == 2
    assert all(word in err for word in words), err


@pytest.mark.long
def test_plan_of_a_users_table_counts_by_content_not_by_name(call, done, tmp_path, stars):
    out = str(tmp_path / "plan")
    asked = ["plan", "--top", "1", "--band", "F520", "--time-s", "1000", "--realisations", "1", "--planets", "200"]
    asked += ["--fidelity", "quick", "--out", out]
    status, text, _ = call(*asked, "--catalog", stars, "--json")
    plan = json.loads(text)
    assert status == 0
    assert plan["targets"][0]["name"] == "mine"
    assert str(tmp_path) not in text
    assert "mine.csv" in plan["catalogue"]
    report = (tmp_path / "plan" / "report.html").read_text()
    assert "mine.csv" in report
    assert str(tmp_path) not in report
    (tmp_path / "copy.csv").write_text(STARS)
    _, err = done(*asked, "--catalog", str(tmp_path / "copy.csv"))
    assert "reused 1 finished" in err
    (tmp_path / "copy.csv").write_text(STARS.replace("273.8", "273.9"))
    status, _, err = call(*asked, "--catalog", str(tmp_path / "copy.csv"))
    assert status == 2
    assert "--force" in err
