"""``cpic catalog refresh``: planets of the archive end to end; what a service does wrong changes nothing here."""

import json

import pytest

from catalogs import load_known_planets

REFRESH = ("catalog", "refresh")


def content(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())} if folder.exists() else {}


def row_of(archive, name):
    return next(row for row in archive.tables if row["pl_name"] == name)


def test_planets_are_stored_and_what_changed_is_shown(done, archive, data_folder):
    row_of(archive, "eps Eri b").update(pl_orbeccen=0.7, pl_orbeccenerr1=0.04, pl_orbeccenerr2=-0.04)
    archive.tables.remove(row_of(archive, "HD 102365 b"))
    out, err = done(*REFRESH, "--planets", "--url", archive.url)
    (written,) = data_folder.iterdir()
    assert written.name.startswith("archive_")
    assert err == ""
    for words in ("gone", "HD 102365 b", "orbit moved out of its errors", "0.06 ± 0.05", "0.7 ± 0.04", "10.0"):
        assert words in out
    assert out.rstrip().endswith(f"wrote {written}")
    out, _ = done("catalog", "info")
    assert "--known-planets latest" in out
    out, _ = done("catalog", "info", "--json")
    assert json.loads(out)["latest_planets"] == str(written)


def test_planets_as_json_and_nothing_else_on_stdout(done, archive, data_folder):
    row_of(archive, "eps Eri b").update(pl_orbper=5000.0)
    for row in archive.tables:
        row["hostname_old"] = row.pop("hostname")
    archive.rename = {"hostname_old": "pl_hostname"}
    out, _ = done(*REFRESH, "--planets", "--url", archive.url, "--json")
    summary = json.loads(out)
    assert summary["kind"] == "planets_refresh"
    assert summary["set_aside"] == ""
    assert summary["file"] == str(next(data_folder.iterdir()))
    (moved,) = summary["changes_to_snapshot"]["orbit_moved"]
    assert (moved["planet"], moved["element"], moved["now"]) == ("eps Eri b", "period_days", 5000.0)
    assert moved["sigmas"] > 3.0
    assert summary["notes"] == ["hostname is called pl_hostname"]


def test_known_takes_the_latest_table(done, archive, data_folder):
    row_of(archive, "eps Eri b").update(pl_orbeccen=0.7, rowupdate="2030-01-01")
    done(*REFRESH, "--planets", "--url", archive.url)
    table = load_known_planets("latest")
    assert table.number("eccentricity")[table.row_of("eps Eri b")] == 0.7
    out, _ = done("known", "eps Eri", "--known-planets", "latest", "--json", "--planets", "100")
    assert "archive_" in out


def test_dry_run_asks_nothing(done, archive, data_folder):
    out, _ = done(*REFRESH, "--planets", "--url", archive.url, "--dry-run", "--json")
    plan = json.loads(out)
    assert plan["queries"] == ["SELECT * FROM ps WHERE sy_dist <= 50"]
    assert plan["service"] == archive.url
    assert archive.paths == []
    assert not data_folder.exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--planets", "--v-mag-max", "5"], ["--v-mag-max", "not with --planets"]),
        (["--planets", "--parallax-min-mas", "5"], ["--parallax-min-mas", "not with --planets"]),
        (["--planets", "--out", "x.csv"], ["--out", ".ecsv"]),
        (["--planets", "--url", "http://archive.example/TAP"], ["url", "https://", "--plain-http"]),
    ],
)
def test_bad_options_are_bad_input(refuses, data_folder, arguments, words):
    refuses([*REFRESH, *arguments], words)


SLOW = pytest.mark.long  # one that hangs stands for them here; test_tap_client has them all
FAILURES = [
    *(pytest.param(mode, "within 0.1 s", marks=SLOW) for mode in ("trickled header", "continue", "redirect slowly")),
    ("many rows", "has no column"),
    ("hang", "within 0.1 s"),
    ("bomb", "the answer is empty"),
    ("500", "HTTP 500"),
    ("404", "HTTP 404"),
    ("html", "web page"),
    ("cut", "breaks off"),
    ("short", "dropped"),
    ("drop", "dropped"),
    ("error", "maintenance"),
    ("server limit", "cut off"),
    ("redirect", "redirects more than"),
    ("redirect file:///etc/passwd", "not followed"),
    ("redirect http://192.0.2.1/TAP", "not asked"),
    ("renamed", "has no column pl_orbper;"),
    ("no rows", "no planet of the answer"),
    ("one row", "set aside"),
]


@pytest.mark.parametrize(("mode", "words"), FAILURES)
def test_what_a_service_does_wrong_is_one_line_and_old_tables_stay(call, archive, data_folder, tmp_path, mode, words):
    data_folder.mkdir()
    (data_folder / "archive_2020-01-01T000000Z.ecsv").write_text("what was there")
    before = content(data_folder)
    if mode == "renamed":
        archive.rename = {"pl_orbper": "pl_period"}
    elif mode == "no rows":
        archive.alter = lambda headings, rows: (headings, [])
    elif mode == "one row":
        archive.tables = archive.tables[:1]
    else:
        archive.mode, archive.failures = mode, 99
    patience = "0.1" if "0.1" in words else "120"
    arguments = ["--planets", "--url", archive.url, "--timeout-s", patience, "--retries", "0"]
    status, out, err = call(*REFRESH, *arguments)
    assert status == 1
    assert err.count("\n") == 1
    assert words in err
    after = content(data_folder)
    aside = {name for name in after if name.startswith("set_aside_archive_")}
    assert len(aside) == (mode == "one row")
    assert {name: data for name, data in after.items() if name not in aside} == before
    assert (out == "") is not bool(aside)


def test_one_star_is_no_catalogue(call, simbad, data_folder):
    """It once became the latest table, with exit status 0."""
    (simbad.tables["basic"],) = ([row for row in simbad.tables["basic"] if row["main_id"] == "* tau Cet"],)
    status, out, err = call(*REFRESH, "--url", simbad.url)
    (written,) = data_folder.iterdir()
    assert (status, written.name[:17]) == (1, "set_aside_simbad_"), out
    assert "is the service whole?" in err
    assert call("rank", "--catalog", "latest")[0] == 2


def test_a_table_of_stars_that_lost_most_of_the_snapshot_is_set_aside(call, simbad, data_folder):
    status, out, err = call(*REFRESH, "--url", simbad.url)
    (written,) = data_folder.iterdir()
    assert status == 1
    assert written.name.startswith("set_aside_simbad_")
    assert "stars of the snapshot well within the cuts are not in the new table, more than 10%" in err
    assert f"set aside as {written}" in err
    assert "eps Eri" in out, "the person who judges sees what changed"
    status, _, err = call("rank", "--catalog", "latest")
    assert status == 2
    assert "cpic catalog refresh" in err


def test_a_chosen_file_is_not_replaced_by_a_table_that_lost_most(call, simbad, tmp_path):
    (tmp_path / "mine.ecsv").write_text("what was there")
    status, out, _ = call(*REFRESH, "--url", simbad.url, "--out", tmp_path / "mine.ecsv", "--json")
    assert status == 1
    assert (tmp_path / "mine.ecsv").read_text() == "what was there"
    assert json.loads(out)["file"] == str(tmp_path / "set_aside_mine.ecsv")
    assert json.loads(out)["set_aside"].startswith("1")


def test_stars_at_the_edge_of_the_cuts_may_go_and_those_well_inside_not(call, simbad, sky, data_folder):
    from catalogs import load_stars

    simbad.tables = sky.snapshot_sky(load_stars())
    edge = [row["oid"] for row in simbad.tables["basic"] if row["plx_value"] < 27.4]
    assert len(edge) > 0.1 * len(load_stars())
    simbad.tables["basic"] = [row for row in simbad.tables["basic"] if row["oid"] not in set(edge)]
    status, _, err = call(*REFRESH, "--url", simbad.url)
    assert status == 0, err
